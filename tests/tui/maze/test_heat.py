"""The map of a grid's belief: levels, numbers, areas, and what stays of the picture under it."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.run.belief_grid import Bounds, grid_belief
from simmer_tui.sim import Pose
from simmer_tui.sim.specs import MazeSpec, RobotSpec
from simmer_tui.tui.maze.heat import HeatMap, HeatMark, heat_numbers
from simmer_tui.tui.maze.painter import Painter, legend_cells
from simmer_tui.tui.maze.palette import HEATS, ZONES, Look, Role, palette_for
from simmer_tui.tui.maze.scene import Scene
from simmer_tui.tui.maze.viewport import Viewport
from simmer_tui.tui.terminal import ColorDepth, GlyphMode
from tests.tui.maze.color_science import contrast

CELLS = tuple(tuple(0 if (row, column) == (1, 2) else 1 for column in range(8)) for row in range(4))
SCENE = Scene(
    maze=MazeSpec(CELLS),
    floor=(np.indices((16, 32)).sum(axis=0) % 2).astype(np.uint8),
    robot=RobotSpec.circle(6),
    pose=Pose(90.0, 6.0, 0.0),
    loading_zone=((6.0, 42.0),),
)
"""Four by eight cells with one wall, and a zone at the top left."""
WHOLE = (0.0, 0.0, 96.0, 48.0)
WINDOW = Viewport(8.0, 0, 0, 64, 16, 48.0)


def mark(table: Any, bounds: Bounds = WHOLE, time: float = 0.0) -> HeatMark:
    numbers = np.asarray(table, dtype=np.float64)
    return HeatMark(grid_belief(numbers[..., None], bounds, 0.0, Pose(1.0, 1.0, 0.0)), time)


def of_cells(*first: float) -> Any:
    """A grid of the maze's cells, by those of its first row."""
    table = np.zeros((4, 8))
    table[0, : len(first)] = first
    return table


def levels(heat: HeatMark, window: Viewport = WINDOW) -> Any:
    return HeatMap().levels(heat, SCENE.maze, window, 2, 2)


@pytest.mark.parametrize(
    ("share", "level"), [(0.35, 3), (0.29, 2), (0.11, 2), (0.09, 1), (0.02, 1), (0.013, 0), (0.0, 0)]
)
def test_levels_are_thirds_and_ninths_of_the_largest(share: float, level: int) -> None:
    found = levels(mark(of_cells(0.9, share)))
    cells = found[4::8, 8::16]
    assert cells.tolist() == [[3, level, 0, 0, 0, 0, 0, 0], *[[0] * 8] * 3]
    # Every pixel of a cell has its level.
    assert (found == np.kron(cells, np.ones((8, 16), dtype=np.uint8))).all()


def test_who_is_hardly_surer_than_by_chance_has_no_high_level() -> None:
    assert levels(mark(np.ones((4, 8)) + of_cells(1.0, 1.0, 1.0))).max() == 1


@pytest.mark.parametrize("shape", [(4, 8), (12, 24), (5, 7)])
def test_a_program_that_knows_nothing_shows_one_faint_tint(shape: tuple[int, int]) -> None:
    assert set(np.unique(levels(mark(np.ones(shape))))) == {1}


def test_cells_that_are_not_the_mazes_are_drawn_by_area() -> None:
    """A pixel half of which is a cell's has half of its probability."""
    edge = 12.0 + 12.0 / 32
    table = np.zeros((4, 8))
    table[0, 0] = 1.0
    found = levels(mark(table, (0.0, 0.0, 8 * edge, 48.0)))
    assert (found[:8, :16] == 3).all()
    assert (found[:8, 16] == 3).all()  # a half of the largest is above its third
    assert not found[:8, 17:].any()
    assert not found[8:].any()
    little = levels(mark(table, (0.0, 0.0, 8 * (12.0 + 12.0 / 16 / 4), 48.0)))
    assert (little[:8, 16] == 2).all()  # a quarter is not


