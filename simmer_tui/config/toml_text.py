"""TOML files, read so that every mistake can be reported with its line number."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from simmer_tui.errors import Problem
from simmer_tui.sim.command import escape

_KEY = r"""(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')"""
_DOTTED = rf"{_KEY}(?:\s*\.\s*{_KEY})*"
_TABLE_LINE = re.compile(rf"\s*\[+\s*({_DOTTED})\s*\]")
_KEY_LINE = re.compile(rf"\s*({_DOTTED})\s*=")
_ERROR_PLACE = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)")


def parse_toml(text: str, file: str, problems: list[Problem]) -> dict[str, Any]:
    """The values of a TOML text; empty, and a problem, if it is none."""
    import tomllib

    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
        found = _ERROR_PLACE.search(message)
        line = (found and found[1]) or str(text.count("\n") + 1)
        what = escape(_ERROR_PLACE.sub("", message), 120)
        problems.append(Problem(f"{file}:{line}", f"is not TOML here: {what}"))
    except (ValueError, RecursionError) as error:
        # tomllib lets these two through: a number of thousands of digits, brackets nested as deep.
        problems.append(Problem(file, f"is not TOML that can be read: {escape(str(error), 120)}"))
    return {}


def key_lines(text: str) -> dict[str, int]:
    """The line of each key by dotted name, found by pattern, because tomllib does not report lines."""
    lines: dict[str, int] = {}
    prefix = ""
    for number, line in enumerate(text.split("\n"), 1):
        if header := _TABLE_LINE.match(line):
            name = _plain(header[1])
            prefix = f"{name}."
            lines.setdefault(name, number)
        elif key := _KEY_LINE.match(line):
            parts = (prefix + _plain(key[1])).split(".")
            for end in range(1, len(parts) + 1):
                lines.setdefault(".".join(parts[:end]), number)
    return lines


def _plain(dotted: str) -> str:
    return ".".join(part.strip().strip("\"'") for part in dotted.split("."))


def place_of(name: str, file: str, lines: Mapping[str, int]) -> str:
    """`FILE:LINE:name`; for one that has no line of its own, the line of its table."""
    shown = escape(name, 60)
    while name:
        if name in lines:
            return f"{file}:{lines[name]}:{shown}"
        name = name.rpartition(".")[0]
    return f"{file}:{shown}"
