"""Numbers in a run log. JSON has no infinities and no NaN: they are the strings inf, -inf and nan."""

from __future__ import annotations

import re
from collections.abc import Iterable

_SPECIAL = re.compile("-?inf|nan")
_SPECIAL_NAMES = ("inf", "-inf", "nan")


def number_text(value: float) -> str:
    """A number as JSON that reads back as the same float, bit for bit."""
    text = repr(float(value))  # float() because NumPy's scalars print otherwise
    return f'"{text}"' if text[-1] in "fn" else text


def list_text(values: Iterable[float]) -> str:
    """A JSON list of such numbers."""
    return nested_text([float(value) for value in values])


def nested_text(values: list[float] | list[list[float]]) -> str:
    """A JSON list of plain floats, or of lists of them."""
    text = repr(values).replace(" ", "")
    return _SPECIAL.sub('"\\g<0>"', text) if "n" in text else text


def number(value: object) -> float:
    """The float that `number_text` wrote. Raises ValueError for anything else."""
    if isinstance(value, float):
        return value
    if (isinstance(value, int) and not isinstance(value, bool)) or value in _SPECIAL_NAMES:
        return float(value)
    raise ValueError(f"{str(value)[:40]!r} is not a number")


def numbers(values: object, count: int | None = None) -> list[float]:
    """A list of such numbers, of a given length if one is given. Raises ValueError."""
    if not isinstance(values, list) or (count is not None and len(values) != count):
        raise ValueError(f"{str(values)[:40]!r} is not a list of {count or 'many'} numbers")
    return [number(value) for value in values]
