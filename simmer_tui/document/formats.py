"""Formats of values: the text that people read, and the plain values that programs read.

A value stays a number until a renderer shows it. A format may split a value into several plain ones, each
with a suffix to the column's key that names its unit. A pose `end` is `end_x_in`, `end_y_in` and
`end_heading_deg`. None is a blank everywhere, and an empty text is null.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from msgspec import Struct

from simmer_tui.sim.command import WORD, cut, first_of

Plain = str | bool | int | float | Sequence[Any] | None
"""A value that JSON has: text, a number, a list of these, or nothing."""


class TextLink(Struct, frozen=True):
    """Words that lead to an address, within the page or beside it. `about` is shown on pointing at them."""

    words: str
    address: str
    about: str = ""


BLOCKS = " ▁▂▃▄▅▆▇█"
"""Characters of a histogram, from none to the most."""
PLAIN_BLOCKS = " .:-=+*#@"
"""The same for terminals that have nothing but ASCII."""
# Most numbers of a list that are shown; a line of a terminal has room for about as many.
_LISTED = 8


def _whole(value: Any) -> tuple[Plain, ...]:
    # An empty text says the same as None: what it is about does not apply.
    return (None if value == "" else value,)


class Format(Struct, frozen=True):
    """Format of one kind of value.

    `show` gives its text, `split` its plain values, one for each of `suffixes`. Numeric columns are aligned
    to the right; `fixed` ones need letters of one width.
    """

    show: Callable[[Any], str]
    suffixes: tuple[str, ...] = ("",)
    split: Callable[[Any], Sequence[Plain]] = _whole
    numeric: bool = False
    fixed: bool = False

    def text(self, value: object) -> str:
        """Text of a value for people; nothing for None."""
        return "" if value is None else self.show(value)

    def plain(self, value: object) -> Sequence[Plain]:
        """Plain values, one for each suffix."""
        if value is None:
            return (None,) * len(self.suffixes)
        return self.split(value.words if isinstance(value, TextLink) else value)


def number(form: str = "", unit: str = "") -> Format:
    """Format of a number, by a format specification, with a unit behind it if the heading has none."""
    return Format(lambda value: f"{_digits(value, form)}{unit}", numeric=True)


def _digits(value: float, form: str) -> str:
    """A number by a format specification; a large one in digits: few readers are used to exponents. What
    rounds to 0 has no minus."""
    sign = "+" if form.startswith("+") else ""
    if isinstance(value, float):
        sign += "z"
    text = f"{value:{sign}{form.removeprefix('+')}}"
    return f"{value:{sign}.0f}" if "e+" in text else text


def estimate(form: str = ".3f") -> Format:
    """Format of an estimate with an interval: `0.940 (0.838 to 0.979)`; it has `value`, `low`, `high`."""

    def show(each: Any) -> str:
        if math.isnan(each.low):  # too few values for an interval
            return _digits(each.value, form)
        return f"{_digits(each.value, form)} ({_digits(each.low, form)} to {_digits(each.high, form)})"

    return Format(show, ("", "_low", "_high"), lambda each: (each.value, each.low, each.high), numeric=True)


def numbers(limit: int = _LISTED) -> Format:
    """Format of a list of whole numbers: `3, 4 and 7 more`."""

    def show(values: Sequence[int]) -> str:
        return first_of([str(each) for each in values], limit)

    return Format(show)


def _duration(seconds: float) -> str:
    # Judged: up to two minutes seconds are easier to compare.
    if seconds < 120:
        return f"{seconds:.2f} s"
    minutes, rest = divmod(seconds, 60)
    return f"{seconds:.0f} s ({int(minutes)} min {rest:.0f} s)"


def _histogram(counts: Sequence[int]) -> str:
    most = max(counts)
    return "".join(BLOCKS[math.ceil(count / most * (len(BLOCKS) - 1))] for count in counts)


LENGTH = number(".1f")
"""Inches, or simulated seconds, to a tenth."""
WORDS = Format(str, (), lambda value: ())
"""Text for people only; other columns have it for programs."""
TEXT = Format(str)
# Several lines: the end of a path is still seen.
_PASSAGE = 400
QUOTED = Format(lambda text: cut(text, WORD))
"""Text from outside for a column that does not wrap: a longer one would leave no room for the others."""
PASSAGE = Format(lambda text: cut(text, _PASSAGE))
"""Text from outside for a column that wraps, and for records."""
TYPED = Format(lambda text: cut(text, _PASSAGE))
"""A path, a name of a person or a command: letters of all scripts stay."""
COUNT = number("d")
COUNT_OR_BLANK = Format(lambda value: str(value or ""), numeric=True)
"""A count whose 0 need not be read."""
SHARE = number(".0%")
DURATION = Format(_duration)
ESTIMATE = estimate()
NUMBERS = numbers()
PLACE = Format(lambda at: f"{at[0]:.2f}, {at[1]:.2f}", ("_x_in", "_y_in"), tuple, numeric=True)
HISTOGRAM = Format(_histogram, fixed=True)
"""Counts of bins, as bars."""


POSE = Format(
    lambda pose: f"({pose.x:.2f}, {pose.y:.2f}) heading {pose.heading:.1f} deg",
    ("_x_in", "_y_in", "_heading_deg"),
    lambda pose: (pose.x, pose.y, pose.heading),
)
