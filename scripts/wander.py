"""Wander through the maze without hitting a wall: a sample to start your own program from.

Each step reads the sensors and makes one move: forward where there is room, else a turn towards the clearer
side, or back where it is boxed in. It reads again before the next. It computes its own position by dead
reckoning and shows it in the simulator.

Needs Python's standard library and simmer_tui/client.py, installed, in this clone, or copied beside
this file.
"""

from __future__ import annotations

import argparse
import itertools
import math
import random
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent))  # a clone's root; an installed one is first
try:
    from simmer_tui.client import Robot, RobotError
except ModuleNotFoundError:
    from client import Robot, RobotError  # type: ignore[import-not-found, no-redef]

SENSORS = ("u1", "u2", "u3", "u4", "u5", "i1", "o3", "g1", "c1")
FORWARD, TURN = "d1", "r1"
STRIDE, TURN_STEP = 2, 30  # in, degrees
CLEAR_AHEAD, CLEAR_DIAGONAL = 6, 3.5  # in; room for a stride, and for its errors
NEAR, CLEAR_BEHIND = 1.5, 4  # in; a wall nearer than NEAR is too near to turn beside it
ODOMETER_OFFSET = 3  # in; o3 is this far left of the centre, so that it counts turns too


@dataclass
class DeadReckoning:
    """The pose of the robot by its gyroscope g1 and its odometer o3.

    x and y in inches and heading in degrees, in the global frame; `spread` is the uncertainty of the
    position, in inches.
    """

    x: float
    y: float
    heading: float
    spread: float = 0.0
    gyroscope: float | None = None
    odometer: float | None = None

    def update(self, gyroscope: float, odometer: float) -> None:
        """Update by the change since the last readings; the first readings only set the zero."""
        if self.gyroscope is not None and self.odometer is not None:
            turned = gyroscope - self.gyroscope
            # A wheel left of the centre runs backwards while the robot turns left.
            driven = odometer - self.odometer + ODOMETER_OFFSET * math.radians(turned)
            self.heading += turned
            self.x += driven * math.cos(math.radians(self.heading))
            self.y += driven * math.sin(math.radians(self.heading))
            self.spread += 0.05 * abs(driven) + 0.01 * abs(turned)
        self.gyroscope, self.odometer = gyroscope, odometer


@dataclass
class Wanderer:
    """Decides the next move. `order` breaks ties. `sense` is the direction in which it turns, 1 to the left
    and -1 to the right, or 0 while it drives; `backed_out` is True if its last move was back."""

    order: random.Random
    sense: int = 0
    backed_out: bool = False

    def decide(self, readings: dict[str, float]) -> tuple[str, float]:
        """The next move for these readings: a drive's code and its value."""
        ahead, left, right = readings["u1"], readings["u2"], readings["u4"]
        clear = ahead > CLEAR_AHEAD and min(left, right) > CLEAR_DIAGONAL
        if clear and not self.backed_out:
            self.sense = 0
            return FORWARD, STRIDE
        if self.sense == 0:  # it turns in the same direction until there is room
            self.sense = self.order.choice((1, -1)) if left == right else 1 if left > right else -1
        boxed_in = min(ahead, left, right) < NEAR and readings["u3"] > CLEAR_BEHIND
        self.backed_out = boxed_in and not self.backed_out
        return (FORWARD, -STRIDE) if self.backed_out else (TURN, self.sense * TURN_STEP)


def step(robot: Robot, position: DeadReckoning, wanderer: Wanderer) -> tuple[dict[str, float], str]:
    """Read, decide and move once; returns the readings by code and the move made, as text."""
    readings = dict(zip(SENSORS, robot.read(*SENSORS)))  # in one round trip
    position.update(readings["g1"], readings["o3"])
    robot.believe(position.x, position.y, position.heading, position.spread)
    code, value = wanderer.decide(readings)
    robot.drive(code, value)
    return readings, f"{code}-{value}"


def start_pose(text: str) -> DeadReckoning:
    """`9.5,42,0` as a pose."""
    try:
        x, y, heading = (float(part) for part in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not x,y,heading, such as 9.5,42,0") from error
    if not all(map(math.isfinite, (x, y, heading))):
        raise argparse.ArgumentTypeError(f"{text!r} must be finite numbers")
    return DeadReckoning(x, y, heading)


def step_count(text: str) -> int:
    """A whole number of at least 1."""
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return int(text)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the steps are done (or Ctrl-C); returns the exit code."""
    parser = argparse.ArgumentParser(description="Wander through the maze without hitting a wall.")
    parser.add_argument("--steps", type=step_count, help="stop after this many steps (default: Ctrl-C stops)")
    parser.add_argument("--seed", type=int, help="makes the order in which sides are tried repeatable")
    parser.add_argument(
        "--start",
        type=start_pose,
        default="9.5,42,0",
        metavar="X,Y,HEADING",
        help="where dead reckoning starts, inches and degrees (default: 9.5,42,0)",
    )
    parser.add_argument("--host", help="the simulator's host (default: SIMMER_HOST, else 127.0.0.1)")
    parser.add_argument("--port", type=int, help="its command port (default: SIMMER_PORT, else 9000)")
    parser.add_argument(
        "--reply-port",
        type=int,
        help="its reply port (default: SIMMER_REPLY_PORT, else 9001 beside 9000; 0: the command port)",
    )
    options = parser.parse_args(arguments)
    wanderer = Wanderer(random.Random(options.seed))
    steps = range(1, options.steps + 1) if options.steps else itertools.count(1)
    done = 0
    try:
        with Robot(options.host, options.port, options.reply_port) as robot:
            for number in steps:
                readings, move = step(robot, options.start, wanderer)
                values = " ".join(f"{code}={value:.2f}" for code, value in readings.items())
                print(f"{number}: {values} -> {move}", flush=True)
                done = number
    except KeyboardInterrupt:
        print(f"stopped after {done} steps")
    except RobotError as error:
        print(f"wander: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
