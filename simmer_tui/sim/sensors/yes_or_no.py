"""Sensors that answer yes or no: the infrared one that follows lines, and the load sensor of the gripper."""

from __future__ import annotations

import math

import numpy as np
from msgspec.structs import replace

from simmer_tui.sim import columns
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import FloorPatch
from simmer_tui.sim.rules import NumberRule
from simmer_tui.sim.sensors.base import ObservingSensor, World
from simmer_tui.sim.specs import SensorSpec

TEST_POINTS = np.array(
    [(i, j) for i in range(-6, 7) for j in range(-6, 7) if i * i + j * j <= 36], dtype=np.float64
)
"""Test points on the disc of a line sensor, (113, 2), in sixths of the radius."""


class LineSensor(ObservingSensor):
    """True if enough of a disc of floor is black: 113 test points, aligned with the global axes."""

    name = "ir"
    meaning = "line sensor, 1 over its colour"
    is_yes_or_no = True
    detects_floor = True
    devices = ("Infrared",)
    columns = (
        *(columns.X, columns.Y, columns.Z, columns.ERROR),
        replace(columns.FIELD_OF_VIEW, rule=NumberRule(0, 180, high_open=True)),
        *(columns.THRESHOLD, columns.DETECTS, *columns.ELECTRONICS),
        *(columns.READ_TIME, columns.DROPOUT, columns.OUTLIER, columns.ANSWER),
    )

    def __init__(self, spec: SensorSpec) -> None:
        super().__init__(spec)
        self.radius = spec.z * math.tan(math.radians(spec.field_of_view / 2))
        self._offsets = TEST_POINTS * self.radius / 6.0

    def observe(self, world: World, pose: Pose) -> tuple[float, FloorPatch]:
        """The fraction of test points of the colour it detects, and the points."""
        spec = self.spec
        centre = pose.place(spec.x, spec.y)
        points = self._offsets + centre
        black = world.maze.black(points)
        fraction = int(np.count_nonzero(black)) / len(points)
        if spec.detects_white:
            fraction = 1.0 - fraction
        return fraction, FloorPatch(centre, self.radius, points, black)

    def reported(self, value: float) -> float:
        """1 from the threshold on, else 0; of an analog sensor the fraction itself, 0 to 1."""
        # Errors may lead below 0 or above 1, which no sensor reports.
        fraction = min(max(value, 0.0), 1.0)
        if self.spec.analog:
            return super().reported(fraction)
        return 1.0 if fraction >= self.spec.threshold else 0.0

    def anywhere(self, fraction: float) -> float:
        """Any fraction; for a yes or no, each with probability 0.5."""
        return self.reported(fraction) if self.spec.analog else float(fraction < 0.5)


class LoadSensor(ObservingSensor):
    """True if the gripper holds something. Its Percent Error is the probability of the opposite answer."""

    name = "load"
    meaning = "1 while the gripper holds something"
    is_yes_or_no = True
    detects_block = True
    columns = (columns.ERROR, columns.READ_TIME)

    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        return float(world.held), None

    def reading(self, true: float, random: np.random.Generator | None, time: float) -> float:
        wrong = random is not None and random.random() < self.spec.error
        return 1.0 - true if wrong else true
