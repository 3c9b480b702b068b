"""Lines of text with roles, and a panel that shows them and redraws only changed ones."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar

from rich.cells import cell_len
from rich.segment import Segment
from rich.style import Style
from textual.events import MouseDown, MouseEvent, MouseMove, MouseUp
from textual.geometry import Offset, Region, Size
from textual.strip import Strip
from textual.widget import Widget

from simmer_tui.errors import printable
from simmer_tui.tui.strips import DirectLines

StyledLine = tuple[tuple[str, str], ...]
"""Pieces of one line, each (text, role); a role is one of `ROLES`."""
ROLES = (
    *("plain", "label", "value", "good", "warning", "danger", "newest", "dim", "title", "belief"),
    *("mark", "rule", "contact", "chosen", "robot", "bold"),
    *("driving", "sensing", "link", "black-tile", "white-tile"),
)
"""Roles for words of some weight, and others.

`title` and `mark` stand out, `newest` was read last, `rule` is a line or the track of a gauge, `contact` a
cell with a contact, `chosen` a person's choice. `driving`, `sensing` and `link` are shares of the time spent,
`black-tile` and `white-tile` the view of a line sensor.
"""


_MARKED = Style(reverse=True)
"""Style of marked text: visible without colour, too."""


def text_of(line: StyledLine) -> str:
    """Text of a line alone, with control characters escaped."""
    return "".join(printable(text) for text, _ in line)


def fault_line(error: Exception) -> StyledLine:
    """A line in place of one that could not be shown."""
    return ((f"cannot be shown: {type(error).__name__}: {error}", "danger"),)


def wrapped_lines(line: StyledLine, width: int, indent: int) -> list[StyledLine]:
    """A line cut into lines of at most `width` characters, all but the first indented."""
    if length(line) <= width or width <= indent:
        return [line]
    lines: list[StyledLine] = []
    pieces: list[tuple[str, str]] = []
    room = width
    for text, role in line:
        rest = text
        while len(rest) > room:
            cut = rest.rfind(" ", 0, room + 1)
            if cut <= 0:
                cut = room if room > (width - indent) // 2 or not pieces else 0
            pieces.append((rest[:cut], role))
            rest = rest[cut:].lstrip()
            lines.append(tuple(pieces))
            pieces, room = [(" " * indent, "plain")], width - indent
        pieces.append((rest, role))
        room -= len(rest)
    return [*lines, tuple(pieces)]


def strip_of(line: StyledLine, styles: Mapping[str, Style], width: int) -> Strip:
    """A line as a Strip of exactly `width` cells. Every segment has a style."""
    segments = [Segment(printable(text), styles[role]) for text, role in line if text]
    spare = width - sum(cell_len(segment.text) for segment in segments)
    if spare < 0:
        return Strip(segments).adjust_cell_length(width, styles["plain"])
    # One strip in place of two: making one takes longer than its content.
    return Strip([*segments, Segment(" " * spare, styles["plain"])] if spare else segments, width)


class RoleWidget(Widget):
    """Widget that shows lines. The styles of its roles are kept: looking them up takes longer than all other
    work for a line."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {f"panel--{role}" for role in ROLES}
    ALLOW_SELECT = False

    _role_styles: Mapping[str, Style] = MappingProxyType({})

    def notify_style_update(self) -> None:
        self._role_styles = {}
        super().notify_style_update()

    def strip(self, line: StyledLine, width: int) -> Strip:
        """A line as the widget shows it."""
        if not self._role_styles:
            styles = {role: self.get_component_rich_style(f"panel--{role}") for role in ROLES}
            self._role_styles = styles | {"plain": self.rich_style}
        return strip_of(line, self._role_styles, width)


def clipped(line: StyledLine, width: int) -> StyledLine:
    """Beginning of a line, at most `width` characters."""
    pieces: list[tuple[str, str]] = []
    for text, role in line:
        if width <= 0:
            break
        pieces.append((text[:width], role))
        width -= len(text)
    return tuple(pieces)


def shortened(line: StyledLine, width: int) -> StyledLine:
    """A line of at most `width` characters; a longer one ends in an ellipsis."""
    if len(text_of(line).rstrip()) <= width:
        return clipped(line, width)
    return (*clipped(line, width - 1), ("…", "mark")) if width > 0 else ()


def between(left: StyledLine, right: StyledLine, width: int) -> StyledLine:
    """Two pieces at both ends of a line. Without enough room the right one is left out first."""
    room = width - length(left) - length(right)
    return (*left, (" " * room, "plain"), *right) if right and room >= 1 else shortened(left, width)


