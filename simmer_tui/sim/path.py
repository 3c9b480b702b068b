"""The path of a movement: a chain of segments, places on it, and the contact it may meet."""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import overload

import numpy as np
from msgspec import Struct

from simmer_tui.sim.angles import cos_sin, cos_sin_array
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.pose import Pose


class PathPosition(Struct, frozen=True, order=True):
    """A place on a path: its segment (from 0), and the fractions of that segment's turn and translation.
    Ordered along the path."""

    segment: int
    turned: float
    translated: float


PATH_START = PathPosition(0, 0.0, 0.0)


class _LazyPlaces(Sequence[tuple[float, float]]):
    """The places of a path whose segments are all alike. They are computed once, at the first access to one
    after the first."""

    __slots__ = ("_asked", "_places", "_segments")

    def __init__(self, start: Pose, x: float, y: float, turn: float, segments: int) -> None:
        self._asked = start, x, y, turn
        self._segments = segments
        self._places: list[tuple[float, float]] | None = None

    def __len__(self) -> int:
        return self._segments + 1

    @overload
    def __getitem__(self, index: int) -> tuple[float, float]: ...

    @overload
    def __getitem__(self, index: slice) -> list[tuple[float, float]]: ...

    def __getitem__(self, index: int | slice) -> tuple[float, float] | list[tuple[float, float]]:
        if index == 0:
            start = self._asked[0]
            return start.x, start.y
        if self._places is None:
            self._places = self._computed()
        return self._places[index]

    def __eq__(self, other: object) -> bool:
        return list(self) == other

    __hash__ = None  # type: ignore[assignment]

    def _computed(self) -> list[tuple[float, float]]:
        # One direction after the other: for the few segments of most paths twice as fast as arrays.
        start, x, y, turn = self._asked
        places = [(start.x, start.y)]
        far_x = far_y = 0.0
        for segment in range(1, self._segments + 1):
            cos, sin = cos_sin(start.heading + turn * segment)
            far_x += cos * x - sin * y
            far_y += sin * x + cos * y
            places.append((start.x + far_x, start.y + far_y))
        return places


