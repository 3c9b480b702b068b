"""A configuration as tables, for programs: `check --json`. Keys carry the units of the values."""

from collections.abc import Iterable, Iterator, Sequence
from operator import attrgetter

from msgspec.structs import astuple, replace

from simmer_tui.config import mission_toml
from simmer_tui.config.loader import Configuration
from simmer_tui.config.mission_toml import Heading, MissionSpec
from simmer_tui.config.set_warnings import set_warnings
from simmer_tui.config.settings import Setting, all_settings, value_of
from simmer_tui.dialect.inverse import InverseRules
from simmer_tui.dialect.messages import dictionary
from simmer_tui.document.formats import PLACE, POSE, TEXT
from simmer_tui.document.model import ABSENT, DataColumn, DataTable, Document, data_table
from simmer_tui.errors import Problem
from simmer_tui.sim import columns
from simmer_tui.sim.columns import CsvColumn, column_name
from simmer_tui.sim.command import cut
from simmer_tui.sim.rules import PairRule
from simmer_tui.sim.sensors import KINDS
from simmer_tui.sim.specs import CELL_SIZE, SensorSpec
from simmer_tui.sim.values import Value

_HEADING = "heading"
_FORMATS = dict.fromkeys(("start", "block", "drop_zone"), PLACE)


def _key(name: str, unit: str) -> str:
    unit = unit.replace("/", "_per_").replace(" ", "_").lower()
    return f"{name}_{unit}" if unit else name


def _value_key(value: CsvColumn) -> str:
    # An axis of an error has no field of its own.
    name = column_name(value.name) if "." in value.field else value.field
    # The unit of the reading, or of the drive, has its own column.
    return f"{name}_per_{value.per_time}" if value.per_time else _key(name, value.unit)


def _columns(names: str, values: Iterable[CsvColumn] = ()) -> tuple[DataColumn, ...]:
    """Columns of these names, and of the values of a part by their fields."""
    return (
        *(DataColumn(name, _FORMATS.get(name, TEXT)) for name in names.split()),
        *(DataColumn(_value_key(value)) for value in values),
    )


def _mission_columns() -> Iterator[DataColumn]:
    """A column for each key of mission.toml; a heading is a number, or drawn."""
    for key in mission_toml.KEYS:
        yield DataColumn(_key(key.name, key.unit), _FORMATS.get(key.name, TEXT))
        if key.name == _HEADING:
            yield DataColumn("heading_drawn")


def _mission_values(mission: MissionSpec) -> Iterator[object]:
    for key in mission_toml.KEYS:
        value = getattr(mission, key.field)
        if key.name == _HEADING:
            yield from (None, value) if isinstance(value, Heading) else (value, None)
        else:
            yield value


_SENSOR_VALUES = tuple(
    {column.field: column for kind in KINDS.values() for column in (*columns.BASE, *kind.columns)}.values()
)
CHECK = data_table("check", "The set", *_columns("ok name directory"), record=True)
PROBLEMS = data_table("problems", "Its mistakes", *_columns("where text"))
WARNINGS = data_table("warnings", "Warnings", *_columns("text"))
_MAZE = data_table(
    "maze", "The maze, the first row on top", *_columns("cell_size_in cells floor"), record=True
)
_ROBOT = data_table(
    "robot",
    "The robot's outline, a circle or a polygon, and its start",
    *_columns("radius_in vertices_in"),
    DataColumn("start", POSE),
    record=True,
)
_BLOCK = data_table(
    "block", "The block", DataColumn("centre", PLACE), *_columns("size_in solid"), record=True
)
_SENSORS = data_table(
    "sensors",
    "Sensors, each with the values of its kind",
    *_columns("id code kind enabled unit", _SENSOR_VALUES),
)
_DEVICES = data_table(
    "devices",
    "Device files of the set's own; one that was not run was only parsed",
    *_columns("path sha256 trusted ran kinds unfinished"),
)
_DRIVES = data_table("drives", "Drives", *_columns("id code enabled unit", columns.MOVEMENT))
_GRIPPER = data_table("gripper", "The gripper", *_columns("code enabled", columns.GRIPPER), record=True)
VELOCITIES = data_table("velocities", "Commands of continuous motion", *_columns("id code enabled"))
_MISSION = data_table(
    "mission",
    "The mission; null for a value that each run draws from its seed",
    *_mission_columns(),
    record=True,
)
_MESSAGES = data_table("messages", "Messages of the dialect", *_columns("message does reply"))
TURNED = data_table(
    "real_robot", "Commands that a real robot is sent by the dialect", *_columns("command message")
)
DIFFERENCES = data_table(
    "differences", "Lines of an exchange in which the dialect answers otherwise", *_columns("line text")
)
TABLES = (
    *(CHECK, PROBLEMS, WARNINGS, _MAZE, _ROBOT, _BLOCK, _SENSORS, _DEVICES, _DRIVES, _GRIPPER, VELOCITIES),
    *(_MISSION, _MESSAGES, TURNED, DIFFERENCES),
)


