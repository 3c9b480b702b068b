"""Delta writer: terminal sequences only for the cells that differ from those on the screen.

It knows the terminal's content, its cursor position and its style. So it skips equal cells, and sends only
the changes of a style. Of scattered cells, those of one style come one after the other: a style takes up to
36 bytes, a jump 8. `textual_internals` installs it.
"""

import unicodedata
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Final

from msgspec import Struct
from rich.cells import get_character_cell_size
from rich.color import Color, ColorSystem
from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip

# `CSI 123 G` has six bytes.
_BRIDGE = 6
"""Most equal cells in a row that may be sent again instead of a jump over them."""
# A picture changes some hundred cells. A new page changes thousands, in long runs of one style.
_SCATTERED = 1500
"""Most changed cells that are sent in the order of their styles."""
# The first 16 are the user's own. Some of the others are there twice.
_NUMBER_OF: Final = {Color.from_ansi(number).get_truecolor(): number for number in range(255, 15, -1)}
"""Number of each of the 256 colours."""
_ON = ("1", "2", "3", "4", "5", "6", "7", "8", "9", "21", "51", "52", "53")
"""SGR code that switches each attribute on, in the order of Rich's bits."""
_OFF = ("22", "22", "23", "24", "25", "25", "27", "28", "29", "24", "54", "54", "55")
# Underline, reverse, strike, double underline, frame, circle, overline.
_SEEN_ON_BLANKS = 1 << 3 | 1 << 6 | 1 << 8 | 0b1111 << 9
"""Bits of the attributes that are visible on a blank."""
_ANY = ""
"""Foreground of a blank: none is visible."""
# Terminals of East Asian settings show ambiguous characters, as those of boxes, in two cells.
_SURE_WIDTHS = ("N", "Na", "H")
"""East Asian widths of characters that every terminal shows in one cell."""
_UNKNOWN = -1
"""A cell with unknown content; it differs from every other."""
# Code points have 21 bits.
_PEN_SHIFT: Final = 21
_CHARACTER: Final = (1 << _PEN_SHIFT) - 1
# A screen of this app has about a hundred; fading notifications make more.
_MOST_PENS = 4096
"""Pens after which all of them, and the known content of the screen, are dropped."""
# About 500 bytes each.
_MOST_TEXTS = 8192
"""Texts whose cells are kept."""
# A paste and a program's output may have them. Rich counts them as no cell, terminals act on them.
_NO_CONTROLS: Final = dict.fromkeys((*range(0x20), *range(0x7F, 0xA0)))
"""Translation of a text without its control characters."""
_END: Final = 1 << 16
"""A column beyond that of any terminal."""


class Pen(Struct, frozen=True):
    """A style as a terminal keeps it: attributes as bits, and the SGR codes of its two colours."""

    attributes: int = 0
    foreground: str = "39"
    background: str = "49"

    @property
    def for_blank(self) -> "Pen":
        """The part of it that is visible on a blank."""
        return self if self.attributes & _SEEN_ON_BLANKS else Pen(0, _ANY, self.background)


_PLAIN = Pen()


