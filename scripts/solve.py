"""Do the whole mission: find out where the robot is, fetch the block, set it down in the drop zone.

    simmer-tui --mission --run "python samples/solve.py"
    simmer-tui --mission --realistic --drive-profile diff-dc --run "python samples/solve.py"

A sample to learn from. It knows the maze and the robot (the configuration set, and the chosen profiles), but
not its start or the block's place. Readings take time, so it reads only the sensors that it needs. Its
modules:

- `solve_beliefs.py`: a particle filter for the robot's pose, and a grid of guesses for the block's place;
  both compute which reading is the most informative;
- `solve_pilot.py`: drives in small steps, learns the drives' biases, corrects errors;
- `solve_way.py`: brings the robot from place to place, with the block or without;
- `solve_ground.py`: the cells, the routes between them and the room there.

Needs numpy and SimMeR-TUI, installed or in this clone.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from msgspec.structs import replace

sys.path.append(str(Path(__file__).resolve().parent.parent))  # a clone's root; an installed one is first

from solve_beliefs import BlockFinder, FloatArray, Localizer, mean_angle
from solve_ground import ENOUGH, Body, Ground, cell_at, centre
from solve_pilot import (
    ALONG,
    ASIDE,
    DRIVES,
    GYROSCOPE,
    RANGES,
    LostError,
    Pilot,
    RobotLike,
    bearing,
    direction,
)
from solve_way import Travel

from simmer_tui.client import Robot, RobotError
from simmer_tui.config.loader import Override, find_set, load
from simmer_tui.config.maze_csv import read_cells
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim import MazeSpec, SimulationSpec, Simulator

COMPASS, LOAD, GRIPPER = "c1", "l1", "p1"
AHEAD = ("u1", "t1")
HIGH, LOW = "u1", "u5"  # both look ahead, one over the block, the other at it
NEEDED = {COMPASS, LOAD, GRIPPER, LOW, *RANGES, *ALONG, *ASIDE, GYROSCOPE, *DRIVES}
LOADING = 3  # the value of the loading zone's cells in maze.csv
GAP = 0.3  # in, between robot and block when the gripper closes
RUN_UP = 3.0  # in, from where the robot aims to where it grips
FOUND = 0.7  # in, spread of the guesses at which the block counts as found
BLUR = 0.2  # in, uncertainty of the block's place in the gripper
ROUNDS = 4  # tries at localizing, searching, gripping
LOOKS = 60  # readings of one search


class Mission:
    """The robot, and its beliefs."""

    def __init__(self, robot: RobotLike, spec: SimulationSpec, random: np.random.Generator) -> None:
        self.robot = robot
        self.ground = Ground(spec.maze)
        simulator = Simulator(spec)  # never driven: it only computes expected readings
        footprint = simulator.footprint
        self.body = Body(self.ground, footprint.reach)
        self.localizer = Localizer(simulator, self.ground, RANGES, random)
        self.pilot = Pilot(robot, self.localizer, self.body)
        self.grip = footprint.front + GAP + spec.block_size / 2
        self.travel = Travel(self.pilot, self.ground, self.body, self.grip)
        self.zone = self.ground.cells(LOADING)
        self.finder = BlockFinder(simulator, self.ground, (HIGH, LOW), spec.block_size, self.zone)
        self.block_size = spec.block_size
        # Sound that meets a face at an angle has no echo: then look at blocks squarely.
        self.headings = range(-180, 180, 90 if simulator.sensor(LOW).incidence_limit else 15)

    def run(self, drop_zone: FloatArray) -> bool:
        """Do the whole mission. True if the block has been delivered, as far as the program knows."""
        for _ in range(ROUNDS):
            try:
                if not self.localizer.settled and not self.localize():
                    continue
                if self.body.loaded or self.fetch():
                    self.say(f"carrying the block to ({drop_zone[0]:g}, {drop_zone[1]:g})")
                    self.travel.to(drop_zone)
                    self.robot.drive(GRIPPER, 0)
                    return not self.loaded()
            except LostError as error:
                self.say(f"lost: {error}")
                self.localizer.forget()
        return False

    # -- where am I? -------------------------------------------------------------------------

    def localize(self) -> bool:
        """Turn around on the spot and read sensors; if that is not enough, do it again at another place."""
        readings = np.array([self.robot.read(COMPASS) for _ in range(25)])
        heading = mean_angle(readings, np.full(25, 1 / 25)) % 360.0
        # The compass of the course reads heading times (1 + error): far from 0 it is less exact.
        self.localizer.scatter(self.body.radius, heading, 5.0 + 0.03 * heading)
        self.say(f"somewhere, heading about {heading:.0f} degrees")
        self.pilot.look(least=0.0)
        for _ in range(ROUNDS):
            for _ in range(8):  # with sensors 45 degrees apart each looks where another one did
                self.pilot.turn(45.0)
                self.pilot.look()
                if self.localizer.settled:
                    x, y, heading = self.localizer.pose
                    self.say(f"at ({x:.1f}, {y:.1f}) heading {heading:.0f}")
                    return True
            for _ in range(4):
                if min(self.pilot.robot.read(code) for code in AHEAD) > 7.0:
                    self.pilot.drive(4.0)
                    self.pilot.look()
                    break
                self.pilot.turn(90.0)
        return False

    # -- the block ----------------------------------------------------------------------------

    def fetch(self) -> bool:
        """Find the block and take it. True if the gripper holds it."""
        for _ in range(ROUNDS):
            if not self.search():
                continue
            heading = self.best_approach(self.finder.place)
            start = self.finder.place - (self.grip + RUN_UP) * direction(heading)
            self.travel.to(start)
            for side in (-12.0, 12.0, 0.0):
                self.pilot.face(bearing(self.finder.place - self.pilot.place) + side)
                self.watch()
            block = self.finder.place
            self.say(f"taking the block at ({block[0]:.1f}, {block[1]:.1f})")
            self.pilot.face(bearing(block - self.pilot.place))
            self.pilot.drive(float(np.hypot(*(block - self.pilot.place))) - self.grip)
            self.pilot.look()
            self.robot.drive(GRIPPER, 1)
            if self.loaded():
                self.body.take(self.localizer.pose, block, self.block_size + 2 * BLUR)
                return True
            self.say("missed it")
            self.robot.drive(GRIPPER, 0)
            self.pilot.go(start, backwards=True)
            self.finder.forget()
        return False

    def search(self) -> bool:
        """Make the most informative readings until the block's place is clear. If no reading here is
        informative, go to another place."""
        for _ in range(LOOKS):
            if self.finder.spread < FOUND:
                return True
            heading, bits = self.best_look(self.pilot.place, self.pilot.heading)
            if bits > 0.25:
                self.pilot.face(heading)
                self.watch()
                continue
            spots = [centre(cell) for cell in {*self.zone, *self.ground.beside(self.zone)}]
            spot = max(spots, key=self.promise)
            if self.promise(spot) <= 0.0:
                break
            self.say(f"looking for the block from ({spot[0]:g}, {spot[1]:g})")
            self.travel.to(spot)
        self.finder.forget()
        return False

    def best_look(self, place: FloatArray, heading: float) -> tuple[float, float]:
        """The best heading for a reading at a place, and its information, bits; a quarter turn less is worth
        twice as many."""
        looks = {
            turn: self.finder.surprise(np.array((*place, heading + turn))) for turn in range(-176, 177, 8)
        }
        turn = max(looks, key=lambda turn: looks[turn] / (1.0 + abs(turn) / 90.0))
        return heading + turn, looks[turn]

    def promise(self, spot: FloatArray) -> float:
        """Information of readings at a place, bits for each second of the way there; 0 if little."""
        way = self.ground.route(cell_at(self.pilot.place), cell_at(spot))
        if len(way) < 2:
            return 0.0
        bits = max(self.finder.surprise(np.array((*spot, heading))) for heading in range(0, 360, 15))
        return bits / (1.0 + 3.0 * len(way)) if bits > 0.25 else 0.0

    def watch(self) -> None:
        """Read the low sensor. If its range is shorter than that of the walls, read the high one too."""
        pose = self.localizer.pose
        wall = self.finder.wall(pose)
        low = self.robot.read(LOW)
        if low < wall - 1.0:
            wall = min(wall, self.robot.read(HIGH))
        self.finder.update(pose, wall, low)

    def best_approach(self, block: FloatArray) -> float:
        """The heading at which to take a block: the one with most room for robot and block, and among equal
        ones that straight from here."""
        straight = bearing(block - self.pilot.place)

        def room(heading: float) -> float:
            ahead = direction(heading)
            robot = np.array(
                [block - (self.grip + back) * ahead for back in np.linspace(0.0, RUN_UP + 3.0, 5)]
            )
            detour = abs(math.remainder(heading - straight, 360.0))
            return min(self.body.room(robot, np.full(5, heading)), ENOUGH) - 0.001 * detour

        return max(map(float, self.headings), key=room)

    def loaded(self) -> bool:
        """True if the gripper holds something; the sensor is sometimes wrong."""
        return self.pilot.mean(LOAD, 9) > 0.5

    def say(self, text: str) -> None:
        """Show the present step, here and in the simulator's app."""
        self.pilot.note = text
        print(text, flush=True)


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
    """The robot in the maze of a file like maze.csv, with block and start at possible places.

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
        metavar="X,Y",
        help="where the block is to go, inches (default: that of the simulator's mission)",
    )
    for sort, what in (("drive", "of the robot's drive"), ("sensor", "of its sensors, with commas between")):
        variable = f"SIMMER_{sort.upper()}_PROFILE"
        parser.add_argument(
            f"--{sort}-profile",
            default=os.environ.get(variable, ""),
            metavar="NAME",
            help=f"the profile {what} (default: {variable}, which the simulator sets)",
        )
    options = parser.parse_args(arguments)
    try:
        profiles = {
            name: Override(f"--{name.replace('_', '-')}", value)
            for name, value in vars(options).items()
            if name.endswith("_profile") and value
        }
        spec = load(find_set(options.config), profiles).simulation
        if options.maze is not None:
            spec = in_maze(spec, options.maze)
        parts = [part for part in (*spec.sensors, *spec.drives, spec.gripper) if part and part.enabled]
        missing = NEEDED - {part.code for part in parts}
        if missing:
            parser.error(f"the robot of set {options.config!r} has no {', '.join(sorted(missing))}")
        if not Ground(spec.maze).cells(LOADING):
            which = options.maze or f"of set {options.config!r}"
            parser.error(f"the maze {which} has no cell of value {LOADING} to find a block in")
        with Robot() as robot:
            drop_zone = options.drop_zone
            if drop_zone is None:
                drop_zone = np.array(robot.mission().drop_zone)
            delivered = Mission(robot, spec, np.random.default_rng(options.seed)).run(drop_zone)
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
