"""The records of a run log: one struct for each kind of line, written and read by msgspec.

`encode.py` makes records of events, and `decode.py` makes events of records. JSON has no infinities and no
NaN, and msgspec would write them as null. A field that can hold them is a `LoggedNumber`: `logged_number`
makes one, and `float()` gives the number back.
"""

from __future__ import annotations

import json
import math
import operator
from enum import StrEnum
from itertools import zip_longest
from typing import Annotated, Any, final

import msgspec

from simmer_tui.robot.actions import argument_count
from simmer_tui.run.belief_grid import GridBelief
from simmer_tui.run.events import (
    LARGEST_NUMBER,
    ActionName,
    Goal,
    NoticeKind,
    OutputLine,
    Real,
    Result,
    VelocityEnd,
)
from simmer_tui.runlog.typed_json import TypedJson
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import cut
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import Status

USUAL_SOURCE = "client"
"""Source of a command whose record names none."""
# msgspec leaves out a field that holds the same object as its default, not one that is only equal.
NO_DELAY = 0.0
"""Default of a delay on the link, seconds."""
NO_REPLY = math.nan
"""Reply of a reading whose scan has it. A reply that is no number is written as `NotFinite`."""
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


class NotFinite(StrEnum):
    """The numbers that JSON lacks. `float()` turns one back into a number."""

    INFINITY = "inf"
    MINUS_INFINITY = "-inf"
    NAN = "nan"


LoggedNumber = float | NotFinite
"""A reading or a reply."""


def logged_number(value: float) -> LoggedNumber:
    """A number as a record holds it."""
    return value if abs(value) < math.inf else NotFinite(str(float(value)))


def logged_pose(pose: Pose | Block) -> LoggedPose:
    """A pose as a record holds it."""
    return pose.x, pose.y, pose.heading


# Without garbage collection (gc=False): records hold no cycles, and millions of them are made.
# Defaults are left out: they are the usual case, and bytes count.
class LogRecord(msgspec.Struct, tag_field="kind", frozen=True, gc=False, omit_defaults=True):
    """A line of a log: simulated time, and seconds of real time since the log began."""

    t: Real
    real_time: RealSeconds = msgspec.field(default=0.0, name="real")


class ReplyRecord(LogRecord, frozen=True, kw_only=True, gc=False):
    """A record of a reply: its command's number, text and source, the time when the command began if earlier,
    and the link's delay."""

    n: Count
    command: str = msgspec.field(name="cmd")
    source: str = USUAL_SOURCE
    reply: LoggedNumber
    taken: Real | None = None
    link: Real = NO_DELAY


class ReadingRecord(ReplyRecord, tag="read", frozen=True, kw_only=True, gc=False):
    """A sensor reading. Without `true` it was exact. A scan also has the `revolution`, and the `scan` in
    base64, unless it was read before; its reply is the first of its ranges."""

    reply: LoggedNumber = NO_REPLY
    true: LoggedNumber | None = None
    revolution: Revolution | None = None
    scan: str = ""
    floats: bool = False


class VelocityFields(msgspec.Struct, frozen=True, omit_defaults=True):
    """The velocity that a command set: x, y, turning rate, and its end if it has one."""

    twist: tuple[Real, Real, Real]
    expires: Real | None = None
    changed: bool = True
    slip: tuple[Real, ...] = ()
    limited: Real = 1.0


class AnswerRecord(ReplyRecord, tag="answer", frozen=True, kw_only=True, gc=False):
    """The answer to any other command."""

    status: Status
    reason: str = ""
    stops: bool = False
    velocity: VelocityFields | None = None
    waits: Real = 0.0


class GripFields(msgspec.Struct, frozen=True):
    """The gripper's action, and the block's pose after it."""

    closed: bool
    holding: bool
    block: LoggedPose


