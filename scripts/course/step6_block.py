"""Step 6, block and gripper: find the block in the loading zone and take it.

    simmer-tui --config mission --run "python samples/course/step6_block.py"

u5 and u1 look ahead from the same place: u5 sees the block, u1 looks over it. Where u5 reads less, there is
the block. The robot turns around with both, drives to the block, measures again from near, and takes it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable

import numpy as np
from step3_dead_reckoning import turned
from step4_particle_filter import CELL, Array, look
from step5_planning import Cell, Pilot, cell_at, centre, route

from simmer_tui import Robot

RADIUS = 3.0  # in, of the robot
BLOCK = 3.0  # in, side of the block
GAP = 0.3  # in, between both
GRIP = RADIUS + GAP + BLOCK / 2  # in, between the centres of robot and block at the grip
AWAY = 4.0  # in, before that place: there it looks again
AROUND = [7.5] * 48  # deg, turns of a search
NEAR = [-18.0, *[6.0] * 6, -18.0]  # deg, turns of a closer look
BESIDE = (0.0, 0.6, -0.6, 1.2, -1.2)  # in, offsets of the block from the middle of the gripper
ZONE = 3  # the value of the loading zone's cells in maze.csv


class Fetcher:
    """Finds and takes the block."""

    def __init__(self, pilot: Pilot) -> None:
        self.pilot, self.robot = pilot, pilot.robot
        values = {(x, y): value for y, row in enumerate(pilot.maze[::-1]) for x, value in enumerate(row)}
        self.zone: list[Cell] = [cell for cell, value in values.items() if value == ZONE]
        grid = [(x, y) for y in range(-1, len(pilot.maze) + 1) for x in range(-1, len(pilot.maze[0]) + 1)]
        self._walls = np.array([centre(cell) for cell in grid if not values.get(cell)])

    def room(self, places: Array) -> float:
        """Least distance of the robot from all walls at these places, inches."""
        beyond = np.maximum(np.abs(places[:, None] - self._walls) - CELL / 2, 0)
        return float(np.hypot(beyond[..., 0], beyond[..., 1]).min()) - RADIUS

    def scan(self, turns: Iterable[float]) -> Array | None:
        """Turn and read both sensors; returns the block's place, or None if it was not seen."""
        seen = []
        for number, turn in enumerate(turns):
            self.pilot.move("r1", turn)
            if number % 6 == 0:
                look(self.robot, self.pilot.localizer, "where is the block?")
            low, high = self.robot.read("u5", "u1")
            x, y, heading = self.pilot.pose
            place = np.array((x, y)) + turned(RADIUS + low + BLOCK / 2, 0, heading)
            if low < 0.85 * high - 1.0 and self._is_near_zone(place):
                seen.append((low, *place))
        if not seen:
            return None
        near = np.array([each for each in seen if each[0] < min(seen)[0] + BLOCK])  # not what is behind it
        return np.asarray(near[:, 1:].mean(axis=0))

    def _is_near_zone(self, place: Array) -> bool:
        return any(np.abs(place - centre(cell)).max() < CELL / 2 + BLOCK for cell in self.zone)

    def approach(self, block: Array) -> tuple[float, Array]:
        """The heading and the place of the robot at the grip: those with most room."""
        plans = []
        for heading in (0.0, 90.0, 180.0, 270.0):
            ahead, left = turned(1, 0, heading), turned(0, 1, heading)
            for beside in BESIDE:
                places = np.array([block - back * ahead - beside * left for back in (GRIP, GRIP + AWAY)])
                if route(self.pilot.maze, cell_at(self.pilot.pose[:2]), cell_at(places[1])):
                    far = np.hypot(*(places[1] - self.pilot.pose[:2]))
                    room = min(self.room(places), 1.2) - 0.2 * abs(beside) - 0.01 * far
                    plans.append((room, heading, places[0]))
        _, heading, place = max(plans, key=lambda plan: plan[0])
        return heading, place

    def search(self) -> Array | None:
        """Look for the block from one cell of the zone after the other."""
        start = cell_at(self.pilot.pose[:2])
        for spot in sorted(self.zone, key=lambda cell: len(route(self.pilot.maze, start, cell))):
            self.pilot.travel(spot, 90 * round(self.pilot.pose[2] / 90))
            block = self.scan(AROUND)
            if block is not None:
                return block
        return None

    def fetch(self) -> bool:
        """Find the block and take it. True if the gripper holds it."""
        block = self.search()
        for _ in range(2 if block is not None else 0):
            heading, place = self.approach(block)
            start = place - turned(AWAY, 0, heading)
            self.pilot.travel(cell_at(start), heading)
            self.pilot.go(start, heading)
            block = block if (seen := self.scan(NEAR)) is None else seen
        if block is None:
            return False
        self.pilot.go(self.approach(block)[1] - turned(1.5, 0, heading), heading, close=0.4)
        gap = float(np.mean(self.robot.read("u5", "u5", "u5")))
        left = GAP + 1.5 if gap > 5.0 else gap  # it does not see a block that lies far to the side
        self.pilot.move("d1", left - GAP)
        self.robot.drive("p1", 1)
        return self.holds()

    def holds(self) -> bool:
        """True if most readings of the load sensor say so: a few are wrong."""
        return sum(self.robot.read(*["l1"] * 9)) > 4.5


if __name__ == "__main__":
    with Robot() as robot:
        fetcher = Fetcher(Pilot(robot, np.random.default_rng(0)))
        taken = fetcher.pilot.localize() and fetcher.fetch()
    print("it has the block" if taken else "it has no block")
    sys.exit(0 if taken else 1)
