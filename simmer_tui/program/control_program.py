"""Runs a control program beside the simulator; environment variables name its ports.

On Unix a keeper watches the program, and ends all that it started.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from simmer_tui import platform_has
from simmer_tui.errors import ProgramError, reason_of
from simmer_tui.program import keeper
from simmer_tui.program.adoption import Adoption
from simmer_tui.program.hook_folder import with_hook
from simmer_tui.program.program_command import console_variables, words_of
from simmer_tui.program.program_output import OutputReader, OutputRoute, ProgramOutput

if TYPE_CHECKING:
    from simmer_tui.program.job_process import JobProcess

_LAST_LINES = 1.0
"""Seconds that a child of an ended program may keep its output open. A longer time would delay every
run that leaves a daemon behind."""


class RunningProgram:
    """A program that has been started, and the reader of its output."""

    def __init__(
        self,
        wait: Callable[[], int],
        stop: Callable[[], None],
        output: OutputRoute | OutputReader,
        on_end: Callable[[int], None],
        last_lines: float,
    ) -> None:
        """Wait in a thread for its end, and then `last_lines` seconds at most for the rest of its output.

        `wait` returns the exit code, or the negative number of the signal that ended it. `stop` ends the
        program and all that it started. `on_end` gets the exit code: 128 and the signal's number for a
        program that a signal ended.
        """
        self.stopped = False
        """True if the program did not end by itself."""
        self._stop = stop
        self._output = output
        self._last_lines = last_lines
        self._ended = threading.Event()
        self._waiter = threading.Thread(target=self._wait, args=(wait, on_end), name="program", daemon=True)
        self._waiter.start()

    def settle_output(self) -> bool:
        """Wait until all its output so far has been read; False if that takes too long."""
        return self._output.settle()

    def end(self, grace: float = 0.0) -> None:
        """Make sure that it and all that it started has ended. Within the first `grace` seconds it may end by
        itself.

        Any thread may call it, more than once; call it in any case.
        """
        if grace:
            self._ended.wait(grace)
        if not self._ended.is_set():
            self.stopped = True
        self._stop()
        self._waiter.join(2 * self._last_lines)

    def _wait(self, wait: Callable[[], int], on_end: Callable[[int], None]) -> None:
        code = wait()
        self._ended.set()
        self._output.join(self._last_lines)  # a child of the program may hold its output open forever
        on_end(code if code >= 0 else 128 - code)


class Program(RunningProgram):
    """A running program, in a session of its own."""

    def __init__(
        self,
        command: str,
        environment: Mapping[str, str],
        on_end: Callable[[int], None],
        on_line: Callable[[str], None] | None = None,
        folder: Path | None = None,
        keeper: Keeper | None = None,
        output: ProgramOutput | None = None,
        *,
        adopts: bool = False,
    ) -> None:
        """Start `command` in `folder`, by default the working directory, with `environment` added to ours.
        Raises ProgramError.

        `on_end` gets the exit code in a thread of its own. With `on_line` the output is read line by line,
        otherwise it goes to our own output. `output` keeps its last lines. A process that runs many programs
        has one `keeper` for them all. One that runs one at a time, and starts no other processes, `adopts`
        processes that a program leaves behind (Linux).
        """
        unbuffered: dict[str, str] = {}
        if not platform_has.POSIX and on_line is None and (os.isatty(1) or os.isatty(2)):
            from simmer_tui.program.job_process import console_code_page

            unbuffered = console_variables(command, console_code_page())
        variables = with_hook({**unbuffered, **os.environ, **environment})
        try:
            kept = output or ProgramOutput()
            route = OutputRoute(kept, on_line, at_once=bool(unbuffered))
            try:
                process = _started(command, variables, folder, keeper, route, on_line is None, adopts)
            except BaseException:
                route.abandon()
                raise
        except OSError as error:
            raise ProgramError(f"--run {command!r}: {reason_of(error)}") from None
        route.start()
        self.pid = process.pid
        """Its process ID."""
        super().__init__(process.wait, process.end, route, on_end, _LAST_LINES)


def _started(
    command: str,
    environment: Mapping[str, str],
    folder: Path | None,
    keeper: Keeper | None,
    route: OutputRoute,
    has_input: bool,
    adopts: bool,
) -> KeptProcess | JobProcess:
    """Start the command as a process that is ended with all that it starts. Raises OSError, ProgramError."""
    if not platform_has.POSIX:
        from simmer_tui.program.job_process import JobProcess

        return JobProcess(command, environment, folder, route, has_input=has_input)
    words = words_of(command)
    return KeptProcess(words, environment, folder, keeper, route, has_input=has_input, adopts=adopts)


_LAST_WAIT = 0.5
"""Seconds to wait for a killed program's end. Another user's program cannot be killed."""


class Keeper:
    """A process that ends this process's programs if this one is killed.

    It starts with the first program. Any thread may use it. Close it at the end, when no watched program
    runs.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()

    def watch(self, mark: str, pid: int = -1) -> None:
        """Watch a program with this mark; its process ID is -1 until it is known. Raises OSError."""
        self._tell(f"{mark} {pid}\n")

    def forget(self, mark: str) -> None:
        """Stop watching: all processes of the program have ended."""
        if self._process is not None:
            self._tell(f"{mark}\n")

    def close(self) -> None:
        with self._lock:
            self._end()

    def _tell(self, line: str) -> None:
        with self._lock:
            try:
                self._write(line)
            except BrokenPipeError:  # it was killed
                self._end()
                self._write(line)

    def _write(self, line: str) -> None:
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", keeper.__file__],
                env={**os.environ, keeper.MARK: keeper.KEEPER},
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd="/",
                start_new_session=True,  # Ctrl-C in our terminal must not end it
            )
            assert self._process.stdin is not None, "it is a pipe"
            if sys.platform != "win32":  # no keeper is running
                os.set_blocking(self._process.stdin.fileno(), False)  # a stopped keeper reads no more
        assert self._process.stdin is not None, "it is a pipe"
        self._process.stdin.write(line.encode())

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


