"""A program watched by a keeper (Unix): its start, and its end with all it started."""

from __future__ import annotations

import contextlib
import os
import secrets
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

from simmer_tui.program import keeper

_LAST_WAIT = 0.5
"""Seconds that a program may take to be gone after it was killed; another user's cannot be killed."""


class Keeper:
    """A process that ends the programs of this one if this one is killed. It starts with the first program.

    Any thread may use it. Close it at last; nothing it watches may run then.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()

    def watch(self, mark: str, pid: int = -1) -> None:
        """A program with this mark begins; its process ID is -1 until it is known. Raises OSError."""
        self._tell(f"{mark} {pid}\n")

    def forget(self, mark: str) -> None:
        """All of the program has ended."""
        if self._process is not None:
            self._tell(f"{mark}\n")

    def close(self) -> None:
        with self._lock:
            self._end()

    def _tell(self, line: str) -> None:
        with self._lock:
            try:
                self._write(line)
            except BrokenPipeError:  # somebody killed it
                self._end()
                self._write(line)

    def _write(self, line: str) -> None:
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", keeper.__file__],
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd="/",
                start_new_session=True,  # Ctrl-C in our terminal is not for it
            )
            assert self._process.stdin is not None, "it is a pipe"
            os.set_blocking(self._process.stdin.fileno(), False)  # one that was stopped reads no more
        assert self._process.stdin is not None, "it is a pipe"
        self._process.stdin.write(line.encode())

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


class KeptProcess:
    """A program, a child of this process, that a keeper watches over."""

    def __init__(
        self,
        words: Sequence[str],
        environment: Mapping[str, str],
        folder: Path | None,
        shared: Keeper | None,
        *,
        take_output: bool,
    ) -> None:
        """Start it, in a folder or where we are; call `end` when it is over. Raises OSError. With
        `take_output` it has no input, and `output` has what it prints; else it shares ours. Without a
        `shared` keeper it has one of its own."""
        self._mark = secrets.token_hex(8)
        self._lock = threading.Lock()
        self._has_ended = False
        self._owns_keeper = shared is None
        self._keeper = shared or Keeper()
        self._keeper.watch(self._mark)  # from before its start: we may be killed at any moment
        try:
            self._process = subprocess.Popen(
                words,
                env={**environment, keeper.MARK: self._mark},
                cwd=folder,
                stdin=subprocess.DEVNULL if take_output else None,
                stdout=subprocess.PIPE if take_output else None,
                stderr=subprocess.STDOUT if take_output else None,
                start_new_session=True,  # Ctrl-C in our terminal is for us, who then end the program
            )
        except OSError:
            self._release()
            raise
        self._keeper.watch(self._mark, self._process.pid)
        self.output: IO[bytes] | None = self._process.stdout

    def wait(self) -> int:
        """Wait for the program's end; its exit code, or the negative number of the signal that ended it."""
        return self._process.wait()

    def end(self) -> None:
        """End the program and everything it started, by SIGTERM first. Any thread may call it, repeatedly."""
        with self._lock:
            if self._has_ended:
                return
            self._has_ended = True
            keeper.end_all(self._mark, self._process.pid)
            self._release()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_LAST_WAIT)

    def _release(self) -> None:
        self._keeper.forget(self._mark)
        if self._owns_keeper:
            self._keeper.close()
