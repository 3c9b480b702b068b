"""The radar, as strings."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.sim.maze import Maze
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import RangeScan
from simmer_tui.tui.maze.glyphs import signs_for
from simmer_tui.tui.maze.palette import Look, Role, palette_for
from simmer_tui.tui.maze.scene import Scene, SensorView
from simmer_tui.tui.radar import radar_cells
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

ROWS, COLUMNS = 21, 42


def picture(scene: Scene, glyphs: GlyphMode, depth: ColorDepth) -> list[str]:
    palette = palette_for(depth, Look.DARK)
    cells = radar_cells(scene, Maze(scene.maze), ROWS, COLUMNS, signs_for(glyphs, depth), palette)
    return [cells.text(row) for row in range(ROWS)]


@pytest.mark.parametrize("heading", [0.0, 90.0, -135.0, 1000.0])
def test_the_front_is_up_whatever_the_heading(plain_scene: Scene, heading: float) -> None:
    view = RangeScan((9.0, 9.0), (heading,), (12.0,))
    scene = replace(plain_scene, pose=Pose(9.0, 9.0, heading), views=(SensorView(view, "u1"),))
    rows = picture(scene, GlyphMode.ASCII, ColorDepth.NONE)
    assert rows[ROWS // 2][COLUMNS // 2] == "^"
    place = next(row for row, text in enumerate(rows) if "u1" in text)
    assert place < ROWS // 2
    assert abs(rows[place].index("u1") + 1 - COLUMNS / 2) <= 1
    assert all(row.isascii() for row in rows)


def test_walls_stand_where_they_are(plain_scene: Scene) -> None:
    """The robot looks along +X: the wall below it in the maze is to its right."""
    scene = replace(plain_scene, pose=Pose(9.0, 4.0, 0.0))
    palette = palette_for(ColorDepth.TRUECOLOR, Look.DARK)
    signs = signs_for(GlyphMode.QUADRANT, ColorDepth.TRUECOLOR)
    cells = radar_cells(scene, Maze(scene.maze), ROWS, COLUMNS, signs, palette)
    walls = np.flatnonzero(cells.foreground[ROWS // 2 - 2] == palette[Role.EDGE])
    right, left = walls[walls > COLUMNS // 2], walls[walls < COLUMNS // 2]
    assert right.min() - COLUMNS / 2 < COLUMNS / 2 - left.max()


@pytest.mark.parametrize("size", [(1, 1), (2, 5), (5, 2), (60, 20)])
def test_any_size_is_drawn(full_scene: Scene, size: tuple[int, int]) -> None:
    palette = palette_for(ColorDepth.TRUECOLOR, Look.LIGHT)
    signs = signs_for(GlyphMode.HALF, ColorDepth.TRUECOLOR)
    assert radar_cells(full_scene, Maze(full_scene.maze), *size, signs, palette).shape == size
