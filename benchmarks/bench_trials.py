"""Trials: runs a minute at one and two jobs, the simulator's fraction of it, and both by maze size.

    python benchmarks/bench_trials.py [--quick] [--runs N] [--run CMD] [--json FILE]

The program of the first table reads the sensors and turns a little some 200 times, so that little
but the simulator and the connection is measured; --run measures another one with the bundled
mission. The mazes are random ones with the fraction of walls of the course's, 4 x 8 to 40 x 80 cells.
The simulator's fraction is its CPU time, links and run log included, over the time of the runs; what
is left is the program's.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from simmer_tui.config.mission_plan import cells_of
from simmer_tui.config.sets import bundled_sets, init_set
from simmer_tui.sim.specs import BLOCK, START, MazeSpec
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.mazes import maze_text, random_maze

SIZES = ((4, 8), (8, 16), (16, 32), (40, 80))
MAZE = (
    (3, 3, 1, 1, 0, 2, 0, 2),
    (3, 3, 0, 1, 1, 1, 1, 1),
    (1, 0, 2, 0, 0, 1, 0, 1),
    (1, 1, 1, 1, 1, 1, 0, 2),
)
PROGRAM = """
from simmer_tui.client import Robot
with Robot() as robot:
    for _ in range(40):
        for code in ("u1", "u2", "u3", "i1"):
            robot.read(code)
        robot.drive("r1", 5)
"""
ROOT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True, slots=True)
class Figures:
    """What one set of trials took. `fraction` is the simulator's of the time of the runs."""

    rows: int
    columns: int
    jobs: int
    runs: int
    runs_a_minute: float
    seconds_a_run: float
    fraction: float


def measure(command: str, configuration: str, size: tuple[int, int], runs: int, jobs: int) -> Figures:
    """Do a set of trials and read its figures."""
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "out"
        options = ["--run", command, "--config", configuration, "--runs", str(runs), "--jobs", str(jobs)]
        started = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "simmer_tui", "trials", *options, "--seed", "1", "--out", str(out)],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )
        seconds = time.perf_counter() - started
        results = TrialFolder.read(out).done
    in_runs = sum(result.real_seconds for result in results)
    return Figures(
        rows=size[0],
        columns=size[1],
        jobs=jobs,
        runs=runs,
        runs_a_minute=60 * runs / seconds,
        seconds_a_run=in_runs / runs,
        fraction=sum(result.simulator_seconds for result in results) / in_runs,
    )


def set_of_size(folder: Path, size: tuple[int, int]) -> Path:
    """The mission set with a maze of so many rows and columns, and so the course's at the smallest."""
    init_set(folder, bundled_sets()["mission"])
    rows, columns = size
    tiled = MazeSpec(tuple(tuple(MAZE[r % 4][c % 8] for c in range(columns)) for r in range(rows)))
    maze = tiled if size == SIZES[0] else random_maze(tiled, np.random.default_rng(0))
    (folder / "maze.csv").write_text(maze_text(maze))
    settings = folder / "settings.toml"
    text = settings.read_text().replace("[9.5, 42.0]", f"{list(first_cell(maze, START))}")
    settings.write_text(text.replace("[25.0, 41.0]", f"{list(first_cell(maze, BLOCK))}"))
    return folder


def first_cell(maze: MazeSpec, value: int) -> tuple[float, float]:
    """The middle of a cell of some value, inches."""
    return next((cell.x, cell.y) for cell in cells_of(maze, value))


def show(figures: Figures) -> None:
    print(
        f"{figures.rows:3} x {figures.columns:<3} cells, jobs {figures.jobs}: "
        f"{figures.runs_a_minute:6.0f} runs a minute, {figures.seconds_a_run * 1000:6.0f} ms a run, "
        f"{figures.fraction:4.0%} of it the simulator"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="fewer runs")
    parser.add_argument("--runs", type=int, help="runs of each set of trials (default 100, quick 10)")
    parser.add_argument("--run", metavar="CMD", help="another program, in the course's maze only")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    options = parser.parse_args()
    runs = options.runs or (10 if options.quick else 100)
    made = []
    with tempfile.TemporaryDirectory() as name:
        program = Path(name) / "program.py"
        program.write_text(PROGRAM)
        words = [sys.executable, str(program)]
        own = subprocess.list2cmdline(words) if sys.platform == "win32" else shlex.join(words)
        for size in SIZES if options.run is None else SIZES[:1]:
            configuration = set_of_size(Path(name) / f"{size[0]}x{size[1]}", size)
            for jobs in (1, 2):
                made.append(measure(options.run or own, str(configuration), size, runs, jobs))
                show(made[-1])
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(each) for each in made], indent=1) + "\n")


if __name__ == "__main__":
    main()
