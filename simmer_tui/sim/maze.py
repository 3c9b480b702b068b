"""The maze as the sensors see it: a grid of wall cells and a floor of black and white tiles."""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from simmer_tui.sim.arrays import BoolArray, FloatArray, NDArray
from simmer_tui.sim.specs import CELL_SIZE, EMPTY, TILE_SIZE, TILES_PER_CELL, WALL, MazeSpec

Rays = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Many rays: X and Y of their origins (inches), and of their directions as unit vectors, (n,) each."""

FLOOR_SEED = 5489
"""Seed of the course's floor pattern: MATLAB's default state of the Mersenne twister."""
ON_WALL = 1e-6
"""A sensor this close to a wall, inches, is on it."""
# Beyond this distance from the lines between cells, inches, only a point's own cell matters.
_FROM_LINE = 2e-6
_TO_LINE = CELL_SIZE - _FROM_LINE
# Twice `ON_WALL`, so that rounding in the cell's number cannot skip the exact test.
_FROM_MIDDLE = CELL_SIZE / 2 - _FROM_LINE
# Judged: an entrance and an exit. Smaller mazes have too few cells to know.
_OPENINGS, _LEAST_SIDE = 2, 4
"""Most openings in the outer wall of another course's maze, and its least cells a side."""
# Rays that are cast at once: some ten arrays of 64 KB stay in a processor's cache.
_CHUNK = 8192


def generated_floor(rows: int, columns: int) -> NDArray[np.uint8]:
    """The course's floor for a maze of `rows` by `columns` cells: (4 rows, 4 columns) tiles, the
    first row on top, 0 black, 1 white.

    Equals MATLAB's `rng(5489,'twister'); randi([0 1],512,1)`, filled column by column.
    """
    shape = (rows * TILES_PER_CELL, columns * TILES_PER_CELL)
    # NumPy's old generator is the same Mersenne twister as MATLAB's, and draws the same doubles.
    draws = np.random.RandomState(FLOOR_SEED).random_sample(shape[0] * shape[1])
    return np.floor(2 * draws).astype(np.uint8).reshape(shape, order="F")


def chosen_rays(rays: Rays, chosen: slice | NDArray[Any]) -> Rays:
    """Some of many rays: those of a slice, a mask, or numbers."""
    x, y, dx, dy = rays
    return x[chosen], y[chosen], dx[chosen], dy[chosen]


def looks_inverted(spec: MazeSpec) -> bool:
    """True if a maze seems to have 1 for a wall, as files of other courses do: its outer cells are 1, and
    those of other values inside are one area of a third of the inner cells or more."""
    cells = np.array(spec.cells)
    if min(cells.shape) < _LEAST_SIDE:
        return False
    inner = cells[1:-1, 1:-1] != EMPTY
    openings = np.count_nonzero(cells != EMPTY) - np.count_nonzero(inner)
    if openings > _OPENINGS or 3 * np.count_nonzero(inner) < inner.size or not (cells == WALL).any():
        return False
    corridors = {(int(row), int(column)) for row, column in zip(*inner.nonzero(), strict=True)}
    edge = [corridors.pop()]
    while edge:
        row, column = edge.pop()
        around = ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1))
        edge += corridors.intersection(around)
        corridors.difference_update(around)
    return not corridors


