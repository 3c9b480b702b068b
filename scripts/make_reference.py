"""Make the reference pages of the documentation, docs/reference, from the code, and fill in the numbers of
the other pages (page_numbers.py).

    python scripts/make_reference.py

Run it after a change of options, settings, columns, orders, keys, messages or numbers that pages state; a
test fails when it is necessary.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import math
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent))  # a clone's root; an installed one is first
sys.path.insert(0, str(Path(__file__).resolve().parent))  # where the scripts are, also for a test
from page_numbers import numbered_pages

from simmer_tui.calibrate import result_page
from simmer_tui.cli import doctor_command, ports_command, rerun_command
from simmer_tui.cli.command_line import EXIT_CODES, EXIT_CODES_OF_RUNS, default_text
from simmer_tui.cli.main import SUBCOMMANDS, build_parser, command_named
from simmer_tui.config import (
    dialect_toml,
    drive_csv,
    maze_csv,
    mission_toml,
    robot_csv,
    sensors_csv,
    set_document,
    wiring_toml,
)
from simmer_tui.config.csv_table import ENABLED
from simmer_tui.config.settings import all_settings
from simmer_tui.document.model import DataTable
from simmer_tui.grade import course
from simmer_tui.grade import site as grade_site
from simmer_tui.live.operating.orders import CONSOLE_COMMANDS
from simmer_tui.report import cause_order, content, run_statistics
from simmer_tui.sim.columns import BASE
from simmer_tui.sim.sensors import KINDS
from simmer_tui.trials import compare, logged_trial_summary, sweep_summary, trials_summary
from simmer_tui.tui.key_table import ANYWHERE, IN_LOG, IN_REPLAY, WITH_THE_MOUSE

ROOT = Path(__file__).resolve().parent.parent
PAGES = ROOT / "docs" / "reference"
CAUSES = ROOT / "docs" / "causes.md"
_ORDER = "cause_order.py: change it there. -->", "<!-- end of the order -->"
NOTE = "<!-- Made by scripts/make_reference.py from the code: change it there. -->\n"
_SETTING = "setting."  # prefix under which the options of settings are stored
_ERRORS = "Error"
_PROBLEM_CALLS = {"Problem": -1, "add_problem": -1, "refuse": 1, "kind": 0}
"""Calls that report a problem, and the number of the argument with the message. `kind` is a class of errors
that a function is given."""
_OF_PYTHON = ("AssertionError", "AttributeError")
"""Errors that no user meets."""
_PLACE = "..."  # placeholder for a value in a message

Rows = Iterable[tuple[str, ...]]
Texts = Mapping[str, Sequence[str]]
Constants = Mapping[str, object]


def pages() -> dict[str, str]:
    """The text of each page by its file name."""
    made = {
        "commands.md": commands(),
        "settings.md": settings(),
        "files.md": files(),
        "screen.md": screen(),
        "answers.md": answers(),
        **messages(),
    }
    return {name: f"{NOTE}\n{text.rstrip()}\n" for name, text in made.items()}


def table(header: tuple[str, ...], rows: Rows) -> str:
    """A table of Markdown."""
    lines = [f"| {' | '.join(header)} |", f"|{'---|' * len(header)}"]
    lines += [f"| {' | '.join(map(_cell, row))} |" for row in rows]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _code(text: str) -> str:
    return f"`{text}`" if text else ""


# -- commands --------------------------------------------------------------------------------------


def commands() -> str:
    """All commands with their own options."""
    parts = ["# Commands\n", "Every command says this too with `--help`.\n"]
    parts += ["## simmer-tui\n", *_command(build_parser(), "simmer-tui [options]")]
    for name in SUBCOMMANDS:
        parser = command_named(name).parser()
        usage = parser.format_usage().removeprefix("usage: ")
        parts += [f"## simmer-tui {name}\n", *_command(parser, usage)]
    parts += ["## Exit codes\n", f"{EXIT_CODES_OF_RUNS}\n"]
    parts.append(table(("code", "when"), ((str(int(code)), text) for code, text in EXIT_CODES.items())))
    return "\n".join(parts)


def _command(parser: argparse.ArgumentParser, usage: str) -> list[str]:
    own = [each for each in parser._actions if not each.dest.startswith(_SETTING) and each.dest != "help"]
    shown = " ".join(usage.split())
    if len(shown) > 110:  # with every option in it
        shown = f"{parser.prog} [options]"
    about = (parser.description or "").partition("\n\n")[0]  # the list of commands is this page
    parts = [f"{about}\n", f"    {shown}\n"]
    if own:
        parts.append(table(("argument", "meaning"), ((_argument(each), _help(parser, each)) for each in own)))
    if len(own) + 1 < len(parser._actions):
        has_screen = any(group.title == "screen" for group in parser._action_groups)
        but = "" if has_screen else " but those of screen and keys"
        parts.append(f"And every option of a [setting](settings.md){but}, which wins over the file.\n")
    return parts


def _argument(action: argparse.Action) -> str:
    if not action.option_strings:
        choices = "|".join(map(str, action.choices)) if action.choices else ""
        return _code(choices or str(action.metavar or action.dest))
    value = "" if action.nargs == 0 else f" {action.metavar or '|'.join(map(str, action.choices or ()))}"
    return _code(", ".join(action.option_strings) + value)


def _help(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    return parser._get_formatter()._expand_help(action) if action.help else ""


# -- settings --------------------------------------------------------------------------------------


def settings() -> str:
    """All settings, by group."""
    parts = [
        "# Settings\n",
        "In `settings.toml` a name with a dot stands in a table: `server.port` is `port` under `[server]`. "
        "On the command line every setting has an option, and the option wins. Lengths are inches, angles "
        "degrees, times seconds.\n",
    ]
    groups: dict[str, list[tuple[str, ...]]] = {}
    for item in all_settings():
        flag = isinstance(item.default, bool)
        option = item.option.replace("--", "--[no-]", 1) if flag else f"{item.option} {item.metavar}"
        unit = f" ({item.unit})" if item.unit else ""
        row = (
            _code(item.name),
            _code(option),
            _code(default_text(item)),
            item.rule.allowed + unit,
            item.help,
        )
        groups.setdefault(item.group, []).append(row)
    for group, rows in groups.items():
        header = ("name", "option", "default", "allowed", "meaning")
        parts += [f"## {group[0].upper()}{group[1:]}\n", table(header, rows)]
    return "\n".join(parts)


# -- files -----------------------------------------------------------------------------------------


def files() -> str:
    """The files of a set: the meaning of each value, row, column and key."""
    maze = ((str(value), kind.name, kind.meaning) for value, kind in maze_csv.CELLS.items())
    keys = ((_code(key.name), key.rule.allowed, key.help) for key in mission_toml.KEYS)
    kinds = ((_code(kind.name), kind.meaning, kind.unit or "1 or 0") for kind in KINDS.values())
    return "\n".join(
        (
            "# Files of a set\n",
            "A set is a folder with `maze.csv`, `robot.csv`, `sensors.csv`, `drive.csv` and `settings.toml`, "
            "perhaps a `mission.toml`, a `dialect.toml` and a `floor.csv`. `simmer-tui init` writes one. In "
            "the CSV files rows that begin with `#` are comments, columns without a header are notes, "
            "semicolons or tabs may replace commas.\n",
            "## maze.csv\n",
            f"{maze_csv.LAYOUT}\n",
            table(("value", "is", "meaning"), maze),
            "## floor.csv\n",
            f"{maze_csv.FLOOR_LAYOUT} Without it the floor is the course's pattern.\n",
            "## robot.csv\n",
            "The value of a row is in column B (of a corner in B and C). Column A is a label.\n",
            table(("row", "meaning"), robot_csv.ROWS.items()),
            "## sensors.csv\n",
            "One row for each sensor. The robot's frame: x ahead, y to the left, z up, from its centre.\n",
            "![Frames of maze and robot](../frame.svg)\n",
            table(("type", "what it measures", "unit"), kinds),
            "The first ten columns must be there. A blank cell of another column means its default, in "
            "brackets here. Formulas are in [Sensors and drives](../sensors.md).\n",
            table(("column", "allowed", "of", "meaning"), _sensor_columns()),
            "## drive.csv\n",
            "One row for each movement, and one for the gripper. From `Gain` on columns may be left out.\n",
            table(("column", "meaning"), ((_code(each.name), each.help) for each in drive_csv.COLUMNS)),
            "## mission.toml\n",
            table(("key", "allowed", "meaning"), keys),
            "## dialect.toml\n",
            "The language of a team's own robot: [dialect.toml](../dialects.md).\n",
            table(("key", "allowed", "meaning"), _dialect_keys()),
            "## wiring.toml\n",
            "The boards that run a team's own sketches: [Your sketch in the simulator](../sketch.md). A "
            "motor has the pins of its driver, a sensor the keys of its part.\n",
            table(("key", "allowed", "meaning"), _wiring_keys()),
            "## settings.toml\n",
            "[Settings](settings.md).\n",
            f"## {course.COURSE_FILE}\n",
            "Beside a set, for [grading](../grading.md).\n",
            table(("key", "default", "allowed", "meaning"), _course_keys()),
        )
    )


def _course_keys() -> Iterator[tuple[str, ...]]:
    for name, values in course.KEYS.items():
        of = f" of [[{name}]]" if name == "team" else f" of [{name}]" if name else ""
        for value in values:
            default = "" if value.default is None else _code(str(value.rule.plain(value.default)).lower())
            yield f"{_code(value.name)}{of}", default, value.rule.allowed, value.help


def _dialect_keys() -> Iterator[tuple[str, ...]]:
    tables = (("frame", dialect_toml.FRAME), ("reply", dialect_toml.REPLY), ("robot", dialect_toml.ROBOT))
    for name, values in tables:
        for value in values:
            yield _code(f"{name}.{value.name}"), value.rule.allowed, value.help
    for key in dialect_toml.HEAD_KEYS:
        yield _code(f"frame.{key}"), "", "binary: see the page"
    for name, keys in (
        ("[[command]]", dialect_toml.COMMAND_KEYS),
        ("[[stream]]", dialect_toml.STREAM_KEYS),
        ("[unknown]", dialect_toml.UNKNOWN_KEYS),
        ("a binary reply", dialect_toml.REPLY_KEYS),
    ):
        for key, meaning in keys.items():
            yield f"{_code(key)} of {name}", "", meaning


def _wiring_keys() -> Iterator[tuple[str, ...]]:
    for name, values in (
        ("[boards.NAME]", wiring_toml.BOARD_TABLE),
        ("[laptop]", wiring_toml.LAPTOP),
        ("[[wires]]", wiring_toml.WIRE),
        ("[[motors]]", wiring_toml.all_keys("motors")),
        ("[[sensors]]", wiring_toml.all_keys("sensors")),
        ("[[servos]]", wiring_toml.SERVO),
        ("gripper of [[servos]]", wiring_toml.GRIPPER_ANGLES),
    ):
        for value in values:
            meaning = f"{value.help}, {value.unit}" if value.unit else value.help
            yield f"{_code(value.name)} of {name}", value.rule.allowed, meaning


def _sensor_columns() -> Iterator[tuple[str, ...]]:
    columns = {column.name: column for column in BASE}
    for name, meaning in sensors_csv.meanings().items():
        of = {kind.name: column for kind in KINDS.values() for column in kind.columns if column.name == name}
        if not of and name not in columns:
            allowed = ENABLED.rule.allowed if name == ENABLED.name else "text"
            yield _code(name), allowed, "all", meaning
            continue
        # A kind may allow another range than the others: a lidar more rays.
        allowed_to: dict[str, list[str]] = {}
        for kind, column in of.items():
            allowed_to.setdefault(column.rule.allowed, []).append(kind)
        allowed_to = allowed_to or {columns[name].rule.allowed: []}
        common, *others = sorted(allowed_to, key=lambda each: -len(allowed_to[each]))
        allowed = "; ".join((common, *(f"{', '.join(allowed_to[each])}: {each}" for each in others)))
        shown = "all" if len(of) in (0, len(KINDS)) else ", ".join(of)
        yield _code(name), allowed, shown, meaning


# -- the screen ------------------------------------------------------------------------------------


def screen() -> str:
    """Orders and keys of the app."""
    keys = [item for item in all_settings() if item.name.startswith("keys.")]
    names = ((_code(str(item.default)), item.help, _code(item.name)) for item in keys)
    return "\n".join(
        (
            "# On the screen\n",
            "`:help` shows this in the app, and `?` in a replay its own keys.\n",
            "## Orders in the console\n",
            "Anything else that is typed there is a command to the robot, such as `u1` or `d1-3`.\n",
            table(
                ("order", "meaning"), ((_code(each.usage), each.help) for each in CONSOLE_COMMANDS.values())
            ),
            "## Keys while the maze has the focus\n",
            table(("keys", "meaning", "setting"), names),
            "## Keys anywhere\n",
            table(("key", "meaning"), ((_code(each.shown), each.help) for each in ANYWHERE)),
            "## Keys while the events have the focus\n",
            table(("key", "meaning"), ((_code(each.shown), each.help) for each in IN_LOG)),
            "## Keys in a replay\n",
            table(("key", "meaning"), ((_code(each.shown), each.help) for each in IN_REPLAY if each.shown)),
            "## Mouse\n",
            table(("", "meaning"), ((each.shown, each.help) for each in WITH_THE_MOUSE)),
        )
    )


# -- answers ---------------------------------------------------------------------------------------


def answers() -> str:
    """Keys of all tables, by command."""
    parts = [
        "# Answers as JSON and CSV\n",
        "With `--json` each table is a list of objects under its key; a record is one object. A key ends "
        "with its unit: `time_s` is seconds, `x_in` inches, `heading_deg` degrees. What does not apply is "
        "null, a number without bounds too. Sentences are under `text`, by the key of what they are about, "
        "and a program's last output under `output`. CSV files have the same keys as columns.\n",
    ]
    shown: dict[tuple[str, str], str] = {}
    for name, tables in ANSWERS.items():
        rows = []
        for each in tables:
            title = f"{each.title} (record)" if each.record else each.title
            keys = " ".join(_code(key) for column in each.columns for key in column.keys)
            # Several commands answer with the same table.
            place = shown.setdefault((each.key, keys), name)
            rows.append((_code(each.key), title, keys if place == name else f"as of `{place}`"))
        parts += [f"## simmer-tui {name}\n", table(("table", "title", "keys"), rows)]
    return "\n".join(parts)


ANSWERS: dict[str, tuple[DataTable, ...]] = {
    "report": content.TABLES,
    "report --csv": (DataTable("csv", "Commands of the log", run_statistics.COMMAND_COLUMNS),),
    "why": logged_trial_summary.TABLES,
    "trials": trials_summary.TABLES,
    "trials --vary": (sweep_summary.SWEEP, trials_summary.RUNS_TABLE),
    "compare": compare.TABLES,
    "grade": (grade_site.GRADES,),
    "calibrate": result_page.TABLES,
    "rerun": (rerun_command.RERUN,),
    "check": (*set_document.TABLES, set_document.settings_table()),
    "doctor": (doctor_command.CHECKS,),
    "ports": (ports_command.PORTS,),
}


# -- messages --------------------------------------------------------------------------------------


def messages() -> dict[str, str]:
    """The pages with the messages of errors, found in the code, each with `...` for what differs."""
    rooms: dict[str, dict[str, None]] = {}
    for path in sorted((ROOT / "simmer_tui").rglob("*.py")):
        place = path.relative_to(ROOT / "simmer_tui").with_suffix("").as_posix()
        part = next((name for name in _PARTS if f"{place}/".startswith(f"{name}/")), "")
        for text in _messages_of(path):
            rooms.setdefault(_PARTS.get(part, _ELSEWHERE), {})[text] = None
    made = {}
    for name, (heading, about, titles) in _MESSAGE_PAGES.items():
        parts = [f"# {heading}\n", f"{about}\n"]
        for title in titles:
            texts = sorted(_unlike(rooms.pop(title)), key=_letters)
            parts += [f"## {title}\n", "\n".join(f"- {_escaped(text)}" for text in texts), ""]
        made[name] = "\n".join(parts)
    assert not rooms, "a part without a page"
    return made


def _unlike(texts: Iterable[str]) -> Iterable[str]:
    """Texts, of those that differ in values and signs only the longest."""
    longest: dict[str, str] = {}
    for text in sorted(texts, key=lambda text: (-len(text), text)):
        longest.setdefault(_letters(text), text)
    return longest.values()


def _letters(text: str) -> str:
    return " ".join(re.findall(r"\w+", text.lower()))


_ELSEWHERE = "Elsewhere"
_PARTS = {
    "config/importer": "Import",
    "config": "The files of a set, and options",
    "sketch": "Sketches and wiring.toml",
    "sim": "Where robot and block stand, and what a robot lacks",
    "run/mission": "Missions",
    "client": "The client library",
    "links": "Ports, connections and the serial port",
    "live/server": "Ports, connections and the serial port",
    "program": "The program of --run",
    "runlog": "Run logs",
    "report": "Reports",
    "trials": "Trials",
    "grade": "Grading",
    "calibrate": "Calibration",
    "dialect": "A team's own language: dialect.toml",
    "tui": "Orders in the console",
    "cli": "The command line",
}
"""Names of the parts of the package for people; the first that fits a file is its part."""
_MESSAGE_PAGES = {
    "messages.md": (
        "Error messages",
        "Messages with `...` in place of values. A message says what to do next; search these pages for a "
        "part of it to see what it is about.\n\n"
        + table(
            ("it begins with, or you did", "its messages"),
            (
                ("a command, a connection, a program", "this page"),
                (
                    "`file:line:column`, `--config`, `import`; `simmer-tui check` lists all at once",
                    "[sets](messages-sets.md)",
                ),
                (
                    "`simmer-tui report`, `replay`, `trials`, `grade`, `calibrate` and other commands",
                    "[commands](messages-commands.md)",
                ),
            ),
        ),
        (
            "The client library",
            "Ports, connections and the serial port",
            "The program of --run",
            "Where robot and block stand, and what a robot lacks",
            "Missions",
            "Orders in the console",
            _ELSEWHERE,
        ),
    ),
    "messages-sets.md": (
        "Error messages of sets",
        "As in [error messages](messages.md). Each begins with its place, `file:line:column`.",
        (
            "The files of a set, and options",
            "Sketches and wiring.toml",
            "A team's own language: dialect.toml",
            "Import",
        ),
    ),
    "messages-commands.md": (
        "Error messages of commands",
        "As in [error messages](messages.md).",
        ("The command line", "Run logs", "Reports", "Trials", "Grading", "Calibration"),
    ),
}
"""Heading, introduction and parts of each page."""


_CALL = re.compile("|".join(rf"{call}\(" for call in (*_PROBLEM_CALLS, _ERRORS)))
_PART = re.compile(r"^(?=(?:class|def|async def|@)\b)", re.MULTILINE)
"""The beginning of a definition at the top of a module."""


def _messages_of(path: Path) -> Iterator[str]:
    text = path.read_text("utf-8")
    if not _CALL.search(text):
        return
    constants = _constants_of(path)
    # The modules as wholes would take three times as long.
    try:
        parts = [ast.parse(part) for part in _PART.split(text) if _CALL.search(part)]
    except SyntaxError:  # a text with a definition in it
        parts = [ast.parse(text)]
    for function in (each for part in parts for each in ast.walk(part)):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if told := list(_messages_in(function)):
            names = _local_texts(function, constants)
            for node in told:
                yield from _told(node, names, constants)


def _messages_in(function: ast.AST) -> Iterator[ast.expr]:
    """Arguments with the messages that a function reports."""
    for node in ast.walk(function):
        if isinstance(node, ast.Call) and node.args:
            called = getattr(node.func, "id", "") or getattr(node.func, "attr", "")
            # A method of another class may have the same name.
            if len(node.args) > _PROBLEM_CALLS.get(called, math.inf):
                yield node.args[_PROBLEM_CALLS[called]]
            elif called.endswith(_ERRORS) and not called.startswith("_") and called not in _OF_PYTHON:
                yield node.args[0]


def _told(node: ast.expr, names: Texts, constants: Constants) -> Iterator[str]:
    """Messages with text of their own, not only a value that is passed on."""
    for text in _texts(node, names, constants):
        words = " ".join(text.split())
        if sum(part.isalpha() for part in words.replace(_PLACE, " ").split()) > 1:
            yield words


def _local_texts(function: ast.AST, constants: Constants) -> Texts:
    """Texts of the local names of a function, those with an unknown one too."""
    names: dict[str, list[str]] = {}
    unknown: Counter[str] = Counter()
    for node in ast.walk(function):
        if isinstance(node, ast.arg):
            unknown[node.arg] += 1
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            unknown[node.id] += 1
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            names.setdefault(node.targets[0].id, []).extend(_texts(node.value, {}, constants))
            unknown[node.targets[0].id] -= 1
    for name in +unknown:
        names.setdefault(name, []).append(_PLACE)
    return names


def _texts(node: ast.expr, names: Texts, constants: Constants) -> list[str]:
    """Texts that an expression may give; the placeholder for one that is not known."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return [node.value]
    if isinstance(node, ast.JoinedStr):
        pieces = [_pieces(piece, names, constants) for piece in node.values]
        return ["".join(each) for each in product(*pieces)]
    if isinstance(node, ast.IfExp):
        return _texts(node.body, names, constants) + _texts(node.orelse, names, constants)
    if isinstance(node, ast.Name):
        return list(names.get(node.id, (_PLACE,)))
    if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "counted":
        return [f"{_PLACE} {noun}s" for noun in _texts(node.args[1], names, constants)]
    return [_PLACE]


