"""Which part of the maze is drawn, and how large.

Lengths on the screen are in units: a unit is the width of a terminal column and half the height of
a row, which is square in nearly every font. A maze cell is `zoom` units wide and high.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.specs import CELL_SIZE, MazeSpec

LARGEST_ZOOM = 64.0
SMALLEST_ZOOM = 0.1
_WHOLE = 4.0
"""Zooms from here on are whole numbers of columns, so that all cells of the maze look alike."""
_STEP = 1.25
_FAR = 1e6
"""Units; places further out are drawn no differently and must not overflow an integer."""


@dataclass(frozen=True, slots=True)
class Viewport:
    """A window onto the maze: `columns` x `rows` terminal cells, the first of which is cell
    (`left`, `top`) counted from the maze's top-left corner. `maze_height` is in inches."""

    zoom: float
    left: int
    top: int
    columns: int
    rows: int
    maze_height: float

    @property
    def scale(self) -> float:
        """Units an inch."""
        return self.zoom / CELL_SIZE

    def to_units(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Global places (..., 2) in units of this window (..., 2), x right, y down."""
        units = np.empty(points.shape)
        units[..., 0] = points[..., 0] * self.scale - self.left
        units[..., 1] = (self.maze_height - points[..., 1]) * self.scale - 2 * self.top
        finite = np.nan_to_num(units, nan=_FAR, posinf=_FAR, neginf=-_FAR)
        within: NDArray[np.float64] = np.clip(finite, -_FAR, _FAR)
        return within

    def place(self, x: float, y: float) -> tuple[float, float]:
        """The unit coordinates of one global place."""
        units = self.to_units(np.array((x, y)))
        return float(units[0]), float(units[1])

    def to_inches(self, column: float, row: float) -> tuple[float, float]:
        """The global place (x, y) at a place of this window in terminal columns and rows."""
        return (column + self.left) / self.scale, self.maze_height - 2 * (row + self.top) / self.scale


def maze_cells(maze: MazeSpec, zoom: float) -> tuple[int, int]:
    """(columns, rows) of terminal cells that the whole maze takes."""
    # A sum that only rounding makes larger than a whole number needs no further cell.
    return math.ceil(maze.columns * zoom - 1e-6), math.ceil(maze.rows * zoom / 2 - 1e-6)


def whole_maze(maze: MazeSpec, zoom: float) -> Viewport:
    """The window that shows all of a maze."""
    return Viewport(zoom, 0, 0, *maze_cells(maze, zoom), maze.height)


def zoom_to_fit(maze: MazeSpec, columns: int, rows: int) -> float:
    """The largest zoom at which a whole maze takes no more than `columns` x `rows` cells."""
    most = max(SMALLEST_ZOOM, min(columns / maze.columns, 2 * rows / maze.rows))
    if most >= _WHOLE:
        return float(math.floor(most))
    return math.floor(2 * most) / 2 if most >= 1 else most


def next_zoom(zoom: float, step: int) -> float:
    """The zoom a step further in (1) or out (-1): a quarter more or less, in whole columns a cell,
    or halves of one for small cells."""
    wanted = zoom * _STEP**step
    if wanted >= 1:
        grain = 1.0 if wanted >= _WHOLE else 0.5
        near = round(wanted / grain) * grain
        beyond = math.floor(zoom / grain) + 1 if step > 0 else math.ceil(zoom / grain) - 1
        wanted = max(near, beyond * grain) if step > 0 else min(near, beyond * grain)
    return min(max(wanted, SMALLEST_ZOOM), LARGEST_ZOOM)
