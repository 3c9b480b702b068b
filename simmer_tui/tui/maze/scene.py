"""One frozen picture's worth of facts: all that a frame of the maze view needs.

Units are inches and degrees, the global frame (origin at the maze's bottom-left corner, +Y up)
unless a docstring says otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import FloorPatch, RangeScan
from simmer_tui.sim.specs import TILES_PER_CELL, MazeSpec, RobotSpec

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class SensorView:
    """The geometry of one sensor's latest reading."""

    view: RangeScan | FloorPatch


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Where a program believes the robot is.

    `spread` is a radius of uncertainty (inches), `particles` an (n, 2) array of places.
    """

    pose: Pose
    spread: float | None = None
    particles: NDArray[np.float64] | None = None


def _no_points() -> NDArray[np.float64]:
    return np.zeros((0, 2))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """What one frame shows.

    `floor` holds the tiles, (4 * maze rows, 4 * maze columns) uint8, the first row on top, 0 black
    and 1 white. `trail` is an (n, 2) array of the robot's past centres, oldest first. `contact` is
    the last place where the robot touched something; `in_contact` says whether it touches now.
    Arrays are not copied: whoever makes a scene must not change them afterwards. A maze and floor
    that are the same objects from scene to scene are drawn once and reused.
    """

    maze: MazeSpec
    floor: NDArray[np.uint8]
    robot: RobotSpec
    pose: Pose
    block_centre: tuple[float, float] | None = None
    block_size: float = 3.0
    block_heading: float = 0.0
    trail: NDArray[np.float64] = field(default_factory=_no_points)
    views: tuple[SensorView, ...] = ()
    contact: tuple[float, float] | None = None
    in_contact: bool = False
    belief: Belief | None = None
    show_trail: bool = True
    show_rays: bool = True
    show_robot: bool = True

    def __post_init__(self) -> None:
        expected = (self.maze.rows * TILES_PER_CELL, self.maze.columns * TILES_PER_CELL)
        if self.floor.shape != expected:
            raise ValueError(f"the floor has shape {self.floor.shape}, this maze needs {expected}")
