"""Replies of a dialect.toml: text with `{expression:format}`, or a binary frame."""

import math
import re
import struct
from collections.abc import Iterator

from msgspec import Struct

from simmer_tui.dialect.expressions import Expression, FieldValue, RealNumber, Scope
from simmer_tui.errors import ExpressionError
from simmer_tui.sim.command import counted

# The part of Python's format language whose results fit in a line.
_FORMAT = re.compile(r"(?:.?[<>=^])?[ +-]?#?0?(\d*),?(?:\.(\d+))?[a-zA-Z%]?", re.DOTALL)
# A field of a protocol; without a limit {u0:100000000.2f} would be a reply of 100 MB.
_WIDEST = 99
"""Greatest width of a format."""
# A double has 17 digits; more digits take more time than the rest of an expression.
_FINEST = 17
"""Greatest precision of a format."""
# A list of 360 distances takes 6,000.
LONGEST_FIELD = 32_768
"""Characters of a field of a reply, and bytes of a packed content."""
# At 9600 baud, a robot's line takes a minute for so many.
LONGEST_REPLY = 65_536
"""Characters of a reply, and bytes of all replies to a message."""
_WHOLE = "bcdoxX"
_TEXT = "s"


class Field(Struct, frozen=True):
    """`{expression:format}` of a reply; with a `joint` it is a list, joined by this text."""

    expression: Expression
    format: str = ""
    joint: str | None = None

    def text(self, scope: Scope, missing: str) -> str:
        """The field as text. A value that is not finite is `missing`. Raises ExpressionError."""
        value, text, joint = self.expression.value(scope), "", ""
        # One growing text: a list of all texts would take several times the memory.
        for each in value if self.joint is not None and isinstance(value, tuple) else (value,):
            text += joint + self._one(each, missing)
            if len(text) > LONGEST_FIELD:
                raise ExpressionError(f"fields go up to {LONGEST_FIELD} characters")
            joint = self.joint or ""
        return text

    def _one(self, value: FieldValue, missing: str) -> str:
        if isinstance(value, tuple):
            raise ExpressionError(f"'{self.expression.source}' is a list; write {{...|,}} to join it")
        if isinstance(value, str):
            return format(value, self.format if self.format.endswith(_TEXT) else "")
        if not math.isfinite(value):
            return missing
        return format(_fitting(value, self.format), self.format)


def _fitting(value: RealNumber, wanted: str) -> RealNumber | str:
    if wanted[-1:] in _WHOLE and wanted:
        return round(value)  # half to even
    if wanted.endswith(_TEXT) and wanted:
        return str(value)
    return float(value) if wanted else value


class TextReply(Struct, frozen=True):
    """A text reply: alternately plain parts and fields."""

    source: str
    parts: tuple[str | Field, ...]

    @property
    def expressions(self) -> tuple[Expression, ...]:
        """The expressions in it."""
        return tuple(part.expression for part in self.parts if isinstance(part, Field))

    def text(self, scope: Scope, missing: str) -> str:
        """The reply with its values. Raises ExpressionError."""
        text = ""
        for part in self.parts:
            text += part if isinstance(part, str) else part.text(scope, missing)
            if len(text) > LONGEST_REPLY:
                raise ExpressionError(f"replies go up to {LONGEST_REPLY} characters")
        return text


class BinaryReply(Struct, frozen=True):
    """A binary frame: its `type`, and as content a text, or values packed by a struct format, `times` over
    (`k` counts from 0)."""

    type: int | None
    text: TextReply | None = None
    pack: str = ""
    values: tuple[Expression, ...] = ()
    times: int = 1

    @property
    def expressions(self) -> tuple[Expression, ...]:
        """The expressions in it."""
        return self.values + (self.text.expressions if self.text is not None else ())

    def content(self, scope: Scope, missing: str) -> bytes:
        """The content of the frame. Raises ExpressionError."""
        if self.text is not None:
            return self.text.text(scope, missing).encode("utf-8", "surrogateescape")
        values = [each.value(scope) for each in self.values]
        try:
            return struct.pack(self.pack, *map(packable, values, pack_codes(self.pack)))
        except (struct.error, OverflowError) as error:
            raise ExpressionError(f"cannot be packed as '{self.pack}': {error}") from None


