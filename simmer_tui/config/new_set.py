"""The files of a new set for editing: with comments and schemas; on request a mission, a dialect, a course.

Files that are not made from others are in the folders `dialects` and `term` of the bundled sets.

Comments are after the rows, so that the first line of a file stays its header and the rows of a maze stay in
place. The JSON schemas of settings.toml and mission.toml are made from their rules; editors complete and
check by them. A file names its schema in a comment, `#:schema .schema/settings.json`: Even Better TOML in VS
Code and taplo on the command line read that.
"""

import json
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from simmer_tui.config import (
    dialect_toml,
    drive_csv,
    maze_csv,
    mission_toml,
    robot_csv,
    sensors_csv,
    settings_file,
    wiring_toml,
)
from simmer_tui.config.csv_table import (
    COMMENT,
    ENABLED,
    ID,
    POLL_CHARACTER,
    csv_text,
    delimiter_of,
    first_row,
    plain_rows,
    rows_by_header,
)
from simmer_tui.config.dialects import DIALECT_FILE
from simmer_tui.config.examples import EXAMPLE, example_files
from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.config.sets import (
    LOCAL_FOLDER,
    MISSION_SET,
    bundled_folder,
    bundled_sets,
    decoded,
    read_all,
    read_files,
)
from simmer_tui.config.settings import Setting, all_settings
from simmer_tui.config.settings_file import with_all_settings
from simmer_tui.dialect.dialect_rules import Busy
from simmer_tui.dialect.frames import FrameKind
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.sensors import KINDS, LoadSensor
from simmer_tui.sim.values import Value
from simmer_tui.version import requirement

_RANGES = tuple(name for name, kind in KINDS.items() if kind.is_range)
_DIALECT_HEAD = """\
# The language of your robot: what its sketch understands, and answers. simmer-tui check DIR finds
# every mistake, and prints all messages with an example of their replies. docs/dialects.md has every key.
# Values are inches and degrees; counter-clockwise and left are positive. cm, mm and m are factors.

"""
SAMPLES, SUBMISSION = "samples", "submission"
"""Folders of a course with the sample programs and with students' submissions."""
_PROGRAM = "main.py"
"""The program in a submission that is run."""
_REQUIREMENTS = "requirements.txt"


def with_comments(files: Mapping[str, bytes], nominal: str = "") -> dict[str, bytes]:
    """The files of a set with comments that explain their values, and with the schemas of its TOML files,
    which these name. Existing comments stay unchanged.

    Args:
        files: Texts by file name.
        nominal: Name of the set that they were copied from; an existing name stays.
    """
    made: dict[str, bytes] = {}
    for name, data in files.items():
        if not name.endswith((".csv", ".toml")):
            made[name] = data  # a device or a sketch, whose hash must not change
            continue
        text = decoded(name, data)
        if name in (DIALECT_FILE, WIRING_FILE):
            text = naming_schema(name, text)
        elif name in (settings_file.FILE, mission_toml.FILE):
            complete = with_all_settings(text, {"nominal": nominal}) if name == settings_file.FILE else text
            text = naming_schema(name, complete)
        elif not any(line.startswith(COMMENT) for line in text.splitlines()):
            end = "" if text.endswith("\n") else "\n"
            text += end + "".join(f"{COMMENT} {line}\n" for line in _comments(name, text))
        made[name] = text.encode()
    for name, schema in schemas().items():
        if name in made:
            made[schema_path(name)] = schema_text(schema).encode()
    return made


def _rows_of(kind: str, text: str) -> list[dict[str, str]]:
    """The rows of a kind of sensor or of the gripper."""
    return [row for row in rows_by_header(text) if row.get(ID, "").lower().rstrip("0123456789") == kind]


