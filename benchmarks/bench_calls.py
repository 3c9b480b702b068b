"""Python calls of one command, in the robot's thread: a count is the same on any machine.

    python benchmarks/bench_calls.py [--quick] [--json FILE] [--instructions]

One program is connected to the binary port of the default set, with instant motion; the run is `simmer-tui
--no-ui` with `--quiet`, with no further option, with `--log` and with `--mission`. Counted are the `call`
events of `sys.setprofile` from the moment that the robot's thread has something to read until it waits again,
the event loop's own included: the least of 20 commands after 100 of warm-up. Beside them are the distinct
functions of the package that one command with `--quiet` passes, and their files.

Another row has what the app adds to a run with `--quiet`: the saved run, the verdict and the events for
snapshots. They get events together, so it is the mean of as many commands, calls of the package alone.

`--instructions` adds machine instructions of a command (`valgrind --tool=cachegrind`), which takes minutes.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import queue
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NamedTuple
from unittest import mock

import simmer_tui
from simmer_tui.cli.main import main as simmer
from simmer_tui.config.dialects import COMMANDS, REPLIES
from simmer_tui.live.late_events import TOGETHER
from simmer_tui.live.server import Server

RUN = ("--no-ui", "--once", "--port", "0", "--seed", "1")
VARIANTS = {"--quiet": ("--quiet",), "plain": (), "--log": ("--log",), "--mission": ("--mission",)}
"""Options of a run, by the name of the figure."""
APP = "app"
"""The run of the app, without its screen."""
GOALS = {
    ("u1", "--quiet"): 60,
    ("u1", "plain"): 75,
    ("u1", "--log"): 85,
    ("u1", "--mission"): 105,
}
"""Most calls of a command."""
HOP_GOALS = {"u1": (45, 11), "d1-3": (110, 22)}
"""Most functions of a command, and most files."""
REACHED = {
    ("u1", "--quiet"): 31,
    ("u1", "plain"): 48,
    ("u1", "--log"): 60,
    ("u1", "--mission"): 75,
    ("d1-1", "--quiet"): 162,
    ("u1", APP): 55.6,
    ("d1-1", APP): 319,
}
"""Calls of the package alone, without the event loop's and numpy's, which differ between versions of Python.
tests/robot/test_calls.py allows 5 % more."""
WARM_UP, COUNTED = 100, 20
_PACKAGE = str(Path(simmer_tui.__file__).parent)
_LONGEST = 60.0
"""Seconds for a reply, on a machine that does other work."""


class Trip(NamedTuple):
    """One command: its calls, and the functions of the package among them."""

    calls: int
    passed: tuple[CodeType, ...]

    @property
    def functions(self) -> set[CodeType]:
        """The distinct functions."""
        return {each for each in self.passed if each.co_name not in ("<lambda>", "<genexpr>", "<listcomp>")}

    @property
    def files(self) -> set[str]:
        """The files that the functions are in."""
        return {each.co_filename for each in self.functions}


class Profile:
    """Counts calls of the robot's thread, from one wait of its event loop to the next."""

    def __init__(self) -> None:
        self.trips: queue.SimpleQueue[Trip] = queue.SimpleQueue()
        """Those in which something was sent."""
        self._calls: list[CodeType] = []
        self._sent = False

    def note(self, frame: FrameType, event: str, argument: object) -> None:
        """Take an event of `sys.setprofile`."""
        if event == "c_call":
            self._sent = self._sent or getattr(argument, "__name__", "") == "send"
        elif event == "call":
            code = frame.f_code
            self._calls.append(code)
            if code.co_name == "select" and frame.f_locals.get("timeout", 0) != 0:
                self._wait()

    def _wait(self) -> None:
        """The loop waits from now on."""
        if self._sent:
            here = tuple(each for each in self._calls if each.co_filename.startswith(_PACKAGE))
            self.trips.put(Trip(len(self._calls), here))
        self._calls.clear()
        self._sent = False


@contextlib.contextmanager
def connected(*ports: int) -> Iterator[tuple[socket.socket, socket.socket]]:
    """A program's two connections."""
    with contextlib.ExitStack() as stack:
        sending, reading = [
            stack.enter_context(socket.create_connection(("127.0.0.1", port), _LONGEST)) for port in ports
        ]
        yield sending, reading


def exchange(server: Server, profile: Profile, commands: Sequence[str]) -> list[Trip]:
    """Send commands, each once the loop waits after the reply to the one before it."""
    trips = []
    with connected(*(server.ports[each.purpose] for each in (COMMANDS, REPLIES))) as (sending, reading):
        for command in commands:
            sending.sendall(command.encode() + b"\n")
            reading.recv(8, socket.MSG_WAITALL)
            trips.append(profile.trips.get(timeout=_LONGEST))
    return trips


