"""Fill in the numbers that pages state, from the code.

A number that a page takes from the code has a comment behind it, which readers do not see:

    at most 1,000<!--=run.belief_grid.MOST_ROWS:,--> rows

The comment names a constant of the package, or a default below: `key.pause` is the key of an action. Behind
the name may stand a format (`:,`), or `!w` for a number as a word. A number may be multiplied or divided:
`100*report.finding.LEAST_SHARE:g`. A comment must not begin a line: Markdown would take the line for HTML.
"""

from __future__ import annotations

import re
import string
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from simmer_tui.cli.command_line import ExitCode
from simmer_tui.config.mission_toml import MissionSpec
from simmer_tui.config.settings import KeySettings, Settings
from simmer_tui.sim.sensors import KINDS, LidarSpec
from simmer_tui.sim.specs import GripperSpec
from simmer_tui.trials.sequential import REQUIRED_RATE, sequential_test
from simmer_tui.tui.key_table import shortest_key

ROOT = Path(__file__).resolve().parent.parent
_NUMBER = re.compile(r"(`[^`\n]*`|[\w.,]*\w)<!--=(.*?)-->")
_WORDS = ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"]
_SHARES = {0.25: "quarter", 0.5: "half", 1 / 3: "third"}


def numbered_pages() -> Iterator[tuple[Path, str]]:
    """The pages with such numbers, each with its text with the numbers of the code. Raises ValueError for a
    comment that names nothing."""
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))):
        text = path.read_text("utf-8")
        if _NUMBER.search(text):
            yield path, with_numbers(text, path.name)


def with_numbers(text: str, name: str) -> str:
    """The text of a page with the numbers of the code. Raises ValueError, with the page's `name`, for a
    comment that names nothing."""

    def filled(match: re.Match[str]) -> str:
        try:
            value = _Formatter().vformat(f"{{{match[2]}}}", (), {})
        except (LookupError, AttributeError, ImportError, ValueError) as error:
            raise ValueError(f"{name}: {match[0]}: {error}") from None
        if match[1].startswith("`"):
            value = f"`{value}`"
        elif match[1][0].isupper():
            value = value.capitalize()
        return f"{value}<!--={match[2]}-->"

    return _NUMBER.sub(filled, text)


@cache
def _defaults() -> dict[str, Any]:
    """The values that no constant has, by name."""
    test = sequential_test(REQUIRED_RATE)
    return {
        "settings": Settings(),
        "mission": MissionSpec(),
        "grip": GripperSpec(code="p1"),
        "lidar": LidarSpec(kind=KINDS["lidar"], number=1, code="sc"),
        "test": test,
        "runs": {f"at_{true}": round(test.expected_runs(true / 1000)) for true in (0, 750, 825, 900, 1000)},
        "exit": ExitCode,
        "key": {name: shortest_key(KeySettings(), name) for name in KeySettings.__struct_fields__},
        **{
            path.stem.replace("-", "_"): tomllib.loads(path.read_text("utf-8"))
            for path in (ROOT / "config" / "profiles").rglob("*.toml")
        },
    }


class _Formatter(string.Formatter):
    """Fills in numbers by the names of constants."""

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> tuple[Any, str]:
        for sign in "*/":
            left, found, right = field_name.partition(sign)
            if found:
                first, second = _value(left), _value(right)
                return first * second if sign == "*" else first / second, field_name
        return _value(field_name), field_name

    def convert_field(self, value: Any, conversion: str | None) -> Any:
        if conversion == "w":
            return _SHARES.get(value) or _WORDS[int(value)]
        return value


def _value(name: str) -> Any:
    if name.isdigit():
        return int(name)
    name, bracket, key = name.removesuffix("]").partition("[")
    first, *rest = name.split(".")
    value = _defaults()[first] if first in _defaults() else resolve_name(f"simmer_tui.{name}")
    for part in rest if first in _defaults() else ():
        value = value[part] if isinstance(value, dict) else getattr(value, part)
    return value[int(key) if key.isdigit() else key] if bracket else value
