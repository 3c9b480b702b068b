"""Differences between two sets of trials: only runs of the same task are compared."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from simmer_tui.config import drive_csv, maze_csv, mission_toml, robot_csv, sensors_csv
from simmer_tui.config.loader import Configuration
from simmer_tui.config.settings import all_settings, value_of
from simmer_tui.sim.command import escape
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.trial import RANDOM

_OF_THE_TASK = ("bot_center", "bot_rot", "block_center", "blocksize", "motion.block_solid")
_DRAWN = ("bot_center", "bot_rot", "block_center")
"""Settings that a mission overrides."""
_NOT_OF_A_RUN = ("seed", "randerror", "sim", "plot_robot", "plot_sense")
"""Settings that trials do without, or have of their own."""
_TABLES_NOT_OF_A_RUN = ("server", "serial", "screen", "keys")
"""Tables of settings that change neither task nor robot: links to the program, and the screen."""

_ROBOT_FILES: dict[str, Callable[[Configuration], object]] = {
    robot_csv.FILE: lambda configuration: configuration.simulation.robot,
    sensors_csv.FILE: lambda configuration: configuration.simulation.sensors,
    drive_csv.FILE: lambda configuration: (configuration.simulation.drives, configuration.simulation.gripper),
}


def task_differences(first: TrialFolder, second: TrialFolder, mazes: Iterable[str]) -> list[str]:
    """The names of what the robot was to do, and where, that is not the same for both, for runs in
    some `mazes`. Comments and line ends make no difference."""
    one, other = first.configuration, second.configuration
    found = []
    if one.mission != other.mission:
        found.append(mission_toml.FILE)
    if first.plan.points != second.plan.points:
        found.append("the values of --vary")
    kinds = set(mazes)
    one_maze, other_maze = one.simulation.maze, other.simulation.maze
    if kinds & {"", RANDOM} and one_maze.cells != other_maze.cells:
        found.append(maze_csv.FILE)
    if one_maze.floor != other_maze.floor:
        found.append(maze_csv.FLOOR_FILE)
    found += [
        f"the maze {escape(name, 60)}"
        for name in sorted(kinds - {"", RANDOM})
        if first.mazes[name].cells != second.mazes[name].cells
    ]
    settled = _DRAWN if one.mission is not None else ()
    return found + _settings(one, other, lambda name: name in _OF_THE_TASK and name not in settled)


def robot_differences(first: TrialFolder, second: TrialFolder) -> list[str]:
    """The names of the files and settings of the robot itself that are not the same for both."""
    one, other = first.configuration, second.configuration
    found = [
        name
        for name, part in _ROBOT_FILES.items()
        if part(one) != part(other) and _lines(one, name) != _lines(other, name)
    ]
    return found + _settings(one, other, _is_of_the_robot)


def _is_of_the_robot(name: str) -> bool:
    table = name.partition(".")[0]
    return name not in (*_OF_THE_TASK, *_NOT_OF_A_RUN) and table not in _TABLES_NOT_OF_A_RUN


def _settings(one: Configuration, other: Configuration, matters: Callable[[str], bool]) -> list[str]:
    found = []
    for item in all_settings():
        values = [value_of(each.settings, item.name) for each in (one, other)]
        if matters(item.name) and values[0] != values[1]:
            shown = " and ".join(escape(str(value), 60) for value in values)
            found.append(f"the setting {item.name} ({shown})")
    return found


def _lines(configuration: Configuration, name: str) -> list[str]:
    """A file's lines; a profile changes what it amounts to, but not the file."""
    return configuration.files.get(name, "").splitlines()
