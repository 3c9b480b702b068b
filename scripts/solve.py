"""Do the whole mission: find out where the robot is, fetch the block, set it down in the drop zone.

    simmer-tui --mission --run "python scripts/solve.py"

A sample to learn from. It knows the maze and the robot (the configuration set), not where it starts
nor where the block lies. How it goes about it, and where to read on:

- `solve_beliefs.py`: a particle filter says where the robot is, a grid of guesses where the block is;
- `solve_pilot.py`: drives in small steps, learns the drives' biases, corrects what went wrong;
- `solve_ground.py`: plans the way from cell to cell.

Needs numpy and SimMeR-TUI, installed or in this clone.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parent.parent))  # a clone's root; what is installed comes first

from solve_beliefs import BlockFinder, FloatArray, Localizer, rotated
from solve_ground import Ground, cell_at, centre
from solve_pilot import ALONG, ASIDE, DRIVES, GYROSCOPE, RANGES, REPEATS, LostError, Pilot, RobotLike

from simmer_tui.client import Robot, RobotError
from simmer_tui.config.loader import find_set, load
from simmer_tui.config.maze_csv import read_cells
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim import MazeSpec, SimulationSpec, Simulator

COMPASS, LOAD, GRIPPER = "c1", "l1", "p1"
AHEAD = ("u1", "u2", "u4")
HIGH, LOW = "u1", "u5"  # both look ahead, one over the block, the other at it
NEEDED = {COMPASS, LOAD, GRIPPER, LOW, *RANGES, *ALONG, *ASIDE, GYROSCOPE, *DRIVES}
LOADING = 3  # the value of the loading zone's cells in maze.csv
GAP = 0.3  # in, between robot and block when the gripper closes
RUN_UP = 3.0  # in, from where the robot aims to where it grips
ENOUGH = 1.5  # in, to the next wall; more is no better
ROUNDS = 4  # tries at localizing, searching, gripping


class Mission:
    """The robot, and what it knows."""

    def __init__(self, robot: RobotLike, spec: SimulationSpec, random: np.random.Generator) -> None:
        self.robot = robot
        self.ground = Ground(spec.maze)
        simulator = Simulator(spec)  # never driven: it only works out what sensors would see
        self.radius = simulator.footprint.reach
        self.localizer = Localizer(simulator, self.ground, RANGES, random)
        self.pilot = Pilot(robot, self.localizer)
        self.zone = self.ground.cells(LOADING)
        self.finder = BlockFinder(self.ground, simulator.sensor(LOW), spec.block_size, self.zone)
        self.grip = simulator.footprint.front + GAP + spec.block_size / 2
        # With the block, the robot needs as much room as a circle around both.
        ahead = math.hypot(self.grip + spec.block_size / 2, spec.block_size / 2)
        self.loaded_reach = (ahead - self.radius) / 2
        self.loaded_radius = (ahead + self.radius) / 2

    def run(self, drop_zone: FloatArray) -> bool:
        """Do everything. Whether the block has been delivered, as far as the program knows."""
        for _ in range(ROUNDS):
            try:
                if not self.localizer.settled and not self.localize():
                    continue
                if self.loaded() or self.fetch():
                    self.say(f"carrying the block to ({drop_zone[0]:g}, {drop_zone[1]:g})")
                    self.travel(drop_zone)
                    self.robot.drive(GRIPPER, 0)
                    return not self.loaded()
            except LostError as error:
                self.say(f"lost: {error}")
                self.localizer.forget()
        return False

    # -- where am I? -------------------------------------------------------------------------

    def localize(self) -> bool:
        """Turn around on the spot, looking; where that is not enough, do it again elsewhere."""
        # The compass reads heading times (1 + error): far from north it is less exact.
        heading = self.pilot.mean(COMPASS, 25)
        self.localizer.scatter(self.radius, heading, 3.0 + 0.03 * abs(heading))
        self.say(f"somewhere, heading about {heading:.0f} degrees")
        self.pilot.sense()
        for _ in range(ROUNDS):
            for _ in range(12):  # with sensors 45 degrees apart, a look every 15 degrees
                self.pilot.move(0.0, 0.0, 30.0)
            if self.localizer.settled:
                x, y, heading = self.localizer.pose
                self.say(f"at ({x:.1f}, {y:.1f}) heading {heading:.0f}")
                return True
            for _ in range(4):
                if min(map(self.pilot.mean, AHEAD)) > 5.0:
                    self.pilot.move(3.0, 0.0, 0.0)
                    break
                self.pilot.move(0.0, 0.0, 90.0)
        return False

    # -- the way ------------------------------------------------------------------------------

    def travel(self, target: FloatArray) -> None:
        """Go to a place from cell to cell. The robot can drive sideways, so that it turns no more
        than it takes to be parallel to the walls: that keeps its block out of the corners."""
        heading = 90.0 * round(self.localizer.pose[2] / 90.0)
        way = self.ground.route(cell_at(self.pilot.middle), cell_at(target))
        if not way:
            raise LostError("there is no way from here")
        for cell in way:
            self.pilot.go(centre(cell), heading, tolerance=0.7)
        self.pilot.go(target, heading)

    # -- the block ----------------------------------------------------------------------------

    def fetch(self) -> bool:
        """Find the block and take it. Whether the gripper holds it."""
        for _ in range(ROUNDS):
            if not self.search():
                continue
            heading = self.best_approach(self.finder.place)
            self.travel(self.finder.place - (self.grip + RUN_UP) * direction(heading))
            for side in (-20.0, -10.0, 0.0, 10.0, 20.0):
                self.face(heading + side)
                self.look()
            block = self.finder.place
            heading = bearing(self.pilot.middle, block)
            self.say(f"taking the block at ({block[0]:.1f}, {block[1]:.1f})")
            self.face(heading)
            start = self.pilot.middle
            self.pilot.go(block - self.grip * direction(heading), heading, tolerance=0.2)
            self.robot.drive(GRIPPER, 1)
            if self.loaded():
                self.pilot.reach = self.loaded_reach
                self.pilot.go(start + self.loaded_reach * direction(heading), heading)
                return True
            self.say("missed it")
            self.robot.drive(GRIPPER, 0)
            self.pilot.go(start, heading)
            self.finder.forget()
        return False

    def search(self) -> bool:
        """Look into the loading zone from beside it, then from within, until it is clear where the
        block is."""
        waiting = {*self.zone, *self.ground.beside(self.zone)}
        while waiting:
            ways = [self.ground.route(cell_at(self.pilot.middle), cell) for cell in sorted(waiting)]
            way = min(filter(None, ways), key=len, default=[])
            if not way:
                raise LostError("there is no way to the loading zone")
            waiting.remove(way[-1])
            spot = centre(way[-1])
            self.say(f"looking for the block from ({spot[0]:g}, {spot[1]:g})")
            self.travel(spot)
            for _ in range(40):
                self.look()
                if self.finder.spread < 0.8:
                    return True
                self.pilot.move(0.0, 0.0, 9.0)
        self.finder.forget()
        return False

    def look(self) -> None:
        """Compare what the two sensors in front see."""
        high, low = self.pilot.mean(HIGH), self.pilot.mean(LOW)
        self.finder.update(self.localizer.pose, high, low, REPEATS)

    def face(self, heading: float) -> None:
        """Turn to a heading on the spot."""
        self.pilot.go(self.pilot.middle, heading)

    def best_approach(self, block: FloatArray) -> float:
        """The heading to take a block with: where robot and block have most room, and then the one
        that leads straight to it from here."""
        straight = bearing(self.pilot.middle, block)

        def room(heading: float) -> float:
            ahead = direction(heading)
            robot = np.array([block - (self.grip + back) * ahead for back in np.linspace(0.0, RUN_UP, 4)])
            body = robot[-1:] + self.loaded_reach * ahead
            for_robot = float(self.ground.clearance(robot).min()) - self.radius
            for_both = float(self.ground.clearance(body)[0]) - self.loaded_radius
            detour = abs(math.remainder(heading - straight, 360.0))
            return min(for_robot, for_both, ENOUGH) - 0.001 * detour

        return max(map(float, range(-180, 180, 15)), key=room)

    def loaded(self) -> bool:
        """Whether the gripper holds something; the sensor may err now and then."""
        return self.pilot.mean(LOAD, 9) > 0.5

    def say(self, text: str) -> None:
        """Tell what goes on, here and in the simulator's app."""
        self.pilot.note = text
        print(text, flush=True)


