"""A program in a job object (Windows), which ends everything in it when the simulator ends, however."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Mapping
from ctypes import wintypes
from pathlib import Path
from typing import Any

from simmer_tui.program.program_output import OutputRoute

_EXTENDED_LIMITS = 9  # JobObjectExtendedLimitInformation
_KILL_ON_CLOSE = 0x2000  # JOB_OBJECT_LIMIT_KILL_ON_JOB_CLOSE


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
    """A program in a job of its own. Has what `KeptProcess` has."""

    def __init__(
        self,
        command: str,
        environment: Mapping[str, str],
        folder: Path | None,
        route: OutputRoute,
        *,
        has_input: bool,
    ) -> None:
        """Start it; what it prints goes its `route`. Raises OSError."""
        self._process = subprocess.Popen(
            command,
            env=dict(environment),
            cwd=folder,
            stdin=None if has_input else subprocess.DEVNULL,
            stdout=route.stdout,
            stderr=route.stderr,
        )
        # Its handle is ours alone: when this process ends, Windows closes it, and the job ends.
        self._kernel: Any = ctypes.WinDLL("kernel32", use_last_error=True)  # type: ignore[attr-defined]
        self._kernel.CreateJobObjectW.restype = wintypes.HANDLE
        self._job = wintypes.HANDLE(self._kernel.CreateJobObjectW(None, None))
        limits = ExtendedLimits()
        limits.basic.flags = _KILL_ON_CLOSE
        self._kernel.SetInformationJobObject(
            self._job, _EXTENDED_LIMITS, ctypes.byref(limits), ctypes.sizeof(limits)
        )
        handle = wintypes.HANDLE(int(self._process._handle))  # type: ignore[attr-defined]
        self._kernel.AssignProcessToJobObject(self._job, handle)

    def wait(self) -> int:
        """Wait for the program's end; its exit code."""
        return self._process.wait()

    def end(self) -> None:
        """End the program and everything it started. Windows has no gentle way."""
        self._kernel.TerminateJobObject(self._job, 1)
        self._process.kill()  # where it could not be put into the job
        self._process.wait()
