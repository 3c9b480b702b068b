"""Meanings of codes, in words."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.config.describe_code import describe_code, side_of
from simmer_tui.errors import printable
from simmer_tui.sim import SimulationSpec
from simmer_tui.sim.specs import Axes, GripperSpec


def test_a_range_sensor_sits_looks_and_errs(course_spec: SimulationSpec) -> None:
    sensors = tuple(replace(sensor, error=0.02) for sensor in course_spec.sensors)
    course_spec = replace(course_spec, sensors=sensors)
    assert describe_code(course_spec, "u2") == [
        "u2  ultra2: ultrasonic range",
        "Sits   3 in from the centre, to the front left (x 2.12, y 2.12), 6 in up",
        "Looks  45 deg to the left (front left), 5 deg wide, 5 rays",
        "Says   inches, Infinity where nothing is hit",
        "Errors 2 %",
        "Give   u2  (it takes no value)",
    ]
    assert describe_code(course_spec, "ultra4")[2] == (
        "Looks  45 deg to the right (front right), 5 deg wide, 5 rays"
    )
    assert describe_code(course_spec, "t1")[3] == "Says   inches, Infinity beyond 47"


def test_other_kinds_say_what_holds_for_them(course_spec: SimulationSpec) -> None:
    line = describe_code(course_spec, "i1")
    assert line[2].startswith("Looks  straight down, 40 deg wide, a disc 0.73 in across")
    assert line[3] == "Says   1 where at least 0.8 of the disc is black, else 0"
    wheel = describe_code(course_spec, "o1")
    assert wheel[2] == "Rolls  90 deg to the left"
    assert wheel[3] == "Says   inches, counted from the start"
    gyro = describe_code(course_spec, "g1")
    assert gyro[1] == "Says   degrees, counted from the start"
    assert describe_code(course_spec, "c1")[1] == "Looks  to the front"


def test_what_a_row_has_beside_the_usual_is_told(course_spec: SimulationSpec) -> None:
    first = replace(
        course_spec.sensors[0],
        enabled=False,
        error=0.02,
        gain=1.02,
        dropout=0.01,
        max_range=100.0,
        min_range=0.8,
    )
    spec = replace(course_spec, sensors=(first, *course_spec.sensors[1:]))
    lines = describe_code(spec, "u1")
    assert lines[1] == "It is switched off (Enabled is 0): the command is refused."
    assert "Says   inches, at least 0.8, Infinity beyond 100" in lines
    assert "Errors 2 %, gain 1.02, dropout 0.01" in lines


def test_drives_and_the_gripper_say_what_they_take(course_spec: SimulationSpec) -> None:
    across = {drive.code: Axes(0.02, 0.05, 0.02) for drive in course_spec.drives if drive.kind.direction.y}
    drives = tuple(
        replace(drive, error=across.get(drive.code, Axes(0.05, 0.02, 0.02))) for drive in course_spec.drives
    )
    spec = replace(course_spec, drives=drives, gripper=GripperSpec(code="gr"))
    drive = describe_code(spec, "d1")
    assert drive[0] == "d1  right: drive forward (+X)"
    assert "Errors along 5 %, across 2 %, turn 2 % of V" in drive
    assert drive[-1] == "Give   d1-V, such as d1-3 or d1--3"
    assert describe_code(spec, "rot")[-1] == "Give   r1-V, such as r1-90 or r1--90"
    assert "Errors along 5 %, across 2 %, turn 2 % of V" in describe_code(spec, "w1")
    assert describe_code(spec, "gr")[-1] == "Give   gr-1 to close it, gr-0 to open it"


def test_a_code_that_there_is_not_says_which_there_are(course_spec: SimulationSpec) -> None:
    (line,) = describe_code(course_spec, "zz\x1b")
    assert printable(line).startswith("zz\\x1b: no sensor or drive has that code; there are u1 u2")


@pytest.mark.parametrize(
    ("angle", "words"),
    [
        (0, "front"),
        (360, "front"),
        (45, "front left"),
        (-45, "front right"),
        (180, "rear"),
        (270, "right"),
        (100, "about left"),
    ],
)
def test_sides_have_names(angle: float, words: str) -> None:
    assert side_of(angle) == words


@given(st.floats(-720, 720), st.floats(-20, 20), st.floats(-20, 20))
def test_any_place_and_direction_can_be_told(
    course_spec: SimulationSpec, rotation: float, x: float, y: float
) -> None:
    sensor = replace(course_spec.sensors[0], rotation=rotation, x=x, y=y)
    lines = describe_code(replace(course_spec, sensors=(sensor,)), "u1")
    assert all(line.isascii() and line.isprintable() for line in lines)
    assert len([line for line in lines if line.startswith("Looks")]) == 1
