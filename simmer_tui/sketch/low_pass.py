"""A gyro's digital low-pass filter: its rate follows that of the robot with a delay.

Times are nanoseconds, rates deg/s.
"""

from __future__ import annotations

import math

GYRO_DELAYS = tuple(round(each * 1e6) for each in (0.98, 1.9, 2.8, 4.8, 8.3, 13.4, 18.6, 0.98))
"""Delays of an MPU-6050's gyro by the number of its filter, DLPF_CFG (register map, register 26). 7 is
reserved."""
_SETTLED = 12
"""Delays after which the rest of a change, 6e-6 of it, is none: less than a count of the gyro."""


class LowPassRate:
    """A rate that changes in steps, behind a filter of first order whose time constant is the delay.

    It is in closed form from the last step: the times of readings change nothing.
    """

    def __init__(self) -> None:
        self._since = 0
        self._rest = 0.0
        """The filtered rate less that of the robot, at the last step."""
        self._rate = math.nan
        self._filter = 0

    def set_rate(self, time: int, rate: float) -> None:
        """The robot turns at another rate from a time on. The first one has been there before."""
        if rate != self._rate:
            before = rate if math.isnan(self._rate) else self.at(time)
            self._since, self._rest, self._rate = time, before - rate, rate

    def set_filter(self, time: int, number: int) -> None:
        """Another filter is on from a time on."""
        if number != self._filter:
            self._rest = self.at(time) - self._rate
            self._since, self._filter = time, number

    def at(self, time: int) -> float:
        """The filtered rate at a time after the last step."""
        gone = (time - self._since) / GYRO_DELAYS[self._filter]
        return self._rate if gone >= _SETTLED else self._rate + self._rest * math.exp(-gone)

    def is_steady(self, time: int) -> bool:
        """True if it stays as it is until the next step."""
        return not self._rest or time - self._since >= _SETTLED * GYRO_DELAYS[self._filter]
