"""Step 1, the first command: drive up to the wall ahead and stop 24 inches before it.

    simmer-tui --run "python samples/course/step1_first_command.py"

u1 looks ahead, d1 drives forward. Both err by a few percent, so that one long movement misses the mark;
half of what is left, again and again, does not.
"""

from __future__ import annotations

import sys

from simmer_tui.client import Robot

GOAL = 24.0  # in, from the sensor to the wall
CLOSE = 0.5  # in, that are close enough
MOST = 20  # movements


def approach(robot: Robot) -> float:
    """Drive up to the wall; returns how far it is at the end, inches."""
    ahead = robot.read("u1")
    for _ in range(MOST):
        if abs(ahead - GOAL) < CLOSE:
            break
        movement = robot.drive("d1", (ahead - GOAL) / 2)
        ahead = robot.read("u1")
        print(f"{movement.command}: the robot has said {movement.reply}, the wall is {ahead:.2f} in ahead")
    return ahead


if __name__ == "__main__":
    with Robot() as robot:
        ahead = approach(robot)
    sys.exit(0 if abs(ahead - GOAL) < 2 * CLOSE else 1)
