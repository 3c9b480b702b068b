"""The place in a Python program at which the simulator ended it.

Python itself writes its stacks when it gets SIGTERM (`faulthandler`, set up by `hook/sitecustomize.py`), even
while it waits for a lock. They go into memory of this process, so no file is left behind. On Linux alone; a
program that handles SIGTERM itself, or that is no Python, has none.
"""

from __future__ import annotations

import os
import re
import weakref

from simmer_tui.program.crash_parts import frames_of, last_own
from simmer_tui.program.program_command import STACK

_LARGEST = 65536
"""Bytes of stacks that are read: a hundred threads of ten calls each."""
_CALL = re.compile(r'^\s*File "(.*)", line (\d+) in ')
_MAIN = "Current thread"


class StackDump:
    """Memory that a program writes its stacks to, and the variable that tells it where."""

    def __init__(self) -> None:
        self._memory = os.memfd_create("stacks") if hasattr(os, "memfd_create") else None
        if self._memory is not None:
            weakref.finalize(self, os.close, self._memory)

    @property
    def variables(self) -> dict[str, str]:
        """Variables of the program."""
        return {} if self._memory is None else {STACK: f"/proc/{os.getpid()}/fd/{self._memory}"}

    def place(self) -> str:
        """The last line of the program's own code on its stack (`robot.py:12`); empty if nothing came."""
        if self._memory is None:
            return ""
        os.lseek(self._memory, 0, os.SEEK_SET)
        text = os.read(self._memory, _LARGEST).decode(errors="replace")
        # The thread that got the signal, the main one, stands last; of its calls the newest stands first.
        calls = text.rpartition(_MAIN)[2].splitlines()
        return last_own(frames_of(_CALL, reversed(calls)))
