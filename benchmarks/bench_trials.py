"""Trials: CPU of a run, runs a minute at one and two jobs, and the simulator's fraction by maze size.

    python benchmarks/bench_trials.py [--quick] [--runs N] [--run CMD] [--json FILE]

The first figures are the CPU time of a run of a program with two commands, in starts of `python -c 'import
simmer_tui.client'`, the least that such a program costs. It is the slope between 4 and 24 runs, user and
system time with all children, the least of five: by the real clock, by the program's clock (the default), and
for runs that fail, which have a page each. The goal is 2 starts.

On a busy machine of two cores, where a start takes 34 ms: 1.60 starts (57 ms) by the real clock, 1.70 (60 ms)
by the program's, 2.94 (101 ms) where it fails. The program itself takes 33 and 38 ms of these, 21 of them for
the imports of the client; the clock's hook takes 5, half of it for socket and threading. The simulator takes
13 and 15 ms; the rest is the end of the processes, and the page of a run that failed.

The program of the first table reads the sensors and turns a little some 200 times, so that mainly the
simulator and the connection are measured. --run measures another one with the bundled mission. The mazes are
random ones with the course's fraction of walls, 4 x 8 to 40 x 80 cells. The simulator's fraction is its CPU
time, with links and run log, over the time of the runs; the rest is the program's.
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
TWO_COMMANDS = """
from simmer_tui.client import Robot
with Robot() as robot:
    robot.read("u1")
    robot.drive("d1", 1)
"""
FEW, MANY = 4, 24
REPEATS = 5
"""Measurements of which the least counts: other processes disturb caches and the clock of the processor."""
ROOT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True, slots=True)
class Figures:
    """Measurements of one set of trials. `fraction` is the simulator's share of the time of the runs."""

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


def cpu_seconds(words: list[str]) -> float:
    """User and system time, seconds, of a process and of all that it waited for."""
    import resource  # not on Windows

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    # Without compiled files every start would compile the modules that have changed.
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    subprocess.run(
        words,
        check=False,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=kept | {"PYTHONPATH": str(ROOT)},
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def starts_a_run(command: str, configuration: str, clock: str) -> tuple[float, float]:
    """CPU time of one more run, in starts of a program that only imports the client, and in milliseconds."""

    def of_trials(runs: int) -> float:
        with tempfile.TemporaryDirectory() as name:
            words = [sys.executable, "-m", "simmer_tui", "trials", "--runs", str(runs), "--jobs", "1"]
            words += ["--config", configuration, "--seed", "3", "--out", f"{name}/out", "--run", command]
            return cpu_seconds([*words, "--clock", clock])

    starts, few, many = [], [], []
    for _ in range(REPEATS):
        starts += [cpu_seconds([sys.executable, "-c", "import simmer_tui.client"]) for _ in range(10)]
        few.append(of_trials(FEW))
        many.append(of_trials(MANY))
    run = (min(many) - min(few)) / (MANY - FEW)
    return run / min(starts), 1000 * run


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


def written(path: Path, lines: str) -> str:
    """The command that runs a program of some lines."""
    path.write_text(lines)
    words = [sys.executable, str(path)]
    return subprocess.list2cmdline(words) if sys.platform == "win32" else shlex.join(words)


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
        own = written(Path(name) / "program.py", PROGRAM)
        small = written(Path(name) / "small.py", TWO_COMMANDS)
        if sys.platform != "win32":
            for what, *of in (
                ("by the real clock", "default", "real"),
                ("by the program's clock", "default", "program"),
                ("where it fails", "mission", "program"),
            ):
                starts, milliseconds = starts_a_run(small, *of)
                print(f"CPU of a run of two commands {what}: {starts:.2f} starts, {milliseconds:.0f} ms")
        for size in SIZES if options.run is None else SIZES[:1]:
            configuration = set_of_size(Path(name) / f"{size[0]}x{size[1]}", size)
            for jobs in (1, 2):
                made.append(measure(options.run or own, str(configuration), size, runs, jobs))
                show(made[-1])
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(each) for each in made], indent=1) + "\n")


if __name__ == "__main__":
    main()
