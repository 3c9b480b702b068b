"""The commanded velocity of a robot's wheels over time: commands, their lag, their ramp and their end.

A command takes effect after its lag. All components then change linearly and reach their values together,
after T = max |du_a| / acceleration_a seconds. As in every board's speed control, the ramp is a staircase: one
step a control period, at its mean.
"""

import math
from collections import deque
from collections.abc import Iterable, Mapping

from msgspec import Struct
from msgspec.structs import astuple

from simmer_tui.sim.arcs import STILL, Twist
from simmer_tui.sim.distance_errors import components
from simmer_tui.sim.specs import DriveKind, DriveSpec


class VelocityTarget(Struct, frozen=True):
    """A commanded velocity: `lag` seconds until it takes effect, and the greatest change of each component
    a second (0: at once)."""

    twist: Twist
    lag: float = 0.0
    acceleration: Twist = STILL


def ramp_of(drives: Iterable[DriveSpec]) -> tuple[float, Twist]:
    """Common lag, seconds, and acceleration of rows of drives: the greatest lag, and on each axis the least
    acceleration."""
    lag, least = 0.0, [math.inf, math.inf, math.inf]
    for drive in drives:
        lag = max(lag, drive.start_lag)
        if drive.acceleration:
            axis = 2 if drive.kind.turns else 1 if drive.kind.direction.y else 0
            least[axis] = min(least[axis], drive.acceleration)
    x, y, r = (value if value < math.inf else 0.0 for value in least)
    return lag, Twist(x, y, r)


def velocity_target(twist: Twist, before: Twist, drives: Mapping[DriveKind, DriveSpec]) -> VelocityTarget:
    """A velocity with the lag and the ramp of the rows that it or the previous one uses."""
    used = {part.drive.kind: part.drive for each in (before, twist) for part in components(each, drives)}
    return VelocityTarget(twist, *ramp_of(used.values()))


class _Ramp(Struct, frozen=True):
    """A linear change of velocity from `begin` seconds on."""

    begin: float
    seconds: float
    before: Twist
    after: Twist

    def mean(self, since: float, until: float) -> Twist:
        """Mean velocity between two times after `begin`."""
        share = (since + until) / 2.0 / self.seconds
        axes = zip(astuple(self.before), astuple(self.after), strict=True)
        return Twist(*(before + share * (after - before) for before, after in axes))


class VelocityPlan:
    """The velocity in force, and its next changes."""

    def __init__(self, control_period: float) -> None:
        self._period = control_period
        self._targets: deque[tuple[float, VelocityTarget]] = deque()
        self._ramp: _Ramp | None = None
        self._step = 0
        self.twist = STILL
        """Velocity in force now."""
        self.commanded = STILL
        """Velocity commanded last, which may not have taken effect yet."""

    @property
    def moves(self) -> bool:
        """True if a velocity other than 0 is in force, or soon will be."""
        return self.twist.moves or self.commanded.moves or bool(self._targets)

    def command(self, time: float, target: VelocityTarget) -> bool:
        """Add a command at a simulated time. Returns True if it changes the commanded velocity."""
        if target.twist == self.commanded:
            return False
        # A lag is a delay, not a pause: commands that arrive faster than it take effect one after the other.
        earliest = self._targets[-1][0] if self._targets else time
        self._targets.append((max(time + target.lag, earliest), target))
        self.commanded = target.twist
        return True

    def halt(self) -> None:
        """Velocity 0 at once, without lag or ramp."""
        self._targets.clear()
        self._ramp, self.twist, self.commanded = None, STILL, STILL

    @property
    def due(self) -> float:
        """Simulated time of the next change, infinite if there is none."""
        return min(self._targets[0][0] if self._targets else math.inf, self._step_end)

    @property
    def _step_end(self) -> float:
        """Simulated time at which the present step of a ramp ends."""
        if self._ramp is None:
            return math.inf
        return self._ramp.begin + min((self._step + 1) * self._period, self._ramp.seconds)

    def change(self, time: float) -> None:
        """Make the changes that are due at a simulated time."""
        if self._ramp is not None and time >= self._step_end:
            self._next_step(self._ramp)
        while self._targets and self._targets[0][0] <= time:
            at, target = self._targets.popleft()
            seconds = _ramp_seconds(self.twist, target)
            if seconds:
                self._ramp, self._step = _Ramp(at, seconds, self.twist, target.twist), -1
                self._next_step(self._ramp)
            else:
                self._ramp, self.twist = None, target.twist

    def _next_step(self, ramp: _Ramp) -> None:
        self._step += 1
        since = self._step * self._period
        if since >= ramp.seconds:
            self._ramp, self.twist = None, ramp.after
        else:
            self.twist = ramp.mean(since, min(since + self._period, ramp.seconds))


def _ramp_seconds(before: Twist, target: VelocityTarget) -> float:
    """Time that the slowest component needs."""
    axes = zip(astuple(before), astuple(target.twist), astuple(target.acceleration), strict=True)
    return max(abs(after - old) / limit if limit else 0.0 for old, after, limit in axes)
