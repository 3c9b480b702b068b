"""One processor that a thread and processes share while they take turns.

Whoever takes turns gains nothing from a second processor. Each turn would wake a sleeping one, which takes
longer than the turn: two boards are four times as fast on one. Elsewhere than on Linux nothing happens.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from simmer_tui import platform_has

_THREAD = Path("/proc/thread-self/stat")
_PROCESSOR = 36
"""Field of the thread's last processor, behind its name (man proc_pid_stat: 39 with number and name)."""
_KEPT = 0.05
"""Real seconds for which a processor is kept: then the system may move the thread elsewhere."""


class SharedProcessor:
    """The processor of one thread and of processes that it waits for."""

    def __init__(self) -> None:
        self._own: set[int] = set()
        """The thread's own processors; empty where they cannot be chosen."""
        if sys.platform == "linux" and platform_has.LINUX:
            self._own = os.sched_getaffinity(0)
        self._processor = -1
        self._is_kept = False
        """True while the thread is kept on that processor."""
        self._until = 0.0
        self._placed: tuple[int, ...] = ()

    @contextlib.contextmanager
    def turns(self, processes: tuple[int, ...]) -> Iterator[None]:
        """Keep the calling thread and these processes, by their numbers, on one processor."""
        if sys.platform != "linux" or len(self._own) < 2:
            yield
            return
        # Turns come thousands of times a second, and a choice of processors takes as long as a turn.
        if not self._is_kept or processes != self._placed:
            try:
                self._place(processes)
            except OSError:  # a container may forbid it, and the set of processors may have changed
                self._own = set()
                yield
                return
        try:
            yield
        finally:
            if time.monotonic() >= self._until:
                self.release()

    def release(self) -> None:
        """Let the thread go where the system wants it. Call it in the thread itself."""
        if sys.platform == "linux" and self._is_kept:
            self._is_kept = False
            with contextlib.suppress(OSError):
                os.sched_setaffinity(0, self._own)

    def _place(self, processes: tuple[int, ...]) -> None:
        if sys.platform != "linux":
            return
        if not self._is_kept:
            present = int(_THREAD.read_text().rpartition(")")[2].split()[_PROCESSOR])
            if present != self._processor:
                self._processor, self._placed = present, ()
            os.sched_setaffinity(0, {present})
            self._is_kept, self._until = True, time.monotonic() + _KEPT
        if processes != self._placed:
            self._placed = processes
            for each in processes:
                with contextlib.suppress(ProcessLookupError):  # its end is told where it is read
                    os.sched_setaffinity(each, {self._processor})
