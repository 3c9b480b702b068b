"""Control groups (Linux, cgroup v2) that bound memory, processes and processors of a whole sandbox.

Source: Documentation/admin-guide/cgroup-v2.rst of the Linux kernel.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import time
from dataclasses import dataclass
from pathlib import Path

_NEEDED = ("memory", "pids", "cpu")
_PERIOD = 100_000
"""Microseconds, the kernel's usual period of cpu.max. A sandbox may use one processor: there are as many runs
at a time as processors."""
_LAST = 2.0
"""Time limit for killed processes to disappear, seconds."""
_PAUSE = 0.01
"""Seconds between two checks of a group that must become empty."""


@dataclass(frozen=True, slots=True)
class ControlGroup:
    """A group with limits, initially empty."""

    path: Path

    @property
    def entry(self) -> list[str]:
        """Words before a command that start it in the group."""
        return ["/bin/sh", "-c", 'echo 0 > "$0" && exec "$@"', str(self.path / "cgroup.procs")]

    def limit(self, memory: int, processes: int) -> None:
        """Set the limits: bytes of memory, number of processes and threads. Raises OSError."""
        values = {
            "memory.max": str(memory),
            "memory.swap.max": "0",
            "memory.oom.group": "1",
            "pids.max": str(processes),
            "cpu.max": f"{_PERIOD} {_PERIOD}",
        }
        for name, value in values.items():
            file = self.path / name
            if file.exists() or name in ("memory.max", "pids.max", "cpu.max"):  # there may be no swap
                _write(file, value)

    def processor_time(self) -> float:
        """Processor time of all its processes, seconds, those that have ended included."""
        try:
            lines = (self.path / "cpu.stat").read_text().splitlines()
        except OSError:
            return 0.0
        return next((int(line.split()[1]) / 1e6 for line in lines if line.startswith("usage_usec")), 0.0)

    def remove(self) -> None:
        """Kill all its processes, and remove the group."""
        with contextlib.suppress(OSError):  # kernels before 5.14 lack it; the sandbox has killed them as well
            _write(self.path / "cgroup.kill", "1")
        until = time.monotonic() + _LAST
        while True:
            try:
                self.path.rmdir()
            except OSError:
                if time.monotonic() < until and self.path.exists():
                    time.sleep(_PAUSE)
                    continue
            return


def _write(file: Path, value: str) -> None:
    """Write to a file that the kernel made. Raises OSError."""
    with file.open("r+") as opened:
        opened.write(value)


def made_group(places: list[Path] | None = None) -> ControlGroup | None:
    """A new group, or None where none can limit memory, processes and processors. `places` are the groups in
    which it may be made: by default ours and those above it."""
    for place in _ours() if places is None else places:
        group = ControlGroup(place / f"simmer-{os.getpid()}-{secrets.token_hex(4)}")
        with contextlib.suppress(OSError):  # it is on already, or we may not turn it on
            _write(place / "cgroup.subtree_control", " ".join(f"+{name}" for name in _NEEDED))
        try:
            group.path.mkdir()
        except OSError:
            continue
        if all((group.path / f"{name}.max").exists() for name in _NEEDED):
            return group
        group.remove()
    return None


def _ours() -> list[Path]:
    """The groups that this process is in, the innermost first."""
    try:
        mounts = [line.split() for line in Path("/proc/self/mountinfo").read_text().splitlines()]
        own = Path("/proc/self/cgroup").read_text().splitlines()
    except OSError:
        return []
    mount = next((Path(row[4]) for row in mounts if "cgroup2" in row[row.index("-") + 1 :][:1]), None)
    line = next((line for line in own if line.startswith("0::/")), None)
    if mount is None or line is None:
        return []
    inner = mount / line.removeprefix("0::/")
    return [place for place in (inner, *inner.parents) if place.is_relative_to(mount)]
