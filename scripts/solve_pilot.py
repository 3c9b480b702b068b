"""Driving: small moves, each measured, each correcting the previous one.

Any robot that drives forward and turns can do it. A reading costs time, so the pilot reads only sensors whose
readings it cannot predict. While its pose is known well enough, it reads one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

import numpy as np
from solve_beliefs import DOUBTFUL, FloatArray, Localizer, rotated
from solve_ground import Body

RANGES = ("u1", "u2", "u3", "u4", "t1")  # all that look over the block
ALONG, ASIDE, GYROSCOPE = ("o3", "o4"), ("o1", "o2"), "g1"
FORWARD, TURN = "d1", "r1"
DRIVES = (FORWARD, TURN)
STRIDE = 5.0  # in, the largest move before the robot looks again
STRAIGHT = 1.5  # deg, off the direction, that are not worth a turn
WORTH, MOST = 0.7, 3  # expected bits of a reading that is made; most readings a look
UNSURE = 0.6  # in, spread of the belief at which the robot turns to see more
PEEKS = (30.0, -30.0)  # deg
MARGIN = 0.4  # in, least clearance for a turn
AXES = {FORWARD: 0, TURN: 2}  # of (forward, left, turn)
LEAST_UNIT = 0.2  # inches or degrees a unit of the worst drive that still moves, judged
PRIOR = np.array(
    (4.0, 100.0)
)  # in2, deg2: sum of squared moves at which measured biases have half the weight


class LostError(Exception):
    """The readings do not fit the believed pose."""


class RobotLike(Protocol):
    """The part of `simmer_tui.client.Robot` that is needed here."""

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
    """True effect of one inch or degree of each drive, learned while driving.

    Each drive has a bias of its own: for example, driving forward also turns the robot a little. `per_unit`
    of a drive is the motion (forward, left, turn) that one unit of it makes.
    """

    def __init__(self) -> None:
        self._weights = dict(zip(DRIVES, PRIOR))
        self._sums = {
            drive: weight * motion
            for (drive, weight), motion in zip(self._weights.items(), np.eye(3)[list(AXES.values())])
        }

    def learn(self, drive: str, value: float, motion: FloatArray) -> None:
        """Least squares over all movements of the drive so far, beginning with no bias."""
        self._weights[drive] += value**2
        self._sums[drive] = self._sums[drive] + value * motion

    def per_unit(self, drive: str) -> FloatArray:
        return np.asarray(self._sums[drive] / self._weights[drive])

    def command(self, drive: str, motion: float) -> float:
        """Value of a command that makes a motion on the drive's own axis. The value is at most five times the
        motion, because it would grow without bound for a robot that does not move."""
        unit = float(self.per_unit(drive)[AXES[drive]])
        return motion / math.copysign(max(abs(unit), LEAST_UNIT), unit)

    def course(self, distance: float) -> float:
        """The pose after `distance` inches of driving, degrees to the left of the heading at first: the bias
        to that side, and half of the robot's turn during the movement."""
        forward, left, turn = self.per_unit(FORWARD)
        return math.degrees(math.atan2(left, forward)) + float(turn) * distance / 2


