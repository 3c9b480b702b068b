"""Answers that are kept beside their tests: whoever changes a number in one does so on purpose.

KEEP=1 pytest ...     # keeps the answers of today, after such a change
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

import msgspec
import numpy as np
import pytest


def assert_kept(found: Any, file: Path, name: str) -> None:
    """Assert that an answer is the one kept under a name in a file; with KEEP=1, keep it."""
    kept = _kept(file)
    if os.environ.get("KEEP"):
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
    if isinstance(value, msgspec.Struct):
        return [in_json(getattr(value, name)) for name in value.__struct_fields__]
    if isinstance(value, Mapping):
        return {str(in_json(key)): in_json(each) for key, each in value.items()}
    if isinstance(value, bytes):
        return value.decode("latin-1")
    if isinstance(value, type):
        return value.__name__
    return [in_json(each) for each in value] if isinstance(value, Iterable) else repr(value)


def assert_same(found: Any, kept: Any, place: str = "") -> None:
    """Numbers to a hundred-thousandth: linear algebra differs in the last bits between machines."""
    found = in_json(found)
    if isinstance(kept, dict):
        assert list(found) == list(kept), place
        for name in kept:
            assert_same(found[name], kept[name], f"{place}.{name}")
    elif isinstance(kept, list):
        assert len(found) == len(kept), place
        for number, (one, other) in enumerate(zip(found, kept, strict=True)):
            assert_same(one, other, f"{place}[{number}]")
    elif isinstance(kept, float):
        assert found == pytest.approx(kept, rel=1e-5, abs=1e-7, nan_ok=True), place
    else:
        assert found == kept, place
