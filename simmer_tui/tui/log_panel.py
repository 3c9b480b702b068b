"""List of events: one line for each important one, readings in between folded, with a filter."""

from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from typing import ClassVar

from textual.binding import BindingType
from textual.events import Blur, Click, Focus, Key
from textual.geometry import Size
from textual.scroll_view import ScrollView
from textual.strip import Strip

from simmer_tui.live.snapshot import EVENTS, LogEntry
from simmer_tui.tui import line_panel
from simmer_tui.tui.event_text import entry_line, event_words, kept_lines
from simmer_tui.tui.key_table import IN_LOG, bindings_of
from simmer_tui.tui.line_panel import MarkableLines, StyledLine, text_of
from simmer_tui.tui.textual_internals import StillWhenClamped, set_virtual_size

_INDENT = 18
"""Columns before the continuation of a line: it begins below the result of its command."""
_ACTIONS = {key: action for group in IN_LOG for key, action in group.actions.items()}
"""Action of each key on the list."""
# The heading does not scroll with the rows below it.
_HEADING = 1
_HINTS = "/ filters   Enter unfolds"


class LogPanel(StillWhenClamped, ScrollView, MarkableLines, can_focus=True):
    """Shows entries, newest last, and stays at the end unless scrolled away from it.

    An entry has one row. Enter, or a click, unfolds it: its readings, or the rest of a line that is too long.
    """

    # Textual looks for them only in the first of the base classes.
    COMPONENT_CLASSES: ClassVar[set[str]] = MarkableLines.COMPONENT_CLASSES
    FIXED_ROWS = _HEADING
    BINDINGS: ClassVar[list[BindingType]] = bindings_of(IN_LOG)
    DEFAULT_CSS = """
    LogPanel { overflow-x: hidden; scrollbar-gutter: stable; scrollbar-size: 1 1; }
    """

    def __init__(self, *, plain: bool = False) -> None:
        super().__init__(id="events")
        self._plain = plain
        self.entries: deque[LogEntry] = deque(maxlen=EVENTS)
        """Entries kept, oldest first."""
        self._rows: list[tuple[LogEntry, StyledLine | None]] = []
        """An entry itself, or a line of what is folded into it."""
        self._unfolded: set[int] = set()
        self._cursor: int | None = None
        self._typing = False
        self._at_end = True
        self._total = 0
        self.filter = ""
        """Text that an entry must have in its line, or as its source, to be shown; empty for all."""
        self._before_events = ""

    # -- what is shown ---------------------------------------------------------------------------

    def add(self, entries: Sequence[LogEntry], *, total: int = 0, is_full: bool = False) -> None:
        """Append entries; the first may be the last one grown. The oldest give way.

        Args:
            total: number of all entries so far.
            is_full: true if they replace all others.
        """
        if is_full:
            self.entries.clear()
            self._rows.clear()
        elif not entries and total == self._total:
            return
        self._total = total
        top = self._top_number()
        if entries and self.entries and self.entries[-1].first == entries[0].first != 0:
            grown = self.entries.pop()
            while self._rows and self._rows[-1][0] is grown:
                self._rows.pop()
        # A replay that has jumped brings more than the list holds.
        new = entries[-EVENTS:]
        self.entries.extend(new)
        self._rows += [row for entry in new for row in self._rows_of(entry)]
        self._drop_rows()
        self._lay_out(top)

    def show_before_events(self, text: str) -> None:
        """Show a text while there are no entries."""
        if text != self._before_events:
            self._before_events = text
            self.refresh()

    @property
    def text(self) -> str:
        """Text of all kept entries that pass the filter; folded readings are indented."""
        lines: list[str] = []
        for entry in self.entries:
            if self._passes(entry):
                lines.append(text_of(_line_of(entry)).rstrip())
                lines += [f"  {text_of(line).rstrip()}" for line in kept_lines(entry) if entry.folds]
        return "".join(f"{line}\n" for line in lines)

    def show_only(self, text: str) -> None:
        """Show the entries that pass a filter, or all for an empty text."""
        self.filter = text
        self._at_end = True
        self._rebuild()

    # -- what people do --------------------------------------------------------------------------

    def action_filter(self) -> None:
        """Use typed text as the filter from now on, until Enter or Escape."""
        self._typing = True
        self.refresh()

    async def take_key(self, event: Key) -> bool:
        """Do a key's action completely before this returns; False if it has none here."""
        if not self._typing:
            action = _ACTIONS.get(event.key)
            return action is not None and await self.app.run_action(action, self)
        match event.key:
            case "enter" | "tab":
                self._typing = False
                self.refresh()
            case "escape":
                self._typing = False
                self.show_only("")
            case "backspace":
                self.show_only(self.filter[:-1])
            case _ if event.is_printable and event.character:
                self.show_only(self.filter + event.character)
            case _:
                return False
        return True

    async def on_key(self, event: Key) -> None:
        """Ignore all other keys while a filter is typed."""
        if self._typing:
            await self.take_key(event)
            event.stop()
            event.prevent_default()

    def action_unfold(self) -> None:
        """Unfold the entry at the cursor, or the last one that folds; or fold it again."""
        place = self._cursor_row()
        if self._cursor is None:
            folding = [row for row, (entry, line) in enumerate(self._rows) if line is None and entry.folds]
            place = folding[-1] if folding else place
        if 0 <= place < len(self._rows):
            self._toggle(self._rows[place][0])

    def action_step(self, rows: int) -> None:
        """Move the cursor."""
        place = self._cursor_row() + (rows if self._cursor is not None else 0)
        if not self._rows:
            return
        place = min(max(place, 0), len(self._rows) - 1)
        self._cursor = place
        first = round(self.scroll_y)
        shown = self._visible
        if place < first or place >= first + shown:
            self.scroll_to(y=place if place < first else place - shown + 1, animate=False, force=True)
        self._at_end = place == len(self._rows) - 1
        self.refresh()

    def action_scroll_end(self) -> None:
        self._cursor = None
        self._at_end = True
        self._lay_out(0)

    def on_click(self, event: Click) -> None:
        row = self.scroll_offset.y + event.y - _HEADING
        if not self.marked_text and event.y >= _HEADING and 0 <= row < len(self._rows):
            self._toggle(self._rows[row][0])

    def on_focus(self, _event: Focus) -> None:
        self.refresh()

    def on_blur(self, _event: Blur) -> None:
        self._typing, self._cursor = False, None
        self.refresh()

    def _toggle(self, entry: LogEntry) -> None:
        self._unfolded ^= {entry.first or entry.number}
        self._rebuild()

    # -- rows ------------------------------------------------------------------------------------

    @property
    def _visible(self) -> int:
        return max(self.scrollable_content_region.height - _HEADING, 1)

    def _cursor_row(self) -> int:
        last = len(self._rows) - 1
        return last if self._cursor is None else min(self._cursor, last)

    def _passes(self, entry: LogEntry) -> bool:
        wanted = self.filter.lower()
        if not wanted or wanted == event_words(entry).source:
            return True
        lines = [_line_of(entry), *(kept_lines(entry) if entry.folds else ())]
        return any(wanted in text_of(line).lower() for line in lines)

    def _rows_of(self, entry: LogEntry) -> list[tuple[LogEntry, StyledLine | None]]:
        if self.filter and not self._passes(entry):
            return []
        rows: list[tuple[LogEntry, StyledLine | None]] = [(entry, None)]
        if (entry.first or entry.number) not in self._unfolded:
            return rows
        if entry.folds:
            return rows + [(entry, line) for line in kept_lines(entry)]
        width = max(self.scrollable_content_region.width - 1, 1)
        return rows + [
            (entry, line) for line in line_panel.wrapped_lines(_line_of(entry), width, _INDENT)[1:]
        ]

    def _drop_rows(self) -> None:
        """Drop the rows of entries that are no longer kept."""
        first = self.entries[0].number if self.entries else 0
        gone = bisect_left(self._rows, first, key=lambda row: row[0].number)
        del self._rows[:gone]
        if self._cursor is not None:
            self._cursor = max(self._cursor - gone, 0)

    def _rebuild(self) -> None:
        """Make all rows again."""
        top = self._top_number()
        self._rows = [row for entry in self.entries for row in self._rows_of(entry)]
        self._lay_out(top)

    def _top_number(self) -> int:
        """Number of the entry in the first visible row."""
        row = self.scroll_offset.y
        return self._rows[row][0].number if row < len(self._rows) else 0

    def _lay_out(self, top: int) -> None:
        """Show the end, or keep the entry with number `top` at its place."""
        width = self.scrollable_content_region.width
        if not width:  # not on the screen yet
            return
        placing, self.placing = self.placing, True
        size = Size(width, len(self._rows) + _HEADING)
        # Its setter would lay out the whole screen again, twice a second.
        if size != self.virtual_size:
            set_virtual_size(self, size)
        end = max(len(self._rows) - self._visible, 0)
        place = end
        if not self._at_end:
            place = min(bisect_left(self._rows, top, key=lambda row: row[0].number), end)
        self.scroll_to(y=place, animate=False, force=True)
        self.placing = placing
        self.refresh()

    def on_resize(self) -> None:
        if self._unfolded:
            self._rebuild()
        self._lay_out(self._top_number())

    def watch_scroll_y(self, old_value: float, new_value: float) -> None:
        super().watch_scroll_y(old_value, new_value)
        # Only a person scrolls away from the end; Textual clamps after a change of size.
        if not self.placing:
            self._at_end = round(new_value) >= self.max_scroll_y

    def watch_show_vertical_scrollbar(self, shown: bool) -> None:
        """Set the position of a scrollbar that appeared after it."""
        if shown:
            self.vertical_scrollbar.position = self.scroll_y

    # -- drawing ---------------------------------------------------------------------------------

    def render_line(self, y: int) -> Strip:
        width = self.scrollable_content_region.width
        if y < _HEADING:
            return self.strip(((" ", "plain"), *self._heading(width - 1)), width)
        line = self._line_at(self.scroll_offset.y + y - _HEADING, width)
        return self.marked(self.strip(line, width), y)

    def text_rows(self) -> list[str]:
        width = self.scrollable_content_region.width
        return [""] * _HEADING + [text_of(self._line_at(row, width)) for row in range(len(self._rows))]

    def _line_at(self, row: int, width: int) -> StyledLine:
        """A row as it is shown."""
        if row >= len(self._rows):
            return () if row or self._total else ((f" {self._before_events}", "dim"),)
        entry, folded = self._rows[row]
        mark = ">" if self.has_focus and row == self._cursor else " "
        if folded is not None:
            return ((f"{mark}  ", "newest"), *folded)
        line = _line_of(entry)
        if entry.folds:
            sign = "-" if (entry.first or entry.number) in self._unfolded else "+"
            line = (*line, (f"  {sign}", "mark"))
        else:
            line = line_panel.shortened(line, width - 1)
        return ((mark, "newest"), *line)

    def _heading(self, width: int) -> StyledLine:
        if self._typing or self.filter:
            note = f"/{self.filter}{'_' if self._typing else ''}   Esc shows all"
        else:
            note = f"{self._total}   {_HINTS}" if self._total else ""
        return line_panel.heading("events", note, width, plain=self._plain)


def _line_of(entry: LogEntry) -> StyledLine:
    try:
        return entry_line(entry)
    except Exception as error:  # noqa: BLE001 - an entry that cannot be shown must not end the run
        return line_panel.fault_line(error)
