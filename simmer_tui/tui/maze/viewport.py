"""Which part of the maze is drawn, and how large.

A pixel is one terminal column wide and half a terminal row high, which is square in nearly every
font. A maze cell is `zoom` pixels wide and high, so `zoom` columns and `zoom / 2` rows; the levels
are chosen so that the edges of floor tiles fall on the borders of terminal cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.specs import CELL_SIZE, MazeSpec

ZOOM_LEVELS = (8, 16, 24)
"""Columns a maze cell may be wide."""

_FAR = 1e6
"""Pixels; places further out are drawn no differently and must not overflow an integer."""


@dataclass(frozen=True, slots=True)
class Viewport:
    """A window onto the maze: `columns` x `rows` terminal cells, the first of which is cell
    (`left`, `top`) counted from the maze's top-left corner. `maze_height` is in inches."""

    zoom: int
    left: int
    top: int
    columns: int
    rows: int
    maze_height: float

    @property
    def scale(self) -> float:
        """Pixels an inch."""
        return self.zoom / CELL_SIZE

    def to_pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Global places (..., 2) as pixel coordinates (..., 2) of this window, x right, y down."""
        pixels = np.empty(points.shape)
        pixels[..., 0] = points[..., 0] * self.scale - self.left
        pixels[..., 1] = (self.maze_height - points[..., 1]) * self.scale - 2 * self.top
        finite = np.nan_to_num(pixels, nan=_FAR, posinf=_FAR, neginf=-_FAR)
        within: NDArray[np.float64] = np.clip(finite, -_FAR, _FAR)
        return within


def maze_cells(maze: MazeSpec, zoom: int) -> tuple[int, int]:
    """(columns, rows) of terminal cells that the whole maze takes."""
    return maze.columns * zoom, maze.rows * zoom // 2


def whole_maze(maze: MazeSpec, zoom: int) -> Viewport:
    """The window that shows all of a maze."""
    return Viewport(zoom, 0, 0, *maze_cells(maze, zoom), maze.height)
