"""Expected readings on a grid of poses: the lookup table of a histogram filter."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct

from simmer_tui.errors import AtlasError, UnknownSensorError
from simmer_tui.sim import Simulator
from simmer_tui.sim.angles import MOST_HEADINGS
from simmer_tui.sim.arrays import BoolArray, FloatArray, NDArray
from simmer_tui.sim.device_faults import faults_of
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.rules import IntegerRule, NumberRule
from simmer_tui.sim.sensors.base import ObservingSensor, World, sensor_of
from simmer_tui.sim.sensors.range_sensors import RangeSensor
from simmer_tui.sim.specs import CELL_SIZE

STEP, HEADINGS = NumberRule(0, CELL_SIZE, low_open=True), IntegerRule(1, MOST_HEADINGS)
"""Side of a cell of a grid, inches, and its number of directions."""
_ON_GRID = 1e-6
"""Inches by which the last edge of a grid may differ from the maze's: rounding of a step such as 0.1."""


class PoseGrid(Struct, frozen=True):
    """A grid of poses over a whole maze: square cells of `step` inches, row 1 on top, and `headings` evenly
    spaced directions from 0 on. A pose is the middle of its cell."""

    step: float
    rows: int
    columns: int
    headings: int

    @classmethod
    def over(cls, maze: Maze, step: float, headings: int) -> PoseGrid:
        """The grid over a maze. Raises AtlasError if its cells do not fill the maze."""
        parts = CELL_SIZE / step
        if abs(round(parts) * step - CELL_SIZE) > _ON_GRID:
            near = f"{CELL_SIZE / np.ceil(parts):.4g} or {CELL_SIZE / np.floor(parts):.4g}"
            what = f"cells of {step:g} in do not fill a cell of the maze, {CELL_SIZE:g} in"
            raise AtlasError(f"{what}: --step {near} does")
        cells = round(parts)
        return cls(
            step, round(maze.height / CELL_SIZE) * cells, round(maze.width / CELL_SIZE) * cells, headings
        )

    @property
    def poses(self) -> int:
        """Number of poses."""
        return self.rows * self.columns * self.headings

    @property
    def x(self) -> FloatArray:
        """X of each column, inches, (columns,)."""
        return (np.arange(self.columns, dtype=np.float64) + 0.5) * self.step

    @property
    def y(self) -> FloatArray:
        """Y of each row, inches, the greatest first, (rows,)."""
        return (np.arange(self.rows, dtype=np.float64)[::-1] + 0.5) * self.step

    @property
    def heading(self) -> FloatArray:
        """Headings, degrees, (headings,)."""
        return np.arange(self.headings, dtype=np.float64) * 360.0 / self.headings

    def row(self, index: int) -> FloatArray:
        """The poses of a row, headings fastest: (columns * headings, 3) of x, y and heading."""
        x, heading = np.meshgrid(self.x, self.heading, indexing="ij")
        return np.column_stack((x.ravel(), np.full(x.size, self.y[index]), heading.ravel()))


class Atlas(Struct, frozen=True):
    """Expected readings, at every pose of a grid, of the sensors with some `codes`."""

    grid: PoseGrid
    codes: tuple[str, ...]
    ranges: NDArray[np.float32]
    """(rows, columns, headings, sensors), in each sensor's unit: of range sensors inches, infinite without
    an echo. 0 where the robot's centre would be in a wall."""
    free: BoolArray
    """True where the robot fits, (rows, columns, headings)."""


def atlas_codes(simulator: Simulator, names: Sequence[str] = ()) -> tuple[str, ...]:
    """The sensors of an atlas: those named, else all enabled range sensors.

    Raises AtlasError for one that is disabled, named twice or independent of the pose, and if there is none;
    UnknownSensorError for other codes.
    """
    codes = tuple(names) or tuple(simulator.ranging_codes())
    if not codes:
        raise AtlasError("this robot has no enabled range sensor: name others with --sensors")
    specs = {spec.code: spec for spec in simulator.spec.sensors}
    for code in codes:
        if code not in specs:
            raise UnknownSensorError(code, specs)
        spec = specs[code]
        if not spec.enabled:
            raise AtlasError(f"the sensor {code} is disabled in sensors.csv")
        if codes.count(code) > 1:
            raise AtlasError(f"the sensor {code} is named twice")
        if not isinstance(sensor_of(spec), ObservingSensor):
            what = f"the sensor {code} ({spec.kind.meaning}) counts motion"
            raise AtlasError(f"{what}: no reading of it belongs to a pose")
    return codes


def compute_atlas(
    simulator: Simulator,
    grid: PoseGrid,
    codes: Sequence[str],
    progress: Callable[[int], None] = lambda row: None,
) -> Atlas:
    """Readings of the simulator without noise at time 0, with the block where it is now.

    Args:
        codes: From `atlas_codes`.
        progress: Called with the number of rows done, after each.
    """
    world = simulator.world
    obstacles = simulator.walls
    if simulator.spec.block_solid:
        obstacles = obstacles.with_block(simulator.block)
    specs = {spec.code: spec for spec in simulator.spec.sensors}
    sensors = [sensor for code in codes if isinstance(sensor := sensor_of(specs[code]), ObservingSensor)]
    place = (grid.columns, grid.headings)
    ranges = np.empty((grid.rows, *place, len(sensors)), np.float32)
    free = np.empty((grid.rows, *place), np.bool_)
    # A row at a time: the rays of all poses at once would take gigabytes.
    for index in range(grid.rows):
        poses = grid.row(index)
        free[index] = ~obstacles.overlapped(simulator.footprint, poses).reshape(place)
        inside = ~world.maze.are_walls(poses[:, 0], poses[:, 1])
        row = np.zeros((len(poses), len(sensors)))
        for column, sensor in enumerate(sensors):
            row[inside, column] = _readings(sensor, world, poses[inside])
        ranges[index] = row.reshape(*place, len(sensors))
        progress(index + 1)
    return Atlas(grid, tuple(codes), ranges, free)


def _readings(sensor: ObservingSensor, world: World, poses: FloatArray) -> list[float]:
    """Readings of a sensor without noise at (n, 3) poses at time 0."""
    with faults_of(sensor):
        if isinstance(sensor, RangeSensor):
            true = sensor.true_values(world, poses).tolist()
        else:
            true = [float(sensor.observe(world, Pose(*pose))[0]) for pose in poses.tolist()]
        return [float(sensor.reading(value, None, 0.0)) for value in true]
