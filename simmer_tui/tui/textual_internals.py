"""All uses of Textual's private parts, and the only ones.

Each function says what it replaces. `KNOWN_VERSION` is the minor version of Textual that they were written
for. With any other, replacements are left out and questions have a fallback.

Updates: Textual sends every dirty span from its widget's left edge on, each piece with its whole style and a
reset after it. Here a `DeltaWriter` sends the cells that differ from those on the screen. Over a slow SSH
connection that saves two thirds of the bytes. The spans can go once Textual crops both ends itself
(Textualize/textual#5625), the styles cannot.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import textual
from rich.color import ColorSystem
from rich.console import Console
from textual._compositor import ChopsUpdate, LayoutUpdate
from textual.app import App
from textual.geometry import Size
from textual.message import Message
from textual.screen import Screen
from textual.scroll_view import ScrollView
from textual.strip import Strip

from simmer_tui.tui.delta_writer import DeltaWriter

# pyproject.toml pins it; a newer one needs a review of each function here.
KNOWN_VERSION = "8.2."


def is_known_version(version: str = textual.__version__) -> bool:
    return version.startswith(KNOWN_VERSION)


# -- updates ---------------------------------------------------------------------------------------


@contextmanager
def delta_updates() -> Iterator[bool]:
    """Write updates of the screen as deltas inside the `with` block. Yields True if they are."""
    if not is_known_version(textual.__version__):
        yield False
        return
    originals = ChopsUpdate.render_segments, LayoutUpdate.render_segments
    writer = DeltaWriter()

    def render_spans(self: ChopsUpdate, console: Console) -> str:
        writer.begin(self.chop_ends[0][-1], len(self.chop_ends), _colors_of(console))
        for y, start, stop in self.spans:
            # Textual keeps a line as pieces that end at the next widget.
            for end, (left, strip) in zip(self.chop_ends[y], self.chops[y].items(), strict=False):
                first, last = max(left, start), min(end, stop)
                if strip is not None and first < last:
                    writer.write(y, left, strip, first, last)
        return writer.end()

    def render_whole(self: LayoutUpdate, console: Console) -> str:
        region = self.region
        # Textual calls it only when it does not know the terminal's content.
        writer.begin(region.right, region.bottom, _colors_of(console), is_full=True)
        for y, strips in enumerate(self.strips, region.y):
            x = region.x
            for strip in strips:
                writer.write(y, x, strip)
                x += strip.cell_length
        return writer.end()

    ChopsUpdate.render_segments = render_spans  # type: ignore[method-assign]
    LayoutUpdate.render_segments = render_whole  # type: ignore[method-assign]
    try:
        yield True
    finally:
        ChopsUpdate.render_segments, LayoutUpdate.render_segments = originals  # type: ignore[method-assign]


def _colors_of(console: Console) -> ColorSystem:
    return console._color_system or ColorSystem.TRUECOLOR


def draw_at_once(screen: Screen[Any]) -> None:
    """Send all changes of a screen in one update, now.

    Textual would have each widget send the screen a message, and may send an update between two of them. One
    part of the screen would then show another moment than the next.
    """
    # By the default argument: Textual reads its version from a file at every call.
    if not is_known_version() or not screen.is_attached:
        return
    for widget in screen.children:
        if widget._repaint_required and widget.display:
            widget._repaint_required = False
            screen._dirty_widgets.add(widget)
    screen._on_timer_update()


# -- what is asked ---------------------------------------------------------------------------------


def writes_waiting(app: App[Any]) -> int:
    """Number of pending writes to the terminal. The queue is the driver's own; a driver without one never
    blocks."""
    writer = getattr(app._driver, "_writer_thread", None)
    queue = getattr(writer, "_queue", None)
    return 0 if queue is None else int(queue.qsize())


def age_of(event: Message) -> float:
    """Real seconds since an event was made; for a key, since it was read from the terminal."""
    # By the clock of Textual's events, which is not the same on every system.
    return Message().time - event.time


def rows_of(screen: Screen[Any]) -> list[Strip]:
    """Present content of a screen, row by row."""
    return screen._compositor.render_strips()


# -- what is done ----------------------------------------------------------------------------------


def forget_traceback(app: App[Any]) -> None:
    """Print nothing after the app has ended by a fault; its caller reports it."""
    # Textual would print them with the traceback when its screen is closed.
    app._exit_renderables.clear()


def write_sequence(app: App[Any], sequence: str) -> None:
    """Send a control sequence of our own to the terminal, between Textual's own."""
    if app._driver is not None:
        app._driver.write(sequence)


def set_virtual_size(view: ScrollView, size: Size) -> None:
    """Set the size that a view scrolls over, without the layout of the whole screen that the usual setter
    causes."""
    view.set_reactive(ScrollView.virtual_size, size)
    view._scroll_update(size)


class FaultReporting:
    """Mixin for an app with a method for exceptions that Textual cannot continue from."""

    def fault_met(self, error: Exception) -> None:
        """Called after Textual has stored it."""

    def _handle_exception(self, error: Exception) -> None:
        super()._handle_exception(error)  # type: ignore[misc]
        self.fault_met(error)


class StillWhenClamped:
    """Mixin for a view that must know when Textual itself, not its user, changes its scroll position."""

    placing = False
    """True while Textual, not the user, scrolls."""

    def _scroll_update(self, virtual_size: Size) -> None:
        placing, self.placing = self.placing, True
        super()._scroll_update(virtual_size)  # type: ignore[misc]
        self.placing = placing
