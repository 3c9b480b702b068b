"""mission.toml, the gripper's row and the load sensor: what is read, and what is said of mistakes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import load
from simmer_tui.config.mission_toml import Heading, MissionSpec
from simmer_tui.config.set_summary import summarize
from simmer_tui.config.sets import FILES, bundled_sets, find_set, init_set
from simmer_tui.config.settings_file import Override
from simmer_tui.errors import ConfigurationError
from simmer_tui.sim.sensors import LoadSensor
from simmer_tui.sim.specs import GripperSpec

Problems = Callable[..., list[str]]
Edit = Callable[[str, str, str], None]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the set with the mission, in place of the default one."""
    made = tmp_path / "set"
    init_set(made, bundled_sets()["mission"])
    return made


# -- the bundled set -----------------------------------------------------------------------------


def test_the_mission_set_is_the_default_robot_with_gripper_and_load_sensor() -> None:
    mission, default = load(find_set("mission")), load(bundled_sets()["default"])
    assert mission.name == "mission"
    assert mission.simulation.maze == default.simulation.maze
    assert mission.simulation.robot == default.simulation.robot
    assert mission.simulation.drives == default.simulation.drives
    timeless = tuple(replace(sensor, read_time=0.0) for sensor in mission.simulation.sensors[:-1])
    assert timeless == default.simulation.sensors
    load_sensor = mission.simulation.sensors[-1]
    assert (load_sensor.kind, load_sensor.code, load_sensor.unit) == (LoadSensor, "l1", "")
    assert mission.simulation.gripper == GripperSpec(code="p1")
    assert replace(mission.settings, link=default.settings.link) == default.settings
    assert mission.mission == MissionSpec()
    assert default.mission is None
    assert default.simulation.gripper is None


def test_the_mission_set_is_honest_about_time() -> None:
    mission, realistic = (
        load(find_set("mission")),
        load(find_set("mission"), {"realistic": Override("--realistic", True)}),
    )
    read_times = {sensor.kind.name: sensor.read_time for sensor in mission.simulation.sensors}
    assert read_times.pop("ultra") == 0.06
    assert read_times.pop("tof") == 0.033
    assert set(read_times.values()) == {0.002}
    assert mission.settings.link == realistic.settings.link
    assert {sensor.read_time for sensor in realistic.simulation.sensors} == {0.06, 0.033, 0.002}


def test_the_files_of_a_set_with_a_mission_hold_it(folder: Path) -> None:
    assert set(load(folder).files) == {*FILES, "mission.toml"}


def test_one_contact_that_is_allowed_is_no_plural(folder: Path) -> None:
    mission = folder / "mission.toml"
    mission.write_text(mission.read_text("utf-8").replace("contacts = 0", "contacts = 1"), "utf-8")
    assert "300 s, at most 1 contact." in summarize(load(folder), ascii_only=True)


@pytest.mark.parametrize("ascii_only", [True, False])
def test_the_summary_shows_gripper_and_mission(folder: Path, ascii_only: bool) -> None:
    text = summarize(load(folder), ascii_only=ascii_only)
    assert "Gripper: p1-1 closes, p1-0 opens; it takes a block whose centre is within 3 in" in text
    assert "Mission: start any start cell, heading a multiple of 90; block anywhere" in text
    assert "300 s, no contact." in text


# -- mission.toml --------------------------------------------------------------------------------


def test_a_mission_may_be_given_in_full(folder: Path) -> None:
    (folder / "mission.toml").write_text(
        "start = [18, 30]\nheading = -90\nblock = [6.5, 30]\ndrop_zone = [31, 20]\n"
        'time_limit = 120\ncontacts = "any"\nclearance = 0\n'
    )
    assert load(folder).mission == MissionSpec(
        start=(18.0, 30.0),
        heading=-90.0,
        block=(6.5, 30.0),
        drop_zone=(31.0, 20.0),
        time_limit=120.0,
        contacts=None,
        clearance=0.0,
    )


def test_what_a_mission_leaves_out_has_its_default(folder: Path) -> None:
    (folder / "mission.toml").write_text('heading = "ANY"\n')
    assert load(folder).mission == MissionSpec(heading=Heading.ANY)


