"""The form of a reply, in every dialect: its format, the order of its bytes, and its end."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import StrEnum

NUMBERS = {
    ("float64", "big"): struct.Struct(">d"),
    ("float64", "little"): struct.Struct("<d"),
    ("float32", "big"): struct.Struct(">f"),
    ("float32", "little"): struct.Struct("<f"),
}
"""Floating-point numbers by their format and the order of their bytes."""


class ReplyFormat(StrEnum):
    """Format of a reply. All but `FRAMED` are what `legacy_reply` may say."""

    FRAMED = "framed"
    FLOAT64 = "float64"
    FLOAT32 = "float32"
    TEXT = "text"


class ReplyEnd(StrEnum):
    """End of a reply: its size, a character, or silence."""

    FLOAT64 = "float64"
    FLOAT32 = "float32"
    NEWLINE = "newline"
    BRACKET = "bracket"
    QUIET = "quiet"


_ENDS = {
    ReplyFormat.FLOAT64: ReplyEnd.FLOAT64,
    ReplyFormat.FLOAT32: ReplyEnd.FLOAT32,
    ReplyFormat.TEXT: ReplyEnd.NEWLINE,
    ReplyFormat.FRAMED: ReplyEnd.BRACKET,
}


@dataclass(frozen=True, slots=True)
class ReplyForm:
    """Format of a reply and, for numbers in binary, the order of the bytes."""

    format: ReplyFormat
    byte_order: str = "little"

    @property
    def end(self) -> ReplyEnd:
        """The end of a reply of this form unless told otherwise."""
        return _ENDS[self.format]


def pack_number(layout: struct.Struct, number: float) -> bytes:
    """A number in binary. A number too great for a float32 becomes infinite."""
    try:
        return layout.pack(number)
    except OverflowError:
        return layout.pack(math.copysign(math.inf, number))
