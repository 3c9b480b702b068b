"""The processes behind local connections. Only Linux reports them; elsewhere clients are distinguished by
time."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import socket
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from enum import IntEnum
from itertools import chain

from msgspec import Struct

from simmer_tui import platform_has
from simmer_tui.links.owners import OwnerLookup, RemoteSocket

# The first is enough for two hundred processes, and delays no packet for long. The second is enough for two
# thousand; a client waits for it once. It is processor time: on a busy machine real time passes meanwhile.
LONGEST_LOOK, LONGEST_SEARCH = 0.01, 0.1
"""Seconds of processor time for the search of a packet's process, and of the processes of a client's
connections."""
# A search in another thread has the interpreter's lock for its own time only: without a pause the robot's
# thread waits up to 5 ms for it at each system call.
_WORK, _PAUSE = 0.0003, 0.0001
"""Seconds of processor time that a search in another thread takes at once, and seconds of its pause."""
# A client that has 500 connections is found by any of them: more in one pass only make it longer.
_AT_ONCE = 256
"""Connections looked for in one pass."""
_SOCKET = "socket:["
"""Begin of the target of /proc/PID/fd/N for a socket; its inode and a bracket follow."""

OWN_PROCESS = {"SIMMER_KEPT": "keeper"}
"""The variable of the environment by which a process is the simulator's own: it does not end with a program
that runs beside it (`program/keeper.py`, which imports nothing, has the same)."""


class StatField(IntEnum):
    """Positions in /proc/PID/stat, counted after the name: the number in proc(5), less 3. Times are in clock
    ticks; the start is counted from that of the machine."""

    STATE = 0
    SESSION = 3
    USER_TIME = 11
    SYSTEM_TIME = 12
    CHILDREN_USER_TIME = 13
    CHILDREN_SYSTEM_TIME = 14
    STARTED = 19
    ARGUMENTS_BEGIN = 45
    ARGUMENTS_END = 46


def stat_of(pid: int | str) -> list[bytes]:
    """Fields of /proc/PID/stat after the name, see `StatField`; "self" is this process. Raises OSError.

    `program/keeper.py` has its own function, because it imports nothing of this package.
    """
    with open(f"/proc/{pid}/stat", "rb") as file:  # noqa: PTH123 - thousands of paths would take milliseconds
        # The name itself may contain spaces and brackets.
        return file.read().rpartition(b") ")[2].split()


class Process(Struct, frozen=True):
    """A process. Its start time tells it apart from later processes with the same number."""

    pid: int
    started: int

    @property
    def lives(self) -> bool:
        """True until the process has ended."""
        return _process(self.pid) == self

    @property
    def age(self) -> float:
        """Seconds since its start, to a hundredth."""
        if sys.platform != "linux":  # none is known
            return math.inf
        return time.clock_gettime(time.CLOCK_BOOTTIME) - self.started / os.sysconf("SC_CLK_TCK")


class ProcessLookup:
    """Asks the system for the process that has the far socket of a connection."""

    def __init__(self) -> None:
        self._owners = OwnerLookup()
        self.of_run: Process | None = None
        """The program that was started beside the run, if there is one."""
        self._wanted: list[tuple[int, Process | None, Callable[[Process | None], None]]] = []
        self._is_searching = False

    def note_run(self, pid: int) -> None:
        """Note the program that the run has started."""
        self.of_run = _process(pid)

    def _far(self, sock: socket.socket, peer: str) -> RemoteSocket | None:
        """The socket at the other end, `address:port`, as far as the system reports it."""
        return self._owners.ask(sock, _address(peer))

    def inode(self, sock: socket.socket, peer: str) -> int:
        """The inode of the socket at the other end, `address:port`. 0 if it is closed already, on another
        machine, or not reported."""
        far = self._far(sock, peer)
        return far.inode if far is not None else 0

    def has_closed(self, sock: socket.socket, peer: str) -> bool:
        """True if the system reports that the other end, `address:port`, is closed, not only for sending."""
        far = self._far(sock, peer)
        return far is not None and not far.inode

    def unread(self, sock: socket.socket, peer: str) -> int | None:
        """Bytes that the program at the other end, `address:port`, has received and not read. None if it is
        on another machine, or not reported."""
        far = self._far(sock, peer)
        return far.unread if far is not None else None

    def user(self, sock: socket.socket, peer: str) -> int | None:
        """The user id of the other end, `address:port`. None if it is on another machine, or not reported."""
        return self._owners.owner(sock, _address(peer))

    def holder(
        self, sock: socket.socket, peer: str, known: Process | None, longest: float = LONGEST_LOOK
    ) -> Process | None:
        """The process that has the socket at the other end, or None if it is not found in `longest` seconds
        of processor time; `known` is tried first."""
        inode = self.inode(sock, peer)
        if not inode:
            return None
        if known is not None and inode in _sockets_of(known.pid, {inode}) and known.lives:
            return known
        pids = self.holders({inode}, longest)[inode]
        return _process(max(pids)) if pids else None

    def seek(
        self, sock: socket.socket, peer: str, known: Process | None, found: Callable[[Process | None], None]
    ) -> None:
        """Look for the process that has the socket at the other end, in another thread; `known` is tried
        first.

        `found` is called with it, or with None if it is not found: at once if the other end is closed or
        not reported, otherwise in the event loop that runs, in the order of the calls. One pass over all
        processes serves all connections that wait at that moment.
        """
        inode = self.inode(sock, peer)
        if not inode and not self._wanted and not self._is_searching:
            found(None)
            return
        self._wanted.append((inode, known, found))
        if not self._is_searching:
            self._is_searching = True
            asyncio.get_running_loop().call_soon(self._search)  # after the others that are accepted now

    def _search(self) -> None:
        """Begin the next pass."""
        loop = asyncio.get_running_loop()
        batch, self._wanted = self._wanted[:_AT_ONCE], self._wanted[_AT_ONCE:]
        self._is_searching = bool(batch)
        if not batch:
            return
        inodes = {inode for inode, _, _ in batch} - {0}
        known = {process for _, process, _ in batch if process is not None}
        if self.of_run is not None:
            known.add(self.of_run)

        def hand_out(search: asyncio.Future[dict[int, Process]]) -> None:
            if search.cancelled():  # the loop ends
                return
            for inode, _, found in batch:
                found(search.result().get(inode))
            self._search()

        loop.run_in_executor(None, _search, inodes, known).add_done_callback(hand_out)

    def holders(
        self, inodes: Collection[int], longest: float = LONGEST_SEARCH, first: Iterable[int] = ()
    ) -> dict[int, set[int]]:
        """The process numbers that have each of these sockets, as far as they are found in time.

        It ends with the first process that has all of them. Processes in `first` are searched before all
        others.
        """
        found: dict[int, set[int]] = {inode: set() for inode in inodes}
        until = time.thread_time() + longest
        for pid in chain(first, _newest_first()):
            held = _sockets_of(pid, inodes)
            for inode in held:
                found[inode].add(pid)
            if len(held) == len(found) or time.thread_time() > until:
                break
        return found

    def close(self) -> None:
        """Close the look-ups."""
        self._owners.close()


def _address(peer: str) -> tuple[str, int]:
    host, _, port = peer.rpartition(":")
    return host, int(port)


def session_of(pid: int) -> int | None:
    """The session of a process; None if it has ended, or the system does not report it."""
    try:
        return int(stat_of(pid)[StatField.SESSION])
    except OSError:
        return None


def children(pid: int | str = "self") -> list[int]:
    """The process numbers of the children of all threads of a process, by default this one; empty without
    /proc."""
    found: list[int] = []
    with contextlib.suppress(OSError):
        for thread in os.listdir(f"/proc/{pid}/task"):  # noqa: PTH208 - names will do
            with (
                contextlib.suppress(OSError),  # it has ended
                open(f"/proc/{pid}/task/{thread}/children", "rb") as file,  # noqa: PTH123 - as in `stat_of`
            ):
                found += map(int, file.read().split())
    return found


def _newest_first() -> Iterator[int]:
    """All process numbers, newest first; none without /proc. A program that has just connected was nearly
    always started recently."""
    with contextlib.suppress(OSError):
        yield from sorted((int(name) for name in os.listdir("/proc") if name.isdigit()), reverse=True)  # noqa: PTH208 - names will do


def _search(inodes: Collection[int], known: Iterable[Process]) -> dict[int, Process]:
    """The process that has each of these sockets, as far as they are found in `LONGEST_SEARCH` seconds of
    processor time. Known ones are tried first. In a thread of its own: it often pauses."""
    found: dict[int, Process] = {}
    left = set(inodes)
    until = time.thread_time() + LONGEST_SEARCH
    pids = dict.fromkeys(chain((process.pid for process in known if process.lives), _newest_first()))
    for pid in pids if left else ():
        held = _sockets_of(pid, left, is_polite=True)
        process = _process(pid) if held else None
        if process is not None:
            found |= dict.fromkeys(held, process)
            left -= held
        if not left or time.thread_time() > until:
            break
    return found


def _sockets_of(pid: int, inodes: Collection[int], *, is_polite: bool = False) -> set[int]:
    """The given sockets that a process has; none if the process may not be read. With `is_polite` it pauses
    for other threads."""
    held = set()
    folder = f"/proc/{pid}/fd"
    pause_at = time.thread_time() + _WORK
    with contextlib.suppress(OSError):
        for descriptor in os.listdir(folder):  # noqa: PTH208 - thousands of paths would take milliseconds
            if is_polite and time.thread_time() > pause_at:
                time.sleep(_PAUSE)
                pause_at = time.thread_time() + _WORK
            with contextlib.suppress(OSError):  # closed meanwhile
                target = os.readlink(f"{folder}/{descriptor}")  # noqa: PTH115 - as above
                if target.startswith(_SOCKET) and (inode := int(target[len(_SOCKET) : -1])) in inodes:
                    held.add(inode)
    return held


def _process(pid: int) -> Process | None:
    """The process of a number, unless it has ended."""
    if not platform_has.LINUX:
        return None
    try:
        fields = stat_of(pid)
    except OSError:
        return None
    # One that has ended and was not collected by its parent is a zombie.
    is_gone = fields[StatField.STATE] in (b"Z", b"X")
    return None if is_gone else Process(pid, int(fields[StatField.STARTED]))
