"""Writes an import as a configuration set: four CSV files and settings.toml."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path

from simmer_tui.config import drive_csv, maze_csv, robot_csv, sensors_csv, settings_file
from simmer_tui.config.sets import write_files
from simmer_tui.config.settings import Setting, all_settings
from simmer_tui.importer.imported import Imported, SettingValue
from simmer_tui.sim.columns import BASE, FIELD_OF_VIEW, THRESHOLD
from simmer_tui.sim.sensors import sensor_kinds
from simmer_tui.sim.specs import DriveSpec, GripperSpec, RobotSpec, SensorSpec


def set_files(imported: Imported) -> dict[str, bytes]:
    """The five files of the set, by name."""
    texts = {
        maze_csv.FILE: _csv(imported.maze.cells),
        robot_csv.FILE: _csv(_robot_rows(imported.robot)),
        sensors_csv.FILE: sensors_csv_text(imported.sensors),
        drive_csv.FILE: drive_csv_text(imported.drives),
        settings_file.FILE: settings_text(imported.settings),
    }
    return {name: text.encode() for name, text in texts.items()}


def write_set(imported: Imported, directory: Path) -> tuple[Path, ...]:
    """Write the five files into `directory`, which is made if need be; returns their paths.

    Raises ConfigurationError, before anything is written, if a file would be overwritten, or if
    the folder cannot be written.
    """
    return write_files(directory, set_files(imported))


def sensors_csv_text(specs: tuple[SensorSpec, ...]) -> str:
    """sensors.csv for these sensors."""
    return _csv(_sensor_rows(specs))


def drive_csv_text(specs: tuple[DriveSpec, ...], gripper: GripperSpec | None = None) -> str:
    """drive.csv for these drives."""
    rows = _drive_rows(specs)
    if gripper is not None:
        _, speed = drive_csv.OPTIONAL_HEADERS
        made: dict[float | str, float | str] = dict.fromkeys(rows[0], "")
        made |= zip(drive_csv.HEADERS, (drive_csv.GRIPPER, gripper.code, int(gripper.enabled)), strict=False)
        made |= {speed: gripper.speed}
        made |= zip(drive_csv.GRIPPER_HEADERS, (gripper.reach, gripper.width), strict=True)
        for row in rows[1:]:
            row += ["", ""]
        rows[0] += drive_csv.GRIPPER_HEADERS
        rows.append([*made.values()])
    return _csv(rows)


def _csv(rows: Iterable[Iterable[float | str]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue()


def _cell(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def _robot_rows(spec: RobotSpec) -> list[list[float | str]]:
    label, first, second = (
        "Shape (0 circle / 1 rectangle / 2 polygon)",
        "Diameter or x-size (in)",
        "y-size (in)",
    )
    if spec.radius is not None:
        return [[label, 0], [first, 2 * spec.radius], [second, 2 * spec.radius]]
    x, y = spec.vertices[0]
    if spec == RobotSpec.rectangle(2 * x, 2 * y):
        return [[label, 1], [first, 2 * x], [second, 2 * y]]
    rows: list[list[float | str]] = [[label, 2]]
    rows += [["vertex x, y (in)", x, y] for x, y in spec.vertices]
    return rows


def _sensor_rows(specs: tuple[SensorSpec, ...]) -> list[list[float | str]]:
    optional = [_optional_cells(spec) for spec in specs]
    present = {header for cells in optional for header in cells}
    kinds = sensor_kinds(*(spec.kind for spec in specs))
    columns = [header for header in sensors_csv.optional_headers(kinds) if header in present]
    rows: list[list[float | str]] = [[*sensors_csv.HEADERS, *columns]]
    for spec, cells in zip(specs, optional, strict=True):
        rows.append(
            [
                *(spec.id, spec.code, int(spec.enabled), spec.x, spec.y, spec.z, spec.rotation, spec.error),
                *(_own(spec, field) for field in (FIELD_OF_VIEW.field, THRESHOLD.field)),
                *(cells.get(header, "") for header in columns),
            ]
        )
    return rows


def _own(spec: SensorSpec, field: str) -> float | str:
    """The value of a field, blank where its kind makes nothing of it."""
    return getattr(spec, field) if spec.kind.has(field) else ""


def _optional_cells(spec: SensorSpec) -> dict[str, float | str]:
    """The optional columns in which a sensor differs from one whose cells are blank."""
    plain = spec.kind.spec_type(kind=spec.kind, number=0, code="")
    cells: dict[str, float | str] = {}
    for column in spec.kind.columns:
        value = getattr(spec, column.field)
        blank = getattr(plain, column.field) if column.default is None else column.default
        if column not in BASE and not column.needed and value != blank:
            cells[column.name] = column.rule.shown(value) if isinstance(value, bool) else value
    return cells


def _drive_rows(specs: tuple[DriveSpec, ...]) -> list[list[float | str]]:
    paced = any(spec.start_lag or spec.acceleration for spec in specs)
    more = drive_csv.PACE_HEADERS if paced else ()
    rows: list[list[float | str]] = [[*drive_csv.HEADERS, *drive_csv.OPTIONAL_HEADERS, *more]]
    rows.extend(
        [
            *(spec.kind.value, spec.code, int(spec.enabled)),
            *(spec.error.y, spec.error.x, spec.error.r, spec.bias.y, spec.bias.x, spec.bias.r),
            *(spec.gain, spec.speed),
            *((spec.start_lag, spec.acceleration) if paced else ()),
        ]
        for spec in specs
    )
    return rows


def settings_text(values: Mapping[str, SettingValue]) -> str:
    """settings.toml with every setting and what it means, `values` (by dotted name) in place of
    the defaults. Raises KeyError for a name that is no setting."""
    known = {item.name: item for item in all_settings()}
    for name in values:
        known[name]
    lines = ["# Settings of the simulator. Every one has a command-line option too, and the option wins."]
    table = ""
    for item in known.values():
        head, _, key = item.name.rpartition(".")
        lines.append("")
        if head != table:
            table = head
            lines += [f"[{table}]"]
        lines += [_comment(item), f"{key} = {_toml(values.get(item.name, item.default))}"]
    return "\n".join(lines) + "\n"


def _comment(item: Setting) -> str:
    unit = f", {item.unit}" if item.unit else ""
    return f"# {item.help[0].upper()}{item.help[1:]}: {item.rule.allowed}{unit}."


def _toml(value: SettingValue) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml(item) for item in value)}]"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    return repr(value)
