"""The result of an import, and what both readers need to build it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from simmer_tui.errors import Problem
from simmer_tui.sim.specs import DriveSpec, MazeSpec, RobotSpec, SensorKind, SensorSpec

COURSE_MAZE = MazeSpec(
    ((3, 3, 1, 1, 0, 2, 0, 2), (3, 3, 0, 1, 1, 1, 1, 1), (1, 0, 2, 0, 0, 1, 0, 1), (1, 1, 1, 1, 1, 1, 0, 2))
)
"""The course's maze, for teams that never changed it."""

SettingValue = bool | int | float | str | tuple[float, float] | tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Imported:
    """A configuration set read from another program's files.

    `settings` holds what differs from the defaults, by dotted name (`server.packet_port`). `left_out`
    lists, by file and line, what has no equivalent here and how the set differs for it.
    """

    maze: MazeSpec
    robot: RobotSpec
    sensors: tuple[SensorSpec, ...]
    drives: tuple[DriveSpec, ...]
    settings: Mapping[str, SettingValue]
    left_out: tuple[Problem, ...]


def free_number(kind: type[SensorKind], code: str, taken: Iterable[SensorSpec]) -> int:
    """The number for a sensor's ID: the digit its code ends with if it is free (`u0` is `ultra0`),
    else the lowest free one."""
    numbers = {sensor.number for sensor in taken if sensor.kind is kind}
    if code[-1].isdigit() and int(code[-1]) not in numbers:
        return int(code[-1])
    return next(number for number in range(len(numbers) + 1) if number not in numbers)
