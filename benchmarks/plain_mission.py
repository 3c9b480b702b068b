"""A mission by a program that sends no beliefs, and needs no numpy.

    simmer-tui --no-ui --config SET --mission --run "python benchmarks/plain_mission.py"

`faults.py` runs it as a program of which a report knows only the commands. The set's mission.toml must give
the whole start pose (SIMMER_START). Odometers and gyro update the pose, and an extended Kalman filter
corrects it by the range sensors (Thrun, Burgard, Fox, Probabilistic Robotics, 2005, chapter 3.3). The robot
keeps its heading and drives ahead and to its left, so that it does not turn with the block. It turns only to
look for the block and to take it.

With SIMMER_PROTOCOL=packets it speaks packets, else binary.
"""

from __future__ import annotations

import math
import os
import sys
from collections import deque
from collections.abc import Sequence

from simmer_tui.client import Robot

# The robot and the maze of the bundled set "mission": this program gets neither from the simulator.
MAZE = (
    (3, 3, 1, 1, 0, 2, 0, 2),
    (3, 3, 0, 1, 1, 1, 1, 1),
    (1, 0, 2, 0, 0, 1, 0, 1),
    (1, 1, 1, 1, 1, 1, 0, 2),
)
RANGES = {
    "u1": (3.0, 0.0, 0.0),
    "u2": (2.12, 2.12, 45.0),
    "u3": (-3.0, 0.0, 180.0),
    "u4": (2.12, -2.12, -45.0),
}
"""Range sensors that look over the block: x and y on the robot, inches, and direction, degrees."""
FAN = (-2.5, 0.0, 2.5)  # deg, rays of a sensor; the nearest counts
COUNTERS = ("o3", "o4", "o1", "o2", "g1")  # the wheels of a pair are on opposite sides: turning cancels
CELL, RADIUS, BLOCK, GAP = 12.0, 3.0, 3.0, 0.3  # in
GRIP = RADIUS + GAP + BLOCK / 2  # in, from the robot's centre to that of a block it takes
MIDDLE = (RADIUS + GAP + BLOCK - RADIUS) / 2  # in, from the robot's centre to the middle of both
STRIDE, CLOSE, STRAIGHT = 4.0, 0.5, 1.5  # in, in, deg
AWAY = 4.0  # in, before the place to grip at, where it looks again
GATE = 4.0  # standard deviations beyond which a reading is ignored
TRIES = 3

Cell = tuple[int, int]
Place = tuple[float, float]


def _is_free(x: float, y: float) -> bool:
    column, row = math.floor(x / CELL), len(MAZE) - 1 - math.floor(y / CELL)
    return 0 <= row < len(MAZE) and 0 <= column < len(MAZE[0]) and MAZE[row][column] > 0


def cast(x: float, y: float, bearing: float) -> float:
    """Distance from a place to the next wall (Amanatides and Woo, 1987), inches."""
    if not _is_free(x, y):
        return 0.0
    steps = []
    for at, way in ((x, math.cos(math.radians(bearing))), (y, math.sin(math.radians(bearing)))):
        way = way if abs(way) > 1e-9 else 1e-9
        edge = (math.floor(at / CELL) + (way > 0)) * CELL
        steps.append([(edge - at) / way, CELL / abs(way), math.copysign(1.0, way)])
    column, row = math.floor(x / CELL), math.floor(y / CELL)
    while True:
        first = steps[0] if steps[0][0] < steps[1][0] else steps[1]
        if first is steps[0]:
            column += int(first[2])
        else:
            row += int(first[2])
        if not _is_free((column + 0.5) * CELL, (row + 0.5) * CELL):
            return first[0]
        first[0] += first[1]


def turned(forward: float, left: float, heading: float) -> Place:
    """A vector in the robot's frame, as x and y in the maze's."""
    cos, sin = math.cos(math.radians(heading)), math.sin(math.radians(heading))
    return cos * forward - sin * left, sin * forward + cos * left


def expected(pose: Sequence[float], code: str) -> float:
    """Expected reading of a range sensor at a pose, inches."""
    ahead, left, bearing = RANGES[code]
    x, y = turned(ahead, left, pose[2])
    return min(cast(pose[0] + x, pose[1] + y, pose[2] + bearing + part) for part in FAN)


