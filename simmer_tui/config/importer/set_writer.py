"""Writes an import as a configuration set: four CSV files and settings.toml."""

from collections.abc import Iterable, Iterator, Sequence
from operator import attrgetter
from pathlib import Path

from msgspec import Struct

from simmer_tui.config import drive_csv, maze_csv, robot_csv, sensors_csv, settings_file
from simmer_tui.config.csv_table import CODE, ENABLED, ID, csv_text
from simmer_tui.config.importer.imported import Imported
from simmer_tui.config.sets import write_files
from simmer_tui.config.settings_file import settings_text
from simmer_tui.sim.columns import (
    BASE,
    FIELD_OF_VIEW,
    GRIPPER,
    LESS_USUAL,
    MOVEMENT,
    REACH,
    THRESHOLD,
    WIDTH,
    CsvColumn,
)
from simmer_tui.sim.sensors import sensor_kinds
from simmer_tui.sim.specs import DriveSpec, GripperSpec, RobotSpec, SensorSpec, VelocityKind, VelocitySpec


def set_files(imported: Imported) -> dict[str, bytes]:
    """The five files of the set, by name."""
    texts = {
        maze_csv.FILE: _csv(imported.maze.cells),
        robot_csv.FILE: _csv(_robot_rows(imported.robot)),
        sensors_csv.FILE: sensors_csv_text(imported.sensors),
        drive_csv.FILE: drive_csv_text(imported.drives, velocities=_velocities(imported)),
        settings_file.FILE: settings_text(imported.settings),
    }
    return {name: text.encode() for name, text in texts.items()}


def _velocities(imported: Imported) -> tuple[VelocitySpec, ...]:
    """The commands of continuous motion, under the codes of the bundled sets where these are free."""
    taken = {sensor.code for sensor in imported.sensors} | {drive.code for drive in imported.drives}
    codes = zip(VelocityKind, drive_csv.VELOCITY_CODES, strict=True)
    return tuple(VelocitySpec(kind=kind, code=code) for kind, code in codes if code not in taken)


def write_set(imported: Imported, directory: Path) -> tuple[Path, ...]:
    """Write the five files into `directory`, which is created if necessary; returns their paths.

    Raises ConfigurationError, before anything is written, if a file would be overwritten, or if
    the folder cannot be written.
    """
    return write_files(directory, set_files(imported))


def sensors_csv_text(specs: tuple[SensorSpec, ...]) -> str:
    """sensors.csv for these sensors."""
    optional = [_optional_cells(spec) for spec in specs]
    present = {header for cells in optional for header in cells}
    kinds = sensor_kinds(*(spec.kind for spec in specs))
    headers = [header for header in sensors_csv.optional_headers(kinds) if header in present]
    rows: list[list[float | str]] = [[*sensors_csv.HEADERS, *headers]]
    for spec, cells in zip(specs, optional, strict=True):
        # Every row has its sensor's place, even if that has no effect.
        used = [each for each in BASE if each not in (FIELD_OF_VIEW, THRESHOLD) or spec.kind.has(each.field)]
        fixed = _cells(spec, (CODE, ENABLED, *BASE), tuple(used))
        rows.append([spec.id, *fixed, *(cells.get(header, "") for header in headers)])
    return _csv(rows)


def drive_csv_text(
    specs: tuple[DriveSpec, ...], gripper: GripperSpec | None = None, velocities: Sequence[VelocitySpec] = ()
) -> str:
    """drive.csv for these drives, without optional columns that are not used here."""
    unused = [] if any(getattr(spec, each.field) for spec in specs for each in LESS_USUAL) else [*LESS_USUAL]
    unused += [REACH, WIDTH] if gripper is None else []
    _, *columns = (column for column in drive_csv.COLUMNS if column not in unused)
    rows: list[list[float | str]] = [[ID, *(column.name for column in columns)]]
    rows += [[spec.kind.value, *_cells(spec, columns, MOVEMENT)] for spec in specs]
    if gripper is not None:
        rows.append([drive_csv.GRIPPER_ID, *_cells(gripper, columns, GRIPPER)])
    rows += [[each.kind.value, *_cells(each, columns, ())] for each in velocities]
    return _csv(rows)


def _cells(spec: Struct, columns: Iterable[CsvColumn], used: tuple[CsvColumn, ...]) -> Iterator[float | str]:
    """The cells of a row under some columns, blank where the row does not use one."""
    for column in columns:
        yield attrgetter(column.field)(spec) if column in (CODE, ENABLED, *used) else ""


def _csv(rows: Iterable[Iterable[float | str]]) -> str:
    return csv_text([_cell(value) for value in row] for row in rows)


def _cell(value: float | str) -> str:
    if isinstance(value, str):
        return value
    # Whole numbers without `.0`, as people write them; repr keeps other numbers exact.
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def _robot_rows(spec: RobotSpec) -> list[list[float | str]]:
    label, (_, first, second, _) = "Shape (0 circle / 1 rectangle / 2 polygon)", robot_csv.ROWS
    if spec.radius is not None:
        return [[label, 0], [first, 2 * spec.radius], [second, 2 * spec.radius]]
    x, y = spec.vertices[0]
    if spec == RobotSpec.rectangle(2 * x, 2 * y):
        return [[label, 1], [first, 2 * x], [second, 2 * y]]
    rows: list[list[float | str]] = [[label, 2]]
    rows += [["vertex x, y (in)", x, y] for x, y in spec.vertices]
    return rows


def _optional_cells(spec: SensorSpec) -> dict[str, float | str]:
    """The optional columns with values that differ from those of blank cells."""
    plain = spec.kind.spec_type(kind=spec.kind, number=0, code="")
    cells: dict[str, float | str] = {}
    for column in spec.kind.columns:
        value = getattr(spec, column.field)
        blank = getattr(plain, column.field) if column.default is None else column.default
        if column not in BASE and not column.needed and value != blank:
            cells[column.name] = column.rule.shown(value) if isinstance(value, bool) else value
    return cells
