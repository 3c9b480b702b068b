"""Rules for robots on both sides of each bound: equal but for rounding is allowed, a little more is not."""

from __future__ import annotations

import math
from typing import Any

import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import Configuration, find_set, load
from simmer_tui.grade.course import Rules
from simmer_tui.grade.robot_rules import rule_problems
from simmer_tui.sim.sensors import KINDS
from simmer_tui.sim.specs import DriveSpec, GripperSpec, RobotSpec, SensorSpec, VelocityKind, VelocitySpec

ROUNDING, MORE = 5e-10, 2e-9
"""Differences that are rounding, and that are not."""


@pytest.fixture(scope="module")
def course() -> Configuration:
    loaded = load(find_set("mission"))
    return changed(loaded, sensors=(sensor(),), robot=RobotSpec.circle(6.0))


def changed(configuration: Configuration, **fields: Any) -> Configuration:
    """A configuration with other parts of its simulation."""
    return replace(configuration, simulation=replace(configuration.simulation, **fields))


def sensor(kind: str = "ultra", **fields: Any) -> SensorSpec:
    usual: dict[str, Any] = {"kind": KINDS[kind], "number": 1, "code": "q1", "x": 2.0, "error": 0.02}
    return KINDS[kind].spec_type(**(usual | fields))


def found(rules: Rules, course: Configuration, **fields: Any) -> list[str]:
    return [*map(str, rule_problems(rules, course, changed(course, **fields)))]


@pytest.mark.parametrize(
    ("robot", "across"),
    [
        (RobotSpec.circle(3.0 - ROUNDING), ""),
        (RobotSpec.circle(3.0 - 2 * MORE), "3.00"),
        (RobotSpec.circle(2.0), "2.00"),
        (RobotSpec.rectangle(9.0, 3.0), ""),
        (RobotSpec.rectangle(2.5, 9.0), "2.50"),
        (RobotSpec.polygon(((-2.0, -1.0), (2.0, -1.0), (-2.0, 2.0))), "2.40"),  # 3, 4, 5: the height on 5
        (RobotSpec.polygon(((-1.0, -2.0), (2.0, -2.0), (1.0, 2.0), (-2.0, 2.0))), "2.91"),  # 12 / sqrt(17)
        (RobotSpec.polygon(((-4.0, -4.0), (4.0, 4.0), (1.0, 1.0))), "0.00"),
        (RobotSpec.polygon(((-3.0, -3.0), (3.0, -3.0), (0.0, 0.0), (3.0, 3.0), (-3.0, 3.0))), ""),
    ],
)
def test_a_robot_is_three_inches_wide(course: Configuration, robot: RobotSpec, across: str) -> None:
    said = [f"robot.csv: the robot is {across} in across; at least 3 are needed"] if across else []
    assert found(Rules(), course, robot=robot, sensors=()) == said


def test_a_robot_fits_into_its_circle(course: Configuration) -> None:
    for diameter, fits in ((8.0, True), (8.0 + ROUNDING, True), (8.0 + MORE, False), (8.5, False)):
        said = (
            []
            if fits
            else [f"robot.csv: the robot needs a circle of {diameter:.2f} in around its centre; 8 allowed"]
        )
        assert found(Rules(size=8.0), course, robot=RobotSpec.circle(diameter)) == said
    corner = RobotSpec.rectangle(6.0, 8.0)
    assert found(Rules(size=10.0), course, robot=corner) == []
    assert len(found(Rules(size=9.9), course, robot=corner)) == 1


def test_sensors_are_counted(course: Configuration) -> None:
    off = sensor(enabled=False)
    assert found(Rules(), course, sensors=(off,) * 64) == []
    assert found(Rules(), course, sensors=(off,) * 65) == [
        "sensors.csv: has 65 sensors; at most 64 are allowed"
    ]
    assert found(Rules(sensors=2), course, sensors=(sensor(), sensor(), off)) == []
    assert found(Rules(sensors=1), course, sensors=(sensor(), off, sensor())) == [
        "sensors.csv: 2 sensors are enabled; at most 1 are allowed"
    ]
    assert len(found(Rules(sensors=0), course, sensors=(sensor(),))) == 1


