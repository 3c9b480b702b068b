"""What the program believes: where the robot is, and where the block lies.

Both are the same idea. Keep many guesses; for each, work out what the sensors would say if it were
true; give the guesses that explain the readings more weight.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from solve_ground import CELL, Ground, centre

from simmer_tui.sim import Block, SensorSpec, Simulator

FloatArray = NDArray[np.float64]

MANY, SOME, FEW = 12_000, 3_000, 500  # particles: at first, while unsure, when sure
SURE = 1.5  # in, spread of the particles below which few will do
BLURS = (0.15, 0.3, 0.6, 1.2, 2.4)  # in, errors of range sensors beyond those in sensors.csv
LEAST_EFFECTIVE = 0.05  # fraction of the particles that must still count after a reading
DOUBTFUL = 0.5  # fraction of explained readings at which a belief is in doubt
OUTLIER = 1e-4  # likelihood of a reading that nothing explains, so that one of them proves nothing


class Localizer:
    """A particle filter: each particle is a pose (x, y, heading) the robot may have.

    `ranges` are the codes of the range sensors to localize by. They must look over the block,
    whose place is unknown; `simulator` is only asked what they would see.
    """

    def __init__(
        self, simulator: Simulator, ground: Ground, ranges: Sequence[str], random: np.random.Generator
    ) -> None:
        self.ranges = tuple(ranges)
        self._simulator = simulator
        self._ground = ground
        self._random = random
        self._errors = np.array([simulator.sensor(code).error for code in ranges])
        self.forget()

    def forget(self) -> None:
        """It may be anywhere: `scatter` comes next."""
        self.particles: FloatArray = np.empty((0, 3))
        self._weights: FloatArray = np.empty(0)
        self.fit = 0.0
        """Share of the last readings that the belief explains, 0 to 1."""

    def scatter(self, radius: float, heading: float, deviation: float) -> None:
        """Start anew: anywhere a robot of `radius` inches fits, with about this heading (degrees)."""
        corners = (centre(cell) - CELL / 2 for cell in self._ground.cells())
        room = np.array(list(corners))
        # More than are wanted: most places in a corridor are too close to a wall.
        x_y = room[self._random.integers(len(room), size=4 * MANY)]
        x_y = x_y + self._random.uniform(0.0, CELL, x_y.shape)
        x_y = x_y[self._ground.clearance(x_y) >= radius][:MANY]
        headings = self._random.normal(heading, deviation, len(x_y))
        self.particles = np.column_stack((x_y, headings))
        self._weights = np.full(len(x_y), 1.0 / len(x_y))

    @property
    def pose(self) -> FloatArray:
        """The mean of the particles: x, y (inches) and heading (degrees)."""
        x, y = self._weights @ self.particles[:, :2]
        return np.array((x, y, self._mean_heading()))

    @property
    def spread(self) -> float:
        """Standard deviation of the position, inches."""
        variance = self._weights @ (self.particles[:, :2] - self.pose[:2]) ** 2
        return float(np.sqrt(variance.sum()))

    @property
    def settled(self) -> bool:
        """Whether the robot knows where it is."""
        off = wrapped(self.particles[:, 2] - self._mean_heading())
        return self.spread < 0.7 and float(self._weights @ off**2) < 4.0**2 and self.fit > DOUBTFUL

    def predict(self, forward: float, left: float, turn: float) -> None:
        """The robot has moved, by its odometers (inches) and its gyroscope (degrees).

        Every particle does the same, each with an error of its own.
        """
        count = len(self.particles)
        along = forward + (0.015 * abs(forward) + 0.02) * self._random.standard_normal(count)
        aside = left + (0.015 * abs(left) + 0.02) * self._random.standard_normal(count)
        turned = turn + (0.005 * abs(turn) + 0.1) * self._random.standard_normal(count)
        # The robot turns evenly on its way, so that its mean heading is the one halfway.
        middle = np.radians(self.particles[:, 2] + turned / 2)
        self.particles[:, 0] += np.cos(middle) * along - np.sin(middle) * aside
        self.particles[:, 1] += np.sin(middle) * along + np.cos(middle) * aside
        self.particles[:, 2] += turned

    def update(self, readings: FloatArray, repeats: int) -> None:
        """Weigh the particles by the readings of the range sensors, each the mean of `repeats`."""
        expected = self._simulator.true_ranges(self.particles, self.ranges)
        near = np.isfinite(readings)  # beyond its greatest range a sensor says infinity
        off = (readings - expected)[:, near]
        deviation = (self._errors * expected / np.sqrt(repeats))[:, near]
        # No particle is exactly right, so that exact sensors would rule out all of them. Blur the
        # readings no more than it takes to keep some.
        for blur in BLURS:
            likelihood = np.exp(-0.5 * off**2 / (deviation**2 + blur**2)) + OUTLIER
            weights = self._weights * likelihood.prod(axis=1)
            weights /= weights.sum()
            if effective(weights) >= LEAST_EFFECTIVE * len(weights):
                break
        self._weights = weights
        self.fit = float(weights @ (likelihood > 0.01).mean(axis=1))
        wanted = FEW if self.spread < SURE else SOME
        if effective(weights) < len(weights) / 2 or len(weights) > wanted:
            self._resample(wanted, 0.03 + 0.1 * blur)

    def _resample(self, count: int, jitter: float) -> None:
        """Draw new particles from the old ones by weight ("low variance"), `jitter` inches off."""
        places = (self._random.uniform() + np.arange(count)) / count
        chosen = np.searchsorted(np.cumsum(self._weights), places).clip(max=len(self._weights) - 1)
        off = self._random.standard_normal((count, 3)) * jitter
        self.particles = self.particles[chosen] + off * (1.0, 1.0, 4.0)
        self._weights = np.full(count, 1.0 / count)

    def _mean_heading(self) -> float:
        angles = np.radians(self.particles[:, 2])
        return float(np.degrees(np.arctan2(self._weights @ np.sin(angles), self._weights @ np.cos(angles))))


class BlockFinder:
    """Where the block may lie: a grid of guesses all over the cells of value 3, each with a weight.

    `high` and `low` are two range sensors at the same place, one of which looks over the block:
    where the low one sees less far, there is the block.
    """

    STEP = 0.5  # in, between guesses
    BLUR = 0.4  # in, for the grid and for errors of the robot's pose

    def __init__(self, ground: Ground, low: SensorSpec, size: float, zone: Sequence[tuple[int, int]]) -> None:
        self._sensor = low
        self._block = Block(0.0, 0.0, size)
        steps = np.arange(self.STEP / 2, CELL, self.STEP)
        in_cell = np.array([(x, y) for x in steps for y in steps])
        guesses = np.concatenate([centre(cell) - CELL / 2 + in_cell for cell in zone])
        self.guesses: FloatArray = guesses[ground.clearance(guesses) >= size / 2]
        self.forget()

    def forget(self) -> None:
        """It may be anywhere."""
        self.weights: FloatArray = np.full(len(self.guesses), 1.0 / len(self.guesses))

    @property
    def place(self) -> FloatArray:
        """The mean of the guesses, x and y."""
        return np.asarray(self.weights @ self.guesses)

    @property
    def spread(self) -> float:
        """Their standard deviation, inches."""
        return float(np.sqrt((self.weights @ (self.guesses - self.place) ** 2).sum()))

    def update(self, pose: FloatArray, high: float, low: float, repeats: int) -> None:
        """Weigh the guesses by what the two sensors read from a pose, each the mean of `repeats`."""
        expected = np.minimum(self._ranges(pose), high)
        deviation = np.hypot(self._sensor.error * expected * np.sqrt(2 / repeats), self.BLUR)
        likelihood = np.exp(-0.5 * ((low - expected) / deviation) ** 2) + OUTLIER
        self.weights = self.weights * likelihood
        self.weights /= self.weights.sum()

    def _ranges(self, pose: FloatArray) -> FloatArray:
        """How far from the low sensor the block would be, (n,); infinite where it would not be seen."""
        sensor = self._sensor
        origin = pose[:2] + rotated(np.array((sensor.x, sensor.y)), pose[2])
        fan = np.linspace(-0.5, 0.5, sensor.rays) * sensor.field_of_view
        bearings = np.radians(pose[2] + sensor.rotation + fan)
        # A ray and a block anywhere are a block at the origin and a ray from elsewhere.
        x, y = (origin - self.guesses).T
        cast = self._block.cast_many
        every = np.ones(len(x))
        rays = [cast(x, y, np.cos(bearing) * every, np.sin(bearing) * every) for bearing in bearings]
        return np.asarray(np.min(rays, axis=0))


def effective(weights: FloatArray) -> float:
    """How many equal particles would say as much as these."""
    return 1.0 / float(weights @ weights)


def wrapped(degrees: FloatArray) -> FloatArray:
    """Angles brought to -180 up to 180."""
    return np.asarray((degrees + 180.0) % 360.0 - 180.0)


def rotated(vector: FloatArray, degrees: float) -> FloatArray:
    """A vector turned counter-clockwise."""
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array((cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]))
