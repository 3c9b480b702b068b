"""The reader of every TOML file: all mistakes of a file at once, each with its line."""

import re
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from simmer_tui.config.csv_table import read_text
from simmer_tui.errors import Problem
from simmer_tui.sim.command import cut, keyboard_text, meant_number
from simmer_tui.sim.rules import did_you_mean
from simmer_tui.sim.values import Value

_KEY = r"""(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')"""
_DOTTED = rf"{_KEY}(?:\s*\.\s*{_KEY})*"
_TABLE_LINE = re.compile(rf"\s*(\[+)\s*({_DOTTED})\s*\]")
_KEY_LINE = re.compile(rf"\s*({_DOTTED})\s*=")
_ERROR_PLACE = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)")


class TomlFile:
    """A parsed TOML file.

    Args:
        file: Its name in messages.
        text: Its text; empty for a file that is not there.
        problems: Every mistake is added to this list.
    """

    def __init__(self, file: str, text: str, problems: list[Problem]) -> None:
        self.file = file
        self._lines = key_lines(text)
        self._problems = problems
        self.tree = _parsed(text, file, problems) if text else {}
        """The values, as parsed by tomllib."""

    @classmethod
    def read(cls, path: Path, problems: list[Problem]) -> "TomlFile":
        """The file of a path. One that cannot be read is empty, and a problem."""
        return cls(path.name, read_text(path, problems) or "", problems)

    @property
    def mistakes(self) -> int:
        """Number of problems found so far."""
        return len(self._problems)

    def place(self, name: str) -> str:
        """`FILE:LINE:name`; without a line of its own, that of its table; the file for no name."""
        if not name:
            return self.file
        shown, found = cut(name), name
        # A name that is missing has no line; its table may have one.
        while found and found not in self._lines:
            found = found.rpartition(".")[0]
        return f"{self.file}:{self._lines[found]}:{shown}" if found else f"{self.file}:{shown}"

    def add_problem(self, name: str, what: str) -> None:
        """Add a problem at the place of a name."""
        self._problems.append(Problem(self.place(name), what))

    def check_names(
        self, names: Iterable[str], known: Collection[str], prefix: str = "", listed_as: str = "known"
    ) -> None:
        """Add a problem for each name that is not one of the `known` ones. The problem lists them, unless one
        of them seems to be meant or `listed_as` is empty."""
        listing = f" ({listed_as}: {', '.join(known)})" if listed_as else ""
        for name in names:
            if name not in known:
                self.add_problem(prefix + name, f"is not known here{did_you_mean(name, known) or listing}")

    def table(self, name: str) -> dict[str, Any]:
        """A table by its dotted name; empty if it is missing, and a problem if it is something else."""
        found: Any = self.tree
        for part in name.split("."):
            found = found.get(part, {})
            if not isinstance(found, dict):
                self.add_problem(name, f"must be a table: [{name}]")
                return {}
        table: dict[str, Any] = found
        return table

    def tables(self, name: str) -> list[dict[str, Any]]:
        """The tables of an array, `[[name]]`."""
        found = self.tree.get(name, [])
        if isinstance(found, list) and all(isinstance(each, dict) for each in found):
            return found
        self.add_problem(name, f"must be tables: [[{name}]]")
        return []

    def values(
        self,
        known: Iterable[Value],
        tree: Mapping[str, Any] | None = None,
        prefix: str = "",
        *,
        others: Iterable[str] = (),
        needed: bool = False,
    ) -> dict[str, Any]:
        """The values of a table by name; wrong and unknown ones are problems.

        Args:
            known: The values that the table may have.
            tree: The table; by default the top of the file.
            prefix: The table's name in messages, with its dot.
            others: Names of tables that are allowed beside the values.
            needed: True if all of `known` must be given.
        """
        tree = self.tree if tree is None else tree
        described = {value.name: value for value in known}
        if needed:
            for name, value in described.items():
                if name not in tree:
                    self.add_problem(prefix + name, f"is missing; must be {value.rule.allowed}")
        names = [*described, *others]
        values: dict[str, Any] = {}
        for name, given in tree.items():
            if name in described:
                self.take(described[name], given, prefix + name, values)
            else:
                # If all values are needed, the problems above already name the missing ones.
                self.check_names([name], names, prefix, "" if needed else "known")
        return values

    def take(self, value: Value, given: object, name: str, values: dict[str, Any]) -> None:
        """Put a given value into `values`, under its own name, if its rule allows it."""
        try:
            values[value.name] = value.rule.check(given)
        except ValueError as error:
            self.add_problem(name, value.with_unit(str(error)))


