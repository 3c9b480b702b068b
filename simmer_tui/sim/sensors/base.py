"""The base of all sensors: the errors added to a true value, and the two sources of that value.

A sensor either observes or counts. The true value of an observing one follows from the world and the robot's
pose; a counting one adds up movements. Each kind is one class, and one object of it works for one row of
sensors.csv.

Its observation model is for calibration: a kind lists the parameters and noise scales that may be estimated,
each with a prior. `ObservingSensor.linearised` and `CountingSensor.lever` give the expected reading and its
derivatives by pose and parameters.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from enum import StrEnum
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from simmer_tui.sim.angles import cos_sin, cos_sin_array
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.device_faults import faults_of
from simmer_tui.sim.maze import Maze, Rays
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import FloorPatch, RangeScan
from simmer_tui.sim.specs import SensorKind, SensorSpec
from simmer_tui.sim.trajectory import Trajectory


class World(Struct, frozen=True):
    """The world that a sensor can see: the maze and its block, which is `held` or lies in the maze."""

    maze: Maze
    block: Block
    held: bool = False

    def fan(
        self, x: float, y: float, directions: Sequence[tuple[float, float]], block_from: float
    ) -> list[float]:
        """Distances from (x, y), not on a wall, along unit vectors to a wall, or to the block where
        it is at least `block_from` away: 0 for rays low enough to meet it, infinite for those that
        pass above."""
        distances = self.maze.cast_fan(x, y, directions)
        if block_from < math.inf:
            cast = self.block.cast
            for index, (dx, dy) in enumerate(directions):
                if block_from <= (distance := cast(x, y, dx, dy)) < distances[index]:
                    distances[index] = distance
        return distances

    def fans(self, rays: Rays, block_from: float) -> FloatArray:
        """The same for many places at once: (n,) distances, 0 for rays that start on a wall."""
        distances = self.maze.cast_many(*rays)
        if block_from < math.inf:
            to_block = self.block.cast_many(*rays)
            return np.where((to_block >= block_from) & (to_block < distances), to_block, distances)
        return distances

    def rays(self, origins: FloatArray, bearings: FloatArray, block_from: float) -> FloatArray:
        """The same for (n, 2) origins and (n,) bearings in degrees."""
        x, y = np.ascontiguousarray(origins.T)
        return self.fans((x, y, *cos_sin_array(bearings)), block_from)

    def incidence(self, rays: Rays, distances: FloatArray, block_from: float) -> FloatArray:
        """Cosines of the angles between rays and the normals of the faces they end on, (n,), for rays
        and their `distances` as `fans` has them. At a corner the less oblique face counts."""
        cosines = self.maze.incidence(*rays, distances)
        if block_from < math.inf:
            to_block = self.block.cast_many(*rays)
            on_block = (to_block >= block_from) & (to_block == distances)
            cosines = np.where(on_block, self.block.incidence(*rays, to_block), cosines)
        return cosines


class ParameterKind(StrEnum):
    """Kind of a parameter; calibration is judged for each kind."""

    BIAS = "bias"
    GAIN = "gain"
    ANGLE = "angle"
    OFFSET = "offset"
    DRIFT = "drift"
    NOISE = "error"
    """The standard deviation of a random error; its intervals are by factors."""


class Prior(Struct, frozen=True):
    """A parameter that calibration may estimate, with its prior about the set's value."""

    field: str
    """The field of the row, or `OFFSET`."""
    label: str
    kind: ParameterKind
    spread: float
    """Prior standard deviation, in `unit`; for a gain a share of it, for a noise scale that of its
    logarithm."""
    unit: str = ""
    usual: float = 0.0
    """For a noise scale: the prior's centre where the set has 0, which has no logarithm."""
    step: float = 0.0
    """Difference over which the derivative of a reading is taken; 0 if readings are linear in it."""


OFFSET = "offset"
"""The parameter that is not a field: inches by which a sensor is mounted to the left of its place in the set,
seen in its own direction. An offset along its direction cannot be distinguished from its bias."""


def with_parameters(spec: SensorSpec, values: Mapping[str, float]) -> SensorSpec:
    """A row with these parameters; an offset is perpendicular to the sensor's direction after them."""
    offset = values.get(OFFSET, 0.0)
    made = replace(spec, **{field: value for field, value in values.items() if field != OFFSET})
    if offset:
        cos, sin = cos_sin(made.rotation)
        made = replace(made, x=spec.x - sin * offset, y=spec.y + cos * offset)
    return made


def parameter_value(spec: SensorSpec, field: str, place: tuple[float, float]) -> float:
    """A parameter that a row has. An offset is counted from `place`, x and y in inches."""
    if field != OFFSET:
        return float(getattr(spec, field))
    cos, sin = cos_sin(spec.rotation)
    # Adding 0 makes 0.0 of -0.0, which would be shown as "-0".
    return cos * (spec.y - place[1]) - sin * (spec.x - place[0]) + 0.0


