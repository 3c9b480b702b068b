"""drive.csv: a header row, then at most one row for each way to move."""

from __future__ import annotations

from pathlib import Path

from simmer_tui.config.codes import ENABLED, ENABLED_RULE, ID, POLL_CHARACTER, claim_id, read_code
from simmer_tui.config.rules import Choice, Number
from simmer_tui.config.sheet import TableRow, read_sheet, read_table
from simmer_tui.errors import Problem
from simmer_tui.sim.specs import Axes, DriveKind, DriveSpec

FILE = "drive.csv"
TRANSLATION_SPEED = 6.0
"""Speed of a translation unless its row says otherwise, in/s."""
ROTATION_SPEED = 120.0
"""Speed of a rotation unless its row says otherwise, deg/s."""

# The file has Y before X; the fields of Axes are x, y, r.
_ERRORS = ("X-Axis Error", "Y-Axis Error", "Rotation Error")
_BIASES = ("X-Axis Bias", "Y-Axis Bias", "Rotation Bias")
_GAIN, _SPEED = "Gain", "Speed"

HEADERS = (
    ID,
    POLL_CHARACTER,
    ENABLED,
    "Y-Axis Error",
    "X-Axis Error",
    "Rotation Error",
    "Y-Axis Bias",
    "X-Axis Bias",
    "Rotation Bias",
)
OPTIONAL_HEADERS = (_GAIN, _SPEED)

_KIND = Choice(tuple(kind.value for kind in DriveKind))


def load_drives(directory: Path, codes: dict[str, str], problems: list[Problem]) -> tuple[DriveSpec, ...]:
    """Read drive.csv. Rows with mistakes are left out, with a problem each.

    `codes` maps codes in use to their places, and is added to.
    """
    sheet = read_sheet(directory / FILE, problems)
    if sheet is None:
        return ()
    seen: dict[str, int] = {}
    rows = read_table(sheet, HEADERS, OPTIONAL_HEADERS, problems)
    specs = [_read_row(row, seen, codes, problems) for row in rows]
    return tuple(spec for spec in specs if spec is not None)


def _read_row(
    row: TableRow, seen: dict[str, int], codes: dict[str, str], problems: list[Problem]
) -> DriveSpec | None:
    name = row.read(ID, _KIND, problems)
    is_new = name is not None and claim_id(name, row, seen, problems)
    code = read_code(row, codes, problems)
    enabled = row.read(ENABLED, ENABLED_RULE, problems)
    error = _read_axes(row, _ERRORS, Number(0), problems)
    bias = _read_axes(row, _BIASES, Number(), problems)
    gain = row.read(_GAIN, Number(), problems) if row.values.get(_GAIN) else 1.0
    default_speed = ROTATION_SPEED if name == DriveKind.ROT else TRANSLATION_SPEED
    speed = row.read(_SPEED, Number(0, low_open=True), problems) if row.values.get(_SPEED) else default_speed
    if name is None or not is_new or code is None or enabled is None:
        return None
    if error is None or bias is None or gain is None or speed is None:
        return None
    return DriveSpec(
        kind=DriveKind(name),
        code=code,
        enabled=enabled == 1,
        error=error,
        bias=bias,
        gain=gain,
        speed=speed,
    )


def _read_axes(
    row: TableRow, columns: tuple[str, str, str], rule: Number, problems: list[Problem]
) -> Axes | None:
    """Three cells, given in the order x, y, rotation."""
    x, y, r = (row.read(column, rule, problems) for column in columns)
    return None if x is None or y is None or r is None else Axes(x, y, r)
