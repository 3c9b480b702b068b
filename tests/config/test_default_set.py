from __future__ import annotations

import re
import tomllib
from itertools import pairwise
from pathlib import Path

import pytest

from simmer_tui.config import load_default
from simmer_tui.config.drive_csv import REQUIRED as DRIVE_HEADERS
from simmer_tui.config.drive_csv import DriveRows
from simmer_tui.config.loader import simulation_of
from simmer_tui.config.new_set import with_mission
from simmer_tui.config.profiles import DRIVE, LINK, SENSOR, profile_names
from simmer_tui.config.sensors_csv import HEADERS as SENSOR_HEADERS
from simmer_tui.config.sets import FILES, bundled_folder, bundled_sets, read_files
from simmer_tui.config.settings import Settings, WheelsSettings, all_settings
from simmer_tui.config.settings_file import with_all_settings
from simmer_tui.sim.rules import ChoiceRule, IntegerRule, NumberRule, SeveralRule
from simmer_tui.sim.sensors import LineSensor
from simmer_tui.sim.specs import (
    Axes,
    DriveKind,
    MazeSpec,
    RobotSpec,
    SimulationSpec,
    WheelLayout,
    WheelsSpec,
)


def test_default_set_is_the_courses_maze_robot_and_sensors() -> None:
    spec = load_default().simulation
    assert spec.maze.cells == (
        (3, 3, 1, 1, 0, 2, 0, 2),
        (3, 3, 0, 1, 1, 1, 1, 1),
        (1, 0, 2, 0, 0, 1, 0, 1),
        (1, 1, 1, 1, 1, 1, 0, 2),
    )
    assert spec.maze.floor is None
    assert spec.robot.radius == 3
    codes = " ".join(sensor.code for sensor in spec.sensors)
    assert codes == "u1 u2 u3 u4 u5 i1 i2 i3 i4 c1 o1 o2 o3 o4 g1 t1"
    by_code = {sensor.code: sensor for sensor in spec.sensors}
    u4, i4, o2, t1 = by_code["u4"], by_code["i4"], by_code["o2"], by_code["t1"]
    assert (u4.id, u4.x, u4.y, u4.z, u4.rotation, u4.error, u4.field_of_view) == (
        "ultra4", 2.12, -2.12, 6, 315, 0.02, 5,
    )  # fmt: skip
    assert (i4.kind, i4.y, i4.threshold, i4.field_of_view) == (LineSensor, -2, 0.8, 40)
    assert (o2.x, o2.rotation) == (-3, 90)
    assert (t1.field_of_view, t1.max_range) == (25, 47)
    assert all(sensor.enabled for sensor in spec.sensors)


def test_default_drives_have_y_errors_before_x_errors() -> None:
    drives = {drive.kind: drive for drive in load_default().simulation.drives}
    codes = {kind.value: drive.code for kind, drive in drives.items()}
    assert codes == {"up": "w1", "down": "s1", "left": "a1", "right": "d1", "rot": "r1"}
    assert drives[DriveKind.UP].error == Axes(x=0.02, y=0.05, r=0.02)
    assert drives[DriveKind.RIGHT].error == Axes(x=0.05, y=0.02, r=0.02)
    assert drives[DriveKind.ROT].error == Axes(x=0.003, y=0.003, r=0.02)
    assert {drive.speed for drive in drives.values() if drive.kind is not DriveKind.ROT} == {6}
    assert drives[DriveKind.ROT].speed == 120
    assert {drive.bias for drive in drives.values()} == {Axes()}


def test_headers_of_the_default_files_are_the_known_columns_in_order() -> None:
    sensors = (bundled_folder() / "sensors.csv").read_text().splitlines()[0]
    drives = (bundled_folder() / "drive.csv").read_text().splitlines()[0]
    assert sensors == (
        "ID,Poll Character,Enabled,X Position (in),Y Position (in),Z Position (in),Rotation (deg),"
        "Percent Error (0-1),Field of View (deg),Threshold"
    )
    assert tuple(sensors.split(",")) == SENSOR_HEADERS
    assert tuple(drives.split(",")) == DRIVE_HEADERS


def test_settings_file_of_a_new_set_holds_every_setting_with_its_default_and_nothing_else() -> None:
    tree = tomllib.loads(with_all_settings((bundled_folder() / "settings.toml").read_text()))
    tables = {
        name: tree.pop(name) for name in [key for key, value in tree.items() if isinstance(value, dict)]
    }
    given = tree | {
        f"{table}.{key}": value for table, values in tables.items() for key, value in values.items()
    }
    assert {name: tuple(v) if isinstance(v, list) else v for name, v in given.items()} == {
        item.name: item.default for item in all_settings()
    }


