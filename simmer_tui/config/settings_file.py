"""settings.toml: read into `Settings` with the options that override it, and written with a comment each."""

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from msgspec import Struct

from simmer_tui.config.settings import ELSE_REAL, KeySettings, Setting, Settings, all_settings, settings_from
from simmer_tui.config.toml_file import TomlFile
from simmer_tui.errors import Problem
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.rules import did_you_mean

FILE = "settings.toml"


class Override(Struct, frozen=True):
    """A setting given outside the file: its option and its value.

    Text is read as the command line gives it (`6,42`); any other type is checked as TOML's is.
    """

    option: str
    value: object


class LoadedSettings(Struct, frozen=True):
    """The settings, and for each (dotted name) the place where a person would change it."""

    settings: Settings
    places: Mapping[str, str]


def load_settings(
    directory: Path, overrides: Mapping[str, Override], problems: list[Problem]
) -> LoadedSettings:
    """Read settings.toml in `directory` and apply the overrides.

    Mistakes go to `problems`; a setting with one keeps its default. A setting absent from the
    file has its default.
    """
    known = {item.name: item for item in all_settings()}
    file = TomlFile.read(directory / FILE, problems)
    given = dict(_flatten(file.tree, known))
    for name in given:
        if name not in known:
            _report_unknown(name, known, file)
    values: dict[str, Any] = {}
    places = {}
    for name, item in known.items():
        places[name] = file.place(name)
        if name in given:
            file.take(item, given[name], name, values)
    for name, item in known.items():
        if name in overrides:
            places[name] = overrides[name].option
            _take_option(item, overrides[name], values, problems)
    # After the options, because each of these depends on given values.
    _apply_seed_option(overrides, values, problems)
    _apply_serial_option(overrides, values, problems)
    if values.get("motion.clock") in ("program", ELSE_REAL):
        values["motion.motion"] = "timed"  # a clock that moves while the program waits needs it
    _apply_keys(values, overrides)
    settings = settings_from(values)
    _check_together(settings, places, problems)
    return LoadedSettings(settings, places)


def _take_option(item: Setting, override: Override, values: dict[str, Any], problems: list[Problem]) -> None:
    given = override.value
    try:
        values[item.name] = item.rule.from_text(given) if isinstance(given, str) else item.rule.check(given)
    except ValueError as error:
        hint = _other_option(given) if item.name == "server.port" and isinstance(given, str) else ""
        problems.append(Problem(override.option, f"{item.with_unit(str(error))}{hint}"))


def _other_option(port: str) -> str:
    """The option that a text in place of a TCP port is for."""
    if re.match(r"(?i)com\d|/dev/|tty|[a-z0-9+]+://", port):
        return f"; a serial port is --serial {cut(port, WORD)}"
    host, colon, number = port.rpartition(":")
    return f"; did you mean --host {cut(host, WORD)} --port {cut(number, WORD)}?" if colon and host else ""


