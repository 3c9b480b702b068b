"""Mazes for trials: made at random like a given one, or read from a folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simmer_tui.config.leftovers import is_leftover
from simmer_tui.config.maze_csv import read_cells
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.specs import BLOCK, EMPTY, START, WALL, MazeSpec


def random_maze(like: MazeSpec, random: np.random.Generator) -> MazeSpec:
    """A maze of the same size with as many walls, start cells and block cells as `like`.

    Every free cell can be reached from every other, sideways and up and down. From an empty rectangle, cells
    drawn at random become walls if all others stay connected. The block cells are one connected area, the
    start cells are anywhere else. The floor is that of `like`.
    """
    counts = {value: sum(row.count(value) for row in like.cells) for value in (WALL, START, BLOCK)}
    ground = _Ground(like.rows, like.columns)
    pending = random.permutation(ground.cells).tolist()
    left = counts[WALL]
    if left == len(pending):
        return like
    while left:
        refused = []
        for cell in pending:
            if left and ground.can_spare(cell):
                ground.free[cell] = 0
                left -= 1
            else:  # by the next round it may be one that connects nothing
                refused.append(cell)
        pending = refused
    values = {cell: EMPTY if ground.free[cell] else WALL for cell in ground.cells}
    zone = ground.grown_area(counts[BLOCK], random)
    others = [cell for cell in ground.cells if ground.free[cell] and cell not in zone]
    starts = random.permutation(others)[: counts[START]].tolist()
    values |= dict.fromkeys(zone, BLOCK) | dict.fromkeys(starts, START)
    flat = [values[cell] for cell in ground.cells]
    rows = range(0, len(flat), like.columns)
    return MazeSpec(tuple(tuple(flat[begin : begin + like.columns]) for begin in rows), like.floor)


class _Ground:
    """Free cells in a frame of wall, all in one row: neighbours are 1 and `stride` apart."""

    def __init__(self, rows: int, columns: int) -> None:
        stride = columns + 2
        self.cells = [(row + 1) * stride + column + 1 for row in range(rows) for column in range(columns)]
        self.free = bytearray((rows + 2) * stride)
        for cell in self.cells:
            self.free[cell] = 1
        self._sides = (1, stride, -1, -stride)
        self._corners = (1 + stride, stride - 1, -1 - stride, 1 - stride)
        """`_corners[i]` lies between `_sides[i]` and the side after it."""

    def can_spare(self, cell: int) -> bool:
        """True if the other free cells stay connected without this one."""
        free = self.free
        sides = [free[cell + side] for side in self._sides]
        joined = sum(
            sides[i] and sides[(i + 1) % 4] and free[cell + corner] for i, corner in enumerate(self._corners)
        )
        if sum(sides) - joined <= 1:  # neighbours meet around the corners
            return True
        neighbours = {cell + side for side in self._sides if free[cell + side]}
        return self._connected(neighbours, cell)

    def _connected(self, wanted: set[int], without: int) -> bool:
        """True if some free cells are connected, by a search from each of them in turn."""
        groups = [({cell}, [cell]) for cell in wanted]
        while len(groups) > 1:
            seen, edge = groups.pop(0)
            if not edge:
                return False
            reached = {cell + side for cell in edge for side in self._sides}
            new = {cell for cell in reached if self.free[cell] and cell != without} - seen
            seen |= new
            edge = list(new)
            for other in [group for group in groups if not seen.isdisjoint(group[0])]:
                groups.remove(other)
                seen |= other[0]
                edge += other[1]
            groups.append((seen, edge))
        return True

    def grown_area(self, size: int, random: np.random.Generator) -> set[int]:
        """`size` connected free cells, grown from one drawn at random."""
        area: set[int] = set()
        edge = [int(random.choice([cell for cell in self.cells if self.free[cell]]))]
        while len(area) < size:
            cell = edge.pop(int(random.integers(len(edge))))
            area.add(cell)
            around = [cell + side for side in self._sides]
            edge += [each for each in around if self.free[each] and each not in area and each not in edge]
        return area


def maze_text(maze: MazeSpec) -> str:
    """The text of maze.csv for a maze."""
    return "".join(f"{','.join(map(str, row))}\n" for row in maze.cells)


def read_mazes(folder: Path) -> dict[str, MazeSpec]:
    """All mazes of a folder, files written as maze.csv is, by name in alphabetical order.

    Raises ConfigurationError with every mistake in any of them.
    """
    shown = str(folder)
    if not folder.is_dir():
        raise ConfigurationError([Problem("--mazes", f"{shown} is not a folder")])
    found = (path for path in folder.iterdir() if path.suffix.lower() == ".csv" and path.is_file())
    paths = sorted(path for path in found if not is_leftover(path.name))
    if not paths:
        raise ConfigurationError([Problem("--mazes", f"{shown} holds no .csv files")])
    problems: list[Problem] = []
    mazes = {}
    for path in paths:
        cells = read_cells(path, problems)
        if cells is not None:
            mazes[path.name] = MazeSpec(cells)
    if problems:
        raise ConfigurationError(problems)
    return mazes
