"""A small drawing of the robot from above, its front up: where a sensor sits and which way it looks."""

from __future__ import annotations

import math

from simmer_tui.sim.specs import RobotSpec, SensorSpec

_COLUMNS, _ROWS = 25, 11
_PER_INCH = 2.0
"""Columns an inch for a robot of the usual size; half as many rows."""
_ROOM = 7.0
"""Inches shown to either side of the middle of such a robot."""
_BEAM = (".", 2.5)
"""The sign of what it looks along, and how many inches of it are drawn."""
_OUTLINE_STEPS = 240


def sensor_drawing(robot: RobotSpec, sensor: SensorSpec) -> list[str]:
    """Lines of ASCII: the outline `o`, the middle `+`, the sensor `#` and what it looks along."""
    grid = [[" "] * _COLUMNS for _ in range(_ROWS)]
    reach = robot.radius or max((math.hypot(*vertex) for vertex in robot.vertices), default=3.0)
    scale = _PER_INCH * min(1.0, (_ROOM - _BEAM[1]) / max(reach, math.hypot(sensor.x, sensor.y), 0.1))

    def put(x: float, y: float, sign: str) -> None:
        """A sign at a place in the robot's frame, x ahead and y left."""
        row, column = round(_ROWS // 2 - x * scale / 2), round(_COLUMNS // 2 - y * scale)
        if 0 <= row < _ROWS and 0 <= column < _COLUMNS:
            grid[row][column] = sign

    for x, y in _outline(robot):
        put(x, y, "o")
    put(0.0, 0.0, "+")
    if sensor.kind.has("rotation"):
        angle = math.radians(sensor.rotation)
        for step in range(1, 11):
            along = step * _BEAM[1] / 10
            put(sensor.x + along * math.cos(angle), sensor.y + along * math.sin(angle), _BEAM[0])
    put(sensor.x, sensor.y, "#")
    lines = ["".join(row).rstrip() for row in grid]
    return [" " * (_COLUMNS // 2 - 2) + "front", *(line for line in lines if line)]


def _outline(robot: RobotSpec) -> list[tuple[float, float]]:
    if robot.radius is not None:
        turns = [2 * math.pi * step / _OUTLINE_STEPS for step in range(_OUTLINE_STEPS)]
        return [(robot.radius * math.cos(turn), robot.radius * math.sin(turn)) for turn in turns]
    points = []
    ends = (*robot.vertices[1:], robot.vertices[0])
    for (x, y), (to_x, to_y) in zip(robot.vertices, ends, strict=True):
        parts = [step / _OUTLINE_STEPS for step in range(_OUTLINE_STEPS)]
        points += [(x + part * (to_x - x), y + part * (to_y - y)) for part in parts]
    return points
