"""sensors.csv: a header row, then one sensor a row."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simmer_tui.config.codes import ENABLED, ENABLED_RULE, ID, POLL_CHARACTER, claim_id, read_code
from simmer_tui.config.csv_table import TableRow, read_sheet, read_table
from simmer_tui.config.rules import Choice, Integer, Number, Rule, describe, did_you_mean, listed
from simmer_tui.errors import Problem
from simmer_tui.sim.specs import RANGE_KINDS, SensorKind, SensorSpec

FILE = "sensors.csv"
TOF_MAX_RANGE = 47.0
"""How far a time-of-flight sensor sees unless its row says otherwise, inches."""

_ALL = frozenset(SensorKind)
_RANGE = frozenset(RANGE_KINDS)
_IR = frozenset({SensorKind.IR})
_ANY_NUMBER = Number()
_ID = re.compile(r"([a-z]+)([0-9]{1,9})")
_NUMBER_AT_END = re.compile(r"[0-9]{1,9}$")


@dataclass(frozen=True, slots=True)
class _Column:
    """A column: its header, the field of `SensorSpec` it fills, its rule, and whom it is for.

    For `kinds` a blank cell is a problem if `needed`, else means the default. For other kinds a
    cell may hold any number, which changes nothing; if `only`, it must be blank.
    """

    header: str
    field: str
    rule: Rule[Any]
    kinds: frozenset[SensorKind] = _ALL
    needed: bool = False
    only: bool = False


_X, _Y, _Z = "X Position (in)", "Y Position (in)", "Z Position (in)"
_ROTATION, _ERROR, _FOV = "Rotation (deg)", "Percent Error (0-1)", "Field of View (deg)"
_THRESHOLD, _MIN, _MAX, _DETECTS = "Threshold", "Min Range (in)", "Max Range (in)", "Detects"
_SEEING = _RANGE | _IR
_ODOM = frozenset({SensorKind.ODOM})
_MEASURING = _ALL - {SensorKind.LOAD}

_BASE = (
    _Column(_X, "x", _ANY_NUMBER, _SEEING | _ODOM, needed=True),
    _Column(_Y, "y", _ANY_NUMBER, _SEEING | _ODOM, needed=True),
    _Column(_Z, "z", Number(0), _SEEING, needed=True),
    _Column(_ROTATION, "rotation", _ANY_NUMBER, _RANGE | _ODOM | {SensorKind.COMP}, needed=True),
    _Column(_ERROR, "error", Number(0, 1), needed=True),
    _Column(_FOV, "field_of_view", Number(0, 360), _RANGE, needed=True),
    _Column(_FOV, "field_of_view", Number(0, 180, high_open=True), _IR, needed=True),
    _Column(_THRESHOLD, "threshold", Number(0, 1), _IR, needed=True),
)
_OPTIONAL = (
    _Column("Gain", "gain", _ANY_NUMBER, _MEASURING, only=True),
    _Column("Absolute Error", "absolute_error", Number(0), _MEASURING, only=True),
    _Column("Bias", "bias", _ANY_NUMBER, _MEASURING, only=True),
    _Column("Drift (per s)", "drift", _ANY_NUMBER, _MEASURING, only=True),
    _Column(_MIN, "min_range", Number(0), _RANGE, only=True),
    _Column(_MAX, "max_range", Number(0), _RANGE, only=True),
    _Column("Resolution", "resolution", Number(0), _MEASURING, only=True),
    _Column("Rays", "rays", Integer(1, 1000), _RANGE, only=True),
    _Column("Wrap", "wrap", Number(0), _MEASURING, only=True),
    _Column(_DETECTS, "detects", Choice(("black", "white")), _IR, only=True),
)

HEADERS = (ID, POLL_CHARACTER, ENABLED, *dict.fromkeys(column.header for column in _BASE))
OPTIONAL_HEADERS = tuple(column.header for column in _OPTIONAL)


def load_sensors(directory: Path, codes: dict[str, str], problems: list[Problem]) -> tuple[SensorSpec, ...]:
    """Read sensors.csv. Rows with mistakes are left out, with a problem each.

    `codes` maps codes in use to their places, and is added to.
    """
    sheet = read_sheet(directory / FILE, problems)
    if sheet is None:
        return ()
    seen: dict[str, int] = {}
    rows = read_table(sheet, HEADERS, OPTIONAL_HEADERS, problems)
    specs = [_read_row(row, seen, codes, problems) for row in rows]
    return tuple(spec for spec in specs if spec is not None)


def profile_rules(kind: SensorKind) -> dict[str, Rule[Any]]:
    """The rules of what a profile may say of a kind, by field of `SensorSpec`: all but where on the
    robot the sensor is (its height, on which a line sensor's view depends, it may say)."""
    placing = {_X, _Y, _ROTATION, _DETECTS}
    columns = [c for c in (*_BASE, *_OPTIONAL) if kind in c.kinds and c.header not in placing]
    return {column.field: column.rule for column in columns}


def _read_row(
    row: TableRow, seen: dict[str, int], codes: dict[str, str], problems: list[Problem]
) -> SensorSpec | None:
    before = len(problems)
    identity = _read_id(row, seen, problems)
    kind = identity[0] if identity else None
    code = read_code(row, codes, problems)
    enabled = row.read(ENABLED, ENABLED_RULE, problems)
    values: dict[str, Any] = {"max_range": TOF_MAX_RANGE} if kind is SensorKind.TOF else {}
    for header in (*HEADERS[3:], *OPTIONAL_HEADERS):
        _read_column(header, row, kind, values, problems)
    values["detects_white"] = values.pop("detects", "black") == "white"
    if identity is None or code is None or enabled is None or len(problems) > before:
        return None
    spec = SensorSpec(kind=identity[0], number=identity[1], code=code, enabled=enabled == 1, **values)
    if spec.min_range > spec.max_range:
        column = _MIN if row.values.get(_MIN) else _MAX
        what = f"the least range, {spec.min_range:g}, must not be above the greatest, {spec.max_range:g}"
        problems.append(Problem(row.where(column), what))
    return spec


def _read_id(row: TableRow, seen: dict[str, int], problems: list[Problem]) -> tuple[SensorKind, int] | None:
    text = row.values.get(ID)
    if text is None:
        return None
    match = _ID.fullmatch(text.lower())
    kinds = [kind.value for kind in SensorKind]
    if match is None or match[1] not in kinds:
        shown = describe(text) if text else "blank"
        number = _NUMBER_AT_END.search(text)
        hint = did_you_mean(text, [f"{kind}{number[0] if number else 1}" for kind in kinds])
        what = f"must be a type and a number, such as ultra1, not {shown}{hint}"
        problems.append(Problem(row.where(ID), f"{what} (types: {listed(kinds)})"))
        return None
    kind, number_value = SensorKind(match[1]), int(match[2])
    return (kind, number_value) if claim_id(f"{kind.value}{number_value}", row, seen, problems) else None


def _read_column(
    header: str, row: TableRow, kind: SensorKind | None, values: dict[str, Any], problems: list[Problem]
) -> None:
    text = row.values.get(header)
    if text is None:
        return
    columns = [column for column in (*_BASE, *_OPTIONAL) if column.header == header]
    meant = next((c for c in columns if (c.kinds >= _MEASURING if kind is None else kind in c.kinds)), None)
    if meant is not None:
        if text or meant.needed:
            value = row.read(header, meant.rule, problems)
            if value is not None:
                values[meant.field] = value
    elif text and kind is not None and columns[0].only:
        names = listed(k.value for k in SensorKind if any(k in c.kinds for c in columns))
        what = f"is for {names} only; leave it blank for {kind.value}, not {describe(text)}"
        problems.append(Problem(row.where(header), what))
    elif text and not columns[0].only:
        value = row.read(header, _ANY_NUMBER, problems)
        if value is not None:
            values[columns[0].field] = value