class Path(Struct, frozen=True, dict=True):
    """A chain of n segments. From heading `start` (degrees) each segment turns by `turn` degrees
    and then goes from one of the n + 1 `places` (x, y in inches) to the next."""

    start: float
    turn: float
    places: Sequence[tuple[float, float]]
    """Plain numbers, not arrays: most paths have few segments, and most queries are about one place."""

    @classmethod
    def of_segments(cls, start: Pose, x: float, y: float, turn: float, segments: int) -> "Path":
        """Segments that each turn by `turn` degrees and then go (x, y) in the robot's frame."""
        places = [(start.x, start.y)] * (segments + 1)
        path = cls(start.heading, turn, places)
        cos, sin = path.directions
        far_x = start.x + np.cumsum(cos[1:] * x - sin[1:] * y)
        far_y = start.y + np.cumsum(sin[1:] * x + cos[1:] * y)
        places[1:] = zip(far_x.tolist(), far_y.tolist(), strict=True)
        return path

    @classmethod
    def lazy(cls, start: Pose, x: float, y: float, turn: float, segments: int) -> "Path":
        """`of_segments`, the same numbers bit for bit, with places computed at the first access. A log has
        millions of paths, and for most of them only the first place is used."""
        return cls(start.heading, turn, _LazyPlaces(start, x, y, turn, segments))

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.places) - 1

    @cached_property
    def points(self) -> FloatArray:
        """The places as an array, (n + 1, 2)."""
        return np.array(self.places)

    def headings_after(self, turns: FloatArray) -> FloatArray:
        """Headings after these numbers of turns."""
        return self.start + self.turn * turns

    @cached_property
    def directions(self) -> tuple[FloatArray, FloatArray]:
        """Cosines and sines of the headings at the start and after each turn, both (n + 1,)."""
        return cos_sin_array(self.headings_after(np.arange(self.segments + 1.0)))

    def pose(self, segment: int, turned: float, translated: float) -> Pose:
        """The pose inside a segment, after these fractions of its turn and its translation."""
        (x, y), (next_x, next_y) = self.places[segment], self.places[segment + 1]
        return Pose(
            x + translated * (next_x - x),
            y + translated * (next_y - y),
            self.start + self.turn * (segment + turned),
        )

    def lengths(self) -> list[float]:
        """Lengths of the n translations, inches. By sqrt: hypot may differ between processors."""
        lengths = []
        before_x, before_y = self.places[0]
        for x, y in self.places[1:]:
            dx, dy = x - before_x, y - before_y
            lengths.append(math.sqrt(dx * dx + dy * dy))
            before_x, before_y = x, y
        return lengths

    def length_to(self, stop: PathPosition) -> float:
        """Length of the path to a place, inches."""
        lengths = self.lengths()
        return math.fsum(lengths[: stop.segment]) + stop.translated * lengths[stop.segment]

    def along(self, at: PathPosition) -> tuple[float, float]:
        """Distance ahead and to the left till a place, inches, from the places."""
        ahead = aside = 0.0
        places = self.places
        for segment in range(at.segment + 1):
            (x, y), (next_x, next_y) = places[segment], places[segment + 1]
            part = 1.0 if segment < at.segment else at.translated
            cos, sin = cos_sin(self.start + self.turn * (segment + 1))
            ahead += part * ((next_x - x) * cos + (next_y - y) * sin)
            aside += part * ((next_y - y) * cos - (next_x - x) * sin)
        return ahead, aside

    def before(
        self, stop: PathPosition, distance: float, reach: float, after: PathPosition = PATH_START
    ) -> PathPosition:
        """The place on the path a distance before another, but not before `after`.

        Args:
            stop: Place from which to count back.
            distance: Length to go back, inches: of translations the path's own, of turns that of an arc
                `reach` inches from the robot's centre.
            reach: Distance of the robot's rim from its centre, inches.
            after: Place that is not passed.
        """
        lengths, arc = self.lengths(), math.radians(abs(self.turn)) * reach
        segment, turned, translated = stop.segment, stop.turned, stop.translated
        left = distance
        while True:
            gone = translated * lengths[segment]
            if left < gone:
                found = PathPosition(segment, turned, translated - left / lengths[segment])
                break
            left -= gone
            if left < turned * arc:
                found = PathPosition(segment, turned - left / arc, 0.0)
                break
            left -= turned * arc
            if segment <= after.segment:
                return after
            segment, turned, translated = segment - 1, 1.0, 1.0
        return max(found, after)


class Contact(Struct, frozen=True):
    """The first contact of a movement with an obstacle.

    `pose` is the robot's pose at contact, `point` the place of the obstacle it touches (global, inches).
    `segment` counts from 0; `turned` and `translated` are the fractions of that segment's turn and
    translation that were done. `time` is simulated time.

    `ended` is True if the contact ended the movement, there or on the rest of the command after its errors
    were dropped. `drift` is True if an error alone, not the commanded motion, led to the contact. That is the
    case in the turn of a translation and in the translation of a rotation. It is also the case in the
    translation of a translation, if the commanded motion without errors on other axes could continue from
    there by more than a millionth of an inch. `held_block` is True if the held block touches, not the robot's
    body. `cell` is the wall's cell: (row from the top, column from the left), counted from 1 as in maze.csv.
    Row 0, column 0, and the row and the column after the last are the outside. None for a solid block.
    """

    pose: Pose
    point: tuple[float, float]
    segment: int
    turned: float
    translated: float
    time: float = 0.0
    ended: bool = True
    drift: bool = False
    held_block: bool = False
    cell: tuple[int, int] | None = None

    @property
    def bearing(self) -> float:
        """Direction of the place that is touched, seen from the robot's centre: degrees from its front."""
        (x, y), pose = self.point, self.pose
        return math.degrees(math.atan2(y - pose.y, x - pose.x)) - pose.heading

    @property
    def place(self) -> PathPosition:
        """Position on the path."""
        return PathPosition(self.segment, self.turned, self.translated)


def distances(x: FloatArray, y: FloatArray) -> FloatArray:
    """Lengths of vectors, of any shape: numpy's hypot may differ between processors."""
    return np.asarray(np.sqrt(x * x + y * y))
