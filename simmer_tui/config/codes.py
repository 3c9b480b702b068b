"""The first three columns of sensors.csv and drive.csv: IDs, codes (unique across both files) and flags."""

from __future__ import annotations

from typing import Any

from simmer_tui.config.csv_table import TableRow
from simmer_tui.errors import Problem
from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.rules import CodeRule, IntegerRule

ID = "ID"
POLL_CHARACTER = "Poll Character"
CODE = CsvColumn(
    CodeRule(),
    "what a program sends to use it: two characters, in no other row of sensors.csv or drive.csv",
    name=POLL_CHARACTER,
    field="code",
    needed=True,
)
ENABLED = CsvColumn(
    IntegerRule(0, 1, "0 (off) or 1 (on)"),
    "1: the robot has it; 0: commands to it are refused",
    name="Enabled",
    field="enabled",
    needed=True,
)


def read_flags(row: TableRow, codes: dict[str, str], problems: list[Problem]) -> dict[str, Any]:
    """The code and the flag of a row, by field. The code is entered in `codes` (code to place), so that the
    next row cannot have it."""
    values = row.cells((CODE, ENABLED), problems)
    if "enabled" in values:
        values["enabled"] = values["enabled"] == 1
    code = values.get("code")
    if code is None:
        return values
    if code in codes:
        what = f'"{code}" is the code of {codes[code]} already; codes must be unique over both files'
        problems.append(Problem(row.where(POLL_CHARACTER), what))
    codes.setdefault(code, f"{row.file}:{row.line}")
    return values


def claim_id(name: str, row: TableRow, seen: dict[str, int], problems: list[Problem]) -> bool:
    """True if no earlier row has the ID `name`; `seen` keeps the line of each."""
    if name in seen:
        what = f'"{name}" is in line {seen[name]} already; every ID must be there once'
        problems.append(Problem(row.where(ID), what))
        return False
    seen[name] = row.line
    return True
