"""Text of a panel that is marked with the mouse, and copied."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.events import MouseDown, MouseEvent, MouseMove, MouseUp
from textual.geometry import Offset
from textual.strip import Strip
from textual.widget import Widget

_MARKED = Style(reverse=True)
"""Seen without colour, too."""


class MarkableLines(Widget):
    """A panel that draws lines of text, in which dragging marks text; let go, it is copied.

    Textual's own selection would have every cell of every line carry its place, which costs a panel
    that changes ten times a second more than all else.
    """

    FIXED_ROWS: ClassVar[int] = 0
    """Rows at the top that do not scroll, and are not marked."""

    _from: Offset | None = None
    """Where marking began: column and row of the text."""
    _to: Offset | None = None
    _marking = False

    def text_rows(self) -> Sequence[str]:
        """The text of every row, the fixed ones first, also of those that are scrolled out of sight."""
        raise NotImplementedError

    @property
    def marked_text(self) -> str:
        """The text that is marked, without blanks at the ends of rows."""
        rows = self.text_rows()
        found = []
        for row in self._marked_rows():
            start, stop = self._span(row)
            found.append((rows[row] if row < len(rows) else "")[start:stop].rstrip())
        return "\n".join(found)

    def marked(self, strip: Strip, y: int) -> Strip:
        """A strip as drawn, row `y` of the panel, with what is marked in it to be seen."""
        row = y + self.scroll_offset.y
        if row not in self._marked_rows():
            return strip
        start, stop = self._span(row)
        stop = strip.cell_length if stop is None else min(stop, strip.cell_length)
        if start >= stop:
            return strip
        before, inside, after = (
            strip.crop(0, start),
            strip.crop(start, stop),
            strip.crop(stop, strip.cell_length),
        )
        shown = [Segment(text, (style or Style()) + _MARKED, control) for text, style, control in inside]
        return Strip.join([before, Strip(shown, inside.cell_length), after])

    def on_mouse_down(self, event: MouseDown) -> None:
        if event.button == 1:
            self._from = self._place(event)
            self._to = None
            self._marking = True
            self.capture_mouse()
            self.refresh()

    def on_mouse_move(self, event: MouseMove) -> None:
        if self._marking:
            self._to = self._place(event)
            self.refresh()

    def on_mouse_up(self, event: MouseUp) -> None:
        if not self._marking:
            return
        self._marking = False
        self.release_mouse()
        if self.marked_text:
            self.app.copy_to_clipboard(self.marked_text)

    def _place(self, event: MouseEvent) -> Offset:
        x, y = event.get_content_offset_capture(self)
        return Offset(max(x, 0), max(min(y, self.size.height - 1), self.FIXED_ROWS) + self.scroll_offset.y)

    def _ends(self) -> tuple[Offset, Offset] | None:
        """Where the marked text begins and ends, in reading order; None if nothing is marked."""
        if self._from is None or self._to is None or self._from == self._to:
            return None
        first, last = sorted((self._from, self._to), key=lambda place: (place.y, place.x))
        return first, last

    def _marked_rows(self) -> range:
        ends = self._ends()
        return range(ends[0].y, ends[1].y + 1) if ends else range(0)

    def _span(self, row: int) -> tuple[int, int | None]:
        """The columns marked in a row; None for up to the end."""
        ends = self._ends()
        assert ends is not None  # asked for marked rows only
        first, last = ends
        return first.x if row == first.y else 0, last.x + 1 if row == last.y else None
