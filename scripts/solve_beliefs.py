"""Beliefs of the program: the robot's pose, and the block's place.

Both use the same idea. Keep many guesses; for each, compute the expected readings; give guesses that explain
the readings more weight. Both also choose the most informative reading: the one whose answer the guesses
predict most differently (`surprise`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from solve_ground import CELL, Ground, centre

from simmer_tui.sim import Block, RangeSpec, Simulator

FloatArray = NDArray[np.float64]

MANY, SOME, FEW = 12_000, 3_000, 500  # particles: at first, while unsure, when sure
SAMPLE = 150  # particles for the choice of a sensor to read
SURE = 1.5  # in, spread of the particles below which few are enough
BLURS = (0.15, 0.3, 0.6, 1.2, 2.4)  # in, errors of range sensors beyond those in sensors.csv
LEAST_EFFECTIVE = 0.05  # fraction of the particles that must still count after a reading
DOUBTFUL = 0.5  # fraction of explained readings at which a belief is in doubt
OUTLIER = 1e-3  # likelihood of an unexplained reading, so that a single one has little effect
MISSED = 0.1  # likelihood of no echo where there should be one
UNFORESEEN = 0.02  # likelihood of an echo where there should be none


class Localizer:
    """A particle filter: each particle is a pose (x, y, heading) the robot may have.

    `ranges` are the codes of the range sensors to localize by. They must look over the block, whose place is
    unknown; `simulator` only gives expected readings.
    """

    def __init__(
        self, simulator: Simulator, ground: Ground, ranges: Sequence[str], random: np.random.Generator
    ) -> None:
        self.ranges = tuple(ranges)
        self._simulator = simulator
        self._ground = ground
        self._random = random
        self.forget()

    def forget(self) -> None:
        """Drop all particles; call `scatter` next."""
        self.particles: FloatArray = np.empty((0, 3))
        self._weights: FloatArray = np.empty(0)
        self.fit = 0.0
        """Share of the last readings that the belief explains, 0 to 1."""

    def scatter(self, radius: float, heading: float, deviation: float) -> None:
        """Restart with particles anywhere a robot of `radius` inches fits, with about this heading
        (degrees)."""
        corners = (centre(cell) - CELL / 2 for cell in self._ground.cells())
        room = np.array(list(corners))
        # More than needed: most places in a corridor are too close to a wall.
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
        """True if the spread is small enough for a known pose."""
        off = wrapped(self.particles[:, 2] - self._mean_heading())
        return self.spread < 0.7 and float(self._weights @ off**2) < 4.0**2 and self.fit > DOUBTFUL

    def predict(self, forward: float, left: float, turn: float) -> None:
        """Move the particles, by the odometers (inches) and the gyroscope (degrees).

        Every particle does the same, each with an error of its own.
        """
        count = len(self.particles)
        along = forward + (0.015 * abs(forward) + 0.02) * self._random.standard_normal(count)
        aside = left + (0.015 * abs(left) + 0.02) * self._random.standard_normal(count)
        turned = turn + (0.012 * abs(turn) + 0.1) * self._random.standard_normal(count)
        # The robot turns evenly during a movement, so that its mean heading is the one halfway.
        middle = np.radians(self.particles[:, 2] + turned / 2)
        self.particles[:, 0] += np.cos(middle) * along - np.sin(middle) * aside
        self.particles[:, 1] += np.sin(middle) * along + np.cos(middle) * aside
        self.particles[:, 2] += turned

    def worth(self, turn: float = 0.0) -> FloatArray:
        """Information in a reading of each sensor after a turn on the spot, bits: 1/2 log2(1 + (spread /
        error)^2), for normal guesses and errors."""
        places = (self._random.uniform() + np.arange(SAMPLE)) / SAMPLE
        sample = self.particles[self._chosen(places)] + (0.0, 0.0, turn)
        bits = []
        for code, expected in zip(self.ranges, self._expected(sample, self.ranges).T):
            heard = expected[np.isfinite(expected)]
            if len(heard) < 2:
                bits.append(0.0)
                continue
            error = np.hypot(self._deviation(code, heard).mean(), BLURS[0])
            bits.append(len(heard) / SAMPLE * 0.5 * np.log2(1.0 + heard.var() / error**2))
        return np.array(bits)

    def update(self, codes: Sequence[str], readings: FloatArray) -> None:
        """Weigh the particles by a reading of each of some range sensors."""
        expected = self._expected(self.particles, codes)
        deviations = np.column_stack(
            [self._deviation(code, column) for code, column in zip(codes, expected.T)]
        )
        foreseen, heard = np.isfinite(expected), np.isfinite(readings)
        off = np.where(foreseen & heard, readings, 0.0) - np.where(foreseen & heard, expected, 0.0)
        deviations = np.where(foreseen, deviations, 1.0)
        # No particle is exactly right, so that exact sensors would rule out all of them. Blur the readings by
        # just enough to keep some.
        for blur in BLURS:
            likelihood = np.exp(-0.5 * off**2 / (deviations**2 + blur**2)) + OUTLIER
            likelihood = np.where(foreseen & ~heard, MISSED, likelihood)
            likelihood = np.where(~foreseen & heard, UNFORESEEN, likelihood)
            weights = self._weights * likelihood.prod(axis=1)
            weights /= weights.sum()
            if effective(weights) >= LEAST_EFFECTIVE * len(weights):
                break
        self._weights = weights
        self.fit = float(weights @ (likelihood > 0.03).mean(axis=1))
        wanted = FEW if self.spread < SURE else SOME
        if effective(weights) < len(weights) / 2 or len(weights) > wanted:
            self._resample(wanted, 0.03 + 0.1 * blur)

    def _expected(self, poses: FloatArray, codes: Sequence[str]) -> FloatArray:
        """Expected readings at some poses, (n, k): infinity where there is no echo."""
        expected = self._simulator.true_ranges(poses, codes)
        farthest = np.array([self._simulator.sensor(code).max_range for code in codes])
        return np.where(expected > farthest, np.inf, expected)

    def _deviation(self, code: str, expected: FloatArray) -> FloatArray:
        """The standard deviation of a sensor's readings, inches."""
        sensor = self._simulator.sensor(code)
        return np.hypot(sensor.error * expected, sensor.absolute_error)

    def _resample(self, count: int, jitter: float) -> None:
        """Draw new particles from the old ones by weight ("low variance"), `jitter` inches off."""
        places = (self._random.uniform() + np.arange(count)) / count
        off = self._random.standard_normal((count, 3)) * jitter
        self.particles = self.particles[self._chosen(places)] + off * (1.0, 1.0, 4.0)
        self._weights = np.full(count, 1.0 / count)

    def _chosen(self, places: FloatArray) -> NDArray[np.intp]:
        return np.searchsorted(np.cumsum(self._weights), places).clip(max=len(self._weights) - 1)

    def _mean_heading(self) -> float:
        return mean_angle(self.particles[:, 2], self._weights)


