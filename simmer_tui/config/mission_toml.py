"""mission.toml, the optional file of a set that says what the robot is to do."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any

from msgspec import Struct

from simmer_tui.config.csv_table import read_text
from simmer_tui.config.toml_text import key_lines, parse_toml, place_of
from simmer_tui.errors import Problem
from simmer_tui.sim.rules import IntegerRule, NumberRule, PairRule, Rule, WordOrRule, did_you_mean, listed

FILE = "mission.toml"
ANY = "any"


class Heading(StrEnum):
    """Start headings that are drawn: a multiple of 90 degrees, or any at all."""

    QUARTER = "quarter"
    ANY = "any"


class MissionSpec(Struct, frozen=True, kw_only=True):
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


_ANY = ((ANY, None),)
_PLACE = WordOrRule(_ANY, PairRule())
KEYS: dict[str, tuple[Rule[Any], str]] = {
    "start": (_PLACE, "where the robot's centre starts, inches; any: the middle of any cell of value 2"),
    "heading": (
        WordOrRule(tuple((heading.value, heading) for heading in Heading), NumberRule()),
        "its heading there, degrees; quarter: any multiple of 90; any: any at all",
    ),
    "block": (_PLACE, "where the block's centre is, inches; any: anywhere in the cells of value 3"),
    "clearance": (NumberRule(0), "least distance between a block that lies anywhere and a wall, inches"),
    "drop_zone": (
        _PLACE,
        "where the block is to go: the cell around this place; any: a cell of value 2 but the start's",
    ),
    "time_limit": (NumberRule(0, low_open=True), "simulated time for all of it, seconds"),
    "contacts": (WordOrRule(_ANY, IntegerRule(0, 1_000_000)), "contacts with a wall that are allowed"),
}
"""The keys of the file: what each may be, and what it says."""


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
        if name not in KEYS:
            hint = did_you_mean(name, KEYS) or f"; known are {listed(KEYS)}"
            problems.append(Problem(where, f"is not known here{hint}"))
            continue
        try:
            values[name] = KEYS[name][0].check(value)
        except ValueError as error:
            problems.append(Problem(where, str(error)))
    return MissionSpec(**values), lines
