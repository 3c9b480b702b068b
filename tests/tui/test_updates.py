"""Updates of the screen: which lines of which widgets are made, and what of them is sent."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pyte
import pytest
import textual
from rich.console import Console
from rich.segment import Segment
from rich.style import Style
from textual._compositor import Compositor, LayoutUpdate
from textual.app import App, ComposeResult
from textual.containers import VerticalScroll
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from simmer_tui.tui.textual_internals import delta_updates, draw_at_once, is_known_version

WIDTH, HEIGHT = 20, 6
CONSOLE = Console(color_system="truecolor", force_terminal=True)

if not is_known_version(textual.__version__):
    pytest.skip("Textual itself writes", allow_module_level=True)


class Lines(Widget):
    """Shows one letter, in two colours, in every cell, and remembers the rows that were asked for."""

    def __init__(self, letter: str, x: int, y: int, width: int, height: int) -> None:
        super().__init__()
        self.letter = letter
        self.asked: list[range] = []
        styles = self.styles
        styles.position, styles.offset, styles.width, styles.height = "absolute", (x, y), width, height

    def render_lines(self, crop: Region) -> list[Strip]:
        self.asked.append(range(*crop.line_span))
        half, width = self.size.width // 2, self.size.width
        red, blue = Style(color="red"), Style(color="blue")
        strip = Strip([Segment(self.letter * half, red), Segment(self.letter * (width - half), blue)])
        return [strip.crop(*crop.column_span)] * crop.height


class Board(App[None]):
    """A line in two corners, and one in front of a part of the last."""

    def __init__(self) -> None:
        super().__init__()
        self.front = Lines("f", 12, 4, 4, 1)
        self.left = Lines("l", 0, 0, 8, 3)
        self.right = Lines("r", 10, 3, 10, 3)
        self.front.styles.layer = "above"

    def compose(self) -> ComposeResult:
        self.screen.styles.layers = ("default", "above")  # type: ignore[assignment]
        yield from (self.front, self.left, self.right)


class Terminal:
    """The screen of an app on an emulated terminal."""

    def __init__(self, app: Board) -> None:
        self.compositor: Compositor = app.screen._compositor
        self._screen = pyte.Screen(WIDTH, HEIGHT)
        self._stream = pyte.Stream(self._screen)

    def update(self, *regions: Region, full: bool = False) -> str:
        """Sequences of an update of some regions."""
        self.compositor._dirty_regions.update(regions)
        update: Any = self.compositor.render_update(full=full)
        sent: str = update.render_segments(CONSOLE)
        self._stream.feed(sent)
        return sent

    @property
    def rows(self) -> list[str]:
        return list(self._screen.display)


def on_board(steps: Callable[[Board, Terminal], Awaitable[None]]) -> None:
    async def run() -> None:
        app = Board()
        async with app.run_test(size=(WIDTH, HEIGHT)) as pilot:
            await pilot.pause()
            await steps(app, Terminal(app))

    with delta_updates() as written:
        assert written
        asyncio.run(run())


def test_of_a_dirty_span_only_what_differs_is_sent() -> None:
    async def steps(app: Board, terminal: Terminal) -> None:
        terminal.update(full=True)
        assert terminal.update(Region(0, 0, WIDTH, HEIGHT - 1)) == "", "all of it is there"
        app.left.letter = "M"
        assert terminal.update(Region(2, 1, 4, 1)).count("M") == 4
        assert terminal.rows[:3] == [f"{'l' * 8:20}", f"{'llMMMMll':20}", f"{'l' * 8:20}"]
        assert terminal.update(Region(0, 1, 8, 1)).count("M") == 4
        whole = LayoutUpdate([[Strip([Segment("M" * 8)])]], Region(0, 0, 8, 1))
        assert "M" * 8 in whole.render_segments(CONSOLE), "all of it, whatever stands there"

    on_board(steps)


def test_a_widget_is_shown_before_those_behind_it() -> None:
    async def steps(app: Board, terminal: Terminal) -> None:
        terminal.update(full=True)
        app.front.letter, app.right.letter = "g", "s"
        terminal.update(Region(10, 3, 10, 2), Region(0, 4, 14, 1))
        rows = [" " * 10 + 10 * "s", " " * 10 + "ssggggssss", " " * 10 + 10 * "r"]
        assert terminal.rows[3:] == rows
        assert rows[:2] == [strip.text for strip in terminal.compositor.render_strips()[3:5]]

    on_board(steps)


def test_only_lines_in_dirty_regions_are_made() -> None:
    """Two regions in corners made all lines of the whole screen."""

    async def steps(app: Board, terminal: Terminal) -> None:
        terminal.update(full=True)
        for widget in (app.left, app.right, app.front):
            widget.asked.clear()
        terminal.update(Region(1, 1, 2, 1), Region(18, 4, 1, 2))
        assert app.left.asked == [range(1, 2)]
        assert app.right.asked == [range(1, 3)]
        assert app.front.asked == []

    on_board(steps)


def test_scrollbars_are_drawn_with_the_rest() -> None:
    """They are no children of their widget, and had an update of their own after each."""

    class Scrolling(App[None]):
        def compose(self) -> ComposeResult:
            self.view = VerticalScroll(Lines("a", 0, 0, 5, 40))
            yield self.view

    async def run() -> None:
        app = Scrolling()
        async with app.run_test(size=(WIDTH, HEIGHT)) as pilot:
            await pilot.pause()
            bar = app.view.vertical_scrollbar
            bar.refresh()
            assert bar._repaint_required
            draw_at_once(app.screen)
            assert not bar._repaint_required

    asyncio.run(run())


def test_other_versions_of_textual_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(textual, "__version__", "9.0.0", raising=False)
    before = Compositor.render_partial_update
    with delta_updates() as written:
        assert not written
        assert Compositor.render_partial_update is before
