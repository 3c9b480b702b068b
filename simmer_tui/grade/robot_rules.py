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
    "error", "absolute_error", "min_range", "read_time", "dropout", "outlier", "cross_talk", "random_walk",
)  # fmt: skip
"""Of these a sensor must have at least what the course's has."""
_MOST = ("max_range", "incidence_limit", "ticks_per_inch")
"""Of these at most; 0 stands for no limit."""
_SAME = (
    "gain", "wrap", "hard_iron", "soft_iron", "analog", "rays", "field_of_view", "vertical_field_of_view",
)  # fmt: skip
"""These it must have as the course's: with a great gain, or much iron around a compass, the errors that
come after it are small."""
_SHIFTS = ("bias", "drift", "resolution")
"""These at least, whatever the sign; but where a range is limited as the course's, for they bring into it
what lies beyond."""
FREE = ("kind", "number", "code", "enabled", "x", "y", "z", "rotation", "threshold", "detects_white")
"""These say how it is mounted and adjusted, which is the team's."""
JUDGED = (*_LEAST, *_MOST, *_SAME, *_SHIFTS)
_AXES = MappingProxyType({"x": "X-axis", "y": "Y-axis", "r": "rotation"})
_ROUNDING = 1e-9


def rule_problems(rules: Rules, course: Configuration, team: Configuration) -> list[Problem]:
    """Everything that is against the rules in a team's configuration."""
    return [
        *_cells(rules, course.files, team.files),
        *_sizes(rules, team),
        *_sensors(course.simulation.sensors, team.simulation.sensors),
        *_places(course, team),
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
        where, of_the_type = f"{sensors_csv.FILE}:{sensor.id}", models.get(sensor.kind.name)
        if of_the_type is None:
            yield Problem(where, f"the course has no sensors of the type {sensor.kind.name}")
            continue
        # One of the course's that it is no better than, in anything; else what keeps it from the nearest.
        found = min(([*_better(sensor, model)] for model in of_the_type), key=len)
        yield from (Problem(where, what) for what in found)


def _places(course: Configuration, team: Configuration) -> Iterable[Problem]:
    """A sensor is on the robot, or no farther out than the course's: from afar it would see past walls."""
    most = max(
        Footprint.of(team.simulation.robot).reach,
        *(math.hypot(each.x, each.y) for each in course.simulation.sensors),
        0.0,
    )
    for sensor in team.simulation.sensors:
        out = math.hypot(sensor.x, sensor.y)
        if sensor.enabled and sensor.kind.has("x") and out > most + _ROUNDING:
            yield Problem(
                f"{sensors_csv.FILE}:{sensor.id}",
                f"it is {out:.2f} in from the robot's centre; at most {most:.2f} are allowed",
            )


def _better(sensor: SensorSpec, model: SensorSpec) -> Iterable[str]:
    """In what a sensor is better than one of the course's, or works otherwise."""
    shifts: tuple[str, ...] = () if sensor.kind.is_range else _SHIFTS
    for name in (*_LEAST, *shifts):
        own, least = abs(getattr(sensor, name)), abs(getattr(model, name))
        if own < least - _ROUNDING:
            yield f"its {_shown(name)} is below the course's {least:g}"
    if _errs_by_opposite(sensor) and 1.0 - sensor.error < min(model.error, 0.5) - _ROUNDING:
        yield f"its error is above {1.0 - model.error:g}: a sensor that is always wrong is always right"
    for name in _MOST:
        own, most = getattr(sensor, name) or math.inf, getattr(model, name) or math.inf
        if own > most + _ROUNDING:
            yield f"its {_shown(name)} is above the course's {most:g}"
    for name in _SAME if shifts else (*_SAME, *_SHIFTS):
        own, wanted = getattr(sensor, name), getattr(model, name)
        if abs(own - wanted) > _ROUNDING:
            said = ("digital", "analog")[wanted] if name == "analog" else f"{wanted:g}"
            yield f"its {_shown(name)} is not the course's {said}"


def _errs_by_opposite(sensor: SensorSpec) -> bool:
    """Whether its error is how often it says the opposite (a line sensor's is one of what it measures)."""
    return sensor.kind.is_yes_or_no and not sensor.kind.has("threshold")


def _drives(course: Iterable[DriveSpec], team: Iterable[DriveSpec]) -> Iterable[Problem]:
    models = {drive.kind: drive for drive in course if drive.enabled}
    for drive in team:
        if not drive.enabled:
            continue
        where, model = f"{drive_csv.FILE}:{drive.kind.value}", models.get(drive.kind)
        if model is None:
            yield Problem(where, "the course's robots have no such drive")
            continue
        for axis, shown in _AXES.items():
            own, least = getattr(drive.error, axis), getattr(model.error, axis)
            if own < least - _ROUNDING:
                yield Problem(where, f"its {shown} error is below the course's {least:g}")
            # Not more either: an error grows with 1 + bias, and a bias of -1 takes it away.
            own, wanted = getattr(drive.bias, axis), getattr(model.bias, axis)
            if abs(own - wanted) > _ROUNDING:
                yield Problem(where, f"its {shown} bias is not the course's {wanted:g}")
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
    return "answer" if name == "analog" else name.replace("_", " ")
