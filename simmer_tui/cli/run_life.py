"""The life of a run, with a screen and without: its start, its program, its end and its exit code.

Only the front end differs: lines on standard error (`headless.py`), or the screen (`app_start.py`).
"""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from simmer_tui import platform_has
from simmer_tui.cli.command_line import ExitCode, say
from simmer_tui.config.dialects import COMMANDS, PACKETS, SERIAL
from simmer_tui.config.variables import HOST
from simmer_tui.errors import ProgramError
from simmer_tui.live.server import LAST_OUTPUT, Server
from simmer_tui.run.events import (
    NOT_CONNECTED,
    Action,
    ActionName,
    Event,
    EventHandler,
    MissionEnd,
    Notice,
    NoticeKind,
    Result,
)
from simmer_tui.run.phrases import NOTHING_SENT, exit_text

if TYPE_CHECKING:
    from simmer_tui.program import Program, ProgramOutput
    from simmer_tui.report.verdict import Verdict
    from simmer_tui.run.mission import Referee
    from simmer_tui.run.run_history import RunHistory
    from simmer_tui.web.page_server import PageServer

# All within the 2 s that an end by signal may take. The program ends first, so that its last commands are
# logged.
_PROGRAM, _SERVER, _EXIT = 0.4, 1.4, 1.8
"""Seconds after a signal at which the program, the server and the process are ended, if the main thread has
not done it.

The main thread cannot while it writes to a terminal, or a pipe, that does not read.
"""


# Judged: a Python program with large imports connects earlier. MATLAB starts more slowly, and the hint is
# true for it too.
CONNECT_WITHIN = 5.0
"""Real seconds after the start of a program without a connection, after which a hint tells the address."""


class FrontEnd:
    """Shows a run, and ends at `finish`. Methods that a front end does not need do nothing."""

    judges = False
    """True if the run ends with its mission, which sets the exit code."""
    wants_verdict = False
    """True if `judged` needs the verdict."""
    watches = True
    """False if `watch` needs no event."""
    program_output: Callable[[str], None] | None = None
    """Callback for a program's lines; without it they go to our own output."""

    def logging(self, path: Path) -> None:
        """The run is logged to a file."""

    def prepare(self, prefix: Callable[[], None] | None) -> None:
        """Watch the server, which starts later. The events of a `prefix` come first."""

    def set_example(self, run: Callable[[str], None]) -> None:
        """`run` starts a program beside a run that was begun without one. It raises ProgramError."""

    def set_restart(self, again: Callable[[], None]) -> None:
        """`again` restarts the run, with its program if there was one; it returns before their end."""

    def watch(self, event: Event) -> None:
        """Take an event, in the robot's thread."""

    def started(self) -> None:
        """Called when server and program run."""

    def show_links(self, links: tuple[str, ...]) -> None:
        """Show the addresses of the page."""

    def show(self) -> int:
        """Show events until `finish`; returns its code."""
        raise NotImplementedError

    def finish(self, code: int) -> None:
        """End `show`. Safe in signal handlers and from any thread."""

    def program_ended(self, code: int, *, stopped: bool) -> None:
        """Called when the program has ended, in a thread of its own; `stopped` if the simulator ended it."""

    def show_rest(self) -> None:
        """Show the events so far, and no later ones."""

    def judged(self, verdict: Verdict) -> None:
        """Called when the run is over and its server stopped, with the verdict."""

    def ended(self) -> None:
        """Called when the run is over and its server stopped."""


class _Connection(EventHandler[None]):
    """Calls a function when a client has connected."""

    def __init__(self, call: Callable[[], None]) -> None:
        self._call = call

    def on_notice(self, event: Notice) -> None:
        if event.kind is NoticeKind.CONNECTED:
            self._call()