class Estimate:
    """The pose and its covariance: x, y (in) and heading (deg)."""

    def __init__(self, pose: Sequence[float]) -> None:
        self.pose = list(pose)
        self._covariance = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.25]]

    def predict(self, forward: float, left: float, turn: float) -> None:
        """Add a movement of the robot, by its counters."""
        way = turned(forward, left, self.pose[2] + turn / 2)
        # The heading's error moves the place to the side: d(way)/d(heading), a degree being pi / 180.
        slope = (-math.radians(way[1]), math.radians(way[0]))
        old = self._covariance
        jacobian = [[1.0, 0.0, slope[0]], [0.0, 1.0, slope[1]], [0.0, 0.0, 1.0]]
        half = [[sum(jacobian[i][k] * old[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
        new = [[sum(half[i][k] * jacobian[j][k] for k in range(3)) for j in range(3)] for i in range(3)]
        # As in solve.py: 1.5 % of the distance and 1.2 % of the turn, and a small constant part.
        along = (0.015 * math.hypot(forward, left) + 0.02) ** 2
        for index, more in enumerate((along, along, (0.012 * abs(turn) + 0.1) ** 2)):
            new[index][index] += more
        self._covariance = new
        self.pose = [self.pose[0] + way[0], self.pose[1] + way[1], self.pose[2] + turn]

    def update(self, code: str, reading: float) -> None:
        """Correct the pose by a reading of a range sensor."""
        foreseen = expected(self.pose, code)
        if not math.isfinite(reading):
            return
        steps = (0.05, 0.05, 0.2)  # in, in, deg: small beside what bends a range, large beside rounding
        slopes = []
        for index, step in enumerate(steps):
            beside = list(self.pose)
            beside[index] += step
            slopes.append((expected(beside, code) - foreseen) / step)
        if max(map(abs, slopes)) > 5.0:  # a corner: the range jumps here
            return
        gains = [sum(row[k] * slopes[k] for k in range(3)) for row in self._covariance]
        variance = sum(s * g for s, g in zip(slopes, gains, strict=True)) + (0.02 * foreseen) ** 2 + 0.15**2
        off = reading - foreseen
        if off**2 > GATE**2 * variance:
            return
        self.pose = [at + gain * off / variance for at, gain in zip(self.pose, gains, strict=True)]
        self._covariance = [
            [self._covariance[i][j] - gains[i] * gains[j] / variance for j in range(3)] for i in range(3)
        ]


class Mission:
    """The robot, and its task."""

    def __init__(self, robot: Robot, start: Sequence[float]) -> None:
        self.robot = robot
        self.estimate = Estimate(start)
        self._counted = robot.read(*COUNTERS)

    # The gripper is moved by `send`: in packets, `drive` asks for the end of a movement by a drive of 0,
    # which would open it again.

    def move(self, code: str, value: float) -> None:
        """Do one movement, and update the pose by the counters."""
        self.robot.drive(code, round(value, 2))
        now = self.robot.read(*COUNTERS)
        a, b, c, d, turn = (new - old for new, old in zip(now, self._counted, strict=True))
        self._counted = now
        self.estimate.predict((a + b) / 2, (c + d) / 2, turn)

    def look(self) -> None:
        """Read the range sensors, and correct the pose."""
        for code, reading in zip(RANGES, self.robot.read(*RANGES), strict=True):
            self.estimate.update(code, reading)

    def face(self, heading: float) -> None:
        """Turn to a heading."""
        for _ in range(4):
            turn = math.remainder(heading - self.estimate.pose[2], 360.0)
            if abs(turn) < STRAIGHT:
                return
            self.move("r1", turn)
            self.look()

    def go(self, place: Place, heading: float, close: float = CLOSE) -> bool:
        """Go straight to a place with this heading; False if it does not reach it."""
        for _ in range(40):
            self.face(heading)
            x, y, at = self.estimate.pose
            way = (place[0] - x, place[1] - y)
            distance = math.hypot(*way)
            if distance < close:
                return True
            share = min(STRIDE / distance, 1.0)
            for code, value in zip(("d1", "w1"), turned(way[0] * share, way[1] * share, -at), strict=True):
                if abs(value) > 0.15:
                    self.move(code, value)
            self.look()
        return False

    def travel(self, goal: Cell, heading: float, ahead: float = 0.0) -> bool:
        """Go from cell to cell, with the point so far `ahead` of the robot's centre in their middles."""
        shift = turned(ahead, 0.0, heading)
        x, y, _ = self.estimate.pose
        cells = route(cell_at((x + shift[0], y + shift[1])), goal)
        return bool(cells) and all(
            self.go((centre(cell)[0] - shift[0], centre(cell)[1] - shift[1]), heading) for cell in cells
        )

    def scan(self, turns: Sequence[float]) -> Place | None:
        """Turn, reading the low and the high sensor. Returns the block's place, or None if it was not
        seen."""
        seen = []
        for turn in turns:
            self.move("r1", turn)
            low, high = self.robot.read("u5", "u1")
            x, y, heading = self.estimate.pose
            by = turned(RADIUS + low + BLOCK / 2, 0.0, heading)
            place = (x + by[0], y + by[1])
            if low < 0.85 * high - 1.0 and in_zone(place):
                seen.append((low, *place))
        if not seen:
            return None
        near = [each for each in seen if each[0] < min(seen)[0] + BLOCK]
        return sum(each[1] for each in near) / len(near), sum(each[2] for each in near) / len(near)

    def search(self) -> Place | None:
        """Look for the block from one cell of the loading zone after the other."""
        here = cell_at((self.estimate.pose[0], self.estimate.pose[1]))
        for cell in sorted(ZONE, key=lambda cell: len(route(here, cell))):
            if not self.travel(cell, 90 * round(self.estimate.pose[2] / 90)):
                return None
            block = self.scan([7.5] * 48)
            self.look()
            if block is not None:
                return block
        return None

    def fetch(self) -> bool:
        """Find the block and take it; True if the gripper holds it."""
        block = self.search()
        if block is None:
            return False
        for _ in range(2):
            heading, place = approach(block)
            back = turned(AWAY, 0.0, heading)
            start = (place[0] - back[0], place[1] - back[1])
            if not self.travel(cell_at(start), heading) or not self.go(start, heading):
                return False
            seen = self.scan([-18.0, *[6.0] * 6])
            self.face(heading)
            block = seen or block
        heading, place = approach(block)
        short = turned(1.5, 0.0, heading)
        self.go((place[0] - short[0], place[1] - short[1]), heading, close=0.4)
        gap = sum(self.robot.read("u5", "u5", "u5")) / 3
        self.move("d1", (GAP + 1.5 if gap > 5.0 else gap) - GAP)
        self.robot.send("p1-1")
        return self.holds()

    def holds(self) -> bool:
        """True if most of nine readings of the load sensor are 1: single ones are sometimes wrong."""
        return sum(self.robot.read(*["l1"] * 9)) > 4.5

    def run(self, zone: Place) -> bool:
        """Do the whole mission; True if the block has been delivered."""
        for _ in range(TRIES):
            if self.fetch():
                heading = 90.0 * round(self.estimate.pose[2] / 90)
                if not self.travel(cell_at(zone), heading, ahead=MIDDLE):
                    return False
                self.robot.send("p1-0")
                return not self.holds()
            self.robot.send("p1-0")
            self.move("d1", -2.0)
        return False


def cell_at(place: Place) -> Cell:
    """The cell of a place, (0, 0) at the bottom left."""
    return math.floor(place[0] / CELL), math.floor(place[1] / CELL)


def centre(cell: Cell) -> Place:
    """The middle of a cell."""
    return (cell[0] + 0.5) * CELL, (cell[1] + 0.5) * CELL


FREE = {(x, y) for y, row in enumerate(MAZE[::-1]) for x, value in enumerate(row) if value}
ZONE = [(x, y) for y, row in enumerate(MAZE[::-1]) for x, value in enumerate(row) if value == 3]


def in_zone(place: Place) -> bool:
    """True if a block, or a point of it, may be there."""
    return any(
        max(abs(a - b) for a, b in zip(place, centre(cell), strict=True)) < CELL / 2 + BLOCK for cell in ZONE
    )


def route(start: Cell, goal: Cell) -> list[Cell]:
    """A shortest path, both ends included; empty if there is none."""
    towards, waiting = {goal: goal}, deque([goal])
    while waiting:
        x, y = waiting.popleft()
        for near in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
            if near in FREE and near not in towards:
                towards[near] = (x, y)
                waiting.append(near)
    way = [start] if start in towards else []
    while way and way[-1] != goal:
        way.append(towards[way[-1]])
    return way


def room(place: Place) -> float:
    """Distance of the robot at a place from the walls around it, inches."""
    column, row = cell_at(place)
    around = [(x, y) for x in (column - 1, column, column + 1) for y in (row - 1, row, row + 1)]
    gaps = (
        math.hypot(*(max(abs(a - b) - CELL / 2, 0.0) for a, b in zip(place, centre(cell), strict=True)))
        for cell in around
        if cell not in FREE
    )
    return min(gaps, default=CELL) - RADIUS


def approach(block: Place) -> tuple[float, Place]:
    """The heading at which to take the block, and the robot's place then: those with most room."""
    plans = []
    for heading in (0.0, 90.0, 180.0, 270.0):
        for beside in (0.0, 0.6, -0.6, 1.2, -1.2):
            ways = [turned(back, beside, heading) for back in (GRIP, GRIP + AWAY)]
            places = [(block[0] - x, block[1] - y) for x, y in ways]
            if cell_at(places[1]) in FREE:
                plans.append((min(*map(room, places), 1.2) - 0.2 * abs(beside), heading, places[0]))
    _, heading, place = max(plans)
    return heading, place


if __name__ == "__main__":
    start = [float(part) for part in os.environ["SIMMER_START"].split(",")]
    x, y = (float(part) for part in os.environ["SIMMER_DROP_ZONE"].split(","))
    packets = os.environ.get("SIMMER_PROTOCOL") == "packets"
    with Robot(protocol="packets" if packets else "binary") as robot:
        delivered = Mission(robot, start).run((x, y))
    print("delivered" if delivered else "failed")
    sys.exit(0 if delivered else 1)
