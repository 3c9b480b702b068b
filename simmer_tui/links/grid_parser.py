"""Grids of beliefs as they come on the belief port: three formats of the numbers, and all their limits."""

from __future__ import annotations

import base64
import binascii
import math
from collections.abc import Callable
from itertools import chain
from typing import Any

import numpy as np

from simmer_tui.belief_grid import MOST_HEADINGS, MOST_ROWS, MOST_STATES, Bounds, Probabilities
from simmer_tui.sim.command import escape_word

_FIELDS = ("p", "f32", "u8", "rows", "cols", "headings", "first", "bounds")
_PACKED = {"f32": "<f4", "u8": "u1"}
"""Types of packed numbers, little-endian."""
JSON_NUMBERS = frozenset({int, float})
"""The types of number in JSON; `True` is none of them."""


def parse_grid(
    value: Any, number: Callable[[Any, str], float], whole: Bounds
) -> tuple[Probabilities, Bounds, float]:
    """Probabilities (rows, columns, headings), bounds and first heading of a grid.

    Args:
        number: checks and rounds a number that has a name.
        whole: the bounds of a grid that names none.

    Raises:
        ValueError: says what is allowed.
    """
    if not isinstance(value, dict):
        raise ValueError('grid must be an object, such as {"p": [[0.1, 0.9], [0, 0]]}')
    unknown = sorted(set(value) - set(_FIELDS))
    if unknown:
        raise ValueError(f"'{escape_word(unknown[0])}' is no field of a grid; there are {', '.join(_FIELDS)}")
    written = [name for name in _FIELDS[:3] if value.get(name) is not None]
    if len(written) != 1:
        raise ValueError("a grid needs exactly one of p, f32 and u8")
    [name] = written
    grid = _listed(value) if name == "p" else _packed(value, name)
    largest = grid.max()
    if not math.isfinite(largest) or not math.isfinite(lowest := grid.min()):
        raise ValueError("probabilities must be finite")
    if lowest < 0.0:
        raise ValueError("probabilities must be 0 or more")
    if largest == 0.0:
        raise ValueError("one probability must be more than 0")
    first = 0.0 if value.get("first") is None else number(value["first"], "first")
    return grid, _bounds(value.get("bounds"), number, whole), first


def _bounds(value: Any, number: Callable[[Any, str], float], whole: Bounds) -> Bounds:
    if value is None:
        return whole
    if not isinstance(value, list) or len(value) != 4:
        raise ValueError("bounds must be [x0, y0, x1, y1], inches")
    x0, y0, x1, y1 = (number(each, "each of bounds") for each in value)
    if not (x0 < x1 and y0 < y1):
        raise ValueError("bounds must be [x0, y0, x1, y1] with x0 < x1 and y0 < y1")
    return x0, y0, x1, y1


def _size(value: dict[str, Any], name: str, most: int, default: int | None = None) -> int:
    size = value.get(name)
    if size is None and default is not None:
        return default
    # MATLAB's numbers are floats.
    if isinstance(size, float) and size.is_integer():
        size = int(size)
    if isinstance(size, bool) or not isinstance(size, int) or not 1 <= size <= most:
        raise ValueError(f"{name} must be a whole number from 1 to {most:,}")
    return size


def _checked_shape(rows: int, columns: int, headings: int) -> tuple[int, int, int]:
    for name, size, most in (
        ("rows", rows, MOST_ROWS), ("cols", columns, MOST_ROWS), ("headings", headings, MOST_HEADINGS),
    ):  # fmt: skip
        if not 1 <= size <= most:
            raise ValueError(f"{name} must be from 1 to {most:,}, not {size:,}")
    if rows * columns * headings > MOST_STATES:
        raise ValueError(
            f"a grid has at most {MOST_STATES:,} states, not {rows} x {columns} x {headings} = "
            f"{rows * columns * headings:,}"
        )
    return rows, columns, headings


def _packed(value: dict[str, Any], name: str) -> Probabilities:
    """A grid of bytes in base64."""
    shape = _checked_shape(
        _size(value, "rows", MOST_ROWS),
        _size(value, "cols", MOST_ROWS),
        _size(value, "headings", MOST_HEADINGS, 1),
    )
    text = value[name]
    try:
        data = base64.b64decode(text if isinstance(text, str) else b"?", validate=True)
    except (ValueError, binascii.Error):
        raise ValueError(f"{name} must be bytes in base64") from None
    kind = np.dtype(_PACKED[name])
    if len(data) != math.prod(shape) * kind.itemsize:
        rows, columns, headings = shape
        raise ValueError(
            f"{name} has {len(data):,} bytes, not {math.prod(shape) * kind.itemsize:,} for "
            f"{rows} x {columns} x {headings} states"
        )
    return np.frombuffer(data, dtype=kind).astype(np.float64).reshape(shape)


def _listed(value: dict[str, Any]) -> Probabilities:
    """A grid of nested lists: rows of numbers, or of lists of numbers."""
    table = value["p"]
    if not isinstance(table, list) or not table:
        raise ValueError("p must be a list of rows, each a list of numbers")
    rows, columns = len(table), _alike(table, "row {}", "numbers")
    cells: list[Any] = list(chain.from_iterable(table)) if columns else []
    headings = 1
    if cells and isinstance(cells[0], list):
        headings = _alike(cells, "cell {} (counted from the top left)", "headings")
        _checked_shape(rows, columns, headings)
        cells = list(chain.from_iterable(cells))
    shape = _checked_shape(rows, columns, headings)
    for name, size in zip(("rows", "cols", "headings"), shape, strict=True):
        if value.get(name) is not None and _size(value, name, MOST_STATES) != size:
            raise ValueError(f"{name} says another number than p has, which is {size}")
    if not JSON_NUMBERS.issuperset(map(type, cells)):
        raise ValueError("p must hold numbers alone")
    try:
        return np.array(cells, dtype=np.float64).reshape(shape)
    except OverflowError:  # an integer too large for a float
        raise ValueError("probabilities must be finite") from None


def _alike(lists: list[Any], name: str, of: str) -> int:
    """The length that all of some lists have."""
    if not {list}.issuperset(map(type, lists)):
        raise ValueError("p must be a list of rows, each a list of numbers")
    length = len(lists[0])
    for number, each in enumerate(lists, 1):
        if len(each) != length:
            raise ValueError(f"{name.format(number)} has {len(each)} {of}, not {length}")
    return length
