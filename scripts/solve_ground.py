"""The maze for a route planner: cells, routes between them, and distances of walls."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim import MazeSpec

FloatArray = NDArray[np.float64]
Cell = tuple[int, int]  # column and row, (0, 0) at the bottom left
CELL = 12.0  # in
WALL = 0  # the value of a wall cell in maze.csv
ENOUGH = 1.0  # in, to the next wall; more is no better


class Ground:
    """Places in inches and cells of one maze."""

    def __init__(self, maze: MazeSpec) -> None:
        self._values = {
            (column, row): value
            for row, values in enumerate(reversed(maze.cells))
            for column, value in enumerate(values)
        }
        ring = [(column, row) for column in range(-1, maze.columns + 1) for row in range(-1, maze.rows + 1)]
        walls = [cell for cell in ring if not self.is_free(cell)]
        self._walls = (np.array(walls) + 0.5) * CELL

    def is_free(self, cell: Cell) -> bool:
        """True where a robot can be. Everything outside the maze is wall."""
        return self._values.get(cell, WALL) != WALL

    def cells(self, *values: int) -> list[Cell]:
        """The free cells, or those of certain values in maze.csv."""
        return [cell for cell, value in self._values.items() if value in values or (not values and value)]

    def neighbours(self, cell: Cell) -> list[Cell]:
        """The free cells on its four sides."""
        column, row = cell
        sides = ((column + 1, row), (column - 1, row), (column, row + 1), (column, row - 1))
        return [side for side in sides if self.is_free(side)]

    def beside(self, cells: Sequence[Cell]) -> set[Cell]:
        """The free cells around some others."""
        return {near for cell in cells for near in self.neighbours(cell)} - set(cells)

    def route(self, start: Cell, goal: Cell) -> list[Cell]:
        """A shortest path from start to goal, both included, from cell to neighbouring cell; empty if there
        is none.

        Breadth-first search, from the goal backwards: the path of the search to a cell is then the path from
        the cell to the goal.
        """
        if not self.is_free(goal):
            return []
        towards: dict[Cell, Cell] = {goal: goal}
        waiting = deque([goal])
        while waiting and start not in towards:
            cell = waiting.popleft()
            for near in self.neighbours(cell):
                if near not in towards:
                    towards[near] = cell
                    waiting.append(near)
        if start not in towards:
            return []
        way = [start]
        while way[-1] != goal:
            way.append(towards[way[-1]])
        return way

    def clearance(self, points: FloatArray) -> FloatArray:
        """Distances of (n, 2) points from the nearest wall, inches: (n,), 0 inside a wall."""
        beyond = np.abs(points[:, None, :] - self._walls[None, :, :]) - CELL / 2
        outside: FloatArray = np.hypot(*np.moveaxis(np.maximum(beyond, 0.0), 2, 0))
        return np.asarray(outside.min(axis=1))


class Body:
    """The body that must not touch a wall: the robot, a circle, and the block while it is held."""

    def __init__(self, ground: Ground, radius: float) -> None:
        self._ground = ground
        self.radius = radius
        self._corners: FloatArray = np.empty((0, 2))  # of the block, in the robot's frame

    @property
    def loaded(self) -> bool:
        return len(self._corners) > 0

    def take(self, pose: FloatArray, block: FloatArray, size: float) -> None:
        """Add a held block, parallel to the maze's walls, with its centre at a place, to the robot at a
        pose."""
        half = size / 2
        off = np.array([(x, y) for x in (-half, half) for y in (-half, half)]) + block - pose[:2]
        cos, sin = np.cos(np.radians(pose[2])), np.sin(np.radians(pose[2]))
        self._corners = off @ np.array(((cos, -sin), (sin, cos)))

    def room(self, places: FloatArray, headings: FloatArray) -> float:
        """Distances of the body from all walls, inches, at (n, 2) places with (n,) headings."""
        free = float(self._ground.clearance(places).min()) - self.radius
        if not self.loaded:
            return free
        cos, sin = np.cos(np.radians(headings))[:, None], np.sin(np.radians(headings))[:, None]
        x, y = self._corners.T
        corners = np.stack((cos * x - sin * y, sin * x + cos * y), axis=2) + places[:, None, :]
        return min(free, float(self._ground.clearance(corners.reshape(-1, 2)).min()))

    def room_ahead(self, start: FloatArray, end: FloatArray) -> float:
        """The same on the straight line from one place to another."""
        line = start + np.linspace(0.0, 1.0, 12)[:, None] * (end - start)
        way = end - start
        return self.room(line, np.full(12, np.degrees(np.arctan2(way[1], way[0]))))

    def room_to_turn(self, place: FloatArray, start: float, turn: float) -> float:
        """The same for a turn on the spot from a heading by `turn` degrees."""
        headings = start + np.linspace(0.0, turn, 2 + int(abs(turn) // 10))
        return self.room(np.tile(place, (len(headings), 1)), headings)

    def spot_to_turn(self, near: FloatArray, start: float, turn: float) -> FloatArray:
        """The nearest place around another with room enough for a turn."""
        steps = np.arange(-2.5, 2.6, 0.5)
        places = near + np.array([(x, y) for x in steps for y in steps])
        return max(
            places,
            key=lambda place: (
                min(self.room_to_turn(place, start, turn), ENOUGH) - 0.02 * float(np.hypot(*(place - near)))
            ),
        )


def cell_at(point: FloatArray) -> Cell:
    """The cell around a place."""
    return int(point[0] // CELL), int(point[1] // CELL)


def centre(cell: Cell) -> FloatArray:
    """The middle of a cell."""
    return (np.array(cell) + 0.5) * CELL
