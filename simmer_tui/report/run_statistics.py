"""The figures of a run, gathered entry by entry in bounded memory."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise

from simmer_tui.actions import ActionName
from simmer_tui.config.loader import Configuration
from simmer_tui.report.bounded import Errors, First, Thinned
from simmer_tui.report.truth import Truth
from simmer_tui.runlog.entries import (
    ActionEntry,
    BeliefEntry,
    BrokenEntry,
    CommandEntry,
    Entry,
    NoticeEntry,
    TwinEntry,
)
from simmer_tui.runlog.header import Header
from simmer_tui.runlog.reader import ElapsedTime
from simmer_tui.runlog.state import carried, ends_movement
from simmer_tui.sim.records import Pose, Status
from simmer_tui.sim.specs import CELL_SIZE

PIECES = 8000
"""Most movements drawn."""
TRACE_POINTS = 800
"""Most points of one sensor's trace."""
LISTED = 200
"""Most contacts, refused commands and jumps listed."""
OTHER_CODES = "other"
SAME_PLACE = 0.1
"""Poses this close, inches, are one place: the robot did not get away from the wall."""

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Piece:
    """One movement as drawn: when (elapsed seconds), and through which centres."""

    begin: float
    end: float
    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Touch:
    """A contact: when, by which command, at which pose, which point was touched, how far the
    robot had come (inches, degrees) and what had been read since the movement before it; whether it
    ended the movement."""

    elapsed: float
    line: int
    shown: str
    pose: Pose
    point: Point
    went: float
    turned: float
    seen: tuple[CommandEntry, ...]
    ended: bool = True


@dataclass(slots=True)
class Bump:
    """A contact, or several in a row of the same command at the same place; `until` is when (elapsed
    seconds) the last one was."""

    touch: Touch
    until: float
    count: int = 1


@dataclass(frozen=True, slots=True)
class Refusal:
    """A command that did nothing: when, and the entry."""

    elapsed: float
    entry: CommandEntry


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

    readings: int = 0
    errors: Errors = field(default_factory=Errors)
    missed: int = 0
    """Readings that saw something where nothing was in range, or the reverse."""
    trace: Thinned[TracePoint] = field(default_factory=lambda: Thinned(TRACE_POINTS))


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


