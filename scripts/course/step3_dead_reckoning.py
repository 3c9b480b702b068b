"""Step 3, dead reckoning: the robot's pose from its wheels and its gyroscope, and why that drifts.

    simmer-tui --run "python samples/course/step3_dead_reckoning.py"

The robot drives around a square and adds up what o1 to o4 and g1 count. On the screen the believed pose
is drawn beside the true one: watch them separate. Every reading has a small error, and errors add up. An
error of the heading moves all later places to the side.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

try:
    from simmer_tui.client import Robot as Robot  # step 3b takes it from here
except ModuleNotFoundError:  # another Python: client.py is in the folder above
    sys.path.append(str(Path(__file__).resolve().parent.parent))
    from client import Robot  # type: ignore[import-not-found, no-redef]

COUNTERS = ("o3", "o4", "o1", "o2", "g1")  # two wheels that roll ahead, two that roll to the left, the gyro
START = (9.5, 42.0, 0.0)  # in, in, deg: bot_center and bot_rot of the default set
SIDE = 6.0  # in, side of the square


@dataclass
class Motion:
    """Motion of the robot in its own frame: inches ahead and to the left, degrees counter-clockwise."""

    forward: float
    left: float
    turn: float


class Odometry:
    """The counters, and their counts since the last reading."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._before = robot.read(*COUNTERS)

    def motion(self) -> Motion:
        """Motion since the last call. The wheels of a pair are on opposite sides: a turn adds to one as much
        as it takes from the other, so their mean is the distance driven."""
        now = self._robot.read(*COUNTERS)
        a, b, c, d, turn = (new - old for new, old in zip(now, self._before))
        self._before = now
        return Motion((a + b) / 2, (c + d) / 2, turn)


Array = NDArray[np.float64]


def turned(forward: float | Array, left: float | Array, heading: float | Array) -> Array:
    """A motion in the robot's frame as x and y in the maze's frame, for a robot with this heading (deg)."""
    cos, sin = np.cos(np.radians(heading)), np.sin(np.radians(heading))
    return np.array((cos * forward - sin * left, sin * forward + cos * left))


@dataclass
class Reckoning:
    """The pose by dead reckoning: x, y (in), heading (deg), and its standard deviation (in)."""

    x: float
    y: float
    heading: float
    spread: float = 0.2

    def add(self, motion: Motion) -> None:
        """Add a motion. The robot turns evenly while it drives, so its mean heading is the one halfway."""
        moved = turned(motion.forward, motion.left, self.heading + motion.turn / 2)
        self.x, self.y = self.x + moved[0], self.y + moved[1]
        self.heading += motion.turn
        self.spread += 0.02 * (abs(motion.forward) + abs(motion.left)) + 0.005 * abs(motion.turn)


def square(robot: Robot, odometry: Odometry, pose: Reckoning, rounds: int) -> None:
    """Drive around a square to the right, with headings by the gyroscope."""
    for corner in range(4 * rounds):
        turn = math.remainder(-90.0 * corner - pose.heading, 360.0)
        for code, value in (("r1", turn), ("d1", SIDE / 2), ("d1", SIDE / 2)):
            robot.drive(code, round(value, 2))
            pose.add(odometry.motion())
            robot.believe(pose.x, pose.y, pose.heading, pose.spread)


if __name__ == "__main__":
    with Robot() as robot:
        pose = Reckoning(*START)
        square(robot, Odometry(robot), pose, rounds=2)
        print(f"by dead reckoning at ({pose.x:.1f}, {pose.y:.1f}) heading {pose.heading:.1f}")
        # The left wall of the maze is at x = 0: face it, and measure the distance.
        robot.drive("r1", round(math.remainder(180.0 - pose.heading, 360.0), 2))
        measured = 3.0 + sum(robot.read(*["u1"] * 9)) / 9
    print(f"the wall is {measured:.1f} in away: dead reckoning is off by {pose.x - measured:+.1f} in")
    sys.exit(0 if abs(pose.x - measured) < 2.0 else 1)
