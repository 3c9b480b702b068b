"""Step 4b, a histogram filter: localize the robot by a probability for every cell and heading.

    simmer-tui --run "python samples/course/step4b_histogram.py"

Step 4 has random particles, this one every pose of a grid. Readings multiply, movements shift the belief.
Thrun, Burgard, Fox, Probabilistic Robotics, 2005, chapters 4 and 8: histogram filter, grid localization.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from step3_dead_reckoning import Motion, Odometry, turned
from step4_particle_filter import NO_ECHO, RANGES, Array

from simmer_tui import Robot, Simulator

STEP = 2.0  # in, the side of a cell
HEADINGS = 36  # directions, evenly spaced from 0
TURN = 360.0 / HEADINGS  # deg, between two directions
BLUR = 1.0  # in, change of a reading within a cell
OUTLIER = 0.02  # likelihood of an unexplained reading: a single one proves little
WAIT = 0.5  # s of real time before each look, to watch the belief; 0 for many trials
SURE = 0.9  # probability around the best pose when sure


class Histogram:
    """A probability for every row (1 on top), column and heading."""

    def __init__(self, simulator: Simulator) -> None:
        self.x = np.arange(STEP / 2, simulator.maze.width, STEP)
        self.y = np.arange(STEP / 2, simulator.maze.height, STEP)[::-1]
        self.heading = np.arange(HEADINGS) * TURN
        y, x, heading = np.meshgrid(self.y, self.x, self.heading, indexing="ij")
        poses = np.column_stack((x.ravel(), y.ravel(), heading.ravel()))
        self._expected = np.minimum(simulator.true_ranges(poses, RANGES), NO_ECHO).reshape(*x.shape, -1)
        # Change of a reading over half a step of heading: small at a wall, large past a corner.
        aside = np.abs(np.roll(self._expected, 1, axis=2) - np.roll(self._expected, -1, axis=2)) / 8
        errors = np.array([simulator.sensor(code).error for code in RANGES])
        self._variance: Array = (errors * self._expected) ** 2 + BLUR**2 + np.minimum(aside, 6) ** 2
        self._free = (self._expected > 0).all(axis=3)  # a sensor in a wall reads 0
        self.belief: Array = self._free / self._free.sum()

    def scatter(self, heading: float, deviation: float) -> None:
        """Restart with a belief anywhere on free floor, with about this heading."""
        off = (self.heading - heading + 180) % 360 - 180
        self._set(self._free * np.exp(-0.5 * (off / deviation) ** 2))

    def predict(self, motion: Motion) -> None:
        """Shift the belief as the robot has moved: each heading in its own direction."""
        for k, (x, y) in enumerate(turned(motion.forward, motion.left, self.heading + motion.turn / 2).T):
            self.belief[:, :, k] = shifted(shifted(self.belief[:, :, k], -y / STEP, 0), x / STEP, 1)
        whole, part = divmod(motion.turn / TURN, 1)
        before, after = (np.roll(self.belief, int(whole) + more, axis=2) for more in (0, 1))
        self._set((1 - part) * before + part * after)

    def update(self, readings: Array) -> None:
        """Weigh all poses by a reading of each of RANGES."""
        away = np.minimum(readings, NO_ECHO) - self._expected
        self._set(self.belief * (np.exp(-0.5 * away**2 / self._variance) + OUTLIER).prod(axis=3))

    def _set(self, belief: Array) -> None:
        # A belief of 0 would stay 0 whatever the readings say.
        belief = np.where(self._free, belief / belief.sum() + 1e-9, 0)
        self.belief = belief / belief.sum()

    def best(self) -> tuple[Array, float]:
        """The most probable pose, and the share of the belief within two cells and headings of it."""
        row, column, heading = map(int, np.unravel_index(self.belief.argmax(), self.belief.shape))
        near = self.belief[max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3]
        share = np.take(near, range(heading - 2, heading + 3), axis=2, mode="wrap").sum()
        return np.array((self.x[column], self.y[row], self.heading[heading])), float(share)


def shifted(plane: Array, cells: float, axis: int) -> Array:
    """A plane moved along an axis by a number of cells; a part of a cell is shared between two."""
    whole, part = divmod(cells, 1)
    room = abs(int(whole)) + 1  # beside the plane, so that what leaves it does not come back opposite
    wide = np.pad(plane, [(room, room) if each == axis else (0, 0) for each in (0, 1)])
    moved = (1 - part) * np.roll(wide, int(whole), axis) + part * np.roll(wide, int(whole) + 1, axis)
    return np.take(moved, range(room, room + plane.shape[axis]), axis)


def look(robot: Robot, histogram: Histogram) -> float:
    """Read the range sensors, weigh, and show the result; returns how far it is free ahead, 0 if unknown."""
    time.sleep(WAIT)
    readings = robot.read(*RANGES)
    histogram.update(np.array(readings))
    robot.believe(grid=histogram.belief, note=f"{histogram.best()[1]:.0%} sure")
    return readings[0] if readings[0] < NO_ECHO else 0.0  # without an echo a wall may be near


def localize(robot: Robot, histogram: Histogram, odometry: Odometry) -> bool:
    """Turn on the spot and read the sensors until the robot is localized; if places look alike, drive on."""
    robot.believe(grid=histogram.belief, note="anywhere")
    compass = np.radians(robot.read(*["c1"] * 25))  # it reads heading times (1 + error)
    heading = np.degrees(np.arctan2(np.sin(compass).mean(), np.cos(compass).mean())) % 360
    histogram.scatter(heading, 10 + 0.03 * heading)
    for _ in range(4):
        ahead = []
        for _ in range(9):
            ahead.append(look(robot, histogram))
            if histogram.best()[1] > SURE:
                return True
            robot.drive("r1", 40)
            histogram.predict(odometry.motion())
        for code, value in (("r1", 40 * int(np.argmax(ahead))), ("d1", min(8, max(ahead) - 3))):
            robot.drive(code, value)
            histogram.predict(odometry.motion())
    return False


if __name__ == "__main__":
    with Robot() as robot:
        histogram = Histogram(Simulator(robot.configuration()))
        found = localize(robot, histogram, Odometry(robot))
    print("at" if found else "perhaps at", "({:.0f}, {:.0f}) heading {:.0f}".format(*histogram.best()[0]))
    sys.exit(0 if found else 1)