def test_every_mistake_is_named_with_its_line(folder: Path, problems: Problems) -> None:
    (folder / "mission.toml").write_text(
        'start = "here"\nheading = "half"\n\nblock = [1]\ntime_limit = 0\ncontacts = -1\n'
        'clearence = 1\ndrop_zone = [1, "a"]\n'
    )
    place = 'must be "any", or two numbers, not '
    assert problems() == [
        f'mission.toml:1:start: {place}"here"',
        'mission.toml:2:heading: must be "quarter" or "any", or a number, not "half" (unit: deg)',
        f"mission.toml:4:block: {place}[1]",
        "mission.toml:5:time_limit: must be a number above 0, not 0 (unit: s)",
        'mission.toml:6:contacts: must be "any", or a whole number from 0 to 1000000, not -1',
        'mission.toml:7:clearence: is not known here; did you mean "clearance"?',
        f'mission.toml:8:drop_zone: {place}[1, "a"]',
    ]


def test_a_text_that_is_no_toml_is_one_problem(folder: Path, problems: Problems) -> None:
    (folder / "mission.toml").write_text("start = [1,\nblock\n")
    (line,) = problems()
    assert line.startswith("mission.toml:2: is not TOML here: ")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("start = [24, 30]\nheading = 0", "mission.toml:1:start: the robot at (24, 30) heading 0 overlaps"),
        ("start = [-1, 30]", "mission.toml:1:start: (-1, 30) lies outside the maze"),
        ("block = [25, 30]", "mission.toml:1:block: the block of 3 in at (25, 30) overlaps a wall"),
        ("block = [250, 30]", "mission.toml:1:block: (250, 30) lies outside the maze"),
        ("\ndrop_zone = [54, 42]", "mission.toml:2:drop_zone: (54, 42) is in no free cell of the maze"),
        ("drop_zone = [96, 6]", "mission.toml:1:drop_zone: (96, 6) is in no free cell of the maze"),
        ("clearance = 11", "mission.toml:block: no cell of value 3 has room for a block of 3 in that keeps"),
        (
            "start = [6, 42]\nblock = [7, 42]",
            "mission.toml:2:block: the robot at its start would stand where",
        ),
    ],
)
def test_places_that_cannot_be_are_problems(
    folder: Path, problems: Problems, text: str, expected: str
) -> None:
    (folder / "mission.toml").write_text(text + "\n")
    (line,) = problems()
    assert line.startswith(expected)


def test_a_maze_without_start_or_block_cells_leaves_nothing_to_draw(folder: Path, problems: Problems) -> None:
    text = (folder / "maze.csv").read_text()
    (folder / "maze.csv").write_text(text.replace("2", "1").replace("3", "1"))
    assert problems() == [
        "mission.toml:6:start: maze.csv has no cell of value 2 to start from",
        "mission.toml:10:block: maze.csv has no cell of value 3 for the block to lie in",
        "mission.toml:16:drop_zone: maze.csv has no cell of value 2 to be the drop zone",
    ]


def test_a_robot_too_large_for_any_start_cell_is_a_problem(
    folder: Path, problems: Problems, edit: Edit
) -> None:
    (folder / "robot.csv").write_text("shape,1\nx,12\ny,12\n")
    edit("settings.toml", "bot_center = [9.5, 42.0]", "bot_center = [6.0, 42.0]")
    (folder / "mission.toml").write_text("heading = 45\n")
    (line,) = problems()
    assert line == "mission.toml:start: the robot fits into no cell of value 2 without overlapping a wall"


def test_a_mission_needs_a_gripper(folder: Path, problems: Problems, edit: Edit) -> None:
    edit("drive.csv", "grip,p1,1", "grip,p1,0")
    assert problems() == [
        "mission.toml: a mission needs a gripper: an enabled row grip in drive.csv (simmer-tui init DIR "
        "--mission writes a set with one)"
    ]


# -- the gripper's row and the load sensor ---------------------------------------------------------


