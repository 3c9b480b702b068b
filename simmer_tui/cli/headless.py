"""A run without a screen: short lines on standard error, and perhaps a program to run beside it."""

from __future__ import annotations

import queue
import sys
from typing import TYPE_CHECKING, TextIO

from simmer_tui.cli.exit_codes import ExitCode
from simmer_tui.cli.shutdown import Shutdown
from simmer_tui.events import (
    Event,
    EventHandler,
    MissionEnd,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    Result,
)
from simmer_tui.phrases import contact_ending
from simmer_tui.program import Program
from simmer_tui.server import Server
from simmer_tui.sim.records import CommandResult, Status

if TYPE_CHECKING:
    from simmer_tui.run.run_history import RunHistory

READY = "Simulator initialized... waiting for connection from client"
NOTHING_SENT = "nothing was sent"
"""Why a mission fails in which no command came."""
_BACKLOG = 1000
_LAST_WORDS = 1.0
"""How long a program may go on when its mission is over, seconds."""
_REFUSALS = (Status.REFUSED, Status.UNKNOWN)


class Console:
    """Prints from the main thread what happens in the robot's thread, so that a stopped terminal
    never holds up the robot. What does not fit is counted."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._lines: queue.SimpleQueue[str | int] = queue.SimpleQueue()
        self._missed = 0
        self._lines_of = EventLines()

    def watch(self, event: Event) -> None:
        """Take note of an event, in the robot's thread."""
        line = "" if self._quiet else self._lines_of.handle(event)
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

    def print_rest(self) -> None:
        """Print what has been told by now, and no more, whatever comes meanwhile; forget that it was to
        `finish`."""
        for _ in range(self._lines.qsize()):
            item = self._lines.get_nowait()
            if isinstance(item, str):
                say(item)


def say(line: str, stream: TextIO | None = None) -> None:
    """Print a line at once, on standard error unless told otherwise; a closed stream is no fault."""
    try:
        print(line, file=stream or sys.stderr, flush=True)
    except (OSError, ValueError):
        return


class EventLines(EventHandler[str]):
    """Short lines for events; empty for those that have none."""

    def __init__(self) -> None:
        self._told_busy = False

    def other(self, event: Event) -> str:
        return ""

    def on_notice(self, event: Notice) -> str:
        return event.text

    def on_mission(self, event: MissionEvent) -> str:
        return event.text

    def on_planned(self, event: MovementPlanned) -> str:
        self._told_busy = False
        return ""

    def on_ended(self, event: MovementEnded) -> str:
        if event.contact is None:
            return ""
        return f"contact: {event.command.shown} {contact_ending(event.contact, event.pose)}"

    def on_result(self, event: CommandResult) -> str:
        source, shown = event.command.source, event.command.shown
        if event.status in _REFUSALS:
            return f"{source}: bad command '{shown}': {event.reason}"
        if event.status is Status.UNANSWERED:
            return f"{source}: no answer to '{shown}': {event.reason}"
        if event.status is Status.BUSY and not self._told_busy:
            self._told_busy = True  # programs ask over and over: one line a movement will do
            return f"{source}: '{shown}' not begun: {event.reason}"
        return ""


def run_headless(server: Server, *, quiet: bool, once: bool, command: str | None) -> int:
    """Serve until a signal, until `command` has ended, or (`once`, without a command) until the
    client has left. Returns the exit code: that of `command` where there is one.
    Raises ProgramError if that cannot be started.

    A mission that is over ends it too, whatever else goes on, and makes the exit code: 0 for
    success, 1 otherwise. So does one that nobody can finish any more, and one that a signal ends.
    """
    console = Console(quiet)
    shutdown = Shutdown(server)
    history = None if server.referee is None else server.keep_history()
    interruptions: list[int] = []
    """The exit codes of signals, as they came."""

    def interrupted(number: int) -> int:
        if command is not None:
            code = 128 + number
        else:
            missed = server.referee is not None and server.referee.result is not Result.SUCCESS
            code = ExitCode.NO if missed else ExitCode.DONE
        interruptions.append(code)
        console.finish(code)
        return code

    shutdown.on_signals(interrupted)
    ends_with_client = once and command is None  # a program may have more to do, and its own exit code
    mission_end = MissionEnd(lambda: console.finish(0))

    def watch(event: Event) -> None:
        console.watch(event)
        mission_end.handle(event)

    server.start(watch, (lambda: console.finish(0)) if ends_with_client else (lambda: None))
    grace = 0.0
    try:
        if command is not None:  # before anything is said: if it fails, that is the one line
            shutdown.program = Program(command, server.environment, console.finish)
        announce(server, sys.stderr if command is not None else sys.stdout)
        code = console.wait()
        if interruptions:
            return interruptions[0]
        if command is not None:
            if server.referee is None or server.referee.result is Result.UNDER_WAY:
                shutdown.end_program()  # what it left running has no say any more
                server.hear_out()
            console.print_rest()
        if server.referee is None:
            if command is not None and not code and not server.simulator.commands:
                say(f"simmer-tui: {NOTHING_SENT}")
                return ExitCode.NO
            return code
        if server.referee.result is Result.UNDER_WAY:
            who = "the client has left" if command is None else f"the program has ended with exit code {code}"
            server.call(_give_up, server, who, code)
            console.wait()
        if interruptions:
            return interruptions[0]
        grace = _LAST_WORDS
        if history is not None and not quiet:
            _say_why(server, history, code if command is not None and code else None)
        return ExitCode.DONE if server.referee.result is Result.SUCCESS else ExitCode.NO
    finally:
        shutdown.finish(0.0 if interruptions else grace)
        for fault in server.late_faults:
            say(fault)


def _say_why(server: Server, history: RunHistory, exit_code: int | None) -> None:
    """Say why a mission failed, and what speaks for it; nothing of one that succeeded."""
    # Imported here because most runs have no mission, and it takes a twentieth of the start.
    from simmer_tui.report.causes import cause_of
    from simmer_tui.run.attempt import Attempt, task_of

    assert server.referee is not None, "only missions are judged"
    task = task_of(server.configuration, server.seed, server.referee.plan)
    cause = cause_of(Attempt(history, task), exit_code)
    if cause is not None:
        say("\n  ".join((f"why: {cause.text}", *cause.evidence)))


def _give_up(server: Server, reason: str, code: int) -> None:
    """End a mission that nobody can finish any more, in the robot's thread. A program that says that
    all is well without one command has most likely not found the port."""
    assert server.referee is not None, "only missions are given up"
    server.referee.end(reason if code or server.simulator.commands else NOTHING_SENT)


def announce(server: Server, stream: TextIO) -> None:
    """The lines at the start: ports, configuration, seed, and that clients may come."""
    for warning in server.warnings:
        say(f"warning: {warning}")
    if server.prefix is not None:
        say(f"taken over {server.prefix.origin}: what comes now is new", stream)
    ports = ", ".join(f"{purpose} on port {number}" for purpose, number in server.ports.items())
    say(f"seed {server.seed}, configuration {server.configuration.name}, {ports}", stream)
    say(READY, stream)
