"""The records of a run log: one struct for each kind of line, written and read by msgspec.

A record's definition is all that there is to a line: its keys, the range of their values, what is left out,
and where in an event each value is from. `encode.py` chooses the records of a run. `decode.py` knows the
parts of events that follow from a record and the header. Both know the most frequent kinds by hand.

Annotations are evaluated here. msgspec would evaluate their texts again for each record that inherits them,
which would take as long as the rest of this module.

JSON has no infinities and no NaN. A field that can hold them is a `LoggedNumber`, and `float()` gives the
number back.
"""

import json
import math
import operator
from itertools import zip_longest
from typing import Annotated, Any, ClassVar, final, get_args

import msgspec
from msgspec.structs import astuple

from simmer_tui.robot.actions import argument_count
from simmer_tui.run.belief_grid import GridBelief
from simmer_tui.run.events import (
    LARGEST_NUMBER,
    ActionDone,
    ActionName,
    Belief,
    CommandResult,
    DisplayChanged,
    Event,
    Goal,
    LegBegun,
    LegEnded,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    OutputLine,
    ProgramEnded,
    Real,
    Result,
    TwinReading,
    VelocityEnd,
    VelocityEnded,
    WireMessage,
)
from simmer_tui.run.state import MissionProgress, MissionSums, TimeSpent
from simmer_tui.runlog.line_form import (
    AXES_FORM,
    ENDLESS,
    GIVEN,
    NUMBER_FORM,
    POSE_FORM,
    TWIST_FORM,
    At,
    NotFinite,
    ValueForm,
    Values,
    form_of_part,
)
from simmer_tui.runlog.typed_json import TypedJson
from simmer_tui.sim.command import cut
from simmer_tui.sim.path import PathPosition
from simmer_tui.sim.records import Status, VelocityChange

USUAL_SOURCE = "client"
"""Source of a command whose record names none."""
NO_DELAY = 0.0
"""Delay of a link whose record names none."""
_HUNDREDTH = 100  # hundredths of an inch or of a degree

# Python's calendar ends in the year 9999, at 2.5e11 seconds.
RealSeconds = Annotated[float, msgspec.Meta(ge=-1e10, le=1e10)]
"""Real time, within the range of calendars."""
# Beyond 2**53 (9e15) a float no longer holds every whole number; 10**15 stays below that.
Hundredths = Annotated[int, msgspec.Meta(ge=-(10**15), le=10**15)]
"""Hundredths of an inch or of a degree, between two places within `LARGEST_NUMBER`."""
Count = Annotated[int, msgspec.Meta(ge=0)]
# Revolutions of a fast lidar in a time within `LARGEST_NUMBER`; -1 is the one before time 0.
Revolution = Annotated[int, msgspec.Meta(ge=-(10**14), le=10**14)]
Fraction = Annotated[float, msgspec.Meta(ge=0, le=1)]
LoggedPoint = tuple[Real, Real]
"""x, y, inches."""
LoggedPose = tuple[Real, Real, Real]
"""x, y, inches, and heading, degrees."""
LoggedPlace = tuple[Count, Fraction, Fraction]
"""A place on a path: its segment, and the fractions of the segment's turn and translation."""


LoggedNumber = float | NotFinite
"""A reading or a reply."""
_COPY = ValueForm(dict, dict)
"""A table that its owner continues to count in."""
PLACE_FORM = ValueForm(astuple, lambda value: PathPosition(*value))
_GOALS = ValueForm(
    lambda goals: {goal: time for goal, time in goals.items() if time is not None},
    lambda met: {goal: met.get(goal) for goal in Goal},
)
_GOAL = ValueForm(lambda subject: subject if isinstance(subject, Goal) else None, Goal)
_RESULT = ValueForm(lambda subject: subject if isinstance(subject, Result) else None, Result)


# Without garbage collection (gc=False): records hold no cycles, and millions of them are made.
# Defaults are left out: they are the usual case, and bytes count.
class LogRecord(msgspec.Struct, tag_field="kind", frozen=True, gc=False, omit_defaults=True):
    """A line of a log: simulated time, and seconds of real time since the log began."""

    event: ClassVar[type[Event] | None] = None
    """The kind of event that it records; None for a checkpoint."""
    given: ClassVar[tuple[str, ...]] = ()
    """More fields that the event does not have."""
    t: Annotated[Real, At("time")]
    real_time: Annotated[RealSeconds, GIVEN] = msgspec.field(default=0.0, name="real")


