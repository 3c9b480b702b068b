"""The mouse: marking text copies it; on the maze the wheel zooms, dragging looks elsewhere, a click tells."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from textual.events import MouseDown, MouseEvent, MouseMove, MouseScrollDown, MouseScrollUp, MouseUp
from textual.widget import Widget

from simmer_tui.sim.specs import BLOCK, START, WALL
from simmer_tui.tui.log_panel import LogPanel
from tests.tui.conftest import KEYS

Fly = Callable[..., int | None]
Cockpit = Any


class Mouse:
    """A mouse as the terminal reports it, at places of a widget's content."""

    def __init__(self, cockpit: Cockpit, widget: Widget) -> None:
        self._cockpit = cockpit
        self._widget = widget
        self._last = (0, 0)

    async def do(self, kind: type[MouseEvent], x: int, y: int, button: int = 0) -> None:
        region = self._widget.content_region
        place = region.x + x, region.y + y
        moved = place[0] - self._last[0], place[1] - self._last[1]
        self._last = place
        app = self._cockpit.app
        event = kind(None, *place, *moved, button, False, False, False, screen_x=place[0], screen_y=place[1])
        app.post_message(event)
        await self._cockpit.pilot.pause()

    async def drag(self, *places: tuple[int, int]) -> None:
        await self.do(MouseDown, *places[0], button=1)
        for place in places[1:]:
            await self.do(MouseMove, *place, button=1)
        await self.do(MouseUp, *places[-1], button=1)


@pytest.mark.slow
def test_marking_in_a_panel_copies_what_is_marked_and_says_so(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        panel = cockpit.app.query_one("#robot")
        rows = panel.lines
        mouse = Mouse(cockpit, panel)
        await mouse.drag((2, 0), (5, 0), (3, 1))
        expected = f"{rows[0][2:].rstrip()}\n{rows[1][:4].rstrip()}"
        assert cockpit.app.clipboard == expected
        assert cockpit["hint"].startswith(f"{len(expected)} characters sent to the terminal's clipboard")
        marked = [each.text for each in panel.render_line(1) if each.style and each.style.reverse]
        assert "".join(marked) == rows[1][:4]
        await mouse.drag((5, 1), (5, 0), (1, 0))  # backwards, too
        assert cockpit.app.clipboard == f"{rows[0][1:].rstrip()}\n{rows[1][:6].rstrip()}"
        await mouse.drag((4, 1))
        assert cockpit.app.clipboard.startswith(rows[0][1:].rstrip())  # a click marks nothing
        assert not [each for each in panel.render_line(1) if each.style and each.style.reverse]
        await mouse.drag((0, 0), (200, 90))  # beyond the panel: to its end
        assert cockpit.app.clipboard.splitlines() == [row.rstrip() for row in rows]

    fly(scenario)


@pytest.mark.slow
def test_marking_in_the_scrolled_log_takes_the_rows_that_are_seen(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        with cockpit.client() as robot:
            for _ in range(60):
                robot.drive("d1", 0.01)
        log = cockpit.app.query_one(LogPanel)
        await cockpit.until(lambda: log.scroll_y > 0 and cockpit["log"].count("d1-0.01") == 60)
        # The last line that comes: a later one would move the rows while they are marked.
        await cockpit.until(lambda: "disconnected after 60 commands" in cockpit["log"])
        await cockpit.until(lambda: log.scroll_y == log.max_scroll_y)
        first = log.render_line(2).text.rstrip()
        await Mouse(cockpit, log).drag((0, 2), (len(first), 2))
        assert cockpit.app.clipboard == first

    fly(scenario)


@pytest.mark.slow
def test_marking_in_the_console_and_in_the_help_copies_too(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.pilot.press(*":teleport 3 4 5")
        await Mouse(cockpit, cockpit.app.query_one("#line")).drag((1, 0), (9, 0))
        assert cockpit.app.clipboard == "teleport"
        await cockpit.pilot.press("end", "ctrl+u", *":help u1", "enter")
        await cockpit.until(lambda: cockpit.app.screen.query("#help-text"))
        await cockpit.pilot.pause()
        await Mouse(cockpit, cockpit.app.screen.query_one("#help-text")).drag((4, 0), (6, 0), (9, 0))
        await cockpit.until(lambda: cockpit.app.clipboard.startswith("ultra"))

    fly(scenario)


@pytest.mark.slow
def test_the_wheel_zooms_where_the_pointer_is(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        maze = cockpit.maze
        mouse = Mouse(cockpit, maze)
        await cockpit.press(KEYS.follow)  # following the robot comes before the pointer
        zoom = maze.zoom
        for _ in range(3):
            await mouse.do(MouseScrollUp, 30, 10)
        assert maze.zoom > zoom
        for _ in range(3):
            await mouse.do(MouseScrollDown, 30, 10)
        assert maze.zoom == zoom

    fly(scenario)


@pytest.mark.slow
def test_dragging_moves_the_picture_with_the_pointer(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        maze = cockpit.maze
        mouse = Mouse(cockpit, maze)
        follow = maze.follow
        await mouse.drag((30, 10), (20, 8))
        assert maze.follow == follow  # the whole maze is in sight: nothing to look for
        await cockpit.press(*["plus"] * 6)
        held = maze.to_inches(30, 12)
        await mouse.drag((30, 12), (26, 11), (22, 10))
        after = maze.to_inches(22, 10)
        assert abs(after[0] - held[0]) < 1
        assert abs(after[1] - held[1]) < 1
        assert not maze.follow

    fly(scenario)


def test_a_click_on_the_maze_says_where_it_is(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        maze = cockpit.maze
        x, y = maze.to_inches(20.5, 8.5)
        row, column = maze.cell_at(20.5, 8.5)
        await Mouse(cockpit, maze).drag((20, 8))
        expected = f"x {x:.1f}, y {y:.1f} in; cell: row {row + 1}, column {column + 1} from the top left"
        assert cockpit["hint"].startswith(expected)
        for value, name in ((START, "a start cell"), (BLOCK, "loading zone"), (WALL, "a wall")):
            places = (divmod(each, maze.size.width) for each in range(maze.size.width * maze.size.height))
            cells = {maze.cell_at(x + 0.5, y + 0.5): (x, y) for y, x in places}
            shown = maze.scene.maze.cells
            place = next(at for cell, at in cells.items() if cell and shown[cell[0]][cell[1]] == value)
            await Mouse(cockpit, maze).drag(place)
            assert cockpit["hint"].endswith(f"({name})")
        assert maze.has_focus
        await cockpit.pilot.press("colon")
        await cockpit.until(lambda: cockpit["hint"].startswith(":"))

    fly(scenario)
