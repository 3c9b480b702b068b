"""The processes behind local connections. Only Linux tells; where none is known, everything goes by time."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import time
from collections.abc import Collection
from dataclasses import dataclass

from simmer_tui.links.access import OwnerLookup

# Judged: two hundred processes are looked through in that time, and no command waits long for it.
LONGEST_LOOK = 0.01
"""Seconds after which the search for a process is given up."""
_STATE, _STARTED = 0, 19
"""Places of state and start time in /proc/PID/stat, counted behind the name (proc(5))."""


@dataclass(frozen=True, slots=True)
class Process:
    """A process, told from later ones of the same number by the time it was started at."""

    pid: int
    started: str

    @property
    def lives(self) -> bool:
        """True until it has ended."""
        return _process(self.pid) == self


class ProcessLookup:
    """Asks the system which process has the far socket of a connection."""

    def __init__(self) -> None:
        self._owners = OwnerLookup()

    def inode(self, sock: socket.socket, peer: str) -> int:
        """The inode of the socket at the other end, `address:port`; 0 if it is closed already, on another
        machine, or not told."""
        host, _, port = peer.rpartition(":")
        told = self._owners.ask(sock, (host, int(port)))
        return told[1] if told is not None else 0

    def holder(self, sock: socket.socket, peer: str, known: Process | None) -> Process | None:
        """The process that has the socket at the other end, or None; `known` is looked at first."""
        inode = self.inode(sock, peer)
        if not inode:
            return None
        if known is not None and inode in _sockets_of(known.pid, {inode}) and known.lives:
            return known
        pids = self.holders({inode})[inode]
        return _process(max(pids)) if pids else None

    def holders(self, inodes: Collection[int]) -> dict[int, set[int]]:
        """The process numbers that have each of these sockets, as far as they are found in time. It ends with
        the first process that has all of them."""
        found: dict[int, set[int]] = {inode: set() for inode in inodes}
        until = time.monotonic() + LONGEST_LOOK
        # The newest first: a program that has just connected was nearly always started lately.
        for pid in sorted(_own_processes(), reverse=True):
            held = _sockets_of(pid, inodes)
            for inode in held:
                found[inode].add(pid)
            if len(held) == len(found) or time.monotonic() > until:
                break
        return found

    def close(self) -> None:
        """Ask no more."""
        self._owners.close()


def _own_processes() -> list[int]:
    """The process numbers there are; none where there is no /proc."""
    try:
        return [int(name) for name in os.listdir("/proc") if name.isdigit()]  # noqa: PTH208 - names will do
    except OSError:
        return []


def _sockets_of(pid: int, inodes: Collection[int]) -> set[int]:
    """Those of some sockets that a process has; none of a process that may not be looked into."""
    names = {f"socket:[{inode}]": inode for inode in inodes}
    held = set()
    folder = f"/proc/{pid}/fd"
    with contextlib.suppress(OSError):
        for descriptor in os.listdir(folder):  # noqa: PTH208 - thousands of paths would take milliseconds
            with contextlib.suppress(OSError):  # closed meanwhile
                inode = names.get(os.readlink(f"{folder}/{descriptor}"))  # noqa: PTH115 - as above
                if inode is not None:
                    held.add(inode)
    return held


def _process(pid: int) -> Process | None:
    """The process of a number, unless it has ended."""
    if sys.platform != "linux":
        return None
    try:
        with open(f"/proc/{pid}/stat", encoding="latin-1") as file:  # noqa: PTH123 - as above
            fields = file.read().rpartition(")")[2].split()
    except OSError:
        return None
    # One that has ended and was not collected by its parent is a zombie.
    return Process(pid, fields[_STARTED]) if fields[_STATE] not in "ZX" else None