class CommandRecord(LogRecord, frozen=True, kw_only=True, gc=False):
    """A record of a command: its number, text and source."""

    n: Annotated[Count, At("number")]
    command: Annotated[str, At("command.text")] = msgspec.field(name="cmd")
    source: Annotated[str, At("command.source")] = USUAL_SOURCE


class ReplyRecord(CommandRecord, frozen=True, kw_only=True, gc=False):
    """A record of a reply, with the link's delay. What a line leaves out is usual: the command began at its
    time (`taken`), the robot had not moved since then (`before`), and it is where the line before with a
    pose has it (`pose`)."""

    taken: Annotated[Real | None, At("taken", unless="t")] = None
    link: Real = NO_DELAY
    pose: Annotated[LoggedPose | None, At("pose", POSE_FORM)] = None
    before: Annotated[LoggedPose | None, At("before", POSE_FORM, unless="pose")] = None


class ReadingRecord(ReplyRecord, tag="read", frozen=True, kw_only=True, gc=False):
    """A sensor reading. Without `true` it was exact. A scan has the `revolution`, and the `scan` in base64,
    unless it was read before; its reply is the first of its ranges."""

    event = CommandResult
    reply: Annotated[LoggedNumber | None, At("reply", NUMBER_FORM)] = None
    true: Annotated[LoggedNumber | None, At("reading.true", NUMBER_FORM, unless="reply")] = None
    revolution: Annotated[Revolution | None, GIVEN] = None
    scan: Annotated[str, GIVEN] = ""
    floats: Annotated[bool, GIVEN] = False


class VelocityFields(msgspec.Struct, frozen=True, omit_defaults=True):
    """The velocity that a command set: x, y, turning rate, and its end if it has one."""

    twist: Annotated[tuple[Real, Real, Real], At("twist", TWIST_FORM)]
    expires: Annotated[Real | None, At("expires", ENDLESS)] = None
    changed: bool = True
    slip: tuple[Real, ...] = ()
    limited: Real = 1.0


VELOCITY_FORM = form_of_part(VelocityFields, VelocityChange)


class GripFields(msgspec.Struct, frozen=True):
    """The gripper's action, and the block's pose after it."""

    closed: bool
    holding: bool
    block: Annotated[LoggedPose, At("block", POSE_FORM)]


GRIP_FORM = form_of_part(GripFields, dict)


class AnswerRecord(ReplyRecord, tag="answer", frozen=True, kw_only=True, gc=False):
    """The answer to any other command."""

    event = CommandResult
    reply: Annotated[LoggedNumber, At("reply", NUMBER_FORM)]
    status: Status
    reason: str = ""
    stops: Annotated[bool, At("command.stops")] = False
    velocity: Annotated[VelocityFields | None, At("velocity", VELOCITY_FORM)] = None
    waits: Real = 0.0
    grip: Annotated[GripFields | None, At("grip", GRIP_FORM)] = None


