"""Sensors that measure a distance with a fan of rays: ultrasonic and time of flight."""

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from msgspec.structs import replace

from simmer_tui.sim import columns
from simmer_tui.sim.angles import cos_sin, cos_sin_array
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.command import counted
from simmer_tui.sim.maze import Rays
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import RangeScan
from simmer_tui.sim.sensors.base import OFFSET, ObservingSensor, ParameterKind, Prior, World
from simmer_tui.sim.specs import SensorSpec

USUAL_RANGE = 157.5
"""Greatest outlier of a sensor without Max Range, inches: 4 m, as an HC-SR04 has it (Elecfreaks)."""

MOUNTED = 0.5
"""Prior standard deviation of a sensor's place, inches: people mount it by eye and with a ruler."""


class RangeSpec(SensorSpec, frozen=True, kw_only=True):
    """One row of sensors.csv for a sensor that measures a distance. Limits of 0 mean none."""

    field_of_view: float = 0.0
    """Degrees from edge to edge."""
    rays: int = 5
    vertical_field_of_view: float = 0.0
    """Degrees from edge to edge; 0 for a sensor that sees a block by height alone."""
    incidence_limit: float = 0.0
    """Degrees from a wall's normal beyond which a ray has no echo."""

    @property
    def beam(self) -> float | None:
        return self.field_of_view

    @property
    def view_words(self) -> tuple[str, ...]:
        return f"{self.field_of_view:g} deg wide", counted(self.rays, "ray")


class UltrasonicSpec(RangeSpec, frozen=True, kw_only=True):
    """One row of sensors.csv for an ultrasonic sensor."""

    cross_talk: float = 0.0
    """Probability that another sensor's sound, if it arrives first, is read as its own echo."""


