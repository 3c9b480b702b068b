"""Import of a simmer-python `config.py`.

Frames there: x to the right and y *down* from the maze's top-left corner, the robot's front is its
+y and its left is its +x, angles turn clockwise. Here, with H the maze's height, a place (x, y) is
(x, H - y), a place on the robot (x, y) is (y, x), a turn R is -R and the start rotation R is the
heading -R - 90.
"""

import math
import re
from pathlib import Path
from typing import Any

from simmer_tui.config.device_outline import python_tree
from simmer_tui.config.importer.device_classes import read_device_classes
from simmer_tui.config.importer.imported import (
    COURSE_MAZE,
    Imported,
    Notes,
    OwnDevice,
    SettingValue,
    pair,
    settled,
)
from simmer_tui.config.importer.literal import read_module, read_source
from simmer_tui.config.importer.python_names import Source
from simmer_tui.config.importer.python_values import Call, Class, Function, Located, Reference, Unreadable
from simmer_tui.config.importer.simmer_python_devices import coded, is_code
from simmer_tui.config.importer.simmer_python_drives import read_drives
from simmer_tui.config.importer.simmer_python_sensors import Surroundings, read_sensors
from simmer_tui.config.maze_csv import CELLS, MAX_CELLS
from simmer_tui.config.robot_csv import outline_fault
from simmer_tui.config.settings import all_settings
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.rules import FlagRule, NumberRule, Rule, describe
from simmer_tui.sim.specs import EMPTY, DriveSpec, MazeSpec, RobotSpec

FILE = "config.py"

_KNOWN = {item.name: item for item in all_settings()}
# Names whose value is used unchanged, with their setting.
_DIRECT = {
    "block_size": "blocksize",
    "num_segments": "num_segments",
    "step_time": "step_time",
    "rand_error": "randerror",
    "error_seed": "seed",
    "strength": "strength",
    "bias_strength": "strength",
    "plot_robot": "plot_robot",
    "plot_sense": "plot_sense",
    "host": "server.host",
    "port_rx": "server.packet_port",
    "port_tx": "server.packet_reply_port",
}
# Names of the settings that are places; where a file has two, the last one counts.
_PLACES = {"bot_center": ("start_position", "robot_start_position"), "block_center": ("block_position",)}
# Names that identify a `config.py`, in addition to its tables of devices.
_SIGNS = (
    *("walls", "robot_outline", "wall_segment_length", "floor_segment_length", "block_size"),
    *("robot_start_position", "start_position", "robot_start_rotation", "start_rotation", "block_position"),
)
# Tables of devices.
_TABLES = ("sensors", "drives", "motors")
_READ = frozenset((*_DIRECT, *_SIGNS, *_TABLES, "rand_bias", "frame_rate", "robot_width", "robot_height"))
# Names that cannot be set here, and the value they always have.
_ALWAYS: dict[str, Any] = {
    "wall_segment_length": 12,
    "floor_segment_length": 3,
    "floor_seed": 5489,
    "block_rotation": 0,
    "round_digits": 3,
    "frame_start": "[",
    "frame_end": "]",
    "sim": True,
}
# Names of screen colours and the like, which have no effect here.
_IDLE = re.compile(
    r".*_(color|thickness|pixels|filename)|foldername|ppi|timeout|str_encoding|maze_dim_[xy]"
    r"|simulate_list|comport_.*"
)


# Frames a second of that simulator, if its file gives none.
_FRAME_RATE = 60
_RATES = NumberRule(1, 1000)
# The values of cells, which are the same there.
_CELLS = tuple(CELLS)


def check_is_configuration(text: str, file: str = FILE) -> None:
    """Raise ConfigurationError unless the text sets two or more of the names in every `config.py`: other
    programs of a team sometimes use one of these names for something else."""
    names = read_source(text, file).names
    found = [name for name in _SIGNS if name in names]
    for name in _TABLES:
        table = names[name].value if name in names else None
        if isinstance(table, dict) and any(isinstance(item.value, Call) for item in table.values()):
            found.append(name)
    # Many programs have a single such name, for example `start_position`.
    if len(found) < 2:
        what = "is no configuration: it sets no walls, start, sensors and drives"
        raise ConfigurationError([Problem(file, f"{what}; name the {FILE} of simmer-python")])


