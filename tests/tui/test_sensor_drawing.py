"""The small drawing of where a sensor sits."""

from __future__ import annotations

from simmer_tui.sim.sensors import Ultrasonic
from simmer_tui.sim.specs import RobotSpec, SensorSpec, SimulationSpec
from simmer_tui.tui.sensor_drawing import sensor_drawing


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
    sensor = SensorSpec(kind=Ultrasonic, number=1, code="u1", x=20.0, y=-9.0, rotation=200.0)
    for robot in (RobotSpec.circle(40.0), RobotSpec.rectangle(30.0, 2.0), RobotSpec.circle(0.5)):
        lines = sensor_drawing(robot, sensor)
        assert max(map(len, lines)) <= 25
        assert sum(line.count("#") for line in lines) == 1