class RangeSensor(ObservingSensor):
    """A distance, inches, from `Rays` rays spread evenly over the field of view, edges included."""

    unit = "in"
    is_range = True
    spec_type: ClassVar[type[RangeSpec]] = RangeSpec
    spec: RangeSpec
    missed = math.inf
    columns: ClassVar[tuple[CsvColumn, ...]] = (
        *(columns.X, columns.Y, columns.Z, columns.ROTATION, columns.ERROR, columns.FIELD_OF_VIEW),
        *(columns.GAIN, columns.ABSOLUTE_ERROR, columns.BIAS, columns.DRIFT),
        *(columns.MIN_RANGE, columns.MAX_RANGE, columns.RESOLUTION, columns.RAYS, columns.WRAP),
        *(columns.VERTICAL_FOV, columns.READ_TIME, columns.DROPOUT, columns.OUTLIER),
        columns.INCIDENCE_LIMIT,
    )
    # Wider than the differences of parts in the profiles' data sheets (gains 3 %, offsets 0.5 in) and of
    # people's mounting (a few degrees, half an inch). Derivatives by the mounting use the same steps as those
    # by the pose.
    parameters: ClassVar[tuple[Prior, ...]] = (
        Prior("gain", "gain", ParameterKind.GAIN, 0.1),
        Prior("bias", "bias", ParameterKind.BIAS, 1.5, "in"),
        Prior("rotation", "mounting angle", ParameterKind.ANGLE, 8.0, "deg", step=0.6),
        Prior(OFFSET, "mounting offset", ParameterKind.OFFSET, MOUNTED, "in"),
    )
    # Known to a factor of exp(1.2), about 3, or exp(1.5), about 4.5; if a set has none, those of an HC-SR04.
    noise_scales: ClassVar[tuple[Prior, ...]] = (
        Prior("error", "percent error", ParameterKind.NOISE, 1.2, usual=0.02),
        Prior("absolute_error", "absolute error", ParameterKind.NOISE, 1.5, "in", usual=0.1),
    )

    def __init__(self, spec: RangeSpec) -> None:
        super().__init__(spec)
        self.bearings: list[float] = (self.fan() + spec.rotation).tolist()
        """Directions of the rays in the robot's frame, degrees."""
        self._directions = [cos_sin(bearing) for bearing in self.bearings]
        half = spec.vertical_field_of_view / 2
        self._slope = math.tan(math.radians(half)) if half else 0.0
        """Slope of the lower edge of its view, inches an inch ahead."""
        limit = spec.incidence_limit
        self.least_cosine = math.cos(math.radians(limit)) if limit else 0.0
        """Of the angle between a ray and a face's normal, for an echo; 0 if there always is one."""
        self.loses_echoes = bool(limit)
        """True if `echoes` may change the distances of rays; only then it is called."""

    def fan(self) -> FloatArray:
        """Directions of the rays of one reading, degrees from the sensor's direction."""
        half = self.spec.field_of_view / 2
        # linspace(-h, h, 1) is -h, but a single ray points straight ahead.
        return np.linspace(-half, half, self.spec.rays) if self.spec.rays > 1 else np.zeros(1)

    @staticmethod
    def contradiction(spec: SensorSpec) -> tuple[tuple[CsvColumn, ...], str] | None:
        if spec.min_range <= spec.max_range:
            return None
        what = f"the least range, {spec.min_range:g}, must not be above the greatest, {spec.max_range:g}"
        return (columns.MIN_RANGE, columns.MAX_RANGE), what

    @abstractmethod
    def combined(self, distances: Sequence[float]) -> float:
        """The range of one fan of rays, inches."""

    @abstractmethod
    def combined_many(self, fans: FloatArray) -> FloatArray:
        """The same for (n, rays) distances: (n,)."""

    def observe(self, world: World, pose: Pose) -> tuple[float, RangeScan]:
        """The true range, inches, and its rays."""
        spec = self.spec
        cos, sin = cos_sin(pose.heading)
        x = pose.x + cos * spec.x - sin * spec.y
        y = pose.y + sin * spec.x + cos * spec.y
        bearings = tuple([bearing + pose.heading for bearing in self.bearings])
        # Rays of a sensor in a wall have length 0.
        if world.maze.is_wall(x, y):
            return 0.0, RangeScan((x, y), bearings, (0.0,) * len(bearings))
        directions = [(cos * a - sin * b, sin * a + cos * b) for a, b in self._directions]
        block_from = self.block_from(world.block.size)
        distances = world.fan(x, y, directions, block_from)
        if self.loses_echoes:
            dx, dy = np.array(directions).T
            rays = np.full(len(dx), x), np.full(len(dx), y), dx, dy
            distances = self.echoes(world, rays, np.array(distances), block_from).tolist()
        return self.combined(distances), RangeScan((x, y), bearings, tuple(distances))

    def true_values(self, world: World, poses: FloatArray) -> FloatArray:
        """The true ranges, (n,), at (n, 3) poses of x, y and heading; those of `observe`, bit for bit."""
        cos, sin = cos_sin_array(poses[:, 2])
        x = poses[:, 0] + cos * self.spec.x - sin * self.spec.y
        y = poses[:, 1] + sin * self.spec.x + cos * self.spec.y
        ranges = np.zeros(len(poses))
        free = np.flatnonzero(~world.maze.are_walls(x, y))
        cos, sin = cos[free, None], sin[free, None]
        a, b = np.array(self._directions).T
        count = len(a)
        block_from = self.block_from(world.block.size)
        rays = (
            *(np.repeat(x[free], count), np.repeat(y[free], count)),
            *((cos * a - sin * b).ravel(), (sin * a + cos * b).ravel()),
        )
        fans = world.fans(rays, block_from)
        if self.loses_echoes:
            fans = self.echoes(world, rays, fans, block_from)
        ranges[free] = self.combined_many(fans.reshape(len(free), count))
        return ranges

    def sees_block(self, size: float) -> bool:
        return math.isfinite(self.block_from(size))

    def within_limits(self, expected: FloatArray, margin: FloatArray) -> np.ndarray[Any, np.dtype[np.bool_]]:
        spec = self.spec
        near: np.ndarray[Any, np.dtype[np.bool_]] = expected - margin > max(spec.min_range, 0.0)
        return near & (expected + margin < spec.max_range)

    @property
    def span(self) -> float:
        """Greatest range, inches; a usual one where the sensor has no limit."""
        return self.spec.max_range if math.isfinite(self.spec.max_range) else USUAL_RANGE

    def worst_case(self) -> SensorSpec:
        # The spread of its priors: gains 5 %, biases half an inch.
        return replace(self.spec, error=math.hypot(self.spec.error, 0.05), absolute_error=0.6)

    def block_from(self, size: float) -> float:
        """Distance from which a block of a size is seen, inches: 0 if the sensor is no higher;
        infinite if it is, or there is none. A vertical field of view opens downwards from the
        sensor: at a distance d it reaches down by d tan(fov / 2)."""
        if not size:
            return math.inf
        above = self.spec.z - size
        if above <= 0.0:
            return 0.0
        return above / self._slope if self._slope else math.inf

    def echoes(self, world: World, rays: Rays, distances: FloatArray, block_from: float) -> FloatArray:
        """The distances of rays as their echoes have them, for all ranges, of a lidar and in analyses too:
        infinite where a ray meets a face too obliquely."""
        cosines = world.incidence(rays, distances, block_from)
        return np.where(cosines >= self.least_cosine, distances, math.inf)

    def anywhere(self, fraction: float) -> float:
        """A reading at a fraction (0 to 1) of the sensor's range, inches."""
        spec = self.spec
        return self.reported(spec.min_range + fraction * (self.span - spec.min_range))

    def reported(self, value: float) -> float:
        """No distance is below 0, and without an echo it is infinite, whatever the errors."""
        reported = super().reported(value)
        if reported > 0.0:
            return reported
        return 0.0 if math.isfinite(value) else math.inf


class Ultrasonic(RangeSensor):
    """The shortest distance at which any of its rays meets something."""

    name = "ultra"
    short_name = "ultrasonic"
    meaning = "ultrasonic range"
    spec_type = UltrasonicSpec
    spec: UltrasonicSpec
    devices = ("Ultrasonic",)
    pings = True
    columns = (*RangeSensor.columns, columns.CROSS_TALK)

    @property
    def cross_talk(self) -> float:
        return self.spec.cross_talk

    def combined(self, distances: Sequence[float]) -> float:
        """The shortest distance, inches."""
        return min(distances)

    def combined_many(self, fans: FloatArray) -> FloatArray:
        nearest: FloatArray = fans.min(axis=1)
        return nearest


class TimeOfFlight(RangeSensor):
    """The mean of its rays' distances."""

    name = "tof"
    short_name = "time of flight"
    meaning = "time-of-flight range"
    columns = tuple(
        replace(column, default=47.0) if column is columns.MAX_RANGE else column
        for column in RangeSensor.columns
    )

    def combined(self, distances: Sequence[float]) -> float:
        """The mean distance, inches."""
        if self.loses_echoes:
            # The mean of the echoes only.
            distances = [each for each in distances if math.isfinite(each)]
            if not distances:
                return math.inf
        return math.fsum(distances) / len(distances)

    def combined_many(self, fans: FloatArray) -> FloatArray:
        # Summed exactly, as in `combined`: numpy's sum depends on the grouping of its terms.
        return np.array([self.combined(fan) for fan in fans.tolist()])
