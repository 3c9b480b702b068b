"""Step 4, a particle filter: localize the robot without knowing its start.

    simmer-tui --run "python samples/course/step4_particle_filter.py"

Keep many guesses of the pose; give those that explain the readings more weight; draw new ones by weight.
Thrun, Burgard, Fox, Probabilistic Robotics, 2005, chapters 4 and 8: Monte Carlo localization.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray
from step3_dead_reckoning import Motion, Odometry, turned

from simmer_tui import Robot, Simulator

RANGES = ("u1", "u2", "u3", "u4")  # the range sensors, all of which look over the block
MANY = 8000  # particles at first
FEW = 800  # particles once the robot knows about where it is
BLUR = 0.4  # in, error of the best particles: none is exactly at the true pose
OUTLIER = 1e-3  # likelihood of an unexplained reading: a single one proves little
SURE = 0.8  # in, spread when sure
DOUBT = 0.4  # share of explained readings when lost
CELL = 12.0  # in
NO_ECHO = 120.0  # in, in place of inf: longer than any straight line through the maze

Array = NDArray[np.float64]


class Localizer:
    """A particle filter. Each particle is a pose: x, y (in) and heading (deg)."""

    def __init__(self, simulator: Simulator, random: np.random.Generator) -> None:
        self._simulator, self._random = simulator, random  # only computes expected readings
        self.particles, self.weights = np.empty((0, 3)), np.empty(0)
        self.fit = 0.0  # share of the last readings that the particles explain

    def scatter(self, heading: float, deviation: float) -> None:
        """Restart with particles anywhere on free floor, with about this heading."""
        rows = self._simulator.spec.maze.cells[::-1]
        free = [(x, y) for y, row in enumerate(rows) for x, value in enumerate(row) if value]
        cells = np.array(free)[self._random.integers(len(free), size=MANY)]
        places = (cells + self._random.uniform(0.25, 0.75, cells.shape)) * CELL  # the robot is 6 in wide
        self.particles = np.column_stack((places, self._random.normal(heading, deviation, MANY)))
        self.weights = np.full(MANY, 1 / MANY)

    def predict(self, motion: Motion) -> None:
        """Move every particle as the robot has moved, each with a random error."""
        counted = np.array((motion.forward, motion.left, motion.turn))
        noise = (0.015, 0.015, 0.012) * np.abs(counted) + (0.02, 0.02, 0.1)
        forward, left, turn = (counted + noise * self._random.standard_normal(self.particles.shape)).T
        self.particles += np.column_stack((*turned(forward, left, self.particles[:, 2] + turn / 2), turn))

    def update(self, readings: Array) -> None:
        """Weigh the particles by a reading of each of RANGES."""
        expected = np.minimum(self._simulator.true_ranges(self.particles, RANGES), NO_ECHO)
        errors = np.array([self._simulator.sensor(code).error for code in RANGES])
        deviation = np.hypot(errors * expected, BLUR)
        likelihood = np.exp(-0.5 * ((np.minimum(readings, NO_ECHO) - expected) / deviation) ** 2)
        self.weights = self.weights * (likelihood + OUTLIER).prod(axis=1)
        self.weights /= self.weights.sum()
        self.fit = float(self.weights @ (likelihood > 0.03).mean(axis=1))
        if 1 / (self.weights @ self.weights) < len(self.weights) / 2:
            self._resample(FEW if self.spread < 2 * SURE else MANY // 2)

    def _resample(self, count: int) -> None:
        """Draw new particles by weight ("low variance"), a little off the old ones."""
        places = (self._random.uniform() + np.arange(count)) / count
        chosen = np.searchsorted(np.cumsum(self.weights), places).clip(max=len(self.weights) - 1)
        self.particles = self.particles[chosen] + self._random.normal(0, (0.08, 0.08, 0.4), (count, 3))
        self.weights = np.full(count, 1 / count)

    @property
    def pose(self) -> Array:
        """The mean of the particles; that of angles goes by their directions, as 359 and 1 make 0."""
        angles = np.radians(self.particles[:, 2])
        heading = np.degrees(np.arctan2(self.weights @ np.sin(angles), self.weights @ np.cos(angles)))
        return np.array((*(self.weights @ self.particles[:, :2]), heading))

    @property
    def spread(self) -> float:
        """Standard deviation of the place, inches."""
        return float(np.sqrt((self.weights @ (self.particles[:, :2] - self.pose[:2]) ** 2).sum()))


def look(robot: Robot, localizer: Localizer, note: str = "") -> float:
    """Read the range sensors, update, and show the belief; returns the free distance ahead, 0 if unknown."""
    readings = robot.read(*RANGES)
    localizer.update(np.array(readings))
    robot.believe(*localizer.pose, localizer.spread, localizer.particles[:200], note)
    return readings[0] if readings[0] < NO_ECHO else 0.0  # without an echo a wall may be near


def localize(robot: Robot, localizer: Localizer, odometry: Odometry) -> bool:
    """Turn on the spot and read the sensors until the robot is localized; if places look alike, drive on."""
    compass = np.radians(robot.read(*["c1"] * 25))  # a reading is heading times (1 + error)
    heading = np.degrees(np.arctan2(np.sin(compass).mean(), np.cos(compass).mean())) % 360
    localizer.scatter(heading, 5 + 0.03 * heading)
    for _ in range(4):
        ahead = []
        for _ in range(8):
            ahead.append(look(robot, localizer, "where am I?"))
            if localizer.spread < SURE and localizer.fit > DOUBT:
                return True
            robot.drive("r1", 45)
            localizer.predict(odometry.motion())
        for code, value in (("r1", 45 * int(np.argmax(ahead))), ("d1", min(8, max(ahead) - 3))):
            robot.drive(code, value)
            localizer.predict(odometry.motion())
    return False


if __name__ == "__main__":
    with Robot() as robot:
        localizer = Localizer(Simulator(robot.configuration()), np.random.default_rng(0))
        found = localize(robot, localizer, Odometry(robot))
    print("at ({:.1f}, {:.1f}) heading {:.0f}".format(*localizer.pose), f"within {localizer.spread:.1f} in")
    sys.exit(0 if found else 1)
