"""Differences of a run's set from the nominal one: maze, block, and numbers of the robot and the mission. A
robot is as its set says, and misleads a program that knows the nominal set all the same."""

from __future__ import annotations

from functools import cache

import numpy as np

from simmer_tui.config import load_default
from simmer_tui.config.nominal import Nominal
from simmer_tui.run.attempt import Attempt
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.specs import WALL, GripperSpec, SimulationSpec

# Judged: a quarter of an inch of reach decides on a contact or a grip, a quarter of a second for each reading
# on the time. A gripper closes a few times.
_REACH, _SLOW_READING, _SLOW, _SPEED = 0.25, 0.25, 1.0, 0.5
"""Least differences that are told: inches, seconds of a reading and of a gripper, and a share of the own
speed."""
GRIPPER_NOUN = "the gripper"
_CELLS = 2
"""Cells with another wall that are named."""


def world_differences(seen: Attempt) -> str:
    """A sentence on what is otherwise in the maze than in the nominal set: its walls and its block; empty
    without a nominal set, or a difference."""
    nominal, own = seen.history.nominal, seen.spec
    if nominal is None:
        return ""
    parts, size, usual = _of_maze(own, nominal.spec), own.block_size, nominal.spec.block_size
    if size != usual:
        parts.append(f"the block is {size:g} in wide, not {usual:g} in" if size else "there is no block")
    return _unlike(nominal, parts)


def set_differences(seen: Attempt, *, with_limit: bool = True) -> str:
    """A sentence on what the robot, its sensors apart, and the time limit have otherwise than in the nominal
    set; the limit may be told elsewhere."""
    nominal = seen.history.nominal
    if nominal is None:
        return ""
    sensors = {each.code for each in seen.spec.sensors}
    parts = [f"{of} {text}" for of, text in number_differences(seen.spec, nominal.spec) if of not in sensors]
    if with_limit and seen.task is not None and nominal.time_limit not in (None, seen.task.time_limit):
        parts.append(f"the time limit is {seen.task.time_limit:g} s, not {nominal.time_limit:g} s")
    return _unlike(nominal, parts)


def number_differences(own: SimulationSpec, usual: SimulationSpec) -> list[tuple[str, str]]:
    """Numbers that change no reading and no movement, but its time or place: for each that differs by enough
    the device's code, or a noun, and a text such as `takes 3 s for a reading, not 0.06 s`."""
    others = {(of, text): value for of, text, value, _, _ in _numbers(usual)}
    return [
        (of, f"{text.format(f'{value:.3g} {unit}')}, not {others[of, text]:.3g} {unit}")
        for of, text, value, unit, least in _numbers(own)
        if abs(value - others.get((of, text), value)) >= least
    ]


def _numbers(spec: SimulationSpec) -> list[tuple[str, str, float, str, float]]:
    """Rows of a device, its text, the number in it, its unit, and the least difference that is told."""
    grip = spec.gripper or GripperSpec(code="")
    drives = [(each.code, each.speed, f"{each.kind.unit}/s") for each in spec.drives]
    return [
        ("the robot", "reaches {} from its centre", Footprint.of(spec.robot).reach, "in", _REACH),
        (GRIPPER_NOUN, "reaches {}", grip.reach, "in", _REACH),
        (GRIPPER_NOUN, "is {} wide", grip.width, "in", _REACH),
        (GRIPPER_NOUN, "takes {} to close", 1.0 / grip.speed, "s", _SLOW),
        *((code, "moves at {}", speed, unit, _SPEED * speed) for code, speed, unit in drives),
        *((each.code, "takes {} for a reading", each.read_time, "s", _SLOW_READING) for each in spec.sensors),
    ]


@cache
def bundled() -> SimulationSpec:
    """The bundled set, with which devices are compared if a run has no nominal set."""
    # It does not change, and takes a moment to read.
    return load_default().simulation


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
