"""The reader of submissions: a child process with limits, in which teams' files are parsed.

A file of a few kilobytes can take a parser minutes or gigabytes. That is then the team's own mistake, and
does not delay others: the child is killed, and another one reads the next team's.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

from simmer_tui import platform_has
from simmer_tui.errors import GradeError, SimmerError
from simmer_tui.grade.submission_copy import LARGEST_SUBMISSION

if platform_has.POSIX:
    import resource
if sys.platform == "win32":
    from multiprocessing.connection import PipeConnection as End
else:
    from multiprocessing.connection import Connection as End

READER_CPU = 5
"""Seconds of processor time for one file or set. The largest honest set takes 0.1 s."""
READER_MEMORY = 500_000_000
"""Bytes of memory beyond those of the child when it begins. Judged: a hundred times an honest set."""
_READ_TIMEOUT = 60.0
"""Seconds (real) for one file or set, with the child's start, on an overloaded machine."""

_Asked = ParamSpec("_Asked")
_Answer = TypeVar("_Answer")


class SubmissionReader:
    """Calls functions in a child process with limits. The child begins with the first call."""

    def __init__(self) -> None:
        self._child: BaseProcess | None = None
        self._connection: End | None = None

    def call(
        self, function: Callable[_Asked, _Answer], *given: _Asked.args, **named: _Asked.kwargs
    ) -> _Answer:
        """The function's result. The function, its arguments and its result must be picklable.

        Raises:
            GradeError: It exceeded a limit, or failed.
        """
        connection = self._begun()
        try:
            connection.send((function, given, named))
            answer = connection.recv() if connection.poll(_READ_TIMEOUT) else None
        except (EOFError, OSError):
            answer = None
        if answer is None:
            self.close()
            raise GradeError(
                f"take more than {READER_CPU} s of processor time or {READER_MEMORY / 1e6:.0f} MB to read: "
                "make them smaller"
            )
        if isinstance(answer, GradeError):
            raise answer
        return cast("_Answer", answer)

    def _begun(self) -> End:
        if self._connection is None:
            context = multiprocessing.get_context("spawn")
            self._connection, theirs = context.Pipe()
            self._child = context.Process(target=serve, args=(theirs,), name="reader", daemon=True)
            self._child.start()
            theirs.close()
        return self._connection

    def close(self) -> None:
        """End the child."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        if self._child is not None:
            self._child.kill()
            self._child.join()
            self._child = None


def serve(connection: End) -> None:
    """The child: answer calls until the other end is closed, each within the limits."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent process
    has_limits = False
    while True:
        try:
            function, given, named = connection.recv()
        except (EOFError, OSError):
            return
        if not has_limits:  # the modules of the function have been imported now
            _limit_size()
            has_limits = True
        _limit_time()
        try:
            answer = function(*given, **named)
        except SimmerError as error:
            answer = GradeError(str(error))
        except (MemoryError, RecursionError, ValueError, OSError) as error:
            answer = GradeError(f"cannot be read: {type(error).__name__}")
        connection.send(answer)


def _limit_size() -> None:
    if sys.platform != "win32" and platform_has.POSIX:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST_SUBMISSION, LARGEST_SUBMISSION))
    if (
        sys.platform == "linux" and platform_has.LINUX
    ):  # elsewhere the size is not known, or the limit is not enforced
        pages = int(Path("/proc/self/statm").read_bytes().split()[0])
        most = pages * os.sysconf("SC_PAGE_SIZE") + READER_MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _limit_time() -> None:
    """Set the limit of processor time to `READER_CPU` seconds from now on: RLIMIT_CPU counts from the child's
    start."""
    if sys.platform != "win32" and platform_has.POSIX:
        _, most = resource.getrlimit(resource.RLIMIT_CPU)
        resource.setrlimit(resource.RLIMIT_CPU, (int(time.process_time()) + 1 + READER_CPU, most))
