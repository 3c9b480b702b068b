"""Answers that are kept beside their tests: whoever changes a number in one does so on purpose.

KEEP=1 pytest ...     # keeps the answers of today that differ, those of slow tests too

A new field of a Struct changes no answer where it has its default: see `Fields`.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import NODEFAULT, Struct, structs


class Fields(dict[str, Any]):
    """Fields of a Struct in JSON, by name; `usual` has the defaults of those that have one.

    A field that a kept answer lacks must have its default. A Struct without defaults is a list of its values.
    """

    def __init__(self, values: Mapping[str, Any], usual: Mapping[str, Any]) -> None:
        super().__init__(values)
        self.usual = usual


def usual_of(kind: type[Struct] | Struct) -> dict[str, Any]:
    """The defaults of a Struct's fields, by name."""
    usual = {}
    for each in structs.fields(kind):
        if each.default is not NODEFAULT:
            usual[each.name] = each.default
        elif each.default_factory is not NODEFAULT:
            usual[each.name] = each.default_factory()
    return usual


def assert_kept(found: Any, file: Path, name: str) -> None:
    """Assert that an answer is the one kept under a name in a file; with KEEP=1, keep one that differs."""
    kept = _kept(file)
    if os.environ.get("KEEP") and not (name in kept and _is_same(found, kept[name])):
        kept[name] = in_json(found)
        lines = ",\n".join(f"{json.dumps(key)}: {json.dumps(kept[key])}" for key in sorted(kept))
        file.write_text(f"{{\n{lines}\n}}\n", "utf-8")
    assert_same(found, kept[name], name)


@cache
def _kept(file: Path) -> dict[str, Any]:
    """The answers in a file. They are read once, since some files have many."""
    return dict(json.loads(file.read_text("utf-8"))) if file.exists() else {}


def in_json(value: Any) -> Any:
    """The value as JSON has it; numbers with 7 digits."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, complex):
        value = [value.real, value.imag]
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, float):
        return float(f"{value:.7g}") if math.isfinite(value) else str(value)
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, Struct):
        values = {name: in_json(getattr(value, name)) for name in value.__struct_fields__}
        usual = {name: in_json(each) for name, each in usual_of(value).items()}
        return Fields(values, usual) if usual else list(values.values())
    if isinstance(value, Fields):
        values = {name: in_json(each) for name, each in value.items()}
        return Fields(values, {name: in_json(each) for name, each in value.usual.items()})
    if isinstance(value, Mapping):
        return {str(in_json(key)): in_json(each) for key, each in value.items()}
    if isinstance(value, bytes):
        return value.decode("latin-1")
    if isinstance(value, type):
        return value.__name__
    return [in_json(each) for each in value] if isinstance(value, Iterable) else repr(value)


def _is_same(found: Any, kept: Any) -> bool:
    try:
        assert_same(found, kept)
    except AssertionError:
        return False
    return True


def assert_same(found: Any, kept: Any, place: str = "") -> None:
    """Numbers to a hundred-thousandth: linear algebra differs in the last bits between machines."""
    _compare(in_json(found), kept, place)


def _compare(found: Any, kept: Any, place: str) -> None:
    if isinstance(found, Fields):
        # Those of a Struct that had none with a default when it was kept are in a list.
        is_list = isinstance(kept, list)
        known = found.keys() - found.usual.keys() if is_list else found.keys() & kept.keys()
        for name in found.keys() - known:
            assert name in found.usual, f"{place}.{name}"
            assert found[name] == found.usual[name], f"{place}.{name}: new, and not its default"
        found = {name: each for name, each in found.items() if name in known}
        found = list(found.values()) if is_list else found
    if isinstance(kept, dict):
        assert list(found) == list(kept), place
        for name in kept:
            _compare(found[name], kept[name], f"{place}.{name}")
    elif isinstance(kept, list):
        assert isinstance(found, list), place
        assert len(found) == len(kept), place
        for number, (one, other) in enumerate(zip(found, kept, strict=True)):
            _compare(one, other, f"{place}[{number}]")
    elif isinstance(kept, float):
        assert found == pytest.approx(kept, rel=1e-5, abs=1e-7, nan_ok=True), place
    else:
        assert found == kept, place
