"""A mission's start pose, block and drop zone; those that the set does not give are drawn from the seed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from msgspec import Struct
from shapely.geometry.base import BaseGeometry

from simmer_tui.config.mission_toml import Heading, MissionSpec
from simmer_tui.sim import noise
from simmer_tui.sim.block import Block
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.obstacles import Obstacles, block_problem, robot_problem
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import BLOCK, CELL_SIZE, START, MazeSpec, SimulationSpec

MISSION_STREAM = "mission"
_QUARTERS = (0.0, 90.0, 180.0, 270.0)
_HALF = CELL_SIZE / 2
# Random headings that are tried; after them a robot that is too long for most gets a multiple of 90 degrees.
_TRIES = 100
# Square inches below which there is no room for the block's centre.
_LEAST_ROOM = 1e-6

Place = tuple[float, float]


class Cell(Struct, frozen=True):
    """A cell of the maze by its middle, inches, global."""

    x: float
    y: float

    @property
    def corners(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Its lower left and upper right corners."""
        return (self.x - _HALF, self.y - _HALF), (self.x + _HALF, self.y + _HALF)

    def holds(self, x: float, y: float) -> bool:
        """True if a place is in the cell, its edges included."""
        return abs(x - self.x) <= _HALF and abs(y - self.y) <= _HALF


class MissionPlan(Struct, frozen=True):
    """One run's mission. `start_known` is True if mission.toml gives the whole start pose, so that a control
    program may know it too. `contacts` is None if any number is allowed."""

    start: Pose
    start_known: bool
    block: Place
    loading_zone: tuple[Cell, ...]
    drop_zone: Cell
    time_limit: float
    contacts: int | None


def contacts_rule(allowed: int | None) -> str:
    """The allowed number of contacts in words: `no contact`, `at most 2 contacts`."""
    if not allowed:
        return "any number of contacts" if allowed is None else "no contact"
    return f"at most {allowed} contact{'s' * (allowed > 1)}"


def mission_text(mission: MissionSpec) -> str:
    """A mission in words, for the summary of its set."""
    headings = {Heading.QUARTER: "a multiple of 90", Heading.ANY: "any"}
    heading = headings[mission.heading] if isinstance(mission.heading, Heading) else f"{mission.heading:g}"
    start = "any start cell" if mission.start is None else _place_text(mission.start)
    block = "anywhere in the block cells" if mission.block is None else _place_text(mission.block)
    zone = (
        "a start cell" if mission.drop_zone is None else f"the cell around {_place_text(mission.drop_zone)}"
    )
    return (
        f"Mission: start {start}, heading {heading}; block {block}; drop zone {zone}; "
        f"{mission.time_limit:g} s, {contacts_rule(mission.contacts)}."
    )


def draw_mission(mission: MissionSpec, simulation: SimulationSpec, seed: int) -> MissionPlan:
    """A mission with its open values drawn. It has a random stream of its own: the same seed gives the same
    plan, and draws of the simulator do not change. Neither robot nor block is placed in a wall.

    `mission` must be one without problems (`mission_problems`).
    """
    ground = _Ground(mission, simulation)
    random = noise.stream(seed, MISSION_STREAM)
    place = ground.starts[int(random.integers(len(ground.starts)))]
    heading = ground.draw_heading(place, random)
    block = mission.block or _draw_place(ground.rooms(place), random)
    zones = ground.drop_zones
    others = [zone for zone in zones if not zone.holds(*place)] or zones
    return MissionPlan(
        start=Pose(*place, heading),
        start_known=mission.start is not None and not isinstance(mission.heading, Heading),
        block=block,
        loading_zone=tuple(cells_of(simulation.maze, BLOCK)),
        drop_zone=others[int(random.integers(len(others)))],
        time_limit=mission.time_limit,
        contacts=mission.contacts,
    )


def mission_problems(mission: MissionSpec, simulation: SimulationSpec) -> list[tuple[str, str]]:
    """The reasons why a mission cannot be drawn or completed: pairs of the key in mission.toml (empty for the
    whole mission) and the reason."""
    gripper = simulation.gripper
    no_gripper = (
        "a mission needs a gripper: an enabled row grip in drive.csv (simmer-tui init DIR --mission writes a "
        "set with one)"
    )
    ground = _Ground(mission, simulation)
    faults = (
        ("", "" if gripper is not None and gripper.enabled else no_gripper),
        ("start", ground.start_fault()),
        ("block", ground.block_fault()),
        ("drop_zone", ground.drop_zone_fault()),
    )
    return [(key, fault) for key, fault in faults if fault]


def cells_of(maze: MazeSpec, value: int) -> list[Cell]:
    """The cells of a value, from the top left, row by row."""
    return [
        Cell((column + 0.5) * CELL_SIZE, (maze.rows - row - 0.5) * CELL_SIZE)
        for row, cells in enumerate(maze.cells)
        for column, cell in enumerate(cells)
        if cell == value
    ]


