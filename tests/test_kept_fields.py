"""Kept answers with Structs: a new field changes none where it has its default, all other changes do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from msgspec import Struct, defstruct

from tests import kept_numbers
from tests.brief_events import brief
from tests.kept_numbers import assert_kept, assert_same, in_json


class Place(Struct):
    x: float
    y: float


class Event(Struct):
    time: float
    at: Place
    share: float = 1.0
    text: str = ""


# The same classes with fields that were added.
LATER_PLACE = defstruct("Place", [("x", float), ("y", float), ("z", float, 0.5)])
LATER_EVENT = defstruct(
    "Event",
    [
        ("time", float),
        ("battery", float | None, None),
        ("at", LATER_PLACE),
        ("share", float, 1.0),
        ("text", str, ""),
        ("limited", float, 2.0),
    ],
    kw_only=True,
)


def later(**fields: Any) -> Struct:
    return LATER_EVENT(**{"time": 3.0, "at": LATER_PLACE(1.0, 2.0), **fields})


def as_read(value: Any) -> Any:
    return json.loads(json.dumps(in_json(value)))


@pytest.mark.parametrize("told", [in_json, brief])
def test_a_field_that_is_new_changes_an_answer_only_where_it_is_not_its_default(told: Any) -> None:
    kept = as_read(told(Event(3.0, Place(1.0, 2.0))))
    assert_same(told(later()), kept)
    for changed in (
        later(battery=7.4),
        later(limited=1.0),
        later(limited=0.0),
        later(at=LATER_PLACE(1.0, 2.0, 0.0)),
        later(at=LATER_PLACE(1.0, 2.5)),
        later(time=3.5),
        later(share=0.5),
        later(share=0.0),
        later(text="a"),
    ):
        with pytest.raises(AssertionError):
            assert_same(told(changed), kept)


def test_a_field_without_a_default_or_one_less_is_a_change() -> None:
    whole = as_read(Event(3.0, Place(1.0, 2.0)))
    for lacking in ("time", "share", "text"):
        kept = {name: each for name, each in whole.items() if name != lacking}
        if lacking == "time":
            with pytest.raises(AssertionError):
                assert_same(Event(3.0, Place(1.0, 2.0)), kept)
        else:
            assert_same(Event(3.0, Place(1.0, 2.0)), kept)
        with pytest.raises(AssertionError):
            assert_same(Event(3.0, Place(1.0, 2.0)), {**whole, f"{lacking}_of_old": 0.0})


def test_only_answers_that_differ_are_kept_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "kept.json"
    monkeypatch.setenv("KEEP", "1")
    assert_kept(Event(3.0, Place(1.0, 2.0)), file, "event")
    first = file.read_text()
    kept_numbers._kept.cache_clear()
    assert_kept(later(), file, "event")
    assert file.read_text() == first
    assert_kept(later(time=4.0), file, "event")
    assert json.loads(file.read_text())["event"]["limited"] == 2.0
