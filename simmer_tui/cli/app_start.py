"""The start of the terminal app: it checks the terminal, imports Textual, and runs the server beside it."""

from __future__ import annotations

import gc
import os
import shlex
import sys
import threading
from collections.abc import Callable
from pathlib import Path, PureWindowsPath

from simmer_tui import platform_has
from simmer_tui.cli.command_line import drop_output, say
from simmer_tui.cli.headless import LinePrinter
from simmer_tui.cli.run_life import FrontEnd
from simmer_tui.live.server import Server
from simmer_tui.program.program_command import SCRIPTS
from simmer_tui.run.events import Notice, NoticeKind, Result
from simmer_tui.run.phrases import exit_text
from simmer_tui.tui.terminal import TerminalChoice, choose

# Judged: a few screens; more would only scroll past.
_LINES_AHEAD = 200
"""Lines that a program may print before the robot's thread has processed them."""
# Characters. Judged: wider than any terminal; a line without end must not fill the log.
_LONGEST_LINE = 500


class Screen(FrontEnd):
    """The front end on the terminal. If the app itself fails, the robot is still served without it."""

    watches = False
    """The screen takes snapshots."""

    def __init__(self, server: Server, *, once: bool, program: str | None = None) -> None:
        """Check the terminal and make the app. With `once` it ends with the program, a command."""
        self._settings = screen = server.configuration.settings.screen
        # Before the import of Textual, which reads the variables only then.
        choice = apply_choice(screen.color, screen.glyphs)

        # Imported here because a run without a screen needs none of it.
        from simmer_tui.tui.app import SimmerApp
        from simmer_tui.tui.console import default_history_file

        self._server = server
        self._once = once
        self._has_program = program is not None
        self._program_failed = False
        """True if the program ended by itself, with an exit code."""
        name = "" if program is None else program_name(program)
        self._app = SimmerApp(server, choice, default_history_file(), program=name)
        self._printer = LinePrinter(quiet=False)
        self.program_output = _teller(server)

    def prepare(self, prefix: Callable[[], None] | None) -> None:
        server, pace = self._server, self._settings.pace
        server.save_run()
        server.keep_verdict(has_program=self._has_program)
        # The prefix has happened before: it is not shown at the pace of a live run.
        server.record(pace if prefix is None else 0.0)
        if prefix is not None:
            prefix()
            server.set_pace(pace)

    def set_example(self, run: Callable[[str], None]) -> None:
        self._app.run_program = run

    def set_restart(self, again: Callable[[], None]) -> None:
        self._app.run_again = again

    def started(self) -> None:
        for warning in self._server.warnings:
            self._server.tell(Notice(NoticeKind.FAULT, f"warning: {warning}"))

    def show_links(self, links: tuple[str, ...]) -> None:
        self._app.page_links = links
        # Without the links: events can be saved to a file.
        self._server.tell(Notice(NoticeKind.HINT, "browsers show this run: :web has the link"))

    def show(self) -> int:
        from simmer_tui.tui.textual_internals import delta_updates, run_app

        server, app = self._server, self._app
        app.after_start = _set_start_apart
        with delta_updates():
            code = run_app(app, mouse=self._settings.mouse)
        if app.fault:
            # A program that drives the robot must not lose its run with the screen.
            say(f"simmer-tui: the screen has failed: {app.fault}")
            say("the robot is served on without it; ctrl+C ends")
            server.set_pace(0.0)
            server.call(server.engine.watch, self._printer.watch)
            return self._printer.show()
        return code or 0

    def finish(self, code: int) -> None:
        self._app.end(code)
        self._printer.finish(code)

    def program_ended(self, code: int, *, stopped: bool) -> None:
        server = self._server
        self._program_failed = bool(code) and not stopped
        server.tell(Notice(NoticeKind.PROGRAM, exit_text(code)))
        # A mission whose program has crashed is over, as without a screen. Who quits, or restarts the run,
        # fails no mission.
        if self._program_failed and server.referee is not None:
            server.call(server.referee.end, exit_text(code))
        # Without `--once` the screen stays, so that the end can be seen.
        if self._once:
            self.finish(code)

    def ended(self) -> None:
        referee, boards = self._server.referee, self._server.boards
        has_failed = self._program_failed or (boards is not None and bool(boards.failed))
        if has_failed or (referee is not None and referee.result is Result.FAILED):
            say("simmer-tui report and simmer-tui replay, without a file, show what went wrong")
        _forget_dead_terminal()


def _set_start_apart() -> None:
    """Collect the garbage of the app's start, and keep collections from its other objects.

    Textual styles widgets with thirty thousand objects in circles. The collection that met them came in the
    middle of a run, and kept a client waiting for 50 ms.
    """
    gc.collect()
    gc.freeze()


def program_name(command: str) -> str:
    """Name of a program for people: its file, without folder and interpreter."""
    try:
        words = shlex.split(command, posix=platform_has.POSIX)
    except ValueError:
        words = command.split()
    words = [word.strip("'\"") for word in words]
    scripts = [word for word in words if word.endswith(SCRIPTS)]
    word = (scripts or words or [""])[0]
    return Path(word).name if platform_has.POSIX else PureWindowsPath(word).name


def apply_choice(color: str, glyphs: str) -> TerminalChoice:
    """Colours and characters for this terminal; Textual gets them in environment variables."""
    choice = choose(
        os.environ, sys.stdout.encoding, color=color, glyphs=glyphs, windows=not platform_has.POSIX
    )
    choice.apply(os.environ)
    return choice


def _teller(server: Server) -> Callable[[str], None]:
    """A function that passes a program's lines on as notices. A program that prints without end has to wait
    for the robot's thread."""
    room = threading.BoundedSemaphore(_LINES_AHEAD)

    def tell(line: str) -> None:
        server.engine.tell(Notice(NoticeKind.PROGRAM, line[:_LONGEST_LINE]))
        room.release()

    def print_line(line: str) -> None:
        room.acquire()
        server.call(tell, line)

    return print_line


def _forget_dead_terminal() -> None:
    """Keep output to a terminal that has been closed from changing our exit code."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            drop_output(stream)