def trips_of(options: Sequence[str], commands: Sequence[str]) -> list[Trip]:
    """The trip of each command of a run with these options; the run is done in this process."""
    profile, begin = Profile(), Server.start
    trips: list[Trip] = []
    program = threading.Thread(target=lambda: trips.extend(exchange(programmed[0], profile, commands)))
    programmed: list[Server] = []

    def start(server: Server, *arguments: Any, **named: Any) -> None:
        if APP in options:
            server.save_run()
            server.keep_verdict(has_program=False)
            server.record()
        begin(server, *arguments, **named)
        server.call(sys.setprofile, profile.note)
        programmed.append(server)
        program.start()

    with tempfile.TemporaryDirectory() as folder:
        named = [f"--log={Path(folder) / 'run.jsonl'}" if each == "--log" else each for each in options]
        named = ["--quiet" if each == APP else each for each in named]
        with (
            mock.patch.object(Server, "start", start),
            mock.patch.dict(os.environ, {"XDG_DATA_HOME": folder}),
            open(os.devnull, "w") as nothing,  # noqa: PTH123
            contextlib.redirect_stdout(nothing),
            contextlib.redirect_stderr(nothing),
        ):
            simmer([*RUN, *named])
        # The run ends when the program has closed its connections.
        program.join()
    return trips


def least(options: Sequence[str], command: str, warm_up: int = WARM_UP, count: int = COUNTED) -> Trip:
    """The trip of fewest calls after the warm-up: others have timers, or a look at the file as well. After
    each drive the robot drives back."""
    back = [command.replace("-", "--", 1)] if command.startswith("d") else []
    trips = trips_of(options, [command, *back] * (warm_up + count))[:: 1 + len(back)]
    return min(trips[warm_up:], key=lambda each: each.calls)


def reached(command: str, variant: str) -> float:
    """Calls of the package for one command: those of `REACHED`."""
    if variant != APP:
        return len(least(VARIANTS[variant], command, 10, 10).passed)
    back = [command.replace("-", "--", 1)] if command.startswith("d") else []
    trips = trips_of((APP,), [command, *back] * (4 * TOGETHER // (1 + len(back))))
    # The first has the start of the run, and one of the others may have a timer as well.
    rounds = [trips[begin : begin + TOGETHER] for begin in range(TOGETHER, len(trips), TOGETHER)]
    return min(sum(len(each.passed) for each in trips) for trips in rounds) / TOGETHER


def instructions(options: Sequence[str], command: str) -> float:
    """Machine instructions of one command, of the whole process: the difference of two runs."""
    counts = (500, 1500)
    totals = []
    for count in counts:
        words = ["valgrind", "--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null"]
        words += [sys.executable, "-m", "simmer_tui", *RUN, *options]
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
            assert run.stdout is not None, "it was asked for"
            assert run.stderr is not None, "it was asked for"
            ports = re.search(r"commands on port (\d+), replies on port (\d+)", run.stdout.readline())
            assert ports is not None, "a run begins with its ports"
            with connected(int(ports[1]), int(ports[2])) as (sending, reading):
                for _ in range(count):
                    sending.sendall(command.encode() + b"\n")
                    reading.recv(8, socket.MSG_WAITALL)
            total = re.search(r"I +refs: +([\d,]+)", run.stderr.read())
        assert total is not None, "cachegrind ends with its counts"
        totals.append(int(total[1].replace(",", "")))
    return (totals[1] - totals[0]) / (counts[1] - counts[0])


def main() -> int:
    """Returns 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description="Python calls of one command.")
    parser.add_argument("--quick", action="store_true", help="no difference: it takes seconds")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file")
    parser.add_argument("--instructions", action="store_true", help="machine instructions too (valgrind)")
    parser.add_argument("--list", metavar="COMMAND", help="list what a command passes, in order")
    options, more = parser.parse_known_args()
    if options.list:
        for code in least(more, options.list).passed:
            print(f"{Path(code.co_filename).relative_to(_PACKAGE)}: {code.co_qualname}")
        return 0
    figures: dict[str, float] = {}
    missed = False
    for command in ("u1", "d1-1", "d1-3"):
        for name, words in VARIANTS.items():
            trip = least(words, command)
            figures[f"{command} {name}, calls"] = trip.calls
            goal = GOALS.get((command, name))
            missed = missed or (goal is not None and trip.calls > goal)
            print(f"{command:5} {name:10} {trip.calls:4} calls" + (f", goal {goal}" if goal else ""))
            if name == "--quiet" and command in HOP_GOALS:
                hops, most = (len(trip.functions), len(trip.files)), HOP_GOALS[command]
                figures |= {f"{command}, functions": hops[0], f"{command}, files": hops[1]}
                missed = missed or hops[0] > most[0] or hops[1] > most[1]
                print(f"{command:5} {hops[0]} functions in {hops[1]} files, goal {most[0]} in {most[1]}")
    for command in ("u1", "d1-1"):
        figures[f"{command} {APP}, calls"] = calls = reached(command, APP)
        quiet = REACHED[command, "--quiet"]
        print(f"{command:5} {APP:10} {calls:5.1f} calls of the package, {quiet} with --quiet")
    if options.instructions and shutil.which("valgrind"):
        for name, words in (("--quiet", ("--quiet",)), ("plain", ())):
            figures[f"u1 {name}, instructions"] = count = instructions(words, "u1")
            print(f"u1    {name:10} {count:8.0f} instructions")
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=2) + "\n", "utf-8")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