def direction(heading: float) -> FloatArray:
    """The unit vector of a heading."""
    return rotated(np.array((1.0, 0.0)), heading)


def bearing(start: FloatArray, goal: FloatArray) -> float:
    """The heading that leads from one place to another."""
    return math.degrees(math.atan2(goal[1] - start[1], goal[0] - start[0]))


def place(text: str) -> FloatArray:
    """`30,18` as x and y."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise argparse.ArgumentTypeError(f"{text!r} is not x,y in inches, such as 30,18")
    return np.array((x, y))


def in_maze(spec: SimulationSpec, path: Path) -> SimulationSpec:
    """The robot in the maze of a file like maze.csv; the block and its start are put where they can be.

    Raises ConfigurationError.
    """
    problems: list[Problem] = []
    cells = read_cells(path, problems)
    if cells is None:
        raise ConfigurationError(problems)
    maze = MazeSpec(cells)
    free = [centre(cell) for cell in Ground(maze).cells()]
    if not free:
        raise ConfigurationError([Problem(path.name, "has no free cell")])
    return replace(spec, maze=maze, bot_center=tuple(free[0]), block_center=tuple(free[-1]))


def main(arguments: Sequence[str] | None = None) -> int:
    """Do the mission; returns 0 when the block has been delivered."""
    parser = argparse.ArgumentParser(description="Localize, fetch the block, deliver it to the drop zone.")
    parser.add_argument("--seed", type=int, default=0, help="of its own random numbers (default: 0)")
    parser.add_argument("--config", default="mission", help="set with its maze and robot (default: mission)")
    parser.add_argument(
        "--maze",
        type=Path,
        default=os.environ.get("SIMMER_MAZE"),
        metavar="FILE",
        help="another maze (default: SIMMER_MAZE, which trials in other mazes set, else that of the set)",
    )
    parser.add_argument(
        "--drop-zone",
        type=place,
        default=os.environ.get("SIMMER_DROP_ZONE"),
        metavar="X,Y",
        help="where the block is to go, inches (default: SIMMER_DROP_ZONE, which a mission sets)",
    )
    options = parser.parse_args(arguments)
    if options.drop_zone is None:
        parser.error("where is the block to go? Give --drop-zone X,Y or run it in simmer-tui --mission")
    try:
        spec = load(find_set(options.config)).simulation
        if options.maze is not None:
            spec = in_maze(spec, options.maze)
        missing = NEEDED - {part.code for part in (*spec.sensors, *spec.drives, spec.gripper) if part}
        if missing:
            parser.error(f"the robot of set {options.config!r} has no {', '.join(sorted(missing))}")
        if not Ground(spec.maze).cells(LOADING):
            which = options.maze or f"of set {options.config!r}"
            parser.error(f"the maze {which} has no cell of value {LOADING} to find a block in")
        with Robot() as robot:
            delivered = Mission(robot, spec, np.random.default_rng(options.seed)).run(options.drop_zone)
    except (ConfigurationError, RobotError) as error:
        print(f"solve: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped")
        return 1
    print("delivered" if delivered else "failed")
    return 0 if delivered else 1


if __name__ == "__main__":
    sys.exit(main())
