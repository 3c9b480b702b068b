"""Contents of a player: poses, readings, beliefs, the block and marks for events, on one clock.

A recording holds the newest of each kind, a bounded number; from `begin` on it is complete.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterable
from enum import StrEnum
from functools import cached_property
from itertools import islice
from operator import itemgetter
from typing import Any

from msgspec import Struct, structs

from simmer_tui.errors import printable
from simmer_tui.report.keyframes import Keyframe, keyframes_of, pose_at
from simmer_tui.run.events import ActionName, Goal, Result
from simmer_tui.run.history_rows import ActionRow, ContactRow, MissionRow, RefusalRow
from simmer_tui.run.paths import MOVEMENTS, Jump, MovementPath, PathRecord
from simmer_tui.run.phrases import contact_text
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.scan_traces import ScanTrace
from simmer_tui.run.table import Newest, Timed, TimedItem
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import cut
from simmer_tui.sim.gripper import in_global_frame
from simmer_tui.sim.pose import Pose

READINGS = 15_000
"""Most readings, the newest: the bounds keep a page small."""
MARKS = 500
"""Most marks, the newest."""


class MarkKind(StrEnum):
    """Kinds of marks on the clock."""

    CONTACT = "contact"
    GOAL = "goal"
    FAILED = "failed"
    REFUSED = "refused"
    PAUSE = "pause"
    PERSON = "person"
    FAULT = "fault"


class Mark(Struct, frozen=True):
    """A mark for an event: its time (elapsed seconds), its text, and its place, if it has one."""

    elapsed: float
    kind: MarkKind
    text: str
    point: tuple[float, float] | None = None


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
        self.displays = history.displays
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
    return Mark(row.elapsed, kind, printable(text), point)


def _refusal(row: RefusalRow) -> Mark:
    result = row.result
    why = cut(result.reason) or result.status.value
    return _mark(row, MarkKind.REFUSED, f"{result.command.shown}: {why}")


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