@dataclass(eq=False)
class RunLife:
    """One run: a server with a front end, and optionally a program that drives the robot.

    `command` is the program. With `once` the run ends with the client, or the program. `log` is a file, or
    `auto`. The events of a `prefix` come before the server starts. A `page` shows the run too.
    """

    server: Server
    front: FrontEnd
    _: KW_ONLY
    command: str | None = None
    once: bool = False
    log: str | None = None
    prefix: Callable[[], None] | None = None
    page: PageServer | None = None

    def __post_init__(self) -> None:
        self.server.program_command = self.command or ""
        self._shutdown = Shutdown(self.server)
        self._interruptions: list[int] = []
        """The exit codes of signals, as they came."""
        self._output: ProgramOutput | None = None
        """The output of the program that was started last."""
        self._program_code: int | None = None
        self._latest = ""
        """Command of the program that was started last."""
        self._program_over = threading.Event()
        self._end_told = False
        self._connected = threading.Event()
        """Set if a client has connected since the program was started."""
        self._lock = threading.Lock()
        self._history: RunHistory | None = None
        self._grace = 0.0

    def run(self) -> int:
        """Serve until a signal, the program, the client, the mission or the front end ends the run.

        Returns the exit code: that of the first signal, of the mission, of the program, or of the front end.
        Raises ProgramError if the program cannot be started and no verdict says so, RunLogError if the log
        cannot be written.
        """
        server, front = self.server, self.front
        try:
            self._start()
            front.started()
            if self.page is not None:
                front.show_links(self.page.shown_links)
            return self._exit_code(front.show())
        except ProgramError as error:
            self._tell_not_started(error)
            if front.wants_verdict:
                return ExitCode.NOT_STARTED
            raise
        finally:
            self._shutdown.finish(0.0 if self._interruptions else self._grace, self._tell_program_end)
            for fault in server.late_faults:
                say(fault)
            self._judge()
            if self.page is not None:
                self.page.stop()
            front.ended()
            self._shutdown.release()

    def _start(self) -> None:
        server, front = self.server, self.front
        if self.log is not None:
            front.logging(server.start_log(self.log))
        # After the log is open and before the server runs: an interruption closes both.
        self._shutdown.on_signals(self._interrupted)
        if front.wants_verdict or (front.judges and self.page is not None):
            self._history = server.keep_history()
        # If a run continues when its client has left, its viewers see the same as the screen.
        if front.judges and self.page is not None and self.command is None:
            server.keep_verdict(has_program=False)
        if self.page is not None:
            self.page.prepare()
        front.prepare(self.prefix)
        # A program may send more after a client has left, and has an exit code of its own.
        ends_with_client = self.once and self.command is None
        client_left = (lambda: front.finish(0)) if ends_with_client else (lambda: None)
        if front.watches:
            server.engine.watch(front.watch)
        server.engine.watch(_Connection(self._connected.set).handle)
        if front.judges:
            server.engine.watch(MissionEnd(lambda: front.finish(0)).handle)
        server.boards_ended = self._boards_over
        server.start(None, client_left, probe_left=lambda: None)
        if self.page is not None:
            self.page.start()
        if self.command is not None:  # before any output: if it fails, its error is the only line
            self._run_program(self.command)
        else:
            front.set_example(self._run_example)
        front.set_restart(self._again)

    def _boards_over(self) -> None:
        """End the run, as a board has died or hangs. A program's time stands still until it is ended: so the
        log ends the same every time. A front end that does not judge shows the end."""
        if self.server.clock is not None:
            self.server.clock.frozen = True
        if self.front.judges or self.once:
            self.front.finish(ExitCode.NO)
        else:
            # Its end is told in the robot's thread, which must not wait for it.
            threading.Thread(target=self._shutdown.end_program, name="boards over", daemon=True).start()

    def _run_program(self, command: str) -> None:
        """Start a program beside the run. Raises ProgramError."""
        # Imported here because it takes a thirtieth of a start without a program.
        from simmer_tui.program import Program, ProgramOutput
        from simmer_tui.program.program_command import out_of_reach

        server = self.server
        self._output = ProgramOutput(
            lambda: server.engine.present, lambda why: server.tell(Notice(NoticeKind.FAULT, why))
        )
        if SERIAL.purpose in server.ports and (why := out_of_reach(command)):
            from simmer_tui.links.port_link import no_hook_advice

            advice = no_hook_advice(server.terminal)
            server.tell(Notice(NoticeKind.FAULT, f"{NOT_CONNECTED}: {why}. {advice}"))
        server.note_output(self._output.settle)
        self._shutdown.program = Program(
            command,
            server.environment,
            self._program_ended,
            self.front.program_output,
            output=self._output,
            adopts=True,
        )
        self._latest = command
        server.note_program(self._shutdown.program.pid)
        self._expect_connection()

    def _expect_connection(self) -> None:
        """Tell the address if the program that was started last has not connected soon."""
        self._connected.clear()
        timer = threading.Timer(CONNECT_WITHIN, self._tell_address, (self._shutdown.program,))
        timer.daemon = True
        timer.start()

    def _tell_address(self, program: Program) -> None:
        is_over = self._program_code is not None or self._shutdown.program is not program
        if not (self._connected.is_set() or is_over) and self.server.running:
            self.server.tell(Notice(NoticeKind.HINT, _unconnected_text(self.server)))

    def _tell_not_started(self, error: ProgramError) -> None:
        if self._output is not None:
            self.server.tell(self._output.not_started(error))

    def _again(self) -> None:
        """Restart the run and its program. A program that still runs is ended first."""
        threading.Thread(target=self._begin_again, name="again", daemon=True).start()

    def _begin_again(self) -> None:
        server, program = self.server, self._shutdown.program
        if program is not None:
            program.end()
            self._program_over.wait()  # its end belongs to the previous run
        server.call(server.engine.perform, Action(ActionName.RESET, source="keys"))
        if program is None:
            return
        with self._lock:
            self._program_code, self._end_told = None, False
            self._program_over.clear()
        try:
            self._run_program(self._latest)
        except ProgramError as error:
            self._tell_not_started(error)
            self._program_over.set()

    def _run_example(self, command: str) -> None:
        """Start a program for a person, once. Its exit code does not become the run's."""
        if self._shutdown.program is None:
            self._run_program(command)
            self.server.expect_program()

    @property
    def _judged(self) -> Referee | None:
        """The referee of a mission that ends the run."""
        return self.server.referee if self.front.judges else None

    def _program_ended(self, code: int) -> None:
        self._program_code = code
        # A run that ends with its program drains first, too.
        if not self.front.judges:
            self.server.drain()
            self._tell_program_end()
        self.front.program_ended(code, stopped=self._is_stopped)
        self._program_over.set()

    def _tell_program_end(self) -> None:
        """Tell once that the program has ended, after its last command."""
        code = self._program_code
        with self._lock:
            if code is None or self._output is None or self._end_told or not self.server.running:
                return
            self._end_told = True
        self.server.tell_at_once(self._output.end(code, stopped=self._is_stopped))

    @property
    def _boards_failed(self) -> bool:
        """True if the run is over because a board has died or hangs."""
        return self.server.boards is not None and bool(self.server.boards.failed)

    @property
    def _is_stopped(self) -> bool:
        """True if the simulator has ended the program."""
        program = self._shutdown.program
        return program is not None and program.stopped

    def _judge(self) -> None:
        """Give front end and page the verdict on a run with any event."""
        server, history = self.server, self._history
        if history is None or server.running or not (history.totals.commands or history.programs.items):
            return
        # Imported here because it takes a twentieth of the start.
        from simmer_tui.report.verdict import verdict_of

        verdict = verdict_of(history, server.task)
        if self.front.wants_verdict:
            self.front.judged(verdict)
        if self.page is not None:
            self.page.judged(verdict)

    def _interrupted(self, number: int) -> int:
        """The exit code of a run that a signal ends."""
        if self.command is not None:
            code = 128 + number
        else:
            missed = self._judged is not None and self._judged.result is not Result.SUCCESS
            code = ExitCode.NO if missed else ExitCode.DONE
        self._interruptions.append(code)
        self.front.finish(code)
        return code

    def _exit_code(self, code: int) -> int:
        """The exit code; `code` is that of the front end."""
        if self.front.judges and not self._interruptions:
            code = self._judgement(code)
        elif self._boards_failed:
            code = ExitCode.NO
        elif self.command is not None and self._program_code is not None:
            code = self._program_code
        return self._interruptions[0] if self._interruptions else code

    def _judgement(self, code: int) -> int:
        """The exit code of a run that ends with its program or its mission."""
        server, referee = self.server, self._judged
        if self.command is not None:
            # Its last commands may meet a goal.
            self._drain()
        if referee is None:
            if self.command is not None and server.sent_nothing(code):
                say(f"simmer-tui: {NOTHING_SENT}")
                return ExitCode.NO
            return code
        if referee.result is Result.UNDER_WAY:
            # The referee belongs to the robot's thread.
            server.call(self._give_up, referee, code)
            self.front.show()
        if self._interruptions:
            return code
        if self.command is None:
            # A program of another terminal may still ask what it has done: it is not cut off in the middle.
            server.drain()
        # Only for a run that ends by itself: after Ctrl-C nobody waits.
        self._grace = LAST_OUTPUT
        return ExitCode.DONE if referee.result is Result.SUCCESS else ExitCode.NO

    def _drain(self) -> None:
        """Receive everything that the program sent before its end, unless its mission is over."""
        if self._judged is None or self._judged.result is Result.UNDER_WAY:
            self._shutdown.end_program()  # its remaining processes no longer count
            self.server.drain()
            self._tell_program_end()
        self.front.show_rest()

    def _give_up(self, referee: Referee, code: int) -> None:
        """End a mission that nobody can finish any more, in the robot's thread."""
        if self.server.sent_nothing(code):
            referee.end(NOTHING_SENT)
        elif self.command is None:
            referee.end("the client has left")
        else:
            referee.end(exit_text(code))
        # Even if the watcher that would set it has failed: nobody waits forever.
        self.front.finish(code)