class ContactFields(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A contact: its time, its place on the path (segment, fractions of the segment's turn and of its
    translation), the point touched."""

    t: Annotated[Real, At("time")]
    at: Annotated[LoggedPlace, At("place", PLACE_FORM)]
    point: LoggedPoint
    cell: tuple[Count, Count] | None = None
    ended: bool = False
    drift: bool = False
    held_block: bool = False


CONTACT_FORM = form_of_part(ContactFields, dict)


class MovementRecord(CommandRecord, frozen=True, kw_only=True):
    """A record of a movement from a pose: when it began, its displacement, errors included, and the reasons
    for leaving its whole path. Without `begin` it began at the record's time."""

    begin: Annotated[Real | None, At("trajectory.start_time", unless="t")] = None
    origin: Annotated[LoggedPose, At("trajectory.before", POSE_FORM)] = msgspec.field(name="from")
    total: Annotated[LoggedPose, At("trajectory.totals", AXES_FORM)]
    contact: Annotated[ContactFields | None, At("trajectory.contact", CONTACT_FORM)] = None
    stop: Annotated[LoggedPlace | None, At("trajectory.rest_stop", PLACE_FORM)] = None
    grip: Annotated[GripFields | None, At("grip", GRIP_FORM)] = None

    def __post_init__(self) -> None:
        # All later code relies on it, and a log may have been edited by hand.
        if self.begin is not None and self.t < self.begin:
            raise ValueError("it ends before it begins")


class PlanRecord(MovementRecord, tag="plan", frozen=True, kw_only=True):
    """The plan of a movement, made at its beginning, or `again` during it."""

    event = MovementPlanned
    again: Annotated[bool, GIVEN] = False


class EndRecord(MovementRecord, tag="end", frozen=True, kw_only=True):
    """The end of a movement, as it really went."""

    event = MovementEnded
    pose: Annotated[LoggedPose, At("pose", POSE_FORM)]
    stopped_by: str = ""
    answers: bool = True


class CourseRecord(CommandRecord, frozen=True, kw_only=True):
    """A record of a leg of a continuous motion from a pose: `velocity` of its centre (global), turning rate
    of its path and beside it, commanded velocity of the wheels (key `told`)."""

    origin: Annotated[LoggedPose, At("leg.before", POSE_FORM)] = msgspec.field(name="from")
    velocity: Annotated[LoggedPoint, At("leg.arc.velocity")]
    rate: Annotated[Real, At("leg.arc.rate")]
    spin: Annotated[Real, At("leg.arc.spin")] = 0.0
    commanded: Annotated[tuple[Real, Real, Real], At("leg.commanded", TWIST_FORM)] = msgspec.field(
        name="told"
    )
    pressed: Annotated[bool, At("leg.pressed")] = False
    contact: Annotated[ContactFields | None, At("leg.contact", CONTACT_FORM)] = None


class LegRecord(CourseRecord, tag="leg", frozen=True, kw_only=True):
    """The beginning of a leg, and its end and last pose unless something interrupts it. Without an end it
    continues until something changes."""

    event = LegBegun
    end: Annotated[Real | None, At("leg.end_time", ENDLESS)] = None
    last_pose: Annotated[LoggedPose, At("leg.last_pose", POSE_FORM)] = msgspec.field(name="to")

    def __post_init__(self) -> None:
        if self.end is not None and self.end < self.t:
            raise ValueError("it ends before it begins")


class LegEndRecord(CourseRecord, tag="leg_end", frozen=True, kw_only=True):
    """The end of a leg, as it really went."""

    event = LegEnded
    begin: Annotated[Real, At("leg.start_time")]
    pose: Annotated[LoggedPose, At("leg.last_pose", POSE_FORM)]

    def __post_init__(self) -> None:
        if self.t < self.begin:
            raise ValueError("it ends before it begins")


class VelocityEndRecord(LogRecord, tag="velocity", frozen=True, kw_only=True):
    """The end of a velocity without a command that set another."""

    event = VelocityEnded
    reason: VelocityEnd
    source: str = ""


class ActionRecord(LogRecord, tag="action", frozen=True, kw_only=True, gc=False):
    """A person's action; `n` commands had begun before it."""

    event = ActionDone
    n: Annotated[Count, GIVEN]
    action: Annotated[ActionName, At("action.name")]
    source: Annotated[str, At("action.source")]
    arguments: Annotated[tuple[int | Real, ...], At("action.arguments")]
    text: str
    pose: Annotated[LoggedPose, At("pose", POSE_FORM)]
    refused: bool = False

    def __post_init__(self) -> None:
        count = argument_count(self.action)
        # A refused action may have been refused for its arguments.
        if not self.refused and len(self.arguments) != count:
            raise ValueError(f"{self.action} takes {count} arguments")
        # Seeds have more digits than other numbers.
        if self.action is not ActionName.SEED and any(abs(each) > LARGEST_NUMBER for each in self.arguments):
            raise ValueError(f"an argument of {self.action} is beyond {LARGEST_NUMBER:g}")


class BeliefRecord(LogRecord, tag="belief", frozen=True, kw_only=True, gc=False):
    """A program's belief, and the true pose at that time, left out as in a `ReplyRecord`. Particles are
    columns of x, y and heading (null without one), in whole hundredths of an inch and of a degree from
    `believed`, which keeps them short. `again` is true for the previous belief, now with the cells of its
    grid."""

    event = Belief
    believed: Annotated[LoggedPose, At("pose", POSE_FORM)]
    pose: Annotated[LoggedPose | None, At("true", POSE_FORM)] = None
    spread: Real | None = None
    note: str = ""
    grid: GridBelief | None = None
    again: bool = False
    # A cloud of particles is most of a log: as rows of floats it takes twice the room.
    particles: Annotated[tuple[tuple[Hundredths | None, ...], ...], GIVEN] = ()

    def __post_init__(self) -> None:
        if not self.particles:
            return
        counts = {len(column) for column in self.particles}
        # Only headings may be missing.
        missing = any(None in column for column in self.particles[:2])
        if len(self.particles) not in (0, 2, 3) or len(counts) > 1 or missing:
            raise ValueError("particles are columns of x and y, or of x, y and heading")


def packed_particles(
    particles: tuple[tuple[float, ...], ...], believed: LoggedPose
) -> tuple[tuple[int | None, ...], ...]:
    """The columns of a `BeliefRecord`.

    Args:
        particles: x, y (inches) and maybe heading (degrees) of each, rounded to hundredths.
    """
    origin = [round(value * _HUNDREDTH) for value in believed]
    return tuple(
        tuple([None if value is None else round(value * _HUNDREDTH) - zero for value in column])
        for column, zero in zip(zip_longest(*particles), origin, strict=False)
    )


def unpacked_particles(record: BeliefRecord) -> tuple[tuple[float, ...], ...]:
    """The particles of a belief: x, y (inches) and maybe heading (degrees) of each."""
    # Whole hundredths divided by 100 give the float nearest to the decimal number, as round() does.
    origin = [round(value * _HUNDREDTH) for value in record.believed]
    columns = (
        [math.nan if value is None else (value + zero) / _HUNDREDTH for value in column]
        for column, zero in zip(record.particles, origin, strict=False)
    )
    rows = zip(*columns, strict=True)
    return tuple([row if row[-1] == row[-1] else row[:2] for row in rows])  # NaN is not itself


class NoticeRecord(LogRecord, tag="notice", frozen=True, kw_only=True):
    """A notice: a connection, a fault, the program. Reports use the time of a fault, or of a board, alone."""

    event = Notice
    given: ClassVar[tuple[str, ...]] = ("t",)
    about: Annotated[NoticeKind, At("kind")]
    text: str
    subject: str = ""
    advice: bool = False


class WireRecord(LogRecord, tag="wire", frozen=True, kw_only=True):
    """Bytes on the line of a dialect, one character each."""

    event = WireMessage
    data: str
    reply: bool = False
    meaning: str = ""


class DisplayRecord(LogRecord, tag="display", frozen=True, kw_only=True):
    """A board's LED, and the rows of each of its displays, from a time on."""

    event = DisplayChanged
    board: str
    led: bool = False
    led_pin: str = "13"
    displays: tuple[tuple[str, ...], ...] = ()


class MissionRecord(LogRecord, tag="mission", frozen=True, kw_only=True):
    """A goal met, or a mission's beginning or end."""

    event = MissionEvent
    goal: Annotated[Goal | None, At("subject", _GOAL)] = None
    result: Annotated[Result | None, At("subject", _RESULT)] = None
    text: str
    reason: str = ""

    def __post_init__(self) -> None:
        # A Goal and a Result are both texts in JSON: two fields distinguish them.
        if (self.goal is None) == (self.result is None):
            raise ValueError("it needs a goal or a result")


class ProgramRecord(LogRecord, tag="program", frozen=True, kw_only=True):
    """The end of the program that drove the robot, with the last lines of its output."""

    event = ProgramEnded
    exit_code: int
    signal: str = ""
    stopped: bool = False
    error: str = ""
    place: str = ""
    stderr: tuple[OutputLine, ...] = ()
    stdout: tuple[OutputLine, ...] = ()


class TwinRecord(LogRecord, tag="twin", frozen=True, kw_only=True):
    """A reading of the real robot and of its simulated twin at the same time."""

    event = TwinReading
    command: Annotated[str, At("command.text")] = msgspec.field(name="cmd")
    code: str
    robot: Annotated[LoggedNumber, At("robot", NUMBER_FORM)]
    simulated: Annotated[LoggedNumber, At("simulated", NUMBER_FORM)]
    source: Annotated[str, At("command.source")] = USUAL_SOURCE


class MissionSumsFields(msgspec.Struct, frozen=True):
    """Sums of the run at the end of its mission."""

    time: Real
    distance: Real
    commands: Count
    contacts: Count
    driving: Annotated[Real, At("spent.driving")]
    link: Annotated[Real, At("spent.link")]
    reading: Annotated[dict[str, Real], At("spent.by_sensor", _COPY)]


def _sums(spent: Values, **others: Any) -> MissionSums:
    return MissionSums(spent=TimeSpent(**spent), **others)


_SUMS = form_of_part(MissionSumsFields, _sums)


class MissionFields(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Progress of a mission. Goals that are not met are left out."""

    goals: Annotated[dict[Goal, Real], At("goals", _GOALS)]
    result: Result
    reason: str
    helped: bool
    end: Annotated[MissionSumsFields | None, At("end", _SUMS)] = None


_MISSION = form_of_part(MissionFields, MissionProgress)


class CheckpointRecord(LogRecord, tag="checkpoint", frozen=True, kw_only=True):
    """The state of the run, from which reading can begin."""

    n: Annotated[Count, At("commands")]
    pose: Annotated[LoggedPose, At("pose", POSE_FORM)]
    block: Annotated[LoggedPose, At("block", POSE_FORM)]
    seed: Count
    holding: bool
    noise: bool
    paused: bool
    time_scale: Real
    contacts: Count
    distance: Real
    client: str
    mission: Annotated[MissionFields | None, At("mission", _MISSION)] = None
    driving: Annotated[Real, At("spent.driving")] = 0.0
    link: Annotated[Real, At("spent.link")] = 0.0
    reading: Annotated[dict[str, Real], At("spent.by_sensor", _COPY)] = {}
    displays: tuple[DisplayChanged, ...] = ()


@final
class BrokenLine(msgspec.Struct, frozen=True):
    """A line that cannot be read, and why."""

    line: int
    reason: str

    def __str__(self) -> str:
        return f"line {self.line} is broken: {self.reason}"


AnyRecord = (
    ReadingRecord
    | AnswerRecord
    | PlanRecord
    | EndRecord
    | ActionRecord
    | BeliefRecord
    | NoticeRecord
    | MissionRecord
    | TwinRecord
    | ProgramRecord
    | CheckpointRecord
    | LegRecord
    | LegEndRecord
    | VelocityEndRecord
    | WireRecord
    | DisplayRecord
)
RECORDS: tuple[type[LogRecord], ...] = get_args(AnyRecord)
"""All kinds of records."""
_LINE: TypedJson[AnyRecord] = TypedJson(AnyRecord)
# Some numbers of a run are NumPy scalars.
_plain_number = operator.methodcaller("item")
"""The plain number of a NumPy scalar, which msgspec cannot encode."""
_ENCODER = msgspec.json.Encoder(enc_hook=_plain_number)


def encode_line(record: msgspec.Struct) -> bytes:
    """The line of a record, in ASCII: a log that is shown on a terminal must not control it."""
    try:
        data = _ENCODER.encode(record)
    except UnicodeEncodeError:  # half a pair of surrogates: JSON allows it, msgspec does not
        data = b"\xff"
    # Rare: names typed by people. The json module escapes what is not ASCII, msgspec does not.
    if not data.isascii():
        fields = msgspec.to_builtins(record, enc_hook=_plain_number)
        data = json.dumps(fields, separators=(",", ":"), allow_nan=False).encode()
    return data + b"\n"


def decode_line(data: bytes, line: int) -> AnyRecord | BrokenLine:
    """The record of a line. Never fails: a line without one gives a `BrokenLine`."""
    try:
        return _LINE.decode(data)
    except ValueError as error:
        return BrokenLine(line, cut(str(error)) if data.strip() else "it is empty")


def decode_lines(data: bytes) -> list[AnyRecord] | None:
    """The records of whole lines, all at once; None if any line is broken."""
    return _LINE.decode_lines(data)
