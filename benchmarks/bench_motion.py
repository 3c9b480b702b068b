"""Continuous motion: the search for contacts, as a ratio to one `cast_rays` of the default set's range
sensors, and simulated seconds in a second of processor time.

    python benchmarks/bench_motion.py [--quick] [--json FILE]

Goals: no shape above 3 times the rays; 25 simulated seconds a second, with about 40 % of the time at walls.
"""

import argparse
import json
import random
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.sim import Arc, Maze, Pose, RangeSpec, RobotSpec, Simulator, Twist
from simmer_tui.sim.arc_contact import first_arc_contact
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.obstacles import Obstacles

RATIO_GOAL, RATE_GOAL = 3.0, 25.0
SPEC = replace(load_default().simulation, wheels=None)
BODIES = {
    "disc": RobotSpec.circle(6),
    "rectangle": RobotSpec.rectangle(6, 4),
    "L": RobotSpec.polygon(((3, 3), (0, 3), (0, 0), (-3, 0), (-3, -3), (3, -3))),
}
STRETCH = 1.2
"""Inches of an arc: the length of a stretch of errors."""
SECONDS = 12.0
"""Simulated seconds of a program."""


def best_of(call: Callable[[], object], times: int) -> float:
    """The least processor time of a call, seconds."""
    found = []
    for _ in range(times):
        begun = time.process_time()
        call()
        found.append(time.process_time() - begun)
    return min(found)


def arcs(body: Footprint, walls: Obstacles, count: int) -> list[Arc]:
    """Arcs of a stretch from random free places."""
    numbers, found = random.Random(1), list[Arc]()
    while len(found) < count:
        pose = Pose(numbers.uniform(0, 96), numbers.uniform(0, 48), numbers.uniform(-180, 180))
        if not walls.overlap(body, pose):
            speed = numbers.uniform(2, 8)
            found.append(Arc.of(pose, Twist(speed, 0.0, numbers.uniform(-60, 60)), STRETCH / speed))
    return found


def searched(body: Footprint, walls: Obstacles, chosen: list[Arc]) -> None:
    """Search for the contact of each arc."""
    for arc in chosen:
        first_arc_contact(body, walls, arc)


def driven(simulator: Simulator, programs: int) -> None:
    """Run programs that drive at random, each for `SECONDS`."""
    for seed in range(programs):
        simulator.reset(seed)
        numbers = random.Random(seed)
        while simulator.time < SECONDS:
            x, y, r = (numbers.uniform(-6, 6) for _ in range(3))
            simulator.execute(f"vv-{x:.2f};{y:.2f};{20 * r:.1f}")
            simulator.execute(f"wt-{numbers.uniform(0.05, 2.5):.3f}")


def main() -> int:
    """Returns 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description="Measure continuous motion.")
    parser.add_argument("--quick", action="store_true", help="fewer arcs and programs")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file")
    options = parser.parse_args()
    count, programs, times = (60, 3, 2) if options.quick else (400, 25, 5)
    walls = Obstacles.of_maze(Maze(SPEC.maze).walls)
    simulator = Simulator(SPEC, seed=1)
    sensors = map(simulator.sensor, simulator.ranging_codes())
    rays = sum(sensor.rays for sensor in sensors if isinstance(sensor, RangeSpec))
    origins, bearings = np.full((rays, 2), (9.5, 42.0)), np.linspace(0.0, 360.0, rays)
    casting = best_of(lambda: [simulator.cast_rays(origins, bearings) for _ in range(count)], times)
    figures: dict[str, float] = {}
    for name, spec in BODIES.items():
        body = Footprint.of(spec)
        searching = best_of(partial(searched, body, walls, arcs(body, walls, count)), times)
        robot = Simulator(replace(SPEC, robot=spec), seed=1)
        rate = programs * SECONDS / best_of(partial(driven, robot, programs), 1)
        figures |= {f"{name}_ratio": searching / casting, f"{name}_simulated_s_per_s": rate}
        print(
            f"{name:9}  search {searching / casting:.2f} of the rays, {rate:.0f} simulated seconds a second"
        )
    if options.json is not None:
        options.json.write_text(json.dumps(figures))
    slow = [name for name in BODIES if figures[f"{name}_ratio"] > RATIO_GOAL]
    slow += [name for name in BODIES if figures[f"{name}_simulated_s_per_s"] < RATE_GOAL]
    if slow:
        print(f"goal missed: {', '.join(sorted(set(slow)))}")
    return 1 if slow and not options.quick else 0


if __name__ == "__main__":
    sys.exit(main())
