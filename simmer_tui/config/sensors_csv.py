"""sensors.csv: a header row, then one sensor a row."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from simmer_tui.config.codes import (
    CODE_MEANING,
    ENABLED,
    ENABLED_MEANING,
    ENABLED_RULE,
    ID,
    POLL_CHARACTER,
    claim_id,
    read_code,
)
from simmer_tui.config.csv_table import TableRow, read_csv, read_table
from simmer_tui.errors import Problem
from simmer_tui.sim.columns import BASE
from simmer_tui.sim.rules import NumberRule, Rule, describe, did_you_mean, listed
from simmer_tui.sim.sensors import KINDS, SensorKinds
from simmer_tui.sim.specs import SensorKind, SensorSpec

FILE = "sensors.csv"

_ANY_NUMBER = NumberRule()
_ID = re.compile(r"([a-z]+)([0-9]{1,9})")
_NUMBER_AT_END = re.compile(r"[0-9]{1,9}$")
_BASE = {column.name: column for column in BASE}

HEADERS = (ID, POLL_CHARACTER, ENABLED, *_BASE)


def meanings(kinds: SensorKinds = KINDS) -> dict[str, str]:
    """What each column says; in brackets what a blank cell of an optional one means."""
    named = "; ".join(f"{kind.name} ({kind.meaning})" for kind in kinds.values())
    columns = {column.name: column.help for kind in kinds.values() for column in kind.columns}
    return {
        ID: f"the type and a number, such as ultra1; types are {named}",
        POLL_CHARACTER: CODE_MEANING,
        ENABLED: ENABLED_MEANING,
        **{column.name: column.help for column in BASE},
        **columns,
    }


def optional_headers(kinds: SensorKinds = KINDS) -> tuple[str, ...]:
    """The headers a file may have besides, in the order in which people are told of them."""
    headers = dict.fromkeys(column.name for kind in kinds.values() for column in kind.columns)
    return tuple(header for header in headers if header not in _BASE)


def load_sensors(
    directory: Path, codes: dict[str, str], problems: list[Problem], kinds: SensorKinds = KINDS
) -> tuple[SensorSpec, ...]:
    """Read sensors.csv. Rows with mistakes are left out, with a problem each.

    `codes` maps codes in use to their places, and is added to.
    """
    table = read_csv(directory / FILE, problems)
    if table is None:
        return ()
    seen: dict[str, int] = {}
    rows = read_table(table, HEADERS, optional_headers(kinds), problems)
    specs = [_read_row(row, kinds, seen, codes, problems) for row in rows]
    return tuple(spec for spec in specs if spec is not None)


def profile_rules(kind: type[SensorKind]) -> dict[str, Rule[Any]]:
    """The rules of what a profile may say of a kind, by field of `SensorSpec`: all but where on the
    robot the sensor is (its height, on which a line sensor's view depends, it may say)."""
    return {column.field: column.rule for column in kind.columns if not column.mounting}


def _read_row(
    row: TableRow, kinds: SensorKinds, seen: dict[str, int], codes: dict[str, str], problems: list[Problem]
) -> SensorSpec | None:
    before = len(problems)
    identity = _read_id(row, kinds, seen, problems)
    kind = identity[0] if identity else None
    code = read_code(row, codes, problems)
    enabled = row.read(ENABLED, ENABLED_RULE, problems)
    values: dict[str, Any] = {}
    for header in (*_BASE, *optional_headers(kinds)):
        if row.values.get(header) is not None:
            _read_cell(header, row, kind, kinds, values, problems)
    if identity is None or code is None or enabled is None or len(problems) > before:
        return None
    kind, number = identity
    blanks = {column.field: column.default for column in kind.columns if column.default is not None}
    spec = kind.spec_type(kind=kind, number=number, code=code, enabled=enabled == 1, **(blanks | values))
    contradiction = kind.contradiction(spec)
    if contradiction is not None:
        columns, what = contradiction
        place = next((c.name for c in columns if row.values.get(c.name)), columns[0].name)
        problems.append(Problem(row.where(place), what))
    return spec


def _read_id(
    row: TableRow, kinds: SensorKinds, seen: dict[str, int], problems: list[Problem]
) -> tuple[type[SensorKind], int] | None:
    text = row.values.get(ID)
    if text is None:
        return None
    match = _ID.fullmatch(text.lower())
    if match is None or match[1] not in kinds:
        shown = describe(text) if text else "blank"
        number = _NUMBER_AT_END.search(text)
        hint = did_you_mean(text, [f"{kind}{number[0] if number else 1}" for kind in kinds])
        what = f"must be a type and a number, such as ultra1, not {shown}{hint}"
        problems.append(Problem(row.where(ID), f"{what} (types: {listed(kinds)})"))
        return None
    kind, number_value = kinds[match[1]], int(match[2])
    return (kind, number_value) if claim_id(f"{kind.name}{number_value}", row, seen, problems) else None


def _read_cell(
    header: str,
    row: TableRow,
    kind: type[SensorKind] | None,
    kinds: SensorKinds,
    values: dict[str, Any],
    problems: list[Problem],
) -> None:
    """Read a cell of a row whose kind is `kind`, or cannot be told."""
    text = row.values[header]
    owners = [each for each in kinds.values() if any(c.name == header for c in each.columns)]
    columns = (kind or owners[0]).columns if owners else ()
    column = next((c for c in columns if c.name == header and (kind or c.common)), None)
    if column is not None:
        if text or column.needed:
            value = row.read(header, column.rule, problems)
            if value is not None:
                values[column.field] = value
    elif text and header in _BASE:
        value = row.read(header, _ANY_NUMBER, problems)
        if value is not None:
            values[_BASE[header].field] = value
    elif text and kind is not None:
        names = listed(each.name for each in owners)
        what = f"is for {names} only; leave it blank for {kind.name}, not {describe(text)}"
        problems.append(Problem(row.where(header), what))
