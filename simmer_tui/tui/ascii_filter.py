"""The whole screen in ASCII, for terminals without UTF-8."""

from __future__ import annotations

from rich.cells import cell_len
from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

_RESEMBLING = (
    ("-", "─━▁▂▔–—"),
    ("|", "│┃▌▐▎▊▏"),
    ("+", "┌┐└┘├┤┬┴┼╭╮╰╯"),
    ("#", "█▃▄▅▆▇▀"),
    ("*", "•"),
    (".", "·"),
    ("~", "…"),
    ("^", "↑"),
    ("v", "↓"),
    ("<", "←"),
    (">", "→"),
)
_REPLACED = {character: sign for sign, characters in _RESEMBLING for character in characters}


class AsciiFilter(LineFilter):
    """Replaces what such a terminal cannot show, whoever drew it."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """The segments in ASCII, every character as wide as before."""
        return [Segment(plain_text(text), style, control) for text, style, control in segments]


def plain_text(text: str) -> str:
    """Text in ASCII: lines and blocks as signs that resemble them, anything else as `?`."""
    if text.isascii():
        return text
    return "".join(c if c.isascii() else _REPLACED.get(c, "?" * cell_len(c)) for c in text)
