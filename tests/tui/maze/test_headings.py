"""Which way the robot looks can be read off the cells, whatever else is drawn around it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.sim.records import Pose, RangeScan
from simmer_tui.sim.specs import BLOCK, EMPTY, START, WALL, MazeSpec, RobotSpec
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.palette import GROUNDS, Look, Role
from simmer_tui.tui.maze.scene import BeliefMark, Scene, SensorView
from simmer_tui.tui.maze.viewport import Viewport, arrange, best_zoom
from simmer_tui.tui.terminal import ColorDepth, GlyphMode
from tests.tui.maze.color_science import contrast
from tests.tui.maze.decoding import arrow_heading, needle_heading, robot_cells, turned

MAZE = MazeSpec(
    (
        (BLOCK, BLOCK, EMPTY, EMPTY, WALL, START, WALL, START),
        (BLOCK, BLOCK, WALL, EMPTY, EMPTY, EMPTY, EMPTY, EMPTY),
        (EMPTY, WALL, EMPTY, WALL, WALL, EMPTY, WALL, EMPTY),
        (EMPTY, EMPTY, EMPTY, EMPTY, EMPTY, EMPTY, WALL, START),
    )
)
FLOOR = (np.indices((16, 32)).sum(axis=0) % 2).astype(np.uint8)
HEADINGS = [22.5 * step for step in range(16)]
VIEWS = {"80x24": (66, 18), "120x36": (82, 22), "200x60": (146, 38)}
SWEPT = [
    pytest.param(size, id=name, marks=[pytest.mark.slow] * (name != "80x24")) for name, size in VIEWS.items()
]
"""Quick tests sweep over the smallest, where there is least room; slow ones over all."""
KINDS = [
    (GlyphMode.QUADRANT, ColorDepth.TRUECOLOR),
    (GlyphMode.QUADRANT, ColorDepth.COLORS_256),
    (GlyphMode.QUADRANT, ColorDepth.COLORS_16),
    (GlyphMode.QUADRANT, ColorDepth.NONE),
    (GlyphMode.ASCII, ColorDepth.NONE),
    (GlyphMode.ASCII, ColorDepth.COLORS_16),
    (GlyphMode.SEXTANT, ColorDepth.TRUECOLOR),
    (GlyphMode.OCTANT, ColorDepth.TRUECOLOR),
    (GlyphMode.HALF, ColorDepth.TRUECOLOR),
    (GlyphMode.HALF, ColorDepth.NONE),
]


def crowded(heading: float, *, contact: float | None = 100.0, held: bool = False) -> Scene:
    """The robot with rays, trail, belief and contact over one another, `contact` degrees to the
    left of its front."""
    step = HEADINGS.index(heading)
    pose = Pose(65.0 + 0.31 * step, 30.2 - 0.17 * step, heading)
    rays = tuple(
        SensorView(RangeScan((pose.x, pose.y), (heading + turn,), (14.0,))) for turn in (0, 70, 180, 290)
    )
    point = None
    if contact is not None:
        aside = math.radians(heading + contact)
        point = (pose.x + 3 * math.cos(aside), pose.y + 3 * math.sin(aside))
    trail = np.array(((6.0, 20.0), (6.0, 6.0), (64.0, 6.0), (67.0, 22.0), (pose.x, pose.y)))
    return Scene(
        maze=MAZE,
        floor=FLOOR,
        robot=RobotSpec.circle(6),
        pose=pose,
        block_centre=(16.5, 41.0),
        block_held=held,
        trail=tuple(np.split(trail, (2, 3, 4))),
        views=rays,
        contact=point,
        belief=BeliefMark(Pose(pose.x - 2.4, pose.y + 1.3, heading + 130), 4.0, np.array([(66.0, 30.0)])),
        drop_zone=(66.0, 42.0),
    )


def window(size: tuple[int, int]) -> Viewport:
    layout = arrange(MAZE, best_zoom(MAZE, *size), *size)
    assert layout.fits
    return layout.viewport(MAZE, 0, 0)


def test_the_views_have_the_sizes_of_the_composition() -> None:
    assert [window(size).zoom for size in VIEWS.values()] == [8, 10, 18]


@pytest.mark.quick_cases(len(KINDS))
@pytest.mark.parametrize(("glyphs", "depth"), KINDS)
@pytest.mark.parametrize("contact", [0.0, None, 100.0])
@pytest.mark.parametrize("size", SWEPT)
def test_the_heading_is_read_off_the_cells(
    size: tuple[int, int], glyphs: GlyphMode, depth: ColorDepth, contact: float | None
) -> None:
    painter, needles = Painter(glyphs, depth), 0
    for heading in HEADINGS:
        cells = painter.cells(crowded(heading, contact=contact), window(size))
        arrow = arrow_heading(cells, painter)
        assert arrow is not None, heading
        assert turned(arrow, heading) <= 22.5, (heading, arrow)
        needle = needle_heading(cells, painter)
        if needle is not None:
            needles += 1
            assert turned(needle, heading) <= 22.5, (heading, needle)
    # A belief close by or a contact ahead may lie over it.
    seen = painter.signs.dotted and depth is not ColorDepth.NONE and contact != 0.0
    assert needles >= 12 * seen


@pytest.mark.quick_cases(4)
@pytest.mark.parametrize("zoom", [4.0, 10.0, 6.0, 13.5, 5.0, 7.0, 9.0, 12.0, 14.0, 16.0, 24.0, 40.0])
def test_the_heading_is_read_at_any_zoom(zoom: float) -> None:
    painter = Painter(GlyphMode.QUADRANT, ColorDepth.TRUECOLOR)
    viewport = arrange(MAZE, zoom, 2000, 2000).viewport(MAZE, 0, 0)
    needles = 0
    for heading in HEADINGS:
        cells = painter.cells(crowded(heading), viewport)
        arrow, needle = arrow_heading(cells, painter), needle_heading(cells, painter)
        assert arrow is not None
        assert turned(arrow, heading) <= (10 if zoom >= 10 else 22.5), (heading, arrow)
        if needle is not None:
            needles += 1
            assert turned(needle, heading) <= 30, (heading, needle)
    assert needles >= 8, "a wall close by cuts it off, a belief lies over it"


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize("zoom", [0.4, 0.8, 1.5, 3.0])
@pytest.mark.parametrize("glyphs", [GlyphMode.QUADRANT, GlyphMode.HALF])
def test_a_robot_smaller_than_a_cell_is_its_arrow(zoom: float, glyphs: GlyphMode) -> None:
    painter = Painter(glyphs, ColorDepth.TRUECOLOR)
    viewport = arrange(MAZE, zoom, 100, 100).viewport(MAZE, 0, 0)
    for heading in HEADINGS:
        arrow = arrow_heading(painter.cells(crowded(heading, contact=None), viewport), painter)
        assert arrow is not None, heading
        assert turned(arrow, heading) <= 22.5


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize(
    "look",
    [Look.DARK, *(pytest.param(each, marks=pytest.mark.slow) for each in Look if each is not Look.DARK)],
)
@pytest.mark.parametrize("depth", [ColorDepth.TRUECOLOR, ColorDepth.COLORS_256, ColorDepth.COLORS_16])
@pytest.mark.parametrize("size", SWEPT)
def test_no_robot_cell_carries_another_layers_color(
    size: tuple[int, int], depth: ColorDepth, look: Look, held: bool
) -> None:
    for glyphs in (GlyphMode.QUADRANT, GlyphMode.SEXTANT, GlyphMode.OCTANT, GlyphMode.HALF):
        painter = Painter(glyphs, depth, look)
        palette = painter.palette
        allowed = {palette[role] for role in (*GROUNDS, Role.ROBOT, Role.HEADING)}
        for heading in HEADINGS:
            cells = painter.cells(crowded(heading, held=held), window(size))
            robot = robot_cells(cells, painter)
            assert robot.sum() >= 4
            shown = set(cells.background[robot].tolist())
            shown |= set(cells.foreground[robot & (cells.characters != ord(" "))].tolist())
            assert shown <= allowed, (heading, [hex(color) for color in shown - allowed])


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("look", list(Look))
def test_marks_stand_out_from_the_ground_of_their_cell(look: Look) -> None:
    painter = Painter(GlyphMode.QUADRANT, ColorDepth.TRUECOLOR, look)
    marks = (Role.ROBOT, Role.BLOCK, Role.EDGE, Role.CONTACT, Role.BELIEF, Role.RAY_STRONG)
    for heading in HEADINGS:
        for size in VIEWS.values():
            cells = painter.cells(crowded(heading), window(size))
            for role in marks:
                there = (cells.foreground == painter.palette[role]) & (cells.characters != ord(" "))
                for ground in np.unique(cells.background[there]).tolist():
                    assert contrast(unpacked(painter.palette[role]), unpacked(ground)) >= 3.0, role.name


OUTER_WALLS: tuple[Callable[[float], tuple[Pose, tuple[float, float]]], ...] = (
    lambda share: (Pose(3 + share * 90, 45, 0), (3 + share * 90, 48)),
    lambda share: (Pose(3 + share * 90, 3, 0), (3 + share * 90, 0)),
    lambda share: (Pose(3, 3 + share * 42, 0), (0, 3 + share * 42)),
    lambda share: (Pose(93, 3 + share * 42, 0), (96, 3 + share * 42)),
)
"""A robot at each of them, from one end to the other, and where it touches."""


@pytest.mark.parametrize("size", VIEWS.values(), ids=VIEWS)
@given(
    at=st.sampled_from(OUTER_WALLS),
    share=st.floats(0, 1),
    heading=st.sampled_from(HEADINGS),
    kind=st.sampled_from(KINDS),
)
@settings(max_examples=8, deadline=None, derandomize=True)
def test_a_contact_with_the_outer_wall_is_marked_beside_the_arrow(
    size: tuple[int, int],
    at: Callable[[float], tuple[Pose, tuple[float, float]]],
    share: float,
    heading: float,
    kind: tuple[GlyphMode, ColorDepth],
) -> None:
    pose, point = at(share)
    pose = Pose(pose.x, pose.y, heading)
    scene = replace(crowded(heading), pose=pose, contact=point, belief=None, views=())
    painter = Painter(*kind)
    cells = painter.cells(scene, window(size))
    rows, columns = np.nonzero(cells.characters == ord("X"))
    assert len(rows) == 1
    x, y = window(size).place(*point)
    assert math.hypot(columns[0] + 0.5 - x, 2 * rows[0] + 1 - y) <= 2 * window(size).scale * 3 + 1
    arrow = arrow_heading(cells, painter)
    assert arrow is not None
    assert turned(arrow, heading) <= 22.5


def unpacked(color: int) -> tuple[int, int, int]:
    return color >> 16, (color >> 8) & 255, color & 255


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("glyphs", [GlyphMode.QUADRANT, GlyphMode.HALF, GlyphMode.ASCII])
def test_a_held_block_is_ahead_of_the_robot(glyphs: GlyphMode) -> None:
    painter = Painter(glyphs, ColorDepth.TRUECOLOR)
    for heading in HEADINGS:
        cells = painter.cells(crowded(heading, contact=None, held=True), window(VIEWS["120x36"]))
        color = painter.palette[Role.BLOCK]
        rows, columns = np.nonzero((cells.background == color) | (cells.foreground == color))
        assert len(rows)
        scene = crowded(heading)
        x, y = window(VIEWS["120x36"]).place(scene.pose.x, scene.pose.y)
        ahead = math.degrees(math.atan2(y - (2 * rows + 1).mean(), (columns + 0.5).mean() - x))
        assert turned(ahead, heading) <= 25, (heading, ahead)
        assert arrow_heading(cells, painter) is not None
