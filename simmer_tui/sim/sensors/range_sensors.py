"""Sensors that measure a distance with a fan of rays: ultrasonic and time of flight."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from simmer_tui.sim import columns
from simmer_tui.sim.angles import FloatArray, cos_sin, cos_sin_array
from simmer_tui.sim.columns import Column
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import RangeScan
from simmer_tui.sim.sensors.base import ObservingSensor
from simmer_tui.sim.sensors.world import World
from simmer_tui.sim.specs import SensorSpec


class RangeSensor(ObservingSensor):
    """A distance, inches, from `Rays` rays spread evenly over the field of view, edges included."""

    unit = "in"
    is_range = True
    columns: ClassVar[tuple[Column, ...]] = (
        *(columns.X, columns.Y, columns.Z, columns.ROTATION, columns.ERROR, columns.FIELD_OF_VIEW),
        *(columns.GAIN, columns.ABSOLUTE_ERROR, columns.BIAS, columns.DRIFT),
        *(columns.MIN_RANGE, columns.MAX_RANGE, columns.RESOLUTION, columns.RAYS, columns.WRAP),
    )

    def __init__(self, spec: SensorSpec) -> None:
        super().__init__(spec)
        half = spec.field_of_view / 2
        steps = np.linspace(-half, half, spec.rays) if spec.rays > 1 else np.zeros(1)
        self.bearings: list[float] = (steps + spec.rotation).tolist()
        """Directions of the rays in the robot's frame, degrees."""
        self._directions = [cos_sin(bearing) for bearing in self.bearings]

    @staticmethod
    def contradiction(spec: SensorSpec) -> tuple[tuple[Column, ...], str] | None:
        if spec.min_range <= spec.max_range:
            return None
        what = f"the least range, {spec.min_range:g}, must not be above the greatest, {spec.max_range:g}"
        return (columns.MIN_RANGE, columns.MAX_RANGE), what

    @abstractmethod
    def combined(self, distances: Sequence[float]) -> float:
        """The range that one fan of rays amounts to."""

    @abstractmethod
    def combined_many(self, fans: FloatArray) -> FloatArray:
        """The same for (n, rays) distances: (n,)."""

    def observe(self, world: World, pose: Pose) -> tuple[float, RangeScan]:
        """The true range, inches, and the rays it rests on."""
        spec = self.spec
        cos, sin = cos_sin(pose.heading)
        x = pose.x + cos * spec.x - sin * spec.y
        y = pose.y + sin * spec.x + cos * spec.y
        bearings = tuple([bearing + pose.heading for bearing in self.bearings])
        if world.maze.is_wall(x, y):
            return 0.0, RangeScan((x, y), bearings, (0.0,) * len(bearings))
        directions = [(cos * a - sin * b, sin * a + cos * b) for a, b in self._directions]
        distances = world.fan(x, y, directions, spec.z <= world.block.size)
        return self.combined(distances), RangeScan((x, y), bearings, tuple(distances))

    def ranges(self, world: World, poses: FloatArray) -> FloatArray:
        """The true ranges, (n,), at (n, 3) poses of x, y and heading."""
        cos, sin = cos_sin_array(poses[:, 2])
        x = poses[:, 0] + cos * self.spec.x - sin * self.spec.y
        y = poses[:, 1] + sin * self.spec.x + cos * self.spec.y
        count = len(self.bearings)
        origins = np.repeat(np.column_stack((x, y)), count, axis=0)
        bearings = (poses[:, 2:3] + np.array(self.bearings)).ravel()
        fans = world.rays(origins, bearings, self.spec.z <= world.block.size).reshape(-1, count)
        ranges = self.combined_many(fans)
        ranges[world.maze.are_walls(x, y)] = 0.0
        return ranges


class Ultrasonic(RangeSensor):
    """The shortest distance at which any of its rays meets something."""

    name = "ultra"
    meaning = "ultrasonic range"
    devices = ("Ultrasonic",)

    def combined(self, distances: Sequence[float]) -> float:
        return min(distances)

    def combined_many(self, fans: FloatArray) -> FloatArray:
        nearest: FloatArray = fans.min(axis=1)
        return nearest


class TimeOfFlight(RangeSensor):
    """The mean of its rays' distances."""

    name = "tof"
    meaning = "time-of-flight range"
    columns = tuple(
        replace(column, blank=47.0) if column is columns.MAX_RANGE else column
        for column in RangeSensor.columns
    )

    def combined(self, distances: Sequence[float]) -> float:
        return math.fsum(distances) / len(distances)

    def combined_many(self, fans: FloatArray) -> FloatArray:
        mean: FloatArray = fans.mean(axis=1)
        return mean