class BlockFinder:
    """Belief of the block's place: a grid of guesses over all cells of value 3, each with a weight.

    `sensors` are the codes of two range sensors in the same place: one looks over the block, the other sees
    it. `simulator` only gives the distances of walls.
    """

    STEP = 0.5  # in, between guesses
    BLUR = 0.4  # in, for the grid and for errors of the robot's pose

    def __init__(
        self,
        simulator: Simulator,
        ground: Ground,
        sensors: tuple[str, str],
        size: float,
        zone: Sequence[tuple[int, int]],
    ) -> None:
        self._simulator = simulator
        self._high, low = sensors
        sensor = simulator.sensor(low)
        assert isinstance(sensor, RangeSpec)
        self._sensor = sensor
        self._block = Block(0.0, 0.0, size)
        steps = np.arange(self.STEP / 2, CELL, self.STEP)
        in_cell = np.array([(x, y) for x in steps for y in steps])
        guesses = np.concatenate([centre(cell) - CELL / 2 + in_cell for cell in zone])
        self.guesses: FloatArray = guesses[ground.clearance(guesses) >= size / 2]
        self.forget()

    def forget(self) -> None:
        """Give all guesses equal weights."""
        self.weights: FloatArray = np.full(len(self.guesses), 1.0 / len(self.guesses))

    @property
    def place(self) -> FloatArray:
        """The mean of the guesses, x and y."""
        return np.asarray(self.weights @ self.guesses)

    @property
    def spread(self) -> float:
        """The standard deviation of the guesses, inches."""
        return float(np.sqrt((self.weights @ (self.guesses - self.place) ** 2).sum()))

    def surprise(self, pose: FloatArray) -> float:
        """Information of a reading at a pose, bits."""
        likely = self.weights > 0.01 * self.weights.max()
        weights = self.weights[likely]
        expected = np.minimum(self._ranges(pose, self.guesses[likely], 5), self.wall(pose))
        return surprise(expected, weights / weights.sum())

    def wall(self, pose: FloatArray) -> float:
        """Ranges of both sensors from a pose if there were no block."""
        return float(self._simulator.true_ranges(pose[None, :], (self._high,))[0, 0])

    def update(self, pose: FloatArray, wall: float, low: float) -> None:
        """Weigh the guesses by a reading of the low sensor at a pose; `wall` is the distance of the wall
        behind."""
        expected = np.minimum(self._ranges(pose, self.guesses, self._sensor.rays), wall)
        foreseen = np.isfinite(expected)
        near = np.where(foreseen, expected, 0.0)
        deviation = np.hypot(np.hypot(self._sensor.error * near, self._sensor.absolute_error), self.BLUR)
        if np.isfinite(low):
            hit = np.exp(-0.5 * ((low - near) / deviation) ** 2) + OUTLIER
            likelihood = np.where(foreseen, hit, UNFORESEEN)
        else:
            likelihood = np.where(foreseen, MISSED, 1.0)
        self.weights = self.weights * likelihood
        self.weights /= self.weights.sum()

    def _ranges(self, pose: FloatArray, guesses: FloatArray, rays: int) -> FloatArray:
        """Distance of the block from the low sensor, (n,); infinite where it would not be seen:
        behind a wall, beside the fan of rays, or at an angle that sends no echo back."""
        sensor = self._sensor
        origin = pose[:2] + rotated(np.array((sensor.x, sensor.y)), pose[2])
        bearings = pose[2] + sensor.rotation + np.linspace(-0.5, 0.5, rays) * sensor.field_of_view
        walls = self._simulator.cast_rays(np.tile(origin, (rays, 1)), bearings)
        # The ray is shifted so that the block is at the origin.
        x, y = (origin - guesses).T
        every = np.ones(len(x))
        nearest = np.full(len(x), np.inf)
        for bearing, wall in zip(np.radians(bearings), walls):
            ray = x, y, np.cos(bearing) * every, np.sin(bearing) * every
            distances = self._block.cast_many(*ray)
            seen = distances < wall
            if sensor.incidence_limit:
                seen &= self._block.incidence(*ray, distances) >= np.cos(np.radians(sensor.incidence_limit))
            nearest = np.where(seen, np.minimum(nearest, distances), nearest)
        return nearest


def surprise(expected: FloatArray, weights: FloatArray) -> float:
    """Entropy of a reading, bits, over the rounded expectations of the guesses."""
    rounded = np.where(np.isfinite(expected), np.round(expected), -1.0).astype(np.intp) + 1
    shares = np.bincount(rounded, weights)
    shares = shares[shares > 0.0]
    return float(-(shares * np.log2(shares)).sum())


def effective(weights: FloatArray) -> float:
    """Effective number of particles: the number of equal weights with the same information."""
    return 1.0 / float(weights @ weights)


def mean_angle(degrees: FloatArray, weights: FloatArray) -> float:
    """The circular mean of angles, degrees: of 359 and 1 it is 0."""
    angles = np.radians(degrees)
    return float(np.degrees(np.arctan2(weights @ np.sin(angles), weights @ np.cos(angles))))


def wrapped(degrees: FloatArray) -> FloatArray:
    """Angles wrapped to -180 up to 180."""
    return np.asarray((degrees + 180.0) % 360.0 - 180.0)


def rotated(vector: FloatArray, degrees: float) -> FloatArray:
    """A vector turned counter-clockwise."""
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array((cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]))
