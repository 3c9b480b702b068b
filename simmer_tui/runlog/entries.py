"""What the lines of a run log say, typed. msgspec reads a line into one of these and says what is
wrong with one that is none."""

from __future__ import annotations

import json
import math
from typing import Annotated, NoReturn

import msgspec

from simmer_tui.errors import RunLogError
from simmer_tui.events import ActionName, Goal, NoticeKind, Result
from simmer_tui.runlog.encode import USUAL_SOURCE
from simmer_tui.sim.command import escape
from simmer_tui.sim.records import Status

LARGEST = 1e12
"""No time (seconds), place (inches) or heading (degrees) is farther from 0."""
Real = Annotated[float, msgspec.Meta(ge=-LARGEST, le=LARGEST)]
Seconds = Annotated[float, msgspec.Meta(ge=-1e10, le=1e10)]
"""Time on the clock, within what calendars can say."""
Number = float | str
"""A reading; infinities and NaN, which JSON lacks, are the strings inf, -inf and nan."""
Count = Annotated[int, msgspec.Meta(ge=0)]
Fraction = Annotated[float, msgspec.Meta(ge=0, le=1)]
Place = tuple[Real, Real]
Placed = tuple[Real, Real, Real]
SUBJECTS: dict[str, Goal | Result] = {each.value: each for each in (*Goal, *Result)}
"""What a line about a mission may be about, by name."""
_SPECIAL = {"inf": math.inf, "-inf": -math.inf, "nan": math.nan}


class Line(msgspec.Struct, tag_field="kind", frozen=True, gc=False):
    """What every line has: simulated time, and seconds of real time since the log's beginning."""

    t: Real
    wall: Seconds = 0.0


class ReadLine(Line, tag="read", frozen=True, kw_only=True, gc=False):
    """A sensor that was read. Without `true` the reading was true."""

    n: Count
    command: str
    reply: Number
    true: Number | None = None
    source: str = USUAL_SOURCE
    taken: Real | None = None
    link: Real = 0.0


class AnswerLine(Line, tag="answer", frozen=True, kw_only=True, gc=False):
    """An answer to any other command."""

    n: Count
    command: str
    status: Status
    reply: Number
    reason: str = ""
    source: str = USUAL_SOURCE
    stops: bool = False
    taken: Real | None = None
    link: Real = 0.0


class GripFields(msgspec.Struct, frozen=True):
    """What the gripper did, and where the block then is."""

    closed: bool
    holding: bool
    block: Placed


class ContactFields(msgspec.Struct, frozen=True, kw_only=True):
    """A contact: when, where on the way (segment, fractions of its turn and its translation), the
    place touched."""

    t: Real
    at: tuple[Count, Fraction, Fraction]
    point: Place
    cell: tuple[Count, Count] | None = None
    ended: bool = False
    drift: bool = False
    held_block: bool = False


class Way(Line, frozen=True, kw_only=True):
    """What a plan and an end have in common: what kept the movement from its whole way.

    In a log that was one of format 1 `way` lists the centres gone through, and `arrival` and
    `heading` tell of the end of the way; its `total` is not known.
    """

    n: Count
    way: tuple[Place, ...] = ()
    arrival: Real = 0.0
    heading: Real = 0.0
    contact: ContactFields | None = None
    stop: tuple[Count, Fraction, Fraction] | None = None
    stopped_by: str = ""


class PlanLine(Way, tag="plan", frozen=True, kw_only=True):
    """A movement that begins, or is planned `again`. `total` is what it is to go, errors included."""

    command: str
    source: str = USUAL_SOURCE
    total: Placed | None = None
    grip: GripFields | None = None
    again: bool = False


class EndLine(Way, tag="end", frozen=True, kw_only=True):
    """A movement that is over."""

    pose: Placed
    answers: bool = True


class MoveLine(Way, tag="move", frozen=True, kw_only=True):
    """A movement that nothing came between, whole: `t` is its beginning."""

    command: str
    end: Real
    pose: Placed
    source: str = USUAL_SOURCE
    total: Placed | None = None
    grip: GripFields | None = None
    answers: bool = True

    def __post_init__(self) -> None:
        if self.end < self.t:
            raise ValueError("it ends before it begins")


