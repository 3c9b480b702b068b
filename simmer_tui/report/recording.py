"""Contents of a player: poses, readings, beliefs, the block and marks for events, on one clock.

A recording holds the newest of each kind, a bounded number; from `begin` on it is complete.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import islice, pairwise
from operator import itemgetter
from typing import Any, NamedTuple

from msgspec import Struct, structs

from simmer_tui.events import ActionName, Goal, Result
from simmer_tui.phrases import contact_text
from simmer_tui.run.history_rows import ActionRow, ContactRow, MissionRow, RefusalRow
from simmer_tui.run.paths import MOVEMENTS, Jump, MovementPath, PathRecord
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.scan_traces import ScanTrace
from simmer_tui.run.table import Newest, Timed, TimedItem
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import escape, escape_passage
from simmer_tui.sim.gripper import in_global_frame
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.path import PathPosition
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.trajectory import Trajectory

READINGS = 15_000
"""Most readings, the newest: the bounds keep a page small."""
MARKS = 500
"""Most marks, the newest."""
# Keyframes give each pose to within this, inches and degrees.
_OFF, _TURNED = 0.01, 0.1
_DIRECTIONS = tuple((math.cos(math.tau * k / 16), math.sin(math.tau * k / 16)) for k in range(16))
# Half the width of the regular polygon with its corners at `_OFF`: 2 % less than that.
_APOTHEM = _OFF * math.cos(math.pi / len(_DIRECTIONS))
# Seconds from a break to the moment just before it.
_INSTANT = 1e-6
# No two keyframes are made closer to each other than this, seconds.
_LEAST = 2e-3


class MarkKind(StrEnum):
    """Kinds of marks on the clock."""

    CONTACT = "contact"
    GOAL = "goal"
    FAILED = "failed"
    REFUSED = "refused"
    PAUSE = "pause"
    PERSON = "person"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class Mark:
    """A mark for an event: its time (elapsed seconds), its text, and its place, if it has one."""

    elapsed: float
    kind: MarkKind
    text: str
    point: tuple[float, float] | None = None


class Keyframe(NamedTuple):
    """Pose of the robot at a moment; between two keyframes it moves evenly. Of two at the same moment the
    second counts from there on."""

    elapsed: float
    pose: Pose


class PlayerReading(Struct, frozen=True):
    """A reading: when it was answered and when it was taken, its sensor, its value and the true value."""

    elapsed: float
    taken: float
    code: str
    value: float
    true: float


class _Move:
    """A movement or jump, and its keyframes, made when they are asked for."""

    def __init__(self, move: MovementPath | Jump) -> None:
        self._move = move

    @property
    def elapsed(self) -> float:
        """Elapsed seconds at its beginning."""
        return self._move.elapsed

    @cached_property
    def frames(self) -> list[Keyframe]:
        move = self._move
        if isinstance(move, Jump):
            return [Keyframe(move.elapsed, move.begin), Keyframe(move.elapsed, move.end)]
        return [
            Keyframe(max(move.zero + time, 0.0), pose)
            for time, pose in keyframes_of(move.trajectory, move.until)
        ]


class Recording:
    """The newest part of a history. Make it when the run is over, or `update` it while the run continues."""

    def __init__(self, history: RunHistory, paths: PathRecord) -> None:
        self.spec = history.spec
        self.end = 0.0
        """Elapsed seconds at the end of the recording."""
        self.readings: Newest[PlayerReading] = Newest(READINGS)
        self.beliefs = paths.beliefs
        self.scans = paths.scans
        self.blocks = history.blocks
        self.marks: Newest[Mark] = Newest(MARKS)
        self.commands: Newest[MovementPath] = Newest(MOVEMENTS)
        """The movements, without the jumps between them."""
        self._history, self._paths = history, paths
        self._moves: deque[_Move] = deque()
        self.moves = 0
        """Number of movements and jumps that are over."""
        self._marked = _Marked(history)
        self._read = 0
        self.update()

    def update(self, present: float = 0.0) -> None:
        """Add the new events; `present` is the elapsed time now, if it is later than all events. Earlier
        results of `pose_at` and similar methods are not updated."""
        history = self._history
        self.end = max(history.elapsed, present)
        codes = history.sensor_codes
        # One more than are kept: the one dropped shows from when on they are complete.
        table = history.readings
        fresh = min(table.dropped + len(table) - self._read, READINGS + 1)
        self._read = table.dropped + len(table)
        for row in table[len(table) - fresh :] if fresh else ():
            self.readings.add(PlayerReading(row.elapsed, row.taken, codes[row.sensor], row.value, row.true))
        for mark in self._marked.news():
            self.marks.add(mark)
        moves = self._paths.moves
        for move in moves.after(self.moves):
            self._moves.append(_Move(move))
            if isinstance(move, MovementPath):
                self.commands.add(move)
        self.moves = moves.first.given
        while len(self._moves) > len(moves.items):
            self._moves.popleft()

    @property
    def one_particle_in(self) -> int:
        """One in this many particles is kept."""
        return self._paths.one_particle_in

    @property
    def earlier_marks(self) -> int:
        """Marks that are left out."""
        return self._marked.dropped + self.marks.dropped

    @property
    def begin(self) -> float:
        """Elapsed seconds from which on nothing but marks is left out."""
        kept = (self.readings.since, self.beliefs.since, self.blocks.since, self._paths.moves.since)
        return min(max(kept), self.end)

    @property
    def under_way(self) -> MovementPath | None:
        """The movement that has not ended, up to now."""
        under_way = self._paths.under_way
        if under_way is None:
            return None
        # A log may end while the robot drives: the player shows the movement up to there.
        begin = under_way.trajectory.start_time
        return structs.replace(under_way, until=min(max(self.end - under_way.zero, begin), under_way.until))

    # -- the run at a moment -----------------------------------------------------------------------

    @cached_property
    def keyframes(self) -> list[Keyframe]:
        """The keyframes of the robot's path, in order of time; at least one. Read it after the last event."""
        return [*self.keyframes_after(0), *self.unsettled_keyframes]

    def keyframes_after(self, moves: int) -> list[Keyframe]:
        """The keyframes of the kept movements after the first `moves`."""
        first = max(len(self._moves) - (self.moves - moves), 0)
        return [frame for move in islice(self._moves, first, None) for frame in move.frames]

    @property
    def moves_begin(self) -> float:
        """Elapsed seconds at which the first movement begins that is kept."""
        return self._moves[0].elapsed if self._moves else 0.0

    @property
    def unsettled_keyframes(self) -> list[Keyframe]:
        """The keyframes of the movement under way, which change while it continues. If the robot has never
        moved, its pose."""
        if self.under_way is not None:
            return _Move(self.under_way).frames
        return [] if self._moves else [Keyframe(0.0, self._paths.start)]

    @cached_property
    def _times(self) -> list[float]:
        return [frame.elapsed for frame in self.keyframes]

    def pose_at(self, elapsed: float) -> Pose:
        """Pose of the robot, by the keyframes."""
        return pose_at(self.keyframes, self._times, elapsed)

    def trail(self, until: float) -> list[Keyframe]:
        """The keyframes up to a moment, and that moment."""
        after = bisect_right(self._times, until)
        return [*self.keyframes[:after], Keyframe(until, self.pose_at(until))]

    def block_at(self, elapsed: float) -> Block:
        """Pose of the block in the maze's frame."""
        placed = latest(self.blocks, elapsed) or self.blocks.items[0]
        return in_global_frame(placed.block, self.pose_at(elapsed)) if placed.held else placed.block

    def command_at(self, elapsed: float) -> MovementPath | None:
        """The newest movement that had begun by then."""
        under_way = self.under_way
        is_it = under_way is not None and under_way.elapsed <= elapsed
        return under_way if is_it else latest(self.commands, elapsed)

    def scan_at(self, elapsed: float) -> dict[str, ScanTrace]:
        """The newest scan of each lidar by then, by code."""
        found: dict[str, ScanTrace] = {}
        lidars = sum(sensor.kind.is_scan for sensor in self.spec.sensors)
        after = bisect_right(self.scans.items, elapsed, key=lambda scan: scan.elapsed)
        for place in range(after - 1, -1, -1):
            scan = self.scans.items[place]
            found.setdefault(scan.code, scan)
            if len(found) == lidars:
                break
        return found