class KeptProcess:
    """A child of this process that a keeper watches."""

    def __init__(
        self,
        words: Sequence[str],
        environment: Mapping[str, str],
        folder: Path | None,
        shared: Keeper | None,
        route: OutputRoute,
        *,
        has_input: bool,
        adopts: bool,
    ) -> None:
        """Start it in a folder, by default the working directory; call `end` when it is over. Raises OSError.

        Its output takes its `route`. Its input is ours if it `has_input`. Without a `shared` keeper it has
        one of its own. With `adopts` this process adopts the processes that it leaves behind.
        """
        # Not with the module secrets, whose import takes time.
        self._mark = os.urandom(8).hex()
        self._adoption = Adoption(self._mark) if adopts else None
        self._lock = threading.Lock()
        self._has_ended = False
        self._owns_keeper = shared is None
        self._keeper = shared or Keeper()
        self._keeper.watch(self._mark)  # before its start: we may be killed at any moment
        try:
            self._process = subprocess.Popen(
                words,
                env={**environment, keeper.MARK: self._mark},
                cwd=folder,
                stdin=None if has_input else subprocess.DEVNULL,
                stdout=route.stdout,
                stderr=route.stderr,
                start_new_session=True,  # Ctrl-C in our terminal is for us; we then end the program
            )
        except OSError:
            self._release()
            raise
        self._keeper.watch(self._mark, self._process.pid)
        if self._adoption is not None:
            self._adoption.begin(self._process.pid)

    @property
    def pid(self) -> int:
        """Its process ID."""
        return self._process.pid

    def wait(self) -> int:
        """Wait for the program's end. Returns its exit code, or the negative number of the signal that ended
        it."""
        return self._process.wait()

    def end(self) -> None:
        """End the program and everything it started, first by SIGTERM. Any thread may call it, repeatedly."""
        with self._lock:
            if self._has_ended:
                return
            self._has_ended = True
            if self._adoption is None:
                keeper.end_all(self._mark, self._process.pid)
            elif not self._adoption.nothing_left():
                keeper.end_all(self._mark, self._process.pid, self._adoption.living)
            self._release()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_LAST_WAIT)

    def _release(self) -> None:
        if self._adoption is not None:
            self._adoption.end()
        self._keeper.forget(self._mark)
        if self._owns_keeper:
            self._keeper.close()
