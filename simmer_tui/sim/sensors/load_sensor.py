"""The load sensor: whether the gripper holds something."""

from __future__ import annotations

import numpy as np

from simmer_tui.sim import columns
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors.base import ObservingSensor
from simmer_tui.sim.sensors.world import World


class LoadSensor(ObservingSensor):
    """True if the gripper holds something. Its Percent Error is how often it says the opposite."""

    name = "load"
    meaning = "1 while the gripper holds something"
    is_yes_or_no = True
    columns = (columns.ERROR, columns.READ_TIME)

    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        return float(world.held), None

    def reading(self, true: float, random: np.random.Generator | None, time: float) -> float:
        wrong = random is not None and random.random() < self.spec.error
        return 1.0 - true if wrong else true
