"""The compass."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from simmer_tui.sim import columns
from simmer_tui.sim.angles import FloatArray, cos_sin
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors.base import ObservingSensor
from simmer_tui.sim.sensors.observation import Linearisation, Prior, Sort
from simmer_tui.sim.sensors.world import World
from simmer_tui.sim.specs import SensorSpec


class Compass(ObservingSensor):
    """The robot's heading and the sensor's own rotation, degrees, not wrapped."""

    name = "comp"
    meaning = "compass heading"
    unit = "deg"
    devices = ("Compass",)
    columns = (
        *(columns.ROTATION, columns.ERROR, *columns.ELECTRONICS),
        *(columns.READ_TIME, columns.DROPOUT, columns.OUTLIER, columns.HARD_IRON, columns.SOFT_IRON),
    )
    # Judged: sets are aligned with north by eye, and iron in a building turns it by tens of degrees.
    parameters = (Prior("bias", "bias", Sort.BIAS, 30.0, "deg"),)
    noise_scales = (
        Prior("absolute_error", "absolute error", Sort.NOISE, 1.5, "deg", usual=2.0),
        Prior("error", "percent error", Sort.NOISE, 1.5, usual=0.01),
    )
    least_error = 0.05
    annealing = 5.0  # degrees: an inch beside a wall one foot away

    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        return pose.heading + self.spec.rotation, None

    def proportional(self, true: float, random: np.random.Generator | None) -> float:
        """With the deviation by iron around it: that which is magnetic itself turns with the robot
        and errs once a turn, that which only bends the earth's field twice a turn."""
        value = super().proportional(true, random)
        spec = self.spec
        if spec.hard_iron or spec.soft_iron:
            value += spec.hard_iron * cos_sin(true)[1] + spec.soft_iron * cos_sin(2.0 * true)[1]
        return value

    def anywhere(self, fraction: float) -> float:
        return self.reported(fraction * (self.spec.wrap or 360.0))

    # -- for calibration --------------------------------------------------------------------------

    @property
    def period(self) -> float:
        """A whole turn: headings of a log may be whole turns off what the robot counts."""
        return self.spec.wrap or 360.0

    @property
    def span(self) -> float:
        return 360.0

    def true_values(self, world: World, poses: FloatArray) -> FloatArray:
        """Headings with the deviation by iron, (n,), at (n, 3) poses."""
        true: FloatArray = poses[:, 2] + self.spec.rotation
        radians = np.radians(true)
        iron: FloatArray = self.spec.hard_iron * np.sin(radians) + self.spec.soft_iron * np.sin(2 * radians)
        return true + iron

    def linearised(self, world: World, poses: FloatArray) -> Linearisation:
        true: FloatArray = poses[:, 2] + self.spec.rotation
        radians = np.radians(true)
        by_pose = np.zeros((3, len(poses)))
        by_pose[2] = 1.0 + np.pi / 180 * (
            self.spec.hard_iron * np.cos(radians) + 2 * self.spec.soft_iron * np.cos(2 * radians)
        )
        return Linearisation(self.true_values(world, poses), true, by_pose, np.zeros(len(poses)))

    def model_error(self, expected: FloatArray, poses: FloatArray) -> FloatArray:
        # A degree at the least: a search's grid of headings is no finer.
        return np.hypot(max(self.spec.absolute_error, 1.0), self.spec.error * np.abs(poses[:, 2]))

    def rough_likelihood(self, reading: float, expected: FloatArray) -> FloatArray:
        # 20 degrees: a bias not yet known, and iron; one reading in ten may be anything.
        away = self.wrapped(reading - expected)
        return 0.9 * np.exp(-0.5 * (away / 20.0) ** 2) + 0.1

    def worst_case(self) -> SensorSpec:
        # Half of its bias' prior: it is to correct a heading that is lost, not to hold one that is known.
        return replace(self.spec, error=0.0, absolute_error=15.0)