def read_simmer_python(text: str, file: str = FILE, folder: Path | None = None) -> Imported:
    """Import the text of a `config.py`, which is parsed and never executed.

    `file` is its name in `left_out`, `folder` has the device classes beside it.
    Raises ConfigurationError if the text is not Python.
    """
    tree = python_tree(text, file)
    source = read_module(tree, file)
    notes = Notes(file)
    classes = read_device_classes(folder, source.names)
    for line, why in source.skipped:
        notes.add(line, "", why)
    maze, robot = _maze(source, notes), _robot(source, notes)
    settings = _settings(source, maze, notes)
    tables = _tables(source, notes)
    drives = read_drives(tables["drives"], notes, classes)
    settings["motion.clearance"] = _clearance(source, drives, notes)
    codes = {drive.code for drive in drives}
    block_size = settings.get("blocksize", _KNOWN["blocksize"].default)
    surroundings = Surroundings(block_size, math.hypot(maze.width, maze.height), classes)
    own: list[OwnDevice] = []
    sensors = read_sensors(tables["sensors"], codes, surroundings, notes, (), own)
    sensors += read_sensors(tables["motors"], codes, surroundings, notes, sensors)
    _list_the_rest(source, notes)
    origins = {
        setting: notes.where(source.names[name].line, name)
        for setting, names in _PLACES.items()
        for name in names
        if name in source.names
    }
    return settled(Imported(maze, robot, sensors, drives, settings, notes.in_order(), tuple(own)), origins)


def _tables(source: Source, notes: Notes) -> dict[str, dict[Any, Located]]:
    """The tables of devices, by name, with a code of two characters for each device."""
    names = ("drives", "sensors", *(("motors",) if "motors" in source.names else ()))
    found = {name: _table(source, name, notes) for name in names}
    taken = {key for table in found.values() for key in table if is_code(key)}
    tables: dict[str, dict[Any, Located]] = {"motors": {}}
    for name, table in found.items():
        tables[name], made = coded(table, taken)
        taken.update(made.values())
        if made:
            pairs = ", ".join(f'"{cut(key, WORD)}" is {code}' for key, code in made.items())
            notes.add(source.names[name].line, name, f"a code has two characters here: {pairs}")
    return tables


def _table(source: Source, name: str, notes: Notes) -> dict[Any, Located]:
    located = source.names.get(name)
    if located is None:
        notes.add(0, name, "is missing; the set has none")
        return {}
    if isinstance(located.value, dict):
        return located.value
    why = located.value.why if isinstance(located.value, Unreadable) else "it is not a dict"
    notes.add(located.line, name, f"cannot be read: {why}; the set has none")
    return {}


def _usable(
    source: Source, name: str, rule: Rule[Any], notes: Notes, otherwise: str, default: Any = None
) -> Any:
    """The value of a name if a rule allows it; else the default, and a note that says what happens
    `otherwise`."""
    located = source.names.get(name)
    if located is None:
        return default
    value = located.value
    try:
        if isinstance(value, Unreadable):
            raise ValueError(f"cannot be read: {value.why}")
        if isinstance(rule, FlagRule) and type(value) is int and value in (0, 1):
            value = bool(value)
        return rule.check(value)
    except ValueError as error:
        notes.add(located.line, name, f"{error}; {otherwise}")
        return default


def _setting(source: Source, name: str, setting: str, notes: Notes) -> Any:
    """The value of a name if its setting allows it; else None, and a note."""
    return _usable(source, name, _KNOWN[setting].rule, notes, f"{setting} keeps its default")


def _maze(source: Source, notes: Notes) -> MazeSpec:
    located = source.names.get("walls")
    if located is None:
        notes.add(0, "walls", "is missing; the course's maze is taken")
        return COURSE_MAZE
    rows = located.value
    fault = _grid_fault(rows)
    if fault:
        notes.add(located.line, "walls", f"{fault}; the course's maze is taken")
        return COURSE_MAZE
    odd = {describe(cell) for row in rows for cell in row if cell not in _CELLS}
    if odd:
        notes.add(located.line, "walls", f"holds {', '.join(sorted(odd))[:80]}; made 1, an empty cell")
    return MazeSpec(tuple(tuple(int(c) if c in _CELLS else EMPTY for c in row) for row in rows))


def _grid_fault(rows: Any) -> str:
    """The reason why a value is not a grid of cells; empty if it is one."""
    if isinstance(rows, Unreadable):
        return f"cannot be read: {rows.why}"
    if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
        return "cannot be read: it is not a list of rows"
    widths = {len(row) for row in rows}
    if len(widths) != 1 or not 1 <= len(rows) <= MAX_CELLS or not 1 <= max(widths) <= MAX_CELLS:
        return f"is no rectangle of 1 to {MAX_CELLS} cells"
    return ""


