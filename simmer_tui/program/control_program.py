"""Runs a control program beside the simulator; environment variables name its ports.

All that it started ends with it: by a keeper on Unix (`kept_process.py`), by a job on Windows
(`job_process.py`).
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from simmer_tui import platform_has
from simmer_tui.errors import ProgramError, reason_of
from simmer_tui.program.kept_process import Keeper, KeptProcess
from simmer_tui.program.program_command import (
    console_variables,
    missing_program,
    runs_python,
    start_advice,
    with_hook,
    words_of,
)
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
        output: OutputReader,
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
        if folder is None and (missing := missing_program(command)):
            raise ProgramError(f"--run {command!r}: {missing}")
        unbuffered: dict[str, str] = {}
        if not platform_has.POSIX and on_line is None and (os.isatty(1) or os.isatty(2)):
            from simmer_tui.program.job_process import console_code_page

            unbuffered = console_variables(command, console_code_page())
        output = output or ProgramOutput()
        stacks = output.stacks.variables if runs_python(command) else {}
        variables = with_hook({**unbuffered, **os.environ, **environment, **stacks})
        has_input = on_line is None
        process: KeptProcess | JobProcess
        try:
            route = OutputRoute(output, on_line, at_once=bool(unbuffered))
            try:
                if platform_has.POSIX:
                    words = words_of(command)
                    process = KeptProcess(
                        words, variables, folder, keeper, route, has_input=has_input, adopts=adopts
                    )
                else:
                    from simmer_tui.program.job_process import JobProcess

                    process = JobProcess(command, variables, folder, route, has_input=has_input)
            except BaseException:
                route.abandon()
                raise
        except OSError as error:
            # The program's name is repeated only if the command has more words.
            name = f"{error.filename}: " if error.filename not in (None, command) else ""
            why = (start_advice(command) if folder is None else "") or f"{name}{reason_of(error)}"
            raise ProgramError(f"--run {command!r}: {why}") from None
        self.pid = process.pid
        """Its process ID."""
        super().__init__(process.wait, process.end, route.start(), on_end, _LAST_LINES)
