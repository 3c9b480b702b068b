"""Obstacles for the robot: walls, the outside of the maze, and the block if it is solid.

Robot and block are checked against them before they are placed.
"""

import math
from functools import cached_property

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace
from shapely.geometry.base import BaseGeometry

from simmer_tui.sim.angles import cos_sin_array, turned
from simmer_tui.sim.arrays import BoolArray, FloatArray, NDArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.footprint import Edges, Footprint, Part
from simmer_tui.sim.maze import Maze, looks_inverted
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import CELL_SIZE, SimulationSpec

# A tenth of `TOUCHING` (contact.py), and 10,000 times the rounding of coordinates of a maze (1e-14).
SKIN = 1e-10
"""The robot overlaps an obstacle when it is deeper in than this, inches; less is rounding."""

# A robot has the same walls around it for most of its legs. The bundled maze has some 200 such sets.
_KEPT = 300
"""Sets of faces and corners that are kept."""


class Obstruction(Struct, frozen=True):
    """An obstacle that the robot touches: its point (inches, global), True for `held_block` if the held block
    touches it, and the wall's cell, as in `Contact`."""

    point: tuple[float, float]
    held_block: bool
    cell: tuple[int, int] | None


class Obstacles(Struct, frozen=True, dict=True):
    """Faces and corners of all that is solid, and the solid itself as a searchable tree.

    `corners` is (n, 2). The tree's geometries are the obstacles shrunk by `SKIN`, so that
    touching one does not count as overlapping it.
    """

    faces: Edges
    corners: FloatArray
    tree: shapely.STRtree
    cells: tuple[int, int]
    """Rows and columns of the maze."""
    block: BaseGeometry | None = None
    """The block, if it is solid; it is then the tree's last geometry."""

    @classmethod
    def of_maze(cls, walls: BoolArray) -> "Obstacles":
        """The walls of a maze, given as `Maze.walls`."""
        upright = _runs(walls[1:-1, :])
        # The same for the transposed grid, whose x and y are swapped back.
        level = _runs(walls[:, 1:-1].T)[:, [1, 0, 3, 2]]
        segments = np.concatenate((upright, level)) * CELL_SIZE
        start, end = segments[:, :2], segments[:, 2:]
        corners = np.array(sorted({(x, y) for x, y in np.concatenate((start, end)).tolist()}))
        rows, columns = walls.shape
        tree = shapely.STRtree(_boxes(walls))
        return cls(Edges.between(start, end), corners, tree, (rows - 2, columns - 2))

    def with_block(self, block: Block) -> "Obstacles":
        """The same and a solid block. A block of almost size 0 has no edges, since their directions are
        undefined."""
        if block.size <= 2 * SKIN:
            return self
        corners = block.corners()
        solid = shapely.Polygon(replace(block, size=block.size - 2 * SKIN).corners())
        return Obstacles(
            Edges.join(self.faces, Edges.between(corners, np.roll(corners, -1, axis=0))),
            np.concatenate((self.corners, corners)),
            shapely.STRtree([*self.tree.geometries, solid]),
            self.cells,
            shapely.Polygon(corners),
        )

    @cached_property
    def _bounds_of_all(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest x and y of all faces, then of all corners, each (n, 2)."""
        faces = self.faces
        foot = faces.normal * faces.offset[:, None]
        start = foot + faces.tangent * faces.low[:, None]
        end = foot + faces.tangent * faces.high[:, None]
        return (
            np.concatenate((np.minimum(start, end), self.corners)),
            np.concatenate((np.maximum(start, end), self.corners)),
        )

    @cached_property
    def _near(self) -> dict[bytes, tuple[Edges, FloatArray]]:
        """Faces and corners that `near` has found, by the mask of those that it has chosen."""
        return {}

    def near(self, low: FloatArray, high: FloatArray) -> tuple[Edges, FloatArray]:
        """Faces and corners that reach into the box from `low` to `high`, each (2,)."""
        all_low, all_high = self._bounds_of_all
        chosen = np.asarray(((all_low <= high) & (all_high >= low)).all(axis=1))
        key = chosen.tobytes()
        found = self._near.get(key)
        if found is None:
            if len(self._near) >= _KEPT:
                self._near.clear()
            faces = len(self.faces.offset)
            found = self._near[key] = self.faces.select(chosen[:faces]), self.corners[chosen[faces:]]
        return found

    def clearance(self, x: float, y: float) -> float:
        """Distance of a place from the nearest obstacle, inches."""
        place = shapely.Point(x, y)
        return float(shapely.distance(place, self.tree.geometries[int(self.tree.nearest(place))]))

    def overlap(self, footprint: Footprint, pose: Pose) -> bool:
        """True if the robot at `pose` overlaps an obstacle by more than rounding."""
        return any(len(self._overlapped(part)) for part in footprint.shapes(pose))

    def overlapped(self, footprint: Footprint, poses: FloatArray) -> BoolArray:
        """`overlap` at (n, 3) poses of x, y and heading: (n,)."""
        overlapping = np.zeros(len(poses), np.bool_)
        # A disc is the same at every heading, so that each place is looked at once.
        places, place_of = np.unique(poses[:, :2], axis=0, return_inverse=True)
        if footprint.radius:
            overlapping |= self._within(places, footprint.radius)[place_of.ravel()]
        if not footprint.polygons:
            return overlapping
        # Only what is within reach of a wall needs its outline.
        close = self._within(places, footprint.reach + SKIN)[place_of.ravel()]
        looked_at = np.flatnonzero(close & ~overlapping)
        cos, sin = (each[:, None] for each in cos_sin_array(poses[looked_at, 2]))
        for polygon in footprint.polygons:
            outlines = shapely.polygons(turned(polygon, cos, sin) + poses[looked_at, None, :2])
            met, _ = self.tree.query(outlines, predicate="intersects")
            overlapping[looked_at[met]] = True
        return overlapping

    def _within(self, places: FloatArray, distance: float) -> BoolArray:
        """True for each of the (n, 2) places that lies within a distance of an obstacle, inches."""
        near = np.zeros(len(places), np.bool_)
        near[self.tree.query(shapely.points(places), predicate="dwithin", distance=distance)[0]] = True
        return near

    def touch(self, footprint: Footprint, pose: Pose, beyond: Pose) -> Obstruction:
        """The obstruction at a pose, where the robot would overlap an obstacle a little further on,
        at `beyond`."""
        pairs = [
            (part, index)
            for part, further in zip(footprint.shapes(pose), footprint.shapes(beyond), strict=True)
            for index in self._overlapped(further).tolist()
        ]
        part, index = self._nearest_pair(pairs)
        point = self._point(part, index)
        return Obstruction(point, part.held, self._cell(index, point))

    def _nearest_pair(self, pairs: list[tuple[Part, int]]) -> tuple[Part, int]:
        """The part and the obstacle with the least distance between them. The body comes before a
        held block: where both touch it is the body that counts."""
        nearest, least = pairs[0], math.inf
        for part, index in pairs:
            gap = float(shapely.distance(part.geometry, self.tree.geometries[index])) - part.margin
            # Only a part that is nearer by more than rounding replaces an earlier one.
            if gap < least - 2 * SKIN:
                nearest, least = (part, index), gap
        return nearest

    def nearest_point(self, footprint: Footprint, pose: Pose) -> tuple[float, float]:
        """The point of an obstacle that is nearest to the robot, inches, global."""
        parts = footprint.shapes(pose)
        pairs = [(part, int(self.tree.nearest(part.geometry))) for part in parts]
        return self._point(*self._nearest_pair(pairs))

    def _overlapped(self, part: Part) -> NDArray[np.intp]:
        """Indices of the tree's geometries that a part overlaps."""
        # A disc is a point with a margin: exact, where a polygon of many corners would not be.
        if part.margin:
            return np.asarray(self.tree.query(part.geometry, predicate="dwithin", distance=part.margin))
        return np.asarray(self.tree.query(part.geometry, predicate="intersects"))

    def _bounds(self, index: int) -> tuple[int, int, int, int]:
        """The box of a wall in cells: left, bottom, right, top."""
        left, bottom, right, top = (round(each / CELL_SIZE) for each in self.tree.geometries[index].bounds)
        return left, bottom, right, top

    def _is_block(self, index: int) -> bool:
        return self.block is not None and index == len(self.tree.geometries) - 1

    def _point(self, part: Part, index: int) -> tuple[float, float]:
        """The point of an obstacle nearest to a part of the robot, on its outline, which is `SKIN` outside
        that of the tree's geometry."""
        ends = shapely.get_coordinates(shapely.shortest_line(part.geometry, self.tree.geometries[index]))
        x, y = ends[1].tolist()
        if self.block is not None and self._is_block(index):
            outline = shapely.get_exterior_ring(self.block)
            (x, y) = shapely.get_coordinates(shapely.shortest_line(shapely.Point(x, y), outline))[1].tolist()
            return x, y
        left, bottom, right, top = self._bounds(index)
        return _onto(x, (left, right)), _onto(y, (bottom, top))

    def _cell(self, index: int, point: tuple[float, float]) -> tuple[int, int] | None:
        """The cell of the wall at a point of one of the tree's geometries."""
        if self._is_block(index):
            return None
        rows, columns = self.cells
        left, bottom, right, top = self._bounds(index)
        # A point on a side lies in two cells; the bounds of the geometry tell which of them is wall.
        column = min(max(math.floor(point[0] / CELL_SIZE), left, -1), right - 1, columns)
        row = min(max(math.floor(point[1] / CELL_SIZE), bottom, -1), top - 1, rows)
        return rows - row, column + 1


def _onto(place: float, lines: tuple[int, int]) -> float:
    """A coordinate, put onto a side of a wall (in cells) where it lies within rounding of it."""
    for line in lines:
        if abs(place - line * CELL_SIZE) <= 2 * SKIN:
            return line * CELL_SIZE
    return place


def _runs(walls: BoolArray) -> FloatArray:
    """Upright wall faces as (x, y, x, y) in cells, neighbouring ones joined. `walls` has a ring column on
    either side."""
    side = walls[:, 1:].astype(np.int8) - walls[:, :-1]
    columns, breaks = np.nonzero(np.diff(side, axis=0, prepend=0, append=0).T)
    column, begin, end = columns[:-1], breaks[:-1], breaks[1:]
    # A break in the last row is the last of its column.
    kept = np.flatnonzero(column == columns[1:])
    kept = kept[side[begin[kept], column[kept]] != 0]
    runs: FloatArray = np.column_stack((column, begin, column, end))[kept].astype(np.float64)
    return runs


def _boxes(walls: BoolArray) -> list[BaseGeometry]:
    """Wall cells joined along rows, and four slabs for the outside, all shrunk by `SKIN`."""
    rows, columns = walls.shape[0] - 2, walls.shape[1] - 2
    width, height = columns * CELL_SIZE, rows * CELL_SIZE
    # The outside's slabs are thicker than any robot in the maze is long: none reaches through one.
    thick = 2 * (width + height)
    bounds = [
        (-thick, -thick, 0.0, height + thick),
        (width, -thick, width + thick, height + thick),
        (-thick, -thick, width + thick, 0.0),
        (-thick, height, width + thick, height + thick),
    ]
    solid = walls[1:-1, 1:-1].astype(np.int8)
    row, breaks = (each.reshape(-1, 2) for each in np.nonzero(np.diff(solid, axis=1, prepend=0, append=0)))
    boxes = np.column_stack((breaks[:, 0], row[:, 0], breaks[:, 1], row[:, 0] + 1)) * CELL_SIZE
    low_x, low_y, high_x, high_y = np.concatenate((bounds, boxes)).T
    return list(shapely.box(low_x + SKIN, low_y + SKIN, high_x - SKIN, high_y - SKIN))


def robot_problem(maze: Maze, obstacles: Obstacles, footprint: Footprint, pose: Pose) -> str:
    """Reason why the robot cannot stand at a pose, or an empty string."""
    if not all(math.isfinite(value) for value in (pose.x, pose.y, pose.heading)):
        return "x, y and heading must be finite numbers"
    outside = _outside(maze, pose.x, pose.y)
    if outside or not obstacles.overlap(footprint, pose):
        return outside
    x, y = obstacles.nearest_point(footprint, pose)
    return (
        f"the robot at ({pose.x:g}, {pose.y:g}) heading {pose.heading:g} overlaps a wall or solid block near "
        f"({x:g}, {y:g}); {_free_places(maze, footprint)}"
    )


def block_problem(maze: Maze, obstacles: Obstacles, block: Block) -> str:
    """Reason why the block cannot stand where it is, or an empty string. `obstacles` are the walls. Without a
    block there is no problem."""
    if not block.size:
        return ""
    if not (math.isfinite(block.x) and math.isfinite(block.y)):
        return "x and y must be finite numbers"
    outside = _outside(maze, block.x, block.y)
    if outside or not obstacles.overlap(Footprint(polygons=(block.corners(),)), Pose(0.0, 0.0, 0.0)):
        return outside
    return f"the block of {block.size:g} in at ({block.x:g}, {block.y:g}) overlaps a wall"


def placement_problems(spec: SimulationSpec) -> list[tuple[str, str]]:
    """Problems of the start pose and the block of a configuration: pairs of the setting's
    name and the reason. Empty when all is well."""
    maze = Maze(spec.maze)
    walls = Obstacles.of_maze(maze.walls)
    block, pose = spec.start_block, spec.start_pose
    # The block first: where it is wrong itself, it cannot be what the robot overlaps.
    wrong_block = block_problem(maze, walls, block)
    obstacles = walls.with_block(block) if spec.block_solid and block.size and not wrong_block else walls
    wrong_pose = robot_problem(maze, obstacles, Footprint.of(spec.robot), pose)
    found = (("block_center", wrong_block), ("bot_center", wrong_pose))
    return [(name, problem) for name, problem in found if problem]


def _outside(maze: Maze, x: float, y: float) -> str:
    if 0 <= x <= maze.width and 0 <= y <= maze.height:
        return ""
    extent = f"which reaches from (0, 0) to ({maze.width:g}, {maze.height:g})"
    return f"({x:g}, {y:g}) lies outside the maze, {extent}"


def _free_places(maze: Maze, footprint: Footprint) -> str:
    """The middle of a free cell, as advice. Where walls may be free and free cells walls, there is none."""
    if looks_inverted(maze.spec):
        return "the maze seems to have 1 for a wall, but here 0 is a wall and 1 is free: exchange them"
    free = [
        ((column - 0.5) * CELL_SIZE, (row - 0.5) * CELL_SIZE)
        for row, column in zip(*(~maze.walls).nonzero(), strict=True)
    ]
    if not free or footprint.reach > CELL_SIZE / 2:
        return "it must stand clear of walls"
    x, y = free[0]
    return f"it must stand clear of walls, as in the middle of a free cell, ({x:g}, {y:g})"