class _Ground:
    """The possible places of a mission's robot and block."""

    def __init__(self, mission: MissionSpec, simulation: SimulationSpec) -> None:
        self._mission = mission
        self._simulation = simulation
        self._maze = Maze(simulation.maze)
        self._walls = Obstacles.of_maze(self._maze.walls)
        self._outline = Footprint.of(simulation.robot)
        self._apart = self._outline.reach + simulation.block_size / math.sqrt(2)
        """Distance, inches, at which robot and block do not touch at any heading."""
        self._rooms = [] if mission.block is not None else self._all_rooms()
        cells = cells_of(simulation.maze, START)
        self.drop_zones = cells if mission.drop_zone is None else [_cell_around(mission.drop_zone)]
        places = [(cell.x, cell.y) for cell in cells] if mission.start is None else [mission.start]
        self._standing = [place for place in places if self._headings(place)]
        self.starts = [place for place in self._standing if self._leaves_block(place)]
        """Start places that leave room for the block."""

    # -- the start ---------------------------------------------------------------------------

    def _fits(self, place: Place, heading: float) -> bool:
        return not robot_problem(self._maze, self._walls, self._outline, Pose(*place, heading))

    def _headings(self, place: Place) -> list[float]:
        """The headings to choose from at a place; if any is allowed, the multiples of 90."""
        heading = self._mission.heading
        wanted = _QUARTERS if isinstance(heading, Heading) else (heading,)
        return [each for each in wanted if self._fits(place, each)]

    def draw_heading(self, place: Place, random: np.random.Generator) -> float:
        if self._mission.heading is Heading.ANY:
            for heading in random.uniform(0.0, 360.0, _TRIES).tolist():
                if self._fits(place, heading):
                    return float(heading)
        headings = self._headings(place)
        return headings[int(random.integers(len(headings)))]

    def start_fault(self) -> str:
        start, heading = self._mission.start, self._mission.heading
        if self._standing:
            return ""
        if start is not None:
            pose = Pose(*start, 0.0 if isinstance(heading, Heading) else heading)
            return robot_problem(self._maze, self._walls, self._outline, pose)
        if not cells_of(self._simulation.maze, START):
            return f"maze.csv has no cell of value {START} to start from"
        return f"the robot fits into no cell of value {START} without overlapping a wall"

    # -- the block ---------------------------------------------------------------------------

    def _all_rooms(self) -> list[BaseGeometry]:
        """The areas in which the block's centre may be, one for each cell of value 3."""
        # Obstacles are grown by half the block and the clearance, so that the block is a point.
        keep_off = self._simulation.block_size / 2 + self._mission.clearance
        walls = self._maze.walls
        ring = math.ceil(keep_off / CELL_SIZE)
        rooms = []
        for cell in cells_of(self._simulation.maze, BLOCK):
            column, row = round(cell.x / CELL_SIZE + 0.5), round(cell.y / CELL_SIZE + 0.5)
            left, below = max(column - ring, 0), max(row - ring, 0)
            rows, columns = walls[below : row + ring + 1, left : column + ring + 1].nonzero()
            right, top = (columns + left) * CELL_SIZE, (rows + below) * CELL_SIZE
            taken = shapely.union_all(
                shapely.box(
                    right - CELL_SIZE - keep_off, top - CELL_SIZE - keep_off, right + keep_off, top + keep_off
                )
            )
            (low_x, low_y), (high_x, high_y) = cell.corners
            rooms.append(shapely.box(low_x, low_y, high_x, high_y).difference(taken))
        return [room for room in rooms if room.area > _LEAST_ROOM]

    def rooms(self, place: Place) -> list[BaseGeometry]:
        """The same with the robot at a place."""
        robot = shapely.Point(place).buffer(self._apart)
        left = [room.difference(robot) for room in self._rooms]
        return [room for room in left if room.area > _LEAST_ROOM]

    def _leaves_block(self, place: Place) -> bool:
        block = self._mission.block
        if block is not None:
            return math.dist(place, block) >= self._apart
        return bool(self.rooms(place))

    def block_fault(self) -> str:
        if not self._simulation.block_size:
            return "a mission needs a block: blocksize must be above 0"
        block = self._mission.block
        if block is not None:
            square = Block(*block, self._simulation.block_size)
            problem = block_problem(self._maze, self._walls, square)
            if problem:
                return problem
        elif not cells_of(self._simulation.maze, BLOCK):
            return f"maze.csv has no cell of value {BLOCK} for the block to lie in"
        elif not self._rooms:
            return (
                f"no cell of value {BLOCK} has room for a block of {self._simulation.block_size:g} in that "
                f"keeps {self._mission.clearance:g} in (clearance) from the walls"
            )
        if self._standing and not self.starts:
            return "the robot at its start would stand where the block lies"
        return ""

    # -- the drop zone -----------------------------------------------------------------------

    def drop_zone_fault(self) -> str:
        if self._mission.drop_zone is not None:
            x, y = self._mission.drop_zone
            inside = 0 <= x < self._maze.width and 0 <= y < self._maze.height
            if inside and not self._maze.walls[int(y // CELL_SIZE) + 1, int(x // CELL_SIZE) + 1]:
                return ""
            return f"({x:g}, {y:g}) is in no free cell of the maze"
        return "" if self.drop_zones else f"maze.csv has no cell of value {START} to be the drop zone"


def _place_text(place: Place) -> str:
    return f"({place[0]:g}, {place[1]:g})"


def _cell_around(place: Place) -> Cell:
    x, y = ((math.floor(value / CELL_SIZE) + 0.5) * CELL_SIZE for value in place)
    return Cell(x, y)


def _draw_place(rooms: Sequence[BaseGeometry], random: np.random.Generator) -> Place:
    """A random place, uniform over some areas."""
    areas = np.array([room.area for room in rooms])
    room = rooms[int(random.choice(len(rooms), p=areas / areas.sum()))]
    low_x, low_y, high_x, high_y = room.bounds
    while True:
        x, y = float(random.uniform(low_x, high_x)), float(random.uniform(low_y, high_y))
        if room.contains(shapely.Point(x, y)):
            return x, y
