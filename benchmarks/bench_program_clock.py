"""Speed of a 50 Hz wall follower: simulated seconds a real second, by the program's clock and by loop_time.

    python benchmarks/bench_program_clock.py [--quick] [--json FILE]

The program sleeps 20 ms a pass, reads two sensors, tells its belief and sets a velocity. The start of program
and simulator, measured by a run of length 0 in the same minute, is subtracted. The goal is 20.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

GOAL = 20.0
PROGRAM = """
import sys, time
from simmer_tui.client import Robot
seconds = float(sys.argv[1])
with Robot() as robot:
    robot.read("u1")
    passes = int(seconds * 50)
    for _ in range(passes):
        ahead, left = robot.read("u1", "u2")
        robot.send("vv-%g;0;%g" % ((4, 5 * (left - 4)) if ahead > 6 else (0, 60)))
        robot.believe(ahead, left, 0)
        if sys.argv[2] == "sleep":
            time.sleep(0.02)
"""
WAYS = {"the program's clock": ("sleep", ["--clock", "program"]), "loop_time": ("no", [])}


def seconds_of(folder: Path, simulated: float, sleeps: str, options: list[str]) -> float:
    """Real seconds of a run."""
    words = [sys.executable, "-m", "simmer_tui", "--no-ui", "--quiet", "--seed", "3", "--port", "0", *options]
    words += ["--run", f"{sys.executable} follower.py {simulated} {sleeps}"]
    begun = time.perf_counter()
    subprocess.run(words, cwd=folder, check=True, capture_output=True, env={**os.environ})
    return time.perf_counter() - begun


def main() -> int:
    """Returns 1 if a way is slower than the goal."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="10 simulated seconds, once")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    options = parser.parse_args()
    simulated, rounds = (10.0, 1) if options.quick else (60.0, 5)
    figures = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "follower.py").write_text(PROGRAM, "utf-8")
        for way, (sleeps, given) in WAYS.items():
            rates = []
            for _ in range(rounds):
                start = seconds_of(folder, 0.0, sleeps, given)
                rates.append(simulated / (seconds_of(folder, simulated, sleeps, given) - start))
            figures[way] = statistics.median(rates)
            print(f"{way}: {figures[way]:.1f} simulated seconds a second (goal {GOAL:g})", flush=True)
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")
    return 0 if min(figures.values()) >= GOAL else 1


if __name__ == "__main__":
    sys.exit(main())
