"""The robot's footprint as the contact search needs it."""

import math
from functools import cached_property

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import astuple, replace
from shapely.geometry.base import BaseGeometry

from simmer_tui.sim.angles import cos_sin, turned
from simmer_tui.sim.arrays import BoolArray, FloatArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import RobotSpec


def _dot(vectors: FloatArray, others: FloatArray) -> FloatArray:
    """Products of (n, 2) vectors with others, one by one: (n,)."""
    # Written out, here and below: matrix products and numpy's hypot round differently from one
    # processor to the next, and the same commands must give the same bits everywhere.
    return vectors[:, 0] * others[:, 0] + vectors[:, 1] * others[:, 1]


class Edges(Struct, frozen=True, dict=True):
    """Straight edges with unit normals: points p of an edge satisfy `normal . p = offset` and
    `low <= tangent . p <= high`. `normal` and `tangent` are (n, 2), the others (n,)."""

    normal: FloatArray
    offset: FloatArray
    tangent: FloatArray
    low: FloatArray
    high: FloatArray

    @classmethod
    def between(cls, start: FloatArray, end: FloatArray) -> "Edges":
        """The edges from `start` to `end`, both (n, 2)."""
        along = end - start
        tangent = along / np.sqrt(_dot(along, along))[:, None]
        normal = np.column_stack((-tangent[:, 1], tangent[:, 0]))
        return cls(normal, _dot(normal, start), tangent, _dot(tangent, start), _dot(tangent, end))

    @cached_property
    def _axes(self) -> tuple[FloatArray, FloatArray]:
        """X and Y of all normals and then all tangents, each (2 n,)."""
        both = np.concatenate((self.normal, self.tangent))
        return np.ascontiguousarray(both[:, 0]), np.ascontiguousarray(both[:, 1])

    def places(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates of points (..., 2) along the normals and along the tangents, both (..., n)."""
        return self.places_of(points[..., 0], points[..., 1])

    def places_of(self, across: FloatArray, up: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same of points with x `across` and y `up`, both (...)."""
        x, y = self._axes
        both = across[..., None] * x + up[..., None] * y
        return both[..., : len(self.offset)], both[..., len(self.offset) :]

    def select(self, chosen: BoolArray) -> "Edges":
        """The edges a mask (n,) picks."""
        return Edges(*[each[chosen] for each in astuple(self)])

    def beside(self, distance: float) -> "Edges":
        """The edges moved by a distance to either side."""
        offsets = np.concatenate((self.offset + distance, self.offset - distance))
        return replace(Edges.join(self, self), offset=offsets)

    @staticmethod
    def join(first: "Edges", second: "Edges") -> "Edges":
        return Edges(*map(np.concatenate, zip(astuple(first), astuple(second), strict=True)))


class Part(Struct, frozen=True):
    """A part of the robot in the global frame: every point within `margin` inches of the geometry belongs to
    it. `held` is True for the block between the gripper's jaws."""

    geometry: BaseGeometry
    margin: float = 0.0
    held: bool = False


class Footprint(Struct, frozen=True, dict=True):
    """A disc of `radius` around the origin (0 for none) and any number of polygons, in the robot's frame. The
    robot's body is their union; `holding` is True if the last polygon is a held block."""

    radius: float = 0.0
    polygons: tuple[FloatArray, ...] = ()
    holding: bool = False

    @classmethod
    def of(cls, spec: RobotSpec) -> "Footprint":
        """The footprint of a robot without a block."""
        if spec.radius is not None:
            return cls(radius=spec.radius)
        return cls(polygons=(np.array(spec.vertices, dtype=np.float64),))

    def with_block(self, corners: FloatArray) -> "Footprint":
        """The same with a held block, whose corners, (4, 2), are in the robot's frame."""
        return Footprint(self.radius, (*self.polygons, corners), holding=True)

    @cached_property
    def vertices(self) -> FloatArray:
        """All polygon vertices, (n, 2)."""
        return np.concatenate(self.polygons) if self.polygons else np.empty((0, 2))

    @cached_property
    def edges(self) -> Edges:
        """All polygon edges, in the robot's frame."""
        following = [np.roll(polygon, -1, axis=0) for polygon in self.polygons]
        return Edges.between(self.vertices, np.concatenate(following) if following else self.vertices)

    @cached_property
    def reach(self) -> float:
        """Greatest distance of any point of the footprint from the robot's centre, inches."""
        squares = _dot(self.vertices, self.vertices)
        return max(self.radius, math.sqrt(float(squares.max(initial=0.0))))

    @cached_property
    def front(self) -> float:
        """Greatest X of any point of the footprint, inches."""
        return max(self.radius, float(self.vertices[:, 0].max(initial=-math.inf)))

    def placed(self, pose: Pose) -> list[FloatArray]:
        """The polygons, each (n, 2), in the global frame."""
        cos, sin = cos_sin(pose.heading)
        place = np.array((pose.x, pose.y))
        return [turned(polygon, cos, sin) + place for polygon in self.polygons]

    def shapes(self, pose: Pose) -> list[Part]:
        """The parts at a pose, a held block last."""
        parts = [Part(shapely.Polygon(polygon)) for polygon in self.placed(pose)]
        # The body comes before a held block in every list of parts: it wins ties.
        if self.radius:
            parts.insert(0, Part(shapely.Point(pose.x, pose.y), self.radius))
        if self.holding:
            parts[-1] = replace(parts[-1], held=True)
        return parts
