"""The sensors: what each would say without error, and the errors laid over it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simmer_tui.sim.angles import FloatArray, cos_sin, cos_sin_array
from simmer_tui.sim.block import Block
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import FloorPatch, RangeScan
from simmer_tui.sim.specs import SensorKind, SensorSpec


@dataclass(frozen=True, slots=True)
class World:
    """What a sensor can see: the maze and the block in it."""

    maze: Maze
    block: Block

    def fan(self, x: float, y: float, directions: Sequence[tuple[float, float]], low: bool) -> list[float]:
        """Distances from (x, y), not on a wall, along unit vectors to a wall, or to the block where
        the rays are `low` enough."""
        distances = self.maze.cast_fan(x, y, directions)
        if low:
            cast = self.block.cast
            distances = [min(far, cast(x, y, *way)) for far, way in zip(distances, directions, strict=True)]
        return distances

    def rays(self, origins: FloatArray, bearings: FloatArray, low: bool) -> FloatArray:
        """The same for (n, 2) origins and (n,) bearings in degrees, all at once: (n,) distances, 0
        from a wall."""
        x, y = np.ascontiguousarray(origins.T)
        dx, dy = cos_sin_array(bearings)
        distances = self.maze.cast_many(x, y, dx, dy)
        return np.minimum(distances, self.block.cast_many(x, y, dx, dy)) if low else distances


class RangeSensor:
    """An ultrasonic (`ultra`) or time-of-flight (`tof`) sensor."""

    def __init__(self, spec: SensorSpec) -> None:
        self.spec = spec
        self._mean = spec.kind is SensorKind.TOF
        half = spec.field_of_view / 2
        steps = np.linspace(-half, half, spec.rays) if spec.rays > 1 else np.zeros(1)
        self.bearings = (steps + spec.rotation).tolist()
        """Directions of the rays in the robot's frame, degrees."""
        self._directions = [cos_sin(bearing) for bearing in self.bearings]

    def observe(self, around: World, pose: Pose) -> tuple[float, RangeScan]:
        """The true range, inches, and the rays it rests on."""
        spec = self.spec
        cos, sin = cos_sin(pose.heading)
        x = pose.x + cos * spec.x - sin * spec.y
        y = pose.y + sin * spec.x + cos * spec.y
        bearings = tuple([bearing + pose.heading for bearing in self.bearings])
        if around.maze.is_wall(x, y):
            return 0.0, RangeScan((x, y), bearings, (0.0,) * len(bearings))
        directions = [(cos * a - sin * b, sin * a + cos * b) for a, b in self._directions]
        distances = around.fan(x, y, directions, spec.z <= around.block.size)
        true = math.fsum(distances) / len(distances) if self._mean else min(distances)
        return true, RangeScan((x, y), bearings, tuple(distances))

    def ranges(self, around: World, poses: FloatArray) -> FloatArray:
        """The true ranges, (n,), at (n, 3) poses of x, y and heading."""
        cos, sin = cos_sin_array(poses[:, 2])
        x = poses[:, 0] + cos * self.spec.x - sin * self.spec.y
        y = poses[:, 1] + sin * self.spec.x + cos * self.spec.y
        count = len(self.bearings)
        origins = np.repeat(np.column_stack((x, y)), count, axis=0)
        bearings = (poses[:, 2:3] + np.array(self.bearings)).ravel()
        fan = around.rays(origins, bearings, self.spec.z <= around.block.size).reshape(-1, count)
        ranges: FloatArray = fan.mean(axis=1) if self._mean else fan.min(axis=1)
        ranges[around.maze.are_walls(x, y)] = 0.0
        return ranges


TEST_POINTS = np.array(
    [(i, j) for i in range(-6, 7) for j in range(-6, 7) if i * i + j * j <= 36], dtype=np.float64
)
"""Where on its disc a line sensor looks, (113, 2), in sixths of the radius."""


class LineSensor:
    """A downward infrared sensor (`ir`): a disc of 113 test points on the floor, aligned with the
    global axes."""

    def __init__(self, spec: SensorSpec) -> None:
        self.spec = spec
        self.radius = spec.z * math.tan(math.radians(spec.field_of_view / 2))
        self._offsets = TEST_POINTS * self.radius / 6.0

    def observe(self, around: World, pose: Pose) -> tuple[float, FloorPatch]:
        """The fraction of test points of the colour it detects, and the points."""
        spec = self.spec
        cos, sin = cos_sin(pose.heading)
        centre = (pose.x + cos * spec.x - sin * spec.y, pose.y + sin * spec.x + cos * spec.y)
        points = self._offsets + centre
        black = around.maze.black(points)
        fraction = int(np.count_nonzero(black)) / len(points)
        if spec.detects_white:
            fraction = 1.0 - fraction
        return fraction, FloorPatch(centre, self.radius, points, black)


def rolling_increments(
    spec: SensorSpec, turn: float, move: tuple[float, float], draws: FloatArray
) -> FloatArray:
    """What an odometer counts, inches, for each segment's turn and translation: (n, 2).

    Each segment turns by `turn` degrees and moves by `move` in the robot's frame; `draws` are (n, 2)
    normal draws. With q the place and v the rolling direction, turning by a degrees
    rolls 2 pi (q x v) a / 360, translating by t rolls t . v.
    """
    cos, sin = cos_sin(spec.rotation)
    turned = 2.0 * math.pi * (spec.x * sin - spec.y * cos) * turn / 360.0
    straight = move[0] * cos + move[1] * sin
    return np.array((turned, straight)) * (1.0 + spec.error * draws)


def with_errors(spec: SensorSpec, true: float, random: np.random.Generator | None, time: float) -> float:
    """A reading: the true value with the sensor's errors, in the order the sensor applies them.

    Odometers and gyros have their Percent Error in `true` already; that of a load sensor is how
    often it says the opposite. Without `random` there is no random error.
    """
    if spec.kind is SensorKind.LOAD:
        wrong = random is not None and random.random() < spec.error
        return 1.0 - true if wrong else true
    value = true
    if random is not None and spec.kind not in (SensorKind.ODOM, SensorKind.GYRO):
        value *= 1.0 + spec.error * random.standard_normal()
    value *= spec.gain
    if random is not None and spec.absolute_error:
        value += spec.absolute_error * random.standard_normal()
    return as_read(spec, value + spec.bias + spec.drift * time)


def as_read(spec: SensorSpec, value: float) -> float:
    """A value as the sensor's electronics report it: wrapped, rounded, limited, or as 0 or 1."""
    if spec.kind is SensorKind.IR:
        return 1.0 if min(max(value, 0.0), 1.0) >= spec.threshold else 0.0
    if not math.isfinite(value):
        return value
    if spec.wrap:
        value %= spec.wrap
    if spec.resolution:
        value = round(value / spec.resolution) * spec.resolution
    if spec.min_range and value < spec.min_range:
        return spec.min_range
    return math.inf if value > spec.max_range else value