class Pilot:
    """Moves the robot and keeps its belief up to date."""

    def __init__(self, robot: RobotLike, localizer: Localizer, body: Body) -> None:
        self.robot = robot
        self.localizer = localizer
        self.body = body
        self.note = ""
        self._model = DriveModel()
        self._counted = self._counters()

    @property
    def place(self) -> FloatArray:
        """The robot's centre, x and y."""
        return self.localizer.pose[:2]

    @property
    def heading(self) -> float:
        return float(self.localizer.pose[2])

    def mean(self, code: str, repeats: int) -> float:
        """The mean of some readings of a sensor."""
        return float(np.mean([self.robot.read(code) for _ in range(repeats)]))

    # -- looking -------------------------------------------------------------------------------

    def look(self, least: float = WORTH) -> None:
        """Read the sensors with enough expected information, at least the best one, so that a moved robot is
        detected. Then show the belief."""
        bits = self.localizer.worth()
        best = [index for index in np.argsort(-bits) if bits[index] > 0.0][:MOST]
        chosen = [index for index in best if index == best[0] or bits[index] >= least]
        if chosen:
            codes = [self.localizer.ranges[index] for index in chosen]
            self.localizer.update(codes, np.array([self.robot.read(code) for code in codes]))
        x, y, heading = self.localizer.pose
        self.robot.believe(x, y, heading, self.localizer.spread, self.localizer.particles[:200], self.note)

    def peek(self) -> None:
        """While the spread of the belief is too large, turn to more informative headings."""
        if self.localizer.spread < UNSURE:
            return
        safe = [turn for turn in PEEKS if self._room(turn) > MARGIN]
        worth = {turn: float(self.localizer.worth(turn).max()) for turn in safe}
        best = max(worth, key=lambda turn: worth[turn], default=0.0)
        if best and worth[best] > 1.0:
            self.turn(best)
            self.look()

    def _room(self, turn: float) -> float:
        return self.body.room_to_turn(self.place, self.heading, turn)

    def _check(self) -> None:
        """Read again if most readings do not fit; if they still do not, the robot is lost."""
        for _ in range(2):
            if self.localizer.fit <= DOUBTFUL:
                self.look(least=0.0)
        if self.localizer.fit <= DOUBTFUL:
            raise LostError("the walls are not where they should be")

    # -- moving --------------------------------------------------------------------------------

    def drive(self, distance: float) -> None:
        """Drive forward, or back, without readings."""
        self._do(FORWARD, self._model.command(FORWARD, distance))

    def turn(self, angle: float) -> None:
        """Turn on the spot, without readings."""
        self._do(TURN, self._model.command(TURN, angle))

    def _do(self, drive: str, value: float) -> None:
        self.robot.drive(drive, round(value, 3))
        counted = self._counters()
        motion, self._counted = counted - self._counted, counted
        self.localizer.predict(*motion)
        self._model.learn(drive, value, motion)

    def face(self, heading: float, through: float | None = None) -> None:
        """Turn to a heading, the short way or by `through` degrees."""
        for _ in range(5):
            turn = math.remainder(heading - self.heading, 360.0) if through is None else through
            if abs(turn) < STRAIGHT:
                return
            self.turn(turn)
            through = None
            self.look()

    def go(self, target: FloatArray, tolerance: float = 1.0, backwards: bool = False) -> None:
        """Bring the robot's centre to a place in a straight line.

        Raises LostError.
        """
        sign = -1.0 if backwards else 1.0
        for _ in range(60):
            self._check()
            self.peek()
            way = target - self.place
            distance = float(np.hypot(*way))
            stride = min(distance, STRIDE)
            course = self._model.course(sign * stride) + (180.0 if backwards else 0.0)
            turn = math.remainder(bearing(way) - course - self.heading, 360.0)
            if distance <= tolerance or (distance < 1.5 and abs(turn) > 60.0):
                return
            if abs(turn) > max(STRAIGHT, math.degrees(0.2 / distance)):
                self.turn(turn)
                if abs(turn) > 20.0:
                    self.look()
                    continue
            self.drive(sign * stride)
            self.look()
        raise LostError("the robot does not get where it should")

    def _counters(self) -> FloatArray:
        """Odometers and gyroscope: inches forward and to the left, degrees turned.

        The two wheels of a pair are on opposite sides, so that the effects of turning cancel.
        """
        read = self.robot.read
        return np.array((sum(map(read, ALONG)) / 2, sum(map(read, ASIDE)) / 2, read(GYROSCOPE)))


def bearing(way: FloatArray) -> float:
    """The heading that leads along a vector, degrees."""
    return math.degrees(math.atan2(way[1], way[0]))


def direction(heading: float) -> FloatArray:
    """The unit vector of a heading."""
    return rotated(np.array((1.0, 0.0)), heading)