def _flatten(tree: Mapping[str, Any], names: Iterable[str], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The values by dotted name; only known tables are descended into."""
    for key, value in tree.items():
        name = prefix + key
        if isinstance(value, dict) and any(known.startswith(f"{name}.") for known in names):
            yield from _flatten(value, names, f"{name}.")
        else:
            yield name, value


def _report_unknown(name: str, known: Iterable[str], file: TomlFile) -> None:
    """Add the problem with a name that is no setting."""
    tables = {each.rpartition(".")[0] for each in known} - {""}
    if name in tables:
        file.add_problem(name, f"is a table of settings, written [{name}] on a line of its own")
        return
    # The first of those with the same last part: settings outside tables come before the others.
    full_names = {each.rpartition(".")[2]: each for each in reversed([*known])}
    leaf = name.rpartition(".")[2]
    same_leaf = full_names.get(leaf)
    hint = f'; did you mean "{same_leaf}"?' if same_leaf else did_you_mean(name, [*known, *sorted(tables)])
    hint = hint or did_you_mean(leaf, full_names)
    if "." in name and same_leaf and "." not in same_leaf:
        hint += " It belongs above the first [table]."
    file.add_problem(name, f"is not a setting{hint}")


def _apply_seed_option(
    overrides: Mapping[str, Override], values: dict[str, Any], problems: list[Problem]
) -> None:
    """Turn unrepeatable errors off if a seed is given as an option: it is meant to be used."""
    if "seed" not in overrides:
        return
    if "randerror" in overrides and values.get("randerror", False):
        other = overrides["randerror"].option
        what = f"asks for repeatable errors and {other} for different ones; give one of the two"
        problems.append(Problem(overrides["seed"].option, what))
    values["randerror"] = False


def _apply_serial_option(
    overrides: Mapping[str, Override], values: dict[str, Any], problems: list[Problem]
) -> None:
    """Turn the simulated robot off if a robot's port is given as an option: it is meant to be used."""
    if "serial.port" not in overrides or not values.get("serial.port"):
        return
    if "sim" in overrides and values.get("sim", False):
        other = overrides["sim"].option
        what = f"asks for a real robot and {other} for the simulated one; give one of the two"
        problems.append(Problem(overrides["serial.port"].option, what))
    values["sim"] = False


def _apply_keys(values: dict[str, Any], overrides: Mapping[str, Override]) -> None:
    """Remove the file's keys from the defaults of other actions. An option takes no key from another action:
    who types it sees at once what is wrong."""
    named = {
        name: keys for name, keys in values.items() if name.startswith("keys.") and name not in overrides
    }
    given = {name.removeprefix("keys."): keys for name, keys in named.items()}
    if any(keys != getattr(KeySettings(), name) for name, keys in given.items()):
        # Most runs leave the keys as they are.
        from simmer_tui.config.keys import yielding_defaults

        yielding = {f"keys.{name}": keys for name, keys in yielding_defaults(given).items()}
        values.update({name: keys for name, keys in yielding.items() if name not in overrides})


def _check_together(settings: Settings, places: Mapping[str, str], problems: list[Problem]) -> None:
    """Check combinations of values, and values that this version does not support."""
    if not settings.sim and not settings.serial.port:
        what = (
            "means the real robot, which needs its serial port: --serial PORT, or port in [serial] "
            "(simmer-tui ports lists them)"
        )
        problems.append(Problem(places["sim"], what))
    server = settings.server
    # Two ports of 0 are two free ones.
    if server.port == server.reply_port != 0:
        what = f"must differ from server.port, which is {server.port} too"
        problems.append(Problem(places["server.reply_port"], what))
    if settings.keys != KeySettings():
        # Most runs leave the keys as they are.
        from simmer_tui.config.keys import key_problems

        problems += key_problems(settings.keys, places)


_TABLE = re.compile(r"\[\s*(\w+)\s*\]")
_FIRST = "# Settings of the simulator. Every one has a command-line option too, and the option wins."
_NONE: Mapping[str, Any] = MappingProxyType({})


def settings_text(values: Mapping[str, Any]) -> str:
    """settings.toml with every setting, `values` (by dotted name) instead of the defaults. Raises KeyError
    for a name that is not a setting."""
    known = {item.name for item in all_settings()}
    for name in values:
        if name not in known:
            raise KeyError(name)
    return with_all_settings(f"{_FIRST}\n", values)


def with_all_settings(text: str, values: Mapping[str, Any] = _NONE) -> str:
    """A settings.toml with missing settings added at the end of their tables, so that a new setting needs no
    line in the bundled sets. A text that is not TOML, or lacks nothing, stays unchanged."""
    # Some milliseconds, which a start saves.
    import json

    problems: list[Problem] = []
    tree = TomlFile(FILE, text, problems).tree
    if problems:
        return text
    sections: dict[str, list[str]] = {"": []}
    table = ""
    for line in text.splitlines():
        header = _TABLE.match(line)
        table = header[1] if header else table
        sections.setdefault(table, []).append(line)
    missing = [item for item in all_settings() if not _is_there(item, tree, sections)]
    begun: set[str] = set()
    for item in missing:
        table, _, key = item.name.rpartition(".")
        lines = sections.setdefault(table, [f"[{table}]"])
        if table not in begun:
            begun.add(table)
            # Exactly one blank line is between the old lines and the added ones.
            while lines[-1:] == [""]:
                lines.pop()
            lines += [] if lines == [f"[{table}]"] else [""]
        # Flags, numbers, texts without control characters and lists of them are the same in JSON and TOML.
        value = json.dumps(values.get(item.name, item.default), ensure_ascii=False)
        lines += [_comment(item), f"{key} = {value}"]
    if not missing:
        return text
    return "\n\n".join("\n".join(lines).rstrip() for lines in sections.values()) + "\n"


def _is_there(item: Setting, tree: Mapping[str, Any], sections: Mapping[str, list[str]]) -> bool:
    """True if a file has a setting, or has its table in a form to which no line can be added."""
    table, _, key = item.name.rpartition(".")
    inside = tree.get(table, {}) if table else tree
    return key in inside or (table in tree and table not in sections)


def _comment(item: Setting) -> str:
    unit = f", {item.unit}" if item.unit else ""
    # The names of keys are explained once, at the top of their table.
    allowed = "" if item.name.startswith("keys.") else f": {item.rule.allowed}{unit}"
    return f"# {item.help[0].upper()}{item.help[1:]}{allowed}."
