"""A control program run beside the simulator, told by its environment where to connect."""

from __future__ import annotations

import contextlib
import os
import shlex
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

from simmer_tui.errors import ProgramError

_PATIENCE = 5.0
_LAST_LINES = 1.0
_LONGEST_LINE = 65536
"""Bytes of a line without an end that are taken at once."""


class Program:
    """A running program."""

    def __init__(
        self,
        command: str,
        environment: Mapping[str, str],
        on_end: Callable[[int], None],
        on_line: Callable[[str], None] | None = None,
        folder: Path | None = None,
    ) -> None:
        """Start `command` in `folder`, or where we are, with `environment` added to ours. Raises
        ProgramError.

        `on_end` gets the exit code in a thread of its own: 128 and the signal's number for a
        program that a signal ended. With `on_line` its output is taken, a line at a time, else it
        goes where ours goes.
        """
        try:
            self._process = subprocess.Popen(
                _words(command),
                env={**os.environ, **environment},
                cwd=folder,
                stdin=None if on_line is None else subprocess.DEVNULL,
                stdout=None if on_line is None else subprocess.PIPE,
                stderr=None if on_line is None else subprocess.STDOUT,
            )
        except OSError as error:
            raise ProgramError(f"--run {command!r}: {error.strerror or error}") from None
        self._reader: threading.Thread | None = None
        if on_line is not None:
            self._reader = threading.Thread(target=self._read, args=(on_line,), name="output", daemon=True)
            self._reader.start()
        self._waiter = threading.Thread(target=self._wait, args=(on_end,), name="program", daemon=True)
        self._waiter.start()

    def end(self, grace: float = 0.0) -> None:
        """Make sure it has ended, kindly at first. It may end by itself for `grace` seconds."""
        if grace:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout=grace)
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(timeout=_PATIENCE)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._waiter.join(2 * _LAST_LINES)

    def _read(self, on_line: Callable[[str], None]) -> None:
        assert self._process.stdout is not None, "only output that is taken is read"
        with self._process.stdout as output:
            for line in iter(lambda: output.readline(_LONGEST_LINE), b""):
                on_line(line.decode(errors="replace").rstrip())

    def _wait(self, on_end: Callable[[int], None]) -> None:
        code = self._process.wait()
        if self._reader is not None:  # a child of the program may hold its output open for ever
            self._reader.join(_LAST_LINES)
        on_end(code if code >= 0 else 128 - code)


def _words(command: str) -> list[str] | str:
    """The command as the system takes it. `python` means ours where there is no other."""
    if sys.platform == "win32":
        return command
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