def test_a_new_set_has_the_settings_that_the_source_lacks() -> None:
    """So a new setting needs no line in the bundled sets: its comment is made of its description."""
    text = (bundled_folder() / "settings.toml").read_text()
    block = '# Command that stops the robot at once. A program\'s xx is sent as this too.\nstop = "xx"\n'
    assert block in text
    lacking = text.replace(block, "").replace("[link]", "[other]").replace("realistic = false\n", "")
    made = with_all_settings(lacking)
    given = tomllib.loads(made)
    assert (given["serial"]["stop"], given["realistic"], given["link"]["jitter"]) == ("xx", False, 0.0)
    assert '# Command that stops the robot at once: a line of text.\nstop = "xx"\n\n[screen]' in made
    complete = with_all_settings(text, {"nominal": "default"})
    assert tomllib.loads(complete)["nominal"] == "default"
    assert with_all_settings(complete) == complete
    assert with_all_settings("a = [") == "a = ["


@pytest.mark.parametrize("folder", bundled_sets().values(), ids=lambda folder: folder.name)
def test_bundled_sets_leave_the_keys_to_the_settings(folder: Path) -> None:
    """So each default key stands in one place; `init` writes all into a new set."""
    assert tomllib.loads((folder / "settings.toml").read_text("utf-8"))["keys"] == {}


def test_every_setting_in_the_file_has_a_comment_above() -> None:
    lines = (bundled_folder() / "settings.toml").read_text().splitlines()
    for above, line in pairwise(lines):
        assert not re.match(r"\w+ =", line) or above.startswith("# ")


def test_default_set_gives_the_default_settings() -> None:
    assert load_default().settings == Settings()
    assert load_default().name == "default"


def test_manuals_names_are_top_level_settings() -> None:
    names = {*Settings.__struct_fields__}
    assert names >= {"bot_center", "bot_rot", "block_center", "blocksize", "num_segments", "strength"}
    assert names >= {"step_time", "randerror", "randbias", "sim", "plot_robot", "plot_sense", "seed"}


def test_default_set_has_the_five_files(folder: Path) -> None:
    assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)


@pytest.mark.parametrize("folder", bundled_sets().values(), ids=lambda folder: folder.name)
def test_comments_of_a_bundled_set_name_what_is_allowed(folder: Path) -> None:
    """Its comments are written by hand, others are made of the descriptions."""
    known = {item.name: item for item in all_settings()}
    profiles = {"drive_profile": DRIVE, "sensor_profile": SENSOR, "link_profile": LINK}
    table, comment, checked = "", "", 0
    for line in (folder / "settings.toml").read_text("utf-8").splitlines():
        if line.startswith("["):
            table = f"{line.strip('[]')}."
        elif line.startswith("#"):
            comment += f" {line}"
        elif line:
            item, said = known[table + line.partition(" =")[0]], comment
            comment = ""
            rule = item.rule
            if isinstance(rule, ChoiceRule | SeveralRule) and said:
                assert [word for word in rule.choices if f'"{word}"' not in said] == [], item.name
            for name in profile_names(profiles[item.name]) if item.name in profiles and said else ():
                assert f'"{name}"' in said, item.name
            bounds = re.search(r"([\d.]+) to ([\d.]*\d)", said)
            if bounds and isinstance(rule, NumberRule | IntegerRule):
                checked += 1
                assert (float(bounds[1]), float(bounds[2])) == (rule.low, rule.high), item.name
        else:
            comment = ""
    assert checked > 5


def test_a_kind_whose_name_begins_like_the_load_sensor_s_is_no_load_sensor() -> None:
    files = read_files(bundled_folder())
    head = files["sensors.csv"].decode().splitlines()[0]
    files["sensors.csv"] = f"{head}\nloadcell1,q1,1,0,0,0,0,0,0,0\n".encode()
    rows = with_mission(files)["sensors.csv"].decode().splitlines()
    assert [row.partition(",")[0] for row in rows if row.startswith("load")] == ["loadcell1", "load1"]


def test_a_simulation_without_settings_is_as_the_settings_have_it() -> None:
    # The simulation knows no settings, so it has defaults of its own; a notebook leaves these out too.
    settings = Settings(wheels=WheelsSettings(layout="omni-4"))
    maze, robot = MazeSpec(((1,),)), RobotSpec.circle(6.0)
    made = simulation_of(settings, maze, robot, (), DriveRows())
    wheels = WheelsSpec(layout=WheelLayout("omni-4"))
    assert made == SimulationSpec(
        maze=maze, robot=robot, sensors=(), drives=(), bot_center=settings.bot_center, wheels=wheels
    )
