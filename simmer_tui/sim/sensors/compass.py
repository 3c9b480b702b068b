"""The compass."""

from __future__ import annotations

from simmer_tui.sim import columns
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors.base import ObservingSensor
from simmer_tui.sim.sensors.world import World


class Compass(ObservingSensor):
    """The robot's heading and the sensor's own rotation, degrees, not wrapped."""

    name = "comp"
    meaning = "compass heading"
    unit = "deg"
    devices = ("Compass",)
    columns = (columns.ROTATION, columns.ERROR, *columns.ELECTRONICS)

    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        return pose.heading + self.spec.rotation, None