def pose_at(frames: Sequence[Keyframe], times: Sequence[float], elapsed: float) -> Pose:
    """The pose at a moment by keyframes with these times."""
    after = bisect_right(times, elapsed)
    if after == 0:
        return frames[0].pose
    if after == len(frames):
        return frames[-1].pose
    return _between(frames[after - 1], frames[after], elapsed)


def latest(kept: Newest[TimedItem], elapsed: float) -> TimedItem | None:
    """The last item not after a moment."""
    # Items are in order of elapsed time, which never goes back.
    found = bisect_right(kept.items, elapsed, key=lambda item: item.elapsed)
    return kept.items[found - 1] if found else None


class _Marked:
    """The rows of a history that are marked on the clock, as marks in the order in which they happened."""

    def __init__(self, history: RunHistory) -> None:
        self._spec = history.spec
        self._tables: tuple[tuple[Newest[Any], Callable[[Any], Mark | None]], ...] = (
            (history.contacts, self._contact),
            (history.refusals, _refusal),
            (history.actions, _action),
            (history.missions, _mission),
            (history.faults, lambda row: _mark(row, MarkKind.FAULT, row.text)),
        )
        self._seen = [0] * len(self._tables)

    @property
    def dropped(self) -> int:
        """Rows that are no longer kept."""
        return sum(table.dropped for table, _ in self._tables)

    def news(self) -> Iterable[Mark]:
        """The marks that have come since the last time."""
        found = []
        for place, (table, mark_of) in enumerate(self._tables):
            found += [(row.order, mark_of(row)) for row in table.after(self._seen[place])]
            self._seen[place] = table.first.given
        # Each kind of row is in order by itself; the clock needs all of them together.
        return [mark for _, mark in sorted(found, key=itemgetter(0)) if mark is not None]

    def _contact(self, row: ContactRow) -> Mark:
        text = f"{row.shown}: {contact_text(row.contact, self._spec)}"
        return _mark(row, MarkKind.CONTACT, text, row.point)


