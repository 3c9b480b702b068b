"""A program with a keeper (Unix): how the simulator starts it, and ends it with all it started."""

from __future__ import annotations

import contextlib
import os
import secrets
import select
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

from simmer_tui.program import keeper

_LONGEST_END = keeper.PATIENCE + 0.6
"""How long a keeper may take to end everything, seconds, before we do it in its place."""

_LAST_WAIT = 0.5
"""How long the program may take to be gone after that, seconds."""


class KeptProcess:
    """A program, a child of this process, that a keeper watches over."""

    def __init__(
        self, words: Sequence[str], environment: Mapping[str, str], folder: Path | None, *, take_output: bool
    ) -> None:
        """Start it, in a folder or where we are; call `end` when it is over. Raises OSError. With
        `take_output` it has no input, and `output` has what it prints; else it shares ours."""
        self._mark = secrets.token_hex(8)
        self._lock = threading.Lock()
        control, self._control = os.pipe()
        self._status, status = os.pipe()
        reading, failure = os.pipe()
        theirs = (control, status, failure)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", keeper.__file__, *map(str, theirs), *words],
                env={**environment, keeper.MARK: self._mark},
                cwd=folder,
                stdin=subprocess.DEVNULL if take_output else None,
                stdout=subprocess.PIPE if take_output else None,
                stderr=subprocess.STDOUT if take_output else None,
                pass_fds=theirs,
                start_new_session=True,  # Ctrl-C in our terminal is for us, who then end the program
            )
        except OSError:
            self._close()
            os.close(reading)
            raise
        finally:
            for end in theirs:
                os.close(end)
        self.output: IO[bytes] | None = self._process.stdout
        with os.fdopen(reading, "rb") as pipe:
            number = pipe.read()  # until the program has begun
        if number:
            self._process.wait()
            if self.output is not None:
                self.output.close()
            self._close()
            raise OSError(int(number), os.strerror(int(number)))

    def wait(self) -> int:
        """Wait for the program's end; its exit code, or the negative number of the signal that ended it."""
        return self._process.wait()

    def end(self) -> None:
        """End the program and everything it started, by SIGTERM first. Any thread may call it, repeatedly."""
        with self._lock:
            if self._control < 0:
                return
            os.close(self._control)
            self._control = -1
            ready, _, _ = select.select([self._status], [], [], _LONGEST_END)
            if not ready or os.read(self._status, 16) != b"done":  # the keeper was stopped, or killed
                keeper.end_all(self._mark, self._process.pid)
            self._close()
            with contextlib.suppress(subprocess.TimeoutExpired):  # another user's cannot be killed
                self._process.wait(_LAST_WAIT)

    def _close(self) -> None:
        for end in (self._control, self._status):
            if end >= 0:
                os.close(end)
        self._control = self._status = -1