class ContactFields(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A contact: its time, its place on the path (segment, fractions of the segment's turn and of its
    translation), the point touched."""

    t: Real
    at: tuple[Count, Fraction, Fraction]
    point: LoggedPoint
    cell: tuple[Count, Count] | None = None
    ended: bool = False
    drift: bool = False
    held_block: bool = False


class MovementRecord(LogRecord, frozen=True, kw_only=True):
    """A record of a movement, with the reasons for leaving its whole path."""

    n: Count
    contact: ContactFields | None = None
    stop: tuple[Count, Fraction, Fraction] | None = None
    stopped_by: str = ""


class PlannedRecord(MovementRecord, frozen=True, kw_only=True):
    """A record with a movement's plan. `total` is the planned displacement, errors included."""

    command: str = msgspec.field(name="cmd")
    source: str = USUAL_SOURCE
    total: LoggedPose | None = None
    grip: GripFields | None = None


class PlanRecord(PlannedRecord, tag="plan", frozen=True, kw_only=True):
    """The plan of a movement, made at its beginning, or `again` during it."""

    again: bool = False


class EndRecord(MovementRecord, tag="end", frozen=True, kw_only=True):
    """The end of a movement."""

    pose: LoggedPose
    answers: bool = True


class MoveRecord(PlannedRecord, tag="move", frozen=True, kw_only=True):
    """A whole movement, if nothing came between its plan and its end. `t` is its beginning."""

    end: Real
    pose: LoggedPose
    answers: bool = True

    def __post_init__(self) -> None:
        # All later code relies on it, and a log may have been edited by hand.
        if self.end < self.t:
            raise ValueError("it ends before it begins")


class LegRecord(LogRecord, tag="leg", frozen=True, kw_only=True):
    """The beginning of a leg of a continuous motion, and its course unless something interrupts it:
    `velocity` of its centre (global), turning rate of its path and beside it, commanded velocity of
    the wheels (key `told`), and its end. Without an end it continues until something changes."""

    n: Count
    command: str = msgspec.field(name="cmd")
    source: str = USUAL_SOURCE
    end: Real | None = None
    velocity: LoggedPoint
    rate: Real
    spin: Real = 0.0
    commanded: tuple[Real, Real, Real] = msgspec.field(name="told")
    pose: LoggedPose
    pressed: bool = False
    contact: ContactFields | None = None

    def __post_init__(self) -> None:
        if self.end is not None and self.end < self.t:
            raise ValueError("it ends before it begins")


class LegCutRecord(LogRecord, tag="cut", frozen=True):
    """The end of the leg under way before its time."""


class VelocityEndRecord(LogRecord, tag="velocity", frozen=True, kw_only=True):
    """The end of a velocity without a command that set another."""

    reason: VelocityEnd
    source: str = ""


class ActionRecord(LogRecord, tag="action", frozen=True, kw_only=True, gc=False):
    """A person's action; `n` commands had begun before it."""

    n: Count
    action: ActionName
    source: str
    arguments: tuple[int | Real, ...]
    text: str
    pose: LoggedPose
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
    """A program's belief, and the true pose at that time. Particles are columns of x, y and heading (null
    without one), in whole hundredths of an inch and of a degree from `believed`. `again` is true for the
    previous belief, now with the cells of its grid."""

    believed: LoggedPose
    pose: LoggedPose
    spread: Real | None = None
    note: str = ""
    grid: GridBelief | None = None
    again: bool = False
    # A cloud of particles is most of a log: as rows of floats it takes twice the room.
    particles: tuple[tuple[Hundredths | None, ...], ...] = ()

    def __post_init__(self) -> None:
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
    """A notice: a connection, a fault, the program."""

    about: NoticeKind
    text: str
    subject: str = ""
    advice: bool = False


class WireRecord(LogRecord, tag="wire", frozen=True, kw_only=True):
    """Bytes on the line of a dialect, one character each."""

    data: str
    reply: bool = False
    meaning: str = ""


class MissionRecord(LogRecord, tag="mission", frozen=True, kw_only=True):
    """A goal met, or a mission's beginning or end."""

    goal: Goal | None = None
    result: Result | None = None
    text: str
    reason: str = ""

    def __post_init__(self) -> None:
        # A Goal and a Result are both texts in JSON: two fields distinguish them.
        if (self.goal is None) == (self.result is None):
            raise ValueError("it needs a goal or a result")


class ProgramRecord(LogRecord, tag="program", frozen=True, kw_only=True):
    """The end of the program that drove the robot, with the last lines of its output."""

    exit_code: int
    signal: str = ""
    stopped: bool = False
    error: str = ""
    place: str = ""
    stderr: tuple[OutputLine, ...] = ()
    stdout: tuple[OutputLine, ...] = ()


class TwinRecord(LogRecord, tag="twin", frozen=True, kw_only=True):
    """A reading of the real robot and of its simulated twin at the same time."""

    command: str = msgspec.field(name="cmd")
    code: str
    robot: LoggedNumber
    simulated: LoggedNumber
    source: str = USUAL_SOURCE


class MissionSumsFields(msgspec.Struct, frozen=True):
    """Sums of the run at the end of its mission. Older logs have no time spent among them."""

    time: Real
    distance: Real
    commands: Count
    contacts: Count
    driving: Real = 0.0
    link: Real = 0.0
    reading: dict[str, Real] = {}


class MissionFields(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Progress of a mission."""

    goals: dict[Goal, Real]
    result: Result
    reason: str
    helped: bool
    end: MissionSumsFields | None = None


class CheckpointRecord(LogRecord, tag="checkpoint", frozen=True, kw_only=True):
    """The state of the run, from which reading can begin."""

    n: Count
    pose: LoggedPose
    block: LoggedPose
    seed: Count
    holding: bool
    noise: bool
    paused: bool
    time_scale: Real
    contacts: Count
    distance: Real
    client: str
    mission: MissionFields | None = None
    driving: Real = 0.0
    link: Real = 0.0
    reading: dict[str, Real] = {}


def shared_fields(source: msgspec.Struct, target: type[msgspec.Struct], *apart: str) -> dict[str, Any]:
    """The values of `source` for the fields that `target` has by the same name, except those `apart`, which
    have another form there. An event and its record share most of their fields."""
    names = set(source.__struct_fields__).intersection(target.__struct_fields__).difference(apart)
    return {name: getattr(source, name) for name in names}


@final
class BrokenLine(msgspec.Struct, frozen=True):
    """A line that cannot be read, and why."""

    line: int
    reason: str

    def __str__(self) -> str:
        return f"line {self.line} is broken: {self.reason}"


AnyRecord = (
    ReadingRecord
    | MoveRecord
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
    | LegCutRecord
    | VelocityEndRecord
    | WireRecord
)
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
