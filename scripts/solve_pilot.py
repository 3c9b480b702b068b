"""Driving: small moves, each measured, each correcting the one before."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

import numpy as np
from solve_beliefs import DOUBTFUL, FloatArray, Localizer, rotated

RANGES = ("u1", "u2", "u3", "u4", "t1")  # all those that look over the block
ALONG, ASIDE, GYROSCOPE = ("o3", "o4"), ("o1", "o2"), "g1"
DRIVES = ("d1", "w1", "r1")  # forward, left, turn
LEAST = (0.03, 0.03, 0.3)  # in, in, deg: smaller commands are not worth it
REPEATS = 5  # readings a sensor: their mean errs less than one of them
STRIDE, SWING = 4.0, 15.0  # in, deg: the largest move before the robot looks again
PRIOR = np.array((4.0, 4.0, 100.0))  # in2, in2, deg2: how far to drive until its own bias is believed


class LostError(Exception):
    """The readings do not fit the place where the robot seems to be."""


class RobotLike(Protocol):
    """What is needed of `simmer_tui.client.Robot`."""

    def read(self, code: str) -> float: ...
    def drive(self, code: str, value: float) -> None: ...
    def believe(
        self,
        x: float,
        y: float,
        heading: float,
        spread: float | None = None,
        particles: Iterable[Iterable[float]] | None = None,
        note: str | None = None,
    ) -> None: ...


class DriveModel:
    """What one inch or degree of each drive really does, learned while driving.

    Each drive has a bias of its own: driving forward also turns the robot a little, say. Column j
    of the matrix is the motion (forward, left, turn) that one unit of drive j makes.
    """

    def __init__(self) -> None:
        self._weights = PRIOR.copy()
        self._columns = np.eye(3) * PRIOR

    def learn(self, drive: int, value: float, motion: FloatArray) -> None:
        """Least squares over all that the drive has done so far, beginning with no bias."""
        self._weights[drive] += value**2
        self._columns[:, drive] += value * motion

    def commands(self, motion: FloatArray) -> FloatArray:
        """The three drives' values that together make a motion."""
        return np.asarray(np.linalg.solve(self._columns / self._weights, motion))


class Pilot:
    """Moves the robot and keeps its belief up to date.

    `reach` is how far ahead of the robot's centre the middle of its body is, inches: 0, or more
    while it holds the block. What is steered is the middle of the body.
    """

    def __init__(self, robot: RobotLike, localizer: Localizer) -> None:
        self.robot = robot
        self.localizer = localizer
        self.reach = 0.0
        self.note = ""
        self._model = DriveModel()
        self._counted = self._counters()

    @property
    def middle(self) -> FloatArray:
        """Where the middle of the body is, x and y."""
        pose = self.localizer.pose
        return np.asarray(pose[:2] + self._ahead(pose[2]))

    def mean(self, code: str, repeats: int = REPEATS) -> float:
        """The mean of some readings of a sensor."""
        return float(np.mean([self.robot.read(code) for _ in range(repeats)]))

    def sense(self) -> None:
        """Look at the walls, and show what comes of it."""
        localizer = self.localizer
        localizer.update(np.array([self.mean(code) for code in localizer.ranges]), REPEATS)
        x, y, heading = localizer.pose
        self.robot.believe(x, y, heading, localizer.spread, localizer.particles[:200], self.note)

    def move(self, forward: float, left: float, turn: float) -> None:
        """Move in the robot's own frame, inches and degrees, then look."""
        values = self._model.commands(np.array((forward, left, turn)))
        for drive, value in enumerate(values):
            if abs(value) >= LEAST[drive]:
                self.robot.drive(DRIVES[drive], round(float(value), 4))
                counted = self._counters()
                motion, self._counted = counted - self._counted, counted
                self.localizer.predict(*motion)
                self._model.learn(drive, float(value), motion)
        self.sense()

    def go(self, target: FloatArray, heading: float, tolerance: float = 0.3) -> None:
        """Bring the middle of the body to a place in a straight line, and turn to a heading.

        Raises LostError.
        """
        for _ in range(100):
            self._check()
            pose = self.localizer.pose
            way = target - self.middle
            distance = float(np.hypot(*way))
            turn = math.remainder(heading - pose[2], 360.0)
            if distance <= tolerance and abs(turn) <= 3.0:
                return
            turn = float(np.clip(turn, -SWING, SWING))
            next_middle = self.middle + way * min(1.0, STRIDE / max(distance, 1e-9))
            # Turning swings the middle around the centre: the centre has to give way.
            centre = next_middle - self._ahead(pose[2] + turn)
            forward, left = rotated(centre - pose[:2], -pose[2])
            self.move(forward, left, turn)
        raise LostError("the robot does not get where it should")

    def _check(self) -> None:
        """Look again where most readings do not fit; where they still do not, the robot is lost."""
        if self.localizer.fit <= DOUBTFUL:
            self.sense()
        if self.localizer.fit <= DOUBTFUL:
            raise LostError("the walls are not where they should be")

    def _ahead(self, heading: float) -> FloatArray:
        return rotated(np.array((self.reach, 0.0)), heading)

    def _counters(self) -> FloatArray:
        """Odometers and gyroscope: inches forward and to the left, degrees turned.

        The two wheels of a pair sit on opposite sides: what turning adds to one it takes from the
        other.
        """
        read = self.robot.read
        return np.array((sum(map(read, ALONG)) / 2, sum(map(read, ASIDE)) / 2, read(GYROSCOPE)))