class RunStatistics:
    """Feed it a log's entries in order, call `finish`, and read the figures."""

    def __init__(self, header: Header, configuration: Configuration) -> None:
        self.header = header
        self.configuration = configuration
        spec = configuration.simulation
        self.commands = 0
        self.codes: dict[str, CodeRecord] = {}
        self.sources: Counter[str] = Counter()
        self.distance = 0.0
        """Inches driven."""
        self.turned = 0.0
        """Degrees turned, either way."""
        self.movements = 0
        self.contacts = 0
        self.contacts_that_ended = 0
        self.bumps: First[Bump] = First(LISTED)
        self.last_bump: Bump | None = None
        self.last_contact: Touch | None = None
        self.contacts_in_a_row = 0
        """How many of the latest movements, without a gap, a wall ended."""
        self.in_a_row_since = 0.0
        self.refusals: First[Refusal] = First(LISTED)
        self.jumps: First[Jump] = First(LISTED)
        self.actions: Counter[str] = Counter()
        self.broken: First[BrokenEntry] = First(20)
        self.faults: First[NoticeEntry] = First(20)
        self.mission: First[tuple[float, NoticeEntry]] = First(20)
        """What the referee said, and when."""
        self.sensors: dict[str, SensorRecord] = {}
        self.beliefs = Errors()
        self.belief_turns = Errors()
        self.belief_trace: Thinned[BeliefPoint] = Thinned(TRACE_POINTS)
        self.lost: BeliefPoint | None = None
        """The first belief off by more than half a cell."""
        self.last_belief: BeliefPoint | None = None
        self.last_command: CommandEntry | None = None
        self.cells: Counter[tuple[int, int]] = Counter()
        """Simulated seconds by cell: row from the top and column from the left, from 1."""
        self.pieces: Thinned[Piece] = Thinned(PIECES)
        self.pose = header.pose
        self.block = header.block
        self.holding = False
        self.notes: list[str] = []
        self.wall_seconds = 0.0
        self._clock = ElapsedTime(header.t)
        self._truth = Truth(spec.sensors, header.pose, header.number == 0)
        self._under_way: CommandEntry | None = None
        self._stood_since = 0.0
        self._seen: dict[str, CommandEntry] = {}
        self._known_codes = {each.code for each in spec.sensors} | {each.code for each in spec.drives}
        if spec.gripper is not None:
            self._known_codes.add(spec.gripper.code)

    @property
    def duration(self) -> float:
        """Simulated seconds from the beginning to the end."""
        return self._clock.now

    def add(self, entry: Entry) -> None:
        """Take in the next entry."""
        movement = self._under_way
        if movement is not None and ends_movement(entry, movement):
            self._settle(entry)
        elapsed = self._clock.advance(entry)
        if isinstance(entry, BrokenEntry):
            self.broken.add(entry)
            return
        self.wall_seconds = max(self.wall_seconds, entry.wall - self.header.wall)
        match entry:
            case CommandEntry():
                self._add_command(entry, elapsed)
            case ActionEntry():
                self._add_action(entry, elapsed)
            case BeliefEntry():
                self._add_belief(entry, elapsed)
            case NoticeEntry():
                if entry.about == "fault":
                    self.faults.add(entry)
                elif entry.about == "mission":
                    self.mission.add((elapsed, entry))
            case TwinEntry():
                pass

    def finish(self, note: str = "") -> None:
        """No more entries come; `note` is what the reader has to say."""
        if self._under_way is not None:
            self._move(self._under_way, max(self._under_way.end, self._under_way.t))
            self._under_way = None
        self._stand(self.duration)
        if note:
            self.notes.append(note)
        for broken in self.broken.items:
            self.notes.append(f"{broken}, and was skipped")
        if self.broken.more:
            self.notes.append(f"{self.broken.more} more broken lines were skipped")

    # -- commands --------------------------------------------------------------------------------

    def _add_command(self, entry: CommandEntry, elapsed: float) -> None:
        self.commands += 1
        self.sources[entry.source if len(self.sources) < 20 else OTHER_CODES] += 1
        self.last_command = entry
        code = entry.command.strip(" \t\r\n")[:2]
        record = self.codes.setdefault(code if code in self._known_codes else OTHER_CODES, CodeRecord())
        record.count += 1
        if entry.refused:
            record.refused += 1
            self.refusals.add(Refusal(elapsed, entry))
        elif entry.sensor:
            self._add_reading(entry, elapsed)
        elif entry.status is Status.DONE and entry.moved:
            self._move(entry, entry.end)
        elif entry.status is Status.ACCEPTED and entry.moved:
            self._under_way = entry
        if entry.contact is not None:
            record.contacts += 1

    def _add_reading(self, entry: CommandEntry, elapsed: float) -> None:
        record = self.sensors.setdefault(entry.sensor, SensorRecord())
        record.trace.add(TracePoint(elapsed, record.readings, entry.reply, entry.true))
        record.readings += 1
        self._seen[entry.sensor] = entry
        error = self._truth.error(entry)
        if error is None:
            return
        if math.isfinite(error):
            record.errors.add(error)
        else:
            record.missed += 1

    def _settle(self, entry: Entry) -> None:
        """A movement that was merely accepted is over by now: it went as planned, or was ended."""
        movement, self._under_way = self._under_way, None
        assert movement is not None
        if isinstance(entry, BrokenEntry) or (
            isinstance(entry, CommandEntry)
            and entry.number == movement.number
            and entry.status is Status.DONE
        ):
            self.commands -= 1  # the same command's end has a line of its own
            return
        stopped = movement.end
        if not (isinstance(entry, ActionEntry) and entry.restarts):
            stopped = min(stopped, entry.t)
        self._move(movement, stopped)

    def _move(self, entry: CommandEntry, until: float) -> None:
        """A movement, up to a simulated time."""
        zero = self._clock.before
        pose = entry.pose_at(until)
        points = entry.trail(until)
        arrival = min(entry.arrival, until)
        went = math.fsum(math.dist(a, b) for a, b in pairwise(points))
        turned = pose.heading - entry.before.heading
        self.movements += entry.grip is None
        self.distance += went
        self.turned += abs(turned)
        self._stand(zero + entry.begin)
        self._truth.place(entry.before)
        self._truth.move(points, pose)
        self._pass_time(points, max(arrival - entry.begin, 0.0))
        self.pieces.add(Piece(zero + entry.begin, zero + until, _simplified(points)))
        if self.holding:
            self.block = carried(self.block, self.pose, pose)
        if entry.grip is not None:
            self.block, self.holding = entry.grip.block, entry.grip.holding
        self.pose = pose
        self._stood_since = zero + max(arrival, entry.begin)
        touch = None
        if entry.contact is not None and entry.contact_time <= until:
            seen = tuple(self._seen.values())
            touch = self.last_contact = Touch(
                zero + entry.contact_time,
                entry.line,
                entry.shown,
                pose,
                entry.contact,
                went,
                turned,
                seen,
                ended=entry.held is not None and entry.held <= until,
            )
            self._bump(touch)
        if touch is None or not touch.ended:
            self.contacts_in_a_row = 0
        self._seen = {}

    def _bump(self, touch: Touch) -> None:
        last = self.last_bump
        again = (
            self.contacts_in_a_row > 0
            and last is not None
            and last.touch.shown == touch.shown
            and math.hypot(last.touch.pose.x - touch.pose.x, last.touch.pose.y - touch.pose.y) < SAME_PLACE
        )
        if again and last is not None:
            last.count += 1
            last.until = touch.elapsed
        else:
            self.last_bump = Bump(touch, touch.elapsed)
            self.bumps.add(self.last_bump)
        if not self.contacts_in_a_row:
            self.in_a_row_since = touch.elapsed
        self.contacts += 1
        self.contacts_that_ended += touch.ended
        self.contacts_in_a_row += 1

    # -- time by cell ------------------------------------------------------------------------------

    def _stand(self, until: float) -> None:
        """The robot stood where it was till then."""
        if until > self._stood_since:
            self.cells[self._cell(self.pose.x, self.pose.y)] += until - self._stood_since  # type: ignore[assignment]
            self._stood_since = until

    def _pass_time(self, points: tuple[Point, ...], seconds: float) -> None:
        """Share out a movement's time among the cells it went through."""
        lengths = [math.dist(a, b) for a, b in pairwise(points)]
        total = math.fsum(lengths)
        if total == 0.0:
            self.cells[self._cell(*points[0])] += seconds  # type: ignore[assignment]
            return
        for (a, b), length in zip(pairwise(points), lengths, strict=True):
            steps = max(math.ceil(length), 1)
            for step in range(steps):
                fraction = (step + 0.5) / steps
                x, y = a[0] + fraction * (b[0] - a[0]), a[1] + fraction * (b[1] - a[1])
                self.cells[self._cell(x, y)] += seconds * length / total / steps  # type: ignore[assignment]

    def _cell(self, x: float, y: float) -> tuple[int, int]:
        maze = self.configuration.simulation.maze
        column = min(max(int(x // CELL_SIZE), 0), maze.columns - 1)
        row = min(max(int(y // CELL_SIZE), 0), maze.rows - 1)
        return maze.rows - row, column + 1

    # -- actions and beliefs -------------------------------------------------------------------------

    def _add_action(self, entry: ActionEntry, elapsed: float) -> None:
        self.actions[entry.action if not entry.refused else f"{entry.action} (refused)"] += 1
        if entry.refused:
            return
        if entry.action is ActionName.BLOCK:
            self.block, self.holding = Pose(entry.arguments[0], entry.arguments[1], 0.0), False
        if entry.restarts:
            self._truth.restart(entry.pose)
            self.block, self.holding = self.header.start_block, False
        elif entry.action is ActionName.TELEPORT:
            self._truth.place(entry.pose)
        else:
            return
        self._stand(elapsed)
        self.jumps.add(Jump(elapsed, entry.action.value, entry.line, self.pose, entry.pose))
        if self.holding:
            self.block = carried(self.block, self.pose, entry.pose)
        self.pose = entry.pose
        self._seen = {}

    def _add_belief(self, entry: BeliefEntry, elapsed: float) -> None:
        believed, pose = entry.believed, entry.pose
        distance = math.hypot(believed.x - pose.x, believed.y - pose.y)
        turn = (believed.heading - pose.heading + 180.0) % 360.0 - 180.0
        point = BeliefPoint(elapsed, entry.line, believed, distance, turn)
        self.last_belief = point
        if not (math.isfinite(distance) and math.isfinite(turn)):
            return
        self.beliefs.add(distance)
        self.belief_turns.add(turn)
        self.belief_trace.add(point)
        if self.lost is None and distance > CELL_SIZE / 2:
            self.lost = point


def _simplified(points: tuple[Point, ...]) -> tuple[Point, ...]:
    """A path without the points that do not show: all within 0.02 in of the straight line."""
    if len(points) < 3:
        return points
    (x, y), (end_x, end_y) = points[0], points[-1]
    length = math.hypot(end_x - x, end_y - y)
    if length == 0.0:
        far = max(math.dist(points[0], point) for point in points)
    else:
        far = max(abs((px - x) * (end_y - y) - (py - y) * (end_x - x)) / length for px, py in points)
    return points if far > 0.02 else (points[0], points[-1])