def test_sensors_are_on_the_robot_or_no_farther_out_than_the_courses(course: Configuration) -> None:
    """The robot's reach is 3 inches, the course's sensor 2 inches from its centre."""

    def out(x: float, y: float = 0.0, sensors: SensorSpec | None = None) -> list[str]:
        base = course if sensors is None else changed(course, sensors=(sensors,))
        return found(Rules(), base, sensors=(sensor(x=x, y=y),))

    said = "sensors.csv:ultra1: it is {} in from the robot's centre; at most {} are allowed"
    assert out(3.0 + ROUNDING) == out(0.0, -3.0) == out(1.8, -2.4) == []
    assert out(3.0 + MORE) == [said.format("3.00", "3.00")]
    assert out(3.0, 4.0) == [said.format("5.00", "3.00")]
    far = sensor(x=-3.0, y=4.0)
    assert out(5.0, sensors=far) == []
    assert out(0.0, 5.5, sensors=far) == [said.format("5.50", "5.00")]
    assert found(Rules(), course, sensors=(sensor(x=9.0, enabled=False),)) == []
    assert found(Rules(), changed(course, sensors=())) == []


def test_errors_are_no_smaller_and_ranges_no_larger(course: Configuration) -> None:
    """Signs do not count; a range of 0 is without a limit."""
    base = changed(course, sensors=(sensor(error=-0.02, max_range=40.0, bias=1.0, absolute_error=0.5),))

    def better(**fields: Any) -> list[str]:
        usual: dict[str, Any] = {"error": 0.02, "max_range": 40.0, "bias": 1.0, "absolute_error": 0.5}
        team = sensor(**(usual | fields))
        return [each.partition("its ")[2] for each in found(Rules(), base, sensors=(team,))]

    assert better() == better(error=0.02 - ROUNDING, max_range=40.0 + ROUNDING) == []
    assert better(bias=1.0 - ROUNDING) == better(error=-0.9) == better(max_range=3.0) == []
    assert better(error=0.02 - MORE) == ["error is below the course's -0.02"]
    assert better(max_range=40.0 + 1e-8) == ["max range is above the course's 40"]
    assert better(bias=-1.0) == better(bias=1.0 + MORE) == ["bias is not the course's 1"]
    assert better(absolute_error=0.0, max_range=math.inf) == [
        "absolute error is below the course's 0.5", "max range is above the course's 40",
    ]  # fmt: skip
    unlimited = changed(course, sensors=(sensor(),))
    assert found(Rules(), unlimited, sensors=(sensor(max_range=9.0),)) == []


@pytest.mark.parametrize(
    ("own", "model", "above"),
    [
        (0.98, 0.02, ""),
        (0.99, 0.02, "0.98"),
        (0.4, 0.4, ""),
        (0.61, 0.4, "0.6"),
        (0.7, 0.7, ""),
        (0.5, 0.5, ""),
    ],
)
def test_the_opposite_of_an_answer_is_no_better(
    course: Configuration, own: float, model: float, above: str
) -> None:
    base = changed(course, sensors=(sensor("load", error=model),))
    said = f"sensors.csv:load1: its error is above {above}: the opposite of its answers would nearly always"
    said += " be right"
    assert found(Rules(), base, sensors=(sensor("load", error=own),)) == ([said] if above else [])


def test_sensors_of_other_types_are_not_the_courses(course: Configuration) -> None:
    assert found(Rules(), course, sensors=(sensor("comp"), sensor("ir", enabled=False))) == [
        "sensors.csv:comp1: the course has no sensors of the type comp"
    ]


def test_differences_to_the_nearest_sensor_are_told(course: Configuration) -> None:
    models = (sensor(error=0.5, gain=2.0, max_range=3.0), sensor(error=0.1), sensor(error=0.5, gain=3.0))
    base = changed(course, sensors=models)
    assert found(Rules(), base, sensors=(sensor(error=0.05),)) == [
        "sensors.csv:ultra1: its error is below the course's 0.1"
    ]


def test_drives_gripper_and_velocities_are_the_courses(course: Configuration) -> None:
    drives = course.simulation.drives
    off = tuple(replace(each, enabled=False) for each in drives)
    names = [f"drive.csv:{each.kind.value}" for each in drives]
    assert found(Rules(), changed(course, drives=off), drives=drives) == [
        f"{name}: the course's robots do not have this drive" for name in names
    ]
    assert found(Rules(), course, drives=off) == []
    faster: tuple[DriveSpec, ...] = tuple(replace(each, speed=each.speed + MORE) for each in drives)
    assert all("speed is above the course's" in each for each in found(Rules(), course, drives=faster))
    assert len(found(Rules(), course, drives=faster)) == len(drives)
    gripper = GripperSpec(code="p1", reach=3.0, width=4.0)
    base = changed(course, gripper=gripper)
    assert found(Rules(), base, gripper=replace(gripper, width=4.0 + ROUNDING)) == []
    assert found(Rules(), base, gripper=replace(gripper, width=4.1, reach=3.1)) == [
        "drive.csv:grip: its reach is above the course's 3",
        "drive.csv:grip: its width is above the course's 4",
    ]
    assert (
        found(Rules(), base, gripper=None)
        == found(Rules(), changed(course, gripper=None), gripper=gripper)
        == []
    )
    one, other = (VelocitySpec(kind=kind, code="v1") for kind in list(VelocityKind)[:2])
    base = changed(course, velocities=(one, replace(other, enabled=False)))
    assert found(Rules(), base, velocities=(one, other)) == [
        f"drive.csv:{other.kind.value}: the course's robots do not know this command"
    ]
    assert found(Rules(), base, velocities=(one, replace(other, enabled=False))) == []


