"""Starting without a screen, as a ratio to importing numpy and shapely; then rest and memory.

    python benchmarks/bench_start.py [--quick] [--json FILE]

The time is from starting the process to its line that clients may connect. CPU at rest and resident memory
are read from /proc, so on Linux only. Goals: ratio 1.7, nothing measurable at rest, 90 MB.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

RATIO_GOAL, MEMORY_GOAL = 1.7, 90.0
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
"""Without this variable both are compiled once, as in an installation."""
COMMAND = (sys.executable, "-m", "simmer_tui", "--no-ui", "--port", "0")


def imports() -> float:
    """Seconds to import the simulation's dependencies."""
    started = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import numpy, shapely"], env=ENVIRONMENT, check=True)
    return time.perf_counter() - started


def started_server() -> tuple[subprocess.Popen[bytes], float]:
    """A server, and the seconds until clients could connect."""
    started = time.perf_counter()
    process = subprocess.Popen(COMMAND, stdout=subprocess.PIPE, env=ENVIRONMENT)
    assert process.stdout is not None
    for line in process.stdout:
        if b"waiting for connection" in line:
            return process, time.perf_counter() - started
    raise SystemExit("the simulator did not start")


def end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    process.communicate()


def cpu_seconds(process: subprocess.Popen[bytes]) -> float:
    """CPU time used so far, by /proc (Linux)."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_megabytes(process: subprocess.Popen[bytes]) -> float:
    """Resident memory, by /proc (Linux)."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    kilobytes = next(line.split()[1] for line in status.splitlines() if line.startswith("VmRSS"))
    return int(kilobytes) / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="fewer and shorter runs")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    options = parser.parse_args()
    repeats, rest = (5, 2.0) if options.quick else (15, 10.0)
    baseline, starts, ratios = [], [], []
    imports()  # the first fills the file cache, and compiles
    end(started_server()[0])
    for _ in range(repeats):
        baseline.append(imports())
        process, seconds = started_server()
        end(process)
        starts.append(seconds)
        ratios.append(seconds / baseline[-1])
    ratio = statistics.median(ratios)
    figures = {"start": statistics.median(starts), "imports": statistics.median(baseline), "ratio": ratio}
    print(
        f"start to listening: {figures['start'] * 1000:.0f} ms, numpy and shapely "
        f"{figures['imports'] * 1000:.0f} ms, ratio {ratio:.2f} (goal {RATIO_GOAL})"
    )
    if sys.platform == "linux":
        process, _ = started_server()
        before = cpu_seconds(process)
        time.sleep(rest)
        figures["idle"] = (cpu_seconds(process) - before) / rest
        figures["memory"] = resident_megabytes(process)
        end(process)
        print(f"at rest: {figures['idle']:.2%} of a core over {rest:.0f} s")
        print(f"resident memory: {figures['memory']:.0f} MB (goal below {MEMORY_GOAL:.0f} MB)")
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
