"""The maze widget in a running app, and the spans it sends."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import textual
from rich.console import Console
from rich.segment import Segment
from rich.style import Style
from textual._compositor import ChopsUpdate
from textual.app import App, ComposeResult
from textual.geometry import Region
from textual.pilot import Pilot
from textual.strip import Strip

from simmer_tui.sim.records import Pose
from simmer_tui.sim.specs import MazeSpec, RobotSpec, SimulationSpec
from simmer_tui.tui.dirty_spans import cropped_dirty_spans, is_known_version, spans_are_cropped
from simmer_tui.tui.maze.axes import arrange, best_zoom
from simmer_tui.tui.maze.scene import Scene
from simmer_tui.tui.maze.view import MazeView
from simmer_tui.tui.terminal import ColorDepth, GlyphMode


class Spy(MazeView):
    """Remembers what it asked to be sent."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.sent: list[tuple[Region, ...]] = []

    def refresh(self, *regions: Region, **options: Any) -> Spy:
        if options.get("repaint", True):
            self.sent.append(regions)
        super().refresh(*regions, **options)
        return self


class Window(App[None]):
    def __init__(self, glyphs: GlyphMode, depth: ColorDepth) -> None:
        super().__init__()
        self.view = Spy(glyphs, depth)
        self.changes = 0

    def compose(self) -> ComposeResult:
        yield self.view

    def on_maze_view_changed(self) -> None:
        self.changes += 1


Steps = Callable[[Pilot[None], Spy], Awaitable[None]]


def in_app(
    steps: Steps,
    size: tuple[int, int] = (80, 24),
    glyphs: GlyphMode = GlyphMode.HYBRID,
    depth: ColorDepth = ColorDepth.TRUECOLOR,
) -> Window:
    async def run() -> Window:
        app = Window(glyphs, depth)
        async with app.run_test(size=size) as pilot:
            await steps(pilot, app.view)
        return app

    return asyncio.run(run())


def lines(view: MazeView) -> list[str]:
    return [view.render_line(y).text for y in range(view.size.height)]


@pytest.fixture(scope="module")
def course(course_spec: SimulationSpec) -> Scene:
    floor = np.indices((16, 32)).sum(axis=0).astype(np.uint8) % 2
    return Scene(maze=course_spec.maze, floor=floor, robot=RobotSpec.circle(6), pose=Pose(9.5, 42, 0))


@pytest.fixture(scope="module")
def large() -> Scene:
    """A maze no terminal of 80 columns can hold."""
    maze = MazeSpec(((1,) * 20,) * 20)
    floor = np.ones((80, 80), dtype=np.uint8)
    return Scene(maze=maze, floor=floor, robot=RobotSpec.circle(6), pose=Pose(120, 120, 0))