def test_many_small_cells_make_the_same_map_as_few_large_ones() -> None:
    table = of_cells(0.9, 0.31, 0.0, 0.01)
    fine = np.kron(table, np.ones((12, 12)))
    assert (levels(mark(table)) == levels(mark(fine))).all()
    far = levels(mark(fine), Viewport(1.0, 0, 0, 8, 2, 48.0))
    assert far[0, :2].tolist() == [3, 3]


def test_a_level_changes_only_once_its_threshold_is_passed() -> None:
    drawn = HeatMap()

    def level(share: float) -> int:
        return int(drawn.levels(mark(of_cells(0.6, share)), SCENE.maze, WINDOW, 2, 2)[4, 24])

    assert [level(share) for share in (0.3, 0.195, 0.18, 0.16, 0.21, 0.3)] == [3, 3, 3, 2, 2, 3]


def test_while_the_robot_drives_a_map_stays_for_half_a_second() -> None:
    drawn = HeatMap()
    marks = [replace(mark(np.eye(4, 8) + n / 10, time=n / 5), stands=False) for n in range(4)]
    shown = []
    for each in marks:
        chosen = drawn.shown(each)
        drawn.levels(chosen, SCENE.maze, WINDOW, 2, 2)
        shown.append(marks.index(chosen))
    assert shown == [0, 0, 0, 3]
    stands = replace(mark(np.ones((4, 8)), time=0.7), stands=True)
    assert drawn.shown(stands) is stands


def test_cells_have_their_per_cent_at_the_lower_right() -> None:
    heat = mark(of_cells(0.5, 0.3, 0.186, 0.014))
    told = [(each.row, each.column, each.text) for each in heat_numbers(heat.grid, WINDOW, tinted=True)]
    assert [(row, column) for row, column, _ in told] == [(3, 7), (3, 15), (3, 23)]
    shares = [float(text.rstrip("%")) for *_, text in told]
    # A logged probability is off by 4 % of itself at most.
    assert shares == pytest.approx([50, 30, 18.6], abs=2.0)
    assert not heat_numbers(mark(np.ones((8, 16))).grid, WINDOW, tinted=True)


def test_without_tints_small_cells_have_tenths() -> None:
    table = np.zeros((8, 16))
    table[0, 0], table[7, 15], table[1, 1] = 0.75, 0.2, 0.05
    told = heat_numbers(mark(table).grid, WINDOW, tinted=False)
    assert [(each.row, each.column, each.text) for each in told] == [(1, 3, "7"), (15, 63, "2")]


HEAT = mark(of_cells(1.0))


@pytest.mark.quick_cases(6)
@pytest.mark.parametrize("depth", list(ColorDepth))
@pytest.mark.parametrize("glyphs", list(GlyphMode))
def test_every_terminal_tells_the_levels_apart(glyphs: GlyphMode, depth: ColorDepth) -> None:
    """By density, whatever colours there are: four cells of the maze, one of each level."""
    painter = Painter(glyphs, depth)
    heat = mark(of_cells(0.7, 0.2, 0.06, 0.0))
    scene = replace(SCENE, heat=heat, pose=Pose(500.0, 500.0, 0.0))
    cells = painter.cells(scene, WINDOW)
    signs = [" ", *painter.signs.heats]
    seen = [chr(cells.characters[1, 8 * cell + 2]) for cell in range(4)]
    assert seen == [signs[3], signs[2], signs[1], " "]
    assert " 72%" in cells.text(3)  # of the sum


@pytest.mark.parametrize("look", list(Look))
@pytest.mark.parametrize("depth", [ColorDepth.TRUECOLOR, ColorDepth.COLORS_256, ColorDepth.COLORS_16])
def test_levels_are_seen_beside_each_other(look: Look, depth: ColorDepth) -> None:
    """Brightness of a whole cell: its dots cover about a half of it if all are there."""

    def bright(level: int) -> float:
        tint = palette[
            HEATS[level - 1][0] if level and depth is not ColorDepth.COLORS_16 else Role.BLACK_TILE
        ]
        share = (0, 2, 4, 8)[level] / 16
        return (1 - share) * luminance(tint) + share * luminance(palette[Role.HEAT_DOTS]) + 0.05

    palette = palette_for(depth, look)
    shown = [bright(level) for level in range(4)]
    steps = [max(pair) / min(pair) for pair in pairwise(shown)]
    assert min(steps) >= 1.09, steps
    assert math.prod(steps) >= 1.5, steps