class Linearisation(Struct, frozen=True):
    """A sensor's true values at n poses, before gain and bias, with their derivatives."""

    true: FloatArray
    """(n,)."""
    proportional: FloatArray
    """The value that the Percent Error multiplies, (n,)."""
    by_pose: FloatArray
    """Derivatives by x, y (inches) and heading (degrees), (3, n)."""
    curvature: FloatArray
    """Variance added for the error of the linear model at bends and jumps, (n,)."""
    by_parameter: dict[str, FloatArray] = field(default_factory=dict)
    """Derivatives by parameters that have a `step`, by field."""


_EDGE = 0.5
"""Bend of readings (half of their second difference), in their unit, above which there is an edge between the
places of the derivative. Along a wall or around a corner it is a tenth of that."""
_SURELY_OFF = 100.0
"""Factor on the variance at an edge: a standard deviation of ten times the bend. Readings at one edge are not
independent, since a robot that turns on the spot sees the same edge again and again."""
_Difference = TypeVar("_Difference", float, FloatArray)
View = RangeScan | FloorPatch
"""The geometry of a reading: rays, or a patch of floor."""


class Sensor(SensorKind):
    """A sensor in use. A kind sets the class variables of `SensorKind`."""

    spec_type: ClassVar[type[SensorSpec]] = SensorSpec
    missed: ClassVar[float] = 0.0
    """Value of a missed reading."""
    pings: ClassVar[bool] = False
    """True if it sends sound that other sensors can receive."""
    parameters: ClassVar[tuple[Prior, ...]] = ()
    """Parameters that calibration may estimate; a kind with none is reported as not identifiable."""
    noise_scales: ClassVar[tuple[Prior, ...]] = ()
    """Standard deviations of its random errors that calibration may estimate."""
    least_error: ClassVar[float] = 0.02
    """Standard deviation that calibration gives every reading, in its unit: a percent error vanishes at 0,
    and a reading with no error at all would outweigh all others."""

    fault: str = ""
    """The fault of a team's own counter, which its readings tell."""

    def __init__(self, spec: SensorSpec) -> None:
        self.spec = spec
        self.id = spec.id

    def reading(self, true: float, random: np.random.Generator | None, time: float) -> float:
        """A reading of a true value at a simulated time, with the sensor's errors in their order. Without
        `random` there is no random error."""
        spec = self.spec
        value = self.proportional(true, random) * spec.gain
        if random is not None and spec.absolute_error:
            value += spec.absolute_error * random.standard_normal()
        return self.reported(value + spec.bias + spec.drift * time)

    def proportional(self, true: float, random: np.random.Generator | None) -> float:
        """The value with its Percent Error: one draw a reading."""
        return true if random is None else true * (1.0 + self.spec.error * random.standard_normal())

    def reported(self, value: float) -> float:
        """A value as the sensor's electronics report it: wrapped, rounded, limited to its range. A wrapped
        value stays below `Wrap`, even if it is rounded up."""
        spec = self.spec
        if not math.isfinite(value):
            return value
        if spec.wrap:
            value %= spec.wrap
        if spec.resolution and math.isfinite(steps := value / spec.resolution):
            value = round(steps) * spec.resolution
        if spec.wrap and value >= spec.wrap:
            # By rounding: -1e-17 % 360.0 is 360.0.
            value = 0.0
        if spec.min_range and value < spec.min_range:
            return spec.min_range
        return math.inf if value > spec.max_range else value

    @property
    def looks_back(self) -> float:
        """Seconds for which the simulator keeps the robot's and the block's motion for its readings
        (`RecentMotion`); 0 if they need the present alone."""
        return 0.0

    @property
    def threshold(self) -> float:
        """Of a sensor that answers yes or no: the measured value from which it answers yes."""
        # Halfway between no and yes.
        return 0.5

    @property
    def tick(self) -> float:
        """Step of a count, in its unit; 0 for a count without steps."""
        return 0.0

    @property
    def random_walk(self) -> float:
        """Standard deviation of its random walk after one second, in its unit: it grows with the square root
        of time."""
        return 0.0

    @property
    def cross_talk(self) -> float:
        """Probability that it takes another sensor's sound, if that arrives first, for its own."""
        return 0.0

    def ideal(self, true: float) -> float:
        """The value without any error, before the sensor's electronics."""
        return true

    def anywhere(self, fraction: float) -> float:
        """An outlier: the value at this fraction (0 to 1) of the sensor's range."""
        return fraction

    def error(self, true: float, reply: float) -> float:
        """Error of a reply, in the sensor's unit: its difference from the errorless reading of a true value.
        Infinity if it saw something where nothing was in range, or the reverse."""
        expected = self.reported(self.ideal(true) * self.spec.gain)
        if expected == reply:
            return 0.0
        error = reply - expected
        if not math.isfinite(error):
            return math.inf
        wrap = self.spec.wrap
        return (error + wrap / 2) % wrap - wrap / 2 if wrap else error

    # -- for calibration --------------------------------------------------------------------------

    @property
    def period(self) -> float:
        """Period of the readings: those that differ by it are the same; 0 if there is none. That of a heading
        is a whole turn: headings of a log may differ by whole turns from the robot's count."""
        return self.spec.wrap or (360.0 if self.is_heading else 0.0)

    def wrapped(self, difference: _Difference) -> _Difference:
        """A difference of readings, with whole periods taken off."""
        period = self.period
        return (difference + period / 2) % period - period / 2 if period else difference

    def worst_case(self) -> SensorSpec:
        """The row with errors wide enough for any robot, for the start of a guided session."""
        # 10 % is more than gains of wheels and gyros of a course's robots differ by.
        return replace(self.spec, error=max(self.spec.error, 0.1))

    def variances(self, proportional: FloatArray) -> tuple[FloatArray, float, float]:
        """Variances of readings around their expected values, to be added: by the Percent Error of
        `proportional` values, (n,), by the Absolute Error, and by rounding and the least error."""
        spec = self.spec
        return (
            (spec.gain * spec.error * proportional) ** 2,
            spec.absolute_error**2,
            self.least_error**2 + spec.resolution**2 / 12.0,
        )


