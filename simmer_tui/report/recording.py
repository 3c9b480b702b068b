"""What a player shows of a run: poses, readings, beliefs, the block and what happened, on one clock.

A recording holds a bounded number of everything, the newest; `begin` is from when on it is whole.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from itertools import pairwise

from msgspec import Struct

from simmer_tui.events import (
    ActionDone,
    ActionName,
    Belief,
    CommandResult,
    Event,
    Goal,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    Result,
)
from simmer_tui.phrases import contact_text
from simmer_tui.run.bounded import Newest, TimedItem
from simmer_tui.run.reducer import Reducer
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import escape
from simmer_tui.sim.gripper import in_global_frame, in_robot_frame
from simmer_tui.sim.path import PathPosition
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import REFUSALS
from simmer_tui.sim.specs import SimulationSpec
from simmer_tui.sim.trajectory import Trajectory

MOVEMENTS = 3000
READINGS = 15_000
BELIEFS = 2000
"""Most of each that are kept."""
PARTICLES = 30_000
"""About the most particles of all beliefs together; rather fewer of each than none of some."""
CLOUD = 250
"""Most particles of one belief."""
MARKS = 500
"""Most marks, the newest."""
_OFF, _TURNED = 0.01, 0.1
"""Keyframes give each pose to within this, inches and degrees."""
_DIRECTIONS = tuple((math.cos(math.tau * k / 16), math.sin(math.tau * k / 16)) for k in range(16))
_APOTHEM = _OFF * math.cos(math.pi / len(_DIRECTIONS))
"""Half the width of the regular polygon with its corners at `_OFF`: 2 % less than that."""
_INSTANT = 1e-6
"""Seconds before a moment that count as just before it."""
_LEAST = 2e-3
"""No two keyframes are made closer to each other than this, seconds."""


class MarkKind(StrEnum):
    """What a mark on the clock stands for."""

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
    """Where the robot was at a moment; between two of them it went evenly. Of two at the same moment
    the second counts from there on."""

    elapsed: float
    pose: Pose


class Heard(Struct, frozen=True):
    """A reading: when it was answered and when it was taken, of which sensor, what it said and what was
    true."""

    elapsed: float
    taken: float
    code: str
    value: float
    true: float


@dataclass(frozen=True, slots=True)
class Believed:
    """A belief, when it was told, and some of its particles."""

    elapsed: float
    belief: Belief
    cloud: tuple[tuple[float, ...], ...]


class Sent(Struct, frozen=True):
    """A command that moved something, when it began."""

    elapsed: float
    text: str


@dataclass(frozen=True, slots=True)
class Placed:
    """From when on the block was where: in the robot's frame while it is `held`, else in the maze's."""

    elapsed: float
    held: bool
    block: Block


class _Moved(Struct, frozen=True):
    """A movement till a simulated time; `zero` is what to add to simulated times."""

    zero: float
    trajectory: Trajectory
    until: float

    @property
    def elapsed(self) -> float:
        return self.zero + self.trajectory.start_time


@dataclass(frozen=True, slots=True)
class _Jumped:
    """The robot was put elsewhere."""

    elapsed: float
    before: Pose
    after: Pose


class Recording:
    """Feed it the events of a run, in order, with the fold that has taken them."""

    def __init__(self, spec: SimulationSpec, pose: Pose, block: Block, *, holding: bool) -> None:
        """How the run stands at its beginning."""
        self.spec = spec
        self.end = 0.0
        """Elapsed seconds of all that was told."""
        self.readings: Newest[Heard] = Newest(READINGS)
        self.beliefs: Newest[Believed] = Newest(BELIEFS)
        self.blocks: Newest[Placed] = Newest(2 * MOVEMENTS)
        self.marks: Newest[Mark] = Newest(MARKS)
        self.commands: Newest[Sent] = Newest(MOVEMENTS)
        self._start = pose
        self._moves: Newest[_Moved | _Jumped] = Newest(MOVEMENTS)
        self._planned: tuple[float, MovementPlanned] | None = None
        self._particles = 0
        self.one_particle_in = 1
        """So many; more than that find no room."""
        self.blocks.add(Placed(0.0, holding, in_robot_frame(block, pose) if holding else block))

    @property
    def begin(self) -> float:
        """From when on, elapsed seconds, nothing but marks is left out."""
        kept = (self.readings, self.beliefs, self.blocks, self.commands, self._moves)
        return min(max(each.since for each in kept), self.end)

    # -- events ----------------------------------------------------------------------------------

    def add(self, event: Event, elapsed: float, zero: float, before: Pose | None, fold: Reducer) -> None:
        """Take in an event: `elapsed` is when it was, `zero` what to add to simulated times, `before`
        where the robot stood before an action."""
        if elapsed > self.end:
            self.end = elapsed
        match event:
            case CommandResult():
                self._add_outcome(event, elapsed, zero)
            case MovementPlanned():
                self._planned = zero, event
                self.commands.add(Sent(zero + event.time, event.command.shown))
                if event.grip is not None:
                    self._place_block(zero + event.time, fold)
            case MovementEnded():
                self._planned = None
                self._moves.add(_Moved(zero, event.trajectory, event.time))
                self._add_contact(event, zero)
            case ActionDone():
                self._add_action(event, elapsed, before, fold)
            case Belief():
                self._add_belief(event, elapsed)
            case MissionEvent():
                failed = event.subject is Result.FAILED
                if isinstance(event.subject, Goal) or event.over:
                    self._mark(elapsed, MarkKind.FAILED if failed else MarkKind.GOAL, event.text)
            case Notice():
                if event.kind is NoticeKind.FAULT:
                    self._mark(elapsed, MarkKind.FAULT, event.text)

    def _add_outcome(self, outcome: CommandResult, elapsed: float, zero: float) -> None:
        reading = outcome.reading
        if outcome.status in REFUSALS:
            why = escape(outcome.reason, 120)
            self._mark(elapsed, MarkKind.REFUSED, f"{outcome.command.shown}: {why or outcome.status.value}")
        elif reading is not None:
            taken = zero + (outcome.time if outcome.taken is None else outcome.taken)
            code = reading.sensor.code
            self.readings.add(Heard(elapsed, min(taken, elapsed), code, reading.value, reading.true))

    def _add_contact(self, ended: MovementEnded, zero: float) -> None:
        contact = ended.contact
        if contact is None:
            return
        words = f"{ended.command.shown}: {contact_text(contact, self.spec)}"
        self._mark(zero + contact.time, MarkKind.CONTACT, words, contact.point)

    def _add_action(self, done: ActionDone, elapsed: float, before: Pose | None, fold: Reducer) -> None:
        name = done.action.name
        pauses = name in (ActionName.PAUSE, ActionName.RESUME)
        self._mark(elapsed, MarkKind.PAUSE if pauses else MarkKind.PERSON, f"{name.value}: {done.text}")
        if done.refused:
            return
        if name.places and before is not None:
            self._moves.add(_Jumped(elapsed, before, done.pose))
        if name.places or name is ActionName.BLOCK:
            self._place_block(elapsed, fold)

    def _add_belief(self, belief: Belief, elapsed: float) -> None:
        pose = belief.pose
        if not all(map(math.isfinite, (pose.x, pose.y, pose.heading))):
            return
        self.beliefs.add(Believed(elapsed, belief, cloud(belief)[:: self.one_particle_in]))
        self._particles += len(self.beliefs.items[-1].cloud)
        if self._particles > PARTICLES:
            self.one_particle_in *= 2
            items = self.beliefs.items
            for place, told in enumerate(items):
                items[place] = replace(told, cloud=told.cloud[::2])
            self._particles = sum(len(each.cloud) for each in items)

    def _place_block(self, elapsed: float, fold: Reducer) -> None:
        state = fold.at()
        block = in_robot_frame(state.block, state.pose) if state.holding else state.block
        self.blocks.add(Placed(elapsed, state.holding, block))

    def _mark(
        self, elapsed: float, kind: MarkKind, text: str, point: tuple[float, float] | None = None
    ) -> None:
        self.end = max(self.end, elapsed)
        self.marks.add(Mark(elapsed, kind, escape(text, 300), point))

    # -- the run at a moment -----------------------------------------------------------------------

    @cached_property
    def keyframes(self) -> list[Keyframe]:
        """The robot's way, in order of time; at least one. To be asked for when all has been told."""
        moves = list(self._moves.items)
        if self._planned is not None:
            zero, planned = self._planned
            until = min(max(self.end - zero, planned.time), planned.trajectory.end_time)
            moves.append(_Moved(zero, planned.trajectory, until))
        frames: list[Keyframe] = []
        for move in moves:
            if isinstance(move, _Jumped):
                frames += [Keyframe(move.elapsed, move.before), Keyframe(move.elapsed, move.after)]
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
        """Where the robot was, by the keyframes."""
        frames = self.keyframes
        after = bisect_right(self._times, elapsed)
        if after == 0:
            return frames[0].pose
        if after == len(frames):
            return frames[-1].pose
        return _between(frames[after - 1], frames[after], elapsed)

    def trail(self, until: float) -> list[Keyframe]:
        """The keyframes up to a moment, and that moment."""
        after = bisect_right(self._times, until)
        return [*self.keyframes[:after], Keyframe(until, self.pose_at(until))]

    def block_at(self, elapsed: float) -> Block:
        """Where the block was, in the maze's frame."""
        placed = latest(self.blocks, elapsed) or self.blocks.items[0]
        return in_global_frame(placed.block, self.pose_at(elapsed)) if placed.held else placed.block

    def belief_at(self, elapsed: float) -> Believed | None:
        """The newest belief told by then."""
        return latest(self.beliefs, elapsed)


def latest(kept: Newest[TimedItem], elapsed: float) -> TimedItem | None:
    """The last item not after a moment."""
    found = bisect_right(kept.items, elapsed, key=lambda item: item.elapsed)
    return kept.items[found - 1] if found else None


def cloud(belief: Belief) -> tuple[tuple[float, ...], ...]:
    """The particles of a belief, at most `CLOUD`, evenly chosen; those without a place are left out."""
    particles = belief.particles
    step = max(1, math.ceil(len(particles) / CLOUD))
    return tuple(each for each in particles[::step] if math.isfinite(each[0]) and math.isfinite(each[1]))


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
    """What must be put between two moments, in order."""
    (a, _), (b, _) = begin, end
    middle = (a + b) / 2
    frame = middle, trajectory.pose_at(middle)
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
