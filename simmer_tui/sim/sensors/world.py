"""The world that sensors observe: the maze and the block, which the gripper may hold."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from simmer_tui.sim.angles import FloatArray, cos_sin_array
from simmer_tui.sim.block import Block
from simmer_tui.sim.maze import Maze


class World(Struct, frozen=True):
    """The world that a sensor can see: the maze and the block in it, which is `held` or lies there."""

    maze: Maze
    block: Block
    held: bool = False

    def fan(
        self, x: float, y: float, directions: Sequence[tuple[float, float]], block_from: float
    ) -> list[float]:
        """Distances from (x, y), not on a wall, along unit vectors to a wall, or to the block where
        it is at least `block_from` away: 0 for rays low enough to meet it, infinite for those that
        pass above."""
        distances = self.maze.cast_fan(x, y, directions)
        if block_from < math.inf:
            cast = self.block.cast
            for index, (dx, dy) in enumerate(directions):
                if block_from <= (distance := cast(x, y, dx, dy)) < distances[index]:
                    distances[index] = distance
        return distances

    def fans(
        self, x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, block_from: float
    ) -> FloatArray:
        """The same for many places at once, all arrays (n,): (n,) distances, 0 from a wall."""
        distances = self.maze.cast_many(x, y, dx, dy)
        if block_from < math.inf:
            to_block = self.block.cast_many(x, y, dx, dy)
            return np.where((to_block >= block_from) & (to_block < distances), to_block, distances)
        return distances

    def rays(self, origins: FloatArray, bearings: FloatArray, block_from: float) -> FloatArray:
        """The same for (n, 2) origins and (n,) bearings in degrees."""
        x, y = np.ascontiguousarray(origins.T)
        return self.fans(x, y, *cos_sin_array(bearings), block_from)

    def incidence(
        self,
        x: FloatArray,
        y: FloatArray,
        dx: FloatArray,
        dy: FloatArray,
        distances: FloatArray,
        block_from: float,
    ) -> FloatArray:
        """Cosines of the angles between rays and the normals of the faces they end on, (n,), for rays
        and their `distances` as `fans` has them. At a corner the less oblique face counts."""
        cosines = self.maze.incidence(x, y, dx, dy, distances)
        if block_from < math.inf:
            to_block = self.block.cast_many(x, y, dx, dy)
            on_block = (to_block >= block_from) & (to_block == distances)
            cosines = np.where(on_block, self.block.incidence(x, y, dx, dy, to_block), cosines)
        return cosines
