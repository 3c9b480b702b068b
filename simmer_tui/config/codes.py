"""What sensors.csv and drive.csv share: command codes, which must be unique across both, and flags."""

from __future__ import annotations

from simmer_tui.config.csv_table import TableRow
from simmer_tui.errors import Problem
from simmer_tui.sim.rules import CodeRule, IntegerRule

ID = "ID"
POLL_CHARACTER = "Poll Character"
ENABLED = "Enabled"
CODE_MEANING = "what a program sends to use it: two characters, in no other row of sensors.csv or drive.csv"
ENABLED_MEANING = "1: the robot has it; 0: commands to it are refused"
ENABLED_RULE = IntegerRule(0, 1, "0 (off) or 1 (on)")


def read_code(row: TableRow, codes: dict[str, str], problems: list[Problem]) -> str | None:
    """The code of a row, entered in `codes` (code to place) so that the next row cannot have it."""
    code = row.read(POLL_CHARACTER, CodeRule(), problems)
    if code is None:
        return None
    if code in codes:
        what = f'"{code}" is the code of {codes[code]} already; codes must be unique over both files'
        problems.append(Problem(row.where(POLL_CHARACTER), what))
        return None
    codes[code] = f"{row.file}:{row.line}"
    return code


def claim_id(name: str, row: TableRow, seen: dict[str, int], problems: list[Problem]) -> bool:
    """Whether no earlier row has the ID `name`; `seen` keeps the line of each."""
    if name in seen:
        what = f'"{name}" is in line {seen[name]} already; every ID must be there once'
        problems.append(Problem(row.where(ID), what))
        return False
    seen[name] = row.line
    return True
