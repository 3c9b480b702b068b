"""Lines of text with roles, and a panel that shows them and redraws only those that changed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region, Size
from textual.strip import Strip
from textual.widget import Widget

from simmer_tui.sim.command import escape, printable
from simmer_tui.tui.selection import MarkableLines

Line = tuple[tuple[str, str], ...]
"""Pieces of one line, each (text, role); a role is one of `ROLES`."""
ROLES = (
    *("plain", "label", "value", "good", "warning", "danger", "newest", "dim", "title", "belief"),
    *("mark", "rule", "contact", "chosen", "robot", "bold"),
)
"""Besides words by their weight: `title` and `mark` stand out, `newest` was read last, `rule` is a line
or the track of a gauge, `contact` a cell that marks one, `chosen` what a person has picked."""


def text_of(line: Line) -> str:
    """The text of a line alone, with control characters escaped."""
    return "".join(printable(text) for text, _ in line)


def fault_line(error: Exception) -> Line:
    """What stands in place of something that could not be shown."""
    return ((f"cannot be shown: {type(error).__name__}: {escape(str(error), 200)}", "danger"),)


def wrapped(line: Line, width: int, indent: int) -> list[Line]:
    """A line cut into lines of at most `width` characters, all but the first indented."""
    if sum(len(text) for text, _ in line) <= width or width <= indent:
        return [line]
    lines: list[Line] = []
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


def strip_of(line: Line, styles: dict[str, Style], width: int) -> Strip:
    """A line as a Strip of exactly `width` cells. Every segment has a style."""
    segments = [Segment(printable(text), styles[role]) for text, role in line if text]
    return Strip(segments).adjust_cell_length(width, styles["plain"])


ROLE_CLASSES = {f"panel--{role}" for role in ROLES}
"""Component classes of a widget that shows lines."""


class RoleStyles:
    """The styles of a widget's roles, kept: looking them up takes longer than all else about a line."""

    def __init__(self, widget: Widget) -> None:
        self._widget = widget
        self._styles: dict[str, Style] = {}

    def forget(self) -> None:
        """The widget's styles are others."""
        self._styles = {}

    def strip(self, line: Line, width: int) -> Strip:
        """A line as the widget shows it."""
        if not self._styles:
            widget = self._widget
            styles = {role: widget.get_component_rich_style(f"panel--{role}") for role in ROLES}
            self._styles = styles | {"plain": widget.rich_style}
        return strip_of(line, self._styles, width)


def clipped(line: Line, width: int) -> Line:
    """The beginning of a line, at most `width` characters."""
    pieces: list[tuple[str, str]] = []
    for text, role in line:
        if width <= 0:
            break
        pieces.append((text[:width], role))
        width -= len(text)
    return tuple(pieces)


def shortened(line: Line, width: int) -> Line:
    """A line of at most `width` characters: one that is longer ends in an ellipsis."""
    if len(text_of(line).rstrip()) <= width:
        return clipped(line, width)
    return (*clipped(line, width - 1), ("…", "mark")) if width > 0 else ()


def between(left: Line, right: Line, width: int) -> Line:
    """Two pieces at both ends of a line; what there is no room for is left out, the right one first."""
    room = width - length(left) - length(right)
    return (*left, (" " * room, "plain"), *right) if right and room >= 1 else shortened(left, width)


def length(line: Line) -> int:
    """Characters of a line."""
    return sum(len(text) for text, _ in line)


def heading(title: str, note: str, width: int, *, plain: bool) -> Line:
    """What heads a panel: its title, a rule, and a note if there is room for it."""
    if width < len(title) + len(note) + 4:
        note = ""
    rule = width - len(title) - 1 - (len(note) + 1 if note else 0)
    line: Line = ((title, "title"), (" ", "plain"), (("-" if plain else "─") * max(rule, 0), "rule"))
    return (*line, (f" {note}", "dim")) if note else line


class LinePanel(MarkableLines):
    """Shows a list of lines, cut at its width."""

    COMPONENT_CLASSES: ClassVar[set[str]] = ROLE_CLASSES
    ALLOW_SELECT = False

    def __init__(self, *, id: str | None = None, classes: str | None = None) -> None:  # noqa: A002 - as in Textual
        self._role_styles = RoleStyles(self)
        super().__init__(id=id, classes=classes)
        self._lines: list[Line] = []

    def show(self, lines: Sequence[Line]) -> None:
        """Show these lines in place of the last; only changed ones are sent."""
        before, self._lines = self._lines, list(lines)
        if len(before) != len(self._lines) and self.styles.is_auto_height:
            self.refresh(layout=True)
            return
        rows = max(len(before), len(self._lines))
        width = self.size.width
        changed = [
            Region(0, row, width, 1)
            for row in range(min(rows, self.size.height))
            if before[row : row + 1] != self._lines[row : row + 1]
        ]
        if changed:
            self.refresh(*changed)

    def notify_style_update(self) -> None:
        self._role_styles.forget()
        super().notify_style_update()

    @property
    def lines(self) -> list[str]:
        """The texts shown."""
        return [text_of(line) for line in self._lines]

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        return len(self._lines)

    def render_line(self, y: int) -> Strip:
        line: Line = self._lines[y] if y < len(self._lines) else ()
        return self.marked(self._role_styles.strip(shortened(line, self.size.width), self.size.width), y)

    def text_rows(self) -> list[str]:
        return self.lines
