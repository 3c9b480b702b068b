"""Differences of a run's set from the nominal one: maze, block, gripper, speeds and time limit. A
robot is as its set says, and misleads a program that knows the nominal set all the same."""

from __future__ import annotations

from functools import cache

import numpy as np

from simmer_tui.config import load_default
from simmer_tui.config.nominal import Nominal
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.run_history import RunHistory
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.specs import WALL, SimulationSpec

_SPEED = 2.0
"""Factor by which a drive is faster or slower than in the nominal set, from which that is told. Judged."""
_CELLS = 2
"""Cells with another wall that are named."""
_REACH = 0.25
"""Inches by which the robot reaches otherwise than in the nominal set, from which that is told. Judged."""


def reference_set(history: RunHistory) -> tuple[str, SimulationSpec]:
    """The set that a row is compared with, and its name: the nominal one, else the bundled one."""
    nominal = history.nominal
    return ("the bundled set", _bundled()) if nominal is None else (f"the set {nominal.name}", nominal.spec)


@cache
def _bundled() -> SimulationSpec:
    # It does not change, and takes a moment to read.
    return load_default().simulation


def world_differences(seen: Attempt) -> str:
    """A sentence on what is otherwise in the maze than in the nominal set: its walls and its block; empty
    without a nominal set, or a difference."""
    nominal = seen.history.nominal
    if nominal is None:
        return ""
    own, usual = seen.spec, nominal.spec
    parts = _of_maze(own, usual)
    if own.block_size != usual.block_size:
        size = f"the block is {own.block_size:g} in wide, not {usual.block_size:g} in"
        parts.append(size if own.block_size else "there is no block")
    return _unlike(nominal, parts)


def set_differences(seen: Attempt, *, with_limit: bool = True) -> str:
    """A sentence on what the robot, its sensors apart, and the time limit have otherwise than in the nominal
    set; the limit may be told elsewhere."""
    nominal = seen.history.nominal
    if nominal is None:
        return ""
    own, usual, parts = seen.spec, nominal.spec, []
    reach, usual_reach = (Footprint.of(each.robot).reach for each in (own, usual))
    if abs(reach - usual_reach) >= _REACH:
        parts.append(f"the robot reaches {reach:.3g} in from its centre, not {usual_reach:.3g} in")
    grip, other = own.gripper, usual.gripper
    if grip is not None and other is not None:
        if grip.reach != other.reach:
            parts.append(f"the gripper reaches {grip.reach:g} in, not {other.reach:g} in")
        if grip.width != other.width:
            parts.append(f"the gripper is {grip.width:g} in wide, not {other.width:g} in")
        if not 1 / _SPEED < grip.speed / other.speed < _SPEED:
            parts.append(f"the gripper takes {1 / grip.speed:g} s to close, not {1 / other.speed:g} s")
    drives = {each.code: each for each in usual.drives}
    for each in own.drives:
        row = drives.get(each.code)
        if row is not None and row.kind is each.kind and not 1 / _SPEED < each.speed / row.speed < _SPEED:
            unit = "deg/s" if each.kind.turns else "in/s"
            parts.append(f"{each.code} moves at {each.speed:g} {unit}, not {row.speed:g} {unit}")
    if with_limit and seen.task is not None and nominal.time_limit not in (None, seen.task.time_limit):
        parts.append(f"the time limit is {seen.task.time_limit:g} s, not {nominal.time_limit:g} s")
    return _unlike(nominal, parts)


def _unlike(nominal: Nominal, parts: list[str]) -> str:
    return f"Unlike in the set {nominal.name}, {'; '.join(parts)}." if parts else ""


def _of_maze(own: SimulationSpec, usual: SimulationSpec) -> list[str]:
    """Differences between the walls of two mazes, in words."""
    mine, other = (np.array(each.maze.cells) == WALL for each in (own, usual))
    if mine.shape != other.shape:
        return [f"the maze has {own.maze.rows} by {own.maze.columns} cells"]
    places = np.argwhere(mine != other).tolist()
    if len(places) > _CELLS:
        return [f"{len(places)} cells of the maze differ"]
    has = {True: "is a wall", False: "is no wall"}
    # Rows count from the top, as in maze.csv.
    return [
        f"there {has[bool(mine[row, column])]} in row {row + 1}, column {column + 1}"
        for row, column in places
    ]