def _parsed(text: str, file: str, problems: list[Problem]) -> dict[str, Any]:
    """The values of a TOML text; empty, and a problem, if it is not TOML."""
    # A third of a millisecond, which a start without TOML files saves.
    import tomllib

    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
        found = _ERROR_PLACE.search(message)
        # tomllib says "end of document" where a bracket or quote was never closed.
        line = (found and found[1]) or str(text.count("\n") + 1)
        what = cut(_ERROR_PLACE.sub("", message))
        lines = text.split("\n")
        hint = _toml_hint(lines[int(line) - 1]) if int(line) <= len(lines) else ""
        problems.append(Problem(f"{file}:{line}", f"is not TOML here: {hint or what}"))
    except (ValueError, RecursionError) as error:
        # Errors that tomllib does not catch: a number of thousands of digits, and brackets nested as deep.
        problems.append(Problem(file, f"is not TOML that can be read: {error}"))
    return {}


_CURLY = re.compile("[\u2018\u2019\u201a\u201c\u201d\u201e]")
_WINDOWS_PATH = re.compile(r"""=\s*"([^"]*\\[^"]*)"?""")
_WORD_VALUE = re.compile(r"""(\s*[\w."-]+\s*=\s*)([^\s"'\[\]{}#][^"'#]*?)\s*(?:#.*)?""")
_COLON = re.compile(r"""(\s*[\w-]+)\s*:\s*(\S.*)""")
_WORDS = {"true": "true", "yes": "true", "on": "true", "false": "false", "no": "false", "off": "false"}


def _toml_hint(line: str) -> str:
    """The usual mistake in a line that is not TOML, and the line as it is written; empty for others."""
    line = line.rstrip("\r")
    if _CURLY.search(line):
        straight = cut(keyboard_text(line).strip())
        return f"curly quotes are no quotes; write {straight}"
    if found := _WINDOWS_PATH.search(line):
        return f"a backslash in \"...\" begins an escape sequence; write '{cut(found[1])}', in single quotes"
    if found := _COLON.fullmatch(line):
        return f"a value stands after =; write {cut(f'{found[1].strip()} = {found[2]}')}"
    found = _WORD_VALUE.fullmatch(line)
    if found is None:
        return ""
    name, value = found[1].lstrip(), found[2]
    if value.lower() in _WORDS:
        return f"true and false have small letters and no quotes; write {cut(name + _WORDS[value.lower()])}"
    if number := meant_number(value):
        return f"a number has a decimal point and no unit; write {cut(name + number)}"
    if re.match(r"[A-Za-z./~\\]", value):
        quote = "'" if "\\" in value else '"'
        return f"a text has quotes; write {cut(f'{name}{quote}{value}{quote}')}"
    return ""


def key_lines(text: str) -> dict[str, int]:
    """The line of each key by dotted name, found by pattern, because tomllib does not report lines. The keys
    of the second table of an array `[[name]]` are `name.2.key`; `name` is the first."""
    lines: dict[str, int] = {}
    prefix = ""
    counts: dict[str, int] = {}
    for number, line in enumerate(text.split("\n"), 1):
        if header := _TABLE_LINE.match(line):
            name = _plain(header[2])
            if len(header[1]) > 1:
                counts[name] = counts.get(name, 0) + 1
                lines.setdefault(name, number)
                name = f"{name}.{counts[name]}"
            prefix = f"{name}."
            lines.setdefault(name, number)
        elif key := _KEY_LINE.match(line):
            parts = (prefix + _plain(key[1])).split(".")
            for end in range(1, len(parts) + 1):
                lines.setdefault(".".join(parts[:end]), number)
    return lines


def _plain(dotted: str) -> str:
    return ".".join(part.strip().strip("\"'") for part in dotted.split("."))
