"""Import of the MATLAB SimMeR's `Main.m` with its `config` folder.

The CSV files have our own form and frame; `Main.m` has the rest in plain assignments. The other scripts of
the folder determine the form of replies.
"""

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from simmer_tui.config import drive_csv, maze_csv, robot_csv, sensors_csv
from simmer_tui.config.drive_csv import load_drives
from simmer_tui.config.importer.imported import (
    COURSE_MAZE,
    POSITIONS,
    Imported,
    Notes,
    SettingValue,
    settled,
    text_of_file,
)
from simmer_tui.config.importer.literal import read_expression
from simmer_tui.config.importer.python_values import Unreadable
from simmer_tui.config.leftovers import is_leftover
from simmer_tui.config.maze_csv import load_maze
from simmer_tui.config.robot_csv import load_robot
from simmer_tui.config.sensors_csv import load_sensors
from simmer_tui.config.settings import Setting, all_settings
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.rules import LARGEST_PORT, FlagRule, listed
from simmer_tui.sim.specs import RobotSpec

FILE = "Main.m"
CONFIG_FOLDER = "config"
_CSV_FILES = (maze_csv.FILE, robot_csv.FILE, sensors_csv.FILE, drive_csv.FILE)

# The variables of `Main.m` that are settings here, under the same name.
_TAKEN = (
    *("bot_center", "bot_rot", "block_center", "blocksize", "num_segments", "strength", "step_time"),
    *("randerror", "randbias", "plot_robot", "plot_sense"),
)
# A name and a single `=`: a comparison is not an assignment.
_ASSIGNMENT = re.compile(r"\s*([A-Za-z]\w*)\s*=(?!=)\s*([^;]*)")
_STRING = r"""(?:'[^'\n]*'|"[^"\n]*")"""
# A quote after a letter is MATLAB's transpose and does not begin a text.
_COMMENT = re.compile(rf"(?P<code>(?:{_STRING}|\w'|[^'\"%\n])*)(?:%.*)?")
_PORTS = re.compile(r"""tcp_setup\s*\(\s*['"]server['"]\s*,\s*(\d{1,5})\s*,\s*(\d{1,5})\s*\)""")
_PRECISION = re.compile(
    r"""\b(fwrite|fread)\s*\([^\n]*?['"](double|float64|real\*8|single|float32|real\*4)['"]""", re.IGNORECASE
)
_WIDTH = {
    **dict.fromkeys(("double", "float64", "real*8"), "float64"),
    **dict.fromkeys(("single", "float32", "real*4"), "float32"),
}


def read_matlab(folder: Path, file: str = FILE) -> Imported:
    """Make a configuration set of a folder with `Main.m` (or another `file`) and `config`, or the CSV
    files beside the script.

    Raises ConfigurationError if the script or the folder cannot be read, or the script sets none of the
    simulator's variables.
    """
    lines = list(_code(folder / file))
    config = _folder_of_csv_files(folder)
    first = _first_assignments(lines)
    if len(first.keys() & set(_TAKEN)) < 2:
        what = f"is no configuration: it sets no bot_center, block_center and the like; name the {FILE}"
        raise ConfigurationError([Problem(cut(file), what)])
    left_out: list[Problem] = []
    codes: dict[str, str] = {}
    maze = load_maze(config, left_out)
    if maze is None:
        left_out.append(Problem("maze.csv", "the course's maze is taken"))
    robot = load_robot(config, left_out)
    if robot is None:
        left_out.append(Problem("robot.csv", "a circle of 6 in is taken"))
    sensors = load_sensors(config, codes, left_out)
    rows = load_drives(config, codes, left_out)
    drives, gripper = rows.drives, rows.gripper
    for table, parts, read in ((sensors_csv.FILE, "sensors", sensors), (drive_csv.FILE, "drives", drives)):
        if not read:
            left_out.append(Problem(table, f"the set has no {parts}: add them to the new {table}"))
    if gripper is not None:
        left_out.append(Problem("drive.csv", "the row grip is not copied; add it to the new drive.csv"))
    notes = Notes(file)
    settings = _settings(first, notes) | _ports(lines, notes) | _replies(folder, notes)
    imported = Imported(
        maze or COURSE_MAZE,
        robot or RobotSpec.circle(6.0),
        sensors,
        drives,
        settings,
        (*notes.in_order(), *left_out),
    )
    origins = {name: notes.where(number, name) for name, (number, _) in first.items() if name in POSITIONS}
    return settled(imported, origins)


def _folder_of_csv_files(folder: Path) -> Path:
    """The folder `config`, else the script's own folder, if one of the files is in it."""
    if (folder / CONFIG_FOLDER).is_dir():
        return folder / CONFIG_FOLDER
    if any((folder / name).is_file() for name in _CSV_FILES):
        return folder
    what = f"has no folder {CONFIG_FOLDER} with {listed(_CSV_FILES)}, nor these files themselves"
    raise ConfigurationError([Problem(str(folder), what)])