class ActionLine(Line, tag="action", frozen=True, kw_only=True):
    """What a person did; `n` commands had been begun by then."""

    n: Count
    action: ActionName
    source: str
    arguments: tuple[Real, ...]
    text: str
    pose: Placed
    refused: bool = False

    def __post_init__(self) -> None:
        if not self.refused and len(self.arguments) != ARGUMENTS[self.action]:
            raise ValueError(f"{self.action} takes {ARGUMENTS[self.action]} arguments")


class BeliefLine(Line, tag="belief", frozen=True, kw_only=True):
    """Where a program believed the robot to be, and where it was."""

    believed: Placed
    pose: Placed
    spread: Real | None = None
    note: str = ""
    particles: tuple[tuple[Real, ...], ...] = ()

    def __post_init__(self) -> None:
        if any(len(each) not in (2, 3) for each in self.particles):
            raise ValueError("a particle is x, y or x, y, heading")


class NoticeLine(Line, tag="notice", frozen=True, kw_only=True):
    """Something beside the commands: who came, who left, what went wrong."""

    about: NoticeKind
    text: str
    subject: str = ""


class MissionLine(Line, tag="mission", frozen=True, kw_only=True):
    """A goal met, or a mission's beginning or end."""

    subject: str
    text: str
    reason: str = ""

    def __post_init__(self) -> None:
        if self.subject not in SUBJECTS:
            raise ValueError(f"{escape(self.subject, 40)!r} is none of {', '.join(SUBJECTS)}")


class TwinLine(Line, tag="twin", frozen=True, kw_only=True):
    """A sensor read on the real robot and on its simulated twin at once."""

    command: str
    code: str
    robot: Number
    simulated: Number
    source: str = USUAL_SOURCE


class MissionFields(msgspec.Struct, frozen=True, kw_only=True):
    """How far a mission was."""

    goals: dict[Goal, Real]
    result: Result
    reason: str
    helped: bool


class StateLine(Line, tag="state", frozen=True, kw_only=True):
    """All that must be known to read on from here."""

    n: Count
    pose: Placed
    block: Placed
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


class BrokenLine(msgspec.Struct, frozen=True):
    """A line that cannot be read, and why."""

    line: int
    reason: str

    def __str__(self) -> str:
        return f"line {self.line} is broken: {self.reason}"


Known = (
    ReadLine
    | MoveLine
    | AnswerLine
    | PlanLine
    | EndLine
    | ActionLine
    | BeliefLine
    | NoticeLine
    | MissionLine
    | TwinLine
    | StateLine
)
ARGUMENTS = {
    ActionName.RESET: 0,
    ActionName.TELEPORT: 3,
    ActionName.BLOCK: 2,
    ActionName.SEED: 1,
    ActionName.NOISE: 1,
    ActionName.BIAS: 1,
    ActionName.STOP: 0,
    ActionName.PAUSE: 0,
    ActionName.RESUME: 0,
    ActionName.SPEED: 1,
}
"""How many numbers each action takes."""
_DECODER: msgspec.json.Decoder[Known] = msgspec.json.Decoder(Known)


def parse_line(data: bytes, line: int) -> Known | BrokenLine:
    """What one line says. Never fails: a line that says nothing gives a `BrokenLine`."""
    try:
        return _DECODER.decode(data)
    except (ValueError, RecursionError) as error:
        if b"\\ud" in data.lower():  # half a pair of surrogates: JSON allows it, msgspec does not
            return _parse_slowly(data, line)
        return BrokenLine(line, escape(str(error), 160))


def _parse_slowly(data: bytes, line: int) -> Known | BrokenLine:
    try:
        known: Known = msgspec.convert(json.loads(data, parse_constant=_refuse), Known)
    except (ValueError, RecursionError) as error:
        return BrokenLine(line, escape(str(error), 160))
    return known


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is no JSON")


def number(value: Number) -> float:
    """The float a field stands for. Raises RunLogError for a text that is none."""
    if isinstance(value, str):
        try:
            return _SPECIAL[value]
        except KeyError:
            raise RunLogError(f"{escape(value, 40)!r} is not a number") from None
    return value