def _mark(row: Timed, kind: MarkKind, text: str, point: tuple[float, float] | None = None) -> Mark:
    return Mark(row.elapsed, kind, escape_passage(text), point)


def _refusal(row: RefusalRow) -> Mark:
    outcome = row.outcome
    why = escape(outcome.reason) or outcome.status.value
    return _mark(row, MarkKind.REFUSED, f"{outcome.command.shown}: {why}")


def _action(row: ActionRow) -> Mark:
    name = row.done.action.name
    pauses = name in (ActionName.PAUSE, ActionName.RESUME)
    return _mark(row, MarkKind.PAUSE if pauses else MarkKind.PERSON, f"{name.value}: {row.done.text}")


def _mission(row: MissionRow) -> Mark | None:
    subject = row.event.subject
    if not (isinstance(subject, Goal) or row.event.over):
        return None
    kind = MarkKind.FAILED if subject is Result.FAILED else MarkKind.GOAL
    return _mark(row, kind, row.text)


# -- keyframes of a movement -------------------------------------------------------------------------


def keyframes_of(trajectory: Trajectory | Leg, until: float) -> list[Keyframe]:
    """Keyframes of a movement from its beginning till a time. Between them it moves evenly, to within a
    hundredth of an inch and a tenth of a degree.

    A movement is even, or smooth, between the ends of its segments and its contact. There it may turn at
    once, so both sides are sampled.
    """
    begin = trajectory.start_time
    breaks = {begin, max(until, begin)}
    # A leg of a continuous motion is one arc, from end to end.
    if isinstance(trajectory, Trajectory):
        breaks.update(
            trajectory.time_of(PathPosition(each, 0.0, 0.0)) for each in range(trajectory.path.segments)
        )
        met = None if trajectory.contact is None else trajectory.contact.time
        breaks.update(each for each in (trajectory.held_at, met) if each is not None)
    times = sorted(each for each in breaks if begin <= each <= until) or [begin]
    frames: list[Keyframe] = []
    for a, b in pairwise(times):
        frames.append(Keyframe(a, trajectory.pose_at(a)))
        # At a break the pose may jump, and `pose_at` gives that after it.
        end = Keyframe(b, trajectory.pose_at(max(b - _INSTANT, a)))
        if b - a > _LEAST:
            frames += _refined(trajectory, frames[-1], end)
        frames.append(end)
    frames.append(Keyframe(times[-1], trajectory.pose_at(times[-1])))
    return _thinned(frames)


