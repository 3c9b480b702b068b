"""Starting the terminal app: the terminal looked at, Textual imported, the server run beside it."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable

from simmer_tui.cli.headless import Console, say
from simmer_tui.cli.shutdown import Shutdown
from simmer_tui.events import Notice, NoticeKind, Result
from simmer_tui.program import Program
from simmer_tui.server import Server
from simmer_tui.tui.terminal import choose

_LINES_AHEAD = 200
"""Lines a program may print before the robot's thread has taken them."""
_LONGEST_LINE = 500


def run_app(
    server: Server,
    *,
    once: bool = False,
    command: str | None = None,
    prefix: Callable[[], None] | None = None,
) -> int:
    """Serve and draw until the user quits; returns the exit code.

    With `once` it ends when the client has left, or the program. `command` is a program to run
    beside it; what it prints goes to the log panel, and its exit code becomes ours. If the app
    itself fails, the robot is served on without it. A `prefix` is told before all starts. Raises
    ProgramError.
    """
    screen = server.configuration.settings.screen
    windows = sys.platform == "win32"
    choice = choose(
        os.environ, sys.stdout.encoding, color=screen.color, glyphs=screen.glyphs, windows=windows
    )
    choice.apply(os.environ)
    from simmer_tui.sim.command import printable
    from simmer_tui.tui.app import SimmerApp
    from simmer_tui.tui.console import default_history_file
    from simmer_tui.tui.event_text import POINTER
    from simmer_tui.tui.textual_internals import cropped_dirty_spans

    app = SimmerApp(server, choice, default_history_file())
    console = Console(quiet=False)  # goes on where the app has failed
    shutdown = Shutdown(server)
    interruptions: list[int] = []
    ended: list[int] = []
    ends_with_client = once and command is None

    def finish(code: int) -> None:
        app.end(code)
        console.finish(code)

    def program_ended(code: int) -> None:
        ended.append(code)
        pointer = f"; {POINTER}" if code else ""
        server.tell(Notice(NoticeKind.PROGRAM, f"the program has ended with exit code {code}{pointer}"))
        if once:
            finish(code)

    def interrupted(number: int) -> int:
        code = 128 + number if command is not None else 0
        interruptions.append(code)
        finish(code)
        return code

    shutdown.on_signals(interrupted)
    server.save_run()
    server.record(screen.pace if prefix is None else 0.0)
    if prefix is not None:
        prefix()
        server.set_pace(screen.pace)
    server.start(client_left=(lambda: finish(0)) if ends_with_client else (lambda: None))
    for warning in server.warnings:
        server.tell(Notice(NoticeKind.FAULT, f"warning: {warning}"))
    try:
        if command is not None:
            shutdown.program = Program(command, server.environment, program_ended, _teller(server, printable))
        with cropped_dirty_spans():
            code = app.run(mouse=screen.mouse)
        if app.fault:
            say(f"simmer-tui: the screen has failed: {app.fault}")
            say("the robot is served on without it; ctrl+C ends")
            server.set_pace(0.0)
            server.call(server.engine.watch, console.watch)
            code = console.wait()
        return [*interruptions, *ended, code or 0][0]
    finally:
        shutdown.finish()
        for fault in server.late_faults:
            say(fault)
        if any(ended) or (server.referee is not None and server.referee.result is Result.FAILED):
            say("simmer-tui report and simmer-tui replay, without a file, show what went wrong")
        _forget_dead_terminal()


def _teller(server: Server, shown: Callable[[str], str]) -> Callable[[str], None]:
    """Passes a program's lines on as notices. One that prints without end has to wait for the
    robot's thread, which has better to do."""
    room = threading.BoundedSemaphore(_LINES_AHEAD)

    def tell(line: str) -> None:
        server.engine.tell(Notice(NoticeKind.PROGRAM, shown(line[:_LONGEST_LINE])))
        room.release()

    def print_line(line: str) -> None:
        room.acquire()
        server.call(tell, line)

    return print_line


def _forget_dead_terminal() -> None:
    """What is left to be written to a terminal that has gone must not become our exit code."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
