"""The block: a square the robot fetches, seen by sensors that are low enough."""

import math

import numpy as np
from msgspec import Struct

from simmer_tui.sim.angles import cos_sin
from simmer_tui.sim.arrays import FloatArray


class Block(Struct, frozen=True):
    """A square of side `size` around (x, y), inches, turned by `heading` degrees. A size of 0 means no block:
    nothing sees, touches or grasps it."""

    x: float
    y: float
    size: float
    heading: float = 0.0

    def corners(self) -> FloatArray:
        """The four corners, (4, 2), counter-clockwise."""
        half = self.size / 2
        cos, sin = cos_sin(self.heading)
        square = ((half, half), (-half, half), (-half, -half), (half, -half))
        return np.array([(cos * x - sin * y + self.x, sin * x + cos * y + self.y) for x, y in square])

    def cast(self, x: float, y: float, dx: float, dy: float) -> float:
        """Distance from (x, y) along the unit vector (dx, dy) to the block's boundary, infinite if
        the ray misses. From inside it is the distance to the far side."""
        x, y = x - self.x, y - self.y
        # Rays meet a turned block in its own frame. An unturned block keeps its coordinates bit for bit.
        if self.heading:
            cos, sin = cos_sin(self.heading)
            x, y = cos * x + sin * y, cos * y - sin * x
            dx, dy = cos * dx + sin * dy, cos * dy - sin * dx
        half = self.size / 2
        near, far = -math.inf, math.inf
        for position, direction in ((x, dx), (y, dy)):
            # Parallel to these two faces: inside their strip they bound nothing, outside of it the ray
            # misses.
            if direction == 0.0:
                if abs(position) > half:
                    return math.inf
                continue
            first, second = (-half - position) / direction, (half - position) / direction
            near = max(near, min(first, second))
            far = min(far, max(first, second))
        if far < 0.0 or near > far:
            return math.inf
        # A sensor on its face is 0.0 away, not -0.0.
        return near + 0.0 if near >= 0.0 else far

    def cast_many(self, x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray) -> FloatArray:
        """`cast` for arrays, all (n,)."""
        x, y = x - self.x, y - self.y
        if self.heading:
            cos, sin = cos_sin(self.heading)
            x, y = cos * x + sin * y, cos * y - sin * x
            dx, dy = cos * dx + sin * dy, cos * dy - sin * dx
        half = self.size / 2
        near, far = np.full(len(x), -np.inf), np.full(len(x), np.inf)
        for position, direction in ((x, dx), (y, dy)):
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                first, second = (-half - position) / direction, (half - position) / direction
            still = direction == 0.0
            outside = still & (np.abs(position) > half)
            low = np.where(still, np.where(outside, np.inf, -np.inf), np.minimum(first, second))
            high = np.where(still, np.inf, np.maximum(first, second))
            near, far = np.maximum(near, low), np.minimum(far, high)
        distance = np.where(near >= 0.0, near + 0.0, far)
        return np.where((far < 0.0) | (near > far), np.inf, distance)

    def incidence(
        self, x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, distances: FloatArray
    ) -> FloatArray:
        """Cosines of the angles between rays and the normals of the faces they end on, all (n,); 0
        for those that miss (infinite distances)."""
        cos, sin = cos_sin(self.heading)
        across, along = cos * dx + sin * dy, cos * dy - sin * dx
        reach = np.where(np.isfinite(distances), distances, 0.0)
        x, y = x + reach * dx - self.x, y + reach * dy - self.y
        half = self.size / 2
        # The face that a ray ends on is the one whose line is nearest to its end.
        off_x, off_y = np.abs(np.abs(cos * x + sin * y) - half), np.abs(np.abs(cos * y - sin * x) - half)
        met = np.where(off_x < off_y, np.abs(across), np.abs(along))
        return np.where(np.isfinite(distances), met, 0.0)
