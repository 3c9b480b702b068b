"""Validation rules for single values: a setting, an option or a cell. Each can describe what it allows.

`check` takes a value that already has a type (from TOML), `from_text` takes text (from a cell or
an option). Both return the value or raise ValueError with a sentence fit for people. Rules are structs
because every start makes them, and dataclasses take six times as long to define.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Protocol, TypeVar

from msgspec import Struct

from simmer_tui.sim.command import NUMBER, escape

Value = TypeVar("Value", covariant=True)

WHOLE_NUMBER = re.compile(r"[+-]?[0-9]{1,30}")


class Rule(Protocol[Value]):
    """The interface of every rule."""

    @property
    def allowed(self) -> str:
        """What is allowed, to follow "must be"."""
        ...

    @property
    def metavar(self) -> str:
        """What stands for the value in `--help`."""
        ...

    def check(self, value: object) -> Value: ...

    def from_text(self, text: str) -> Value: ...


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`; did you mean "..."?` if one of `known` is close to `word`, else nothing."""
    from difflib import get_close_matches  # slow to import, needed for mistakes only

    by_fold = {name.casefold(): name for name in known}
    close = get_close_matches(word.casefold()[:200], by_fold, n=1)
    return f'; did you mean "{by_fold[close[0]]}"?' if close else ""


def listed(words: Iterable[str]) -> str:
    """`a, b or c`."""
    *most, last = words
    return f"{', '.join(most)} or {last}" if most else last


def describe(value: object) -> str:
    """A value from outside, shortened and escaped for display."""
    if isinstance(value, str):
        return f'"{escape(value, 40)}"'
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list | tuple):
        if len(value) <= 4 and not any(isinstance(item, list | tuple | dict) for item in value):
            return f"[{', '.join(describe(item) for item in value)}]"
        return f"a list of {len(value)} values"
    if isinstance(value, int) and abs(value) >= 10**30:
        return "a far larger whole number"
    return escape(str(value), 40)


def _refusal(rule: Rule[object], value: object, hint: str = "") -> ValueError:
    return ValueError(f"must be {rule.allowed}, not {describe(value)}{hint}")


