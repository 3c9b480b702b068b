"""What the lines of a run log say, typed."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from simmer_tui.actions import ActionName
from simmer_tui.runlog.numbers import number, numbers
from simmer_tui.sim.command import escape
from simmer_tui.sim.records import FloorPatch, Pose, RangeScan, Status
from simmer_tui.sim.sensors import TEST_POINTS

REFUSALS = (Status.REFUSED, Status.UNKNOWN, Status.BUSY, Status.UNANSWERED)
"""Verdicts of commands that did nothing, or that a real robot did not answer."""


@dataclass(frozen=True, slots=True)
class GripEntry:
    """What the gripper did, and where the block then is."""

    closed: bool
    holding: bool
    block: Pose


@dataclass(frozen=True, slots=True)
class CommandEntry:
    """One command and what became of it.

    `line` counts from 1, `t` is the simulated time of the reply, `wall` seconds since 1970.
    A reading has `sensor` (its ID), `true` and perhaps `view`; a movement has `begin`, `end` and
    `path`, the centres it went through (for one merely accepted: is to go through), and `contact`,
    the place where it met a wall at `contact_time`, if it met one; that ended the movement if it `held`
    the robot, from that time on. `cut` means that it was stopped early.
    A command for the gripper is a movement that stands still, with `grip`.
    """

    line: int
    t: float
    wall: float
    number: int
    status: Status
    source: str
    command: str
    reply: float
    before: Pose
    pose: Pose
    reason: str = ""
    sensor: str = ""
    true: float = math.nan
    view: RangeScan | FloorPatch | None = None
    begin: float = math.nan
    end: float = math.nan
    cut: bool = False
    path: tuple[tuple[float, float], ...] = ()
    contact: tuple[float, float] | None = None
    contact_time: float = math.nan
    held: float | None = None
    grip: GripEntry | None = None

    @property
    def shown(self) -> str:
        """The command as sent, safe on any terminal."""
        return escape(self.command)

    @property
    def moved(self) -> bool:
        """Whether this is a movement, done or under way, whose path is known: a simulated one."""
        return bool(self.path)

    @property
    def refused(self) -> bool:
        """Whether the command did nothing."""
        return self.status in REFUSALS

    @property
    def started(self) -> float:
        """Simulated time at which the command was taken up."""
        return self.begin if self.moved else self.t

    @property
    def arrival(self) -> float:
        """Simulated time at which a movement brings the robot to a stand."""
        return self.end if self.held is None else min(self.held, self.end)

    def pose_at(self, time: float) -> Pose:
        """The robot's pose at a simulated time while this movement goes on.

        Along the path at even speed; the heading, which a log holds for both ends only, likewise.
        """
        return self._pose_along(self._fraction(time))

    def trail(self, time: float) -> tuple[tuple[float, float], ...]:
        """The part of the path that has been gone at a simulated time."""
        fraction = self._fraction(time)
        if fraction >= 1.0 or len(self.path) < 2:
            return self.path
        passed, pose = self._passed(fraction)[0], self._pose_along(fraction)
        return (*self.path[: passed + 1], (pose.x, pose.y))

    def _fraction(self, time: float) -> float:
        duration = self.arrival - self.begin
        return min(max((time - self.begin) / duration, 0.0), 1.0) if duration > 0 else 1.0

    def _passed(self, fraction: float) -> tuple[int, float]:
        """The piece of the path one is on after a fraction of its length, and the fraction of that piece."""
        lengths = [math.dist(a, b) for a, b in pairwise(self.path)]
        left = fraction * math.fsum(lengths)
        for piece, length in enumerate(lengths):
            if left < length:
                return piece, left / length
            left -= length
        return max(len(lengths) - 1, 0), 1.0

    def _pose_along(self, fraction: float) -> Pose:
        if fraction >= 1.0 or len(self.path) < 2:
            return self.pose if fraction >= 1.0 else self.before
        piece, part = self._passed(fraction)
        (x, y), (next_x, next_y) = self.path[piece], self.path[piece + 1]
        heading = self.before.heading + fraction * (self.pose.heading - self.before.heading)
        return Pose(x + part * (next_x - x), y + part * (next_y - y), heading)


@dataclass(frozen=True, slots=True)
class ActionEntry:
    """What a person did; `number` commands had been begun by then. `pose` is the robot's after it."""

    line: int
    t: float
    wall: float
    number: int
    source: str
    action: ActionName
    arguments: tuple[float, ...]
    refused: bool
    text: str
    pose: Pose

    @property
    def restarts(self) -> bool:
        """Whether the run began anew, with simulated time 0."""
        return self.action in (ActionName.RESET, ActionName.SEED) and not self.refused


@dataclass(frozen=True, slots=True)
class BeliefEntry:
    """Where a program believed the robot to be, and where it was (`pose`)."""

    line: int
    t: float
    wall: float
    believed: Pose
    pose: Pose
    spread: float | None
    note: str
    particles: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class NoticeEntry:
    """Something beside the commands: who came, who left, what went wrong."""

    line: int
    t: float
    wall: float
    about: str
    subject: str
    text: str


@dataclass(frozen=True, slots=True)
class TwinEntry:
    """A sensor read on the real robot and on its simulated twin at once."""

    line: int
    t: float
    wall: float
    source: str
    command: str
    code: str
    robot: float
    simulated: float


@dataclass(frozen=True, slots=True)
class BrokenEntry:
    """A line that cannot be read, and why."""

    line: int
    reason: str

    def __str__(self) -> str:
        return f"line {self.line} is broken: {self.reason}"