def with_mission(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """The files of a set with the parts that a mission needs: a gripper, a load sensor and a mission.toml.
    Missing parts are copied from the bundled set `mission`."""
    model = read_files(bundled_sets()[MISSION_SET])
    texts = _device_tables(files)
    taken = {row.get(POLL_CHARACTER, "") for text in texts.values() for row in rows_by_header(text)}
    for name, kind in ((drive_csv.FILE, drive_csv.GRIPPER_ID), (sensors_csv.FILE, LoadSensor.name)):
        if not _rows_of(kind, texts[name]):
            wanted = _rows_of(kind, model[name].decode())[0]
            code = _free_code(wanted[POLL_CHARACTER], taken)
            taken.add(code)
            texts[name] = _with_row(texts[name], wanted | {POLL_CHARACTER: code})
    made = {**files, **{name: text.encode() for name, text in texts.items()}}
    return made | {mission_toml.FILE: files.get(mission_toml.FILE, model[mission_toml.FILE])}


def with_dialect(files: Mapping[str, bytes], kind: FrameKind) -> dict[str, bytes]:
    """The files of a set with a dialect.toml of a kind, a small language with the codes of the set."""
    drives, sensors = (enabled_codes(text) for text in _device_tables(files).values())
    ranges = [code for name, code in sensors.items() if name.startswith(_RANGES)]
    text = _DIALECT_HEAD + _bundled_files("dialects")[f"{kind}.toml"].decode()
    for word, code in (
        ("SENSOR", next(iter([*ranges, *sensors.values()]), "u1")),
        ("FORWARD", drives.get("right", "d1")),
        ("TURN", drives.get("rot", "r1")),
    ):
        text = text.replace(word, code)
    return {**files, DIALECT_FILE: text.encode()}


def _device_tables(files: Mapping[str, bytes]) -> dict[str, str]:
    """The texts of drive.csv and sensors.csv. Raises ConfigurationError if one is missing or empty."""
    names = (drive_csv.FILE, sensors_csv.FILE)
    texts = {name: decoded(name, files[name]) for name in names if name in files}
    problems = [Problem(name, "is missing from the set") for name in names if name not in texts]
    problems += [Problem(name, "the file is empty") for name, text in texts.items() if not plain_rows(text)]
    if problems:
        raise ConfigurationError(problems)
    return texts


def enabled_codes(text: str) -> dict[str, str]:
    """The codes of the enabled rows of a table, by ID."""
    return {
        row.get(ID, "").lower(): row.get(POLL_CHARACTER, "")
        for row in rows_by_header(text)
        if row.get(ENABLED.name) != "0"
    }


def term_files(course_set: Mapping[str, bytes]) -> dict[str, bytes]:
    """The files of a course's folder, by path in it: its set, samples, and a repository for students.

    Raises ConfigurationError if a bundled file cannot be read.
    """
    samples = example_files()
    files = {f"{LOCAL_FOLDER}/{name}": data for name, data in course_set.items()}
    files |= {f"{SAMPLES}/{name}": data for name, data in samples.items()}
    files[f"{SUBMISSION}/{_PROGRAM}"] = samples[EXAMPLE]
    files |= _bundled_files("term")
    files[_REQUIREMENTS] += f"{requirement()}\n".encode()
    return files


def _bundled_files(folder: str) -> dict[str, bytes]:
    """The files in a folder beside the default set, by path in it. Raises ConfigurationError."""
    home = bundled_folder() / folder
    return read_all(sorted(path for path in home.rglob("*") if path.is_file()), home)


def _free_code(wanted: str, taken: Collection[str]) -> str:
    """The wanted code, or one with another digit: there are more digits than sensors with the same letter."""
    others = (f"{letter}{digit}" for letter in (wanted[0], "x", "z") for digit in "1234567890")
    return next(code for code in (wanted, *others) if code not in taken)


def _with_row(text: str, row: Mapping[str, str]) -> str:
    """A table with one more row, and the columns that it needs; comments stay after the rows."""
    comments = [line for line in text.splitlines() if line.lstrip(' "').startswith(COMMENT)]
    table = plain_rows(text)
    header = table[0]
    header += [name for name, value in row.items() if value and name not in header]
    table.append([row.get(name, "") for name in header])
    rows = ([*cells, *[""] * (len(header) - len(cells))] for cells in table)
    return csv_text(rows, delimiter_of(text)) + "".join(f"{line}\n" for line in comments)


def _comments(name: str, text: str) -> Iterable[str]:
    """The lines that explain the values in one of the files."""
    if name == maze_csv.FILE:
        yield maze_csv.LAYOUT
        for value, kind in maze_csv.CELLS.items():
            yield f"{value} {kind.name}: {kind.meaning}"
    elif name == maze_csv.FLOOR_FILE:
        yield maze_csv.FLOOR_LAYOUT
    elif name == robot_csv.FILE:
        yield "The robot's outline from above, in its own frame: x ahead, y to the left, inches."
        yield from (f"{row}: {meaning}" for row, meaning in robot_csv.ROWS.items())
    elif name in (sensors_csv.FILE, drive_csv.FILE):
        drives = {each.name: each.help for each in drive_csv.COLUMNS}
        meanings = sensors_csv.meanings() if name == sensors_csv.FILE else drives
        present = first_row(text)
        yield "One row each. In brackets what a blank cell means. docs/sensors.md has more columns."
        yield from (f"{column}: {meanings[column]}" for column in present if column in meanings)


SCHEMA_FOLDER = ".schema"
"""The folder of a set with the schemas of its files."""
# Keywords are those of draft 7, which both editors support.
_DRAFT = "http://json-schema.org/draft-07/schema#"
_DIRECTIVE = "#:schema "

Schema = dict[str, Any]


def schemas() -> dict[str, Schema]:
    """The schemas by the name of the file that each is for."""
    return {
        settings_file.FILE: settings_schema(),
        mission_toml.FILE: mission_schema(),
        DIALECT_FILE: dialect_schema(),
        WIRING_FILE: wiring_schema(),
    }


def schema_path(file: str) -> str:
    """The path in a set of the schema of one of its files: `.schema/settings.json`."""
    return f"{SCHEMA_FOLDER}/{file.removesuffix('.toml')}.json"


def schema_text(schema: Schema) -> str:
    """The text of a schema's file."""
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def naming_schema(file: str, text: str) -> str:
    """The text of a TOML file with its schema named in the first line; one named before is replaced."""
    lines = text.splitlines(keepends=True)
    rest = lines[1:] if lines and lines[0].startswith(_DIRECTIVE) else lines
    return f"{_DIRECTIVE}{schema_path(file)}\n" + "".join(rest)


def settings_schema() -> Schema:
    """The schema of settings.toml: every setting with its values, default and meaning, in its table."""
    return _schema("Settings of the simulator, SimMeR-TUI", all_settings())


def mission_schema() -> Schema:
    """The schema of mission.toml."""
    return _schema("The mission of a set, SimMeR-TUI", mission_toml.KEYS)


def dialect_schema() -> Schema:
    """The schema of dialect.toml."""
    text, number = {"type": "string"}, {"type": "number"}
    texts = {"type": ["string", "array"], "items": text}
    reply = {
        "type": ["string", "object", "array"],
        "additionalProperties": False,
        "properties": _described(dialect_toml.REPLY_KEYS, {}),
    }
    kinds: dict[str, Schema] = {
        **dict.fromkeys(("match", "do"), texts),
        **dict.fromkeys(("reply", "done", "stopped", "send"), reply),
        **dict.fromkeys(("if", "unpack"), text),
        "takes": {"type": ["number", "string"]},
        "type": {"type": "integer"},
        "every": number,
        "busy": {"enum": [each.value for each in Busy]},
    }
    whole = _object("The language of a team's robot, SimMeR-TUI")
    properties = whole["properties"]
    for name, values in (
        ("frame", dialect_toml.FRAME),
        ("reply", dialect_toml.REPLY),
        ("robot", dialect_toml.ROBOT),
    ):
        properties[name] = _object(name)
        for value in values:
            properties[name]["properties"][value.name] = value.rule.schema | {"description": value.help}
    properties["frame"]["properties"] |= {
        "head": text,
        "names": {"type": "array", "items": text},
        "body": {"type": ["string", "integer"]},
    }
    properties["state"] = {"type": "object", "additionalProperties": {"type": ["number", "string"]}}
    for name, keys in (("command", dialect_toml.COMMAND_KEYS), ("stream", dialect_toml.STREAM_KEYS)):
        each = _object(name) | {"properties": _described(keys, kinds)}
        properties[name] = {"type": "array", "items": each}
    properties["unknown"] = _object("unknown") | {"properties": _described(dialect_toml.UNKNOWN_KEYS, kinds)}
    return {"$schema": _DRAFT, **whole}


def wiring_schema() -> Schema:
    """The schema of wiring.toml. Which pins a driver or part needs is left to the reader."""

    def table(title: str, values: Iterable[Value]) -> Schema:
        described = {value.name: value.rule.schema | {"description": value.help} for value in values}
        return _object(title) | {"properties": described}

    whole, gripper = _object("The boards of a set and their wires, SimMeR-TUI"), wiring_toml.GRIPPER_ANGLES
    rows = {
        "wires": table("wire", wiring_toml.WIRE),
        "motors": table("motor", wiring_toml.all_keys("motors")),
        "sensors": table("sensor", wiring_toml.all_keys("sensors")),
        "servos": table("servo", wiring_toml.SERVO),
    }
    rows["servos"]["properties"]["gripper"] = table("gripper", gripper)
    whole["properties"] = {
        "boards": {"type": "object", "additionalProperties": table("board", wiring_toml.BOARD_TABLE)},
        "laptop": table("laptop", wiring_toml.LAPTOP),
        **{name: {"type": "array", "items": each} for name, each in rows.items()},
    }
    return {"$schema": _DRAFT, **whole}


def _described(keys: Mapping[str, str], kinds: Mapping[str, Schema]) -> dict[str, Schema]:
    """The schemas of keys, with their meanings."""
    return {key: {**kinds.get(key, {}), "description": meaning} for key, meaning in keys.items()}


def _schema(title: str, values: Iterable[Value]) -> Schema:
    whole = _object(title)
    for value in values:
        table, _, key = value.name.rpartition(".")
        target = whole["properties"].setdefault(table, _object(table)) if table else whole
        parts = [f"{value.help[0].upper()}{value.help[1:]}"]
        parts += [f"Unit: {value.unit}"] if value.unit else []
        parts += [f"Option: {value.option}"] if isinstance(value, Setting) else []
        described = {"description": ". ".join(parts), "default": value.rule.plain(value.default)}
        target["properties"][key] = value.rule.schema | described
    return {"$schema": _DRAFT, **whole}


def _object(title: str) -> Schema:
    return {"title": title, "type": "object", "additionalProperties": False, "properties": {}}
