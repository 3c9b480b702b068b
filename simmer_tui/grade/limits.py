"""The limits of a run in a grading."""

from typing import Annotated

from msgspec import Struct

from simmer_tui.sim.rules import IntegerRule, NumberRule
from simmer_tui.sim.values import Value, described
from simmer_tui.trials.trial import TIME_LIMIT

_MEGABYTE = 1_000_000
# Open files of a process: enough for every program of a course, too few to harm others.
_FILES = 256
_AMOUNT = NumberRule(0, 1e6, low_open=True)


class Limits(Struct, frozen=True, kw_only=True):
    """Limits of one run, all its processes together, and of the logs of a grading."""

    time: Annotated[
        float, Value(_AMOUNT, "real time, seconds; where motion is timed, the mission's time limit more")
    ] = TIME_LIMIT
    cpu: Annotated[float, Value(_AMOUNT, "processor time of all processes together, seconds")] = 120.0
    memory: Annotated[float, Value(_AMOUNT, "memory of all processes together, MB")] = 2000.0
    processes: Annotated[int, Value(IntegerRule(1, 10_000), "processes and threads at a time")] = 64
    disk: Annotated[float, Value(_AMOUNT, "files, in memory, gone after the run, MB")] = 64.0
    output: Annotated[float, Value(_AMOUNT, "output that is kept of a failed run, kB")] = 20.0
    logs: Annotated[float, Value(_AMOUNT, "logs of failed and of first runs, of all teams together, MB")] = (
        400.0
    )

    @property
    def disk_bytes(self) -> int:
        """Limit of the disk, bytes."""
        return int(self.disk * _MEGABYTE)

    @property
    def memory_bytes(self) -> int:
        """Limit of the memory, bytes."""
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


LIMITS = described(Limits())
"""The keys of the table `limits` of course.toml."""
