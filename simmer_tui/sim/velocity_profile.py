"""Speed over time of a drive that does not start at once, nor at full speed."""

from __future__ import annotations

import math

from msgspec import Struct


class VelocityProfile(Struct, frozen=True):
    """A trapezoid of speed over time: still for `lag` seconds, then ever faster up to `speed`, then
    ever slower to the end, both at `acceleration` (0: at once). `way` (0 or more) is what is asked for
    in inches or degrees; a short one never gets to full speed. Nothing asked for takes no time.
    """

    way: float
    speed: float
    lag: float = 0.0
    acceleration: float = 0.0

    @property
    def _top(self) -> float:
        """The greatest speed that is reached."""
        if not self.acceleration:
            return self.speed
        return min(self.speed, math.sqrt(self.way * self.acceleration))

    @property
    def _ramp(self) -> float:
        """Seconds of getting faster, and as many of getting slower."""
        return self._top / self.acceleration if self.acceleration else 0.0

    @property
    def duration(self) -> float:
        """Seconds from the command to standstill: lag + way / top + top / acceleration."""
        return self.lag + self.way / self._top + self._ramp if self.way else 0.0

    def fraction_at(self, elapsed: float) -> float:
        """The fraction of the way that is done so many seconds after the command."""
        gone, left = elapsed - self.lag, self.duration - elapsed
        if gone <= 0.0:
            return 0.0
        if left <= 0.0:
            return 1.0
        ramp, top = self._ramp, self._top
        if gone < ramp:
            return self.acceleration * gone * gone / 2.0 / self.way
        if left < ramp:
            return 1.0 - self.acceleration * left * left / 2.0 / self.way
        return top * (gone - ramp / 2.0) / self.way

    def time_at(self, fraction: float) -> float:
        """Seconds after the command at which a fraction (0 to 1) of the way is done."""
        if not self.way:
            return 0.0
        ramp, top = self._ramp, self._top
        gone, left = fraction * self.way, (1.0 - fraction) * self.way
        if gone < top * ramp / 2.0:
            return self.lag + math.sqrt(2.0 * gone / self.acceleration)
        if left < top * ramp / 2.0:
            return self.duration - math.sqrt(2.0 * left / self.acceleration)
        return self.lag + gone / top + ramp / 2.0
