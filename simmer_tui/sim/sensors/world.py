"""What sensors look at: the maze, the block, and whether the gripper holds it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simmer_tui.sim.angles import FloatArray, cos_sin_array
from simmer_tui.sim.block import Block
from simmer_tui.sim.maze import Maze


@dataclass(frozen=True, slots=True)
class World:
    """What a sensor can see: the maze and the block in it, which is `held` or lies there."""

    maze: Maze
    block: Block
    held: bool = False

    def fan(self, x: float, y: float, directions: Sequence[tuple[float, float]], low: bool) -> list[float]:
        """Distances from (x, y), not on a wall, along unit vectors to a wall, or to the block where
        the rays are `low` enough."""
        distances = self.maze.cast_fan(x, y, directions)
        if low:
            cast = self.block.cast
            distances = [min(far, cast(x, y, *way)) for far, way in zip(distances, directions, strict=True)]
        return distances

    def rays(self, origins: FloatArray, bearings: FloatArray, low: bool) -> FloatArray:
        """The same for (n, 2) origins and (n,) bearings in degrees, all at once: (n,) distances, 0
        from a wall."""
        x, y = np.ascontiguousarray(origins.T)
        dx, dy = cos_sin_array(bearings)
        distances = self.maze.cast_many(x, y, dx, dy)
        return np.minimum(distances, self.block.cast_many(x, y, dx, dy)) if low else distances
