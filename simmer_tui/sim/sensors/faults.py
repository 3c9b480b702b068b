"""Occasional faults of readings: dropouts, outliers, cross-talk. They draw from random streams of their
own, so that a sensor without such columns reads exactly as if there were no faults."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct, field

from simmer_tui.sim.sensors.base import Sensor

# 343 m/s, in inches of 0.0254 m.
SPEED_OF_SOUND = 343.0 / 0.0254
"""In/s, in air of 20 degrees Celsius."""


class Pings(Struct):
    """The bursts of sound of a run. For each sensor ID: the time of the last one, the end of its sensor's
    listening (both simulated time), and the distance of its reflector (inches)."""

    sent: dict[str, tuple[float, float, float]] = field(default_factory=dict)

    def overheard(self, sensor: str, own: float, time: float) -> float | None:
        """Cross-talk of a sensor that sends at `time`: the distance, inches, that it reads from another
        sensor's earlier sound. None unless that sensor still listens, and the sound arrives before the own
        echo from `own` inches away.

        The other's sound goes to its own reflector and returns from this sensor's: (d1 + d2) / c after it was
        sent. Read as an own echo, it gives (d1 + d2 - c dt) / 2.
        """
        echoes = [
            (other + own - SPEED_OF_SOUND * (time - begin)) / 2
            for name, (begin, until, other) in self.sent.items()
            if name != sensor and begin <= time < until
        ]
        return min((each for each in echoes if 0.0 < each < own), default=None)


class Faults:
    """The faults of one sensor during one run."""

    def __init__(self, sensor: Sensor, random: np.random.Generator, pings: Pings) -> None:
        self._sensor = sensor
        self._random = random
        self._pings = pings
        self._walked, self._walked_at = 0.0, 0.0

    def reading(self, true: float, random: np.random.Generator, time: float) -> float:
        """A reading as `Sensor.reading` has it, with the faults of that moment."""
        spec = self._sensor.spec
        if walk := self._sensor.random_walk:
            true += self._walk(walk, time)
        if self._sensor.pings and spec.read_time:
            own = true
            if cross_talk := self._sensor.cross_talk:
                false_echo = self._pings.overheard(spec.id, own, time)
                if false_echo is not None and self._random.random() < cross_talk:
                    true = false_echo
            # The true distance, not the reading: the sound returns from the surface that the sensor points
            # at.
            self._pings.sent[spec.id] = (time, time + spec.read_time, own)
        value = self._sensor.reading(true, random, time)
        if not (spec.dropout or spec.outlier):
            return value
        # Always three draws, so that one fault's probability does not change the other faults of the same
        # seed.
        missing, off, where = self._random.random(3).tolist()
        if missing < spec.dropout:
            return self._sensor.missed
        return self._sensor.anywhere(where) if off < spec.outlier else value

    def _walk(self, strength: float, time: float) -> float:
        """A random walk: its increment over t seconds has the standard deviation strength sqrt(t)."""
        if time > self._walked_at:
            step = strength * math.sqrt(time - self._walked_at)
            self._walked += step * float(self._random.standard_normal())
            self._walked_at = time
        return self._walked


def has_faults(sensor: Sensor) -> bool:
    """True if a sensor needs `Faults`."""
    spec = sensor.spec
    return bool(sensor.random_walk or spec.dropout or spec.outlier or (sensor.pings and spec.read_time))
