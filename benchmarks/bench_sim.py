"""The simulation in process: readings, batched rays, pairs of movements, a second.

    python benchmarks/bench_sim.py [--quick] [--json FILE]

Each figure is the median of several runs, beside a baseline measured in between: calls of an empty Python
function, or numpy's hypot for each element. So figures are comparable between machines.
"""

from __future__ import annotations

import argparse
import itertools
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from simmer_tui.config import load_default
from simmer_tui.sim import Simulator, parse_command

RAYS = 100_000


def nothing() -> None:
    """The baseline for single calls."""


def per_second(work: Callable[[], object], seconds: float) -> float:
    """Rate at which `work` can be done, calls a second."""
    count, started = 0, time.perf_counter()
    while (elapsed := time.perf_counter() - started) < seconds:
        for _ in range(10):
            work()
        count += 10
    return count / elapsed


def works() -> list[tuple[str, Callable[[], object], int, Callable[[], object], float]]:
    """Measurements: name, work, number of items in one call, baseline, goal."""
    configuration = load_default().simulation
    still, moving, driven = (Simulator(configuration, seed=1) for _ in range(3))
    reading = parse_command("u1")

    moving.begin("r1-1e6")
    moments = itertools.count()

    def read_in_motion() -> None:
        moving.advance(next(moments) * 1e-3 % 8000.0)
        moving.begin(reading)

    there, back = parse_command("d1-1"), parse_command("d1--1")
    start = driven.pose

    def drive_there_and_back() -> None:
        driven.execute(there)
        driven.execute(back)
        if abs(driven.pose.x - start.x) > 3.0:  # errors add up; stay clear of walls
            driven.teleport(start)

    random = np.random.default_rng(1)
    origins = np.column_stack((random.uniform(12, 24, RAYS), random.uniform(36, 48, RAYS)))
    bearings = random.uniform(0, 360, RAYS)
    yards = random.uniform(0, 1, (2, RAYS))

    def hypot() -> None:
        np.hypot(yards[0], yards[1])

    return [
        ("ultrasonic readings, at rest", lambda: still.execute(reading), 1, nothing, 30_000),
        ("ultrasonic readings, each from a new pose", read_in_motion, 1, nothing, 30_000),
        ("batched rays", lambda: still.cast_rays(origins, bearings), RAYS, hypot, 2_000_000),
        ("pairs of d1-1 and d1--1", drive_there_and_back, 1, nothing, 0),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="shorter runs")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    options = parser.parse_args()
    repeats, seconds = (3, 0.1) if options.quick else (9, 0.3)
    figures = {}
    for name, work, size, yardstick, goal in works():
        rates, ratios = [], []
        for _ in range(repeats):
            ours, yard = per_second(work, seconds) * size, per_second(yardstick, seconds) * size
            rates.append(ours)
            ratios.append(ours / yard)
        rate, ratio = statistics.median(rates), statistics.median(ratios)
        figures[name] = {"per second": rate, "ratio": ratio}
        wanted = f" (goal {goal:,.0f})" if goal else ""
        print(f"{name}: {rate:,.0f}/s{wanted}, ratio to {yardstick.__name__} {ratio:.3g}")
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
