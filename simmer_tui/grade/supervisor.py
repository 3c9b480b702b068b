"""Supervisor of a sandbox: adds up ten times a second what its processes take, and ends it at its limits."""

from __future__ import annotations

import threading
from collections.abc import Callable

from simmer_tui.grade.cgroup import ControlGroup
from simmer_tui.grade.usage import SandboxUsage

_EVERY = 0.1
"""Seconds between two looks. Judged: filling 500 MB takes a program longer, and more looks cost more."""


class Supervisor:
    """Watches over a sandbox from its beginning until `close`."""

    def __init__(
        self,
        usage: SandboxUsage,
        group: ControlGroup | None,
        memory: int,
        processor_time: float,
        end: Callable[[str], None],
    ) -> None:
        """`memory` in bytes is not looked at where a control group has that limit. `end` is called with the
        reason, in a thread of its own."""
        self._usage = usage
        self._group = group
        self._memory = memory
        self._processor_time = processor_time
        self._end = end
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="supervisor", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop watching."""
        self._is_over.set()
        self._thread.join()
        self._usage.close()

    def _watch(self) -> None:
        while not self._is_over.wait(_EVERY):
            reason = self._reason()
            if reason:
                self._end(reason)
                return

    def _reason(self) -> str:
        """The limit that is passed, or empty."""
        if self._group is None and self._usage.memory() > self._memory:
            return f"ended: its processes took more than {self._memory / 1e6:.0f} MB together"
        time = (self._usage if self._group is None else self._group).processor_time()
        if time > self._processor_time:
            return (
                f"ended: its processes took more than {self._processor_time:g} s of processor time together"
            )
        return ""
