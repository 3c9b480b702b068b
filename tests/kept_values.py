"""Values kept in a JSON file beside a test, compared number by number."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from enum import Enum
from pathlib import Path
from typing import Any

import msgspec
import numpy as np


def plain(value: Any) -> Any:
    """A value as JSON holds it, numbers to a millionth: that is finer than any
    fault that is looked for, and far coarser than the rounding of processors."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, float):
        return round(value, 6) + 0.0 if math.isfinite(value) else str(value)
    if isinstance(value, msgspec.Struct):
        return [plain(getattr(value, name)) for name in value.__struct_fields__]
    if isinstance(value, Mapping):
        return {str(plain(key)): plain(each) for key, each in value.items()}
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, bytes):
        return value.decode("latin-1")
    if isinstance(value, type):
        return value.__name__
    if isinstance(value, Iterable):
        return [plain(each) for each in value]
    return repr(value)


def assert_same(now: Any, then: Any, where: str = "") -> None:
    """Fails where a plain value differs from the one that was kept by more than rounding."""
    if isinstance(then, dict):
        assert list(now) == list(then), where
        for name, each in then.items():
            assert_same(now[name], each, f"{where}.{name}")
    elif isinstance(then, list):
        assert len(now) == len(then), where
        for number, (one, other) in enumerate(zip(now, then, strict=True)):
            assert_same(one, other, f"{where}[{number}]")
    elif isinstance(then, float | int) and not isinstance(then, bool):
        assert type(now) in (float, int), where
        assert abs(now - then) <= 2e-6 + 1e-9 * abs(then), f"{where}: {now} is not {then}"
    else:
        assert (type(now), now) == (type(then), then), where


def keep(path: Path, everything: Mapping[str, Any]) -> None:
    """Write what is kept from now on."""
    lines = [
        f"{json.dumps(name)}: {json.dumps(value, separators=(',', ':'))}"
        for name, value in everything.items()
    ]
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")
