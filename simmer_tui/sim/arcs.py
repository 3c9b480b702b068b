"""Motion at a constant twist: the robot's centre goes along a circular arc or a straight line, and it
turns evenly.

With w the turning rate in radians, v the global velocity at the start, v' that velocity turned left by
90 degrees and h = 2 tan(w t / 2) / w (t where w is 0), the centre is after t seconds at

    p(t) = p0 + (h v + (w h^2 / 2) v') / (1 + w^2 h^2 / 4).

This follows from sin(w t) / w and (1 - cos(w t)) / w by the half-angle formulas. It has no distant centre of
rotation, and no special case for straight lines. So no digits are lost at any rate. Tangent and arctangent
are the standard library's, one number at a time: numpy's own differ between processors.
"""

import math
from collections.abc import Iterable

import numpy as np
from msgspec import Struct

from simmer_tui.sim.angles import cos_sin
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.pose import Pose

# The tangent of half a turn of 90 degrees is 1, and h grows without bound towards 180.
LARGEST_TURN = 90.0
"""Degrees that one arc may turn by; a longer motion is a chain of arcs."""


class Twist(Struct, frozen=True):
    """A velocity in the robot's frame: `x` ahead and `y` to the left in in/s, `r` counter-clockwise in
    deg/s."""

    x: float = 0.0
    y: float = 0.0
    r: float = 0.0

    @property
    def moves(self) -> bool:
        """True if any component differs from 0."""
        return self.x != 0.0 or self.y != 0.0 or self.r != 0.0

    @property
    def speed(self) -> float:
        """Speed of the robot's centre, in/s."""
        return math.sqrt(self.x * self.x + self.y * self.y)

    def scaled(self, factor: float) -> "Twist":
        """The twist with every component times a factor: the same curve, faster or slower."""
        return Twist(self.x * factor, self.y * factor, self.r * factor)


STILL = Twist()
"""The twist of a robot that stands."""


class Arc(Struct, frozen=True, dict=True):
    """A motion of `duration` seconds from a pose at a constant twist, at most `LARGEST_TURN` degrees.

    `velocity` is the centre's at the start, global, in/s; `rate` the turning rate, deg/s. A `spin`, deg/s,
    turns the robot as well, but not its path: a disc that slides along a wall goes straight however it turns.
    """

    start: Pose
    velocity: tuple[float, float]
    rate: float
    duration: float
    spin: float = 0.0

    @classmethod
    def of(cls, start: Pose, twist: Twist, duration: float) -> "Arc":
        """The motion of a robot at `start` by a twist in its own frame."""
        cos, sin = cos_sin(start.heading)
        velocity = (cos * twist.x - sin * twist.y, sin * twist.x + cos * twist.y)
        return cls(start, velocity, twist.r, duration)

    @classmethod
    def standing(cls, pose: Pose) -> "Arc":
        """The motion of a robot that stands, without end."""
        return cls(pose, (0.0, 0.0), 0.0, math.inf)

    @property
    def own_velocity(self) -> tuple[float, float]:
        """The centre's velocity ahead and to the left of the robot, in/s; with a spin that at the start."""
        cos, sin = cos_sin(self.start.heading)
        x, y = self.velocity
        return cos * x + sin * y, cos * y - sin * x

    @property
    def turn_rate(self) -> float:
        """The turning rate w, rad/s."""
        return math.radians(self.rate)

    @property
    def length(self) -> float:
        """Length of the centre's path, inches."""
        x, y = self.velocity
        return math.sqrt(x * x + y * y) * self.duration

    @property
    def end(self) -> Pose:
        """The pose after the whole duration."""
        return self.pose_after(self.duration)

    def half_tangent(self, seconds: float) -> float:
        """The number h of a time since the start: 2 tan(w t / 2) / w, also in seconds."""
        w = self.turn_rate
        return 2.0 * math.tan(w * seconds / 2.0) / w if w else seconds

    def seconds_at(self, h: float) -> float:
        """The time since the start to which a number h belongs."""
        w = self.turn_rate
        return 2.0 * math.atan(w * h / 2.0) / w if w else h

    def pose_after(self, seconds: float) -> Pose:
        """The pose so many seconds after the start."""
        x, y = self.place_at(self.half_tangent(seconds))
        return Pose(x, y, self.start.heading + (self.rate + self.spin) * seconds)

    def pose_at(self, h: float) -> Pose:
        """The pose to which a number h belongs."""
        x, y = self.place_at(h)
        return Pose(x, y, self.start.heading + (self.rate + self.spin) * self.seconds_at(h))

    def seconds_in_box(self, low: tuple[float, float], high: tuple[float, float]) -> float | None:
        """Seconds after the start at which the centre first is in a box, its edges included; None for
        never."""
        last = self.half_tangent(self.duration) if self.duration < math.inf else 0.0
        w, (vx, vy) = self.turn_rate, self.velocity
        moments = [0.0, last]
        for place, speed, bend, sides in (
            (self.start.x, vx, -vy, (low[0], high[0])),
            (self.start.y, vy, vx, (low[1], high[1])),
        ):
            for side in sides:
                gap = place - side
                moments += _roots(gap * w * w / 4.0 + bend * w / 2.0, speed, gap)
        for h in sorted(h for h in moments if 0.0 <= h <= last):
            x, y = self.place_at(h)
            if _within(x, low[0], high[0]) and _within(y, low[1], high[1]):
                return self.seconds_at(h)
        return None

    def place_at(self, h: float) -> tuple[float, float]:
        """The centre to which a number h belongs, inches, global."""
        w, (vx, vy) = self.turn_rate, self.velocity
        half = w * h / 2.0
        along, aside = h / (1.0 + half * half), half * h / (1.0 + half * half)
        return self.start.x + along * vx - aside * vy, self.start.y + along * vy + aside * vx


