"""Sensors that add up what movements bring: wheel encoders and the gyro."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from simmer_tui.sim import columns
from simmer_tui.sim.angles import FloatArray, cos_sin
from simmer_tui.sim.sensors.base import CountingSensor
from simmer_tui.sim.sensors.observation import Prior, Sort
from simmer_tui.sim.trajectory import Trajectory


class Odometer(CountingSensor):
    """A wheel encoder, inches. With q its place and v its rolling direction (robot's frame), turning
    by a degrees rolls 2 pi (q x v) a / 360, translating by t rolls t . v."""

    name = "odom"
    meaning = "wheel encoder"
    unit = "in"
    slips = True
    devices = ("MotorSimple",)
    columns = (
        columns.X,
        columns.Y,
        columns.ROTATION,
        columns.ERROR,
        *columns.ELECTRONICS,
        columns.READ_TIME,
        columns.TICKS,
    )

    def increments(self, turn: float, move: tuple[float, float], draws: FloatArray) -> FloatArray:
        """For each segment what its turn and its translation roll, inches: (n, 2)."""
        parts = self.counted_on(turn, 0.0, 0.0), self.counted_on(0.0, *move)
        return np.array(parts) * (1.0 + self.spec.error * draws)

    def ideal(self, true: float) -> float:
        """Whole ticks, where it counts such: a new one at each edge that goes by."""
        ticks = self.spec.ticks_per_inch
        return math.floor(true * ticks) / ticks if ticks else true

    def counted(self, trajectory: Trajectory, time: float) -> float:
        return trajectory.rolled(self.spec.id, time)

    def counted_on(self, turned: float, ahead: float, aside: float) -> float:
        cos, sin, around = self._wheel
        return around * turned / 360.0 + (ahead * cos + aside * sin)

    @cached_property
    def _wheel(self) -> tuple[float, float, float]:
        """The direction v it rolls in, and what a whole turn rolls, by its lever q x v."""
        spec = self.spec
        cos, sin = cos_sin(spec.rotation)
        return cos, sin, 2.0 * math.pi * (spec.x * sin - spec.y * cos)


class Gyro(CountingSensor):
    """The angle turned, degrees: only what was really turned."""

    name = "gyro"
    meaning = "angle turned"
    unit = "deg"
    slips = False
    devices = ("Gyroscope",)
    columns = (columns.ERROR, *columns.ELECTRONICS, columns.READ_TIME, columns.RANDOM_WALK)
    # An MPU-6050's sensitivity is within 3 %, its rate at rest within 20 deg/s before and some tenths after
    # its offset is taken off (InvenSense, revision 3.4); priors are wider by a factor of 2 to 3.
    parameters = (
        Prior("gain", "gain", Sort.GAIN, 0.1),
        Prior("drift", "drift", Sort.DRIFT, 0.5, "deg/s"),
    )
    noise_scales = (
        Prior("error", "percent error", Sort.NOISE, 1.2, usual=0.01),
        Prior("random_walk", "random walk", Sort.NOISE, 1.5, "deg/sqrt s", usual=0.01),
    )
    least_error = 0.003

    def increments(self, turn: float, move: tuple[float, float], draws: FloatArray) -> FloatArray:
        """For each segment what it turns, degrees: (n,)."""
        return turn * (1.0 + self.spec.error * draws)

    def counted(self, trajectory: Trajectory, time: float) -> float:
        return trajectory.turned(self.spec.id, time)

    def counted_on(self, turned: float, ahead: float, aside: float) -> float:
        return turned
