"""Where there are few colours or no half blocks, the robot is still to be found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from simmer_tui.sim.records import FloorPatch, Pose
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.palette import EXACT, pack
from simmer_tui.tui.maze.scene import Belief, Scene, SensorView
from simmer_tui.tui.maze.viewport import whole_maze
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

GREENS = [int(pack(np.array(color, dtype=np.uint8))) for color in (EXACT.robot, EXACT.robot_edge)]


@pytest.mark.parametrize("glyphs", [GlyphMode.SOLID, GlyphMode.HYBRID, GlyphMode.HALF])
def test_what_the_sensors_see_does_not_hide_a_small_robot_in_16_colors(
    plain_scene: Scene, glyphs: GlyphMode
) -> None:
    grid = np.array([(i, j) for i in range(-6, 7) for j in range(-6, 7)]) / 6 * 3 + 9.0
    patch = FloorPatch((9.0, 9.0), 3.0, grid, np.ones(len(grid), dtype=bool))
    seen = replace(plain_scene, views=(SensorView(patch),))

    def robot_cells(scene: Scene) -> int:
        cells = Painter(glyphs, ColorDepth.COLORS_16).cells(scene, whole_maze(scene.maze, 8))
        return int((np.isin(cells.background, GREENS) | np.isin(cells.foreground, GREENS)).sum())

    assert robot_cells(seen) == robot_cells(plain_scene) > 4


def test_particles_on_the_linux_console_are_signs_that_leave_the_floor_to_be_seen(plain_scene: Scene) -> None:
    particles = np.array([(14.0, 16.0), (20.0, 20.0), (16.0, 15.0)])
    scene = replace(plain_scene, belief=Belief(Pose(30.0, 4.0, 0.0), None, particles), show_robot=False)
    bare = replace(scene, belief=Belief(Pose(30.0, 4.0, 0.0), None, None))
    painter = Painter(GlyphMode.SOLID, ColorDepth.COLORS_16)
    cells = painter.cells(scene, whole_maze(scene.maze, 8))
    without = painter.cells(bare, whole_maze(scene.maze, 8))
    assert (cells.characters == ord("*")).sum() == 3
    assert (cells.background == without.background).all()