Entry = CommandEntry | ActionEntry | BeliefEntry | NoticeEntry | TwinEntry | BrokenEntry


def parse_entry(data: bytes, line: int) -> Entry:
    """What one line says. Never fails: a line that says nothing gives a `BrokenEntry`."""
    try:
        fields = json.loads(data)
        if not isinstance(fields, dict):
            raise ValueError("it is not a JSON object")
        kind = fields["kind"]
        if kind not in _PARSERS:
            raise ValueError(f"its kind is {escape(str(kind), 40)!r}, not one of {', '.join(_PARSERS)}")
        return _PARSERS[kind](fields, line)
    except KeyError as error:
        return BrokenEntry(line, f"it has no field {error.args[0]!r}")
    except json.JSONDecodeError as error:
        return BrokenEntry(line, f"it is not JSON: {error.msg} at character {error.pos + 1}")
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        return BrokenEntry(line, escape(str(error), 120))


def _command(fields: Mapping[str, Any], line: int) -> CommandEntry:
    status = Status(fields["verdict"])
    before = _pose(fields["before"])
    pose = before if fields["pose"] == fields["before"] else _pose(fields["pose"])
    common = (
        line,
        number(fields["t"]),
        number(fields["wall"]),
        _whole(fields["number"]),
        status,
        _text(fields["source"]),
        _text(fields["command"]),
        number(fields["reply"]),
        before,
        pose,
        _text(fields.get("reason", "")),
    )
    if "sensor" in fields:
        return CommandEntry(
            *common, sensor=_text(fields["sensor"]), true=number(fields["true"]), view=_view(fields)
        )
    if "path" in fields:
        path = tuple([_pair(point) for point in fields["path"]])
        if not path:
            raise ValueError("its path has no points")
        contact = fields.get("contact")
        return CommandEntry(
            *common,
            begin=number(fields["begin"]),
            end=number(fields["end"]),
            cut=fields["cut"] is True,
            path=path,
            contact=None if contact is None else _pair(contact),
            contact_time=math.nan if contact is None else number(fields["contact_time"]),
            held=None if contact is None else _held(fields),
            grip=_grip(fields["grip"]) if "grip" in fields else None,
        )
    return CommandEntry(*common)


def _held(fields: Mapping[str, Any]) -> float | None:
    """From when on a wall held the robot. In logs of earlier versions every contact does."""
    held = fields.get("held", fields["contact_time"])
    return None if held is None else number(held)


def _grip(fields: Mapping[str, Any]) -> GripEntry:
    return GripEntry(fields["closed"] is True, fields["holding"] is True, _pose(fields["block"]))


def _view(fields: Mapping[str, Any]) -> RangeScan | FloorPatch | None:
    if "rays" in fields:
        rays = fields["rays"]
        bearings, distances = numbers(rays["bearings"]), numbers(rays["distances"])
        if len(bearings) != len(distances):
            raise ValueError("its rays have as many bearings as distances")
        return RangeScan(_pair(rays["origin"]), tuple(bearings), tuple(distances))
    if "points" in fields:
        points = fields["points"]
        centre, radius, black = _pair(points["centre"]), number(points["radius"]), points["black"]
        if not isinstance(black, str) or len(black) != len(TEST_POINTS) or black.strip("01"):
            raise ValueError(f"its black must be {len(TEST_POINTS)} characters 0 or 1")
        mask = np.frombuffer(black.encode(), dtype=np.uint8) == ord("1")
        return FloorPatch(centre, radius, TEST_POINTS * radius / 6.0 + centre, mask)
    return None


def _action(fields: Mapping[str, Any], line: int) -> ActionEntry:
    return ActionEntry(
        line,
        number(fields["t"]),
        number(fields["wall"]),
        _whole(fields["number"]),
        _text(fields["source"]),
        ActionName(fields["action"]),
        tuple(numbers(fields["arguments"])),
        fields["refused"] is True,
        _text(fields["text"]),
        _pose(fields["pose"]),
    )


def _belief(fields: Mapping[str, Any], line: int) -> BeliefEntry:
    spread = fields["spread"]
    return BeliefEntry(
        line,
        number(fields["t"]),
        number(fields["wall"]),
        _pose(fields["believed"]),
        _pose(fields["pose"]),
        None if spread is None else number(spread),
        _text(fields["note"]),
        tuple([tuple(numbers(each)) for each in fields["particles"]]),
    )


def _notice(fields: Mapping[str, Any], line: int) -> NoticeEntry:
    return NoticeEntry(
        line,
        number(fields["t"]),
        number(fields["wall"]),
        _text(fields["about"]),
        _text(fields["subject"]),
        _text(fields["text"]),
    )


def _twin(fields: Mapping[str, Any], line: int) -> TwinEntry:
    return TwinEntry(
        line,
        number(fields["t"]),
        number(fields["wall"]),
        _text(fields["source"]),
        _text(fields["command"]),
        _text(fields["code"]),
        number(fields["robot"]),
        number(fields["simulated"]),
    )


def _pose(values: object) -> Pose:
    return Pose(*numbers(values, 3))


def _pair(values: object) -> tuple[float, float]:
    x, y = numbers(values, 2)
    return x, y


def _whole(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{str(value)[:40]!r} is not a whole number, 0 or more")
    return value


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{str(value)[:40]!r} is not text")
    return value


_PARSERS: dict[str, Callable[[Mapping[str, Any], int], Entry]] = {
    "command": _command,
    "action": _action,
    "belief": _belief,
    "notice": _notice,
    "twin": _twin,
}
