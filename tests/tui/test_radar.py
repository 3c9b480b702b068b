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
from simmer_tui.tui.radar import radar_cells, radar_scale
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


def shown(scene: Scene) -> list[str]:
    return picture(scene, GlyphMode.QUADRANT, ColorDepth.TRUECOLOR)


def seen(code: str, reading: float, bearing: float = 0.0) -> SensorView:
    return SensorView(RangeScan((9.0, 9.0), (bearing,), (20.0,)), code, reading)


@pytest.mark.parametrize(
    ("readings", "scale"),
    [
        ((), 24),
        ((12.0,), 24),
        ((12.0, 30.0), 36),
        ((1.0, 2.0, 3.0, 47.0), 24),
        ((47.0,), 48),
        ((np.inf,), 24),
    ],
)
def test_the_scale_is_the_least_that_holds_most_readings(
    plain_scene: Scene, readings: tuple[float, ...], scale: float
) -> None:
    views = tuple(seen(f"u{number}", value) for number, value in enumerate(readings))
    assert radar_scale(replace(plain_scene, views=views)) == scale
    rows = "\n".join(shown(replace(plain_scene, views=views)))
    assert f"{scale:g} in" in rows
    assert "12" in rows


def test_a_reading_without_an_echo_is_a_stub_with_a_dash(plain_scene: Scene) -> None:
    rows = shown(replace(plain_scene, views=(seen("u1", np.inf),)))
    place = next(row for row, text in enumerate(rows) if "u1 –" in text)
    middle, radius = ROWS / 2, (ROWS - 2.0) / 2
    assert middle - place == pytest.approx(radius * 9 / 24, abs=1.5)


def test_codes_of_sensors_that_look_the_same_way_do_not_cover_each_other(plain_scene: Scene) -> None:
    views = tuple(seen(code, 12.0) for code in ("u1", "u5", "t1"))
    text = "\n".join(shown(replace(plain_scene, views=views)))
    assert all(code in text for code in ("u1", "u5", "t1"))


def test_the_robot_has_its_own_shape_and_the_hand_of_the_maze(plain_scene: Scene) -> None:
    palette = palette_for(ColorDepth.TRUECOLOR, Look.DARK)
    signs = signs_for(GlyphMode.QUADRANT, ColorDepth.TRUECOLOR)
    cells = radar_cells(
        replace(plain_scene, pose=Pose(9.0, 9.0, 70.0)), Maze(plain_scene.maze), ROWS, COLUMNS, signs, palette
    )
    body = np.argwhere((cells.foreground == palette[Role.ROBOT]) | (cells.background == palette[Role.ROBOT]))
    hand = np.argwhere(
        (cells.foreground == palette[Role.HEADING]) & (cells.background == palette[Role.ROBOT])
    )
    assert len(body) >= 6
    assert len(hand)
    assert hand[:, 0].mean() <= body[:, 0].mean(), "the hand points up, to the front"
    assert abs(body[:, 1].mean() + 0.5 - COLUMNS / 2) <= 1
