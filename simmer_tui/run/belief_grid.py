"""Beliefs that are grids: a probability for each cell and heading, and the numbers that follow from it.

Rows count from the top, columns from the left, headings from the first one counterclockwise.
"""

from __future__ import annotations

import math
from itertools import groupby
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct, field

from simmer_tui.sim.angles import MOST_HEADINGS, half_turn
from simmer_tui.sim.arrays import FloatArray, NDArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import CELL_SIZE, WALL, MazeSpec

MOST_STATES = 65_536
"""Most states of a grid, all headings counted: 1 in cells of the course's maze with 14 headings. As f32 they
take 341 kB of a line."""
MOST_ROWS = 1000
"""Most rows or columns: finer than a tenth of an inch."""
# An eighth of a doubling: off by 4 % at most, which moves the entropy by 0.01 bit.
STEPS_OF_HALVING = 8.0
"""Steps of a logged probability for each halving."""
RULED_OUT = 255
"""Logged probability of 0, and of less than 2**-31 of the largest."""
# In two dimensions this share is within three standard deviations: 1 - exp(-4.5).
SURELY_ELSEWHERE = 0.989
"""A belief that puts more than this into states likelier than the true one has lost the robot."""
# More decimals carry no information, and would be most of a log's line.
_DECIMALS = 6
# Few levels, since fine shades look the same on some backgrounds.
_LEAST = 0.5
"""A cell with less than this share of an even distribution over the free cells is ruled out."""
_STEP = 3.0
"""Ratio of the probabilities of one level and the next."""
_DOUBT = 1.5
"""Doublings of an even share that a level takes: a program that knows nothing shows one faint tint."""
# 2 in of the course's maze: on a page a cell is six points wide.
_PAGE_ROWS, _PAGE_COLUMNS = 24, 48
"""Most rows and columns of a map on a page."""
Levels = NDArray[np.uint8]
Probabilities = FloatArray
Bounds = tuple[float, float, float, float]
"""x0, y0, x1, y1, inches."""
_Size = Annotated[int, Meta(ge=1, le=MOST_ROWS)]
_Index = Annotated[int, Meta(ge=0)]
_Probability = Annotated[float, Meta(ge=0, le=1)]
_Positive = Annotated[float, Meta(ge=0, le=1e13)]
_Place = Annotated[float, Meta(ge=-1e12, le=1e12)]


class GridBelief(Struct, frozen=True, gc=False, omit_defaults=True):
    """A grid, packed, and the numbers that follow from it and from the true pose. A run log holds the same.

    Attributes:
        best: row, column and heading of the most probable state, from 0.
        entropy: bits.
        spread: root of the mean squared distance from the best cell, inches.
        turn_spread: standard deviation of the heading about the best one, degrees; 0 without headings.
        best_probability: its probability.
        true_probability: probability of the state that the robot is in, 0 outside the grid.
        above: probability of all states likelier than the true one and each of its neighbours.
        cells: probabilities as `log8`, heading fastest, then column; empty where a log left them out.
    """

    rows: _Size
    columns: _Size = field(name="cols")
    bounds: tuple[_Place, _Place, _Place, _Place]
    best: tuple[_Index, _Index, _Index]
    entropy: _Positive
    spread: _Positive
    best_probability: _Probability = field(name="p_best")
    true_probability: _Probability = field(name="p_true")
    above: _Probability
    headings: Annotated[int, Meta(ge=1, le=MOST_HEADINGS)] = 1
    first: _Place = 0.0
    turn_spread: Annotated[float, Meta(ge=0, le=180)] = 0.0
    cells: bytes = field(default=b"", name="log8")

    def __post_init__(self) -> None:
        # Logs come from elsewhere too, and the code that draws a grid relies on these bounds.
        x0, y0, x1, y1 = self.bounds
        if not (x0 < x1 and y0 < y1):
            raise ValueError("bounds of a grid must be increasing")
        if self.states > MOST_STATES or (self.cells and len(self.cells) != self.states):
            raise ValueError(f"a grid has {MOST_STATES} states at most, and a byte for each")
        if any(at >= size for at, size in zip(self.best, self.shape, strict=True)):
            raise ValueError("the best state lies outside the grid")

    @property
    def shape(self) -> tuple[int, int, int]:
        """Rows, columns, headings."""
        return self.rows, self.columns, self.headings

    @property
    def states(self) -> int:
        return self.rows * self.columns * self.headings

    @property
    def has_headings(self) -> bool:
        """True if the grid covers the heading too."""
        return self.headings > 1

    @property
    def cell_size(self) -> tuple[float, float]:
        """Width and height of a cell, inches."""
        x0, y0, x1, y1 = self.bounds
        return (x1 - x0) / self.columns, (y1 - y0) / self.rows

    @property
    def best_pose(self) -> Pose:
        """Middle of the most probable state; the heading is the first one where there are no others."""
        row, column, heading = self.best
        width, height = self.cell_size
        x0, _, _, y1 = self.bounds
        turned = self.first + 360.0 * heading / self.headings
        return Pose(x0 + (column + 0.5) * width, y1 - (row + 0.5) * height, half_turn(turned))

    @property
    def best_place(self) -> tuple[float, float, float]:
        """Middle of the most probable cell, inches, and its probability: all headings together, as in a
        picture. Of the most probable state where a log left the cells out."""
        if not (self.cells and self.has_headings):
            return self.best_pose.x, self.best_pose.y, self.best_probability
        places, (width, height) = self.places(), self.cell_size
        row, column = divmod(int(places.argmax()), self.columns)
        x0, _, _, y1 = self.bounds
        return x0 + (column + 0.5) * width, y1 - (row + 0.5) * height, float(places[row, column])

    def places(self) -> Probabilities:
        """Probability of each cell, all its headings together, (rows, columns): of those that are logged."""
        levels = np.frombuffer(self.cells, dtype=np.uint8).reshape(self.shape)
        shares = _OF_LEVEL[levels].sum(axis=2)
        found: Probabilities = shares / shares.sum()
        return found


