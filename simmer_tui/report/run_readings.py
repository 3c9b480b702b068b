"""The readings of a run by sensor, the poses of rows, and the world as a program knows it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from simmer_tui.run.run_history import RunHistory, rows_by_name
from simmer_tui.run.table import Columns
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.sensors.base import World
from simmer_tui.sim.specs import SensorSpec, SimulationSpec


def by_sensor(history: RunHistory, readings: Columns) -> Iterator[tuple[SensorSpec, Columns]]:
    """The sensors that a run read, each with its rows among some readings."""
    specs = {each.code: each for each in history.spec.sensors}
    for code, rows in rows_by_name(readings, "sensor", history.sensor_codes):
        if code in specs:
            yield specs[code], rows


def poses_of(rows: Columns) -> FloatArray:
    """The poses of some rows, (n, 3)."""
    return np.column_stack([rows[name] for name in ("x", "y", "heading")]).astype(np.float64)


def world_without_block(spec: SimulationSpec) -> World:
    """The maze without the block, as a program has it that does not know the block's place."""
    return World(Maze(spec.maze), Block(0.0, 0.0, 0.0), False)
