"""What the robot can run into: walls, the outside of the maze, and the block if it is solid."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.footprint import Edges, Footprint
from simmer_tui.sim.records import Pose
from simmer_tui.sim.specs import CELL_SIZE

SKIN = 1e-10
"""The robot overlaps an obstacle when it is deeper in than this, inches; less is rounding."""


@dataclass(frozen=True)
class Obstacles:
    """Faces and corners of all that is solid, and the solid itself as a searchable tree.

    `corners` is (n, 2). The tree's geometries are the obstacles shrunk by `SKIN`, so that
    touching one does not count as overlapping it.
    """

    faces: Edges
    corners: FloatArray
    tree: shapely.STRtree

    @classmethod
    def of_maze(cls, walls: NDArray[np.bool_]) -> Obstacles:
        """The walls of a maze, given as `Maze.walls`."""
        upright = _runs(walls[1:-1, :], walls.shape[0] - 2)
        level = _runs(walls[:, 1:-1].T, walls.shape[1] - 2)[:, [1, 0, 3, 2]]
        segments = np.concatenate((upright, level)) * CELL_SIZE
        start, end = segments[:, :2], segments[:, 2:]
        corners = np.array(sorted({(x, y) for x, y in np.concatenate((start, end)).tolist()}))
        return cls(Edges.between(start, end), corners, shapely.STRtree(_boxes(walls)))

    def with_block(self, block: Block) -> Obstacles:
        """The same and a solid block; one that is hardly there has no edges that point anywhere."""
        if block.size <= 2 * SKIN:
            return self
        corners = block.corners()
        solid = shapely.Polygon(replace(block, size=block.size - 2 * SKIN).corners())
        return Obstacles(
            Edges.join(self.faces, Edges.between(corners, np.roll(corners, -1, axis=0))),
            np.concatenate((self.corners, corners)),
            shapely.STRtree([*self.tree.geometries, solid]),
        )

    @cached_property
    def _face_bounds(self) -> tuple[FloatArray, FloatArray]:
        faces = self.faces
        foot = faces.normal * faces.offset[:, None]
        start = foot + faces.tangent * faces.low[:, None]
        end = foot + faces.tangent * faces.high[:, None]
        return np.minimum(start, end), np.maximum(start, end)

    def near(self, low: FloatArray, high: FloatArray) -> tuple[Edges, FloatArray]:
        """Faces and corners that reach into the box from `low` to `high`, each (2,)."""
        face_low, face_high = self._face_bounds
        chosen = np.all((face_low <= high) & (face_high >= low), axis=1)
        corners = self.corners[((self.corners <= high) & (self.corners >= low)).all(axis=1)]
        return self.faces.select(np.asarray(chosen)), corners

    def overlap(self, footprint: Footprint, pose: Pose) -> bool:
        """Whether the robot at `pose` overlaps an obstacle by more than rounding."""
        return any(
            len(
                self.tree.query(shape, predicate="dwithin", distance=margin)
                if margin
                else self.tree.query(shape, predicate="intersects")
            )
            for shape, margin in footprint.shapes(pose)
        )

    def nearest_point(self, footprint: Footprint, pose: Pose) -> tuple[float, float]:
        """The point of an obstacle that is nearest to the robot, inches, global."""
        nearest, distance = (0.0, 0.0), math.inf
        for shape, margin in footprint.shapes(pose):
            obstacle = self.tree.geometries[self.tree.nearest(shape)]
            ends = shapely.get_coordinates(shapely.shortest_line(shape, obstacle))
            gap = float(np.hypot(*(ends[1] - ends[0]))) - margin
            if gap < distance:
                nearest, distance = (float(ends[1, 0]), float(ends[1, 1])), gap
        return nearest


def _runs(walls: NDArray[np.bool_], rows: int) -> NDArray[np.float64]:
    """Upright wall faces as (x, y, x, y) in cells, neighbouring ones joined. `walls` has `rows`
    rows and a ring column on either side."""
    runs = []
    for column in range(walls.shape[1] - 1):
        side = walls[:, column + 1].astype(np.int8) - walls[:, column]
        breaks = np.flatnonzero(np.diff(side, prepend=0, append=0))
        for begin, end in pairwise(breaks):
            if begin < rows and side[begin]:
                runs.append((column, begin, column, end))
    return np.array(runs, dtype=np.float64).reshape(-1, 4)


def _boxes(walls: NDArray[np.bool_]) -> list[BaseGeometry]:
    """Wall cells joined along rows, and four slabs for the outside, all shrunk by `SKIN`."""
    rows, columns = walls.shape[0] - 2, walls.shape[1] - 2
    width, height = columns * CELL_SIZE, rows * CELL_SIZE
    thick = 2 * (width + height)
    bounds = [
        (-thick, -thick, 0.0, height + thick),
        (width, -thick, width + thick, height + thick),
        (-thick, -thick, width + thick, 0.0),
        (-thick, height, width + thick, height + thick),
    ]
    for row in range(rows):
        solid = walls[row + 1, 1:-1].astype(np.int8)
        breaks = np.flatnonzero(np.diff(solid, prepend=0, append=0)).reshape(-1, 2) * CELL_SIZE
        bounds += [(begin, row * CELL_SIZE, end, (row + 1) * CELL_SIZE) for begin, end in breaks]
    low_x, low_y, high_x, high_y = np.array(bounds).T
    return list(shapely.box(low_x + SKIN, low_y + SKIN, high_x - SKIN, high_y - SKIN))
