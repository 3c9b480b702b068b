"""From a folder of wheels to the first drive: an environment, installed, started, a client's movement.

    python benchmarks/bench_first_drive.py [--quick] [--json FILE]

The folder has the package's wheel and all its dependencies, and no index is used. It is done by pip in an
environment of `python -m venv`, as in the README, and by uv. The time is from before the environment is made
until the client's first movement has ended. CPU time of the processes is printed beside it: on a busy machine
only that is meaningful. Goal: 10 s.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
GOAL = 10.0
COMMANDS = "Scripts" if os.name == "nt" else "bin"
DRIVE = """
import sys
from simmer_tui.client import Robot
with Robot("127.0.0.1", int(sys.argv[1]), reply_port=int(sys.argv[2])) as robot:
    robot.drive("d1", 3)
"""
WAYS = ("pip", "uv")


def call(*command: str) -> None:
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def wheels(folder: Path) -> Path:
    """A folder with the package's wheel and all its dependencies."""
    call(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT))
    (wheel,) = folder.glob("*.whl")
    pip = (sys.executable, "-m", "pip", "download", "-qq", "--disable-pip-version-check")
    call(*pip, "-d", str(folder), str(wheel))
    return folder


def install(way: str, house: Path, place: Path) -> None:
    """Make an environment with the package in it."""
    alone = ("--no-index", "--find-links", str(house), "simmer-tui")
    python = str(place / COMMANDS / "python")
    if way == "uv":
        uv = shutil.which("uv", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
        assert uv, "uv is not installed; pip install '.[test]' brings it"
        call(uv, "venv", "-q", "--python", sys.executable, str(place))
        call(uv, "pip", "install", "-q", "--offline", "--python", python, *alone)
        return
    call(sys.executable, "-m", "venv", str(place))
    call(python, "-m", "pip", "install", "-q", "--disable-pip-version-check", *alone)


def first_drive(place: Path) -> None:
    """Start the simulator without a screen, and drive once."""
    command = [str(place / COMMANDS / "simmer-tui"), "--no-ui", "--port", "0", "--reply-port", "0"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, encoding="utf-8"
    ) as server:
        assert server.stdout is not None
        ports: Sequence[str] = ()
        for line in server.stdout:
            ports = re.findall(r"(?:commands|replies) on port (\d+)", line) or ports
            if "waiting for connection" in line:
                break
        call(str(place / COMMANDS / "python"), "-c", DRIVE, *ports)
        server.terminate()


def cpu() -> float:
    """CPU seconds of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="once each")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    options = parser.parse_args()
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name:
        house = wheels(Path(name) / "house")
        install("uv", house, Path(name) / "warm")  # the first fills the file cache
        for way in WAYS:
            seconds, used = [], []
            for number in range(1 if options.quick else 5):
                started, before = time.perf_counter(), cpu()
                place = Path(name) / f"{way}{number}"
                install(way, house, place)
                first_drive(place)
                seconds.append(time.perf_counter() - started)
                used.append(cpu() - before)
                shutil.rmtree(place)
            figures[way], figures[f"{way}_cpu"] = statistics.median(seconds), statistics.median(used)
            print(
                f"{way}: first drive after {figures[way]:.1f} s, {figures[f'{way}_cpu']:.1f} s of CPU "
                f"(goal {GOAL:.0f} s)",
                flush=True,
            )
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
