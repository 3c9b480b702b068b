"""Every benchmark, one after the other.

    python benchmarks/run_all.py [--quick] [--json FOLDER]

Each can be run by itself too. They measure their baselines in the same run, so that their ratios are
meaningful on any machine that is not busy.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent


def main() -> int:
    """Returns 1 if one of them failed or missed a goal that it insists on."""
    parser = argparse.ArgumentParser(description="Run every benchmark.")
    parser.add_argument("--quick", action="store_true", help="shorter runs")
    parser.add_argument(
        "--json", metavar="FOLDER", type=Path, help="write the figures of each to a file there"
    )
    options = parser.parse_args()
    if options.json is not None:
        options.json.mkdir(parents=True, exist_ok=True)
    failed = []
    for path in sorted(HERE.glob("bench_*.py")):
        print(f"== {path.stem.removeprefix('bench_')}", flush=True)
        command = [sys.executable, str(path)]
        command += ["--quick"] if options.quick else []
        command += ["--json", str(options.json / f"{path.stem}.json")] if options.json is not None else []
        if subprocess.run(command, check=False).returncode:
            failed.append(path.name)
    if failed:
        print(f"failed: {', '.join(failed)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