class ObservingSensor(Sensor, ABC):
    """A sensor whose true value follows from the world and the robot's pose."""

    steps: ClassVar[tuple[float, float, float]] = (0.12, 0.12, 0.6)
    """Differences in x, y (inches) and heading (degrees) over which derivatives are taken: about the
    uncertainty of poses while calibration converges. Smaller ones read a corner's edge as a slope."""
    annealing: ClassVar[float] = 1.0
    """Readings' uncertainty, in the sensor's unit, for an inch of uncertainty of the pose while calibration
    converges."""

    @abstractmethod
    def observe(self, world: World, pose: Pose) -> tuple[float, View | None]:
        """The reading of a perfect sensor in `world` with the robot at `pose`, and the geometry of that
        reading, if there is any."""

    def steady_distance(self, pose: Pose) -> float:
        """Inches that the sensor may move from its place at `pose` without another true value; 0 if that is
        not known."""
        return 0.0

    def true_values(self, world: World, poses: FloatArray) -> FloatArray:
        """True values, (n,), at (n, 3) poses of x, y and heading."""
        with faults_of(self):
            return np.array([float(self.observe(world, Pose(*pose))[0]) for pose in poses.tolist()])

    def expected(self, world: World, poses: FloatArray, time: float) -> FloatArray:
        """Readings without random errors, (n,), at (n, 3) poses."""
        spec = self.spec
        return spec.gain * self.true_values(world, poses) + spec.bias + spec.drift * time

    def linearised(self, world: World, poses: FloatArray) -> Linearisation:
        """True values at (n, 3) poses and their derivatives, by central differences."""
        offsets = np.diag(self.steps)
        shifts = np.concatenate((np.zeros((1, 3)), offsets, -offsets))
        # All in one call, because the calls take the time.
        around = np.concatenate(poses + shifts[:, None, :])
        middle, *sides = self.true_values(world, around).reshape(len(shifts), len(poses))
        slopes = [(sides[k] - sides[k + 3]) / (2 * self.steps[k]) for k in range(3)]
        # Half of the second difference is the error of the tangent one step away.
        bends = np.array([0.5 * (sides[k] + sides[k + 3] - 2 * middle) for k in range(3)])
        by_parameter = {}
        for prior in self.parameters:
            if prior.field == OFFSET:
                # The whole robot is moved as far to the sensor's left, so that an edge is as uncertain for
                # the offset as for the pose.
                cos, sin = cos_sin_array(poses[:, 2] + self.spec.rotation)
                by_parameter[OFFSET] = cos * slopes[1] - sin * slopes[0]
            elif prior.step:
                value = parameter_value(self.spec, prior.field, (self.spec.x, self.spec.y))
                above, below = (
                    self._with(prior.field, value + sign * prior.step).true_values(world, poses)
                    for sign in (1.0, -1.0)
                )
                by_parameter[prior.field] = (above - below) / (2 * prior.step)
        curvature = np.square(bends).sum(axis=0)
        curvature = np.where(curvature > _EDGE**2, _SURELY_OFF * curvature, curvature)
        return Linearisation(middle, middle, np.array(slopes), curvature, by_parameter)

    def _with(self, field: str, value: float) -> ObservingSensor:
        return type(self)(with_parameters(self.spec, {field: value}))

    def within_limits(self, expected: FloatArray, margin: FloatArray) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """True where readings up to `margin` off the expected ones are within the sensor's limits, (n,)."""
        return np.ones(len(expected), bool)

    def sees_block(self, size: float) -> bool:
        """True if a reading depends on where a block of a size lies."""
        return False

    @property
    def span(self) -> float:
        """Width of the interval that outliers are drawn from."""
        return abs(self.anywhere(1.0) - self.anywhere(0.0)) or 1.0

    def model_error(self, expected: FloatArray, poses: FloatArray) -> FloatArray:
        """Standard deviations of readings in a search for a pose, (n,); 0.1 is for the grid of the search, in
        the sensor's unit."""
        return np.hypot(self.spec.error * np.abs(expected), self.spec.absolute_error + 0.1)

    def rough_likelihood(self, reading: float, expected: FloatArray) -> FloatArray:
        """Likelihoods, up to a factor, of a reading before gain, bias and mounting are known, (n,)."""
        # Gains differ by some 6 %. Biases, and the effect of a few degrees of mounting, are 0.7 in. One
        # reading in twelve may fit no model (an edge, a dropout, an outlier), and is then uniform within 4 m.
        spread = 0.06 * np.abs(expected) + 0.7
        away = self.wrapped(reading - expected) / spread
        return 0.92 * np.exp(-0.5 * away**2) / (2.5066 * spread) + 0.08 / 157.0