def length(line: StyledLine) -> int:
    """Number of characters of a line."""
    return sum(len(text) for text, _ in line)


def heading(title: str, note: str, width: int, *, plain: bool) -> StyledLine:
    """Heading of a panel: its title, a rule, and a note if there is room for it."""
    if width < len(title) + len(note) + 4:
        note = ""
    rule = width - len(title) - 1 - (len(note) + 1 if note else 0)
    line: StyledLine = ((title, "title"), (" ", "plain"), (("-" if plain else "─") * max(rule, 0), "rule"))
    return (*line, (f" {note}", "dim")) if note else line


class MarkableLines(RoleWidget):
    """Panel of lines of text: dragging marks text, and releasing the button copies it.

    With Textual's own selection every cell of every line would store its place. In a panel that changes ten
    times a second this costs more than all other work.
    """

    FIXED_ROWS: ClassVar[int] = 0
    """Rows at the top that do not scroll, and cannot be marked."""

    _from: Offset | None = None
    """Beginning of the marked text: column and row."""
    _to: Offset | None = None
    _marking = False

    def text_rows(self) -> Sequence[str]:
        """Text of every row, the fixed ones first, also of rows that are scrolled out of sight."""
        raise NotImplementedError

    @property
    def marked_text(self) -> str:
        """The marked text, without blanks at the ends of rows."""
        rows, spans = self.text_rows(), self._marked_spans()
        texts = ((rows[row] if row < len(rows) else "")[span].rstrip() for row, span in spans.items())
        return "\n".join(texts)

    def marked(self, strip: Strip, y: int) -> Strip:
        """A strip as drawn, row `y` of the panel, with its marked part reversed."""
        spans = self._marked_spans()
        span = spans.get(y + self.scroll_offset.y) if spans else None
        if span is None:
            return strip
        start, stop, _ = span.indices(strip.cell_length)
        if start >= stop:
            return strip
        inside = strip.crop(start, stop)
        shown = [Segment(text, (style or Style()) + _MARKED, control) for text, style, control in inside]
        marked = Strip(shown, inside.cell_length)
        return Strip.join([strip.crop(0, start), marked, strip.crop(stop, strip.cell_length)])

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

    def _marked_spans(self) -> dict[int, slice]:
        """Columns of the marked text by row, in reading order; empty if nothing is marked."""
        if self._from is None or self._to is None or self._from == self._to:
            return {}
        first, last = sorted((self._from, self._to), key=lambda place: (place.y, place.x))
        spans = dict.fromkeys(range(first.y, last.y + 1), slice(None))
        spans[last.y] = slice(0, last.x + 1)
        spans[first.y] = slice(first.x, spans[first.y].stop)
        return spans


class LinePanel(MarkableLines, DirectLines):
    """Shows a list of lines, cut at its width."""

    def __init__(self, *, id: str | None = None, classes: str | None = None) -> None:  # noqa: A002 - as in Textual
        super().__init__(id=id, classes=classes)
        self._lines: list[StyledLine] = []
        # Textual asks for more rows than those that changed.
        self._drawn: dict[int, tuple[StyledLine, Strip]] = {}

    def notify_style_update(self) -> None:
        self._drawn = {}
        super().notify_style_update()

    def show(self, lines: Sequence[StyledLine]) -> None:
        """Show these lines in place of the last; only changed ones are sent."""
        before, self._lines = self._lines, list(lines)
        if len(before) != len(self._lines) and self.styles.is_auto_height:
            self.refresh(layout=True)
            return
        if before == self._lines:
            return
        rows, size = max(len(before), len(self._lines)), self.size
        changed = [
            Region(0, row, size.width, 1)
            for row in range(min(rows, size.height))
            if before[row : row + 1] != self._lines[row : row + 1]
        ]
        if changed:
            self.refresh(*changed)

    @property
    def lines(self) -> list[str]:
        """Texts of the lines shown."""
        return [text_of(line) for line in self._lines]

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        return len(self._lines)

    def render_line(self, y: int) -> Strip:
        line: StyledLine = self._lines[y] if y < len(self._lines) else ()
        width = self.size.width
        shown, strip = self._drawn.get(y, (None, None))
        if strip is None or shown != line or strip.cell_length != width:
            strip = self.strip(shortened(line, width), width)
            self._drawn[y] = line, strip
        return self.marked(strip, y)

    def text_rows(self) -> list[str]:
        return self.lines
