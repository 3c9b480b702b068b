"""A team's robot against the course's rules."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from itertools import zip_longest
from operator import attrgetter
from types import MappingProxyType

import numpy as np
from msgspec import Struct
from shapely import MultiPoint

from simmer_tui.config import drive_csv, robot_csv, sensors_csv, settings_file
from simmer_tui.config.csv_table import ID, plain_rows, rows_by_header
from simmer_tui.config.loader import Configuration
from simmer_tui.config.settings import WheelsSettings
from simmer_tui.dialect.dialect_rules import DialectRules
from simmer_tui.errors import Problem
from simmer_tui.grade.course import Rules
from simmer_tui.sim.columns import GRIPPER, MOVEMENT, CsvColumn
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.specs import DriveSpec, GripperSpec, RobotSpec, SensorSpec, VelocitySpec
from simmer_tui.sim.values import CourseRule

# Judged: the smallest that has room for a controller, two motors and a battery. A point would pass any maze.
SMALLEST_ROBOT = 3.0
"""Width of a team's robot at its narrowest, inches, whatever a course's rules say."""
# Judged: four times what robots of courses have.
MOST_SENSORS = 64
"""Sensors in a team's set, whatever a course's rules say."""
_ROUNDING = 1e-9
"""Difference up to which two numbers are the same, by rounding."""


def rule_problems(rules: Rules, course: Configuration, team: Configuration) -> list[Problem]:
    """All violations of the rules in a team's configuration."""
    return [
        *_cells(rules, course.files, team.files),
        *_bounds(team),
        *_sizes(rules, team),
        *_sensors(course.simulation.sensors, team.simulation.sensors),
        *_places(course, team),
        *_drives(course.simulation.drives, team.simulation.drives),
        *_gripper(course.simulation.gripper, team.simulation.gripper),
        *_velocities(course.simulation.velocities, team.simulation.velocities),
        *_top_speed(course.settings.wheels, team.settings.wheels),
        *(_dialect(team.dialect) if team.dialect is not None else ()),
    ]


def _bounds(team: Configuration) -> Iterable[Problem]:
    """Problems that no course allows: an impossible robot, or one that delays the grading."""
    across = _narrowest(team.simulation.robot)
    if across < SMALLEST_ROBOT - _ROUNDING:
        yield Problem(
            robot_csv.FILE, f"the robot is {across:.2f} in across; at least {SMALLEST_ROBOT:g} are needed"
        )
    number = len(team.simulation.sensors)
    if number > MOST_SENSORS:
        yield Problem(sensors_csv.FILE, f"has {number} sensors; at most {MOST_SENSORS} are allowed")


def _narrowest(robot: RobotSpec) -> float:
    """Least distance, inches, of two parallel lines with the robot between them. One of them then lies along
    an edge of its convex hull (Houle and Toussaint, Computing the width of a set, 1988)."""
    if robot.radius is not None:
        return 2 * robot.radius
    hull = MultiPoint(robot.vertices).convex_hull
    if hull.area == 0.0:
        return 0.0
    corners = np.array(hull.boundary.coords)
    edges = np.diff(corners, axis=0)
    normals = np.column_stack((-edges[:, 1], edges[:, 0])) / np.linalg.norm(edges, axis=1)[:, None]
    return float(np.ptp(corners @ normals.T, axis=0).min())


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
        # A sensor of the course must be at least as good in everything; else the differences to the nearest
        # are shown.
        found = min(([*_better(sensor, model)] for model in of_the_type), key=len)
        yield from (Problem(where, what) for what in found)


def _places(course: Configuration, team: Configuration) -> Iterable[Problem]:
    """Problems with places: a sensor must be on the robot, or no farther out than the course's, as it could
    see past walls."""
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
    """Properties in which a sensor is better than one of the course's, or different."""
    yield from _differences(sensor, model, sensor.kind.columns, limited=sensor.kind.is_range)
    most = max(model.error, 1.0 - model.error)
    if sensor.kind.errs_by_opposite and sensor.error > most + _ROUNDING:
        yield f"its error is above {most:g}: the opposite of its answers would nearly always be right"


def _differences(own: Struct, model: Struct, columns: Iterable[CsvColumn], *, limited: bool) -> Iterable[str]:
    """Messages about the values of a part that the rules of their columns forbid. Of a part that is `limited`
    to a range, a shift must be the same."""
    for column in columns:
        value = attrgetter(column.field)
        rule = CourseRule.SAME if limited and column.course is CourseRule.SHIFT else column.course
        broken = _BROKEN[rule](value(own), value(model))
        if broken:
            yield f"its {column.shown} is {broken} the course's {column.rule.shown(value(model))}"


