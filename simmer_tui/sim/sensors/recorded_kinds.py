"""Kinds of sensor that are only described: those of a log, and of files that were only parsed.

Such a kind has a name, a meaning, a unit and columns. It makes no readings; its readings are in a log.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from msgspec import Struct, defstruct
from msgspec.structs import fields

from simmer_tui.sim.columns import ERROR, ROTATION, CsvColumn, X, Y, Z
from simmer_tui.sim.command import cut
from simmer_tui.sim.rules import NumberRule, RawTextRule, Rule, WordRule, is_number
from simmer_tui.sim.sensors.base import Sensor
from simmer_tui.sim.sensors.range_sensors import RangeSpec
from simmer_tui.sim.specs import SensorKind, SensorSpec

# Characters of a cell of a table: no value of a sensor is longer.
_LONGEST_CELL = 1000
# Characters that fit in a line of a table, with room for numbers beside it.
_LONGEST_LABEL = 100
LONGEST_KIND = 20
"""Most letters of the name of a kind."""
_KIND = re.compile(rf"[a-z]{{1,{LONGEST_KIND}}}")
_GIVEN = ("kind", "number", "code", "enabled")
"""Fields of a row that come from its ID, code and switch, never from a column."""


_SAME = ("name", "meaning", "unit", "short_name", "is_range", "is_yes_or_no", "counts")
"""Attributes that a kind and its description share."""
_PLACED = (X, Y, Z, ROTATION, ERROR)
"""The columns of a kind whose own columns are not known."""


class RecordedColumn(Struct, frozen=True, omit_defaults=True):
    """A column of a kind, as a log describes it: its header, the field it fills, and its default. `words` are
    those for True and False, if it has such words."""

    header: str
    field: str
    unit: str = ""
    label: str = ""
    is_number: bool = True
    words: tuple[str, ...] = ()
    default: float | str | bool | None = None


class RecordedKind(Struct, frozen=True, omit_defaults=True, kw_only=True):
    """The description of a kind of sensor. `title` is the name of its class; `any_columns` is true if its
    columns are not known, so that sensors.csv may have any."""

    name: str
    title: str
    meaning: str = "a device of the team's own"
    unit: str = ""
    short_name: str = ""
    is_range: bool = False
    is_yes_or_no: bool = False
    counts: bool = False
    any_columns: bool = False
    columns: tuple[RecordedColumn, ...] = ()


class RecordedSensor(Sensor):
    """A sensor of which only a description is known."""

    is_opaque = True


def recorded_kind(kind: type[SensorKind]) -> RecordedKind:
    """The description of a kind."""
    blank = kind.spec_type(kind=kind, number=1, code="?")
    columns = tuple(_recorded(column, blank) for column in kind.columns)
    same = {each: getattr(kind, each) for each in _SAME}
    return RecordedKind(title=kind.__name__, columns=columns, **same)


def is_label(text: object) -> bool:
    """True for a line of text that is safe on a terminal and in a log."""
    return type(text) is str and text.isprintable() and len(text) <= _LONGEST_LABEL


def is_kind_name(text: object) -> bool:
    """True for a name that a kind of sensor may have: it begins the IDs in sensors.csv."""
    return type(text) is str and _KIND.fullmatch(text) is not None


def _is_field(name: str, row: type[SensorSpec]) -> bool:
    """True for a field that a column may fill: one of a row's, or an additional one."""
    if name in {each.name for each in fields(row)}:
        return name not in _GIVEN
    return name.isidentifier() and not name.startswith("__") and not hasattr(row, name)


def _recorded(column: CsvColumn, blank: SensorSpec) -> RecordedColumn:
    rule = column.rule
    default = getattr(blank, column.field) if column.default is None else column.default
    words: tuple[str, ...] = ()
    if isinstance(rule, WordRule) and rule.meant == (False, True):
        words = rule.choices
    return RecordedColumn(
        header=column.name,
        field=column.field,
        unit=column.unit,
        label=column.label,
        is_number=is_number(default),
        words=words,
        default=_plain(default),
    )


def _plain(default: object) -> float | str | bool | None:
    """A default as JSON has it, which has no infinity."""
    if isinstance(default, bool):
        return default
    if isinstance(default, int | float):
        return float(default) if math.isfinite(default) else None
    return cut(str(default), _LONGEST_CELL)


@lru_cache(maxsize=256)
def recorded_class(kind: RecordedKind) -> type[RecordedSensor]:
    """A class of a kind that is only described. The same description gives the same class, so that rows of
    two sets can be compared. Raises ValueError for a description that fits no class."""
    if not (is_kind_name(kind.name) and is_label(kind.title) and kind.title.isidentifier()):
        raise ValueError("a kind of sensor whose name is no name")
    if not all(map(is_label, (kind.meaning, kind.unit, kind.short_name))):
        raise ValueError(f"the meaning, unit or short name of the kind {kind.name} is no line of text")
    row = RangeSpec if kind.is_range else SensorSpec
    for column in kind.columns:
        if not all(map(is_label, (column.header, column.unit, column.label, *column.words))):
            raise ValueError(f"a column of the kind {kind.name} has a name that is no line of text")
        if not _is_field(column.field, row):
            raise ValueError(f"the column {column.header!r} of the kind {kind.name} fills what is no field")
    values = {each: getattr(kind, each) for each in (*_SAME, "any_columns")}
    values["columns"] = _PLACED if kind.any_columns else tuple(_columns(kind.columns))
    values |= {"spec_type": _spec_type(kind.columns, row), "__doc__": f"{kind.meaning}, described only."}
    return type(kind.title, (RecordedSensor,), values)


def _spec_type(columns: Iterable[RecordedColumn], row: type[SensorSpec]) -> type[Struct]:
    """A class of rows, derived from `row`, that has a field for each of these columns."""
    known = {each.name for each in fields(row)}
    own = {column.field: column for column in columns if column.field not in known}
    if not own:
        return row
    more = [(name, Any, 0.0 if each.default is None else each.default) for name, each in own.items()]
    return defstruct("RecordedSpec", more, bases=(row,), frozen=True, kw_only=True)


def _columns(columns: Iterable[RecordedColumn]) -> Iterable[CsvColumn]:
    for each in columns:
        rule: Rule[Any] = NumberRule() if each.is_number else RawTextRule(_LONGEST_CELL)
        if len(each.words) == 2:
            rule = WordRule(each.words, (False, True))
        yield CsvColumn(
            rule, name=each.header, field=each.field, unit=each.unit, label=each.label, default=each.default
        )