def _robot(source: Source, notes: Notes) -> RobotSpec:
    located = source.names.get("robot_outline")
    if located is None:
        return _sized(source, notes)
    points = located.value if isinstance(located.value, list) else []
    vertices = [point for point in map(pair, points) if point is not None]
    if isinstance(located.value, Unreadable):
        fault = f"cannot be read: {located.value.why}"
    elif not vertices or len(vertices) < len(points):
        fault = "is not a list of points"
    else:
        vertices = [(y + 0.0, x + 0.0) for x, y in vertices]
        # Outlines there are closed by repeating the first point.
        if vertices[0] == vertices[-1]:
            vertices.pop()
        fault = outline_fault(vertices)
        if not fault:
            return _rectangle(vertices) or RobotSpec.polygon(tuple(vertices))
    notes.add(located.line, "robot_outline", f"{fault}; a square of 6 in is taken")
    return RobotSpec.rectangle(6.0, 6.0)


def _sized(source: Source, notes: Notes) -> RobotSpec:
    """The rectangle for files without an outline; their height is along the direction of travel."""
    height, width = (
        _usable(source, name, NumberRule(0, 12, low_open=True), notes, "6 in is taken", 6.0)
        for name in ("robot_height", "robot_width")
    )
    return RobotSpec.rectangle(height, width)


def _rectangle(vertices: list[tuple[float, float]]) -> RobotSpec | None:
    """The rectangle around the origin that four vertices make, if they do."""
    x, y = vertices[0]
    rectangle = RobotSpec.rectangle(2 * abs(x), 2 * abs(y))
    return rectangle if len(vertices) == 4 and set(vertices) == set(rectangle.vertices) else None


def _settings(source: Source, maze: MazeSpec, notes: Notes) -> dict[str, SettingValue]:
    settings: dict[str, SettingValue] = {
        "randbias": False,
        "server.listeners": ("packets",),
        # That simulator moves in real time, answers at once, and its block stops the robot.
        "motion.motion": "timed",
        "motion.reply": "accepted",
        "motion.block_solid": True,
    }
    _place(source, maze, "bot_center", settings, notes)
    has_block = source.names.get("block_position", Located(0, 0)).value is not None
    if has_block:
        _place(source, maze, "block_center", settings, notes)
    for name in ("start_rotation", "robot_start_rotation"):
        rotation = _setting(source, name, "bot_rot", notes)
        if rotation is not None:
            # -R - 90, wrapped to (-180, 180].
            settings["bot_rot"] = 180.0 - (270.0 + rotation) % 360.0
    for name, setting in _DIRECT.items():
        value = _setting(source, name, setting, notes)
        if value is not None:
            settings[setting] = value
    if not has_block:
        settings["blocksize"] = 0.0
    bias = source.names.get("rand_bias")
    if bias is not None and bias.value not in (False, 0):
        what = "had no effect there; randbias is false, the biases are those given"
        notes.add(bias.line, "rand_bias", what)
    return settings


def _clearance(source: Source, drives: tuple[DriveSpec, ...], notes: Notes) -> float:
    """The gap to a wall, inches, at which a movement of that simulator ends. It ends with the last frame in
    which the robot touches nothing, on average half of a frame's distance before the wall."""
    rate: float = _usable(source, "frame_rate", _RATES, notes, f"{_FRAME_RATE} is taken", _FRAME_RATE)
    fastest = max((drive.speed for drive in drives if not drive.kind.turns), default=0.0)
    # Clearances are rounded as lengths in files of ours are, and above the most that the setting takes
    # nothing would be right.
    return min(round(fastest / rate / 2, 4), 1.0)


def _place(
    source: Source, maze: MazeSpec, setting: str, settings: dict[str, SettingValue], notes: Notes
) -> None:
    *_, usual = names = _PLACES[setting]
    name = next((name for name in reversed(names) if name in source.names), None)
    if name is None:
        notes.add(0, usual, f"is missing; {setting} keeps its default")
        return
    point = pair(source.names[name].value)
    if point is None:
        notes.add(source.names[name].line, name, f"is not a point; {setting} keeps its default")
    else:
        settings[setting] = (point[0] + 0.0, maze.height - point[1])


def _list_the_rest(source: Source, notes: Notes) -> None:
    """Note the names of the file that were not imported."""
    idle: list[tuple[str, int]] = []
    for name, located in source.names.items():
        if name in _ALWAYS:
            if located.value != _ALWAYS[name]:
                notes.add(located.line, name, f"is left out; here it is always {describe(_ALWAYS[name])}")
        elif _IDLE.fullmatch(name):
            idle.append((name, located.line))
        elif isinstance(located.value, Function | Class | Reference):
            continue
        elif name not in source.used and name not in _READ:
            notes.add(located.line, name, "has no equivalent; left out")
    if idle:
        names = ", ".join(name for name, _ in idle)
        notes.add(idle[0][1], "", f"left out, because nothing here depends on them: {names}")
    if "frame_start" not in source.names:
        what = "is missing, so requests have no brackets; legacy_reply says how they are answered"
        notes.add(0, "frame_start", what)