def test_wheels_are_no_faster(course: Configuration) -> None:
    top = course.settings.wheels.top_speed

    def problems(speed: float) -> list[str]:
        settings = replace(course.settings, wheels=replace(course.settings.wheels, top_speed=speed))
        return [*map(str, rule_problems(Rules(), course, replace(course, settings=settings)))]

    assert problems(top) == problems(top + ROUNDING) == problems(top / 2) == []
    assert problems(top + 1.0) == [
        f"settings.toml:wheels.top_speed: the wheels turn at {top + 1:g} in/s; at most {top:g} are allowed"
    ]
    assert len(problems(top + 1e-8)) == 1


# -- cells -------------------------------------------------------------------------------------------


def cells(course: Configuration, file: str, columns: tuple[str, ...], wanted: str, own: str) -> list[str]:
    """Problems with cells of a file: all may differ in other files, and in these columns."""
    base = replace(course, files={**course.files, file: wanted})
    team = replace(course, files={**course.files, file: own})
    found = rule_problems(Rules(cells={file: columns}), base, team)
    same = ": must be the same as in the course's set"
    assert all(str(each).endswith(same) for each in found)
    return [str(each).removesuffix(same) for each in found]


TABLE = "ID,Code,Enabled,Bias\nultra1,u1,1,0.50\nultra2,u2,0,2\nir1,i1,1,\n"


@pytest.mark.parametrize(
    ("own", "problems"),
    [
        (TABLE, []),
        ("\ufeff# a comment\n\n ID , Code,Enabled,Bias\nultra1,zz, 1.0 ,.5\nir1,i9,1,\n", []),
        (TABLE.replace("0.50", "0.51"), ["ultra1:Bias"]),
        (TABLE.replace("ultra2,u2,0", "ultra2,u2,1"), ["ultra2:Enabled"]),
        (
            "ID;Code;Enabled;Bias\nultra1;u1;1;0,5\nir1;i9;1;\n",
            [],
        ),  # as spreadsheets of many countries save it
        ("ID,Code,Enabled,Bias\nultra7,u7,1,0.5\n", []),  # as the first of its type
        ("ID,Code,Enabled,Bias\nultra7,u7,0,2\n", ["ultra7:Enabled", "ultra7:Bias"]),
        ("ID,Code\nultra1,u1\n", ["ultra1:Enabled", "ultra1:Bias"]),
        ("ID,Code,Enabled,Bias,More\nir1,i1,1,,3\nir1,i1,1,,\n", ["ir1:More"]),
        ("ID,Code,Enabled,Bias\nlidar1,l1,1,\n", ["lidar1:Enabled"]),
        ("ID,Code,Enabled,Bias\nir1,i1,x\n", ["ir1:Enabled"]),
        ("", []),
        ("Code,Enabled\nu1,1\n", [":Enabled"]),
    ],
)
def test_cells_of_a_table_are_the_courses(course: Configuration, own: str, problems: list[str]) -> None:
    expected = [f"sensors.csv:{each}" for each in problems]
    assert cells(course, "sensors.csv", ("Code",), TABLE, own) == expected


@pytest.mark.parametrize(
    ("own", "problems"),
    [
        ("Shape,0\nx-size (in),6\n", []),
        ("Shape,0.0\nx-size (in),6.5\n", []),
        ("Shape;0\nx-size (in);6,5\n", []),
        ("Shape,1\nx-size (in),6\n", ["Shape"]),
        ("Shape,0\n", []),
        ("x-size (in),6\n", []),
        ("Shape,0,1\nx-size (in),6\nvertex,1,2\n", ["Shape", "vertex"]),
        ("", ["Shape"]),
    ],
)
def test_rows_of_a_robot_are_the_courses(course: Configuration, own: str, problems: list[str]) -> None:
    found = cells(course, "robot.csv", ("x-size (in)",), "Shape,0\nx-size (in),6\n", own)
    assert found == [f"robot.csv:{each}" for each in problems]
