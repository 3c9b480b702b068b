"""The line of a Python program at which the simulator ended it."""

from __future__ import annotations

import os
import queue
import shlex
import sys
from pathlib import Path

import pytest

from simmer_tui.program import Program, ProgramOutput

SECONDS = 120.0
pytestmark = pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="memory files are of Linux")

# What is printed arrives before the program goes on: it waits in the same line.
LOCK = """\
import threading
lock = threading.Lock()
def wait_for_block():
    lock.acquire()
    print("there", flush=True), lock.acquire()
wait_for_block()
"""
LOOP = """\
def route():
    print("there", flush=True)
    while True:
        sum(range(9))
route()
"""
THREADS = """\
import threading, time
def other():
    threading.Event().wait()
threading.Thread(target=other, daemon=True).start()
def main():
    print("there", flush=True), threading.Event().wait()
main()
"""
HANDLES = """\
import signal, sys, time
signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
print("there", flush=True)
while True:
    time.sleep(0.01)
"""
CHILD = """\
import os, subprocess, sys
print(sorted(name for name in os.environ if "STACK" in name), flush=True)
"""


def stopped(tmp_path: Path, text: str, **environment: str) -> tuple[str, str]:
    """The first line of a program, and the line of its code at which it was ended."""
    script = tmp_path / "robot.py"
    script.write_text(text, "utf-8")
    output = ProgramOutput()
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    codes: queue.SimpleQueue[int] = queue.SimpleQueue()
    command = shlex.join([sys.executable, str(script)])
    program = Program(command, environment, codes.put, lines.put, output=output)
    said = lines.get(timeout=SECONDS)
    program.end()
    return said, output.end(codes.get(timeout=SECONDS), stopped=True).place


@pytest.mark.parametrize(
    ("text", "place"),
    [
        (LOCK, ("robot.py:5",)),
        (LOOP, ("robot.py:2", "robot.py:3", "robot.py:4")),
        (THREADS, ("robot.py:6",)),
        (HANDLES, ("",)),
    ],
)
def test_a_program_that_is_ended_tells_its_line(tmp_path: Path, text: str, place: tuple[str, ...]) -> None:
    said, found = stopped(tmp_path, text)
    assert said == "there"
    assert found in place


def test_a_program_keeps_nothing_of_it_for_its_children(tmp_path: Path) -> None:
    assert stopped(tmp_path, CHILD)[0] == "[]"


def test_a_program_that_ends_by_itself_has_the_line_of_its_crash_alone(tmp_path: Path) -> None:
    output = ProgramOutput()
    codes: queue.SimpleQueue[int] = queue.SimpleQueue()
    program = Program(
        shlex.join([sys.executable, "-c", "pass"]), {}, codes.put, lambda line: None, output=output
    )
    ended = output.end(codes.get(timeout=SECONDS))
    program.end()
    assert (ended.place, ended.stopped) == ("", False)