def luminance(packed: int) -> float:
    """Relative luminance of a colour, 0 to 1."""
    return contrast((packed >> 16, packed >> 8 & 255, packed & 255), (0, 0, 0)) * 0.05 - 0.05


@pytest.mark.quick_cases(8)
@pytest.mark.parametrize("depth", list(ColorDepth))
@pytest.mark.parametrize("glyphs", list(GlyphMode))
def test_every_terminal_shows_it(glyphs: GlyphMode, depth: ColorDepth) -> None:
    painter = Painter(glyphs, depth)
    scene = replace(SCENE, heat=HEAT, pose=Pose(500.0, 500.0, 0.0))
    cells = painter.cells(scene, WINDOW)
    text = "\n".join("".join(map(chr, row)) for row in cells.characters)
    assert "100%" in text
    painter.heat = False
    bare = painter.cells(scene, WINDOW)
    assert not bare.differs(painter.cells(replace(scene, heat=None), WINDOW)).any()
    has_tints = depth in (ColorDepth.TRUECOLOR, ColorDepth.COLORS_256) and glyphs is not GlyphMode.ASCII
    # The mark of the best cell has a ground of its own.
    others = cells.characters != ord(painter.signs.peak)
    assert (cells.background != bare.background)[others].any() == has_tints


def test_heat_takes_the_place_of_the_zones_tint_and_leaves_walls() -> None:
    painter = Painter(GlyphMode.QUADRANT, ColorDepth.TRUECOLOR)
    before = painter.cells(SCENE, WINDOW)
    after = painter.cells(replace(SCENE, heat=HEAT), WINDOW)
    zones = {painter.palette[role] for role in ZONES}
    assert zones & set(before.background.ravel().tolist())
    assert not zones & set(after.background.ravel().tolist())
    walls = {painter.palette[Role.WALL], painter.palette[Role.EDGE]}
    for picture in (before, after):
        assert walls & set(np.concatenate((picture.background, picture.foreground)).ravel().tolist())


def test_the_legend_names_the_levels() -> None:
    scene = replace(SCENE, heat=HEAT)

    def legend(depth: ColorDepth) -> str:
        painter = Painter(GlyphMode.QUADRANT, depth)
        return "".join(map(chr, legend_cells(scene, painter, 100).characters[0]))

    for depth in ColorDepth:
        assert re.search(r"⣿⣿ most likely +⢕⢕ likely +⡈⡈ possible +else ruled out", legend(depth)), depth


def rows_of(painter: Painter, scene: Scene) -> list[str]:
    return ["".join(map(chr, row)) for row in painter.cells(scene, WINDOW).characters]


@pytest.mark.parametrize("glyphs", [GlyphMode.QUADRANT, GlyphMode.ASCII])
@pytest.mark.parametrize("pose", [Pose(90.0, 6.0, 0.0), Pose(41.0, 43.0, 0.0)])
def test_the_most_likely_small_cell_has_its_percentage_also_beside_a_robot(glyphs: Any, pose: Pose) -> None:
    table = np.full((12, 24), 0.1)
    table[1, 10] = 20.0
    scene = replace(SCENE, pose=pose, heat=mark(table))
    painter = Painter(glyphs, ColorDepth.TRUECOLOR)
    written = rows_of(painter, scene)
    found = [(row, each) for row, line in enumerate(written) for each in re.finditer(r"(\d+)%", line)]
    ((row, told),) = found
    assert float(told[1]) == pytest.approx(100 * 20.0 / (20.0 + 28.7), abs=4.0)
    assert abs(told.start() - 27) <= 12
    assert row <= 7
    # Its mark lies over the robot too: the middle of the cell is at x = 42, y = 42.
    x, y = WINDOW.place(42.0, 42.0)
    assert written[int(y // 2)][int(x)] == painter.signs.peak
    even = replace(scene, heat=mark(np.ones((12, 24))))
    assert not re.search(r"\d%", "\n".join(rows_of(painter, even)))
