"""The small drawing of where a sensor sits."""

from __future__ import annotations

from msgspec.structs import replace

from simmer_tui.config.robot_drawing import robot_drawing, sensor_drawing
from simmer_tui.sim.sensors import Ultrasonic, UltrasonicSpec
from simmer_tui.sim.specs import RobotSpec, SimulationSpec


def test_the_front_is_up_and_the_sensor_stands_where_it_sits(course_spec: SimulationSpec) -> None:
    by_code = {sensor.code: sensor for sensor in course_spec.sensors}
    places = {"u1": (-1, 0), "u2": (-1, -1), "u3": (1, 0), "u4": (-1, 1)}
    for code, (row_sign, column_sign) in places.items():
        lines = sensor_drawing(course_spec.robot, by_code[code])
        [(row, column)] = [(r, line.index("#")) for r, line in enumerate(lines) if "#" in line]
        [(middle, centre)] = [(r, line.index("+")) for r, line in enumerate(lines) if "+" in line]
        assert (row > middle) - (row < middle) == row_sign
        assert (column > centre) - (column < centre) == column_sign
        assert "." in "".join(lines)


def test_any_robot_fits() -> None:
    sensor = UltrasonicSpec(kind=Ultrasonic, number=1, code="u1", x=20.0, y=-9.0, rotation=200.0)
    for robot in (RobotSpec.circle(40.0), RobotSpec.rectangle(30.0, 2.0), RobotSpec.circle(0.5)):
        lines = sensor_drawing(robot, sensor)
        assert max(map(len, lines)) <= 25
        assert sum(line.count("#") for line in lines) == 1


def test_the_whole_robot_has_every_sensor_on_its_side_and_in_words(course_spec: SimulationSpec) -> None:
    lines = robot_drawing(course_spec)
    beside = next(line.index("u1 u5 ") for line in lines if "u1 u5  " in line)
    words = {line[beside:].split("  ")[0]: line for line in lines if line[beside:].strip()}
    assert "ultrasonic range, 45 deg left" in words["u2"]
    assert "ultrasonic range, 45 deg right" in words["u4"]
    assert "wheel encoder, front" in words["o3 o4"]
    assert "line sensor" in words["i1 to i4"]
    assert "d1-V" in words
    assert max(map(len, lines)) <= 74  # as much as the help shows at 80 columns
    pictures = [line[:beside] for line in lines]
    codes = " ".join(pictures).split()
    for sensor in course_spec.sensors:
        assert codes.count(sensor.code) == (sensor.kind.has("x")), sensor.code
    left = next(line for line in pictures if "u2" in line)
    assert left.index("u2") < left.index("o1") < left.index("u4")
    assert "".join(pictures).count("\N{NORTH WEST ARROW}") == 1
    assert "\n".join(robot_drawing(course_spec, ascii_only=True)).isascii()


def test_sensors_that_are_off_are_left_out(course_spec: SimulationSpec) -> None:
    off = tuple(replace(sensor, enabled=False) for sensor in course_spec.sensors)
    text = "\n".join(robot_drawing(replace(course_spec, sensors=off)))
    assert "u1" not in text