def _unconnected_text(server: Server) -> str:
    """The hint for a program without a connection."""
    host = server.environment[HOST]
    places = [
        f"port {server.ports[port.purpose]} ({port.variable})"
        for port in (COMMANDS, PACKETS)
        if port.purpose in server.ports
    ]
    if places:
        where = f"use {host}, {' or '.join(places)}"
    else:
        from simmer_tui.links.port_link import no_hook_advice

        where = f"it must open its serial port. {no_hook_advice(server.terminal)}"
    # Short: a line of a small screen has room for the address.
    return f"no connection from the program after {CONNECT_WITHIN:g} s: {where}"


class Shutdown:
    """Ends the program beside a run, and then its server with a complete log. The first thread that calls it
    does so, once."""

    def __init__(self, server: Server) -> None:
        self._server = server
        # The main thread and the time-limit thread may both call it.
        self._lock = threading.Lock()
        self._done = False
        self._wakes: socket.socket | None = None
        """The socket to which the system writes the numbers of signals."""
        self.program: Program | None = None
        """The program of the run, once it has been started."""

    def on_signals(self, interrupted: Callable[[int], int]) -> None:
        """End the run at signals from now on.

        `interrupted` is called with the number of the first signal, in any thread. It makes the main thread
        end the run, and returns the exit code. If the main thread is stuck, the run still ends within 2 s.
        """

        first = [True]

        def end(number: int) -> None:
            try:
                first.pop()
            except IndexError:  # another signal, or the other thread, was first
                return
            code = interrupted(number)
            threading.Thread(target=self._insist, args=(code,), name="insist", daemon=True).start()

        def handle(number: int, frame: FrameType | None) -> None:
            end(number)

        numbers = _end_signals()
        # Windows interrupts no wait, and its event loop has a descriptor of its own here.
        if platform_has.POSIX:
            self._wake_at(numbers, end)
        for number in numbers:
            signal.signal(number, handle)

    def _wake_at(self, numbers: Sequence[int], end: Callable[[int], None]) -> None:
        """Call `end` in a thread of its own at a signal, until `release`.

        Python calls a handler in the main thread only. A signal that comes just before that thread begins a
        blocking call does not interrupt the call: the handler would never be called.
        """
        reading, self._wakes = socket.socketpair()
        self._wakes.setblocking(False)

        def watch() -> None:
            with reading:
                while number := reading.recv(1):
                    if number[0] in numbers:
                        end(number[0])

        signal.set_wakeup_fd(self._wakes.fileno(), warn_on_full_buffer=False)
        threading.Thread(target=watch, name="signals", daemon=True).start()

    def release(self) -> None:
        """End the thread that waits for signals: the run is over."""
        if self._wakes is not None:
            signal.set_wakeup_fd(-1)
            self._wakes.close()
            self._wakes = None

    def finish(self, grace: float = 0.0, program_over: Callable[[], None] = lambda: None) -> None:
        """End everything, or wait until it has ended.

        The program may run for another `grace` seconds. `program_over` is called when it has ended, before
        the server stops.
        """
        with self._lock:
            if self._done:
                return
            self._done = True
            if self.program is not None:
                self.program.end(grace)
            program_over()
            self._server.stop()

    def _insist(self, code: int) -> None:
        begun = time.monotonic()
        for when, end in ((_PROGRAM, self.end_program), (_SERVER, self.finish), (_EXIT, None)):
            threading.Event().wait(max(begun + when - time.monotonic(), 0.0))
            if end is not None:
                threading.Thread(target=end, name="end", daemon=True).start()
        os._exit(code)  # the keeper ends the processes that a program has left running

    def end_program(self) -> None:
        """End the program with all processes that it has started."""
        if self.program is not None:
            self.program.end()


def _end_signals() -> list[int]:
    """The signals that end a run, without those that are ignored (by nohup, for example)."""
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
    known = [int(getattr(signal, name)) for name in names if hasattr(signal, name)]
    return [number for number in known if signal.getsignal(number) is not signal.SIG_IGN]
