"""Step 2, a wall follower: keep the wall on the left at the same distance, and see where that leads.

    simmer-tui --run "python samples/course/step2_wall_follower.py"

u2 looks 45 degrees to the left and not straight left: what it reads is longer than the way to the wall,
and it sees a corner before the robot is there. `simmer-tui check` draws where every sensor looks.
"""

from __future__ import annotations

import math
import sys

from simmer_tui.client import Robot

WALL = 6.0  # in, from the robot's centre to the wall: the middle of a corridor
SENSOR = 2.12  # in, from the centre to u2, both ahead and to the left; to u4 ahead and to the right
AHEAD = 4.0  # in, of free way without which it does not drive on
OPEN = 11.0  # in, from which on there is no wall on that side any more
NEAR = 4.0  # in, below which the nearer wall counts, on whichever side it is
STRIDE, STRAIGHT = 2.0, 2.0  # in; deg, of a turn that is not worth it
TOWARDS, AWAY = (3.0, 20.0), (10.0, 45.0)  # deg of a turn for each inch off, and at most: away is urgent
STEPS = 100

Move = tuple[str, float]
LEFT, RIGHT, ON = ("r1", 90.0), ("r1", -90.0), ("d1", STRIDE)
AROUND = [ON] * 6 + [LEFT] + [ON] * 5
"""Around a corner: u2 no longer sees the wall when the corner is still 6 in ahead, and the middle of the
corridor behind it 12 in."""


def decide(ahead: float, left: float, plan: list[Move]) -> list[Move]:
    """The moves to make next, for what u1 and u2 read and what was planned before."""
    if ahead < AHEAD:  # the end of the corridor: turn left if that was the plan, else right
        return plan[plan.index(LEFT) :] if LEFT in plan else [RIGHT]
    return plan or (list(AROUND) if left > OPEN else [ON])


def correction(left: float, right: float) -> float:
    """The turn that leads back to the middle of the corridor (deg, left is positive), by the left wall; by
    the right one where there is none on the left, or where the right one is near."""
    by_left = left < OPEN and (left <= right or right >= NEAR)
    seen, side = (left, 1.0) if by_left else (right, -1.0)
    off = seen * math.cos(math.radians(45)) + SENSOR - WALL  # in, by which that wall is too far away
    gain, most = TOWARDS if off > 0 else AWAY
    return side * max(-most, min(most, gain * off)) if seen < OPEN else 0.0


def follow(robot: Robot, steps: int) -> float:
    """Follow the wall for so many steps; returns the nearest that anything came to a sensor, inches."""
    nearest, plan = math.inf, list[Move]()
    for number in range(1, steps + 1):
        ahead, left, right = robot.read("u1", "u2", "u4")
        nearest = min(nearest, ahead, left, right)
        (code, value), *plan = decide(ahead, left, plan)
        turn = correction(left, right) if code == "d1" else 0.0
        print(
            f"{number}: {ahead:.1f} ahead, {left:.1f} left, {right:.1f} right: {turn:.0f}, {code}-{value:g}"
        )
        if abs(turn) > STRAIGHT:
            robot.drive("r1", round(turn, 1))
        robot.drive(code, value)
    return nearest


if __name__ == "__main__":
    with Robot() as robot:
        nearest = follow(robot, STEPS)
    print(f"nothing came nearer than {nearest:.2f} in")
    sys.exit(0 if nearest > 0.3 else 1)