def _below(own: float, model: float) -> str:
    return "below" if abs(own) < abs(model) - _ROUNDING else ""


def _above(own: float, model: float) -> str:
    """A limit of 0 means that there is none."""
    return "above" if (own or math.inf) > (model or math.inf) + _ROUNDING else ""


def _other(own: float, model: float) -> str:
    return "not" if abs(own - model) > _ROUNDING else ""


_BROKEN: Mapping[CourseRule, Callable[[float, float], str]] = MappingProxyType(
    {
        CourseRule.FREE: lambda own, model: "",
        CourseRule.AT_LEAST: _below,
        CourseRule.SHIFT: _below,
        CourseRule.AT_MOST: _above,
        CourseRule.SAME: _other,
    }
)
"""By rule, the word for a forbidden relation of a team's value to the course's; empty if it is allowed."""


def _drives(course: Iterable[DriveSpec], team: Iterable[DriveSpec]) -> Iterable[Problem]:
    models = {drive.kind: drive for drive in course if drive.enabled}
    for drive in team:
        if not drive.enabled:
            continue
        where, model = f"{drive_csv.FILE}:{drive.kind.value}", models.get(drive.kind)
        if model is None:
            yield Problem(where, "the course's robots do not have this drive")
            continue
        yield from (Problem(where, what) for what in _differences(drive, model, MOVEMENT, limited=False))


def _velocities(course: Iterable[VelocitySpec], team: Iterable[VelocitySpec]) -> Iterable[Problem]:
    kinds = {velocity.kind for velocity in course if velocity.enabled}
    for velocity in team:
        if velocity.enabled and velocity.kind not in kinds:
            where = f"{drive_csv.FILE}:{velocity.kind.value}"
            yield Problem(where, "the course's robots do not know this command")


def _top_speed(course: WheelsSettings, team: WheelsSettings) -> Iterable[Problem]:
    if team.top_speed > course.top_speed + _ROUNDING:
        what = f"the wheels turn at {team.top_speed:g} in/s; at most {course.top_speed:g} are allowed"
        yield Problem(f"{settings_file.FILE}:wheels.top_speed", what)


def _dialect(dialect: DialectRules) -> Iterable[Problem]:
    """Problems with exact values in a dialect that no sensor of the robot measures."""
    for place, name in dialect.without_sensor(("contact",)):
        sensor = f"'{name}' needs a bumper in {sensors_csv.FILE}"
        yield Problem(place, f"{sensor}; write the code of a sensor instead")


def _gripper(course: GripperSpec | None, team: GripperSpec | None) -> Iterable[Problem]:
    if course is None or team is None:
        return
    for what in _differences(team, course, GRIPPER, limited=False):
        yield Problem(f"{drive_csv.FILE}:{drive_csv.GRIPPER_ID}", what)


def _cells(rules: Rules, course: Mapping[str, str], team: Mapping[str, str]) -> Iterable[Problem]:
    for file, columns in rules.cells.items():
        wanted, found = (files.get(file, "").removeprefix("\ufeff") for files in (course, team))
        compare = _robot_cells if file == robot_csv.FILE else _table_cells
        yield from compare(file, columns, wanted, found)


def _robot_cells(file: str, labels: tuple[str, ...], wanted: str, found: str) -> Iterable[Problem]:
    """Problems in robot.csv: the name at the beginning of a row decides if it may change."""
    nothing: list[str] = []
    for model, row in zip_longest(plain_rows(wanted), plain_rows(found), fillvalue=nothing):
        label = (row or model)[0]
        if label not in labels and [*map(_plain, row[1:])] != [*map(_plain, model[1:])]:
            yield Problem(f"{file}:{cut(label)}", "must be the same as in the course's set")


def _table_cells(file: str, columns: tuple[str, ...], wanted: str, found: str) -> Iterable[Problem]:
    """Problems in a file with headings: a row is compared with the course's of the same ID, or else type."""
    models = {row.get(ID, ""): row for row in rows_by_header(wanted)}
    types = {name.rstrip("0123456789"): row for name, row in reversed(models.items())}
    for row in rows_by_header(found):
        name = row.get(ID, "")
        model = models.get(name, types.get(name.rstrip("0123456789"), {}))
        for column in [each for each in {**model, **row} if each not in (ID, *columns)]:
            if _plain(row.get(column, "")) != _plain(model.get(column, "")):
                yield Problem(
                    f"{file}:{cut(name, WORD)}:{cut(column, WORD)}",
                    "must be the same as in the course's set",
                )


def _plain(cell: str) -> str | float:
    """The number in a cell, in any notation; else its text."""
    try:
        return float(cell.replace(",", "."))
    except ValueError:
        return cell