_OF_LEVEL = np.exp2(-np.arange(RULED_OUT + 1) / STEPS_OF_HALVING)
"""Probability of each logged byte, as a share of the largest."""
_OF_LEVEL[RULED_OUT] = 0.0


def grid_belief(probabilities: Probabilities, bounds: Bounds, first: float, true: Pose) -> GridBelief:
    """The belief of a grid.

    Args:
        probabilities: (rows, columns, headings), finite, none negative, not all 0; of any sum.
        first: the first heading, degrees.
        true: the robot's pose then.
    """
    rows, columns, headings = shape = probabilities.shape
    # Divided by the largest first: the sum of numbers near the largest float would be infinite.
    shares = probabilities / probabilities.max()
    total = float(shares.sum())
    # Below 2**-31 the log has 0, and a smaller share adds far less to the entropy than its digits show.
    logs = np.log2(np.maximum(shares, 1e-300))
    levels = np.minimum(np.rint(-STEPS_OF_HALVING * logs), RULED_OUT).astype(np.uint8)
    given = shares / total
    best = tuple(int(each) for each in np.unravel_index(int(shares.argmax()), shape))
    x0, y0, x1, y1 = bounds
    width, height = (x1 - x0) / columns, (y1 - y0) / rows
    places = given.sum(axis=2)
    away = (
        places.sum(axis=0) @ ((np.arange(columns) - best[1]) * width) ** 2
        + places.sum(axis=1) @ ((np.arange(rows) - best[0]) * height) ** 2
    )
    step = 360.0 / headings
    turns = half_turn((np.arange(headings) - best[2]) * step)
    turned = float(given.sum(axis=(0, 1)) @ turns**2)
    state = _state_of(true, shape, bounds, first)
    peak = _largest_near(given, state)
    at_truth = float(given[state]) if _inside(state, shape) else 0.0
    return GridBelief(
        rows,
        columns,
        bounds,
        (best[0], best[1], best[2]),
        _rounded(math.log2(total) - float((given * logs).sum())),
        _rounded(math.sqrt(float(away))),
        min(_rounded(float(given.max())), 1.0),
        min(_rounded(at_truth), 1.0),
        min(_rounded(float(given[given > peak].sum())), 1.0),
        headings,
        first,
        _rounded(math.sqrt(turned)),
        levels.tobytes(),
    )


