"""Step 2, a wall follower: keep the wall on the left at the same distance, and see where that leads.

    simmer-tui --run "python samples/course/step2_wall_follower.py"

u2 looks 45 degrees to the left, not straight left. So its reading is longer than the distance to the wall,
and it sees a corner before the robot is there. `simmer-tui check` draws where every sensor looks.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

try:
    from simmer_tui.client import Robot
except ModuleNotFoundError:  # another Python: client.py is in the folder above
    sys.path.append(str(Path(__file__).resolve().parent.parent))
    from client import Robot  # type: ignore[import-not-found, no-redef]

WALL = 6.0  # in, from the robot's centre to the wall: the middle of a corridor
SENSOR = 2.12  # in, from the centre to u2, both ahead and to the left; to u4 ahead and to the right
AHEAD = 4.0  # in, free ahead: with less it turns
OPEN = 11.0  # in: from this reading on there is no wall on that side
NEAR = 4.0  # in: below this reading the nearer wall counts, left or right
STRIDE = 2.0  # in, length of a movement
STRAIGHT = 2.0  # deg, the smallest turn that is made
TOWARDS = (3.0, 20.0)  # deg for each inch that the wall is too far, and the most
AWAY = (10.0, 45.0)  # the same for a wall that is too near: away is urgent
STEPS = 100

LEFT = ("r1", 90.0)
RIGHT = ("r1", -90.0)
ON = ("d1", STRIDE)
AROUND = [ON] * 6 + [LEFT] + [ON] * 5
"""The moves around a corner. u2 loses the wall when the corner is still 6 in ahead, and the middle of the
next corridor 12 in."""


def decide(ahead: float, left: float, plan: list[tuple[str, float]]) -> list[tuple[str, float]]:
    """The next moves, for readings of u1 and u2 and the rest of the plan."""
    if ahead < AHEAD:  # end of the corridor: left if planned, else right
        return plan[plan.index(LEFT) :] if LEFT in plan else [RIGHT]
    return plan or (list(AROUND) if left > OPEN else [ON])


def correction(left: float, right: float) -> float:
    """The turn that leads back to the middle of the corridor, deg, left positive. It is by the left wall; by
    the right one if there is none on the left, or if the right one is near."""
    by_left = left < OPEN and (left <= right or right >= NEAR)
    seen, side = (left, 1.0) if by_left else (right, -1.0)
    off = seen * math.cos(math.radians(45)) + SENSOR - WALL  # in, too far from that wall
    gain, most = TOWARDS if off > 0 else AWAY
    return side * max(-most, min(most, gain * off)) if seen < OPEN else 0.0


def follow(robot: Robot, steps: int) -> float:
    """Follow the wall for a number of steps; returns the smallest reading, inches."""
    nearest = math.inf
    plan: list[tuple[str, float]] = []
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
