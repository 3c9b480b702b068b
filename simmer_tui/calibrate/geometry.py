"""Geometry of many poses at once: the drive law in closed form, and distances from walls.

A movement of totals (x, y, r) is cut into n parts, each of which turns by r / n and then goes (x, y) / n
in its new frame (sim/motion.py). Rotations in a plane commute, so all parts together go c(r) (x, y), with
(x, y) as a complex number and c(r) = sum over k from 1 to n of exp(i k r / n) / n.
"""

from __future__ import annotations

import numpy as np

from simmer_tui.sim.arrays import FloatArray, NDArray
from simmer_tui.sim.specs import CELL_SIZE, WALL, Axes, MazeSpec, RobotSpec

ComplexArray = NDArray[np.complex128]


def on_axes(axes: Axes) -> FloatArray:
    """The numbers for x, y and rotation, (3,)."""
    return np.array((axes.x, axes.y, axes.r))


def chord_factor(turn: FloatArray, segments: int | FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """c(r) for (m,) turns in degrees, and its derivative by a degree; `segments` is one number for all, or
    one for each.

    The geometric sum is sin(r / 2) / (n sin(r / 2n)) exp(i r (n + 1) / 2n).
    """
    half = np.radians(turn) / 2
    n = np.asarray(segments, float)
    below = n * np.sin(half / n)
    # Near a straight line, the first terms of the series: at 1e-4 the next one is 1e-16.
    straight = np.abs(below) < 1e-4
    safe = np.where(straight, 1.0, below)
    length = np.where(straight, 1.0 - half**2 * (1 - 1 / n**2) / 6, np.sin(half) / safe)
    slope = np.where(
        straight, -half * (1 - 1 / n**2) / 6, (np.cos(half) - length * np.cos(half / n)) / (2 * safe)
    )
    mean = (n + 1) / (2 * n)
    direction = np.exp(2j * half * mean)
    return length * direction, (slope + 1j * mean * length) * direction * (np.pi / 180.0)


def displacements(totals: FloatArray, segments: int | FloatArray) -> ComplexArray:
    """Displacements, (m,), in the frame of the start, by (m, 3) totals of x, y (inches) and r (degrees)."""
    return chord_factor(totals[:, 2], segments)[0] * (totals[:, 0] + 1j * totals[:, 1])


def moved(
    poses: FloatArray, totals: FloatArray, segments: int | FloatArray, bend: complex | ComplexArray = 0.0
) -> FloatArray:
    """The poses, (m, 3), to which totals lead from (m, 3) poses in free space. `bend` is the distance between
    the ends of a path that is not an arc and of the arc, in the frame of the start."""
    offset = (displacements(totals, segments) + bend) * np.exp(1j * np.radians(poses[:, 2]))
    return np.column_stack((poses[:, 0] + offset.real, poses[:, 1] + offset.imag, poses[:, 2] + totals[:, 2]))


def totals_between(
    before: FloatArray, after: FloatArray, segments: int | FloatArray, bend: complex | ComplexArray = 0.0
) -> FloatArray:
    """The totals, (m, 3), that lead from poses to poses in free space: the inverse of `moved`."""
    turn = after[:, 2] - before[:, 2]
    offset = (after[:, 0] - before[:, 0]) + 1j * (after[:, 1] - before[:, 1])
    offset = offset * np.exp(-1j * np.radians(before[:, 2])) - bend
    local = offset / chord_factor(turn, segments)[0]
    return np.column_stack((local.real, local.imag, turn))


_OUTLINE = 6
"""Points tested on each side of a polygon: an inch apart on a robot of 6 in, so that no corner of a wall can
be deeper than half an inch between two."""
SHARES = np.arange(1, 9) / 8
"""Shares of a path at which it is tested for walls: an inch or two apart on the movements of a course."""


class Clearance:
    """Distances of a robot's outline from walls, negative inside one."""

    def __init__(self, maze: MazeSpec, robot: RobotSpec) -> None:
        # A ring of walls around the maze represents its outside. It is two cells wide, so that all neighbours
        # of a cell inside exist.
        self._walls = np.pad(np.array(maze.cells)[::-1] == WALL, 2, constant_values=True)
        self._radius = robot.radius or 0.0
        self._outline = np.zeros((1, 2))
        if robot.radius is None:
            corners = np.array(robot.vertices)
            shares = np.arange(_OUTLINE)[:, None, None] / _OUTLINE
            sides = corners + shares * (np.roll(corners, -1, axis=0) - corners)
            self._outline = sides.reshape(-1, 2)

    def of(self, poses: FloatArray) -> FloatArray:
        """Inches between the outline and the nearest wall at (n, 3) poses: (n,)."""
        turned = np.exp(1j * np.radians(poses[:, 2]))
        local = self._outline[:, 0] + 1j * self._outline[:, 1]
        places = (poses[:, 0] + 1j * poses[:, 1])[:, None] + turned[:, None] * local
        distances = self._to_walls(places.real.ravel(), places.imag.ravel()).reshape(places.shape)
        nearest: FloatArray = distances.min(axis=1) - self._radius
        return nearest

    def along(
        self,
        poses: FloatArray,
        totals: FloatArray,
        segments: int | FloatArray,
        bend: complex | ComplexArray = 0.0,
    ) -> FloatArray:
        """The same after each of `SHARES` of the paths that totals lead along in free space: (n, 8)."""
        clear = [self.of(moved(poses, share * totals, segments, share * bend)) for share in SHARES]
        return np.column_stack(clear)

    def _to_walls(self, x: FloatArray, y: FloatArray) -> FloatArray:
        rows, columns = self._walls.shape
        column = np.clip(np.floor(x / CELL_SIZE).astype(int) + 2, 1, columns - 2)
        row = np.clip(np.floor(y / CELL_SIZE).astype(int) + 2, 1, rows - 2)
        u, v = x - (column - 2) * CELL_SIZE, y - (row - 2) * CELL_SIZE
        nearest = np.full(len(x), CELL_SIZE)
        depth = np.full(len(x), CELL_SIZE)
        for i in (-1, 0, 1):
            for j in (-1, 0, 1):
                if not (i or j):
                    continue
                away = np.hypot(_gap(u, j), _gap(v, i))
                wall = self._walls[row + i, column + j]
                nearest = np.where(wall, np.minimum(nearest, away), nearest)
                depth = np.where(wall, depth, np.minimum(depth, away))
        inside = self._walls[row, column]
        return np.where(inside, -depth, nearest)


def _gap(place: FloatArray, step: int) -> FloatArray:
    """Distance of a point in a cell from the cell `step` away, along one axis."""
    if step == 0:
        return np.zeros_like(place)
    return np.maximum(place if step < 0 else CELL_SIZE - place, 0.0)
