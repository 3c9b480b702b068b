"""Step 3b, keep going: the robot drives until the next command, and is steered fifty times a second.

    simmer-tui --run "python samples/course/step3b_keep_going.py"

`vv-4;0;10` is a velocity: 4 in/s ahead, 0 to the left, 10 deg/s counter-clockwise. It lasts until the next
one. While the robot drives, each pass of a loop that reads and steers takes 0.02 s of its time. The robot
keeps 4 in from the wall on its left, once around the maze. It stops when dead reckoning says it is back.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator

from step3_dead_reckoning import START, Odometry, Reckoning, Robot

GAP = 4.0  # in, between the robot's outline and the wall, on the left and ahead
RADIUS = 3.0  # in, of the robot; u2 is on its outline
BESIDE = RADIUS + GAP  # in, from the centre to the wall
LOOK = 47.5  # deg to the left: u2 sees 45 +- 2.5, and reads the nearest
LEFT = BESIDE / math.sin(math.radians(LOOK)) - RADIUS  # in, the reading of u2 at this distance
OPEN = 10.0  # in: from this reading on u2 looks past the end of the wall
SPEED = 4.0  # in/s, ahead
SLOW = 2.0  # in/s, back
STEER = 13.0  # deg/s for each inch that u2 reads too much
SHARPEST = 40.0  # deg/s, the most by u2
HOLD = 8.0  # deg/s for each degree of error of the heading
FASTEST = 90.0  # deg/s, the most by the heading
ROUND = -350.0  # deg, turned: once around along an outer wall is one whole turn to the right
NEAR = 6.0  # in from the start: it is back
LONGEST = 500.0  # in, after which it gives up; once around is about 310


class Follower:
    """A robot that follows the wall on its left: its readings and its believed pose."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._odometry = Odometry(robot)
        self.pose = Reckoning(*START)
        self.gone, self.nearest, self.last_left = 0.0, math.inf, LEFT
        self.look()

    def look(self) -> None:
        """Read all sensors. The same codes come again, so 0.02 s pass before."""
        motion = self._odometry.motion()
        self.ahead, self.left = self._robot.read("u1", "u2")
        self.pose.add(motion)
        self.gone += motion.forward
        self.nearest = min(self.nearest, self.ahead, self.left)
        off = math.hypot(self.pose.x - START[0], self.pose.y - START[1])
        self.ended = (self.pose.heading < ROUND and off < NEAR) or self.gone > LONGEST

    def velocities(self) -> Iterator[tuple[float, float]]:
        """The velocities to send, ahead (in/s) and counter-clockwise (deg/s), one after each `look`."""
        while True:
            if self.ahead < GAP:
                yield from self.turn_right()
            elif self.left > OPEN:
                yield from self.around_corner()
            else:  # a turn to the wall shortens the reading of u2 at once: that damps the motion
                self.last_left = self.left
                yield SPEED, max(-SHARPEST, min(SHARPEST, STEER * (self.left - LEFT)))

    def along(self) -> float:
        """The direction of the wall, degrees: the nearest multiple of 90."""
        return 90.0 * round(self.pose.heading / 90.0)

    def towards(self, heading: float, speed: float, rate: float = 0.0) -> tuple[float, float]:
        """The velocity that turns the robot to a heading, which itself changes at `rate`, deg/s."""
        return speed, max(-FASTEST, min(FASTEST, rate + HOLD * (heading - self.pose.heading)))

    def turn_right(self) -> Iterator[tuple[float, float]]:
        """A turn on the spot, since a wall is ahead; then back, until there is room and u2 sees the wall."""
        goal = self.along() - 90.0
        while abs(self.pose.heading - goal) > 1.0:
            yield self.towards(goal, 0.0)
        while self.ahead < GAP or self.left > OPEN:
            yield self.towards(goal, -SLOW)

    def around_corner(self) -> Iterator[tuple[float, float]]:
        """Straight on to where u2 saw the wall last, which is its end; then an arc around that end."""
        goal = self.along()
        end = self.gone + (RADIUS + self.last_left) * math.cos(math.radians(LOOK + self.pose.heading - goal))
        while self.pose.heading < goal + 85.0:
            arc = math.degrees((self.gone - end) / BESIDE)
            rate = math.degrees(SPEED / BESIDE) if 0.0 < arc < 90.0 else 0.0
            yield self.towards(goal + max(0.0, min(90.0, arc)), SPEED, rate)


def once_around(robot: Robot) -> Follower:
    """Drive until the robot is back, or has gone too far."""
    follower = Follower(robot)
    for number, (speed, turn) in enumerate(follower.velocities()):
        if math.isnan(robot.send(f"vv-{speed:.2f};0;{turn:.1f}")):
            sys.exit("the robot refuses velocities")
        follower.look()
        if number % 25 == 0:  # twice a second
            robot.believe(follower.pose.x, follower.pose.y, follower.pose.heading, follower.pose.spread)
        if follower.ended:
            break
    robot.send("vv-0;0;0")
    return follower


if __name__ == "__main__":
    with Robot() as robot:
        ended = once_around(robot)
        # The walls of the maze are at x = 0 and y = 48: face each, and measure the distance.
        robot.drive("r1", round(math.remainder(90.0 - ended.pose.heading, 360.0), 2))
        y = 48.0 - 3.0 - robot.read("u1")
        robot.drive("r1", 90.0)
        x = 3.0 + robot.read("u1")
    off = math.hypot(x - START[0], y - START[1])
    print(f"after {ended.gone:.0f} in it is {off:.1f} in from its start; nearest {ended.nearest:.2f} in")
    sys.exit(0 if off < NEAR and ended.nearest > 0.3 else 1)
