"""Formats of the numbers in replies: one table, of which settings, codecs and warnings are made.

A format of numbers is a row of `NUMBER_LETTERS`, a member of `ReplyFormat` and one of `ReplyEnd`. The codec
that packs and reads such numbers is `links/protocol/replies.py`.
"""

import struct
from enum import StrEnum

from msgspec import Struct

NUMBER_LETTERS = {"float64": "d", "float32": "f"}
"""Binary formats of a number, by name: the letter of `struct`, for eight and for four bytes."""
BYTE_ORDERS = {"big": ">", "little": "<"}
"""Orders of the bytes, by name: the sign of `struct`."""
NUMBER_STRUCTS = {
    (name, order): struct.Struct(sign + letter)
    for name, letter in NUMBER_LETTERS.items()
    for order, sign in BYTE_ORDERS.items()
}
"""Floating-point numbers by their format and the order of their bytes."""
NUMBER_SIZES = {name: struct.calcsize(f"={letter}") for name, letter in NUMBER_LETTERS.items()}
"""Bytes of a number by its format. Other formats have no fixed size."""


class ReplyFormat(StrEnum):
    """Format of a reply. All but `FRAMED` are possible values of `legacy_reply`."""

    FRAMED = "framed"
    FLOAT64 = "float64"
    FLOAT32 = "float32"
    TEXT = "text"


class ReplyEnd(StrEnum):
    """End of a reply: the size of its numbers, a character, or silence."""

    FLOAT64 = "float64"
    FLOAT32 = "float32"
    NEWLINE = "newline"
    BRACKET = "bracket"
    QUIET = "quiet"


# The end of replies in each format that is text.
_ENDS = {ReplyFormat.TEXT: ReplyEnd.NEWLINE, ReplyFormat.FRAMED: ReplyEnd.BRACKET}


class ReplyForm(Struct, frozen=True):
    """Format of a reply and, for numbers in binary, the order of the bytes."""

    format: ReplyFormat
    byte_order: str = "little"

    @property
    def end(self) -> ReplyEnd:
        """The end of a reply of this form; the setting `reply_end` names another."""
        return _ENDS.get(self.format) or ReplyEnd(self.format.value)