def _pieces(piece: ast.expr, names: Texts, constants: Constants) -> list[str]:
    """Texts that one part of an f-string may give: a constant's value, each of a local name's texts, or the
    placeholder."""
    if isinstance(piece, ast.FormattedValue):
        parts = [part for part in ast.walk(piece) if isinstance(part, ast.Name)]
        if parts and all(part.id in constants for part in parts):
            shown = ast.fix_missing_locations(ast.Expression(ast.JoinedStr([piece])))
            return [str(eval(compile(shown, "message", "eval"), dict(constants)))]
        if piece.format_spec is None and piece.conversion == -1:
            return _texts(piece.value, names, constants)
        return [_PLACE]
    return _texts(piece, names, constants)


def _constants_of(path: Path) -> Constants:
    """Constants of a module by name, those that it imports included."""
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    found = vars(importlib.import_module(module))
    return {name: value for name, value in found.items() if name.isupper()}


def _escaped(text: str) -> str:
    """Text, escaped so that Markdown leaves it unchanged, MkDocs' as well as that of code hosts."""
    return "".join("&lt;" if each == "<" else f"\\{each}" if each in "\\`*_{}[]>#" else each for each in text)


def causes() -> str:
    """The text of docs/causes.md with the order of causes."""
    rows = [
        (
            str(place) if rule is not cause_order.NO_RULE else "",
            _code(rule.kind.value),
            rule.when,
            rule.excludes,
        )
        for place, rule in enumerate((*cause_order.ORDER, cause_order.NO_RULE), 1)
    ]
    made = table(("", "cause", "when", "rules out"), rows)
    before, begin, rest = CAUSES.read_text("utf-8").partition(_ORDER[0])
    _, end, after = rest.partition(_ORDER[1])
    return f"{before}{begin}\n\n{made}\n{end}{after}"


def main() -> int:
    """Write the pages; returns the exit code."""
    PAGES.mkdir(parents=True, exist_ok=True)
    CAUSES.write_text(causes(), encoding="utf-8", newline="\n")
    for path, text in numbered_pages():
        path.write_text(text, encoding="utf-8", newline="\n")
    for name, text in pages().items():
        (PAGES / name).write_text(text, encoding="utf-8", newline="\n")
        print(f"Wrote {(PAGES / name).relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
