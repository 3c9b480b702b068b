"""Sensors of the robot's own motion: wheel encoders and the gyro, which add it up, and the compass."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from msgspec.structs import replace

from simmer_tui.sim import columns
from simmer_tui.sim.angles import cos_sin
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors.base import (
    CountingSensor,
    Linearisation,
    ObservingSensor,
    ParameterKind,
    Prior,
    World,
)
from simmer_tui.sim.specs import SensorSpec


class OdometerSpec(SensorSpec, frozen=True, kw_only=True):
    """One row of sensors.csv for a wheel encoder."""

    ticks_per_inch: float = 0.0
    """Ticks to which readings are rounded; 0 means that they are not."""


class Odometer(CountingSensor):
    """A wheel encoder, inches. With q its place and v its rolling direction (robot's frame), turning
    by a degrees rolls 2 pi (q x v) a / 360, translating by t rolls t . v."""

    name = "odom"
    short_name = "odometer"
    spec_type = OdometerSpec
    spec: OdometerSpec
    meaning = "wheel encoder"
    unit = "in"
    slips = True
    devices = ("MotorSimple",)
    columns = (
        *(columns.X, columns.Y, columns.ROTATION, columns.ERROR),
        *(*columns.ELECTRONICS, columns.READ_TIME, columns.TICKS),
    )

    @property
    def tick(self) -> float:
        ticks = self.spec.ticks_per_inch
        return 1.0 / ticks if ticks else 0.0

    def ideal(self, true: float) -> float:
        """Whole ticks, if it counts ticks: a new one at each edge that passes."""
        ticks = self.spec.ticks_per_inch
        # Rounded down, not to the nearest: an edge counts when it has passed.
        return math.floor(true * ticks) / ticks if ticks else true

    def counted_on(self, turned: float, ahead: float, aside: float) -> float:
        cos, sin, around = self._wheel
        return around * turned / 360.0 + (ahead * cos + aside * sin)

    @cached_property
    def _wheel(self) -> tuple[float, float, float]:
        """The rolling direction v, and the inches that a whole turn of the robot rolls, by the lever q x
        v."""
        spec = self.spec
        cos, sin = cos_sin(spec.rotation)
        return cos, sin, 2.0 * math.pi * (spec.x * sin - spec.y * cos)


class GyroSpec(SensorSpec, frozen=True, kw_only=True):
    """One row of sensors.csv for a gyro."""

    random_walk: float = 0.0
    """Degrees in a second, growing with the square root of time."""


class Gyro(CountingSensor):
    """The angle turned, degrees: only what was really turned."""

    name = "gyro"
    short_name = "gyro"
    spec_type = GyroSpec
    spec: GyroSpec
    meaning = "angle turned"
    unit = "deg"
    slips = False
    devices = ("Gyroscope",)
    columns = (columns.ERROR, *columns.ELECTRONICS, columns.READ_TIME, columns.RANDOM_WALK)
    # An MPU-6050's sensitivity is within 3 %, its rate at rest within 20 deg/s before and some tenths after
    # its offset is taken off (InvenSense, revision 3.4); priors are wider by a factor of 2 to 3.
    parameters = (
        Prior("gain", "gain", ParameterKind.GAIN, 0.1),
        Prior("drift", "drift", ParameterKind.DRIFT, 0.5, "deg/s"),
    )
    noise_scales = (
        Prior("error", "percent error", ParameterKind.NOISE, 1.2, usual=0.01),
        Prior("random_walk", "random walk", ParameterKind.NOISE, 1.5, "deg/sqrt s", usual=0.01),
    )
    least_error = 0.003

    @property
    def random_walk(self) -> float:
        return self.spec.random_walk

    def counted_on(self, turned: float, ahead: float, aside: float) -> float:
        return turned


class CompassSpec(SensorSpec, frozen=True, kw_only=True):
    """One row of sensors.csv for a compass."""

    hard_iron: float = 0.0
    soft_iron: float = 0.0
    """Greatest deviations by iron, degrees: once, and twice, a turn."""


class Compass(ObservingSensor):
    """The robot's heading and the sensor's own rotation, degrees, not wrapped."""

    name = "comp"
    short_name = "compass"
    spec_type = CompassSpec
    spec: CompassSpec
    meaning = "compass heading"
    unit = "deg"
    is_heading = True
    devices = ("Compass",)
    columns = (
        *(columns.ROTATION, columns.ERROR, *columns.ELECTRONICS),
        *(columns.READ_TIME, columns.DROPOUT, columns.OUTLIER, columns.HARD_IRON, columns.SOFT_IRON),
    )
    # Judged: sets are aligned with north by eye, and iron in a building turns it by tens of degrees.
    parameters = (Prior("bias", "bias", ParameterKind.BIAS, 30.0, "deg"),)
    noise_scales = (
        Prior("absolute_error", "absolute error", ParameterKind.NOISE, 1.5, "deg", usual=2.0),
        Prior("error", "percent error", ParameterKind.NOISE, 1.5, usual=0.01),
    )
    least_error = 0.05
    # Degrees for an inch: the angle of an inch at a distance of one foot.
    annealing = 5.0

    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        return pose.heading + self.spec.rotation, None

    def proportional(self, true: float, random: np.random.Generator | None) -> float:
        """The value with its deviation by iron. Magnetic iron turns with the robot: its error has one period
        a turn. Iron that only bends the earth's field has two."""
        value = super().proportional(true, random)
        spec = self.spec
        if spec.hard_iron or spec.soft_iron:
            value += spec.hard_iron * cos_sin(true)[1] + spec.soft_iron * cos_sin(2.0 * true)[1]
        return value

    def anywhere(self, fraction: float) -> float:
        """A reading at a fraction (0 to 1) of a turn, degrees."""
        return self.reported(fraction * (self.spec.wrap or 360.0))

    # -- for calibration --------------------------------------------------------------------------

    @property
    def span(self) -> float:
        """A whole turn, degrees."""
        return 360.0

    def true_values(self, world: World, poses: FloatArray) -> FloatArray:
        """Headings with the deviation by iron, (n,), at (n, 3) poses."""
        return self.linearised(world, poses).true

    def linearised(self, world: World, poses: FloatArray) -> Linearisation:
        hard, soft = self.spec.hard_iron, self.spec.soft_iron
        true: FloatArray = poses[:, 2] + self.spec.rotation
        radians = np.radians(true)
        iron = hard * np.sin(radians) + soft * np.sin(2 * radians)
        by_pose = np.zeros((3, len(poses)))
        by_pose[2] = 1.0 + np.pi / 180 * (hard * np.cos(radians) + 2 * soft * np.cos(2 * radians))
        return Linearisation(true + iron, true, by_pose, np.zeros(len(poses)))

    def model_error(self, expected: FloatArray, poses: FloatArray) -> FloatArray:
        # At least a degree: a search's grid of headings is no finer.
        return np.hypot(max(self.spec.absolute_error, 1.0), self.spec.error * np.abs(poses[:, 2]))

    def rough_likelihood(self, reading: float, expected: FloatArray) -> FloatArray:
        # 20 degrees, for a bias not yet known, and iron. One reading in ten may have any value.
        away = self.wrapped(reading - expected)
        return 0.9 * np.exp(-0.5 * (away / 20.0) ** 2) + 0.1

    def worst_case(self) -> SensorSpec:
        # Half of its bias' prior: it must correct a lost heading, not fix a known one.
        return replace(self.spec, error=0.0, absolute_error=15.0)
