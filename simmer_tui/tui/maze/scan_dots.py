"""Scans of lidars in the picture: a dot where each beam ended."""

import numpy as np

from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.scan_rays import ScanRays
from simmer_tui.tui.maze.canvas import Canvas
from simmer_tui.tui.maze.glyphs import Mask
from simmer_tui.tui.maze.palette import Role
from simmer_tui.tui.maze.scene import Scene

# A dot: a longer step would leave gaps between dots and wall.
_BACK = 0.5
"""Units by which a dot in a wall is moved along its beam at a time."""


def draw_scans(canvas: Canvas, scene: Scene) -> None:
    """Dots of the newest scans. One that noise puts into a wall is drawn at the last free place of its beam,
    so that walls keep their edge; zone names and per cents stay legible."""
    spare = canvas.backdrop.named | canvas.backdrop.has_wall
    for each in scene.scans:
        canvas.dots(Role.RAY_STRONG, 2 * dot_places(canvas, each), spare)


def dot_places(canvas: Canvas, rays: ScanRays) -> FloatArray:
    """Places of a scan's dots, units of the window, (n, 2); of a beam that is nowhere free none."""
    viewport = canvas.viewport
    lengths = _within(canvas, rays)
    places = viewport.to_units(rays.origins + lengths[:, None] * rays.ways)
    back = _BACK * rays.ways * (1.0, -1.0)
    steps = lengths * viewport.scale / _BACK
    blocked = np.flatnonzero(_is_covered(canvas, places))
    shown = np.ones(len(places), dtype=np.bool_)
    while len(blocked):
        places[blocked] -= back[blocked]
        steps[blocked] -= 1.0
        shown[blocked[steps[blocked] < 0.0]] = False
        blocked = blocked[(steps[blocked] >= 0.0) & _is_covered(canvas, places[blocked])]
    free: FloatArray = places[shown]
    return free


def _within(canvas: Canvas, rays: ScanRays) -> FloatArray:
    """Lengths of the beams as far as they are in the maze, inches."""
    rows, columns = canvas.backdrop.walls.shape
    cell = canvas.viewport.maze_height / rows
    most = np.array((columns * cell, canvas.viewport.maze_height))
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (np.where(rays.ways > 0.0, most, 0.0) - rays.origins) / rays.ways
    # A beam along a side never reaches it.
    ends[rays.ways == 0.0] = np.inf
    lengths: FloatArray = np.clip(rays.ranges, 0.0, ends.min(axis=1, initial=np.inf).clip(0.0))
    return lengths


def _is_covered(canvas: Canvas, places: FloatArray) -> Mask:
    """True for places in units of the window that are in a wall, or in a terminal cell that shows one."""
    x, y = places.T
    covered = canvas.backdrop.in_wall(x, y)
    row, column = np.floor(y / 2).astype(np.intp), np.floor(x).astype(np.intp)
    inside = (row >= 0) & (row < canvas.rows) & (column >= 0) & (column < canvas.columns)
    covered[inside] |= canvas.backdrop.has_wall[row[inside], column[inside]]
    return covered
