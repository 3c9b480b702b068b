"""Heat: the levels and numbers of a grid's belief in the pixels and cells of a window.

There are few levels, since fine shades look alike on some grounds. From 2 % on a number is shown too.
"""

import math

import numpy as np
from msgspec import Struct

from simmer_tui.run.belief_grid import GridBelief, Levels, Probabilities, covered, even_share, heat_levels
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.specs import MazeSpec
from simmer_tui.tui.maze.viewport import Viewport

# A belief changes slightly with every reading, and each change of a level sends a part of the map.
_HELD = 1.15
"""Factor by which a probability has to pass a threshold before its level changes."""
HEAT_PERIOD = 0.5
"""Simulated seconds between two maps of a robot that drives."""
# "100%", and as wide a gap to the number of the next cell.
_NUMBER_COLUMNS = 8.0
"""Columns of a grid's cell from which its number is shown."""
LEAST_SHOWN_SHARE = 0.02
# A belief that has seen nothing is even, but for rounding.
_STANDS_OUT = 1.5
"""Times the probability of an even belief from which a cell counts as the most likely."""


class HeatMark(Struct, frozen=True, eq=False):
    """A grid to be drawn, the time at which it came (simulated seconds), and True if the robot stands."""

    grid: GridBelief
    time: float
    stands: bool = True


class HeatNumber(Struct, frozen=True):
    """A number of a grid's cell, and the cell of the window that its last digit stands in."""

    row: int
    column: int
    text: str


class HeatPeak(Struct, frozen=True):
    """The most likely cell of a grid: the cell of the window in which its middle is, and its percentage;
    none where cells have room for their own."""

    row: int
    column: int
    text: str


class HeatMap:
    """The levels of one window from grid to grid: a new map changes as few of them as possible."""

    def __init__(self) -> None:
        self._mark: HeatMark | None = None
        self._frame: object = None
        self._levels: Levels = np.zeros((0, 0), dtype=np.uint8)

    def shown(self, mark: HeatMark) -> HeatMark:
        """The mark to draw: the previous one, until it is time for another."""
        old = self._mark
        if old is not None and old.grid is not mark.grid:
            is_early = not mark.stands and 0.0 <= mark.time - old.time < HEAT_PERIOD
            same_grid = (old.grid.shape, old.grid.bounds) == (mark.grid.shape, mark.grid.bounds)
            return (
                old
                if is_early and same_grid and old.grid.best_place[:2] == mark.grid.best_place[:2]
                else mark
            )
        return mark if old is None else old

    def levels(self, mark: HeatMark, maze: MazeSpec, viewport: Viewport, across: int, down: int) -> Levels:
        """Level of each pixel of the window, (rows * down, columns * across)."""
        grid = mark.grid
        frame = (viewport, across, down, grid.shape, grid.bounds)
        shares, most = _shares(grid, viewport, across, down)
        even = even_share(grid, maze)
        if frame != self._frame:
            levels = heat_levels(shares, most, even)
        else:
            low, high = heat_levels(shares / _HELD, most, even), heat_levels(shares * _HELD, most, even)
            levels = np.clip(self._levels, low, high)
        self._mark, self._frame, self._levels = mark, frame, levels
        return levels


def heat_numbers(grid: GridBelief, viewport: Viewport, *, tinted: bool) -> list[HeatNumber]:
    """Percentages of the cells that have room for them. Without tints smaller cells have tenths."""
    places, (width, height) = grid.places(), grid.cell_size
    x0, _, _, y1 = grid.bounds
    in_full = _has_room(grid, viewport)
    wide, high = width * viewport.scale, height * viewport.scale / 2
    if wide < 1.0 or high < 1.0 or (tinted and not in_full):
        return []
    found = []
    for row, column in np.argwhere(places >= (LEAST_SHOWN_SHARE if in_full else 0.1)).tolist():
        share = float(places[row, column])
        text = f"{100 * share:.0f}%" if in_full else f"{min(int(10 * share + 1e-9), 9)}"
        # The lower right corner, from within.
        right, bottom = viewport.place(x0 + (column + 1) * width, y1 - (row + 1) * height)
        at = HeatNumber(math.ceil(bottom / 2) - 1, math.ceil(right) - 1, text)
        if 0 <= at.row < viewport.rows and len(text) <= at.column + 1 <= viewport.columns:
            found.append(at)
    return found


def stands_out(grid: GridBelief, maze: MazeSpec) -> bool:
    """True if one cell is more likely than those of an even belief."""
    return grid.best_place[2] >= _STANDS_OUT * even_share(grid, maze)


def peak_of(grid: GridBelief, maze: MazeSpec, viewport: Viewport) -> HeatPeak | None:
    """The most likely cell; None while none stands out."""
    if not stands_out(grid, maze):
        return None
    x, y, share = grid.best_place
    middle, line = viewport.place(x, y)
    text = "" if _has_room(grid, viewport) else f"{100 * share:.0f}%"
    return HeatPeak(math.floor(line / 2), math.floor(middle), text)


def _has_room(grid: GridBelief, viewport: Viewport) -> bool:
    """True if a grid's cells have room for their percentages."""
    return grid.cell_size[0] * viewport.scale >= _NUMBER_COLUMNS


def _shares(grid: GridBelief, viewport: Viewport, across: int, down: int) -> tuple[FloatArray, float]:
    """Probability of a grid's cell at each pixel of the window, by the areas of the cells that a pixel
    covers; and the largest. Outside the grid it is 0."""
    x0, y0, x1, y1 = grid.bounds
    places = grid.places()
    left = (viewport.left + np.arange(viewport.columns * across + 1) / across) / viewport.scale
    lines = viewport.top + np.arange(viewport.rows * down + 1) / down
    top = viewport.maze_height - 2 * lines / viewport.scale
    columns = (left - x0) * grid.columns / (x1 - x0)
    rows = (y1 - top) * grid.rows / (y1 - y0)
    shares: Probabilities = covered(rows, grid.rows) @ places @ covered(columns, grid.columns).T
    # Pixels larger than cells have the mean of several, and may not reach the largest.
    is_coarse = columns[1] - columns[0] > 1.0 or rows[1] - rows[0] > 1.0
    most = float(shares.max()) if is_coarse else float(places.max())
    return shares, most or 1.0
