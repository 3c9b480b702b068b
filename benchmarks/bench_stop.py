"""Time until the simulator has ended after SIGTERM, beside several kinds of programs.

    python benchmarks/bench_stop.py [--quick] [--json FILE]

The goal is 2 s in every case; the program and all processes that it started have ended by then. Unix only.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

GOAL = 2.0
LONGEST = 60.0
"""Seconds for a start, or an end, even on a busy machine."""
UP = "print('up', flush=True); import signal, time; "
PROGRAMS = {
    "a program that waits": UP + "time.sleep(600)",
    "a program that ignores SIGTERM": UP + "signal.signal(15, signal.SIG_IGN); time.sleep(600)",
    "a child in a session of its own": "import subprocess; "
    "subprocess.Popen(['sleep', '600'], start_new_session=True); " + UP + "time.sleep(600)",
}


def full_pipe() -> tuple[int, int]:
    """A full pipe, to which every write blocks."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while os.write(writing, b"x" * 4096):
            pass
    os.set_blocking(writing, True)
    return reading, writing


@contextlib.contextmanager
def ended_if_late(process: subprocess.Popen[bytes], awaited: str) -> Iterator[None]:
    """Kill the simulator if it takes too long; its keeper ends the program. Raises TimeoutError then."""
    late = threading.Event()

    def end() -> None:
        late.set()
        process.kill()

    timer = threading.Timer(LONGEST, end)
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
    if late.is_set():
        raise TimeoutError(f"{awaited} did not come within {LONGEST:g} s: {process.args!r}")


def seconds_to_end(code: str, blocked: bool) -> float:
    """Seconds from the signal to the end of all processes with the program's output."""
    command = shlex.join([sys.executable, "-c", code])
    ends = full_pipe() if blocked else ()
    process = subprocess.Popen(
        [sys.executable, "-m", "simmer_tui", "--no-ui", "--port", "0", "--run", command],
        stdout=subprocess.PIPE,
        stderr=ends[1] if blocked else subprocess.DEVNULL,
    )
    assert process.stdout is not None
    with ended_if_late(process, "the program's first line"):
        process.stdout.readline()
    begun = time.perf_counter()
    with ended_if_late(process, "the end after SIGTERM"):
        process.send_signal(signal.SIGTERM)
        process.stdout.read()
        process.wait()
    taken = time.perf_counter() - begun
    process.stdout.close()
    for end in ends:
        os.close(end)
    return taken


def main() -> int:
    """Returns 1 if it took longer than the goal."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="once each")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    options = parser.parse_args()
    figures = {}
    for name, code in PROGRAMS.items():
        for blocked in (False, True):
            times = [seconds_to_end(code, blocked) for _ in range(1 if options.quick else 5)]
            name_of_case = f"{name}{', standard error blocked' if blocked else ''}"
            figures[name_of_case] = max(times)
            print(f"{name_of_case}: at most {max(times):.2f} s (goal {GOAL})")
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")
    return 0 if max(figures.values()) <= GOAL else 1


if __name__ == "__main__":
    sys.exit(main())