def _refined(trajectory: Trajectory | Leg, begin: Keyframe, end: Keyframe) -> Iterable[Keyframe]:
    """Keyframes needed between two moments, in order."""
    middle = (begin.elapsed + end.elapsed) / 2
    frame = Keyframe(middle, trajectory.pose_at(middle))
    # Halving ends at `_LEAST`: a jump would be halved for ever.
    if end.elapsed - begin.elapsed <= _LEAST or _is_even(begin, frame, end):
        return []
    return [*_refined(trajectory, begin, frame), frame, *_refined(trajectory, frame, end)]


def _thinned(frames: list[Keyframe]) -> list[Keyframe]:
    """The keyframes without those that lie evenly between their neighbours."""
    kept = [frames[0]]
    skipped: Keyframe | None = None
    corridor = _Corridor(frames[0])
    for frame in frames[1:]:
        if skipped is not None and not corridor.holds(frame):
            kept.append(skipped)
            corridor = _Corridor(skipped)
        corridor.add(frame)
        skipped = frame
    return kept if skipped is None else [*kept, skipped]


class _Corridor:
    """The velocities and turn rates with which an even movement from a keyframe passes all frames added.

    Each frame allows a disc of velocities. Their intersection is kept as the polygon of `_DIRECTIONS` inside
    it, so the cost of a frame does not grow. Comparing each with all before it would take the square of their
    number.
    """

    def __init__(self, begin: Keyframe) -> None:
        self._begin = begin
        self._speeds = [math.inf] * len(_DIRECTIONS)
        self._turns = -math.inf, math.inf

    def add(self, frame: Keyframe) -> None:
        span, x, y, turn = self._to(frame)
        if span > 0.0:
            self._speeds = [
                min(most, (x * ux + y * uy + _APOTHEM) / span)
                for most, (ux, uy) in zip(self._speeds, _DIRECTIONS, strict=True)
            ]
            least, most = self._turns
            self._turns = max(least, (turn - _TURNED) / span), min(most, (turn + _TURNED) / span)
        elif math.hypot(x, y) > _OFF or abs(turn) > _TURNED:
            self._turns = math.inf, -math.inf  # a jump at the keyframe's own moment: no movement passes it

    def holds(self, end: Keyframe) -> bool:
        """True if an even movement to `end` passes all frames added."""
        span, x, y, turn = self._to(end)
        least, most = self._turns
        if span <= 0.0:
            return least <= most
        return least <= turn / span <= most and all(
            (x * ux + y * uy) / span <= most for most, (ux, uy) in zip(self._speeds, _DIRECTIONS, strict=True)
        )

    def _to(self, frame: Keyframe) -> tuple[float, float, float, float]:
        """Time and changes of x, y and heading from the keyframe to a frame."""
        (begin, a), (end, b) = self._begin, frame
        return end - begin, b.x - a.x, b.y - a.y, b.heading - a.heading


def _is_even(begin: Keyframe, middle: Keyframe, end: Keyframe) -> bool:
    there, pose = _between(begin, end, middle.elapsed), middle.pose
    off = math.hypot(there.x - pose.x, there.y - pose.y)
    return off <= _OFF and abs(there.heading - pose.heading) <= _TURNED


def _between(begin: Keyframe, end: Keyframe, elapsed: float) -> Pose:
    span = end.elapsed - begin.elapsed
    part = (elapsed - begin.elapsed) / span if span > 0.0 else 1.0
    a, b = begin.pose, end.pose
    return Pose(
        a.x + part * (b.x - a.x), a.y + part * (b.y - a.y), a.heading + part * (b.heading - a.heading)
    )
