"""What all sensors have in common: errors laid over a true value, and how the truth comes about.

A sensor either observes, its true value following from the world and the robot's pose, or counts,
adding up what movements bring. Each kind is one class, and one object of it works for one row of
sensors.csv.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import FloorPatch, RangeScan
from simmer_tui.sim.sensors.world import World
from simmer_tui.sim.specs import SensorKind, SensorSpec
from simmer_tui.sim.trajectory import Trajectory

View = RangeScan | FloorPatch
"""The geometry a reading may rest on: rays, or a patch of floor."""


class Sensor(SensorKind):
    """A sensor at work. A kind says in class variables what `SensorKind` asks for."""

    spec_type: ClassVar[type[SensorSpec]] = SensorSpec
    missed: ClassVar[float] = 0.0
    """What a missed reading says."""
    pings: ClassVar[bool] = False
    """Whether it sends sound that others may hear."""

    def __init__(self, spec: SensorSpec) -> None:
        self.spec = spec

    def reading(self, true: float, random: np.random.Generator | None, time: float) -> float:
        """A reading of a true value at a simulated time, with the sensor's errors in the order it
        applies them. Without `random` there is no random error."""
        spec = self.spec
        value = self.proportional(true, random) * spec.gain
        if random is not None and spec.absolute_error:
            value += spec.absolute_error * random.standard_normal()
        return self.reported(value + spec.bias + spec.drift * time)

    def proportional(self, true: float, random: np.random.Generator | None) -> float:
        """The value with its Percent Error: one draw a reading."""
        return true if random is None else true * (1.0 + self.spec.error * random.standard_normal())

    def reported(self, value: float) -> float:
        """A value as the sensor's electronics report it: wrapped, rounded, limited to its range. A
        wrapped value stays below `Wrap` itself, when it is rounded up, too."""
        spec = self.spec
        if not math.isfinite(value):
            return value
        if spec.wrap:
            value %= spec.wrap
        if spec.resolution and math.isfinite(steps := value / spec.resolution):
            value = round(steps) * spec.resolution
        if spec.wrap and value >= spec.wrap:  # by rounding: -1e-17 % 360.0 is 360.0
            value = 0.0
        if spec.min_range and value < spec.min_range:
            return spec.min_range
        return math.inf if value > spec.max_range else value

    def ideal(self, true: float) -> float:
        """The value as the sensor would have it without any error, before its electronics."""
        return true

    def anywhere(self, fraction: float) -> float:
        """An outlier: the value that far along the range of what it may say."""
        return fraction

    def error(self, true: float, reply: float) -> float:
        """How far a reply is off what the sensor should have said of a true value, in its unit;
        infinity if it saw something where nothing was in range, or the reverse."""
        expected = self.reported(self.ideal(true) * self.spec.gain)
        if expected == reply:
            return 0.0
        error = reply - expected
        if not math.isfinite(error):
            return math.inf
        wrap = self.spec.wrap
        return (error + wrap / 2) % wrap - wrap / 2 if wrap else error


class ObservingSensor(Sensor, ABC):
    """A sensor whose true value follows from the world and where the robot is in it."""

    @abstractmethod
    def observe(self, world: World, pose: Pose) -> tuple[float, View | None]:
        """What a perfect sensor would say of `world` with the robot at `pose`, and the geometry
        this rests on, if there is any."""


class CountingSensor(Sensor, ABC):
    """A sensor that adds up what movements bring; its Percent Error enters as it counts."""

    counts = True
    slips: ClassVar[bool]
    """Whether it counts on while a wall holds the robot. It then has increments for the turn and
    for the translation of each segment, (n, 2); else for the turn alone, (n,)."""

    @abstractmethod
    def increments(self, turn: float, move: tuple[float, float], draws: FloatArray) -> FloatArray:
        """What each segment adds, which turns by `turn` degrees and then moves by `move` in the
        robot's frame. `draws` are normal draws, of the shape of the result."""

    @abstractmethod
    def counted(self, trajectory: Trajectory, time: float) -> float:
        """What a movement has added by a simulated time."""

    @abstractmethod
    def counted_on(self, turned: float, ahead: float, aside: float) -> float:
        """What it would count without error where the robot turns by `turned` degrees and goes, in
        its own frame, `ahead` and `aside` (to the left) inches."""

    def proportional(self, true: float, random: np.random.Generator | None) -> float:
        """The value alone: its Percent Error is in it already."""
        return self.ideal(true)


def sensor_of(spec: SensorSpec) -> Sensor:
    """The sensor at work for a row. Raises TypeError if its kind is no class of `Sensor`."""
    kind = spec.kind
    if not issubclass(kind, Sensor):
        raise TypeError(f"{kind.__name__} says what a sensor is, but not how it works")
    return kind(spec)
