"""Starting the terminal app: the terminal looked at, Textual imported, the station run beside it."""

from __future__ import annotations

import os
import sys

from simmer_tui.engine import Notice, NoticeKind
from simmer_tui.program import NOT_FOUND, Program, ProgramError
from simmer_tui.sim.command import escape
from simmer_tui.station import Station
from simmer_tui.tui.terminal import choose


def run_app(station: Station, *, once: bool = False, command: str | None = None) -> int:
    """Serve and draw until the user quits; returns the exit code.

    With `once` it ends when the client has left. `command` is a program to run beside it; what
    it prints goes to the log panel, and its exit code becomes ours.
    """
    screen = station.configuration.settings.screen
    windows = sys.platform == "win32"
    choice = choose(
        os.environ, sys.stdout.encoding, color=screen.color, glyphs=screen.glyphs, windows=windows
    )
    choice.apply(os.environ)
    from simmer_tui.tui.app import SimmerApp
    from simmer_tui.tui.dirty_spans import cropped_dirty_spans
    from simmer_tui.tui.history import default_history_file

    app = SimmerApp(station, choice, default_history_file())

    def client_left() -> None:
        if once:
            app.call_from_thread(app.exit, 0)

    station.record()
    station.start(client_left=client_left)
    program: Program | None = None
    ended: list[int] = []

    def print_line(line: str) -> None:
        station.tell(Notice(NoticeKind.PROGRAM, escape(line, 500)))

    def program_ended(code: int) -> None:
        ended.append(code)
        station.tell(Notice(NoticeKind.PROGRAM, f"the program has ended with exit code {code}"))

    try:
        if command is not None:
            program = Program(command, station.environment, program_ended, print_line)
        with cropped_dirty_spans():
            code = app.run(mouse=screen.mouse)
    except ProgramError as error:
        sys.stderr.write(f"simmer-tui: {error}\n")
        return NOT_FOUND
    finally:
        if program is not None:
            program.end()
        station.stop()
    return ended[0] if ended else app.return_code or code or 0
