"""Runs a control program beside the simulator; environment variables tell it where to connect."""

from __future__ import annotations

import os
import shlex
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from simmer_tui.errors import ProgramError
from simmer_tui.program.kept_process import Keeper, KeptProcess

if TYPE_CHECKING:
    from simmer_tui.program.job_process import JobProcess

_LAST_LINES = 1.0
"""Time that a child of an ended program may keep its output open, seconds. Longer would delay every run that
leaves a daemon behind."""
# A line without an end is cut here, so that it does not fill the memory.
_LONGEST_LINE = 65536
"""Bytes of a line without an end that are taken at once."""


class Program:
    """A running program, in a session of its own."""

    def __init__(
        self,
        command: str,
        environment: Mapping[str, str],
        on_end: Callable[[int], None],
        on_line: Callable[[str], None] | None = None,
        folder: Path | None = None,
        keeper: Keeper | None = None,
    ) -> None:
        """Start `command` in `folder`, or where we are, with `environment` added to ours. Raises
        ProgramError.

        `on_end` gets the exit code in a thread of its own: 128 and the signal's number for a
        program that a signal ended. With `on_line` its output is taken, a line at a time, else it
        goes where ours goes. A process that runs many programs has one `keeper` for them all.
        """
        surroundings = {**os.environ, **environment}
        try:
            self._process = _started(command, surroundings, folder, keeper, take_output=on_line is not None)
        except OSError as error:
            raise ProgramError(f"--run {command!r}: {error.strerror or error}") from None
        self._reader: threading.Thread | None = None
        if on_line is not None:
            self._reader = threading.Thread(target=self._read, args=(on_line,), name="output", daemon=True)
            self._reader.start()
        self._ended = threading.Event()
        self._waiter = threading.Thread(target=self._wait, args=(on_end,), name="program", daemon=True)
        self._waiter.start()

    def end(self, grace: float = 0.0) -> None:
        """Make sure that it and all that it started has ended, kindly at first. It may end by itself
        for `grace` seconds. Any thread may ask, more than once; call it in any case."""
        if grace:
            self._ended.wait(grace)
        self._process.end()
        self._waiter.join(2 * _LAST_LINES)

    def _read(self, on_line: Callable[[str], None]) -> None:
        assert self._process.output is not None, "only output that is taken is read"
        with self._process.output as output:
            for line in iter(lambda: output.readline(_LONGEST_LINE), b""):
                on_line(line.decode(errors="replace").rstrip())

    def _wait(self, on_end: Callable[[int], None]) -> None:
        code = self._process.wait()
        self._ended.set()
        if self._reader is not None:  # a child of the program may hold its output open for ever
            self._reader.join(_LAST_LINES)
        on_end(code if code >= 0 else 128 - code)


def _started(
    command: str,
    environment: Mapping[str, str],
    folder: Path | None,
    keeper: Keeper | None,
    *,
    take_output: bool,
) -> KeptProcess | JobProcess:
    """The command as a process with all that it will start. Raises OSError, ProgramError."""
    if sys.platform == "win32":
        from simmer_tui.program.job_process import JobProcess

        return JobProcess(command, environment, folder, take_output=take_output)
    return KeptProcess(words_of(command), environment, folder, keeper, take_output=take_output)


def words_of(command: str) -> list[str]:
    """The command split into words as a Unix shell does. `python` falls back to our own interpreter."""
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise ProgramError(f"--run {command!r}: {error}") from None
    if not words:
        raise ProgramError("--run needs a program, such as --run 'python my_robot.py'")
    if words[0] in ("python", "python3"):
        from shutil import which  # imported by those who need it: it takes time

        words[0] = words[0] if which(words[0]) else sys.executable
    return words
