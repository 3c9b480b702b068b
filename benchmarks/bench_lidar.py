"""Cost of a lidar's scan, as a ratio to as many single rays of `cast_rays` in one call.

    python benchmarks/bench_lidar.py [--quick] [--json FILE]

A scan adds to its rays the pose of the robot at the moment of each, the errors and the record. If nothing has
moved since the previous scan, it casts no ray. Goal: a ratio of 1.3, at rest and in motion.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.sim import Pose, Simulator
from simmer_tui.sim.sensors import Lidar, LidarSpec

RATIO_GOAL = 1.3
RAYS = (72, 360, 1450)
STATES = ("at rest", "put elsewhere", "turning", "driving", "movements")
PLACE = Pose(66.0, 18.0, 33.0)
# A curve of less than 3 in, without contact with a wall.
VELOCITIES = {"turning": "vv-0;0;126.5", "driving": "vv-3;0;60"}


def robot(rays: int) -> Simulator:
    """The mission set's robot in mid-maze, with nothing but a lidar, its drives without bias."""
    lidar = LidarSpec(kind=Lidar, number=1, code="sc", z=2.0, rays=rays)
    spec = load(bundled_folder() / "mission").simulation
    return Simulator(
        replace(spec, sensors=(lidar,), bot_center=(PLACE.x, PLACE.y), bot_rot=PLACE.heading, randbias=False),
        5,
    )


def moved(simulator: Simulator, state: str, number: int) -> None:
    """Move a robot as between two scans, one turn of its lidar apart."""
    if state == "put elsewhere":
        simulator.teleport(Pose(PLACE.x + 0.01 * (number % 50), PLACE.y, PLACE.heading + number))
    elif state == "movements":
        simulator.execute("r1-7" if number % 2 else "r1--7")
    # Slightly more than a turn, so that rounding does not leave the same one.
    simulator.advance(simulator.time + 1.001 / 5.5)


def measured(state: str, rays: int, rounds: int) -> tuple[float, float]:
    """Seconds of the fastest scan, and of as many rays in one call."""
    simulator = robot(rays)
    if state in VELOCITIES:
        simulator.execute(VELOCITIES[state])
    scans, casts = [], []
    for number in range(rounds):
        moved(simulator, state, 2 * number)
        scans.append(_timed(lambda: simulator.begin("sc")))
        reading = simulator.begin("sc").reading
        assert reading is not None
        assert reading.scan is not None
        origins = np.ascontiguousarray(reading.scan.poses[:, :2])
        bearings = reading.scan.poses[:, 2] + reading.scan.bearings
        # Each is measured once after a motion: a loop over the same rays would be faster, from the cache.
        moved(simulator, state, 2 * number + 1)
        casts.append(_timed(lambda: simulator.cast_rays(origins, bearings, 2.0)))  # noqa: B023
    return min(scans), min(casts)


def _timed(call: Callable[[], object]) -> float:
    begun = time.perf_counter()
    call()
    return time.perf_counter() - begun


def main() -> int:
    """Returns 1 if the goal was missed."""
    parser = argparse.ArgumentParser(description="Take scans.")
    parser.add_argument("--quick", action="store_true", help="fewer scans")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures there")
    options = parser.parse_args()
    rounds = 60 if options.quick else 400
    figures: dict[str, float] = {}
    for rays in RAYS:
        for state in STATES:
            scan, cast = measured(state, rays, rounds)
            name = f"{state.replace(' ', '_')}_{rays}"
            figures |= {f"{name}_ms": 1e3 * scan, f"{name}_ratio": scan / cast}
            print(
                f"{rays:5} rays, {state:13}: {1e3 * scan:5.2f} ms, {scan / cast:4.2f} of so many single rays"
            )
    if options.json is not None:
        options.json.write_text(json.dumps(figures) + "\n", encoding="utf-8")
    judged = [figures[f"{state.replace(' ', '_')}_{rays}_ratio"] for state in STATES for rays in (360, 1450)]
    return int(max(judged) > RATIO_GOAL)


if __name__ == "__main__":
    sys.exit(main())
