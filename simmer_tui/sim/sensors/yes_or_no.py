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
from simmer_tui.sim.specs import TILE_SIZE, SensorSpec

TEST_POINTS = np.array(
    [(i, j) for i in range(-6, 7) for j in range(-6, 7) if i * i + j * j <= 36], dtype=np.float64
)
"""Test points on the disc of a line sensor, (113, 2), in sixths of the radius."""
# Inches: places are below 1e3 in, and their rounding is 1e-13 of that.
_ROUNDING = 1e-9


class LineSpec(SensorSpec, frozen=True, kw_only=True):
    """One row of sensors.csv for a line sensor."""

    field_of_view: float = 0.0
    """Degrees from edge to edge."""
    threshold: float = 0.0
    """Share of the seen floor that must have the colour for a 1."""
    detects_white: bool = False
    analog: bool = False
    """True if it replies with the fraction of its test points, 0 to 1, instead of yes or no."""

    @property
    def is_yes_or_no(self) -> bool:
        return not self.analog

    @property
    def is_inverted(self) -> bool:
        return self.detects_white

    @property
    def beam(self) -> float:
        return self.field_of_view

    @property
    def radius(self) -> float:
        """Radius of the disc of floor that it sees, inches."""
        return self.z * math.tan(math.radians(self.field_of_view / 2))

    @property
    def view_words(self) -> tuple[str, ...]:
        return f"{self.field_of_view:g} deg wide", f"a disc {round(2 * self.radius, 2):g} in across"

    @property
    def yes_words(self) -> tuple[str, str]:
        colour = "white" if self.detects_white else "black"
        return colour, f"where at least {self.threshold:g} of the disc is {colour}"


class LineSensor(ObservingSensor):
    """True if enough of a disc of floor is black: 113 test points, aligned with the global axes."""

    name = "ir"
    short_name = "line sensor"
    spec_type = LineSpec
    spec: LineSpec
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

    def __init__(self, spec: LineSpec) -> None:
        super().__init__(spec)
        self.radius = spec.radius
        self._offsets = TEST_POINTS * self.radius / 6.0

    @property
    def threshold(self) -> float:
        return self.spec.threshold

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

    def steady_distance(self, pose: Pose) -> float:
        """Inches that the sensor may move before a test point can come to another tile."""
        tiles = (self._offsets + pose.place(self.spec.x, self.spec.y)) / TILE_SIZE
        nearest = float(np.abs(tiles - np.rint(tiles)).min()) * TILE_SIZE
        return max(nearest - _ROUNDING, 0.0)

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
    short_name = "load sensor"
    errs_by_opposite = True
    meaning = "1 while the gripper holds something"
    is_yes_or_no = True
    detects_block = True
    columns = (columns.ERROR, columns.READ_TIME)

    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        return float(world.held), None

    def reading(self, true: float, random: np.random.Generator | None, time: float) -> float:
        wrong = random is not None and random.random() < self.spec.error
        return 1.0 - true if wrong else true
