"""Memory and processor time of all processes of a sandbox, and their limits (Linux).

Memory is their proportional set size, which counts a page shared by four processes as a quarter of it in each
(proc(5), smaps_rollup). Memory outside processes is added: the buffers of the sockets in their network, and
the files in folders that are in memory.

Sources: proc(5), sock_diag(7), linux/inet_diag.h, linux/unix_diag.h, linux/netlink_diag.h.
"""

from __future__ import annotations

import os
import socket
import struct
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from simmer_tui import platform_has
from simmer_tui.grade.cgroup import ControlGroup
from simmer_tui.links.owners import attributes
from simmer_tui.links.processes import StatField, children, stat_of

if sys.platform != "win32" and platform_has.POSIX:
    _TICKS, _PAGE = os.sysconf("SC_CLK_TCK"), os.sysconf("SC_PAGE_SIZE")
else:  # this module is imported there, and not used
    _TICKS, _PAGE = 100, 4096
_REQUEST, _DUMP = 20, 0x301
"""SOCK_DIAG_BY_FAMILY; NLM_F_REQUEST with NLM_F_DUMP."""
_ERROR, _DONE = 2, 3  # NLMSG_ERROR, NLMSG_DONE
_ALL = 0xFFFFFFFF  # all states of sockets, and any cookie
_RECEIVED, _SENT, _QUEUED, _OPTIONS, _BACKLOG = 0, 2, 5, 6, 7
"""Places in the figures of SK_MEMINFO: allocated to receive and to send, queued, for options, in backlog."""
_FIGURES = struct.Struct(f"={_BACKLOG + 1}I")
_ANSWER = 1 << 16  # bytes received at once
# Measured on Linux 6.18: 1,022 of an empty file, 1,031 of a folder.
_FILE = 1024
"""Kernel memory for a file in memory, bytes, besides its contents. There may be millions of files."""
_LONGEST_WAIT = 1.0
"""Time limit for an answer of the kernel, seconds; it comes at once."""


def _inet(family: int, protocol: int) -> bytes:
    return struct.pack("=BBBBI", family, protocol, 1 << 6, 0, _ALL) + bytes(48)


_SOCKETS = (
    # request, length of the message before its attributes, attribute with the memory
    *((_inet(family, protocol), 72, 7) for family in (2, 10) for protocol in (6, 17)),
    (struct.pack("=BBHIIIII", 1, 0, 0, _ALL, 0, 1 << 5, _ALL, _ALL), 16, 5),  # Unix sockets
    (struct.pack("=BBHIIII", 16, 255, 0, 0, 1, _ALL, _ALL), 28, 0),  # netlink sockets
)


@dataclass(slots=True)
class SandboxUsage:
    """Meter of the processes below one process. `sockets` is a socket of sock_diag in their network.
    `folders` of theirs are kept in memory, each with a file system of its own."""

    process: int
    sockets: socket.socket | None = None
    folders: Sequence[str] = ()
    _seen: dict[tuple[int, int], float] = field(default_factory=dict)

    def memory(self) -> int:
        """Memory in use, bytes."""
        pids = descendants(self.process)
        return sum(_memory(pid) for pid in pids) + self._buffers() + self._files(pids)

    def processor_time(self) -> float:
        """Processor time since the beginning, seconds. A process that ended between two checks counts if its
        parent waited for it."""
        living = 0.0
        for pid in descendants(self.process):
            try:
                fields = stat_of(pid)
            except OSError:
                continue
            own = int(fields[StatField.USER_TIME]) + int(fields[StatField.SYSTEM_TIME])
            waited = int(fields[StatField.CHILDREN_USER_TIME]) + int(fields[StatField.CHILDREN_SYSTEM_TIME])
            # With its start time: process numbers are reused.
            self._seen[pid, int(fields[StatField.STARTED])] = own / _TICKS
            living += (own + waited) / _TICKS
        return max(living, sum(self._seen.values()))

    def _files(self, pids: Sequence[int]) -> int:
        """Kernel memory of the files in memory, bytes, without their contents, which have a limit of their
        own."""
        if sys.platform != "linux":
            raise NotImplementedError  # there are no sandboxes here
        for pid in pids[1:]:  # the first is outside
            try:
                found = [os.statvfs(f"/proc/{pid}/root{folder}") for folder in self.folders]
            except OSError:
                continue  # it has ended
            return sum(each.f_files - each.f_ffree for each in found) * _FILE
        return 0

    def _buffers(self) -> int:
        if self.sockets is None:
            return 0
        found = 0
        for request, before, attribute in _SOCKETS:
            try:
                found += sum(_dumped(self.sockets, request, before, attribute))
            except OSError:
                continue  # this kernel does not report it
        return found

    def close(self) -> None:
        """Close the socket."""
        if self.sockets is not None:
            self.sockets.close()


