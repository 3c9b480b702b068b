"""Beliefs as they come on the belief port: JSON in, checked and rounded values out, with all their limits.

A grid has its numbers in one of three formats.
"""

from __future__ import annotations

import base64
import binascii
import contextlib
import json
import math
from collections.abc import Sequence
from itertools import chain, islice
from typing import Any

import numpy as np
from msgspec.structs import asdict

from simmer_tui.run.belief_grid import (
    MOST_ROWS,
    MOST_STATES,
    Bounds,
    GridBelief,
    Probabilities,
    grid_belief,
)
from simmer_tui.run.events import LARGEST_NUMBER, Belief
from simmer_tui.sim.angles import MOST_HEADINGS
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.pose import Pose

# Judged: more than a large terminal has cells, so that more could not be distinguished.
MOST_PARTICLES = 5000
"""Particles kept of one belief, evenly picked; a screen shows no more."""
# Judged: a line of the event list, twice.
LONGEST_NOTE = 200
"""Characters kept of the note of a belief."""
# Finer than any filter's estimate. Screen, log and replay get the same rounded numbers. A log of particles
# with all digits would be three times as large.
DECIMALS = 2
"""Decimals of a belief, inches and degrees."""
_FIELDS = ("x", "y", "heading", "spread", "particles", "grid", "note")
_GRID_FIELDS = ("p", "f32", "u8", "rows", "cols", "headings", "first", "bounds")
_PACKED = {"f32": "<f4", "u8": "u1"}
"""Types of packed numbers, little-endian."""
_JSON_NUMBERS = frozenset({int, float})
"""The types of number in JSON; `True` is none of them."""


def parse_belief(line: bytes, time: float, true: Pose, whole: Bounds) -> Belief:
    """A belief from one line of JSON; `whole` are the maze's bounds. The ValueError says what is allowed."""
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        raise ValueError("a belief is one JSON object a line") from None
    if not isinstance(fields, dict):
        raise ValueError('a belief is an object, such as {"x": 6, "y": 42, "heading": 0}')
    _check_names(fields, _FIELDS, "belief")
    grid = None if fields.get("grid") is None else _grid(fields["grid"], whole, true)
    # Missing fields follow from the grid.
    derived = {} if grid is None else asdict(grid.best_pose)
    known = derived | {name: value for name in _FIELDS[:3] if (value := fields.get(name)) is not None}
    pose = Pose(*(_number(known.get(name), name) for name in _FIELDS[:3]))
    spread = None if fields.get("spread") is None else abs(_number(fields["spread"], "spread"))
    if grid is not None and spread is None:
        spread = round(grid.spread, DECIMALS)
    note = fields.get("note") or ""
    if not isinstance(note, str):
        raise ValueError("note must be text")
    return Belief(time, pose, true, spread, _particles(fields.get("particles")), note[:LONGEST_NOTE], grid)


def _check_names(fields: dict[str, Any], known: Sequence[str], what: str) -> None:
    # An error, not ignored: a misspelt field would never be drawn, without a word.
    if unknown := sorted(set(fields) - set(known)):
        raise ValueError(f"'{cut(unknown[0], WORD)}' is no field of a {what}; there are {', '.join(known)}")


def _number(value: Any, name: str) -> float:
    # JSON's true is an int in Python, but is no coordinate.
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name} must be a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite")
    if abs(number) > LARGEST_NUMBER:
        raise ValueError(f"{name} must be between -{LARGEST_NUMBER:g} and {LARGEST_NUMBER:g}")
    return round(number, DECIMALS) + 0.0  # the sum makes 0.0 of -0.0


def _particles(value: Any) -> tuple[tuple[float, ...], ...]:
    if value is None:
        return ()
    if not isinstance(value, list):
        raise ValueError("particles must be a list of [x, y] or [x, y, heading]")
    # Thinned out before the check: a million particles cost no more than 5,000.
    rows = value[:: max(1, math.ceil(len(value) / MOST_PARTICLES))]
    # Thousands come at once: no call of a Python function for each.
    lengths = set(map(len, rows)) if {list}.issuperset(map(type, rows)) else {0}
    if not {2, 3}.issuperset(lengths):
        raise ValueError("each particle must be [x, y] or [x, y, heading]")
    numbers = iter(_rounded(list(chain.from_iterable(rows))))
    if len(lengths) == 1:  # nearly always true
        return tuple(zip(*[numbers] * lengths.pop(), strict=True))
    return tuple([tuple(islice(numbers, len(row))) for row in rows])


def _rounded(values: list[Any]) -> list[float]:
    """The rounded numbers of particles, usually without a call for each."""
    if _JSON_NUMBERS.issuperset(map(type, values)):
        with contextlib.suppress(OverflowError):  # an integer too large for a float
            numbers = np.array(values, dtype=np.float64)
            if (np.abs(numbers) <= LARGEST_NUMBER).all():
                rounded: list[float] = (np.round(numbers, DECIMALS) + 0.0).tolist()
                return rounded
    return [_number(value, "a particle's number") for value in values]


# -- grids -------------------------------------------------------------------------------------------


def _grid(value: Any, whole: Bounds, true: Pose) -> GridBelief:
    """A grid. One that names no bounds has those of the `whole` maze."""
    if not isinstance(value, dict):
        raise ValueError('grid must be an object, such as {"p": [[0.1, 0.9], [0, 0]]}')
    _check_names(value, _GRID_FIELDS, "grid")
    written = [name for name in _GRID_FIELDS[:3] if value.get(name) is not None]
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
    first = 0.0 if value.get("first") is None else _number(value["first"], "first")
    return grid_belief(grid, _bounds(value.get("bounds"), whole), first, true)


def _bounds(value: Any, whole: Bounds) -> Bounds:
    if value is None:
        return whole
    if not isinstance(value, list) or len(value) != 4:
        raise ValueError("bounds must be [x0, y0, x1, y1], inches")
    x0, y0, x1, y1 = (_number(each, "each of bounds") for each in value)
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
    if not _JSON_NUMBERS.issuperset(map(type, cells)):
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