def poses_along(arcs: Iterable[tuple[Arc, float, int]], times: FloatArray) -> FloatArray:
    """Poses, (n, 3), at n simulated times along arcs: the numbers of `Arc.pose_after`, bit for bit. Each arc
    comes with the time at which it begins, and the number of times on it, in order."""
    lines, counts = [], []
    for arc, begin, count in arcs:
        if count:
            place = (arc.start.x, arc.start.y, arc.start.heading)
            lines.append((begin, *place, *arc.velocity, arc.turn_rate, arc.rate + arc.spin))
            counts.append(count)
    table = np.array(lines)
    rows = np.repeat(table.T, counts, axis=1)
    since, x, y, heading, vx, vy, w, turning = rows
    seconds = times - since
    # One coordinate after the other in memory, since that is how rays are cast.
    poses = np.empty((3, len(times)))
    poses[2] = heading + turning * seconds
    if not table[:, 4:6].any():
        poses[0], poses[1] = x, y
        return poses.T
    h = seconds
    if table[:, 6].all():
        h = 2.0 * _tangents(w * seconds / 2.0) / w
    elif table[:, 6].any():
        h, bent = seconds.copy(), np.flatnonzero(w)
        h[bent] = 2.0 * _tangents(w[bent] * seconds[bent] / 2.0) / w[bent]
    half = w * h / 2.0
    below = 1.0 + half * half
    along, aside = h / below, half * h / below
    poses[0] = x + along * vx - aside * vy
    poses[1] = y + along * vy + aside * vx
    return poses.T


def _tangents(angles: FloatArray) -> FloatArray:
    return np.fromiter(map(math.tan, angles.tolist()), np.float64, len(angles))


# Inches. More than the rounding of a place on an edge, and far less than the precision of any robot's place.
_EDGE = 1e-9


def _within(place: float, low: float, high: float) -> bool:
    return low - _EDGE <= place <= high + _EDGE


def _roots(a: float, b: float, c: float) -> list[float]:
    """Real roots of a h^2 + b h + c = 0 (Press et al., Numerical Recipes, 5.6)."""
    square = b * b - 4.0 * a * c
    if square < 0.0:
        return []
    q = -0.5 * (b + math.copysign(math.sqrt(square), b))
    return [top / bottom for top, bottom in ((q, a), (c, q)) if bottom]