def _rounded(value: float) -> float:
    # The entropy of one sure state may come out as -1e-17.
    return round(max(value, 0.0), _DECIMALS) + 0.0


def _state_of(pose: Pose, shape: tuple[int, ...], bounds: Bounds, first: float) -> tuple[int, int, int]:
    """Row, column and heading of a pose; row and column may lie outside."""
    rows, columns, headings = shape
    x0, y0, x1, y1 = bounds
    row = math.floor((y1 - pose.y) * rows / (y1 - y0))
    column = math.floor((pose.x - x0) * columns / (x1 - x0))
    return row, column, round((pose.heading - first) * headings / 360.0) % headings


def _inside(state: tuple[int, int, int], shape: tuple[int, ...]) -> bool:
    return 0 <= state[0] < shape[0] and 0 <= state[1] < shape[1]


def _largest_near(given: Probabilities, state: tuple[int, int, int]) -> float:
    """Largest probability of a state and its neighbours: the 8 cells around, the headings to both sides."""
    row, column, heading = state
    rows = slice(max(row - 1, 0), max(row + 2, 0))
    columns = slice(max(column - 1, 0), max(column + 2, 0))
    near = given[rows, columns].take((heading - 1, heading, heading + 1), axis=2, mode="wrap")
    return float(near.max()) if near.size else 0.0


# -- as a map --------------------------------------------------------------------------------------


def heat_levels(shares: FloatArray, most: float, even: float) -> Levels:
    """Level of each probability: 0 ruled out, 1 possible, 2 likely, 3 most likely.

    Args:
        most: the largest probability.
        even: as `even_share` has it.
    """
    with np.errstate(divide="ignore"):
        doubt = np.maximum(1 + np.floor(np.log2(shares / even) / _DOUBT), 1)
    steps = 1 + (shares > most / _STEP**2).astype(np.uint8) + (shares > most / _STEP)
    return np.where(shares < _LEAST * even, 0, np.minimum(steps, doubt)).astype(np.uint8)


def covered(edges: FloatArray, count: int) -> FloatArray:
    """Share of each interval between two edges that lies in each of `count` cells, (intervals, count)."""
    cells = np.arange(count)
    low = np.maximum(edges[:-1, None], cells)
    high = np.minimum(edges[1:, None], cells + 1)
    parts: FloatArray = np.maximum(high - low, 0.0) / np.diff(edges)[:, None]
    return parts


def even_share(grid: GridBelief, maze: MazeSpec) -> float:
    """Probability of each free cell if all were the same: of those whose middle lies in an open cell of the
    maze."""
    rows, columns = grid.rows, grid.columns
    x0, y0, x1, y1 = grid.bounds
    x = x0 + (np.arange(columns) + 0.5) * (x1 - x0) / columns
    y = maze.height - y1 + (np.arange(rows) + 0.5) * (y1 - y0) / rows
    column = np.floor(x / CELL_SIZE).clip(-1, maze.columns).astype(np.intp) + 1
    row = np.floor(y / CELL_SIZE).clip(-1, maze.rows).astype(np.intp) + 1
    closed = np.pad(np.array(maze.cells) == WALL, 1, constant_values=True)
    return 1.0 / max(int((~closed[np.ix_(row, column)]).sum()), 1)


class SmallMap(Struct, frozen=True, gc=False):
    """Levels of a grid in few cells, as runs: `a12b3d` are 12 cells ruled out, 3 possible, 1 most likely."""

    rows: int
    columns: int
    runs: str


def small_map(grid: GridBelief, maze: MazeSpec) -> SmallMap:
    """The map of a grid for a page that has thousands of them. The grid has its cells."""
    rows, columns = min(grid.rows, _PAGE_ROWS), min(grid.columns, _PAGE_COLUMNS)
    down = covered(np.linspace(0.0, grid.rows, rows + 1), grid.rows)
    across = covered(np.linspace(0.0, grid.columns, columns + 1), grid.columns)
    shares = down @ grid.places() @ across.T
    levels = heat_levels(shares, float(shares.max()), even_share(grid, maze))
    text = "".join("abcd"[level] for level in levels.ravel().tolist())
    runs = (f"{name}{length}" if (length := len(list(each))) > 1 else name for name, each in groupby(text))
    return SmallMap(rows, columns, "".join(runs))
