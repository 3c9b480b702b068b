"""A run without a screen: short lines on standard error, and perhaps a program to run beside it."""

from __future__ import annotations

import queue
import signal
import sys
from types import FrameType
from typing import TextIO

from simmer_tui.engine import Event, Notice
from simmer_tui.program import NOT_FOUND, Program, ProgramError
from simmer_tui.sim.records import Outcome, Verdict
from simmer_tui.station import Station

READY = "Simulator initialized... waiting for connection from client"
_BACKLOG = 1000
_REFUSALS = (Verdict.REFUSED, Verdict.UNKNOWN, Verdict.BUSY)


class Console:
    """Prints from the main thread what happens in the robot's thread, so that a stopped terminal
    never holds up the robot. What does not fit is counted."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._lines: queue.SimpleQueue[str | int] = queue.SimpleQueue()
        self._missed = 0

    def watch(self, event: Event) -> None:
        """Take note of an event, in the robot's thread."""
        if self._quiet:
            return
        line = describe(event)
        if not line:
            return
        if self._lines.qsize() >= _BACKLOG:
            self._missed += 1
            return
        if self._missed:
            line = f"... {self._missed} lines not shown\n{line}"
            self._missed = 0
        self._lines.put(line)

    def finish(self, code: int) -> None:
        """End `wait` with an exit code. Safe in signal handlers and from any thread."""
        self._lines.put(code)

    def wait(self) -> int:
        """Print lines until `finish`; returns its code."""
        while True:
            try:  # Windows does not interrupt a wait without an end
                item = self._lines.get(timeout=1.0 if sys.platform == "win32" else None)
            except queue.Empty:
                continue
            if isinstance(item, int):
                return item
            say(item)


def say(line: str, stream: TextIO | None = None) -> None:
    """Print a line at once, on standard error unless told otherwise; a closed stream is no fault."""
    try:
        print(line, file=stream or sys.stderr, flush=True)
    except (OSError, ValueError):
        return


def describe(event: Event) -> str:
    """The short line for an event, or an empty string."""
    if isinstance(event, Notice):
        return event.text
    if isinstance(event, Outcome):
        if event.verdict in _REFUSALS:
            return f"{event.command.source}: bad command {event.command.shown!r}: {event.reason}"
        if event.verdict is Verdict.UNANSWERED:
            return f"{event.command.source}: no answer to {event.command.shown!r}: {event.reason}"
        contact = event.contact
        if contact is not None:
            pose = contact.pose
            return (
                f"contact: {event.command.shown} was stopped at ({pose.x:.2f}, {pose.y:.2f}) heading "
                f"{pose.heading:.1f} by the wall at ({contact.point[0]:.2f}, {contact.point[1]:.2f})"
            )
    return ""


def run_headless(station: Station, *, quiet: bool, once: bool, command: str | None) -> int:
    """Serve until a signal, until the client has left (`once`), or until `command` has ended.

    Returns the exit code: that of `command` where there is one.
    """
    console = Console(quiet)
    program: Program | None = None

    def interrupted(number: int, frame: FrameType | None) -> None:
        console.finish(128 + number if command is not None else 0)

    for number in _end_signals():
        signal.signal(number, interrupted)
    station.start(console.watch, (lambda: console.finish(0)) if once else (lambda: None))
    try:
        announce(station, sys.stderr if command is not None else sys.stdout)
        if command is not None:
            program = Program(command, station.environment, console.finish)
        return console.wait()
    except ProgramError as error:
        say(f"simmer-tui: {error}")
        return NOT_FOUND
    finally:
        if program is not None:
            program.end()
        station.stop()


def announce(station: Station, stream: TextIO) -> None:
    """The lines at the start: ports, configuration, seed, and that clients may come."""
    if station.open_to_others:
        say(f"warning: anyone who reaches {station.host} can drive the robot; 127.0.0.1 is this machine only")
    for warning in station.warnings:
        say(f"warning: {warning}")
    ports = ", ".join(f"{purpose} on port {number}" for purpose, number in station.ports.items())
    say(f"seed {station.seed}, configuration {station.configuration.name}, {ports}", stream)
    say(READY, stream)


def _end_signals() -> list[int]:
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
    known = [int(getattr(signal, name)) for name in names if hasattr(signal, name)]
    return [number for number in known if signal.getsignal(number) is not signal.SIG_IGN]  # nohup
