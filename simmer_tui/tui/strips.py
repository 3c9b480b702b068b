"""From rows of cells to what Textual sends: runs of equal style, and only what changed."""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import ClassVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from rich.color import Color
from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from simmer_tui.tui.maze.glyphs import BLANK, Cells, Mask
from simmer_tui.tui.maze.palette import DEFAULT, Attribute
from simmer_tui.tui.textual_internals import spans_are_cropped

# Moving the cursor to the next span takes about as many bytes as the cells in between.
_JOIN = 6
"""Changed spans nearer than this are sent as one, columns."""


class Span(Struct, frozen=True):
    """Cells `start` to `stop` (exclusive) of a row."""

    row: int
    start: int
    stop: int


def changed_spans(old: Cells, new: Cells, join: int | None) -> list[Span]:
    """Spans in which two pictures of one shape differ.

    Spans of a row less than `join` cells apart become one, since moving the cursor costs bytes
    too; None makes one span a row.
    """
    changed = new.differs(old)
    spans: list[Span] = []
    for row in np.flatnonzero(changed.any(axis=1)).tolist():
        columns = np.flatnonzero(changed[row])
        if join is None:
            spans.append(Span(row, int(columns[0]), int(columns[-1]) + 1))
            continue
        gaps = np.flatnonzero(np.diff(columns) > join)
        starts = columns[np.concatenate(([0], gaps + 1))]
        stops = columns[np.concatenate((gaps, [len(columns) - 1]))] + 1
        spans.extend(Span(row, *span) for span in zip(starts.tolist(), stops.tolist(), strict=True))
    return spans


def make_strip(cells: Cells, row: int, default: Style) -> Strip:
    """One row as a strip; cells without colours take the default style.

    No segment is ever without a style: Textual's colour filters fail on one.
    """
    text = cells.text(row)
    segments = [
        Segment(text[start:stop], _style(foreground, background, attributes, default))
        for start, stop, foreground, background, attributes in _runs(cells, row)
    ]
    return Strip(segments, len(text))


def _runs(cells: Cells, row: int) -> Iterator[tuple[int, int, int, int, int]]:
    """(start, stop, foreground, background, attributes) of the runs that need no change of style."""
    background, attributes = cells.background[row], cells.attributes[row]
    foreground = _borrowed_foreground(cells.characters[row] == BLANK, cells.foreground[row], background)
    breaks = (np.diff(foreground) != 0) | (np.diff(background) != 0) | (np.diff(attributes) != 0)
    starts = np.concatenate(([0], np.flatnonzero(breaks) + 1))
    stops = np.concatenate((starts[1:], [len(background)]))
    of_runs = (values[starts].tolist() for values in (foreground, background, attributes))
    yield from zip(starts.tolist(), stops.tolist(), *of_runs, strict=True)


def _borrowed_foreground(
    blank: Mask, foreground: NDArray[np.int32], background: NDArray[np.int32]
) -> NDArray[np.int32]:
    """A blank shows no foreground, so it takes that of its neighbour on the same background: one
    run then goes on through it."""
    index = np.arange(len(blank))
    new_stretch = np.concatenate(([True], np.diff(background) != 0))
    first = np.maximum.accumulate(np.where(new_stretch, index, 0))
    # An index beyond the end means "none"; looking backwards is looking forwards in the mirror.
    before = np.maximum.accumulate(np.where(blank, -1, index))
    after = np.minimum.accumulate(np.where(blank, len(blank), index)[::-1])[::-1]
    lends_before = before >= first
    after_clipped = np.minimum(after, len(blank) - 1)
    lends_after = (after < len(blank)) & (first[after_clipped] == first)
    lender = np.where(lends_before, before, np.where(lends_after, after_clipped, index))
    return np.where(background == DEFAULT, foreground, foreground[lender])


# Making a Style takes longer than all else about a run of cells.
@lru_cache(maxsize=8192)
def _style(foreground: int, background: int, attributes: int, default: Style) -> Style:
    plain = default
    if foreground != DEFAULT or background != DEFAULT:
        color = None if foreground == DEFAULT else _color(foreground)
        bgcolor = default.bgcolor if background == DEFAULT else _color(background)
        plain = Style(color=color, bgcolor=bgcolor)
    if not attributes:
        return plain
    return plain + Style(
        bold=bool(attributes & Attribute.BOLD) or None,
        dim=bool(attributes & Attribute.DIM) or None,
        reverse=bool(attributes & Attribute.REVERSE) or None,
    )


def _color(packed: int) -> Color:
    return Color.from_rgb(packed >> 16, (packed >> 8) & 255, packed & 255)


class CellsWidget(Widget):
    """Shows a picture of cells, below rows of another kind if there are any, and sends only what changed."""

    CELLS_TOP: ClassVar[int] = 0
    """Rows above the picture."""

    _cells: Cells | None = None
    _cells_style = Style()
    _strips: Sequence[Strip] = ()

    def show_cells(self, cells: Cells, style: Style) -> None:
        """Show a picture. Cells without colours take `style`."""
        before, self._cells = self._cells, cells
        # Another shape or style changes every cell: comparing would find nothing that stays.
        if before is None or before.shape != cells.shape or style != self._cells_style:
            self._cells_style = style
            self._strips = [make_strip(cells, row, style) for row in range(cells.shape[0])]
            self.refresh()
            return
        spans = changed_spans(before, cells, _JOIN if spans_are_cropped() else None)
        strips = list(self._strips)
        for row in {span.row for span in spans}:
            strips[row] = make_strip(cells, row, style)
        self._strips = strips
        if spans:
            top = self.CELLS_TOP
            self.refresh(*(Region(span.start, top + span.row, span.stop - span.start, 1) for span in spans))

    def forget_cells(self) -> None:
        """Have the next picture sent as a whole: the colours around it are others."""
        self._cells = None

    def render_line(self, y: int) -> Strip:
        row = y - self.CELLS_TOP
        return self._strips[row] if row < len(self._strips) else Strip.blank(self.size.width, self.rich_style)
