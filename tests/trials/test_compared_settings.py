"""Differences of two sets of trials: each setting is of the task, of the robot, or of neither."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import Configuration, find_set, load
from simmer_tui.config.settings import all_settings, settings_from, value_of
from simmer_tui.sim.specs import MazeSpec
from simmer_tui.trials.compare import robot_differences, task_differences


@pytest.fixture(scope="module")
def mission() -> Configuration:
    return load(find_set("mission"))


def folder(configuration: Configuration, points: tuple[dict[str, str], ...] = (), **mazes: MazeSpec) -> Any:
    """Trials of a configuration, as far as they are compared."""
    plan = SimpleNamespace(points=points, sketches={})
    return SimpleNamespace(configuration=configuration, plan=plan, mazes=mazes)


def other(value: Any) -> Any:
    """Another value of the same type."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    return f"{value}x" if isinstance(value, str) else (*value, 1)


NEITHER = ("seed", "randerror", "sim", "plot_robot", "plot_sense")
TABLES_OF_NEITHER = ("server", "serial", "screen", "keys", "web")
"""Links to the program, screens and pages change no run."""
PLACES = ("bot_center", "bot_rot", "block_center")
OF_THE_TASK = (*PLACES, "blocksize", "motion.block_solid")


@pytest.mark.parametrize("has_mission", [True, False])
def test_each_setting_is_of_the_task_the_robot_or_neither(mission: Configuration, has_mission: bool) -> None:
    """Places that mission.toml decides are of no task that has one."""
    base = mission if has_mission else replace(mission, mission=None)
    for item in all_settings():
        changed = settings_from({item.name: other(value_of(base.settings, item.name))}, base.settings)
        pair = folder(base), folder(replace(base, settings=changed))
        of_task, of_robot = task_differences(*pair, {""}), robot_differences(*pair)
        assert all(f"the setting {item.name} (" in each for each in (*of_task, *of_robot))
        table = item.name.partition(".")[0]
        neither = item.name in NEITHER or table in TABLES_OF_NEITHER
        is_settled = has_mission and item.name in PLACES
        found = (len(of_task), len(of_robot))
        in_task = item.name in OF_THE_TASK
        assert found == (in_task and not is_settled, not in_task and not neither), item.name


def test_values_of_settings_are_shown(mission: Configuration) -> None:
    changed = settings_from({"wheels.layout": "y\a"}, mission.settings)
    found = robot_differences(folder(mission), folder(replace(mission, settings=changed)))
    layout = value_of(mission.settings, "wheels.layout")
    assert found == [f"the setting wheels.layout ({layout} and y\x07)"]


def test_parts_of_a_task(mission: Configuration) -> None:
    spec = mission.simulation
    walls = replace(spec.maze, cells=spec.maze.cells[::-1])
    floor = replace(spec.maze, floor=((0.5,) * 4,) * 4)
    one = folder(mission, a=spec.maze, b=spec.maze)

    def found(mazes: set[str], points: tuple[dict[str, str], ...] = (), **fields: Any) -> list[str]:
        simulation = replace(spec, maze=fields.pop("maze", spec.maze))
        changed = replace(mission, simulation=simulation, **fields)
        return task_differences(one, folder(changed, points, a=walls, b=spec.maze), mazes)

    assert found({""}) == found({"random", "b"}) == []
    assert found({""}, mission=None)[:1] == ["mission.toml"]
    assert found({""}, ({"a": "1"},)) == ["the values of --vary"]
    for mazes in ({""}, {"random"}, {"", "b"}):
        assert found(mazes, maze=walls) == ["maze.csv"]
    assert found({"b"}, maze=walls) == []
    assert found({"b"}, maze=floor) == ["floor.csv"]
    assert found({"b", "a"}) == ["the maze a"]


def test_parts_of_a_robot(mission: Configuration) -> None:
    """A part counts as another where its file has other lines as well: a seed may have changed it."""
    spec = mission.simulation
    parts: dict[str, dict[str, Any]] = {
        "robot.csv": {"robot": replace(spec.robot, radius=(spec.robot.radius or 3.0) + 1.0)},
        "sensors.csv": {"sensors": spec.sensors[1:]},
        "drive.csv": {"drives": spec.drives[1:]},
    }
    more = {"drive.csv": [{"gripper": None}, {"velocities": ()}]}
    for file, fields in [*parts.items(), *((file, each) for file, many in more.items() for each in many)]:
        simulation = replace(spec, **fields)
        if simulation == spec:
            continue
        changed = replace(mission, simulation=simulation)
        assert robot_differences(folder(mission), folder(changed)) == [], "the files are the same"
        changed = replace(changed, files={**changed.files, file: f"{changed.files[file]}# more\n"})
        assert robot_differences(folder(mission), folder(changed)) == [file]
    ends = {name: text.replace("\n", "\r\n") for name, text in mission.files.items()}
    assert robot_differences(folder(mission), folder(replace(mission, files=ends))) == []


def test_the_wiring_of_boards_is_of_the_robot_and_a_sketch_is_a_program(mission: Configuration) -> None:
    def wired(text: str, sketch: str) -> Any:
        made = folder(replace(mission, files={**mission.files, "wiring.toml": text}))
        made.plan.sketches = {"rover": f"{sketch} 0123456789abcdef"}
        return made

    one = wired('[boards.rover]\nsketch = "a.ino"\nboard = "uno"\n', "a.ino")
    other_sketch = wired('[boards.rover]\nsketch = "b.ino"  # ours\nboard = "uno"\n', "b.ino")
    other_board = wired('[boards.rover]\nsketch = "a.ino"\nboard = "mega"\n', "a.ino")
    assert robot_differences(one, other_sketch) == []
    assert robot_differences(one, other_board) == ["wiring.toml"]
    assert robot_differences(one, folder(mission)) == ["boards, which drive only one of them"]
