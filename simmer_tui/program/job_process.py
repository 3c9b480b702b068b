"""A program in a job object (Windows), which ends all its processes when the simulator ends, in any way."""

from __future__ import annotations

import ctypes
import subprocess
import threading
from collections.abc import Mapping
from ctypes import wintypes
from pathlib import Path
from typing import Any

from simmer_tui.program.program_command import command_line_of
from simmer_tui.program.program_output import OutputRoute

_EXTENDED_LIMITS = 9  # JobObjectExtendedLimitInformation
_KILL_ON_CLOSE = 0x2000  # JOB_OBJECT_LIMIT_KILL_ON_JOB_CLOSE


def _kernel() -> Any:
    """kernel32, whose last error is kept for `ctypes`."""
    library: Any = ctypes  # only Windows' ctypes has WinDLL, which type checkers of other systems report
    kernel = library.WinDLL("kernel32", use_last_error=True)
    kernel.CreateJobObjectW.restype = wintypes.HANDLE
    return kernel


def console_code_page() -> int:
    """Code page that the console reads bytes in."""
    return int(_kernel().GetConsoleOutputCP())


class BasicLimits(ctypes.Structure):
    """JOBOBJECT_BASIC_LIMIT_INFORMATION."""

    _fields_ = (
        ("per_process_user_time", ctypes.c_int64),
        ("per_job_user_time", ctypes.c_int64),
        ("flags", ctypes.c_uint32),
        ("minimum_working_set", ctypes.c_size_t),
        ("maximum_working_set", ctypes.c_size_t),
        ("active_processes", ctypes.c_uint32),
        ("affinity", ctypes.c_size_t),
        ("priority_class", ctypes.c_uint32),
        ("scheduling_class", ctypes.c_uint32),
    )


class ExtendedLimits(ctypes.Structure):
    """JOBOBJECT_EXTENDED_LIMIT_INFORMATION."""

    _fields_ = (
        ("basic", BasicLimits),
        ("io_counters", ctypes.c_uint64 * 6),
        ("process_memory", ctypes.c_size_t),
        ("job_memory", ctypes.c_size_t),
        ("peak_process_memory", ctypes.c_size_t),
        ("peak_job_memory", ctypes.c_size_t),
    )


class JobProcess:
    """A program in a job of its own, with the methods of `KeptProcess`."""

    def __init__(
        self,
        command: str,
        environment: Mapping[str, str],
        folder: Path | None,
        route: OutputRoute,
        *,
        has_input: bool,
    ) -> None:
        """Start it; its output takes its `route`. Raises OSError, ProgramError."""
        line = command_line_of(command)
        self._lock = threading.Lock()
        self._kernel = _kernel()
        # Made before the program starts, so that the program is in the job as soon as possible.
        self._job = self._new_job()
        try:
            self._process = subprocess.Popen(
                line,
                env=dict(environment),
                cwd=folder,
                stdin=None if has_input else subprocess.DEVNULL,
                stdout=route.stdout,
                stderr=route.stderr,
            )
        except BaseException:
            self._close_job()
            raise
        if self._job is not None:
            process: Any = self._process
            handle = wintypes.HANDLE(int(process._handle))
            if not self._kernel.AssignProcessToJobObject(self._job, handle):
                self._close_job()  # a job around ours forbids it: at least the program itself is ended

    def _new_job(self) -> wintypes.HANDLE | None:
        """A job that ends its processes when its last handle is closed; None if the system gives none."""
        # Only we have the handle: when this process ends, Windows closes it, and the job ends.
        number = self._kernel.CreateJobObjectW(None, None)
        if not number:
            return None
        job = wintypes.HANDLE(number)
        limits = ExtendedLimits()
        limits.basic.flags = _KILL_ON_CLOSE
        self._kernel.SetInformationJobObject(
            job, _EXTENDED_LIMITS, ctypes.byref(limits), ctypes.sizeof(limits)
        )
        return job

    def _close_job(self) -> None:
        if self._job is not None:
            self._kernel.CloseHandle(self._job)
            self._job = None

    @property
    def pid(self) -> int:
        """Its process ID."""
        return self._process.pid

    def wait(self) -> int:
        """Wait for the program's end. Returns its exit code."""
        return self._process.wait()

    def end(self) -> None:
        """End the program and everything it started. Windows has no SIGTERM. Any thread may call it,
        repeatedly."""
        with self._lock:
            if self._job is not None:
                self._kernel.TerminateJobObject(self._job, 1)
                self._close_job()
            self._process.kill()  # if it could not be put into the job
            self._process.wait()
