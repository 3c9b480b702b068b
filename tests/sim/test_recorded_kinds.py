"""Kinds of sensors that are only described: their classes are like those that they describe."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest
from msgspec import json
from msgspec.structs import replace

from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.rules import ChoiceRule, IntegerRule, NumberRule, RawTextRule, WordRule
from simmer_tui.sim.sensors import ObservingSensor, RangeSpec, modelled_sensor, sensor_kinds, sensor_of
from simmer_tui.sim.sensors.recorded_kinds import (
    RecordedColumn,
    RecordedKind,
    is_kind_name,
    is_label,
    recorded_class,
    recorded_kind,
)
from simmer_tui.sim.specs import SensorKind, SensorSpec
from tests.kept_numbers import in_json


class OddSpec(RangeSpec, frozen=True, kw_only=True):
    mode: str = "slow\n"
    most: float = math.inf
    count: int = 7
    awake: bool = True
    asleep: bool = False
    note: Any = ("a", 1)


class Odd(ObservingSensor):
    """A kind with a column of each sort."""

    name = "odd"
    meaning = "oddity"
    unit = "odds"
    is_yes_or_no = True
    is_range = True
    spec_type = OddSpec
    columns = (
        CsvColumn(NumberRule(), name="Gain", field="gain", default=2.5),
        CsvColumn(ChoiceRule(("slow", "fast")), name="Mode", field="mode", label="how"),
        CsvColumn(NumberRule(), name="Most (in)", field="most", unit="in"),
        CsvColumn(IntegerRule(0, 9), name="Count", field="count"),
        CsvColumn(WordRule(("no", "yes"), (False, True)), name="Awake", field="awake"),
        CsvColumn(WordRule(("yes", "no"), (True, False)), name="Asleep", field="asleep"),
        CsvColumn(WordRule(("one", "two"), (1, 2)), name="Rays", field="rays"),
        CsvColumn(NumberRule(), name="Note", field="note"),
    )


def with_column(**values: Any) -> RecordedKind:
    column: dict[str, Any] = {"header": "Heat (C)", "field": "heat"}
    return RecordedKind(name="temp", title="Thermometer", columns=(RecordedColumn(**(column | values)),))


def written(kind: RecordedKind) -> Any:
    return json.decode(json.encode(kind))


@pytest.mark.parametrize("kind", [*sensor_kinds().values()], ids=lambda kind: kind.name)
def test_the_class_of_a_description_has_that_description(kind: type[SensorKind]) -> None:
    made = recorded_class(recorded_kind(kind))
    assert made.is_opaque
    assert issubclass(made.spec_type, SensorSpec)
    assert [column.name for column in made.columns] == [column.name for column in kind.columns]
    assert written(recorded_kind(made)) == written(recorded_kind(kind))
    assert recorded_class(recorded_kind(kind)) is made


def test_the_columns_of_a_recorded_kind_have_rules_of_their_sort() -> None:
    rules = [column.rule for column in recorded_class(recorded_kind(Odd)).columns]
    words = WordRule(("no", "yes"), (False, True))
    number, text = NumberRule(), RawTextRule(1000)
    assert rules == [number, text, number, number, words, text, number, text]
    row = recorded_class(recorded_kind(Odd)).spec_type(kind=Odd, number=3, code="x1")
    found = {name: getattr(row, name) for name in ("gain", "mode", "most", "count", "awake", "note")}
    assert found == {
        "gain": 1.0,
        "mode": "slow\n",
        "most": 0.0,
        "count": 7.0,
        "awake": True,
        "note": "('a', 1)",
    }
    assert recorded_class(RecordedKind(name="bare", title="Bare")).spec_type is SensorSpec
    assert recorded_class(with_column(field="gain")).spec_type is SensorSpec


def test_a_kind_with_any_columns_has_only_its_place_and_error() -> None:
    made = recorded_class(replace(with_column(), any_columns=True, counts=True, unit="C"))
    headers = [column.name for column in made.columns]
    assert headers[:3] == ["X Position (in)", "Y Position (in)", "Z Position (in)"]
    assert headers[3:] == ["Rotation (deg)", "Percent Error (0-1)"]
    assert (made.any_columns, made.counts, made.unit) == (True, True, "C")
    assert (made.is_range, made.is_yes_or_no) == (False, False)
    assert made.__doc__ == "a device of the team's own, described only."
    assert not recorded_class(with_column()).any_columns


def test_a_recorded_sensor_has_its_row_and_no_readings_of_its_own() -> None:
    made = recorded_class(with_column(default=3.0))
    row = made.spec_type(kind=made, number=2, code="t1")
    assert in_json(getattr(row, "heat")) == 3.0  # noqa: B009  # a field that was made
    sensor = modelled_sensor(row)
    assert (sensor.spec, row.id, sensor.reading(4.0, None, 1.0)) == (row, "temp2", 4.0)
    with pytest.raises(TypeError, match="a row of Odd is a OddSpec, not a RecordedSpec"):
        sensor_of(replace(row, kind=Odd))
    with pytest.raises(TypeError, match="SensorKind says what a sensor is, but not how it works"):
        sensor_of(SensorSpec(kind=SensorKind, number=1, code="s1"))


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        (RecordedKind(name="Temp", title="Thermometer"), "a kind of sensor whose name is no name"),
        (RecordedKind(name="", title="Thermometer"), "a kind of sensor whose name is no name"),
        (RecordedKind(name="temp", title="no title"), "a kind of sensor whose name is no name"),
        (RecordedKind(name="temp", title="x" * 101), "a kind of sensor whose name is no name"),
        (RecordedKind(name="temp", title="T", meaning="a\n"), "the meaning, unit or short name of the kind"),
        (RecordedKind(name="temp", title="T", unit="\x1b"), "the meaning, unit or short name of the kind"),
        (RecordedKind(name="temp", title="T", short_name="\n"), "the meaning, unit or short name of"),
        (with_column(header="a\n"), "a column of the kind temp has a name that is no line"),
        (with_column(unit="a\n"), "a column of the kind temp has a name that is no line"),
        (with_column(label="a\n"), "a column of the kind temp has a name that is no line"),
        (with_column(words=("a", "b\n")), "a column of the kind temp has a name that is no line"),
        (with_column(field="kind"), "the column 'Heat (C)' of the kind temp fills what is no field"),
        (with_column(field="number"), "the column 'Heat (C)' of the kind temp fills what is no field"),
        (with_column(field="code"), "the column 'Heat (C)' of the kind temp fills what is no field"),
        (with_column(field="enabled"), "the column 'Heat (C)' of the kind temp fills what is no field"),
        (with_column(field="two words"), "the column 'Heat (C)' of the kind temp fills what is no field"),
        (with_column(field="__init__"), "the column 'Heat (C)' of the kind temp fills what is no field"),
        (with_column(field="__own"), "the column 'Heat (C)' of the kind temp fills what is no field"),
        (with_column(field="id"), "the column 'Heat (C)' of the kind temp fills what is no field"),
    ],
)  # fmt: skip
def test_a_description_that_fits_no_class_is_refused(kind: RecordedKind, reason: str) -> None:
    with pytest.raises(ValueError, match="^" + re.escape(reason)):
        recorded_class(kind)


def test_names_and_labels_have_greatest_lengths() -> None:
    names = ["a" * 20, "a" * 21, "", "a1", "A", "ab", None, 3]
    assert [is_kind_name(name) for name in names] == [True, False, False, False, False, True, False, False]
    labels = ["x" * 100, "x" * 101, "", "a\tb", "grün", None, 3]
    assert [is_label(label) for label in labels] == [True, False, True, False, True, False, False]
    assert recorded_class(with_column(words=("a", "b"))).columns[0].rule == WordRule(
        ("a", "b"), (False, True)
    )
    assert recorded_class(with_column(words=("a", "b", "c"))).columns[0].rule == NumberRule()
    assert recorded_class(with_column(is_number=False)).columns[0].rule == RawTextRule(1000)
    long = recorded_kind(
        type(
            "Long",
            (Odd,),
            {"columns": (CsvColumn(NumberRule(), name="L", field="mode", default="x" * 2000),)},
        )
    )
    assert long.columns[0].default == "x" * 997 + "..."
