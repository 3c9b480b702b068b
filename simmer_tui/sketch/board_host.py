"""The process of a board: its pipes, and its end."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

from simmer_tui import platform_has
from simmer_tui.links.processes import OWN_PROCESS

_LAST = 2.0
"""Real seconds that a board may take to end once it has closed its channel. It takes milliseconds."""
# The pipe of a system has as much room at most, so nothing that was written before the end is missed.
_MOST_WORDS = 65536
"""Bytes of a board's last words that are read."""


class BoardHost(Protocol):
    """A board's process, wherever it runs. The channel (`arduino/board/exchange.h`) is two descriptors:
    `input` is written to, `output` is read."""

    input: int
    output: int

    @property
    def pids(self) -> tuple[int, ...]:
        """The numbers of the processes that take turns with us, as far as they are known."""

    def interrupt(self) -> None:
        """Make it tell where it is, and end; any thread may ask."""

    def kill(self) -> None:
        """End it at once; any thread may ask."""

    def end(self) -> tuple[str, str]:
        """Wait for its end, which comes soon: its last words, and how it ended, such as `exit code 1`."""

    def close(self) -> None:
        """End it, and free all that it has."""


BoardStart = Callable[[Path, Sequence[str]], BoardHost]
"""A function that starts a compiled sketch with options. Raises OSError, SimmerError."""


class LocalBoard:
    """A board as a process of this machine, with the access of this process."""

    def __init__(self, program: Path, options: Sequence[str]) -> None:
        self._process = subprocess.Popen(
            [str(program), *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
            # A terminal that closes, and ctrl+C, reach the processes of its session. Boards would die by them
            # before the run is over, and the run would have a fault.
            start_new_session=True,
            # Else it is taken for one that the program of the run has left behind, and ends with it.
            env={**os.environ, **OWN_PROCESS},
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self.input = self._process.stdin.fileno()
        self.output = self._process.stdout.fileno()

    @property
    def pids(self) -> tuple[int, ...]:
        return (self._process.pid,)

    def interrupt(self) -> None:
        # Its handler tells where it is. Windows has no such signal for processes.
        if platform_has.POSIX:
            self._process.send_signal(signal.SIGABRT)
        else:
            self._process.kill()

    def kill(self) -> None:
        self._process.kill()

    def end(self) -> tuple[str, str]:
        return last_words(self._process), f"exit code {self._process.wait()}"

    def close(self) -> None:
        close_process(self._process)


def last_words(process: subprocess.Popen[bytes]) -> str:
    """The output of a board for people before its end. One that does not end is killed."""
    assert process.stderr is not None
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_LAST)
    process.kill()
    process.wait()
    # What the board has started may still have the pipe, so one look must be enough.
    try:
        if sys.platform != "win32":
            os.set_blocking(process.stderr.fileno(), False)
        return os.read(process.stderr.fileno(), _MOST_WORDS).decode("utf-8", "replace")
    except (OSError, ValueError):  # nothing is there, or another thread has closed it
        return ""


def close_process(process: subprocess.Popen[bytes]) -> None:
    """End a process, and close its pipes: a thread that reads them finds their end before."""
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout, process.stderr):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()