def packable(value: FieldValue, code: str) -> object:
    """A value as `struct` packs it by a code. Raises ExpressionError for a list."""
    if isinstance(value, tuple):
        raise ExpressionError("a list cannot be packed; name its values one by one")
    if isinstance(value, str):
        return value.encode("utf-8", "surrogateescape")
    if code in "fde":
        return float(value)
    if not math.isfinite(value):
        return 0  # whole numbers have no other value for what is missing
    return round(value)


def pack_codes(pack: str) -> Iterator[str]:
    """The codes of a struct format, one a value."""
    for count, code in re.findall(r"(\d*)([a-zA-Z?])", pack):
        if code == "x":
            continue
        yield from code * (1 if code in "sp" else int(count or 1))


def parsed_reply(source: str) -> tuple[TextReply, list[str]]:
    """A parsed reply, without the parts that cannot be parsed, and the mistakes in these."""
    parts: list[str | Field] = []
    mistakes: list[str] = []
    plain, at = "", 0
    while at < len(source):
        character = source[at]
        if source[at : at + 2] in ("{{", "}}"):
            plain, at = plain + character, at + 2
            continue
        end = at
        try:
            if character == "{":
                end = len(source)
                end = _end_of_field(source, at)
                parts += [plain, _field(source[at + 1 : end])]
                plain = ""
            elif character == "}":
                raise ValueError("has a } without its {; a brace itself is written twice")
            else:
                plain += character
        except ValueError as error:
            mistakes.append(str(error))
        at = end + 1
    parts.append(plain)
    return TextReply(source, tuple(part for part in parts if part != "")), mistakes


def _end_of_field(source: str, begin: int) -> int:
    """The place of the brace that closes a field; those in quotes do not count."""
    for at, character in _unquoted(source, begin + 1):
        if character == "}":
            return at
    raise ValueError(
        f"'{source[begin : begin + 30]}' has a {{ without its }}; a brace itself is written twice"
    )


def _field(inside: str) -> Field:
    source, joint = _parted(inside, "|")
    expression, shape = _parted(source, ":")
    checked = _FORMAT.fullmatch(shape or "")
    width, digits = (int(each or 0) for each in checked.groups()) if checked is not None else (0, 0)
    if checked is None or width > _WIDEST or digits > _FINEST:
        limits = f"up to {_WIDEST} wide, with {_FINEST} decimals"
        raise ValueError(f"{{{inside}}}: '{shape}' is no format, such as .2f or d, {limits}")
    try:
        format("" if (shape or "").endswith(_TEXT) else _fitting(1.5, shape or ""), shape or "")
    except ValueError as error:
        raise ValueError(f"{{{inside}}}: '{shape}' is no format: {error}") from None
    return Field(Expression(expression), shape or "", joint)


def _parted(text: str, mark: str) -> tuple[str, str | None]:
    """The text before a mark, and after it; a mark inside brackets or quotes does not count."""
    depth = 0
    for at, character in _unquoted(text):
        depth += (character in "([") - (character in ")]")
        if character == mark and not depth:
            return text[:at], text[at + 1 :]
    return text, None


def _unquoted(text: str, begin: int = 0) -> Iterator[tuple[int, str]]:
    """The characters of a text outside quotes, from an index on, each with its index."""
    quote = ""
    for at in range(begin, len(text)):
        character = text[at]
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        else:
            yield at, character


def check_pack(pack: str, count: int) -> None:
    """Raise ValueError if a struct format is invalid, or has another number of values."""
    try:
        size = struct.calcsize(pack)
    except struct.error as error:
        raise ValueError(f"'{pack}' is no struct format: {error}") from None
    if size > LONGEST_FIELD:
        raise ValueError(f"'{pack}' has {size} bytes; {LONGEST_FIELD} are allowed")
    wanted = len(tuple(pack_codes(pack)))
    if wanted != count:
        raise ValueError(f"'{pack}' has {counted(wanted, 'value')} for {counted(count, 'name')}")
