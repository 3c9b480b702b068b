"""Step 1, the first command: drive up to the wall ahead and stop 24 inches before it.

    simmer-tui --run "python samples/course/step1_first_command.py"

u1 looks ahead, d1 drives forward. Both have errors of a few percent, so one long movement misses the goal.
Half of the remaining distance, again and again, reaches it.
"""

from __future__ import annotations

import sys
from pathlib import Path

try:
    from simmer_tui.client import Robot
except ModuleNotFoundError:  # another Python: client.py is in the folder above
    sys.path.append(str(Path(__file__).resolve().parent.parent))
    from client import Robot  # type: ignore[import-not-found, no-redef]

GOAL = 24.0  # in, from the sensor to the wall
CLOSE = 0.5  # in, from the goal: close enough
MOST = 20  # movements before it gives up


def approach(robot: Robot) -> float:
    """Drive up to the wall; returns the last distance to it, inches."""
    ahead = robot.read("u1")
    for _ in range(MOST):
        if abs(ahead - GOAL) < CLOSE:
            break
        movement = robot.drive("d1", (ahead - GOAL) / 2)
        ahead = robot.read("u1")
        print(f"{movement.command}: the robot answered {movement.reply}, the wall is {ahead:.2f} in ahead")
    return ahead


if __name__ == "__main__":
    with Robot() as robot:
        ahead = approach(robot)
    sys.exit(0 if abs(ahead - GOAL) < 2 * CLOSE else 1)