class Maze:
    """Walls and floor, ready for ray casts. Nothing here changes after construction.

    `walls` is the (rows + 2, columns + 2) grid of wall cells, the bottom row first, with a ring of
    wall around it: the outside is wall.
    """

    def __init__(self, spec: MazeSpec) -> None:
        self.spec = spec
        self.width, self.height = spec.width, spec.height
        # Files have the first row on top, coordinates begin at the bottom.
        cells = np.array(spec.cells)[::-1]
        self.walls: BoolArray = np.pad(cells == WALL, 1, constant_values=True)
        self._stride = spec.columns + 2
        self._flat = self.walls.ravel()
        self._cells = self._flat.tobytes()

    @cached_property
    def tiles(self) -> NDArray[np.uint8]:
        """The floor, (4 rows, 4 columns), as in `MazeSpec.floor`."""
        if self.spec.floor is None:
            return generated_floor(self.spec.rows, self.spec.columns)
        return np.array(self.spec.floor, dtype=np.uint8)

    @cached_property
    def _black(self) -> BoolArray:
        return np.pad(self.tiles[::-1] == 0, 1, constant_values=False)

    def is_wall(self, x: float, y: float) -> bool:
        """True if a point (inches) lies on, within 1e-6 in of, or inside a wall, or outside."""
        if not (ON_WALL < x < self.width - ON_WALL and ON_WALL < y < self.height - ON_WALL):
            return True
        # Most points are far from any line between cells and need one look.
        column, row = int(x / CELL_SIZE), int(y / CELL_SIZE)
        from_left, from_bottom = x - column * CELL_SIZE, y - row * CELL_SIZE
        if _FROM_LINE < from_left < _TO_LINE and _FROM_LINE < from_bottom < _TO_LINE:
            return bool(self._cells[(row + 1) * self._stride + column + 1])
        # Near a line the cells on both sides count, near a crossing all four.
        left, right = int((x - ON_WALL) // CELL_SIZE) + 1, int((x + ON_WALL) // CELL_SIZE) + 1
        below, above = int((y - ON_WALL) // CELL_SIZE) + 1, int((y + ON_WALL) // CELL_SIZE) + 1
        cells, stride = self._cells, self._stride
        return bool(
            cells[below * stride + left]
            or cells[below * stride + right]
            or cells[above * stride + left]
            or cells[above * stride + right]
        )

    def cast(self, x: float, y: float, dx: float, dy: float) -> float:
        """Distance, inches, from (x, y) along the unit vector (dx, dy) to the first wall met.

        The origin must not be on a wall (`is_wall`). A ray that touches a wall's corner or runs
        along its face meets it.
        """
        (distance,) = self.cast_fan(x, y, ((dx, dy),))
        return distance

    def cast_fan(self, x: float, y: float, directions: Sequence[tuple[float, float]]) -> list[float]:
        """`cast` for several unit vectors from one place."""
        column, row = math.floor(x / CELL_SIZE), math.floor(y / CELL_SIZE)
        distances = self._march(x, y, directions, column, row)
        if x == column * CELL_SIZE or y == row * CELL_SIZE:
            # Along a grid line both sides count.
            for index, (dx, dy) in enumerate(directions):
                if dx == 0.0 and x == column * CELL_SIZE:
                    other_side = self._march(x, y, ((dx, dy),), column - 1, row)
                elif dy == 0.0 and y == row * CELL_SIZE:
                    other_side = self._march(x, y, ((dx, dy),), column, row - 1)
                else:
                    continue
                distances[index] = min(distances[index], other_side[0])
        return distances

    def _march(
        self, x: float, y: float, directions: Sequence[tuple[float, float]], column: int, row: int
    ) -> list[float]:
        """Walks from grid line to grid line (Amanatides and Woo, "A fast voxel traversal algorithm
        for ray tracing", 1987)."""
        cells, stride = self._cells, self._stride
        start = (row + 1) * stride + column + 1
        to_left, to_right = column * CELL_SIZE - x, (column + 1) * CELL_SIZE - x
        to_bottom, to_top = row * CELL_SIZE - y, (row + 1) * CELL_SIZE - y
        distances = []
        for dx, dy in directions:
            cell = start
            if dx > 0.0:
                step_x, period_x, next_x = 1, CELL_SIZE / dx, to_right / dx
            elif dx < 0.0:
                step_x, period_x, next_x = -1, -CELL_SIZE / dx, to_left / dx
            else:
                step_x, period_x, next_x = 0, math.inf, math.inf
            if dy > 0.0:
                step_y, period_y, next_y = stride, CELL_SIZE / dy, to_top / dy
            elif dy < 0.0:
                step_y, period_y, next_y = -stride, -CELL_SIZE / dy, to_bottom / dy
            else:
                step_y, period_y, next_y = 0, math.inf, math.inf
            while True:
                if next_x < next_y:
                    cell += step_x
                    if cells[cell]:
                        distances.append(next_x)
                        break
                    next_x += period_x
                elif next_y < next_x:
                    cell += step_y
                    if cells[cell]:
                        distances.append(next_y)
                        break
                    next_y += period_y
                else:
                    # Through a corner: any of the three cells beyond stops it.
                    if cells[cell + step_x] or cells[cell + step_y] or cells[cell + step_x + step_y]:
                        distances.append(next_x)
                        break
                    cell += step_x + step_y
                    next_x += period_x
                    next_y += period_y
        return distances

    def are_walls(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """`is_wall` for arrays of points, both (n,)."""
        # Points outside are moved to a corner, so that no index leaves the grid. They count as wall below.
        inside = (x > ON_WALL) & (x < self.width - ON_WALL) & (y > ON_WALL) & (y < self.height - ON_WALL)
        x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
        column, row = np.floor(x / CELL_SIZE), np.floor(y / CELL_SIZE)
        walls = self._flat[((row + 1.0) * self._stride + column + 1.0).astype(np.intp)]
        from_left, from_bottom = x - column * CELL_SIZE, y - row * CELL_SIZE
        near = np.abs(from_left - CELL_SIZE / 2) > _FROM_MIDDLE
        near |= np.abs(from_bottom - CELL_SIZE / 2) > _FROM_MIDDLE
        for index in np.flatnonzero(near & inside).tolist():
            walls[index] = self.is_wall(float(x[index]), float(y[index]))
        walls |= ~inside
        return walls

    def has_walls(self, low: tuple[float, float], high: tuple[float, float]) -> bool:
        """False if no point of a box (inches) is a wall as `is_wall` has it; True if one is, or may be."""
        if not (ON_WALL < low[0] <= high[0] < self.width - ON_WALL):
            return True
        if not (ON_WALL < low[1] <= high[1] < self.height - ON_WALL):
            return True
        # Slightly more than the distance from a line at which `is_wall` tests both cells.
        left, below = (int((each - _FROM_LINE) // CELL_SIZE) + 1 for each in low)
        right, above = (int((each + _FROM_LINE) // CELL_SIZE) + 1 for each in high)
        return bool(self.walls[below : above + 1, left : right + 1].any())

    def cast_many(self, x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray) -> FloatArray:
        """`cast` for many rays at once, all arrays (n,); the same numbers bit for bit.

        Origins on a wall or outside give 0.
        """
        distances = np.zeros(len(x))
        for begin in range(0, len(x), _CHUNK):
            # A chunk's arrays stay in the cache.
            part = slice(begin, begin + _CHUNK)
            rays = chosen_rays((x, y, dx, dy), part)
            on_wall = self.are_walls(x[part], y[part])
            if on_wall.any():
                free = np.flatnonzero(~on_wall)
                distances[begin + free] = self.cast_free(chosen_rays(rays, free))
            else:
                distances[part] = self.cast_free(rays)
        return distances

    def cast_free(self, rays: Rays) -> FloatArray:
        """`cast_many` for origins that are known to be on no wall."""
        x, y, dx, dy = rays
        column, row = np.floor(x / CELL_SIZE), np.floor(y / CELL_SIZE)
        distances = self._march_many(rays, column, row)
        upright = (dx == 0.0) & (x == column * CELL_SIZE)
        level = (dy == 0.0) & (y == row * CELL_SIZE)
        for along, left, down in ((upright, 1, 0), (level, 0, 1)):
            if along.any():
                beside = chosen_rays(rays, along)
                other_side = self._march_many(beside, column[along] - left, row[along] - down)
                distances[along] = np.minimum(distances[along], other_side)
        return distances

    def _march_many(self, rays: Rays, column: FloatArray, row: FloatArray) -> FloatArray:
        (x, y, dx, dy), walls = rays, self._flat
        distances = np.empty(len(x))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            # A direction of 0 divides by 0 on purpose: the next line of such a ray is at infinity.
            period_x, period_y = np.abs(CELL_SIZE / dx), np.abs(CELL_SIZE / dy)
            next_x = np.where(dx == 0.0, np.inf, ((column + (dx > 0.0)) * CELL_SIZE - x) / dx)
            next_y = np.where(dy == 0.0, np.inf, ((row + (dy > 0.0)) * CELL_SIZE - y) / dy)
        step_x = np.sign(dx).astype(np.intp)
        step_y = np.sign(dy).astype(np.intp) * self._stride
        cell = (row.astype(np.intp) + 1) * self._stride + column.astype(np.intp) + 1
        index = np.arange(len(x))
        while len(index):
            by_x, by_y = next_x <= next_y, next_y <= next_x
            distance = np.minimum(next_x, next_y)
            corner = by_x & by_y
            ahead = cell + by_x * step_x + by_y * step_y
            stopped = walls[ahead]
            if corner.any():
                beside = walls[cell + step_x] | walls[cell + step_y]
                stopped = stopped | (corner & beside)
            distances[index[stopped]] = distance[stopped]
            # Rays that have ended are left out of the next step, so that the arrays shrink.
            going = np.flatnonzero(~stopped)
            by_x, by_y, index, cell = by_x[going], by_y[going], index[going], ahead[going]
            step_x, step_y = step_x[going], step_y[going]
            period_x, period_y = period_x[going], period_y[going]
            next_x = np.where(by_x, next_x[going] + period_x, next_x[going])
            next_y = np.where(by_y, next_y[going] + period_y, next_y[going])
        return distances

    def incidence(
        self, x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, distances: FloatArray
    ) -> FloatArray:
        """Cosines of the angles between rays and the normals of the faces they end on, all arrays
        (n,): |dx| on an upright face, |dy| on a level one, the greater at a wall's corner."""
        steps_x, steps_y = (x + distances * dx) / CELL_SIZE, (y + distances * dy) / CELL_SIZE
        lines_x, lines_y = np.rint(steps_x), np.rint(steps_y)
        # A ray ends on the nearer of the two lines between cells.
        off_x, off_y = np.abs(steps_x - lines_x), np.abs(steps_y - lines_y)
        across, along = np.abs(dx), np.abs(dy)
        cosines = np.where(off_x < off_y, across, along)
        for index in np.flatnonzero(np.maximum(off_x, off_y) < ON_WALL / CELL_SIZE).tolist():
            # Where lines cross, the cells beside the ray's own decide which faces there are.
            column = int(lines_x[index]) + int(dx[index] < 0.0)
            row = int(lines_y[index]) + int(dy[index] < 0.0)
            upright = self.walls[row, column + (1 if dx[index] > 0.0 else -1)]
            level = self.walls[row + (1 if dy[index] > 0.0 else -1), column]
            if upright == level or not (across[index] and along[index]):
                cosines[index] = max(across[index], along[index])
            else:
                cosines[index] = across[index] if upright else along[index]
        return cosines

    def black(self, points: FloatArray) -> BoolArray:
        """True for each of the (n, 2) points that is on, or at the edge of, a black tile. The outside is not
        black."""
        scaled = points / TILE_SIZE
        high = np.floor(scaled)
        rows, columns = self._black.shape
        limit = (columns - 1.0, rows - 1.0)
        # Two ufuncs: a line sensor asks thousands of times a second, and np.clip takes twice as long.
        upper = np.minimum(np.maximum(high + 1.0, 0.0), limit).astype(np.intp)
        black = self._black[upper[:, 1], upper[:, 0]]
        if (high == scaled).any():
            # On an edge the tiles on both sides count.
            lower = np.minimum(np.maximum(np.ceil(scaled), 0.0), limit).astype(np.intp)
            black = (
                black
                | self._black[lower[:, 1], lower[:, 0]]
                | self._black[lower[:, 1], upper[:, 0]]
                | self._black[upper[:, 1], lower[:, 0]]
            )
        return black
