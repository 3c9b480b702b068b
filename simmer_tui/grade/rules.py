"""A team's robot against the course's rules."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping
from itertools import zip_longest
from types import MappingProxyType

from simmer_tui.config import drive_csv, robot_csv, sensors_csv
from simmer_tui.config.loader import Configuration
from simmer_tui.errors import Problem
from simmer_tui.grade.course import Rules
from simmer_tui.sim.command import escape
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.specs import DriveSpec, GripperSpec, SensorSpec

ROBOT_FILES = (robot_csv.FILE, sensors_csv.FILE, drive_csv.FILE)
"""What of a set is the team's; the rest is the course's."""
_LEAST = (
    "error", "absolute_error", "bias", "drift", "min_range", "resolution", "read_time", "dropout", "outlier",
    "cross_talk", "random_walk", "hard_iron", "soft_iron",
)  # fmt: skip
"""Of these a sensor must have at least what the course's have, whatever the sign."""
_MOST = ("max_range", "incidence_limit")
"""Of these at most; 0 stands for no limit."""
_AXES = MappingProxyType({"x": "X-axis", "y": "Y-axis", "r": "rotation"})
_ROUNDING = 1e-9


def rule_problems(rules: Rules, course: Configuration, team: Configuration) -> list[Problem]:
    """Everything that is against the rules in a team's configuration."""
    return [
        *_cells(rules, course.files, team.files),
        *_sizes(rules, team),
        *_sensors(course.simulation.sensors, team.simulation.sensors),
        *_drives(course.simulation.drives, team.simulation.drives),
        *_gripper(course.simulation.gripper, team.simulation.gripper),
    ]


def _sizes(rules: Rules, team: Configuration) -> Iterable[Problem]:
    reach = 2 * Footprint.of(team.simulation.robot).reach
    if rules.size is not None and reach > rules.size + _ROUNDING:
        yield Problem(
            robot_csv.FILE,
            f"the robot needs a circle of {reach:.2f} in around its centre; {rules.size:g} allowed",
        )
    enabled = sum(sensor.enabled for sensor in team.simulation.sensors)
    if rules.sensors is not None and enabled > rules.sensors:
        yield Problem(sensors_csv.FILE, f"{enabled} sensors are enabled; at most {rules.sensors} are allowed")


def _sensors(course: Iterable[SensorSpec], team: Iterable[SensorSpec]) -> Iterable[Problem]:
    models: dict[str, list[SensorSpec]] = {}
    for sensor in course:
        models.setdefault(sensor.kind.name, []).append(sensor)
    for sensor in team:
        if not sensor.enabled:
            continue
        where, model = f"{sensors_csv.FILE}:{sensor.id}", models.get(sensor.kind.name)
        if model is None:
            yield Problem(where, f"the course has no sensors of the type {sensor.kind.name}")
            continue
        for name in _LEAST:
            least = min(abs(getattr(each, name)) for each in model)
            if abs(getattr(sensor, name)) < least - _ROUNDING:
                yield Problem(where, f"its {_shown(name)} is below the course's {least:g}")
        for name in _MOST:
            most = max(getattr(each, name) or math.inf for each in model)
            if (getattr(sensor, name) or math.inf) > most + _ROUNDING:
                yield Problem(where, f"its {_shown(name)} is above the course's {most:g}")


def _drives(course: Iterable[DriveSpec], team: Iterable[DriveSpec]) -> Iterable[Problem]:
    models = {drive.kind: drive for drive in course if drive.enabled}
    for drive in team:
        if not drive.enabled:
            continue
        where, model = f"{drive_csv.FILE}:{drive.kind.value}", models.get(drive.kind)
        if model is None:
            yield Problem(where, "the course's robots have no such drive")
            continue
        for what in ("error", "bias"):
            own, least = getattr(drive, what), getattr(model, what)
            for axis in _AXES:
                if abs(getattr(own, axis)) < abs(getattr(least, axis)) - _ROUNDING:
                    yield Problem(
                        where, f"its {_AXES[axis]} {what} is below the course's {getattr(least, axis):g}"
                    )
        for name in ("speed", "acceleration"):
            most = getattr(model, name) or math.inf
            if (getattr(drive, name) or math.inf) > most + _ROUNDING:
                yield Problem(where, f"its {name} is above the course's {most:g}")
        if drive.start_lag < model.start_lag - _ROUNDING:
            yield Problem(where, f"its start lag is below the course's {model.start_lag:g}")


def _gripper(course: GripperSpec | None, team: GripperSpec | None) -> Iterable[Problem]:
    if course is None or team is None:
        return
    for name in ("reach", "width", "speed"):
        if getattr(team, name) > getattr(course, name) + _ROUNDING:
            most = getattr(course, name)
            yield Problem(f"{drive_csv.FILE}:grip", f"its {name} is above the course's {most:g}")


def _cells(rules: Rules, course: Mapping[str, str], team: Mapping[str, str]) -> Iterable[Problem]:
    for file, columns in rules.cells.items():
        if file in ROBOT_FILES:
            wanted, found = _rows(course.get(file, "")), _rows(team.get(file, ""))
            compare = _robot_cells if file == robot_csv.FILE else _table_cells
            yield from compare(file, columns, wanted, found)


def _robot_cells(
    file: str, labels: tuple[str, ...], wanted: list[list[str]], found: list[list[str]]
) -> Iterable[Problem]:
    """robot.csv: what may change is given by the name at the beginning of a row."""
    nothing: list[str] = []
    for model, row in zip_longest(wanted, found, fillvalue=nothing):
        label = (row or model)[0]
        if label not in labels and [*map(_plain, row[1:])] != [*map(_plain, model[1:])]:
            yield Problem(f"{file}:{escape(label, 60)}", "may not differ from the course's")


def _table_cells(
    file: str, columns: tuple[str, ...], wanted: list[list[str]], found: list[list[str]]
) -> Iterable[Problem]:
    """A file with headings: a row is compared with the course's of the same ID, or else type."""
    models = {row["ID"]: row for row in _tables(wanted)}
    types = {name.rstrip("0123456789"): row for name, row in reversed(models.items())}
    for row in _tables(found):
        name = row["ID"]
        model = models.get(name, types.get(name.rstrip("0123456789"), {}))
        for column in [each for each in {**model, **row} if each not in ("ID", *columns)]:
            if _plain(row.get(column, "")) != _plain(model.get(column, "")):
                yield Problem(
                    f"{file}:{escape(name, 30)}:{escape(column, 40)}", "may not differ from the course's"
                )


def _rows(text: str) -> list[list[str]]:
    rows = [[cell.strip() for cell in row] for row in csv.reader(io.StringIO(text.lstrip("\ufeff")))]
    return [row for row in rows if any(row) and not row[0].startswith("#")]


def _tables(rows: list[list[str]]) -> list[dict[str, str]]:
    head = rows[0] if rows else []
    return [{"ID": "", **dict(zip(head, row, strict=False))} for row in rows[1:]]


def _plain(cell: str) -> str | float:
    """A number, however it is written; else the text."""
    try:
        return float(cell)
    except ValueError:
        return cell


def _shown(name: str) -> str:
    return name.replace("_", " ")