class Number(Struct, frozen=True):
    """A finite number from `low` to `high`; an open end excludes the bound itself."""

    low: float = -math.inf
    high: float = math.inf
    low_open: bool = False
    high_open: bool = False

    @property
    def allowed(self) -> str:
        return f"a number{self._range()}"

    @property
    def metavar(self) -> str:
        return "N"

    def _range(self) -> str:
        """The bounds in words; a bound above without one below does not occur."""
        low = f"{'above' if self.low_open else 'from'} {self.low:g}"
        if math.isinf(self.low):
            return ""
        if math.isinf(self.high):
            return f" {low}" if self.low_open else f", {self.low:g} or more"
        joint = "and" if self.low_open else "to"
        most = "below " if self.high_open else "at most " if self.low_open else ""
        return f" {low} {joint} {most}{self.high:g}"

    def _accepts(self, number: float) -> bool:
        return (
            math.isfinite(number)
            and self.low <= number <= self.high
            and not (self.low_open and number == self.low)
            and not (self.high_open and number == self.high)
        )

    def check(self, value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise _refusal(self, value)
        try:
            number = float(value)
        except OverflowError:
            raise _refusal(self, value) from None
        if not self._accepts(number):
            raise _refusal(self, value)
        return number

    def from_text(self, text: str) -> float:
        if NUMBER.fullmatch(text.strip()) is None or not self._accepts(float(text)):
            raise _refusal(self, text)
        return float(text)


class NumberOrOff(Struct, frozen=True):
    """A number from `low` to `high`, or off, which is 0."""

    low: float
    high: float

    @property
    def allowed(self) -> str:
        return f"a number from {self.low:g} to {self.high:g}, or off"

    @property
    def metavar(self) -> str:
        return "N|off"

    def check(self, value: object) -> float:
        if value == "off":
            return 0.0
        return self._bounded(value, Number().check(value) if not isinstance(value, str) else math.nan)

    def from_text(self, text: str) -> float:
        if text.strip().lower() == "off":
            return 0.0
        return self._bounded(text, float(text) if NUMBER.fullmatch(text.strip()) else math.nan)

    def _bounded(self, value: object, number: float) -> float:
        if number != 0.0 and not self.low <= number <= self.high:
            raise _refusal(self, value)
        return number


class Integer(Struct, frozen=True):
    """A whole number from `low` to `high`; `meaning` says it in other words."""

    low: int
    high: int
    meaning: str = ""

    @property
    def allowed(self) -> str:
        if self.meaning:
            return self.meaning
        if self.high - self.low == 1:
            return f"{self.low} or {self.high}"
        return f"a whole number from {self.low} to {self.high}"

    @property
    def metavar(self) -> str:
        return "N"

    def check(self, value: object) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not self.low <= value <= self.high:
            raise _refusal(self, value)
        return value

    def from_text(self, text: str) -> int:
        if WHOLE_NUMBER.fullmatch(text.strip()) is None or not self.low <= int(text) <= self.high:
            raise _refusal(self, text)
        return int(text)


class Flag(Struct, frozen=True):
    """true or false."""

    @property
    def allowed(self) -> str:
        return "true or false"

    @property
    def metavar(self) -> str:
        return "{true,false}"

    def check(self, value: object) -> bool:
        if not isinstance(value, bool):
            raise _refusal(self, value)
        return value

    def from_text(self, text: str) -> bool:
        known = {"true": True, "false": False}
        if text.strip().lower() not in known:
            raise _refusal(self, text)
        return known[text.strip().lower()]


class Choice(Struct, frozen=True):
    """One of a few words, in any case."""

    choices: tuple[str, ...]

    @property
    def allowed(self) -> str:
        return listed(f'"{choice}"' for choice in self.choices)

    @property
    def metavar(self) -> str:
        return "{" + ",".join(self.choices) + "}"

    def check(self, value: object) -> str:
        if not isinstance(value, str):
            raise _refusal(self, value)
        word = value.strip().lower()
        if word not in self.choices:
            raise _refusal(self, value, did_you_mean(value, self.choices))
        return word

    def from_text(self, text: str) -> str:
        return self.check(text)


class Several(Struct, frozen=True):
    """One or more of a few words: a list in TOML, `binary,packets` in text."""

    choices: tuple[str, ...]

    @property
    def allowed(self) -> str:
        return f"a list of one or more of {Choice(self.choices).allowed}"

    @property
    def metavar(self) -> str:
        return ",".join(self.choices)

    def check(self, value: object) -> tuple[str, ...]:
        if not isinstance(value, list | tuple) or not value:
            raise _refusal(self, value)
        return tuple(dict.fromkeys(Choice(self.choices).check(word) for word in value))

    def from_text(self, text: str) -> tuple[str, ...]:
        return self.check(text.split(","))


class Names(Struct, frozen=True):
    """Any number of names, perhaps none: a list in TOML, `one,two` in text."""

    @property
    def allowed(self) -> str:
        return "a list of names"

    @property
    def metavar(self) -> str:
        return "NAME,..."

    def check(self, value: object) -> tuple[str, ...]:
        if not isinstance(value, list | tuple):
            raise _refusal(self, value)
        names = (Text(blank=True).check(name) for name in value)
        return tuple(dict.fromkeys(name for name in names if name))

    def from_text(self, text: str) -> tuple[str, ...]:
        return self.check(text.split(","))


class Text(Struct, frozen=True):
    """A line of text without control characters or spaces around it, not blank unless allowed."""

    blank: bool = False

    @property
    def allowed(self) -> str:
        return "a line of text"

    @property
    def metavar(self) -> str:
        return "TEXT"

    def check(self, value: object) -> str:
        if not isinstance(value, str) or not value.isprintable() or len(value) > 255:
            raise _refusal(self, value)
        if not value.strip() and not self.blank:
            raise _refusal(self, value)
        return value.strip()

    def from_text(self, text: str) -> str:
        return self.check(text)


class Pair(Struct, frozen=True):
    """Two numbers: a list of two in TOML, `6,42` in text."""

    each: Number = Number()

    @property
    def allowed(self) -> str:
        return f"two numbers{self.each.allowed.removeprefix('a number')}"

    @property
    def metavar(self) -> str:
        return "X,Y"

    def check(self, value: object) -> tuple[float, float]:
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise ValueError(f"must be {self.allowed}, such as [6, 42], not {describe(value)}")
        try:
            return self.each.check(value[0]), self.each.check(value[1])
        except ValueError:
            raise _refusal(self, value) from None

    def from_text(self, text: str) -> tuple[float, float]:
        parts = text.split(",")
        if len(parts) != 2:
            raise ValueError(f"must be {self.allowed}, such as 6,42, not {describe(text)}")
        try:
            return self.each.from_text(parts[0]), self.each.from_text(parts[1])
        except ValueError:
            raise _refusal(self, text) from None
