"""A run without a screen: short lines on standard error, and perhaps a program to run beside it."""

from __future__ import annotations

import queue
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from simmer_tui.cli.run_life import say
from simmer_tui.events import Event, EventHandler, MissionEvent, MovementEnded, MovementPlanned, Notice
from simmer_tui.phrases import contact_ending
from simmer_tui.server import Server
from simmer_tui.sim.records import CommandResult, Status

if TYPE_CHECKING:
    from simmer_tui.report.verdict import Verdict

READY = "Simulator initialized... waiting for connection from client"
_BACKLOG = 1000
"""Lines kept for a terminal that takes none, some 100 KB."""
# Only these are the sender's mistakes; busy and unanswered are told in other words.
_REFUSALS = (Status.REFUSED, Status.UNKNOWN)


class LinePrinter:
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
        # Counted, not kept: the robot must not wait, nor memory grow.
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
        # As many as there are now: a client may go on sending for ever.
        for _ in range(self._lines.qsize()):
            item = self._lines.get_nowait()
            if isinstance(item, str):
                say(item)


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


class Headless:
    """The front end without a screen: it ends with its mission, which makes the exit code."""

    judges = True
    program_output = None

    def __init__(self, server: Server, *, quiet: bool, has_program: bool) -> None:
        self._server = server
        self._quiet = quiet
        # What a program prints on standard output is its own, for others to read.
        self._stream = sys.stderr if has_program else sys.stdout
        printer = LinePrinter(quiet)
        self.watch, self.show, self.show_rest = printer.watch, printer.wait, printer.print_rest
        self.finish = self.program_ended = printer.finish

    def logging(self, path: Path) -> None:
        if not self._quiet:
            say(f"logging to {path}")

    def prepare(self, prefix: Callable[[], None] | None) -> None:
        if prefix is not None:
            prefix()

    def started(self) -> None:
        """Say the ports, configuration and seed, and that clients may come."""
        server = self._server
        for warning in server.warnings:
            say(f"warning: {warning}")
        if server.prefix is not None:
            say(f"taken over {server.prefix.origin}: what comes now is new", self._stream)
        ports = ", ".join(f"{purpose} on port {number}" for purpose, number in server.ports.items())
        say(f"seed {server.seed}, configuration {server.configuration.name}, {ports}", self._stream)
        say(READY, self._stream)

    @property
    def wants_verdict(self) -> bool:
        return not self._quiet

    def judged(self, verdict: Verdict) -> None:
        """Say how the run ended: the evidence, and the verdict's sentence as the last line."""
        said, *evidence = verdict.lines
        for line in (*(f"  {each}" for each in evidence), f"verdict: {said}"):
            say(line)

    def ended(self, program_code: int | None) -> None:
        """Nothing is left to be said."""
