"""Processes that a program left behind without a mark: Linux makes them children of this process, which ends
them.

A process whose parent has ended goes to the nearest ancestor that asked for it (PR_SET_CHILD_SUBREAPER,
prctl(2)), otherwise to the system's first process. Some processes clear their environment, begin a session
of their own and lose their parent. They are still known: they are children of this process that it did not
start. This works only in a process that runs one program at a time, and nothing else.
"""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

from simmer_tui import platform_has
from simmer_tui.links.processes import StatField, children, stat_of
from simmer_tui.program.keeper import KEEPER, MARK

_SET_CHILD_SUBREAPER = 36
"""Option of prctl (linux/prctl.h)."""


class Adoption:
    """Adopts processes that a program leaves behind, from before its start until `end`. Does nothing except
    on Linux."""

    def __init__(self, mark: str) -> None:
        """`mark` is that of the program (`MARK`)."""
        self._mark = mark.encode()
        self._program = 0
        self._since = 0
        self._is_on = _adopt(is_on=True)

    def begin(self, program: int) -> None:
        """Take note of the program's process ID and start time."""
        with contextlib.suppress(OSError):  # no /proc: `living` will find nothing there either
            self._program, self._since = program, int(stat_of(program)[StatField.STARTED])

    def nothing_left(self) -> bool:
        """True if the keeper is the only child of this process: all that the program started has ended.

        The check takes some microseconds; a search of all processes takes milliseconds.
        """
        try:
            return self._is_on and [_mark_of(pid) for pid in children()] == [KEEPER.encode()]
        except OSError:
            return False

    def living(self) -> set[int]:
        """Adopted processes that live. Ended ones are reaped."""
        if sys.platform == "win32":
            raise NotImplementedError  # there is no such thing on Windows
        found: dict[int, int] = {}
        others, ended = [], []
        for pid in children():
            try:
                fields = stat_of(pid)
                started = int(fields[StatField.STARTED])
                if pid == self._program or int(fields[StatField.SESSION]) == os.getsid(0):
                    continue
                if fields[StatField.STATE] == b"Z":
                    ended.append(pid)
                    continue
                mark = _mark_of(pid)
            except OSError:
                continue  # it has ended meanwhile, or is another user's
            if mark is None:
                found[pid] = started
            elif mark not in (self._mark, KEEPER.encode()):
                others.append(started)  # another program of ours: processes started after it may be its own
        if not others:
            for pid in ended:
                with contextlib.suppress(ChildProcessError):
                    os.waitpid(pid, os.WNOHANG)
        first = min(others, default=sys.maxsize)
        return {pid for pid, started in found.items() if self._program and self._since <= started < first}

    def end(self) -> None:
        """Stop adopting."""
        _adopt(is_on=False)


def _adopt(*, is_on: bool) -> bool:
    """Start or stop adopting; True if the system supports it."""
    if not platform_has.LINUX:
        return False
    import ctypes  # numpy has imported it already

    return bool(ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, int(is_on), 0, 0, 0) == 0)


def _mark_of(pid: int) -> bytes | None:
    """Mark of the program that started a process, if its environment has one. Raises OSError."""
    variable = f"{MARK}=".encode()
    variables = Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    return next((each[len(variable) :] for each in variables if each.startswith(variable)), None)
