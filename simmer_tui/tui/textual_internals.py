"""All that reaches into Textual's private parts, and nothing else does.

Each function says what it stands in for. `KNOWN_VERSION` is the minor version of Textual that they were
written against; with any other, what replaces something is left out and what only asks falls back.

Dirty spans: when part of a widget is dirty, `ChopsUpdate.render_segments` sends the line from the
widget's left edge to the right end of the dirty span; here it starts at the left end of the span.
A robot that moves at the right of a maze makes Textual resend most of the line; over a slow SSH
connection half of the bytes of a frame are such repetition. It can go once Textual crops both ends
itself (Textualize/textual#5625). A span may begin in the middle of a wide character only if a
widget asks for it; the maze view draws none.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import textual
from rich.console import Console
from textual._compositor import ChopsUpdate
from textual.app import App
from textual.geometry import Size
from textual.screen import Screen
from textual.scroll_view import ScrollView
from textual.strip import Strip

# pyproject.toml pins it; a newer one needs a look at each function here.
KNOWN_VERSION = "8.2."


def is_known_version(version: str = textual.__version__) -> bool:
    return version.startswith(KNOWN_VERSION)


# -- dirty spans -----------------------------------------------------------------------------------


@contextmanager
def cropped_dirty_spans() -> Iterator[bool]:
    """While this lasts, dirty spans are cropped on both sides. Gives true if they are."""
    if not is_known_version(textual.__version__):
        yield False
        return
    original = ChopsUpdate.render_segments
    ChopsUpdate.render_segments = _render_cropped  # type: ignore[method-assign]
    try:
        yield True
    finally:
        ChopsUpdate.render_segments = original  # type: ignore[method-assign]


def spans_are_cropped() -> bool:
    return ChopsUpdate.render_segments is _render_cropped


def _render_cropped(self: ChopsUpdate, console: Console) -> str:
    """Terminal sequences of the dirty spans, and of nothing beside them."""
    sequences: list[str] = []
    for y, start, stop in self.spans:
        # Textual keeps a line as pieces that end where another widget begins.
        for end, (left, strip) in zip(self.chop_ends[y], self.chops[y].items(), strict=False):
            first, last = max(left, start), min(end, stop)
            if strip is None or first >= last:
                continue
            sequences.append(f"\x1b[{y + 1};{first + 1}H")
            sequences.append(strip.crop(first - left, last - left).render(console))
    return "".join(sequences)


# -- what is asked ---------------------------------------------------------------------------------


def writes_waiting(app: App[Any]) -> int:
    """Number of writes that the terminal has not taken. The queue is the driver's own; a driver
    without one never blocks."""
    writer = getattr(app._driver, "_writer_thread", None)
    queue = getattr(writer, "_queue", None)
    return 0 if queue is None else int(queue.qsize())


def rows_of(screen: Screen[Any]) -> list[Strip]:
    """Content of a screen now, row by row."""
    return screen._compositor.render_strips()


# -- what is done ----------------------------------------------------------------------------------


def forget_traceback(app: App[Any]) -> None:
    """Have nothing printed after the app has ended by a fault; whoever runs it tells of it."""
    # Textual would print them, traceback and all, once its screen has gone.
    app._exit_renderables.clear()


def write_sequence(app: App[Any], sequence: str) -> None:
    """Send a control sequence of our own to the terminal, between what Textual sends."""
    if app._driver is not None:
        app._driver.write(sequence)


def set_virtual_size(view: ScrollView, size: Size) -> None:
    """Another size of what a view scrolls over, without the layout of the whole screen that setting
    it would ask for."""
    view.set_reactive(ScrollView.virtual_size, size)
    view._scroll_update(size)


class FaultTold:
    """Mixin for an app that is told of an exception that Textual cannot go on from."""

    def fault_met(self, error: Exception) -> None:
        """Called after Textual has taken note of it."""

    def _handle_exception(self, error: Exception) -> None:
        super()._handle_exception(error)  # type: ignore[misc]
        self.fault_met(error)


class StillWhenClamped:
    """Mixin for a view that is told when Textual itself, not its user, changes where it scrolls to."""

    placing = False
    """True while Textual, not the user, scrolls."""

    def _scroll_update(self, virtual_size: Size) -> None:
        placing, self.placing = self.placing, True
        super()._scroll_update(virtual_size)  # type: ignore[misc]
        self.placing = placing
