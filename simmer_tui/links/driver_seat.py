"""Which program drives the robot of a set with a dialect: one at a time, whichever door it comes by."""

from __future__ import annotations

import socket

from simmer_tui.links.peer import host_of
from simmer_tui.links.processes import Process, ProcessLookup, session_of
from simmer_tui.program_clock import ProgramClock
from simmer_tui.sim.command import escape

NOT_SERVED = "by the program's clock only the program of --run is served"
"""The reason why others are turned away."""


class DriverSeat:
    """The right to drive. A link takes it for a program, and leaves it when that has left."""

    def __init__(self, clock: ProgramClock | None, processes: ProcessLookup | None) -> None:
        self._clock = clock
        self._processes = processes
        self._holder: object = None
        self._name = ""
        self._process: Process | None = None

    def take(self, holder: object, name: str, process: Process | None = None) -> str:
        """Take it for a program that has a name for messages; a link that has it takes it again for each
        connection. Returns the reason why it is refused, or nothing."""
        if self._holder is not None and not self._is_free_for(holder, process):
            return f"{self._name} drives the robot, and one program at a time does"
        if self._holder is not holder:
            self._process = None
        self._holder, self._name = holder, escape(name, 60)
        self._process = process or self._process
        return ""

    def take_by(self, holder: object, sock: socket.socket, peer: str, *, makes_many: bool = False) -> str:
        """The same for a connection. A program that `makes_many` is told by its process."""
        if self._is_outsider(sock, peer):
            return NOT_SERVED
        if not makes_many:
            return self.take(holder, f"client {peer}")
        known = self._process if holder is self._holder else None
        process = None if self._processes is None else self._processes.holder(sock, peer, known)
        return self.take(holder, f"client {host_of(peer)}", process)

    def _is_free_for(self, holder: object, process: Process | None) -> bool:
        """True if the seat is the same program's, or was that of one that has ended unseen."""
        before = self._process
        if before is not None and not before.lives:
            return True
        if holder is not self._holder:
            return False
        # What a program has started is in its session, and counts as the same.
        return process is None or before is None or session_of(process.pid) == session_of(before.pid)

    def leave(self, holder: object) -> None:
        """The program of a link has left."""
        if holder is self._holder:
            self._holder = self._process = None

    def _is_outsider(self, sock: socket.socket, peer: str) -> bool:
        """True if a connection is none of the program that --run started, and that alone is served. Where the
        system does not tell (other than Linux, in a sandbox), nobody is an outsider."""
        started = None if self._processes is None else self._processes.of_run
        if self._clock is None or self._processes is None or started is None:
            return False
        process = self._processes.holder(sock, peer, started)
        # The program begins a session of its own, with the number of its process.
        return process is not None and session_of(process.pid) not in (None, started.pid)
