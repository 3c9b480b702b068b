"""What happened in a run, as its report lists and draws it: movements, contacts, refusals, jumps, readings,
beliefs and remarks, each with when it was and in which line of the log."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from simmer_tui.events import CommandResult
from simmer_tui.run.bounded import Errors, Thinned
from simmer_tui.run.facts import degrees_beside
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Piece:
    """One movement as drawn: when (elapsed seconds), and through which centres."""

    begin: float
    end: float
    points: Sequence[Point]


@dataclass(frozen=True, slots=True)
class Touch:
    """A contact: when, by which command, the robot's pose at the movement's end, how far it had come by
    then (inches, degrees), and by sensor what had been read since the movement before it."""

    elapsed: float
    line: int
    shown: str
    pose: Pose
    contact: Contact
    went: float
    turned: float
    read: Mapping[str, CommandResult]

    @property
    def point(self) -> Point:
        """Which point was touched."""
        return self.contact.point

    @property
    def ended(self) -> bool:
        """Whether it ended the movement."""
        return self.contact.ended

    @property
    def seen(self) -> tuple[CommandResult, ...]:
        """What had been read: range sensors first, of these the one that looks there."""
        return _by_lookout(self.read.values(), self.contact)


@dataclass(slots=True)
class Bump:
    """A contact, or several in a row of the same command at the same place; `until` is when (elapsed
    seconds) the last one was."""

    touch: Touch
    until: float
    count: int = 1


@dataclass(frozen=True, slots=True)
class Refusal:
    """A command that did nothing: when, in which line, and what it was answered."""

    elapsed: float
    line: int
    outcome: CommandResult


@dataclass(frozen=True, slots=True)
class Jump:
    """A teleport or restart: when, which, and between which poses."""

    elapsed: float
    name: str
    line: int
    begin: Pose
    end: Pose


@dataclass(frozen=True, slots=True)
class TracePoint:
    """A reading in a trace. `order` counts the sensor's readings from 0."""

    elapsed: float
    order: int
    value: float
    true: float


@dataclass(slots=True)
class SensorRecord:
    """What one sensor did."""

    trace: Thinned[TracePoint]
    readings: int = 0
    errors: Errors = field(default_factory=Errors)
    missed: int = 0
    """Readings that saw something where nothing was in range, or the reverse."""


@dataclass(frozen=True, slots=True)
class BeliefPoint:
    """A believed pose, and how far it was off (inches, degrees)."""

    elapsed: float
    line: int
    believed: Pose
    distance: float
    turn: float


@dataclass(slots=True)
class CodeRecord:
    """How often a code was sent, and how often in vain."""

    count: int = 0
    refused: int = 0
    contacts: int = 0


@dataclass(frozen=True, slots=True)
class Remark:
    """Something that was told: when, in which line, and in what words."""

    elapsed: float
    line: int
    text: str


def _by_lookout(seen: Iterable[CommandResult], contact: Contact) -> tuple[CommandResult, ...]:
    """Readings in the order of what they could say of a contact."""

    def rank(outcome: CommandResult) -> float:
        sensor = outcome.reading.sensor if outcome.reading is not None else None
        return degrees_beside(contact, sensor) if sensor is not None and sensor.kind.is_range else math.inf

    return tuple(sorted(seen, key=rank))
