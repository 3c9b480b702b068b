"""sensors.csv: a header row, then one sensor a row."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from msgspec.structs import fields, replace

from simmer_tui.config.csv_table import (
    CODE,
    ENABLED,
    ID,
    POLL_CHARACTER,
    TableRow,
    claim_id,
    headers_of,
    read_csv,
    read_flags,
    read_table,
)
from simmer_tui.errors import Problem
from simmer_tui.sim.columns import BASE, COMMON, MAX_RANGE, MIN_RANGE, CsvColumn
from simmer_tui.sim.rules import NumberRule, describe, did_you_mean, listed
from simmer_tui.sim.sensors import KINDS, SensorKinds
from simmer_tui.sim.specs import SensorKind, SensorSpec

FILE = "sensors.csv"

_ID = re.compile(r"([a-z]+)([0-9]{1,9})")
_NUMBER_AT_END = re.compile(r"[0-9]{1,9}$")

HEADERS = (ID, POLL_CHARACTER, ENABLED.name, *(column.name for column in BASE))


def meanings(kinds: SensorKinds = KINDS) -> dict[str, str]:
    """The help of each column by its header; in brackets the meaning of a blank cell of an optional one, also
    for kinds with a default of their own."""
    named = "; ".join(f"{kind.name} ({kind.meaning})" for kind in kinds.values())
    columns = [*(CODE, ENABLED, *BASE), *(column for kind in kinds.values() for column in kind.columns)]
    return {
        ID: f"the type and a number, such as ultra1; types are {named}",
        **{column.name: _with_defaults(column, kinds) for column in columns},
    }


def _with_defaults(column: CsvColumn, kinds: SensorKinds) -> str:
    """The help of a column, and what a blank cell means to kinds with another default than most."""
    fields_of = (_defaults(kind.spec_type) for kind in kinds.values())
    usual = next((each[column.field] for each in fields_of if column.field in each), None)
    shown = []
    for kind in kinds.values():
        for own in (each for each in kind.columns if each.name == column.name):
            blank = _blank(kind, own)
            if usual not in (None, blank):
                shown.append(
                    f"{kind.name}: {blank:g}" if isinstance(blank, float) else f"{kind.name}: {blank}"
                )
    if not shown:
        return column.help
    begin = f"{column.help[:-1]}; " if column.help.endswith(")") else f"{column.help} ("
    return f"{begin}{', '.join(shown)})"


def _blank(kind: type[SensorKind], column: CsvColumn) -> object:
    """The value that a blank cell means to a kind."""
    return _defaults(kind.spec_type).get(column.field) if column.default is None else column.default


def _defaults(spec_type: type[SensorSpec]) -> dict[str, Any]:
    """The values of the fields of a row that its file leaves blank."""
    return {each.name: each.default for each in fields(spec_type)}


def optional_headers(kinds: SensorKinds = KINDS) -> tuple[str, ...]:
    """The optional headers of a file, in the order in which lists show them."""
    headers = dict.fromkeys(column.name for kind in kinds.values() for column in kind.columns)
    return tuple(header for header in headers if header not in HEADERS)


def load_sensors(
    directory: Path,
    codes: dict[str, str],
    problems: list[Problem],
    kinds: SensorKinds = KINDS,
    longest: float = math.inf,
) -> tuple[SensorSpec, ...]:
    """Read sensors.csv. Rows with mistakes are left out, with a problem each.

    `codes` maps codes in use to their places, and is added to. `longest` is the longest distance in the maze,
    inches: a sensor that reads nothing below it is a mistake.
    """
    table = read_csv(directory / FILE, problems)
    if table is None:
        return ()
    seen: dict[str, int] = {}
    optional = optional_headers(kinds)
    if any(kind.any_columns for kind in kinds.values()):
        # For a device file that was not run: its kinds may have any column.
        optional += tuple(name for name in headers_of(table) if name not in (*HEADERS, *optional))
    owners = _owners(kinds)
    cells: dict[type[SensorKind] | None, _Cells] = {}
    specs = []
    for row in read_table(table, HEADERS, optional):
        before = len(problems)
        identity = _read_id(row, kinds, seen)
        values = read_flags(row, codes)
        kind = identity[0] if identity else None
        if kind not in cells:
            cells[kind] = _cells_of(kind, owners, optional)
        values |= cells[kind].read(row)
        if identity and row.has((CODE, ENABLED)) and len(problems) == before:
            specs.append(_spec(*identity, row, values, longest))
    return tuple(specs)


class _Cells(NamedTuple):
    """The columns of rows of a kind, and for other columns, by header, the kinds that use them."""

    kind: str
    columns: tuple[CsvColumn, ...]
    blank: Mapping[str, str]

    def read(self, row: TableRow) -> dict[str, Any]:
        values = row.cells(self.columns)
        for header, owners in self.blank.items():
            shown = describe(row.values.get(header))
            row.refuse([header], f"is for {owners} only; leave it blank for {self.kind}, not {shown}")
        return values


def _cells_of(
    kind: type[SensorKind] | None, owners: Mapping[str, Sequence[str]], optional: tuple[str, ...]
) -> _Cells:
    """The columns of a kind, and the base columns that it does not use, which may have any number. In a row
    whose kind cannot be read (None), only those common to all kinds are checked."""
    # Files may fill these columns for every kind, with numbers that it does not use.
    usable = {column.name: replace(column, rule=NumberRule(), needed=False) for column in BASE}
    if kind is not None and kind.any_columns:
        return _Cells(kind.name, tuple(usable[header] for header in HEADERS if header in usable), {})
    if kind is not None:
        usable |= {column.name: column for column in kind.columns}
    else:
        usable |= {column.name: column for column in COMMON}
    ordered = tuple(usable[header] for header in (*HEADERS, *optional) if header in usable)
    blank = {
        header: listed(names) for header, names in owners.items() if kind is not None and header not in usable
    }
    return _Cells(kind.name if kind else "", ordered, blank)


def _owners(kinds: SensorKinds) -> dict[str, list[str]]:
    """The kinds that have a column, by its header."""
    owners: dict[str, list[str]] = {}
    for kind in kinds.values():
        for header in dict.fromkeys(column.name for column in kind.columns):
            owners.setdefault(header, []).append(kind.name)
    return owners


def _spec(
    kind: type[SensorKind], number: int, row: TableRow, values: dict[str, Any], longest: float
) -> SensorSpec:
    """The sensor of a row without mistakes; values that contradict each other are a problem."""
    made = {column.field: column.default for column in kind.columns if column.default is not None} | values
    # A base column of other kinds has a number that this kind has no field for.
    own = _defaults(kind.spec_type).keys()
    spec = kind.spec_type(kind=kind, number=number, **{name: made[name] for name in made if name in own})
    contradiction = kind.contradiction(spec)
    if contradiction is not None:
        columns, what = contradiction
        place = next((c.name for c in columns if row.values.get(c.name)), columns[0].name)
        row.add_problem(place, what)
    elif kind.has(MIN_RANGE.field) and spec.min_range >= min(spec.max_range, longest):
        limit = f"the longest distance in this maze, {longest:.1f} in"
        if spec.max_range < longest:
            limit = f"the greatest range, {spec.max_range:g} in"
        what = f"must be below {limit}, not {spec.min_range:g}: the sensor could not read anything"
        row.add_problem(MIN_RANGE.name if row.values.get(MIN_RANGE.name) else MAX_RANGE.name, what)
    return spec


def _read_id(row: TableRow, kinds: SensorKinds, seen: dict[str, int]) -> tuple[type[SensorKind], int] | None:
    """The kind and the number in an ID; None, and a problem, if it is wrong or an earlier row has it."""
    text = row.values.get(ID)
    if text is None:
        return None
    match = _ID.fullmatch(text.lower())
    if match is None or match[1] not in kinds:
        shown = describe(text) if text else "blank"
        number = _NUMBER_AT_END.search(text)
        hint = did_you_mean(text, [f"{kind}{number[0] if number else 1}" for kind in kinds])
        what = f"must be a type and a number, such as ultra1, not {shown}{hint}"
        row.add_problem(ID, f"{what} (types: {listed(kinds)})")
        return None
    kind, number_value = kinds[match[1]], int(match[2])
    return (kind, number_value) if claim_id(f"{kind.name}{number_value}", row, seen) else None
