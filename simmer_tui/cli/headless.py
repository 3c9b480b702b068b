"""A run without a screen: short lines on standard error, and perhaps a program to run beside it."""

from __future__ import annotations

import queue
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from simmer_tui import platform_has
from simmer_tui.cli.command_line import say
from simmer_tui.cli.run_life import FrontEnd
from simmer_tui.live.server import Server
from simmer_tui.run.events import (
    BOARDS_ENDED,
    Event,
    EventHandler,
    LegEnded,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    VelocityEnd,
    VelocityEnded,
    WireMessage,
)
from simmer_tui.run.message_trail import MessageTrail
from simmer_tui.run.phrases import contact_ending
from simmer_tui.sim.command import counted
from simmer_tui.sim.records import REFUSALS, CommandResult, Status

if TYPE_CHECKING:
    from simmer_tui.report.verdict import Verdict

READY = "Simulator initialized... waiting for connection from client"
_BACKLOG = 1000
"""Lines kept for a terminal that does not read; some 100 KB."""
# Only these are the sender's mistakes; busy and unanswered commands have other messages.
_REFUSALS = (Status.REFUSED, Status.UNKNOWN)


class LinePrinter:
    """Prints events of the robot's thread in the main thread, so that a stopped terminal never delays the
    robot. Lines beyond its limit are counted. The methods are those of a `FrontEnd`."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._lines: queue.SimpleQueue[str | int] = queue.SimpleQueue()
        self._missed = 0
        self._lines_of = EventLines()

    def watch(self, event: Event) -> None:
        """Take an event, in the robot's thread."""
        line = "" if self._quiet else self._lines_of.handle(event)
        if not line:
            return
        # Counted, not kept: the robot must not wait, and the memory must not grow.
        if self._lines.qsize() >= _BACKLOG:
            self._missed += 1
            return
        if self._missed:
            self._lines.put(f"... {counted(self._missed, 'line')} not shown")
            self._missed = 0
        self._lines.put(line)

    def finish(self, code: int) -> None:
        """End `show` with an exit code. Safe in signal handlers and from any thread."""
        self._lines.put(code)

    def show(self) -> int:
        """Print lines until `finish`; returns its code."""
        while True:
            try:  # Windows does not interrupt a wait without a time limit
                item = self._lines.get(timeout=None if platform_has.POSIX else 1.0)
            except queue.Empty:
                continue
            if isinstance(item, int):
                return item
            say(item)

    def show_rest(self) -> None:
        """Print the lines so far, and no later ones. An earlier `finish` is cancelled."""
        # As many as there are now: a client may continue to send.
        for _ in range(self._lines.qsize()):
            item = self._lines.get_nowait()
            if isinstance(item, str):
                say(item)


class EventLines(EventHandler[str]):
    """Short lines for events; empty for those that have none."""

    def __init__(self) -> None:
        self._told_busy = False
        self._trail = MessageTrail()

    def other(self, event: Event) -> str:
        return ""

    def on_wire(self, event: WireMessage) -> str:
        self._trail.add_message(event)
        return ""

    def on_notice(self, event: Notice) -> str:
        # The verdict is the last line of a run; a page shows it as soon as its client has left.
        return "" if event.kind is NoticeKind.VERDICT else event.text

    def on_mission(self, event: MissionEvent) -> str:
        return event.text

    def on_planned(self, event: MovementPlanned) -> str:
        self._told_busy = False
        self._trail.begun(event.number, event.time)
        return ""

    def on_ended(self, event: MovementEnded) -> str:
        if event.contact is None:
            return ""
        shown = self._trail.shown(event.number, event.command)
        return f"contact: {shown} {contact_ending(event.contact, event.pose)}"

    def on_leg_ended(self, event: LegEnded) -> str:
        return self.on_ended(event.as_movement())

    def on_velocity_ended(self, event: VelocityEnded) -> str:
        # The program's own request, or a person's action, needs no line.
        is_shown = event.reason in (VelocityEnd.TIMEOUT, VelocityEnd.LEFT)
        return f"velocity ended: {event.reason.value}" if is_shown else ""

    def on_result(self, event: CommandResult) -> str:
        self._trail.begun(event.number, event.time)
        if event.status not in REFUSALS:
            return ""
        source, shown = event.command.source, event.command.shown
        if event.status in _REFUSALS:
            return f"{source}: refused '{shown}': {event.reason}"
        if event.status is Status.UNANSWERED:
            return f"{source}: no answer to '{shown}': {event.reason}"
        if self._told_busy:
            return ""
        self._told_busy = True  # programs repeat the command: one line a movement is enough
        return f"{source}: '{shown}' not begun: {event.reason}"


class Headless(LinePrinter, FrontEnd):
    """The front end without a screen: it ends with its mission, which sets the exit code."""

    judges = True

    def __init__(self, server: Server, *, quiet: bool, has_program: bool) -> None:
        super().__init__(quiet)
        self._server = server
        self.wants_verdict = self.watches = not quiet
        # A program's standard output is for others to read.
        self._stream = sys.stderr if has_program else sys.stdout

    def logging(self, path: Path) -> None:
        if not self._quiet:
            say(f"logging to {path}")

    def prepare(self, prefix: Callable[[], None] | None) -> None:
        if prefix is not None:
            prefix()

    def started(self) -> None:
        """Print the ports, configuration and seed: clients may connect."""
        server = self._server
        for warning in server.warnings:
            say(f"warning: {warning}")
        if server.prefix is not None:
            say(str(server.prefix), self._stream)
        ports = ", ".join(f"{purpose} on port {number}" for purpose, number in server.ports.items())
        name = server.configuration.name
        say(f"seed {server.seed}, configuration {name}, {ports}", self._stream)
        say(READY, self._stream)

    def show_links(self, links: tuple[str, ...]) -> None:
        for link in links:
            say(link, self._stream)

    def program_ended(self, code: int, *, stopped: bool) -> None:
        self.finish(code)

    def ended(self) -> None:
        """Tell why boards have ended the run, if no line about events has."""
        boards = self._server.boards
        if self._quiet and boards is not None and boards.failed:
            say(f"{BOARDS_ENDED}{boards.failed}")

    def judged(self, verdict: Verdict) -> None:
        """Print the end of the run: the evidence, and the verdict's sentence as the last line."""
        said, *evidence = verdict.lines
        for line in (*(f"  {each}" for each in evidence), f"verdict: {said}"):
            say(line)
