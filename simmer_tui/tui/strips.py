"""From rows of cells to what Textual sends: runs of equal style, and only what changed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from rich.color import Color
from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip

from simmer_tui.tui.maze.glyphs import BLANK, Cells
from simmer_tui.tui.maze.palette import DEFAULT


@dataclass(frozen=True, slots=True)
class Span:
    """Cells `start` to `stop` (exclusive) of a row."""

    row: int
    start: int
    stop: int


def changed_spans(old: Cells, new: Cells, join: int | None) -> list[Span]:
    """Where two pictures of one shape differ.

    Spans of a row less than `join` cells apart become one, since moving the cursor costs bytes
    too; None makes one span a row.
    """
    changed = (
        (old.characters != new.characters)
        | (old.foreground != new.foreground)
        | (old.background != new.background)
    )
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
        Segment(text[start:stop], _style(foreground, background, default))
        for start, stop, foreground, background in _runs(cells, row)
    ]
    return Strip(segments, len(text))


def _runs(cells: Cells, row: int) -> Iterator[tuple[int, int, int, int]]:
    """(start, stop, foreground, background) of the runs that need no change of style."""
    background = cells.background[row]
    foreground = _borrowed_foreground(cells.characters[row] == BLANK, cells.foreground[row], background)
    breaks = (np.diff(foreground) != 0) | (np.diff(background) != 0)
    starts = np.concatenate(([0], np.flatnonzero(breaks) + 1))
    stops = np.concatenate((starts[1:], [len(background)]))
    yield from zip(
        starts.tolist(), stops.tolist(), foreground[starts].tolist(), background[starts].tolist(), strict=True
    )


def _borrowed_foreground(
    blank: NDArray[np.bool_], foreground: NDArray[np.int32], background: NDArray[np.int32]
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


@lru_cache(maxsize=8192)
def _style(foreground: int, background: int, default: Style) -> Style:
    if foreground == DEFAULT and background == DEFAULT:
        return default
    color = None if foreground == DEFAULT else _color(foreground)
    bgcolor = default.bgcolor if background == DEFAULT else _color(background)
    return Style(color=color, bgcolor=bgcolor)


def _color(packed: int) -> Color:
    return Color.from_rgb(packed >> 16, (packed >> 8) & 255, packed & 255)