class DeltaWriter:
    """Keeps the content of a terminal, and makes the sequences that change it."""

    def __init__(self) -> None:
        self._screen = 0, 0, ColorSystem.TRUECOLOR
        self._rows: list[list[int]] = []
        """Cells on the screen, each the number of its pen and its character, or `_UNKNOWN`."""
        self._forget_pens()
        self._out: list[str] = []
        self._changed: dict[int, set[int]] = {}
        """By row, the columns that have changed and are not sent yet."""
        # The cursor's position; -1 if it is not known.
        self._row = self._column = -1
        self._is_sure = False
        """True if every terminal has its cursor there, whatever width it gives to ambiguous characters."""
        self._pen = 0

    def begin(self, width: int, height: int, colors: ColorSystem, *, is_full: bool = False) -> None:
        """Begin an update of a screen. `is_full` forgets the known content of the screen, as a new size
        does."""
        screen = width, height, colors
        if is_full or self._screen != screen or len(self._pens) > _MOST_PENS:
            self._screen = screen
            self._changed.clear()
            self._rows = [[_UNKNOWN] * width for _ in range(height)]
            self._forget_pens()
        # Others write between two updates, and leave the cursor anywhere.
        self._row = self._column = -1

    def end(self) -> str:
        """The sequences of the update. They end in the default style, as other writers expect."""
        self._send_changes()
        if self._pen:
            self._out.append("\x1b[0m")
            self._pen = 0
        text, self._out = "".join(self._out), []
        return text

    def write(
        self, row: int, column: int, segments: Iterable[Segment], first: int = 0, last: int = _END
    ) -> None:
        """Write segments from a cell on, as far as they are in columns `first` to `last`."""
        cells: list[int] = []
        known = self._known
        for text, style, _ in segments:
            found = known.get((text, style))
            if found is None:
                found = known[text, style] = self._cells_of(text, style)
            if found:
                cells += found
            elif text.translate(_NO_CONTROLS):
                self._write_wide(row, column, segments, first, last)
                return
        begin, end = max(first - column, 0), max(min(last, self._screen[0]) - column, 0)
        self._write_cells(row, column + begin, cells[begin:end])

    # -- within ----------------------------------------------------------------------------------

    def _forget_pens(self) -> None:
        self._pens: list[Pen] = []
        self._numbers: dict[Pen, int] = {}
        self._known: dict[tuple[str, Style | None], list[int]] = {}
        """Cells of texts written before: most of a picture comes again with the next one."""
        self._changes: dict[tuple[int, int], tuple[str, int]] = {}
        self._number(_PLAIN)

    def _number(self, pen: Pen) -> int:
        number = self._numbers.get(pen)
        if number is None:
            number = self._numbers[pen] = len(self._pens)
            self._pens.append(pen)
        return number

    def _cells_of(self, text: str, style: Style | None) -> list[int]:
        """Cells of a text without its control characters. Empty if another takes two cells or none, or if it
        is a link."""
        text = text.translate(_NO_CONTROLS)
        if len(self._known) >= _MOST_TEXTS:
            self._known.clear()
        is_link = style is not None and style.link is not None
        if is_link or not (text.isascii() or all(get_character_cell_size(each) == 1 for each in text)):
            return []
        pen = pen_of(style, self._screen[2])
        letters = self._number(pen) << _PEN_SHIFT
        # All blanks have one value, whatever colour their letters would have.
        blank = self._number(pen.for_blank) << _PEN_SHIFT | ord(" ")
        return [blank if each == " " else letters | ord(each) for each in text]

    def _write_cells(self, row: int, column: int, cells: list[int]) -> None:
        """Note those cells that the screen does not show yet."""
        if not cells or not 0 <= row < len(self._rows):
            return
        shown = self._rows[row]
        last = column + len(cells)
        if shown[column:last] == cells:
            return
        changed = self._changed.setdefault(row, set())
        for at, cell in enumerate(cells, column):
            if shown[at] != cell:
                shown[at] = cell
                changed.add(at)

    def _send_changes(self) -> None:
        """Send the cells that have changed. Where few have, in the order of their styles: in runs of
        `wander.py` no picture took fewer bytes row by row."""
        places = [(row, at) for row in sorted(self._changed) for at in sorted(self._changed[row])]
        self._changed.clear()
        self._send(self._by_style(places) if len(places) <= _SCATTERED else places)

    def _by_style(self, places: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """Places, which are in the order of rows, in that of their styles; cells beside each other that can
        be written in one style stay together."""
        runs: list[list[tuple[int, int]]] = []
        styles: list[Pen] = []
        for row, at in places:
            pen = self._pens[self._rows[row][at] >> _PEN_SHIFT]
            if runs and runs[-1][-1] == (row, at - 1) and (joint := _joint(styles[-1], pen)) is not None:
                runs[-1].append((row, at))
                styles[-1] = joint
            else:
                runs.append([(row, at)])
                styles.append(pen)
        by_pen: dict[Pen, list[tuple[int, int]]] = {}
        for run, pen in zip(runs, styles, strict=True):
            by_pen.setdefault(pen, []).extend(run)
        return [place for pen in _in_order(by_pen) for place in by_pen[pen]]

    def _send(self, places: Iterable[tuple[int, int]]) -> None:
        """Send the cells of some places."""
        out, changes = self._out, self._changes
        for row, at in places:
            cell = self._rows[row][at]
            if self._row != row or self._column != at:
                self._go(row, at)
            number = cell >> _PEN_SHIFT
            if number != self._pen:
                change = changes.get((self._pen, number))
                if change is None:
                    change = changes[self._pen, number] = self._change(number)
                out.append(change[0])
                self._pen = change[1]
            character = chr(cell & _CHARACTER)
            out.append(character)
            self._is_sure = self._is_sure and _is_narrow(character)
            self._column = at + 1
            if self._column >= self._screen[0]:
                self._row = -1  # the terminal may have wrapped the line, or not

    def _go(self, row: int, column: int) -> None:
        """Move the cursor by the shortest sequence. A few equal cells are written again instead."""
        sent, is_sure = f"\x1b[{row + 1};{column + 1}H", True
        aside = f"\x1b[{column + 1}G"
        if self._is_sure:
            aside = _shortest(aside, _aside(column - self._column))
        if self._row == row:
            sent = aside
            between = self._rows[row][self._column : column]
            ahead = 0 <= column - self._column <= _BRIDGE
            if ahead and all(self._fits(cell) for cell in between):
                again = "".join(chr(cell & _CHARACTER) for cell in between)
                if len(again.encode()) <= len(sent):
                    sent, is_sure = again, self._is_sure and all(map(_is_narrow, again))
        elif self._row >= 0 and self._is_sure:
            sent = _shortest(sent, _down(row - self._row) + aside)
        self._out.append(sent)
        self._row, self._column, self._is_sure = row, column, is_sure

    def _fits(self, cell: int) -> bool:
        """True if a cell can be written with the present pen."""
        return cell != _UNKNOWN and self._fitted(self._pens[cell >> _PEN_SHIFT]) == self._pens[self._pen]

    def _fitted(self, wanted: Pen) -> Pen:
        """The pen in which a cell of another pen can be written: for a blank, invisible parts stay as they
        are."""
        if wanted.foreground != _ANY:
            return wanted
        pen = self._pens[self._pen]
        return Pen(pen.attributes & ~_SEEN_ON_BLANKS, pen.foreground, wanted.background)

    def _change(self, number: int) -> tuple[str, int]:
        """The sequence from the present pen to another, and the number of the pen after it."""
        before, after = self._pens[self._pen], self._fitted(self._pens[number])
        codes = change_of(before, after)
        return (f"\x1b[{codes}m" if codes else ""), self._number(after)

    def _write_wide(self, row: int, column: int, segments: Iterable[Segment], first: int, last: int) -> None:
        """Write a line with a link, or a character that takes two cells or none. It is always sent, since
        terminals differ in how they show it."""
        self._send_changes()
        if self._pen:
            self._out.append("\x1b[0m")
            self._pen = 0
        strip = Strip(Segment(text.translate(_NO_CONTROLS), style) for text, style, _ in segments)
        begin, last = max(first - column, 0), min(last, self._screen[0])
        strip = strip.crop(begin, min(max(last - column, 0), strip.cell_length))
        colors = self._screen[2]
        shown = "".join(
            text if style is None else style.render(text, color_system=colors) for text, style, _ in strip
        )
        self._out.append(f"\x1b[{row + 1};{column + begin + 1}H{shown}")
        if 0 <= row < len(self._rows):
            cells = self._rows[row]
            end = min(column + begin + strip.cell_length, len(cells))
            cells[column + begin : end] = [_UNKNOWN] * max(end - column - begin, 0)
        self._row = -1


def _is_narrow(character: str) -> bool:
    """True if every terminal shows a character in one cell."""
    return unicodedata.east_asian_width(character) in _SURE_WIDTHS


def _shortest(*sequences: str) -> str:
    """The first of the shortest sequences."""
    return min(sequences, key=len)


def _aside(columns: int) -> str:
    """The sequence that moves the cursor to the right, or to the left if negative."""
    if columns > 0:
        return _moved(columns, "C")
    return _shortest("\b" * -columns, _moved(-columns, "D"))


def _down(rows: int) -> str:
    """The sequence that moves the cursor down, or up if negative."""
    return _moved(rows, "B") if rows > 0 else _moved(-rows, "A")


def _moved(cells: int, final: str) -> str:
    """A cursor sequence; a distance of one is its default."""
    return f"\x1b[{cells if cells > 1 else ''}{final}" if cells else ""


def _in_order(pens: Iterable[Pen]) -> list[Pen]:
    """Pens in an order in which a change of the background keeps the foreground, where both are the same."""
    grounds: dict[tuple[str, int], list[Pen]] = {}
    for pen in pens:
        grounds.setdefault((pen.background, pen.attributes), []).append(pen)
    order: list[Pen] = []
    last = _ANY
    for ground in sorted(grounds):
        # Blanks fit any foreground.
        order += sorted(grounds[ground], key=lambda pen: (pen.foreground not in (_ANY, last), pen.foreground))
        last = order[-1].foreground or last
    return order


def _joint(one: Pen, other: Pen) -> Pen | None:
    """The pen in which cells of both pens can be written; None if there is none."""
    if one == other:
        return one
    if one.background != other.background or _ANY not in (one.foreground, other.foreground):
        return None
    full = other if one.foreground == _ANY else one
    return None if full.attributes & _SEEN_ON_BLANKS else full


# A picture has dozens of styles and thousands of texts.
@lru_cache(maxsize=_MOST_PENS)
def pen_of(style: Style | None, colors: ColorSystem) -> Pen:
    """Pen of a style, in the colours that a terminal has."""
    if style is None:
        return _PLAIN
    attributes = sum(1 << bit for bit, name in enumerate(_NAMES) if getattr(style, name))
    foreground, background = _PLAIN.foreground, _PLAIN.background
    if style.color is not None:
        foreground = _codes_of(style.color.downgrade(colors), foreground=True)
    if style.bgcolor is not None:
        background = _codes_of(style.bgcolor.downgrade(colors), foreground=False)
    return Pen(attributes, foreground, background)


def _codes_of(color: Color, *, foreground: bool) -> str:
    """The SGR codes of a colour: by its number where it is one of the 256, which takes up to 7 bytes less."""
    number = None if color.triplet is None else _NUMBER_OF.get(color.triplet)
    return ";".join((Color.from_ansi(number) if number else color).get_ansi_codes(foreground=foreground))


_NAMES = (
    *("bold", "dim", "italic", "underline", "blink", "blink2", "reverse", "conceal", "strike"),
    *("underline2", "frame", "encircle", "overline"),
)
"""Attributes of a style in the order of their bits."""


def change_of(before: Pen, after: Pen) -> str:
    """The shortest SGR codes that turn one pen into another; empty for the same."""
    return min(";".join(_codes(before, after)), ";".join(("0", *_codes(_PLAIN, after))), key=len)


def _codes(before: Pen, after: Pen) -> Iterator[str]:
    """The codes for each difference of two pens."""
    removed = before.attributes & ~after.attributes
    offs = dict.fromkeys(off for bit, off in enumerate(_OFF) if removed >> bit & 1)
    # A code switches off all attributes of its kind, so the others of them are switched on again.
    kept = [bit for bit, off in enumerate(_OFF) if off not in offs and before.attributes >> bit & 1]
    yield from offs
    yield from (on for bit, on in enumerate(_ON) if after.attributes >> bit & 1 and bit not in kept)
    if after.foreground != before.foreground:
        yield after.foreground
    if after.background != before.background:
        yield after.background
