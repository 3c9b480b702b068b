"""The log: every command and what became of it, bounded, with a filter by source."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.geometry import Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip

from simmer_tui.snapshot import EVENTS, LogEntry
from simmer_tui.tui.lines import ROLES, Line, role_styles, strip_of, text_of, wrapped
from simmer_tui.tui.readouts import entry_line, entry_source

_INDENT = 18
"""Where a line that did not fit goes on: under the command."""


class LogPanel(ScrollView, can_focus=True):
    """Shows log entries, newest last, and stays at the end unless scrolled away from it."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {f"panel--{role}" for role in ROLES}
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f", "filter", "Filter"),
        Binding("c", "app.copy_log", "Copy"),
        Binding("end", "scroll_end", "Newest", show=False),
    ]
    ALLOW_SELECT = False

    class Filtered(Message):
        """Another source is shown."""

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - as in Textual
        super().__init__(id=id)
        self._entries: deque[tuple[str, Line]] = deque(maxlen=EVENTS)
        self._shown: list[Line] = []
        self._columns = 0
        self.source = ""
        """The only source shown; empty for all."""

    def add(self, entries: Iterable[LogEntry]) -> None:
        """Append entries; the oldest give way."""
        fresh = [(entry_source(entry), entry_line(entry)) for entry in entries]
        if not fresh:
            return
        at_end = self.is_vertical_scroll_end
        self._entries.extend(fresh)
        for source, line in fresh:
            if self._passes(source):
                self._shown += wrapped(line, self._columns, _INDENT)
        del self._shown[:-EVENTS]
        self._lay_out(at_end)

    def on_resize(self) -> None:
        if self._columns != self.scrollable_content_region.width:
            self._columns = self.scrollable_content_region.width
            self._wrap_all()

    @property
    def sources(self) -> list[str]:
        """The sources there are, in the order they came up."""
        return list(dict.fromkeys(source for source, _ in self._entries))

    def show_only(self, source: str) -> None:
        """Show one source's entries, or all for an empty text."""
        self.source = source
        self._wrap_all()
        self.border_title = f"Log: {source}" if source else "Log"
        self.post_message(self.Filtered())

    def action_filter(self) -> None:
        """Go on to the next source."""
        choices = ["", *self.sources]
        place = choices.index(self.source) if self.source in choices else 0
        self.show_only(choices[(place + 1) % len(choices)])

    @property
    def text(self) -> str:
        """What is shown, as text."""
        shown = [line for source, line in self._entries if self._passes(source)]
        return "".join(f"{text_of(line).rstrip()}\n" for line in shown)

    def _passes(self, source: str) -> bool:
        return not self.source or source == self.source

    def _wrap_all(self) -> None:
        """Lay the entries out anew, for another width or another source."""
        self._shown = []
        for source, line in self._entries:
            if self._passes(source):
                self._shown += wrapped(line, self._columns, _INDENT)
        del self._shown[:-EVENTS]
        self._lay_out(True)

    def _lay_out(self, to_end: bool) -> None:
        self.virtual_size = Size(self._columns, len(self._shown))
        if to_end:
            self.scroll_end(animate=False, immediate=True)
        self.refresh()

    def render_line(self, y: int) -> Strip:
        row = self.scroll_offset.y + y
        line: Line = self._shown[row] if 0 <= row < len(self._shown) else ()
        return strip_of(line, role_styles(self), self.scrollable_content_region.width)
