"""mission.toml, the optional file of a set that says what the robot is to do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from simmer_tui.config.csv_table import read_text
from simmer_tui.config.rules import Choice, Integer, Number, Pair, Rule, describe, did_you_mean, listed
from simmer_tui.config.toml_text import key_lines, parse_toml, place_of
from simmer_tui.errors import Problem

FILE = "mission.toml"
ANY = "any"


class Heading(StrEnum):
    """Start headings that are drawn: a multiple of 90 degrees, or any at all."""

    QUARTER = "quarter"
    ANY = "any"


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionSpec:
    """mission.toml: fetch the block and set it down in the drop zone.

    Places are in inches, global; None stands for one that is drawn anew for every run: the `start`
    the middle of a cell of value 2, the `block` anywhere in the cells of value 3 with `clearance`
    inches between it and any wall, the `drop_zone` a cell of value 2, another than the start's if
    there is one. A `drop_zone` that is given is the cell around that place. `time_limit` is in
    simulated seconds. `contacts` is how many contacts with a wall are allowed, None for any number.
    """

    start: tuple[float, float] | None = None
    heading: float | Heading = Heading.QUARTER
    block: tuple[float, float] | None = None
    clearance: float = 1.0
    drop_zone: tuple[float, float] | None = None
    time_limit: float = 300.0
    contacts: int | None = 0


@dataclass(frozen=True, slots=True)
class _Or:
    """One of some words, or what another rule takes."""

    words: tuple[str, ...]
    other: Rule[Any]

    @property
    def allowed(self) -> str:
        return f"{Choice(self.words).allowed}, or {self.other.allowed}"

    @property
    def metavar(self) -> str:
        return self.other.metavar

    def check(self, value: object) -> Any:
        try:
            return (Choice(self.words) if isinstance(value, str) else self.other).check(value)
        except ValueError:
            raise ValueError(f"must be {self.allowed}, not {describe(value)}") from None

    def from_text(self, text: str) -> Any:
        return self.check(text)


_PLACE = _Or((ANY,), Pair())
_RULES: dict[str, Rule[Any]] = {
    "start": _PLACE,
    "heading": _Or(tuple(heading.value for heading in Heading), Number()),
    "block": _PLACE,
    "clearance": Number(0),
    "drop_zone": _PLACE,
    "time_limit": Number(0, low_open=True),
    "contacts": _Or((ANY,), Integer(0, 1_000_000)),
}


def load_mission(directory: Path, problems: list[Problem]) -> tuple[MissionSpec | None, Mapping[str, int]]:
    """Read mission.toml, if there is one, and the lines of its keys; mistakes go to `problems`."""
    path = directory / FILE
    text = read_text(path, problems) if path.exists() else None
    if text is None:
        return None, {}
    lines = key_lines(text)
    values: dict[str, Any] = {}
    for name, value in parse_toml(text, FILE, problems).items():
        where = place_of(name, FILE, lines)
        rule = _RULES.get(name)
        if rule is None:
            hint = did_you_mean(name, _RULES) or f"; known are {listed(_RULES)}"
            problems.append(Problem(where, f"is not known here{hint}"))
            continue
        try:
            values[name] = rule.check(value)
        except ValueError as error:
            problems.append(Problem(where, str(error)))
    for name in ("start", "block", "drop_zone", "contacts"):
        if values.get(name) == ANY:
            values[name] = None
    if isinstance(values.get("heading"), str):
        values["heading"] = Heading(values["heading"])
    return MissionSpec(**values), lines
