"""The compass."""

from __future__ import annotations

import numpy as np

from simmer_tui.sim import columns
from simmer_tui.sim.angles import cos_sin
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors.base import ObservingSensor
from simmer_tui.sim.sensors.world import World


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
