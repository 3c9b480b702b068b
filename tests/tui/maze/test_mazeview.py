"""The maze widget in a running app, and the spans it sends."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from textual.app import App, ComposeResult
from textual.geometry import Region
from textual.pilot import Pilot

from simmer_tui.sim.records import Pose
from simmer_tui.sim.specs import MazeSpec, RobotSpec, SimulationSpec
from simmer_tui.tui.maze.palette import Look
from simmer_tui.tui.maze.scene import BeliefMark, FloorMode, Scene
from simmer_tui.tui.maze.view import MazeView
from simmer_tui.tui.maze.viewport import arrange, best_zoom
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

    def compose(self) -> ComposeResult:
        yield self.view


Steps = Callable[[Pilot[None], Spy], Awaitable[None]]


def in_app(
    steps: Steps,
    size: tuple[int, int] = (80, 24),
    glyphs: GlyphMode = GlyphMode.QUADRANT,
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


def test_the_frame_around_the_maze_is_its_outer_wall(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        await pilot.pause()
        shown = lines(view)
        assert len(shown) == 24
        assert {len(line) for line in shown} == {80}
        assert shown[0] == 74 * "#" + 6 * " "
        assert shown[1].startswith("#+ loading")
        assert shown[19] == shown[0]
        assert {line[0] + line[73] for line in shown[:20]} == {"##"}
        assert "".join(shown[20:]).strip() == ""
        assert "(->)" in shown[3]

    in_app(steps, glyphs=GlyphMode.ASCII, depth=ColorDepth.NONE)


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(
    ("size", "zoom"), [((40, 12), 4), ((66, 18), 8), ((82, 22), 10), ((146, 38), 18), ((200, 60), 24)]
)
def test_automatic_zoom_is_the_largest_that_fits(course: Scene, size: tuple[int, int], zoom: float) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        await pilot.pause()
        assert view.zoom == zoom
        assert view.viewport is not None
        assert (view.viewport.columns, view.viewport.rows) == (8 * zoom, 2 * zoom)

    in_app(steps, size)
    assert best_zoom(course.maze, *size) == zoom


def test_zooming_goes_in_small_steps_and_back_to_what_fits(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        seen = []
        for step in (1, 1, 1, -1, -1, -1):
            view.action_zoom(step)
            await pilot.pause()
            seen.append(view.zoom)
            assert view.fault == ""
        assert seen == [11, 14, 18, 14, 11, 9]
        assert not view.zoom_is_automatic
        for _ in range(30):
            view.action_zoom(-1)
        assert view.zoom == 9, "there is no more of the maze to be seen"
        for _ in range(30):
            view.action_zoom(1)
        assert view.zoom == 64
        view.action_fit()
        await pilot.pause()
        assert (view.zoom, view.zoom_is_automatic) == (9, True)

    in_app(steps)


def test_a_large_maze_is_seen_whole_with_its_robot() -> None:
    maze = MazeSpec(tuple(tuple((row * column) % 3 for column in range(80)) for row in range(40)))
    floor = np.ones((160, 320), dtype=np.uint8)
    scene = Scene(maze=maze, floor=floor, robot=RobotSpec.circle(6), pose=Pose(480.0, 240.0, 90.0))

    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(scene)
        await pilot.pause()
        assert view.fault == ""
        assert view.zoom < 1
        shown = lines(view)
        assert shown[0].rstrip()[-1] == "▖"
        assert shown[-1].startswith("▝") or shown[-2].startswith("▝")
        assert "".join(shown).count("↑") == 1

    in_app(steps, (66, 18))


def test_an_overview_shows_where_one_is(large: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(large)
        await pilot.pause()
        text = "".join(lines(view))
        assert "┌" not in text, "the maze is whole"
        while view.zoom < 8:
            view.action_zoom(1)
        await pilot.pause()
        text = "".join(lines(view))
        assert "┌" in text
        assert "┘" in text
        assert text.count("→") == 2

    in_app(steps, (120, 36))


def test_robot_stays_in_sight_until_the_user_pans(large: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(large)
        while view.zoom < 10:
            view.action_zoom(1)
        for x, y in ((5, 5), (235, 235), (5, 235), (120, 5)):
            view.show(replace(large, pose=Pose(x, y, 0)))
            await pilot.pause()
            assert "(->)" in "".join(lines(view)) or "O->" in "".join(lines(view)), (x, y)
            assert view.follow
        view.pan(0, -100)
        await pilot.pause()
        assert not view.follow
        where = view.viewport
        view.show(replace(large, pose=Pose(235, 235, 0)))
        await pilot.pause()
        assert view.viewport == where
        assert "OO" not in "".join(lines(view))
        assert ">" in "".join(line[-1] for line in lines(view)), "an arrow on the frame says where it is"
        view.action_follow()
        await pilot.pause()
        assert view.follow
        assert "->" in "".join(lines(view))

    in_app(steps, glyphs=GlyphMode.ASCII, depth=ColorDepth.NONE)


def test_a_belief_outside_the_view_has_an_arrow_on_the_frame(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        for x, y, row, column, arrow in (
            (-30.0, 30.0, 7, 0, "←"),
            (200.0, 30.0, 7, 65, "→"),
            (42.0, 80.0, 0, 29, "↑"),
            (42.0, -80.0, 17, 29, "↓"),
        ):
            view.show(replace(course, belief=BeliefMark(Pose(x, y, 0.0))))
            await pilot.pause()
            assert lines(view)[row][column] == arrow

    in_app(steps, (66, 18))


def test_a_place_of_the_widget_is_one_in_the_maze(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        assert view.to_inches(5, 5) is None
        view.show(course)
        await pilot.pause()
        assert view.to_inches(1, 1) == (0.0, 48.0)
        assert view.to_inches(1 + 20, 1 + 6) == pytest.approx((30.0, 30.0))
        assert view.cell_at(1 + 20, 1 + 6) == (1, 2)
        assert view.to_inches(0, 5) is None
        assert view.cell_at(65, 5) is None
        view.action_follow()
        view.zoom_at(1, 21, 7)
        await pilot.pause()
        near = view.to_inches(21, 7)
        assert near == pytest.approx((30.0, 30.0), abs=1.5), "what is under the pointer stays there"

    in_app(steps, (66, 18))


def test_robot_far_inside_the_window_does_not_move_it(large: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(large)
        for _ in range(8):
            view.action_zoom(1)
        await pilot.pause()
        where = view.viewport
        view.show(replace(large, pose=Pose(125, 118, 0)))
        await pilot.pause()
        assert view.viewport == where

    in_app(steps)


def test_the_floor_is_loud_when_a_line_sensor_is_used_or_by_choice(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        def is_loud() -> bool:
            near = "".join(line[2:18] for line in lines(view)[2:8])
            return ":" in near and " black" in view.legend(150).text

        for age, expected in ((None, False), (3.0, True), (11.0, False)):
            view.show(replace(course, line_age=age))
            await pilot.pause()
            assert is_loud() is expected, age
        view.action_floor()
        assert view.painter.floor is FloorMode.LOUD
        assert is_loud()
        view.action_floor()
        view.show(replace(course, line_age=1.0))
        assert not is_loud()
        view.action_floor()
        assert view.painter.floor is FloorMode.AUTO
        assert is_loud()

    in_app(steps, glyphs=GlyphMode.ASCII, depth=ColorDepth.NONE)


def test_the_legend_names_what_there_is_and_fits(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        await pilot.pause()
        assert view.legend(80).text.split() == ["robot"]
        view.show(replace(course, block_centre=(25.0, 41.0), contact=(3.0, 3.0), drop_zone=(66.0, 42.0)))
        words = view.legend(80).text.split()
        assert words == ["robot", "■", "block", "X", "contact", "⣏⣹", "loading", "⡠⠊", "drop"]
        assert "contact" not in view.legend(20).text
        assert view.legend(20).cell_length == 20

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
        assert all(region.height == 1 and region.width <= 12 for region in regions)
        assert all(region.x >= 4 and region.right <= 18 and 2 <= region.y <= 5 for region in regions)

    in_app(steps, (66, 18))


@pytest.mark.slow
def test_resizing_keeps_zoom_follow_and_scene(large: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(large)
        while view.zoom < 12:
            view.action_zoom(1)
        zoom = view.zoom
        await pilot.pause()
        for size in ((120, 40), (30, 10), (8, 3), (3, 1), (200, 60), (80, 24)):
            await pilot.resize_terminal(*size)
            await pilot.pause()
            assert (view.zoom, view.follow, view.fault) == (zoom, True, "")
            assert view.scene is large
        assert "->" in "".join(lines(view))

    in_app(steps, glyphs=GlyphMode.ASCII, depth=ColorDepth.NONE)


def test_too_small_a_widget_says_so(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        await pilot.pause()
        assert lines(view)[0].startswith("Too small")

    in_app(steps, (30, 4))


def test_scene_that_cannot_be_drawn_shows_why_and_the_next_one_shows(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        await pilot.pause()
        view.show(replace(course, trail=(np.arange(15.0),)))
        await pilot.pause()
        assert "cannot be drawn" in lines(view)[0]
        assert view.fault
        assert pilot.app.is_running
        view.show(course)
        await pilot.pause()
        assert view.fault == ""
        assert "(OO)" in "".join(lines(view))

    in_app(steps, glyphs=GlyphMode.ASCII, depth=ColorDepth.NONE)


def test_the_look_goes_with_the_theme(course: Scene) -> None:
    async def steps(pilot: Pilot[None], view: Spy) -> None:
        view.show(course)
        await pilot.pause()
        assert view.painter.look is Look.DARK
        dark = view.render_line(5)
        pilot.app.theme = "textual-light"
        await pilot.pause()
        await pilot.pause()
        assert view.painter.look is Look.LIGHT
        assert view.render_line(5).text == dark.text
        assert list(view.render_line(5)) != list(dark)

    in_app(steps)


@pytest.mark.quick_cases(1)
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
        view.action_zoom(1)
        view.action_follow()
        view.pan(3, 3)
        await pilot.pause()
        assert "".join(lines(view)).strip() == ""

    in_app(steps)


@given(
    width=st.integers(0, 300),
    height=st.integers(0, 100),
    zoom=st.floats(0.1, 64),
    rows=st.integers(1, 80),
    columns=st.integers(1, 80),
)
def test_layout_never_leaves_the_widget_nor_the_maze(
    width: int, height: int, zoom: float, rows: int, columns: int
) -> None:
    maze = MazeSpec(((1,) * columns,) * rows)
    layout = arrange(maze, zoom, width, height)
    if layout.usable:
        assert layout.columns + 2 <= width
        assert layout.rows + 2 <= height
    viewport = layout.viewport(maze, 10_000, 10_000)
    assert viewport.left + viewport.columns == layout.maze_columns
    assert viewport.top + viewport.rows == layout.maze_rows
    fit = arrange(maze, best_zoom(maze, width, height), width, height)
    assert fit.fits or width < 10 or height < 10
