"""One frozen picture's worth of facts: all that a frame of the maze view needs.

Units are inches and degrees, the global frame (origin at the maze's bottom-left corner, +Y up)
unless a docstring says otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import FloorPatch, RangeScan
from simmer_tui.sim.specs import BLOCK, CELL_SIZE, TILES_PER_CELL, MazeSpec, RobotSpec

if TYPE_CHECKING:
    from numpy.typing import NDArray

Place = tuple[float, float]
LOUD_SECONDS = 10.0
"""How long after a line sensor's reading the floor keeps its contrast, seconds."""


class FloorMode(StrEnum):
    """Whether black and white tiles are told apart: always, never, or when a line sensor is used."""

    AUTO = "auto"
    QUIET = "quiet"
    LOUD = "loud"


@dataclass(frozen=True, slots=True, eq=False)
class SensorView:
    """The geometry of one sensor's latest reading; `sensor` is its code."""

    view: RangeScan | FloorPatch
    sensor: str = ""


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
    and 1 white. `trail` is an (n, 2) array of the robot's past centres, oldest first, and
    `leg_starts` the indices at which a new movement begins; without them it is one movement.
    `views` come in the order they were read: the last is what was read last. It is drawn brightly,
    and so is what the sensor with the code `chosen` read. `contact` is the last place where the
    robot touched something; `in_contact` says whether it touches now.
    `line_age` is how many seconds ago a line sensor was read, None for not at all. `loading_zone`
    holds the middles of its cells, None for those that the maze marks; `drop_zone` is the middle
    of its cell.
    Arrays are not copied: whoever makes a scene must not change them afterwards. A maze and floor
    that are the same objects from scene to scene are drawn once and reused.
    """

    maze: MazeSpec
    floor: NDArray[np.uint8]
    robot: RobotSpec
    pose: Pose
    block_centre: Place | None = None
    block_size: float = 3.0
    block_heading: float = 0.0
    block_held: bool = False
    trail: NDArray[np.float64] = field(default_factory=_no_points)
    leg_starts: tuple[int, ...] = (0,)
    views: tuple[SensorView, ...] = ()
    chosen: str = ""
    contact: Place | None = None
    in_contact: bool = False
    belief: Belief | None = None
    line_age: float | None = None
    loading_zone: tuple[Place, ...] | None = None
    drop_zone: Place | None = None
    show_trail: bool = True
    show_rays: bool = True
    show_robot: bool = True

    def __post_init__(self) -> None:
        expected = (self.maze.rows * TILES_PER_CELL, self.maze.columns * TILES_PER_CELL)
        if self.floor.shape != expected:
            raise ValueError(f"the floor has shape {self.floor.shape}, this maze needs {expected}")

    def is_loud(self, mode: FloorMode) -> bool:
        """Whether the floor's tiles are to be told apart."""
        if mode is FloorMode.AUTO:
            return self.line_age is not None and self.line_age <= LOUD_SECONDS
        return mode is FloorMode.LOUD


@dataclass(frozen=True, slots=True)
class Zones:
    """The zones by row and column of the maze's cells, the first row on top."""

    loading: frozenset[tuple[int, int]]
    drop: frozenset[tuple[int, int]]


def zones_of(scene: Scene) -> Zones:
    """Which cells of the maze belong to a zone."""
    maze = scene.maze
    if scene.loading_zone is None:
        loading = frozenset(
            (row, column)
            for row, cells in enumerate(maze.cells)
            for column, cell in enumerate(cells)
            if cell == BLOCK
        )
    else:
        loading = frozenset(_cell(maze, place) for place in scene.loading_zone)
    drop = frozenset() if scene.drop_zone is None else frozenset((_cell(maze, scene.drop_zone),))
    return Zones(loading, drop)


def _cell(maze: MazeSpec, place: Place) -> tuple[int, int]:
    return maze.rows - 1 - int(place[1] // CELL_SIZE), int(place[0] // CELL_SIZE)
