"""Limits of a program, and the kinds of sandbox."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

_MEGABYTE = 1_000_000
# Open files of a process: enough for every program of a course, too few to harm others.
_FILES = 256


class Isolation(StrEnum):
    """Kind of sandbox."""

    BWRAP = "bwrap"
    DOCKER = "docker"
    PODMAN = "podman"
    NONE = "none"


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Of one run: `time` (real) and `cpu` in seconds, `memory` (of each process) and `disk` in megabytes,
    `processes` (and threads) at a time, `output` in kilobytes kept. `logs`, in megabytes, is what logs
    of failed runs may take of all teams together."""

    time: float = 120.0
    cpu: float = 120.0
    memory: float = 2000.0
    processes: int = 64
    disk: float = 64.0
    output: float = 20.0
    logs: float = 400.0

    @property
    def disk_bytes(self) -> int:
        return int(self.disk * _MEGABYTE)

    @property
    def memory_bytes(self) -> int:
        return int(self.memory * _MEGABYTE)

    def resources(self) -> dict[str, int]:
        """The limits that the system keeps for each process, by the end of their RLIMIT_ names."""
        return {
            "CPU": max(int(self.cpu), 1),
            "AS": self.memory_bytes,
            "NPROC": self.processes,
            "FSIZE": self.disk_bytes,
            "NOFILE": _FILES,
            "CORE": 0,
        }
