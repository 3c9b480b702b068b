"""The log: every command and what became of it, bounded, with a filter by source."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Iterable, Sequence
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.geometry import Size
from textual.scroll_view import ScrollView
from textual.strip import Strip

from simmer_tui.snapshot import EVENTS, LogEntry
from simmer_tui.tui.line_panel import ROLE_CLASSES, Line, RoleStyles, fault_line, text_of, wrapped
from simmer_tui.tui.readouts import entry_line, entry_source
from simmer_tui.tui.selection import MarkableLines

_INDENT = 18
"""Where a line that did not fit goes on: under the command."""


class LogPanel(ScrollView, MarkableLines, can_focus=True):
    """Shows log entries, newest last, and stays at the end unless scrolled away from it."""

    COMPONENT_CLASSES: ClassVar[set[str]] = ROLE_CLASSES
    ALLOW_SELECT = False
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f", "filter", "Filter"),
        Binding("c", "app.copy_log", "Copy"),
        Binding("end", "scroll_end", "Newest", show=False),
    ]
    DEFAULT_CSS = """
    LogPanel { overflow-x: hidden; scrollbar-gutter: stable; scrollbar-size: 1 1; }
    """

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - as in Textual
        self._role_styles = RoleStyles(self)
        super().__init__(id=id)
        self._entries: deque[tuple[int, str, Line]] = deque(maxlen=EVENTS)
        self._rows: list[Line] = []
        self._numbers: list[int] = []
        """For each row the number of its entry."""
        self._columns = 0
        self._at_end = True
        self._placing = False
        self.source = ""
        """The only source shown; empty for all."""

    def add(self, entries: Sequence[LogEntry]) -> None:
        """Append entries; the oldest give way."""
        lines = ((entry, _line_of(entry)) for entry in entries[-EVENTS:])
        fresh = [(entry.number, entry_source(entry), line) for entry, line in lines if line is not None]
        if not fresh:
            return
        self._entries.extend(fresh)
        if self._columns == 0:  # not on the screen yet
            return
        top = self._top_number()
        self._append_rows(fresh)
        self._drop_rows()
        self._lay_out(top)

    def on_resize(self) -> None:
        if self._columns != self.scrollable_content_region.width:
            self._columns = self.scrollable_content_region.width
            self._wrap_all()
        else:
            self._lay_out(self._top_number())

    def watch_scroll_y(self, old_value: float, new_value: float) -> None:
        super().watch_scroll_y(old_value, new_value)
        if not self._placing:
            self._at_end = round(new_value) >= self.max_scroll_y

    def _scroll_update(self, virtual_size: Size) -> None:
        # Textual clamps the scroll position here; that is no wish of the user's.
        placing, self._placing = self._placing, True
        super()._scroll_update(virtual_size)
        self._placing = placing

    def watch_show_vertical_scrollbar(self, shown: bool) -> None:
        """It came too late to hear of the position."""
        if shown:
            self.vertical_scrollbar.position = self.scroll_y

    def notify_style_update(self) -> None:
        self._role_styles.forget()
        super().notify_style_update()

    @property
    def sources(self) -> list[str]:
        """The sources there are, in the order they came up."""
        return list(dict.fromkeys(source for _, source, _ in self._entries))

    def show_only(self, source: str) -> None:
        """Show one source's entries, or all for an empty text."""
        self.source = source
        self._at_end = True
        self._wrap_all()
        self.border_title = f"Log: {source}" if source else "Log"

    def action_filter(self) -> None:
        """Go on to the next source."""
        choices = ["", *self.sources]
        place = choices.index(self.source) if self.source in choices else 0
        self.show_only(choices[(place + 1) % len(choices)])

    @property
    def text(self) -> str:
        """What is shown, as text."""
        shown = [line for _, source, line in self._entries if self._passes(source)]
        return "".join(f"{text_of(line).rstrip()}\n" for line in shown)

    def _passes(self, source: str) -> bool:
        return not self.source or source == self.source

    def _append_rows(self, entries: Iterable[tuple[int, str, Line]]) -> None:
        for number, source, line in entries:
            if self._passes(source):
                rows = wrapped(line, self._columns, _INDENT)
                self._rows += rows
                self._numbers += [number] * len(rows)

    def _drop_rows(self) -> None:
        """Forget the rows of entries that have given way."""
        first = self._entries[0][0] if self._entries else 0
        gone = bisect_left(self._numbers, first)
        del self._rows[:gone], self._numbers[:gone]

    def _wrap_all(self) -> None:
        """Lay the entries out anew, for another width or another source."""
        top = self._top_number()
        self._rows, self._numbers = [], []
        self._append_rows(self._entries)
        self._lay_out(top)

    def _top_number(self) -> int:
        """The number of the entry at the top of what is seen."""
        row = self.scroll_offset.y
        return self._numbers[row] if row < len(self._numbers) else 0

    def _lay_out(self, top: int) -> None:
        """Show the end, or keep the entry with number `top` where it is."""
        placing, self._placing = self._placing, True
        size = Size(self._columns, len(self._rows))
        if size != self.virtual_size:  # without a layout of the whole screen, as setting it would ask for
            self.set_reactive(LogPanel.virtual_size, size)
            self._scroll_update(size)
        end = max(len(self._rows) - self.scrollable_content_region.height, 0)
        self.scroll_to(
            y=end if self._at_end else min(bisect_left(self._numbers, top), end), animate=False, force=True
        )
        self._placing = placing
        self.refresh()

    def render_line(self, y: int) -> Strip:
        row = self.scroll_offset.y + y
        line: Line = self._rows[row] if 0 <= row < len(self._rows) else ()
        return self.marked(self._role_styles.strip(line, self.scrollable_content_region.width), y)

    def text_rows(self) -> list[str]:
        return [text_of(line) for line in self._rows]


def _line_of(entry: LogEntry) -> Line | None:
    try:
        return entry_line(entry)
    except Exception as error:  # noqa: BLE001 - an entry that cannot be shown must not end the run
        return fault_line(error)
