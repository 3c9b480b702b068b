"""Contents of a player: poses, readings, beliefs, the block and what happened, on one clock.

A recording holds a bounded number of everything, the newest; `begin` is from when on it is whole.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import pairwise
from operator import itemgetter
from typing import Protocol

from msgspec import Struct, structs

from simmer_tui.events import ActionName, Goal, Result
from simmer_tui.phrases import contact_text
from simmer_tui.run.paths import MOVEMENTS, BeliefCloud, Jump, MovementPath, PathRecord
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import Newest, TimedItem
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import escape
from simmer_tui.sim.gripper import in_global_frame
from simmer_tui.sim.path import PathPosition
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.trajectory import Trajectory

READINGS = 15_000
"""Most readings, the newest."""
MARKS = 500
"""Most marks, the newest."""
# Keyframes give each pose to within this, inches and degrees.
_OFF, _TURNED = 0.01, 0.1
_DIRECTIONS = tuple((math.cos(math.tau * k / 16), math.sin(math.tau * k / 16)) for k in range(16))
# Half the width of the regular polygon with its corners at `_OFF`: 2 % less than that.
_APOTHEM = _OFF * math.cos(math.pi / len(_DIRECTIONS))
# Seconds before a moment that count as just before it.
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
    """Something that happened: when (elapsed seconds), what, in words, and where, if anywhere."""

    elapsed: float
    kind: MarkKind
    text: str
    point: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Keyframe:
    """Pose of the robot at a moment; between two of them it went evenly. Of two at the same moment
    the second counts from there on."""

    elapsed: float
    pose: Pose


class PlayerReading(Struct, frozen=True):
    """A reading: when it was answered and when it was taken, of which sensor, what it said and what was
    true."""

    elapsed: float
    taken: float
    code: str
    value: float
    true: float


class PlayerCommand(Struct, frozen=True):
    """A command that moved something, when it began."""

    elapsed: float
    text: str


class Ordered(Protocol):
    """A row of a history."""

    @property
    def order(self) -> int: ...

    @property
    def elapsed(self) -> float: ...


class Recording:
    """The newest part of a history. Make it when all has happened."""

    def __init__(self, history: RunHistory, paths: PathRecord) -> None:
        self.spec = history.spec
        self.end = history.elapsed
        """Elapsed seconds of all that happened."""
        self.readings: Newest[PlayerReading] = Newest(READINGS)
        self.beliefs = paths.beliefs
        self.one_particle_in = paths.one_particle_in
        self.blocks = history.blocks
        self.marks: Newest[Mark] = Newest(MARKS)
        self.commands: Newest[PlayerCommand] = Newest(MOVEMENTS)
        self._start = paths.start
        self._moves = list(paths.moves.items)
        if paths.under_way is not None:
            under_way = paths.under_way
            # A log may end while the robot drives: the player shows the movement up to there.
            until = min(max(self.end - under_way.zero, under_way.trajectory.start_time), under_way.until)
            self._moves.append(structs.replace(under_way, until=until))
        self._moves_since = paths.moves.since
        codes = history.sensor_codes
        # One more than are kept says from when on they are whole.
        for row in history.readings[-READINGS - 1 :]:
            self.readings.add(PlayerReading(row.elapsed, row.taken, codes[row.sensor], row.value, row.true))
        # Each kind of row is in order by itself; the clock needs all of them together.
        for _, mark in sorted(_marks(history), key=itemgetter(0)):
            self.marks.add(mark)
        marked = (history.contacts, history.refusals, history.actions, history.missions, history.faults)
        self.earlier_marks = sum(each.dropped for each in marked) + self.marks.dropped
        """Marks that are left out."""
        for move in self._moves:
            if isinstance(move, MovementPath):
                self.commands.add(PlayerCommand(move.elapsed, move.text))

    @property
    def begin(self) -> float:
        """From when on, elapsed seconds, nothing but marks is left out."""
        kept = (self.readings.since, self.beliefs.since, self.blocks.since, self._moves_since)
        return min(max(kept), self.end)

    # -- the run at a moment -----------------------------------------------------------------------

    @cached_property
    def keyframes(self) -> list[Keyframe]:
        """The robot's way, in order of time; at least one. To be asked for after the last event."""
        frames: list[Keyframe] = []
        for move in self._moves:
            if isinstance(move, Jump):
                frames += [Keyframe(move.elapsed, move.begin), Keyframe(move.elapsed, move.end)]
            else:
                frames += [
                    Keyframe(max(move.zero + time, 0.0), pose)
                    for time, pose in way(move.trajectory, move.until)
                ]
        return frames or [Keyframe(0.0, self._start)]

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

    def belief_at(self, elapsed: float) -> BeliefCloud | None:
        """The newest belief by then."""
        return latest(self.beliefs, elapsed)


def pose_at(frames: Sequence[Keyframe], times: Sequence[float], elapsed: float) -> Pose:
    """The pose at a moment by keyframes, which stand at these times."""
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