def test_maze_stands_in_the_middle_with_inches_along_its_axes(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        await pilot.pause()
        shown = lines(view)
        assert len(shown) == 24
        assert {len(line) for line in shown} == {80}
        assert shown[2].strip() == "+" + 64 * "-" + "+"
        assert shown[3].startswith("      48+..  ")
        assert [line[6:8] for line in shown if line[6:8].strip()] == ["48", "36", "24", "12", " 0"]
        assert shown[19].strip() == "0+" + 7 * "-------+" + "--------+"
        assert shown[20].split() == ["0", "12", "24", "36", "48", "60", "72", "84", "96"]
        assert "OO>" in shown[5]

    in_app(steps, glyphs=GlyphMode.ASCII, depth=ColorDepth.NONE)


@pytest.mark.parametrize(
    ("size", "zoom"), [((40, 12), 8), ((80, 24), 8), ((130, 40), 8), ((131, 34), 16), ((200, 60), 24)]
)
def test_automatic_zoom_is_the_largest_that_fits(course: Scene, size: tuple[int, int], zoom: int) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        await pilot.pause()
        assert view.zoom == zoom
        assert view.show_horizontal_scrollbar == (size == (40, 12))

    in_app(steps, size)
    assert best_zoom(course.maze, *size) == zoom


def test_zooming_steps_through_the_levels_and_back_to_what_fits(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        seen = []
        for step in (view.zoom_in, view.zoom_in, view.zoom_in, view.zoom_out, view.zoom_out, view.zoom_out):
            step()
            await pilot.pause()
            seen.append(view.zoom)
            assert view.fault == ""
        assert seen == [16, 24, 24, 16, 8, 8]
        assert not view.zoom_is_automatic
        view.zoom_in()
        await pilot.pause()
        assert view.show_horizontal_scrollbar
        view.zoom_to_fit()
        await pilot.pause()
        assert (view.zoom, view.zoom_is_automatic) == (8, True)
        assert not view.show_horizontal_scrollbar
        assert not view.show_vertical_scrollbar

    assert in_app(steps).changes >= 4


def test_robot_stays_in_sight_until_the_user_scrolls(large: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        for x, y in ((5, 5), (235, 235), (5, 235), (120, 5)):
            view.show(replace(large, pose=Pose(x, y, 0)))
            await pilot.pause()
            assert "O" in "".join(lines(view)), (x, y)
            assert view.follow
        view.pan(0, -20)
        await pilot.pause()
        assert not view.follow
        where = view.scroll_offset
        view.show(replace(large, pose=Pose(235, 235, 0)))
        await pilot.pause()
        assert view.scroll_offset == where
        assert "O" not in "".join(lines(view))
        view.toggle_follow()
        await pilot.pause()
        assert view.follow
        assert "O" in "".join(lines(view))

    in_app(steps, glyphs=GlyphMode.ASCII, depth=ColorDepth.NONE)


def test_wheel_scrolls_and_ends_following(large: Scene) -> None:
    from textual.events import MouseScrollDown

    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(large)
        await pilot.pause()
        before = view.scroll_offset.y
        await pilot._post_mouse_events([MouseScrollDown], view, offset=(5, 5), button=0)
        await pilot.pause()
        assert view.scroll_offset.y > before
        assert not view.follow

    in_app(steps)


def test_axes_count_on_while_the_maze_scrolls(large: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.toggle_follow()
        view.show(large)
        await pilot.pause()
        view.pan(16, 8)
        await pilot.pause()
        shown = lines(view)
        assert shown[0].startswith("216")
        assert shown[-2 - view.scrollbar_size_horizontal + 1].split()[0] == "24"

    in_app(steps)


def test_robot_far_inside_the_window_does_not_scroll_it(large: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(large)
        await pilot.pause()
        where = view.scroll_offset
        view.show(replace(large, pose=Pose(130, 115, 0)))
        await pilot.pause()
        assert view.scroll_offset == where

    in_app(steps)


def test_only_changed_spans_are_refreshed(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        await pilot.pause()
        view.sent.clear()
        view.show(replace(course))
        assert view.sent == []
        view.show(replace(course, pose=Pose(11.0, 42, 0)))
        assert len(view.sent) == 1
        regions = view.sent[0]
        assert 2 <= len(regions) <= 3
        assert all(region.height == 1 and region.width <= 6 for region in regions)
        # The robot is 6 in wide, centred at (9.5, 42): columns 4.3 to 8.3 and rows 2 to 5 of
        # the maze, which begins at column 9 and row 3 of the widget.
        assert all(region.x >= 12 and region.right <= 20 and 4 <= region.y <= 6 for region in regions)

    in_app(steps)


def test_resizing_keeps_zoom_follow_and_scene(large: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(large)
        view.zoom_in()
        await pilot.pause()
        for size in ((120, 40), (30, 10), (8, 3), (3, 1), (200, 60), (80, 24)):
            await pilot.resize_terminal(*size)
            await pilot.pause()
            assert (view.zoom, view.follow, view.fault) == (16, True, "")
            assert view.scene is large
        assert "O" in "".join(lines(view))

    in_app(steps, glyphs=GlyphMode.ASCII, depth=ColorDepth.NONE)


def test_too_small_a_widget_says_so(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        await pilot.pause()
        assert lines(view)[0].startswith("Too small")

    in_app(steps, (30, 5))


def test_scene_that_cannot_be_drawn_shows_why_and_the_next_one_shows(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        await pilot.pause()
        view.show(replace(course, trail=np.zeros((3, 5))))
        await pilot.pause()
        assert "cannot be drawn" in lines(view)[0]
        assert view.fault
        assert pilot.app.is_running
        view.show(course)
        await pilot.pause()
        assert view.fault == ""
        assert "O" in "".join(lines(view))

    in_app(steps, glyphs=GlyphMode.ASCII, depth=ColorDepth.NONE)


def test_axes_take_their_color_from_the_theme_of_the_moment(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        await pilot.pause()
        dark = view.render_line(0)
        pilot.app.theme = "textual-light"
        await pilot.pause()
        await pilot.pause()
        assert view.render_line(0).text == dark.text
        assert list(view.render_line(0)) != list(dark)

    in_app(steps)


@pytest.mark.parametrize("glyphs", list(GlyphMode))
def test_no_color_does_not_end_the_app(
    course: Scene, glyphs: GlyphMode, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")

    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        await pilot.pause()
        await pilot.resize_terminal(100, 40)
        await pilot.pause()
        assert all(segment.style is not None for y in range(40) for segment in view.render_line(y))

    assert in_app(steps, glyphs=glyphs, depth=ColorDepth.NONE).no_color


def test_view_without_a_scene_is_blank() -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        await pilot.pause()
        view.zoom_in()
        view.toggle_follow()
        await pilot.pause()
        assert "".join(lines(view)).strip() == ""

    in_app(steps)


@pytest.mark.parametrize("width", [0, 1, 5, 12, 13, 67, 68, 300])
@pytest.mark.parametrize("height", [0, 1, 2, 6, 18, 19, 100])
@pytest.mark.parametrize("zoom", [8, 24])
def test_layout_never_leaves_the_widget(course: Scene, width: int, height: int, zoom: int) -> None:
    layout = arrange(course.maze, zoom, width, height)
    if layout.usable:
        assert layout.x - 1 - layout.numbers >= 0
        assert layout.x + layout.columns + int(layout.framed) <= width
        assert layout.y - int(layout.framed) >= 0
        assert layout.y + layout.rows + 2 <= height
    viewport = layout.viewport(course.maze, 10_000, 10_000)
    assert viewport.left + viewport.columns == layout.maze_columns
    assert viewport.top + viewport.rows == layout.maze_rows


def test_dirty_span_is_sent_without_what_is_left_of_it() -> None:
    console = Console(color_system="truecolor", force_terminal=True)
    strip = Strip([Segment("abcdef", Style(color="red")), Segment("ghijkl", Style(color="blue"))])
    update = ChopsUpdate([{0: strip, 12: None}], [(0, 4, 8)], [[12, 20]])
    before = update.render_segments(console)
    assert "abcdef" in before
    assert not spans_are_cropped()
    with cropped_dirty_spans() as cropped:
        if not is_known_version(textual.__version__):
            assert not cropped
            return
        assert cropped
        assert spans_are_cropped()
        after = update.render_segments(console)
    assert not spans_are_cropped()
    assert after.startswith("\x1b[1;5H")
    assert [text in after for text in ("ef", "gh", "d", "i")] == [True, True, False, False]


def test_other_versions_of_textual_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(textual, "__version__", "9.0.0", raising=False)
    with cropped_dirty_spans() as cropped:
        assert not cropped
        assert not spans_are_cropped()