def test_the_gripper_is_no_drive_and_reads_its_own_columns(folder: Path, edit: Edit) -> None:
    edit("drive.csv", "Reach,Width", "Reach,Speed,Width")
    edit("drive.csv", "grip,p1,1,,,,,,,3,4", "GRIP,g9,0,,,,,,,1.5,0.5,2.5")
    (folder / "mission.toml").unlink()
    spec = load(folder).simulation
    assert spec.gripper == GripperSpec(code="g9", enabled=False, reach=1.5, width=2.5, speed=0.5)
    assert [drive.kind.value for drive in spec.drives] == ["up", "down", "left", "right", "rot"]


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ("grip,p,1,,,,,,,3,4", "Poll Character: must be two printable"),
        ("grip,w1,1,,,,,,,3,4", 'Poll Character: "w1" is the code of drive.csv:2 already'),
        ("grip,u1,1,,,,,,,3,4", 'Poll Character: "u1" is the code of sensors.csv:2 already'),
        ("grip,p1,5,,,,,,,3,4", 'Enabled: must be 0 (off) or 1 (on), not "5"'),
        ("grip,p1,1,,,,,,,0,4", 'Reach: must be a number above 0, not "0"'),
        ("grip,p1,1,,,,,,,3,x", 'Width: must be a number above 0, not "x"'),
    ],
)
def test_mistakes_in_the_grippers_row_name_the_cell(
    folder: Path, problems: Problems, edit: Edit, row: str, expected: str
) -> None:
    edit("drive.csv", "grip,p1,1,,,,,,,3,4", row)
    (folder / "mission.toml").unlink()
    (line,) = problems()
    assert line.startswith(f"drive.csv:7:{expected}")


def test_columns_that_are_not_for_a_row_must_be_blank_there(
    folder: Path, problems: Problems, edit: Edit
) -> None:
    edit("drive.csv", "0,0,0,,", "0,0,0,1,")
    edit("drive.csv", "Reach,Width", "Reach,Width,Gain")
    edit("drive.csv", "grip,p1,1,,,,,,,3,4", "grip,p1,1,,,,,,,3,4,2")
    assert problems() == [
        "drive.csv:2:Reach: is for grip only; leave it blank for up",
        "drive.csv:7:Gain: is for movements only; leave it blank for grip",
    ]


def test_two_grippers_are_a_problem(folder: Path, problems: Problems) -> None:
    with (folder / "drive.csv").open("a") as file:
        file.write("grip,p2,1,,,,,,,3,4\n")
    (line,) = problems()
    assert line.startswith('drive.csv:13:ID: "grip" is in line 7 already')


def test_a_load_sensor_needs_only_its_error(folder: Path, problems: Problems, edit: Edit) -> None:
    edit("sensors.csv", "load1,l1,1,,,,,0.02,,", "load1,l1,1,,,,,,,")
    assert problems() == ["sensors.csv:18:Percent Error (0-1): is blank; must be a number from 0 to 1"]


@pytest.mark.parametrize("column", ["Gain", "Absolute Error", "Bias", "Drift (per s)", "Resolution", "Wrap"])
def test_a_load_sensor_has_no_errors_of_measurement(
    folder: Path, problems: Problems, edit: Edit, column: str
) -> None:
    edit("sensors.csv", "Threshold", f"Threshold,{column}")
    edit("sensors.csv", "load1,l1,1,,,,,0.02,,", "load1,l1,1,,,,,0.02,,,1")
    (line,) = problems()
    assert line.startswith(f"sensors.csv:18:{column}: is for ")
    assert line.endswith('only; leave it blank for load, not "1"')


def test_a_set_without_a_mission_may_have_a_gripper(folder: Path) -> None:
    (folder / "mission.toml").unlink()
    loaded = load(folder)
    assert loaded.mission is None
    assert loaded.simulation.gripper is not None


def test_problems_of_all_files_come_together(folder: Path, edit: Edit) -> None:
    edit("drive.csv", "grip,p1,1", "grip,p,1")
    edit("sensors.csv", "load1,l1,1", "load,l1,1")
    (folder / "mission.toml").write_text("contacts = 1.5\n")
    with pytest.raises(ConfigurationError) as raised:
        load(folder)
    assert [problem.where.split(":")[0] for problem in raised.value.problems] == [
        "sensors.csv",
        "drive.csv",
        "mission.toml",
    ]