def _marks(history: RunHistory) -> Iterable[tuple[int, Mark]]:
    """All that is marked on the clock, with the order in which it happened."""

    def mark(
        row: Ordered, kind: MarkKind, text: str, point: tuple[float, float] | None = None
    ) -> tuple[int, Mark]:
        return row.order, Mark(row.elapsed, kind, escape(text, 300), point)

    for contact in history.contacts.items:
        words = contact_text(contact.contact, history.spec)
        yield mark(contact, MarkKind.CONTACT, f"{contact.shown}: {words}", contact.point)
    for refusal in history.refusals.items:
        outcome = refusal.outcome
        why = escape(outcome.reason, 120) or outcome.status.value
        yield mark(refusal, MarkKind.REFUSED, f"{outcome.command.shown}: {why}")
    for action in history.actions.items:
        name = action.done.action.name
        pauses = name in (ActionName.PAUSE, ActionName.RESUME)
        yield mark(action, MarkKind.PAUSE if pauses else MarkKind.PERSON, f"{name.value}: {action.done.text}")
    for mission in history.missions.items:
        subject = mission.event.subject
        if isinstance(subject, Goal) or mission.event.over:
            kind = MarkKind.FAILED if subject is Result.FAILED else MarkKind.GOAL
            yield mark(mission, kind, mission.text)
    for fault in history.faults.items:
        yield mark(fault, MarkKind.FAULT, fault.text)


# -- keyframes of a movement -------------------------------------------------------------------------


def way(trajectory: Trajectory, until: float) -> list[tuple[float, Pose]]:
    """Simulated times and poses between which a movement goes evenly, to within a hundredth of an inch
    and a tenth of a degree, from its beginning till a time.

    A movement goes on evenly, or smoothly, between the ends of its segments and where it met
    something, and there it may turn at once; so these are looked at from both sides.
    """
    begin = trajectory.start_time
    held = trajectory.held_at
    breaks = {begin, max(until, begin)}
    breaks.update(
        trajectory.time_of(PathPosition(each, 0.0, 0.0)) for each in range(trajectory.path.segments)
    )
    met = None if trajectory.contact is None else trajectory.contact.time
    breaks.update(each for each in (held, met) if each is not None)
    times = sorted(each for each in breaks if begin <= each <= until) or [begin]
    frames: list[tuple[float, Pose]] = []
    for a, b in pairwise(times):
        frames.append((a, trajectory.pose_at(a)))
        # At a break the pose may jump, and `pose_at` gives that after it.
        before = max(b - _INSTANT, a)
        end = (b, trajectory.pose_at(before))
        if b - a > _LEAST:
            frames += _refined(trajectory, frames[-1], end)
        frames.append(end)
    frames.append((times[-1], trajectory.pose_at(times[-1])))
    return _thinned(frames)


def _refined(
    trajectory: Trajectory, begin: tuple[float, Pose], end: tuple[float, Pose]
) -> Iterable[tuple[float, Pose]]:
    """Keyframes needed between two moments, in order."""
    (a, _), (b, _) = begin, end
    middle = (a + b) / 2
    frame = middle, trajectory.pose_at(middle)
    # Halving ends at `_LEAST`: a jump would be halved for ever.
    if b - a <= _LEAST or _is_even(begin, frame, end):
        return []
    return [*_refined(trajectory, begin, frame), frame, *_refined(trajectory, frame, end)]


def _thinned(frames: list[tuple[float, Pose]]) -> list[tuple[float, Pose]]:
    """Without those that lie evenly between their neighbours."""
    kept = [frames[0]]
    skipped: tuple[float, Pose] | None = None
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

    Each frame allows a disc of velocities. Their intersection is kept as the polygon of `_DIRECTIONS`
    inside it, so that a frame costs the same however many came before: to compare it with all of them
    takes the square of their number.
    """

    def __init__(self, begin: tuple[float, Pose]) -> None:
        self._begin = begin
        self._speeds = [math.inf] * len(_DIRECTIONS)
        self._turns = -math.inf, math.inf

    def add(self, frame: tuple[float, Pose]) -> None:
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

    def holds(self, end: tuple[float, Pose]) -> bool:
        """True if an even movement to `end` passes all frames added."""
        span, x, y, turn = self._to(end)
        least, most = self._turns
        if span <= 0.0:
            return least <= most
        return least <= turn / span <= most and all(
            (x * ux + y * uy) / span <= most for most, (ux, uy) in zip(self._speeds, _DIRECTIONS, strict=True)
        )

    def _to(self, frame: tuple[float, Pose]) -> tuple[float, float, float, float]:
        """Time and changes of x, y and heading from the keyframe to a frame."""
        (begin, a), (end, b) = self._begin, frame
        return end - begin, b.x - a.x, b.y - a.y, b.heading - a.heading


def _is_even(begin: tuple[float, Pose], middle: tuple[float, Pose], end: tuple[float, Pose]) -> bool:
    there = _between(Keyframe(*begin), Keyframe(*end), middle[0])
    pose = middle[1]
    off = math.hypot(there.x - pose.x, there.y - pose.y)
    return off <= _OFF and abs(there.heading - pose.heading) <= _TURNED


def _between(begin: Keyframe, end: Keyframe, elapsed: float) -> Pose:
    span = end.elapsed - begin.elapsed
    part = (elapsed - begin.elapsed) / span if span > 0.0 else 1.0
    a, b = begin.pose, end.pose
    return Pose(
        a.x + part * (b.x - a.x), a.y + part * (b.y - a.y), a.heading + part * (b.heading - a.heading)
    )
