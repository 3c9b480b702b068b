"""Keyframes: a movement as a few poses, between which it is even. The player of a page draws these."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

from simmer_tui.sim.legs import Leg
from simmer_tui.sim.path import PathPosition
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.trajectory import Trajectory

# Keyframes give each pose to within this, inches and degrees.
_OFF, _TURNED = 0.01, 0.1
_DIRECTIONS = tuple((math.cos(math.tau * k / 16), math.sin(math.tau * k / 16)) for k in range(16))
# Half the width of the regular polygon with its corners at `_OFF`: 2 % less than that.
_APOTHEM = _OFF * math.cos(math.pi / len(_DIRECTIONS))
# Seconds from a break to the moment just before it.
_INSTANT = 1e-6
# No two keyframes are made closer to each other than this, seconds.
_LEAST = 2e-3


class Keyframe(NamedTuple):
    """Pose of the robot at a moment; between two keyframes it moves evenly. Of two at the same moment the
    second counts from there on."""

    elapsed: float
    pose: Pose


def pose_at(frames: Sequence[Keyframe], times: Sequence[float], elapsed: float) -> Pose:
    """The pose at a moment by keyframes with these times."""
    after = bisect_right(times, elapsed)
    if after == 0:
        return frames[0].pose
    if after == len(frames):
        return frames[-1].pose
    return _between(frames[after - 1], frames[after], elapsed)


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