def descendants(process: int) -> list[int]:
    """A process and all its descendants. All processes of a sandbox are among them: orphans become children
    of its first process."""
    found = [process]
    for pid in found:  # it grows meanwhile
        found += children(pid)
    return found


def _memory(pid: int) -> int:
    """Memory of a process, bytes; its whole resident set where the shares are not known."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_bytes().splitlines()
        return sum(int(line.split()[1]) * 1024 for line in lines if line.startswith(b"Pss:"))
    except (OSError, ValueError):
        pass
    try:
        return int(Path(f"/proc/{pid}/statm").read_bytes().split()[1]) * _PAGE
    except (OSError, ValueError, IndexError):
        return 0  # it has ended


def _dumped(link: socket.socket, request: bytes, before: int, attribute: int) -> Iterator[int]:
    """Bytes of the buffers of each socket of one kind. Raises OSError."""
    link.settimeout(_LONGEST_WAIT)
    link.send(struct.pack("=IHHII", 16 + len(request), _REQUEST, _DUMP, 0, 0) + request)
    while True:
        data, at = link.recv(_ANSWER), 0
        while at + 16 <= len(data):
            length, kind = struct.unpack_from("=IH", data, at)
            if kind in (_ERROR, _DONE) or length < 16:
                return
            yield _buffered(data[at + 16 + before : at + length], attribute)
            at += (length + 3) & ~3


def _buffered(found: bytes, wanted: int) -> int:
    for kind, payload in attributes(found):
        if kind == wanted and len(payload) >= _FIGURES.size:
            figures = _FIGURES.unpack_from(payload)
            sent = max(figures[_SENT], figures[_QUEUED])  # of TCP these are the same bytes
            return int(figures[_RECEIVED] + sent + figures[_OPTIONS] + figures[_BACKLOG])
    return 0


def tells_descendants() -> bool:
    """True if this system lists the children of a process (Linux from 4.2, as all distributions configure
    it)."""
    return Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").exists()


USAGE_PERIOD = 0.1
"""Seconds between two checks. Judged: a program needs longer to fill 500 MB, and more checks take more
time."""


@dataclass(eq=False)
class Supervisor:
    """Watches over a sandbox from its beginning until `close`. `memory` (bytes) is not checked where a
    control group has that limit. `end` is called with the reason, in a thread of its own."""

    usage: SandboxUsage
    group: ControlGroup | None
    memory: int
    processor_time: float
    end: Callable[[str], None]

    def __post_init__(self) -> None:
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="supervisor", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop watching."""
        self._is_over.set()
        self._thread.join()
        self.usage.close()

    def _watch(self) -> None:
        while not self._is_over.wait(USAGE_PERIOD):
            reason = self._reason()
            if reason:
                self.end(reason)
                return

    def _reason(self) -> str:
        """The limit that is exceeded, or empty."""
        if self.group is None and self.usage.memory() > self.memory:
            return f"ended: its processes took more than {self.memory / 1e6:.0f} MB together"
        time = (self.usage if self.group is None else self.group).processor_time()
        if time > self.processor_time:
            return f"ended: its processes took more than {self.processor_time:g} s of processor time together"
        return ""