def settings_table() -> DataTable:
    """The table of all settings, without rows. A function, because an added dialect has settings of its
    own."""
    return data_table("settings", "Settings", *map(_setting_column, all_settings()), record=True)


def _setting_column(setting: Setting) -> DataColumn:
    name = setting.name.replace(".", "_")
    if setting.unit == "in" and isinstance(setting.rule, PairRule):
        return DataColumn(name, PLACE)
    return DataColumn(_key(name, setting.unit))


def problems_document(problems: Iterable[Problem]) -> Document:
    """The mistakes of a set that cannot be used."""
    rows = [(problem.where, problem.what) for problem in problems]
    return Document("Set", [CHECK.filled([(False, None, None)]), PROBLEMS.filled(rows)])


def set_document(configuration: Configuration, sketch_problems: Sequence[Problem] = ()) -> Document:
    """A whole set as tables, with the problems of its wiring and sketches."""
    spec, settings, mission = configuration.simulation, configuration.settings, configuration.mission
    start = spec.start_pose
    drives = [
        (each.kind.value, each.code, each.enabled, each.kind.unit, *_values(each, columns.MOVEMENT))
        for each in spec.drives
    ]
    parts = [
        CHECK.filled([(not sketch_problems, configuration.name, str(configuration.directory))]),
        PROBLEMS.filled([(problem.where, problem.what) for problem in sketch_problems]),
        WARNINGS.filled([(each,) for each in set_warnings(configuration)]),
        _MAZE.filled([(CELL_SIZE, spec.maze.cells, spec.maze.floor)]),
        _ROBOT.filled([(spec.robot.radius, spec.robot.vertices, start)]),
        _BLOCK.filled([(spec.block_center, spec.block_size, spec.block_solid)]),
        _sensors_table(spec.sensors),
        _DRIVES.filled(drives),
        settings_table().filled([[value_of(settings, each.name) for each in all_settings()]]),
    ]
    if configuration.device_statuses:
        parts.append(_DEVICES.filled([astuple(each) for each in configuration.device_statuses]))
    gripper = spec.gripper
    if gripper is not None:
        parts.append(_GRIPPER.filled([(gripper.code, gripper.enabled, *_values(gripper, columns.GRIPPER))]))
    if spec.velocities:
        rows = [(each.kind.value, each.code, each.enabled) for each in spec.velocities]
        parts.append(VELOCITIES.filled(rows))
    if mission is not None:
        parts.append(_MISSION.filled([tuple(_mission_values(mission))]))
    if configuration.dialect is not None:
        parts.append(_MESSAGES.filled(list(dictionary(configuration.dialect))))
        parts.append(TURNED.filled(list(InverseRules(configuration.dialect).dictionary())))
    return Document("Set", parts)


def _sensors_table(sensors: Sequence[SensorSpec]) -> DataTable:
    """The table of sensors, with the columns of the set's own devices after the others. A row has values
    under the columns of its kind."""
    keys = {key for column in _SENSORS.columns for key in column.keys}
    own = {column.field: column for sensor in sensors for column in sensor.kind.columns}
    further = [column for column in own.values() if _value_key(column) not in keys]
    names = [value.field for value in (*_SENSOR_VALUES, *further)]
    rows = [
        (
            *(each.id, each.code, each.kind.name, each.enabled, each.unit),
            *(_plain(getattr(each, name)) if each.kind.has(name) else ABSENT for name in names),
        )
        for each in sensors
    ]
    return replace(_SENSORS, columns=(*_SENSORS.columns, *_columns("", further)), rows=rows)


def _plain(value: object) -> object:
    """A value for JSON; those of a device's own types as text."""
    return value if value is None or type(value) in (bool, int, float) else cut(str(value))


def _values(spec: object, values: Iterable[Value]) -> list[object]:
    """Values of a drive or the gripper."""
    return [attrgetter(value.field)(spec) for value in values]
