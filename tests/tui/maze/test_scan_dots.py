"""Dots of a scan in the picture: where the beams ended, and never on a wall."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.live.operating.switches import SHOWN
from simmer_tui.sim.records import Pose, RangeScan
from simmer_tui.sim.scan_rays import ScanRays
from simmer_tui.tui.maze.canvas import Canvas
from simmer_tui.tui.maze.glyphs import BRAILLE, Cells
from simmer_tui.tui.maze.lines import dot_places
from simmer_tui.tui.maze.painter import Painter, legend_cells
from simmer_tui.tui.maze.palette import Attribute, Role
from simmer_tui.tui.maze.scene import Scene, SensorView
from simmer_tui.tui.terminal import ColorDepth, GlyphMode
from tests.tui.maze.decoding import whole_maze

EVERY_MODE = [(glyphs, depth) for glyphs in GlyphMode for depth in ColorDepth]


def scan(ranges: list[float], origin: tuple[float, float] = (9.0, 9.0)) -> ScanRays:
    """Beams all around from one place."""
    angles = np.arange(len(ranges)) * 2 * math.pi / len(ranges)
    ways = np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    return ScanRays(np.full((len(ranges), 2), origin), ways, np.array(ranges))


def backdrop_canvas(scene: Scene, zoom: float, glyphs: GlyphMode = GlyphMode.QUADRANT) -> Canvas:
    painter = Painter(glyphs, ColorDepth.TRUECOLOR)
    return Canvas(painter.backdrop(scene, whole_maze(scene.maze, zoom), loud=False))


@settings(max_examples=20)
@given(
    ranges=st.lists(st.floats(0.1, 500.0), min_size=1, max_size=40),
    origin=st.tuples(st.floats(0.0, 36.0), st.floats(0.0, 24.0)),
    zoom=st.sampled_from([3.0, 8.0, 10.0, 11.5, 18.0]),
    glyphs=st.sampled_from(list(GlyphMode)),
)
def test_no_dot_lies_on_a_wall(
    plain_scene: Scene, ranges: list[float], origin: tuple[float, float], zoom: float, glyphs: GlyphMode
) -> None:
    canvas = backdrop_canvas(plain_scene, zoom, glyphs)
    for x, y in dot_places(canvas, scan(ranges, origin)).tolist():
        column, row = math.floor(x), math.floor(y / 2)
        assert canvas.holds(row, column)
        assert not canvas.backdrop.has_wall[row, column]


@settings(max_examples=20)
@given(st.lists(st.floats(0.1, 2.9), min_size=1, max_size=40))
def test_a_dot_in_the_open_is_exactly_where_its_beam_ended(plain_scene: Scene, ranges: list[float]) -> None:
    canvas = backdrop_canvas(plain_scene, 10.0)
    rays = scan(ranges)
    assert dot_places(canvas, rays) == pytest.approx(canvas.viewport.to_units(rays.ends))


def test_a_dot_in_a_wall_is_drawn_back_along_its_beam(plain_scene: Scene) -> None:
    """The wall is at the top right: the beam to the right from the upper row ends at its side."""
    canvas = backdrop_canvas(plain_scene, 10.0)
    (place,) = dot_places(canvas, scan([27.0], (6.0, 18.3))).tolist()
    assert place[0] == pytest.approx(20.0, abs=0.5)
    assert place[0] < 20.0
    assert place[1] == canvas.viewport.place(6.0, 18.3)[1]


def test_a_beam_that_is_nowhere_free_has_no_dot(plain_scene: Scene) -> None:
    canvas = backdrop_canvas(plain_scene, 10.0)
    assert dot_places(canvas, scan([1.0, 2.0], (30.0, 18.0))).shape == (0, 2)
    assert dot_places(canvas, scan([], (9.0, 9.0))).shape == (0, 2)


def ink(cells: Cells, painter: Painter) -> int:
    """The number of cells with a dot of a scan."""
    return int((cells.foreground == painter.palette[Role.RAY_STRONG]).sum())


def test_a_scan_is_drawn_with_the_rays_and_hidden_with_them(plain_scene: Scene) -> None:
    painter = Painter(GlyphMode.QUADRANT, ColorDepth.TRUECOLOR)
    scene = replace(plain_scene, scans=(scan([7.0] * 36),), scan_is_newest=True)
    window = whole_maze(scene.maze, 10.0)
    shown = painter.cells(scene, window)
    assert ink(shown, painter) > 10
    assert ink(painter.cells(replace(scene, shown=SHOWN - {"plot_sense"}), window), painter) == 0
    dots = shown.characters[shown.foreground == painter.palette[Role.RAY_STRONG]]
    assert ((dots > BRAILLE) & (dots < BRAILLE + 256)).all()


def test_the_legend_names_it_and_the_ray_before_it_is_weak(plain_scene: Scene) -> None:
    painter = Painter(GlyphMode.QUADRANT, ColorDepth.TRUECOLOR)
    view = SensorView(RangeScan((12.0, 9.0), (0.0,), (9.0,)), "u1", 9.0)
    scene = replace(plain_scene, scans=(scan([5.0] * 36),), views=(view,), scan_is_newest=True)

    def words(scene: Scene) -> str:
        return legend_cells(scene, painter, 110).text(0)

    assert "scan" in words(scene)
    assert "read last" not in words(scene)
    assert " ray " in words(scene)
    later = replace(scene, scan_is_newest=False)
    assert "scan" in words(later)
    assert "read last" in words(later)
    assert "scan" not in words(replace(scene, shown=SHOWN - {"plot_sense"}))


@pytest.mark.parametrize(("glyphs", "depth"), EVERY_MODE)
def test_every_terminal_tells_a_scan_from_a_trail(
    plain_scene: Scene, glyphs: GlyphMode, depth: ColorDepth
) -> None:
    """By colour, by the sign, or by the brightness where there is neither."""
    painter = Painter(glyphs, depth)
    window = whole_maze(plain_scene.maze, 10.0)
    bare = replace(plain_scene, pose=Pose(500.0, 500.0, 0.0))  # the robot is outside the window
    ground = painter.cells(bare, window)
    looks = []
    for scene in (
        replace(bare, scans=(scan([7.0] * 90),)),
        replace(bare, trail=(np.array([(2.0, 4.0), (22.0, 4.0)]),)),
    ):
        cells = painter.cells(scene, window)
        there = cells.differs(ground)
        assert there.any()
        signs = cells.characters[there]
        kinds = signs if not painter.signs.dotted else np.zeros_like(signs)
        attributes = cells.attributes[there] & (Attribute.BOLD | Attribute.DIM)
        looks.append(
            set(zip(kinds.tolist(), cells.foreground[there].tolist(), attributes.tolist(), strict=True))
        )
    assert not looks[0] & looks[1]


def test_names_of_zones_stay_legible(plain_scene: Scene) -> None:
    painter = Painter(GlyphMode.QUADRANT, ColorDepth.TRUECOLOR)
    scene = replace(
        plain_scene, loading_zone=((6.0, 18.0), (18.0, 18.0)), scans=(scan([13.4, *([15.0] * 359)]),)
    )
    assert "loading" in painter.cells(scene, whole_maze(scene.maze, 8.0)).text(0)
