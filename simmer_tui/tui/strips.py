"""From rows of cells to Textual's strips: runs of equal style, and only changed parts."""

from collections.abc import Sequence
from functools import lru_cache
from typing import ClassVar, Self

import numpy as np
from rich.color import Color
from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from simmer_tui.sim.arrays import NDArray
from simmer_tui.tui.maze.glyphs import BLANK, Cells, Mask
from simmer_tui.tui.maze.palette import DEFAULT, Attribute
from simmer_tui.tui.textual_internals import mark_changed


def changed_spans(old: Cells, new: Cells) -> list[Region]:
    """Spans in which two pictures of one shape differ, one a row. The writer leaves out equal cells in
    between."""
    changed = new.differs(old)
    spans: list[Region] = []
    for row in np.flatnonzero(changed.any(axis=1)).tolist():
        columns = np.flatnonzero(changed[row]).tolist()
        spans.append(Region(columns[0], row, columns[-1] + 1 - columns[0], 1))
    return spans


def make_strips(cells: Cells, rows: Sequence[int], default: Style) -> list[Strip]:
    """Some rows as strips; cells without colours take the default style.

    No segment is ever without a style: Textual's colour filters fail on one.
    """
    if not rows:
        return []
    texts = [cells.text(row) for row in rows]
    # All rows at once: for a single one the arithmetic costs less than its call.
    background, attributes = cells.background[rows], cells.attributes[rows]
    blank = cells.characters[rows] == BLANK
    foreground = _borrowed_foreground(blank, cells.foreground[rows], background)
    begins = np.ones(blank.shape, dtype=np.bool_)
    begins[:, 1:] = (foreground[:, 1:] != foreground[:, :-1]) | (background[:, 1:] != background[:, :-1])
    begins[:, 1:] |= attributes[:, 1:] != attributes[:, :-1]
    of_runs = (values[begins].tolist() for values in (foreground, background, attributes))
    styles = [_style(*run, default) for run in zip(*of_runs, strict=True)]
    starts = np.nonzero(begins)[1].tolist()
    ends = np.cumsum(begins.sum(axis=1)).tolist()
    strips, run = [], 0
    for text, end in zip(texts, ends, strict=True):
        stops = [*starts[run + 1 : end], len(text)]
        pieces = zip(starts[run:end], stops, styles[run:end], strict=True)
        strips.append(Strip([_segment(text[start:stop], style) for start, stop, style in pieces], len(text)))
        run = end
    return strips


def _segment(text: str, style: Style) -> Segment:
    # A named tuple's own constructor takes three times as long, and a busy picture has thousands.
    return tuple.__new__(Segment, (text, style, None))


def _borrowed_foreground(
    blank: Mask, foreground: NDArray[np.int32], background: NDArray[np.int32]
) -> NDArray[np.int32]:
    """Foregrounds in which a blank has that of its neighbour on the same background.

    A blank shows no foreground, so that one run then continues through it. All are (rows, columns).
    """
    width = blank.shape[1]
    index = np.arange(width)
    new_stretch = np.ones(blank.shape, dtype=np.bool_)
    new_stretch[:, 1:] = background[:, 1:] != background[:, :-1]
    first = np.maximum.accumulate(np.where(new_stretch, index, 0), axis=1)
    # An index beyond the end means "none"; looking backwards is looking forwards in the mirror.
    before = np.maximum.accumulate(np.where(blank, -1, index), axis=1)
    after = np.minimum.accumulate(np.where(blank, width, index)[:, ::-1], axis=1)[:, ::-1]
    after_clipped = np.minimum(after, width - 1)
    lends_after = (after < width) & (np.take_along_axis(first, after_clipped, axis=1) == first)
    lender = np.where(before >= first, before, np.where(lends_after, after_clipped, index))
    borrowed = np.take_along_axis(foreground, lender, axis=1)
    return np.where(background == DEFAULT, foreground, borrowed)


# Making a Style takes longer than all other work for a run of cells.
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


class DirectLines(Widget):
    """Widget that fills all of its lines, each with its whole style.

    Textual adds border, padding, background and opacity around every line, even if there are none: a fifth of
    the time of a picture. Without border and padding, lines skip that.
    """

    def refresh(self, *regions: Region, **options: bool) -> Self:
        """Send regions with the next update. With options, or without regions, it is Textual's own."""
        if not regions or options or not mark_changed(self, regions):
            super().refresh(*regions, **options)
        return self

    def render_lines(self, crop: Region) -> list[Strip]:
        """Strips of the part of the widget in `crop`."""
        size = self.outer_size
        # Either would make the content smaller than the widget.
        if size != self.size:
            return super().render_lines(crop)
        strips = self.cropped_lines(crop, size.width)
        for line_filter in self.get_line_filters():
            background = self.background_colors[1]
            strips = [strip.apply_filter(line_filter, background) for strip in strips]
        return strips

    def cropped_lines(self, crop: Region, width: int) -> list[Strip]:
        """The same before Textual's filters, for a widget of `width` columns."""
        strips = [self.render_line(y) for y in crop.line_range]
        # Between a change of size and its new picture, lines have the old width.
        strips = [
            strip if strip.cell_length == width else strip.adjust_cell_length(width, self.rich_style)
            for strip in strips
        ]
        if crop.column_span == (0, width):
            return strips
        return [strip.crop(*crop.column_span) for strip in strips]


class CellsWidget(DirectLines):
    """Shows a picture of cells, below rows of another kind if there are any, and sends only changes."""

    CELLS_TOP: ClassVar[int] = 0
    """Rows above the picture."""

    _cells: Cells | None = None
    _cells_style = Style()
    _is_forgotten = False
    """True if colours around the picture have changed since it was shown."""

    def show_cells(self, cells: Cells, style: Style) -> None:
        """Show a picture. Cells without colours take `style`."""
        before, self._cells = self._cells, cells
        # Another shape or style changes every cell: a comparison would find nothing equal.
        is_forgotten, self._is_forgotten = self._is_forgotten, False
        if is_forgotten or before is None or before.shape != cells.shape or style != self._cells_style:
            self._cells_style = style
            self.refresh()
            return
        spans = changed_spans(before, cells)
        if spans:
            self.refresh(*(span.translate((0, self.CELLS_TOP)) for span in spans))

    def forget_cells(self) -> None:
        """Send the next picture as a whole: the colours around it have changed."""
        self._is_forgotten = True

    def cropped_lines(self, crop: Region, width: int) -> list[Strip]:
        cells, top = self._cells, crop.y - self.CELLS_TOP
        if cells is None or top < 0 or top + crop.height > cells.shape[0] or width != cells.shape[1]:
            return super().cropped_lines(crop, width)
        part = cells.part(slice(top, top + crop.height), slice(*crop.column_span))
        return make_strips(part, range(crop.height), self._cells_style)

    def render_line(self, y: int) -> Strip:
        cells, row = self._cells, y - self.CELLS_TOP
        if cells is None or row >= cells.shape[0]:
            return Strip.blank(self.size.width, self.rich_style)
        return make_strips(cells, [row], self._cells_style)[0]
