"""Step 5, planning: find a path to another cell and follow it, localizing the robot after each stride.

    simmer-tui --run "python samples/course/step5_planning.py"

Breadth-first search finds the path from cell to cell. Each short stride begins at the pose that the particle
filter estimates, so errors do not add up. This robot drives in any direction (d1 ahead, w1 to the left): it
keeps its heading, and need not turn at corners.
"""

from __future__ import annotations

import math
import sys
from collections import deque

import numpy as np
from step3_dead_reckoning import Odometry, turned
from step4_particle_filter import CELL, DOUBT, Array, Localizer, localize, look

from simmer_tui import Robot, Simulator

STRIDE = 4.0  # in, the longest movement between two looks
CLOSE = 0.7  # in, from a place: close enough
STRAIGHT = 1.5  # deg, the smallest turn that is made
GOAL = (7, 0)  # column and row of the cell to go to, (0, 0) at the bottom left

Cell = tuple[int, int]


class LostError(Exception):
    """The readings do not fit the place where the robot seems to be."""


def cell_at(place: Array) -> Cell:
    return int(place[0] // CELL), int(place[1] // CELL)


def centre(cell: Cell) -> Array:
    return (np.array(cell) + 0.5) * CELL


def route(maze: tuple[tuple[int, ...], ...], start: Cell, goal: Cell) -> list[Cell]:
    """A shortest path, both ends included; empty if there is none. The search begins at the goal."""
    free = {(x, y) for y, row in enumerate(maze[::-1]) for x, value in enumerate(row) if value}
    towards, waiting = {goal: goal}, deque([goal])
    while waiting:
        x, y = waiting.popleft()
        for near in {(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)} & free - towards.keys():
            towards[near] = (x, y)
            waiting.append(near)
    path = [start] if start in towards else []
    while path and path[-1] != goal:
        path.append(towards[path[-1]])
    return path


class Pilot:
    """Moves the robot and keeps its belief up to date."""

    def __init__(self, robot: Robot, random: np.random.Generator) -> None:
        spec = robot.configuration().simulation
        self.robot, self.maze = robot, spec.maze.cells
        self.localizer = Localizer(Simulator(spec), random)
        self._odometry = Odometry(robot)
        self.note = ""

    @property
    def pose(self) -> Array:
        return self.localizer.pose

    def localize(self) -> bool:
        return localize(self.robot, self.localizer, self._odometry)

    def move(self, code: str, value: float) -> None:
        """Make one movement, and predict the belief from the counters."""
        self.robot.drive(code, round(value, 2))
        self.localizer.predict(self._odometry.motion())

    def face(self, heading: float) -> None:
        """Turn to a heading, and look."""
        for _ in range(4):
            turn = math.remainder(heading - self.pose[2], 360)
            if abs(turn) < STRAIGHT:
                return
            self.move("r1", turn)
            look(self.robot, self.localizer, self.note)

    def go(self, place: Array, heading: float, close: float = CLOSE) -> None:
        """Go straight to a place, stride by stride, with this heading. Raises LostError."""
        for _ in range(80):
            self.face(heading)
            offset = place - self.pose[:2]
            if (distance := float(np.hypot(*offset))) < close:
                return
            stride = turned(*(offset * min(STRIDE / distance, 1)), -self.pose[2])
            for code, value in zip(("d1", "w1"), stride):
                if abs(value) > 0.15:
                    self.move(code, value)
            for _ in range(3):  # one bad reading is no reason to be lost
                look(self.robot, self.localizer, self.note)
                if self.localizer.fit > DOUBT:
                    break
            else:
                raise LostError(f"the walls do not fit at {self.pose.round(1)}")
        raise LostError(f"the robot does not get to {place.round(1)}")

    def travel(self, goal: Cell, heading: float, ahead: float = 0.0) -> None:
        """Go from cell to cell. A point `ahead` inches of the robot's centre goes through their middles."""
        shift = turned(ahead, 0, heading)
        for cell in route(self.maze, cell_at(self.pose[:2] + shift), goal):
            self.go(centre(cell) - shift, heading)


if __name__ == "__main__":
    with Robot() as robot:
        pilot = Pilot(robot, np.random.default_rng(0))
        if pilot.localize():
            pilot.travel(GOAL, 90 * round(pilot.pose[2] / 90))
    print("at ({:.1f}, {:.1f}) heading {:.0f}".format(*pilot.pose))
    sys.exit(0 if cell_at(pilot.pose[:2]) == GOAL else 1)