class CountingSensor(Sensor, ABC):
    """A sensor that adds up movements; its Percent Error applies to each increment."""

    counts = True
    slips: ClassVar[bool]
    """True if it still counts while a wall blocks the robot. It then has increments for the turn and for the
    translation of each segment, (n, 2); else for the turn alone, (n,)."""
    # Wheels wear and are measured with a ruler: a prior of 15 %. Noise scales are known to a factor of
    # exp(1.2), about 3.
    parameters: ClassVar[tuple[Prior, ...]] = (Prior("gain", "gain", ParameterKind.GAIN, 0.15),)
    noise_scales: ClassVar[tuple[Prior, ...]] = (
        Prior("error", "percent error", ParameterKind.NOISE, 1.2, usual=0.02),
    )
    least_error = 0.002

    def increments(self, turn: float, move: tuple[float, float], draws: FloatArray) -> FloatArray:
        """The increment of each segment, which turns by `turn` degrees and then moves by `move` in the
        robot's frame. `draws` are normal draws, of the shape of the result."""
        turning = self.counted_on(turn, 0.0, 0.0)
        exact = np.array((turning, self.counted_on(0.0, *move))) if self.slips else turning
        return exact * (1.0 + self.spec.error * draws)

    def counted(self, trajectory: Trajectory, time: float) -> float:
        """Count that a movement has added by a simulated time."""
        return (trajectory.rolled if self.slips else trajectory.turned)(self.id, time)

    @abstractmethod
    def counted_on(self, turned: float, ahead: float, aside: float) -> float:
        """Count without error where the robot turns by `turned` degrees and goes, in its own frame, `ahead`
        and `aside` (to the left) inches. It must be linear in them, for `lever`."""

    @cached_property
    def lever(self) -> FloatArray:
        """Count for an inch ahead, an inch to the left and a degree turned, (3,)."""
        return np.array([self.counted_on(0, 1, 0), self.counted_on(0, 0, 1), self.counted_on(1, 0, 0)])

    def change(self, begin: tuple[float, float], end: tuple[float, float]) -> float:
        """Count between two readings, each a value and its time, without the drift."""
        return float(self.wrapped(end[0] - begin[0] - self.spec.drift * (end[1] - begin[1])))

    def proportional(self, true: float, random: np.random.Generator | None) -> float:
        """The value alone: its Percent Error is in it already."""
        return self.ideal(true)


def modelled_sensor(spec: SensorSpec) -> Sensor:
    """The sensor of a row for analyses of a run; for an opaque kind, one that neither observes nor counts.
    Raises TypeError if its kind is no class of `Sensor`."""
    return Sensor(spec) if spec.kind.is_opaque else sensor_of(spec)


def sensor_of(spec: SensorSpec) -> Sensor:
    """A new sensor for a row. Raises TypeError if its kind is no class of `Sensor`."""
    kind = spec.kind
    if not issubclass(kind, Sensor):
        raise TypeError(f"{kind.__name__} says what a sensor is, but not how it works")
    if not isinstance(spec, kind.spec_type):
        raise TypeError(
            f"a row of {kind.__name__} is a {kind.spec_type.__name__}, not a {type(spec).__name__}"
        )
    return kind(spec)