def _code(path: Path) -> Iterator[tuple[int, str]]:
    """The lines of a MATLAB script by number, without comments."""
    block = 0
    for number, line in enumerate(text_of_file(path).splitlines(), 1):
        bare = line.strip()
        if bare in ("%{", "%}"):
            block = block + 1 if bare == "%{" else max(0, block - 1)
        elif not block:
            match = _COMMENT.match(line)
            yield number, match["code"] if match else ""


def _first_assignments(lines: list[tuple[int, str]]) -> dict[str, tuple[int, str]]:
    """The line and right-hand side of each variable's first assignment, which is the user's: the
    main loop assigns some of them again."""
    first: dict[str, tuple[int, str]] = {}
    for number, line in lines:
        match = _ASSIGNMENT.match(line)
        if match is not None:
            first.setdefault(match[1], (number, match[2].strip()))
    return first


def _ports(lines: list[tuple[int, str]], notes: Notes) -> dict[str, SettingValue]:
    for number, line in lines:
        ports = _PORTS.search(line)
        if ports is None or max(int(port) for port in ports.groups()) > LARGEST_PORT:
            continue
        if ports[1] != ports[2] or not int(ports[1]):
            return {"server.port": int(ports[1]), "server.reply_port": int(ports[2])}
        notes.add(number, "tcp_setup", f"takes port {ports[1]} twice; the ports keep their defaults")
    return {}


def _settings(first: dict[str, tuple[int, str]], notes: Notes) -> dict[str, SettingValue]:
    known = {item.name: item for item in all_settings()}
    settings: dict[str, SettingValue] = {}
    for name in _TAKEN:
        if name not in first:
            notes.add(0, name, "is not set; it keeps its default")
            continue
        number, text = first[name]
        try:
            settings[name] = _value(text, known[name])
        except ValueError as error:
            notes.add(number, name, f"{error}; it keeps its default")
    for name, what in (
        ("sim", "a real robot is reached with the serial port's own options"),
        ("comport_num", "the serial port is named with the serial port's own options"),
        ("comport_baud", "the serial port's speed is set with its own options"),
    ):
        if name in first and not (name == "sim" and first[name][1] in ("1", "true")):
            notes.add(first[name][0], name, f"left out; {what}")
    outline = first.get("bot_perim", (0, "import_bot"))
    if not outline[1].startswith("import_bot"):
        notes.add(outline[0], "bot_perim", "left out; the outline is the one in robot.csv")
    return settings


def _value(text: str, meant: Setting) -> SettingValue:
    """The value of a right-hand side, a number or a row of them. Raises ValueError."""
    bracketed = re.fullmatch(r"\[(.*)\]", text)
    pieces = re.split(r"\s*,\s*|\s+", bracketed[1].strip()) if bracketed else [text]
    numbers = []
    for piece in pieces:
        value = {"true": True, "false": False}.get(piece)
        value = read_expression(piece) if value is None else value
        if isinstance(value, Unreadable) or not isinstance(value, int | float):
            raise ValueError(f"is not a plain number: {cut(text, WORD)}")
        numbers.append(value)
    plain: object = numbers if bracketed else numbers[0]
    if isinstance(meant.rule, FlagRule) and plain in (0, 1):
        plain = bool(plain)
    checked: SettingValue = meant.rule.check(plain)
    return checked


def _replies(folder: Path, notes: Notes) -> dict[str, SettingValue]:
    """The form of replies, from the scripts' own reads and writes."""
    reads: Counter[str] = Counter()
    writes: Counter[str] = Counter()
    streams, little = False, False
    for path in sorted(path for path in folder.glob("*.m") if not is_leftover(path.name)):
        for _, line in _code(path):
            for call, precision in _PRECISION.findall(line):
                (reads if call.lower() == "fread" else writes)[_WIDTH[precision.lower()]] += 1
            streams = streams or re.search(r"\btcpip\s*\(", line) is not None
            little = little or re.search(r"\btcpclient\s*\(", line) is not None
    # The reads of a program show the form that it expects; without any, the simulator's writes do.
    votes = (reads or writes).most_common()
    if not votes:
        notes.add(0, "fread", "and fwrite with double or single were not found; replies are doubles")
        return {}
    if len(votes) > 1 or (reads and writes and set(reads) != set(writes)):
        notes.add(0, "fread", f"and fwrite disagree on the size of a reply; {votes[0][0]} is taken")
    found: dict[str, SettingValue] = {"server.reply_format": votes[0][0]}
    if little and not streams:
        # tcpclient objects read so, tcpip objects big-endian.
        found["server.byte_order"] = "little"
    return found
