"""Rules for single values: a setting, an option, a TOML key or a cell of a CSV file.

`check` takes a value that has a type (from TOML), `from_text` takes text (from a cell or an option). Both
return the value or raise ValueError with a sentence for people. Every rule says what it allows in words
and as a JSON schema. Rules are structs because every start makes them, and dataclasses take six times as
long to define.
"""

import math
import re
from collections.abc import Iterable
from typing import Any, ClassVar, Generic, TypeGuard, TypeVar

from msgspec import Struct

from simmer_tui.sim.command import NUMBER, WORD, counted, cut

_T = TypeVar("_T")

# At most 39 digits, those of the longest seed: Python refuses to convert texts of more than 4,300.
WHOLE_NUMBER = re.compile(r"[+-]?[0-9]{1,39}")
LARGEST_PORT = 65535
"""The largest number of a TCP port."""
MAX_TEXT = 255
"""Most characters of a text: the longest file name that file systems take."""
# In place of a value that a rule refuses; None is a value.
_REFUSED: Any = object()


def is_whole(value: object) -> TypeGuard[int]:
    """True for a whole number: True is an int to Python, but nobody means 1 by it."""
    return isinstance(value, int) and not isinstance(value, bool)


def is_number(value: object) -> TypeGuard[float]:
    """True for a number of any kind."""
    return isinstance(value, float) or is_whole(value)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`; did you mean "..."?` if one of `known` is close to `word`, else nothing."""
    # Slow to import, needed for mistakes only.
    from difflib import get_close_matches

    by_fold = {name.casefold(): name for name in known}
    # A cut, because the comparison takes time with the square of the length.
    close = get_close_matches(word.casefold()[:200], by_fold, n=1)
    return f'; did you mean "{by_fold[close[0]]}"?' if close else ""


def listed(words: Iterable[str]) -> str:
    """`a, b or c`."""
    *most, last = words
    return f"{', '.join(most)} or {last}" if most else last


def describe(value: object) -> str:
    """A value from outside, shortened and escaped for display."""
    if isinstance(value, str):
        return f'"{cut(value, WORD)}"'
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list | tuple):
        # Longer and nested lists would fill the line of the message.
        if len(value) <= 4 and not any(isinstance(item, list | tuple | dict) for item in value):
            return f"[{', '.join(describe(item) for item in value)}]"
        return f"a list of {counted(len(value), 'value')}"
    if isinstance(value, int) and abs(value) >= 10**30:
        # str() refuses more than 4,300 digits.
        return "a far larger whole number"
    return cut(str(value), WORD)


class Rule(Struct, Generic[_T], frozen=True):
    """The interface of every rule; T is the type of the values it gives."""

    @property
    def allowed(self) -> str:
        """The values that are allowed, to follow "must be"."""
        raise NotImplementedError

    @property
    def metavar(self) -> str:
        """The placeholder of the value in `--help`."""
        raise NotImplementedError

    @property
    def schema(self) -> dict[str, Any]:
        """The allowed values of a TOML key, as a JSON schema (draft 7)."""
        raise NotImplementedError

    def check(self, value: object) -> _T:
        """The value itself. Raises ValueError if it is not allowed."""
        return self._taken(value, value)

    def from_text(self, text: str) -> _T:
        """The value of a cell or an option. Raises ValueError if it is not allowed."""
        return self._taken(self._parsed(text), text)

    def refusal(self, value: object) -> str:
        """The message about a value that is not allowed."""
        return f"must be {self.allowed}, not {describe(value)}"

    def plain(self, value: Any) -> Any:
        """An allowed value as TOML and JSON have it."""
        return list(value) if isinstance(value, tuple) else value

    def shown(self, value: Any) -> str:
        """An allowed value in a few characters, for people."""
        plain = self.plain(value)
        return f"{plain:g}" if isinstance(plain, int | float) else str(plain)

    def _taken(self, value: object, given: object) -> _T:
        taken = self._accepted(value)
        if taken is _REFUSED:
            raise ValueError(self.refusal(given))
        accepted: _T = taken
        return accepted

    def _parsed(self, text: str) -> object:
        """The typed value of a text; the text itself if it has none."""
        return text

    def _accepted(self, value: object) -> Any:
        """The value as it is used; `_REFUSED` if it is not allowed."""
        raise NotImplementedError


def _number(text: str) -> object:
    return float(text) if NUMBER.fullmatch(text.strip()) else text


class NumberRule(Rule[float], frozen=True):
    """A finite number from `low` to `high`; an open interval excludes the bound itself."""

    low: float = -math.inf
    high: float = math.inf
    low_open: bool = False
    high_open: bool = False

    @property
    def allowed(self) -> str:
        return f"a number{self.bounds}"

    metavar: ClassVar[str] = "N"

    @property
    def schema(self) -> dict[str, Any]:
        low, high = "exclusiveMinimum" if self.low_open else "minimum", "maximum"
        limits = {low: self.low, "exclusiveMaximum" if self.high_open else high: self.high}
        return {"type": "number"} | {name: limit for name, limit in limits.items() if math.isfinite(limit)}

    @property
    def bounds(self) -> str:
        """The bounds in words; an upper bound without a lower one does not occur."""
        low = f"{'above' if self.low_open else 'from'} {self.low:g}"
        if math.isinf(self.low):
            return ""
        if math.isinf(self.high):
            return f" {low}" if self.low_open else f", {self.low:g} or more"
        joint = "and" if self.low_open else "to"
        most = "below " if self.high_open else "at most " if self.low_open else ""
        return f" {low} {joint} {most}{self.high:g}"

    def _parsed(self, text: str) -> object:
        return _number(text)

    def _accepted(self, value: object) -> Any:
        if not is_number(value):
            return _REFUSED
        try:
            number = float(value)
        # A whole number of more than 308 digits is no float.
        except OverflowError:
            return _REFUSED
        below = number <= self.low if self.low_open else number < self.low
        above = number >= self.high if self.high_open else number > self.high
        return _REFUSED if below or above or not math.isfinite(number) else number


class NumberOrOffRule(NumberRule, frozen=True):
    """A number from `low` to `high`, or off, which is 0."""

    @property
    def allowed(self) -> str:
        return f"{super().allowed}, or off"

    metavar: ClassVar[str] = "N|off"

    @property
    def schema(self) -> dict[str, Any]:
        return {"anyOf": [super().schema, {"enum": ["off", 0]}]}

    def _parsed(self, text: str) -> object:
        return "off" if text.strip().lower() == "off" else super()._parsed(text)

    def _accepted(self, value: object) -> Any:
        # 0 is allowed as well, because it is the setting's value when it is off.
        is_off = value == "off" or (value == 0 and not isinstance(value, bool))
        return 0.0 if is_off else super()._accepted(value)


class PortOrOffRule(Rule[str], frozen=True):
    """A TCP port, 0 for any free one, or off; the value is a text."""

    allowed: ClassVar[str] = f"a port from 0 to {LARGEST_PORT}, or off"
    metavar: ClassVar[str] = "PORT|off"

    @property
    def schema(self) -> dict[str, Any]:
        return {"anyOf": [IntegerRule(0, LARGEST_PORT).schema, {"enum": ["off"]}]}

    def _parsed(self, text: str) -> object:
        text = text.strip().lower()
        return int(text) if WHOLE_NUMBER.fullmatch(text) else text

    def _accepted(self, value: object) -> Any:
        if isinstance(value, str):
            value = self._parsed(value)
        if value == "off":
            return "off"
        accepted = IntegerRule(0, LARGEST_PORT)._accepted(value)
        return accepted if accepted is _REFUSED else str(accepted)


class NumberOrAutoRule(Rule[str], frozen=True):
    """A number from `low` to `high`, or auto; the value is a text."""

    low: float
    high: float
    metavar: ClassVar[str] = "N|auto"

    @property
    def allowed(self) -> str:
        return f"{self._number.allowed}, or auto"

    @property
    def schema(self) -> dict[str, Any]:
        return {"anyOf": [self._number.schema, {"enum": ["auto"]}]}

    @property
    def _number(self) -> NumberRule:
        return NumberRule(self.low, self.high)

    def _parsed(self, text: str) -> object:
        return "auto" if text.strip().lower() == "auto" else self._number._parsed(text)

    def _accepted(self, value: object) -> Any:
        if isinstance(value, str):
            value = self._parsed(value)
        if value == "auto":
            return "auto"
        accepted = self._number._accepted(value)
        return accepted if accepted is _REFUSED else f"{accepted:g}"


class IntegerRule(Rule[int], frozen=True):
    """A whole number from `low` to `high`; `meaning` describes it in words."""

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

    metavar: ClassVar[str] = "N"

    @property
    def schema(self) -> dict[str, Any]:
        return {"type": "integer", "minimum": self.low, "maximum": self.high}

    def _parsed(self, text: str) -> object:
        return int(text) if WHOLE_NUMBER.fullmatch(text.strip()) else text

    def _accepted(self, value: object) -> Any:
        return value if is_whole(value) and self.low <= value <= self.high else _REFUSED


class FlagRule(Rule[bool], frozen=True):
    """true or false."""

    allowed: ClassVar[str] = "true or false"

    metavar: ClassVar[str] = "{true,false}"

    schema: ClassVar[dict[str, Any]] = {"type": "boolean"}

    def _parsed(self, text: str) -> object:
        return {"true": True, "false": False}.get(text.strip().lower(), text)

    def _accepted(self, value: object) -> Any:
        return value if isinstance(value, bool) else _REFUSED


class ChoiceRule(Rule[str], frozen=True):
    """One of a few words, in any case."""

    choices: tuple[str, ...]

    @property
    def allowed(self) -> str:
        return listed(f'"{choice}"' for choice in self.choices)

    @property
    def metavar(self) -> str:
        return "{" + ",".join(self.choices) + "}"

    @property
    def schema(self) -> dict[str, Any]:
        return {"enum": list(self.choices)}

    def refusal(self, value: object) -> str:
        hint = did_you_mean(value, self.choices) if isinstance(value, str) else ""
        return super().refusal(value) + hint

    def _accepted(self, value: object) -> Any:
        word = value.strip().lower() if isinstance(value, str) else ""
        return word if word in self.choices else _REFUSED


class WordRule(ChoiceRule, frozen=True):
    """One of a few words, in any case, each with its value."""

    meant: tuple[Any, ...] = ()

    def plain(self, value: Any) -> Any:
        pairs = zip(self.choices, self.meant, strict=True)
        return next((word for word, meant in pairs if meant == value), value)

    def _accepted(self, value: object) -> Any:
        word = super()._accepted(value)
        return word if word is _REFUSED else self.meant[self.choices.index(word)]


class WordOrRule(WordRule, frozen=True, kw_only=True):
    """One of a few words, each with its value, or a value of another rule."""

    other: Rule[Any]

    @property
    def allowed(self) -> str:
        return f"{super().allowed}, or {self.other.allowed}"

    @property
    def metavar(self) -> str:
        return self.other.metavar

    @property
    def schema(self) -> dict[str, Any]:
        return {"anyOf": [super().schema, self.other.schema]}

    def plain(self, value: Any) -> Any:
        word = super().plain(value)
        return word if word is not value else self.other.plain(value)

    def refusal(self, value: object) -> str:
        return Rule.refusal(self, value)

    def _accepted(self, value: object) -> Any:
        return super()._accepted(value) if isinstance(value, str) else self.other._accepted(value)


class SeveralRule(Rule[tuple[str, ...]], frozen=True):
    """One or more of a few words: a list in TOML, `binary,packets` in text."""

    choices: tuple[str, ...]

    @property
    def allowed(self) -> str:
        return f"a list of one or more of {ChoiceRule(self.choices).allowed}"

    @property
    def metavar(self) -> str:
        return ",".join(self.choices)

    @property
    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": {"enum": list(self.choices)}, "minItems": 1}

    def _parsed(self, text: str) -> object:
        return text.split(",")

    def _accepted(self, value: object) -> Any:
        if not isinstance(value, list | tuple) or not value:
            return _REFUSED
        # A word given twice counts once, at its first place.
        return tuple(dict.fromkeys(ChoiceRule(self.choices).check(word) for word in value))


class NamesRule(Rule[tuple[str, ...]], frozen=True):
    """Any number of names, perhaps none: a list in TOML, `one,two` in text."""

    allowed: ClassVar[str] = "a list of names"

    metavar: ClassVar[str] = "NAME,..."

    schema: ClassVar[dict[str, Any]] = {"type": "array", "items": {"type": "string"}}

    def _parsed(self, text: str) -> object:
        return text.split(",")

    def _accepted(self, value: object) -> Any:
        if not isinstance(value, list | tuple):
            return _REFUSED
        names = (TextRule(blank=True).check(name) for name in value)
        return tuple(dict.fromkeys(name for name in names if name))


class TextRule(Rule[str], frozen=True):
    """A line of text without control characters or spaces around it, not blank unless allowed."""

    blank: bool = False

    allowed: ClassVar[str] = "a line of text"

    metavar: ClassVar[str] = "TEXT"

    @property
    def schema(self) -> dict[str, Any]:
        return {"type": "string", "maxLength": MAX_TEXT} | ({} if self.blank else {"minLength": 1})

    def _accepted(self, value: object) -> Any:
        # Texts go to terminals and logs, where a control character could do anything.
        if not isinstance(value, str) or not value.isprintable() or len(value) > MAX_TEXT:
            return _REFUSED
        return value.strip() if value.strip() or self.blank else _REFUSED


class RawTextRule(Rule[str], frozen=True):
    """A text of up to `longest` characters of any kind, as sent over a wire."""

    longest: int = 256

    @property
    def allowed(self) -> str:
        return f"a text of at most {self.longest} characters"

    metavar: ClassVar[str] = "TEXT"

    @property
    def schema(self) -> dict[str, Any]:
        return {"type": "string", "maxLength": self.longest}

    def _accepted(self, value: object) -> Any:
        return value if isinstance(value, str) and len(value) <= self.longest else _REFUSED


class PairRule(Rule[tuple[float, float]], frozen=True):
    """Two numbers: a list of two in TOML, `6,42` in text."""

    each: NumberRule = NumberRule()

    @property
    def allowed(self) -> str:
        return f"two numbers{self.each.bounds}"

    metavar: ClassVar[str] = "X,Y"

    @property
    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": self.each.schema, "minItems": 2, "maxItems": 2}

    def refusal(self, value: object) -> str:
        parts = value.split(",") if isinstance(value, str) else value
        # Where there are two parts already, an example of two numbers explains nothing.
        if isinstance(parts, list | tuple) and len(parts) == 2:
            return super().refusal(value)
        example = "6,42" if isinstance(value, str) else "[6, 42]"
        return f"must be {self.allowed}, such as {example}, not {describe(value)}"

    def _parsed(self, text: str) -> object:
        return [_number(part) for part in text.split(",")]

    def _accepted(self, value: object) -> Any:
        if not isinstance(value, list | tuple) or len(value) != 2:
            return _REFUSED
        pair = self.each._accepted(value[0]), self.each._accepted(value[1])
        return _REFUSED if _REFUSED in pair else pair


class CodeRule(Rule[str], frozen=True):
    """The code of a command: two characters that programs send."""

    allowed: ClassVar[str] = "two printable ASCII characters without a space, such as u1"

    metavar: ClassVar[str] = "CC"

    schema: ClassVar[dict[str, Any]] = {"type": "string", "pattern": "^[!-~]{2}$"}

    def _accepted(self, value: object) -> Any:
        return value if isinstance(value, str) and re.fullmatch("[!-~]{2}", value) else _REFUSED
