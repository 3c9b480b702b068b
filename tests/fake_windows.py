"""Windows as far as a program is started there: a recorded fake of the calls of kernel32, and of `Popen`.

Tests of one process put it in place of what `ctypes` and `subprocess` have; runs without POSIX
(tests/posixless/sitecustomize.py) show it to the package alone. It imports nothing of the package.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

KILL_ON_CLOSE = 0x2000
"""JOB_OBJECT_LIMIT_KILL_ON_JOB_CLOSE (winnt.h)."""


class Job:
    """A job object: the processes in it, and the limits that it was given."""

    def __init__(self) -> None:
        self.processes: list[int] = []
        self.flags = 0


class FakeKernel32:
    """The calls of kernel32 that end what a program started. Each is kept, in order, with its numbers.

    Calls in `failing` fail as those of Windows do: they return 0, and do nothing.
    """

    def __init__(self, failing: Sequence[str] = ()) -> None:
        self.calls: list[tuple[object, ...]] = []
        self.open: dict[int, Job] = {}
        """The handles that were given out and not closed."""
        self._failing = failing
        self._next = 0x100

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        call = _Call(self, name)
        setattr(self, name, call)
        return call

    def do(self, name: str, given: tuple[object, ...]) -> int | None:
        """Do one call, as Windows would."""
        numbers = tuple(getattr(each, "value", each) for each in given)
        self.calls.append((name, *(each for each in numbers if isinstance(each, int))))
        if name in self._failing:
            return 0
        if name == "GetConsoleOutputCP":
            return 1252
        if name == "CreateJobObjectW":
            self._next += 4
            self.open[self._next] = Job()
            return self._next
        job = self.open[numbers[0]]  # type: ignore[index]
        if name == "SetInformationJobObject":
            kind, given_limits, size = given[1:]
            limits = given_limits._obj  # type: ignore[attr-defined]
            assert (kind, size) == (9, ctypes.sizeof(limits)), "JobObjectExtendedLimitInformation"
            job.flags = limits.basic.flags
        elif name == "AssignProcessToJobObject":
            job.processes.append(int(numbers[1]))  # type: ignore[call-overload]
        elif name == "TerminateJobObject":
            _end(job)
        elif name == "CloseHandle":
            if job.flags & KILL_ON_CLOSE:
                _end(job)
            del self.open[numbers[0]]  # type: ignore[arg-type]
        else:
            raise AssertionError(f"{name} is not called by this package")
        return 1


class _Call:
    """A function of a library of `ctypes`, whose types may be set."""

    def __init__(self, kernel: FakeKernel32, name: str) -> None:
        self._kernel = kernel
        self._name = name
        self.restype: object = None

    def __call__(self, *given: object) -> int | None:
        answer = self._kernel.do(self._name, given)
        # ctypes turns a NULL that is declared as a HANDLE into None.
        return None if self.restype is not None and not answer else answer


def _end(job: Job) -> None:
    for process in job.processes:
        with suppress(ProcessLookupError):
            os.killpg(process, signal.SIGKILL)


class FakePopen(subprocess.Popen[bytes]):
    """A process as Windows starts it: from one line, which is split by its rules, with a handle."""

    def __init__(self, command: str | list[str], **options: Any) -> None:
        assert "preexec_fn" not in options, "not on Windows"
        assert not options.get("pass_fds"), "not on Windows"
        words = split_line(command) if isinstance(command, str) else command
        options["start_new_session"] = True  # a job ends a group of processes here
        super().__init__(words, **options)
        self._handle = self.pid

    def wait(self, timeout: float | None = None) -> int:
        code = super().wait(timeout)
        return 1 if code == -signal.SIGKILL else code  # the code that the ending call names


def split_line(line: str) -> list[str]:
    """The words of a command line, by the rules of C programs of Windows for quotes and backslashes."""
    words: list[str] = []
    word, is_open, is_quoted, at = "", False, False, 0
    while at < len(line):
        slashes = len(line[at:]) - len(line[at:].lstrip("\\"))
        behind = line[at + slashes : at + slashes + 1]
        if slashes:
            # Backslashes stand for themselves, but before a quote, where each two are one.
            word += "\\" * (slashes // 2 if behind == '"' else slashes)
            is_open, at = True, at + slashes
            if behind == '"' and slashes % 2:
                word, at = word + '"', at + 1
        elif behind == '"':
            is_quoted, is_open, at = not is_quoted, True, at + 1
        elif behind in " \t" and not is_quoted:
            words += [word] if is_open else []
            word, is_open, at = "", False, at + 1
        else:
            word, is_open, at = word + behind, True, at + 1
    return words + ([word] if is_open else [])
