"""Expected readings at every pose of a grid: 1 in, 36 headings, the default set's six range sensors.

    python benchmarks/bench_atlas.py [--quick] [--json FILE]

The whole command, from starting the process to the .npz file on the disk. Goals: 3 s and 1 MB. --quick is the
same: it takes seconds.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SECONDS_GOAL, MEGABYTES_GOAL = 3.0, 1.0
TIMES = 3


def main() -> int:
    """Returns 1 if a goal was missed."""
    parser = argparse.ArgumentParser(description="Compute an atlas.")
    parser.add_argument("--quick", action="store_true", help="no shorter: it takes seconds")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures there")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "atlas.npz"
        command = [sys.executable, "-m", "simmer_tui", "atlas", str(out), "--step", "1", "--headings", "36"]
        took = []
        for _ in range(TIMES):
            started = time.perf_counter()
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            took.append(time.perf_counter() - started)
        figures = {"atlas_s": min(took), "atlas_npz_mb": out.stat().st_size / 1e6}
    print(f"best of {TIMES}: {figures['atlas_s']:.2f} s, {figures['atlas_npz_mb']:.2f} MB")
    if options.json is not None:
        options.json.write_text(json.dumps(figures) + "\n", encoding="utf-8")
    return int(figures["atlas_s"] > SECONDS_GOAL or figures["atlas_npz_mb"] > MEGABYTES_GOAL)


if __name__ == "__main__":
    sys.exit(main())
