"""A run without a screen: short lines on standard error, and perhaps a program to run beside it."""

from __future__ import annotations

import queue
import signal
import sys
from types import FrameType
from typing import TextIO

from simmer_tui.engine import Event, Notice, NoticeKind
from simmer_tui.mission import Result
from simmer_tui.program import NOT_FOUND, Program, ProgramError
from simmer_tui.server import Server
from simmer_tui.sim.records import Outcome, Status

READY = "Simulator initialized... waiting for connection from client"
_BACKLOG = 1000
_LAST_WORDS = 1.0
"""How long a program may go on when its mission is over, seconds."""
_MISSION_ENDS = (Result.SUCCESS, Result.FAILED)
_REFUSALS = (Status.REFUSED, Status.UNKNOWN)


class Console:
    """Prints from the main thread what happens in the robot's thread, so that a stopped terminal
    never holds up the robot. What does not fit is counted."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._lines: queue.SimpleQueue[str | int] = queue.SimpleQueue()
        self._missed = 0
        self._told_busy = False

    def watch(self, event: Event) -> None:
        """Take note of an event, in the robot's thread."""
        if self._quiet or self._is_more_of_the_same(event):
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

    def _is_more_of_the_same(self, event: Event) -> bool:
        """Programs ask over and over whether a movement has ended: one line a movement will do."""
        if isinstance(event, Outcome) and event.status is Status.BUSY:
            told, self._told_busy = self._told_busy, True
            return told
        if isinstance(event, Outcome) and event.trajectory is not None:
            self._told_busy = False
        return False

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
        if event.status in _REFUSALS:
            return f"{event.command.source}: bad command '{event.command.shown}': {event.reason}"
        if event.status is Status.BUSY:
            return f"{event.command.source}: '{event.command.shown}' not begun: {event.reason}"
        if event.status is Status.UNANSWERED:
            return f"{event.command.source}: no answer to '{event.command.shown}': {event.reason}"
        contact = event.contact
        if contact is not None:
            pose = contact.pose
            return (
                f"contact: {event.command.shown} was stopped at ({pose.x:.2f}, {pose.y:.2f}) heading "
                f"{pose.heading:.1f} by the wall at ({contact.point[0]:.2f}, {contact.point[1]:.2f})"
            )
    return ""


def run_headless(server: Server, *, quiet: bool, once: bool, command: str | None) -> int:
    """Serve until a signal, until `command` has ended, or (`once`, without a command) until the
    client has left. Returns the exit code: that of `command` where there is one.

    A mission that is over ends it too, whatever else goes on, and makes the exit code: 0 for
    success, 1 otherwise. So does one that nobody can finish any more.
    """
    console = Console(quiet)
    program: Program | None = None
    interruptions: list[int] = []

    def interrupted(number: int, frame: FrameType | None) -> None:
        interruptions.append(number)
        code = 128 + number if command is not None else 0
        server.insist(code)  # a terminal that takes nothing any more holds up this thread
        console.finish(code)

    def watch(event: Event) -> None:
        console.watch(event)
        if isinstance(event, Notice) and event.kind is NoticeKind.MISSION and event.subject in _MISSION_ENDS:
            console.finish(0)

    for number in end_signals():
        signal.signal(number, interrupted)
    ends_with_client = once and command is None  # a program may have more to do, and its own exit code
    server.start(watch, (lambda: console.finish(0)) if ends_with_client else (lambda: None))
    grace = 0.0
    try:
        if command is not None:  # before anything is said: if it fails, that is the one line
            program = Program(command, server.environment, console.finish)
        announce(server, sys.stderr if command is not None else sys.stdout)
        code = console.wait()
        if server.referee is None or interruptions:
            return code
        if server.referee.result is Result.UNDER_WAY:
            who = "the client has left" if command is None else f"the program has ended with exit code {code}"
            server.call(server.referee.end, who)
            console.wait()
        grace = _LAST_WORDS
        return 0 if server.referee.result is Result.SUCCESS else 1
    except ProgramError as error:
        say(f"simmer-tui: {error}")
        return NOT_FOUND
    finally:
        if program is not None:
            program.end(grace)
        server.stop()


def announce(server: Server, stream: TextIO) -> None:
    """The lines at the start: ports, configuration, seed, and that clients may come."""
    for warning in warnings_of(server):
        say(f"warning: {warning}")
    ports = ", ".join(f"{purpose} on port {number}" for purpose, number in server.ports.items())
    say(f"seed {server.seed}, configuration {server.configuration.name}, {ports}", stream)
    say(READY, stream)


def warnings_of(server: Server) -> list[str]:
    """What a person should know of a server that runs all the same."""
    if not server.open_to_others or server.demands_token:
        return server.warnings
    exposed = (
        f"anyone who reaches {server.host} can drive the robot: demand a word with --token, or take "
        "127.0.0.1, this machine only"
    )
    return [exposed, *server.warnings]


def end_signals() -> list[int]:
    """The signals that ask a run to end, without those that are ignored."""
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
    known = [int(getattr(signal, name)) for name in names if hasattr(signal, name)]
    return [number for number in known if signal.getsignal(number) is not signal.SIG_IGN]  # nohup
