"""The right to drive the robot of a set with a dialect: one program at a time has it, by whichever port it
connects."""

from __future__ import annotations

import socket
from collections.abc import Callable

from simmer_tui.links.peer import host_of
from simmer_tui.links.processes import LONGEST_SEARCH, Process, ProcessLookup, session_of
from simmer_tui.robot.program_clock import ProgramClock
from simmer_tui.sim.command import cut

NOT_SERVED = "by the program's clock only the program of --run is served"
"""The reason why other programs are refused."""


class DriverLock:
    """The right to drive. A link acquires it for a program, and releases it when the program has left."""

    def __init__(self, clock: ProgramClock | None = None, processes: ProcessLookup | None = None) -> None:
        """Without `clock` and `processes` it is a lock of one link's own, which that can always acquire."""
        self.used = False
        """True once a program has driven the robot."""
        self._clock = clock
        self._processes = processes
        self._holder: object = None
        self._name = ""
        self._process: Process | None = None

    def acquire(self, holder: object, name: str, process: Process | None = None) -> str:
        """Acquire the lock for a program; `name` is for messages. Returns the reason of a refusal, or an
        empty text.

        A link that has it acquires it again for each connection.
        """
        if self._holder is not None and not self._is_free_for(holder, process):
            return f"{self._name} drives the robot, and one program at a time does"
        if self._holder is not holder:
            self._process = None
        self._holder, self._name, self.used = holder, cut(name), True
        self._process = process or self._process
        return ""

    def acquire_by_process(
        self, holder: object, sock: socket.socket, peer: str, decided: Callable[[str], None]
    ) -> None:
        """Acquire the lock for one of the many connections of a program, which is recognised by its
        process. `decided` is called with the reason of a refusal, or an empty text, in the order of the
        calls."""

        def found(process: Process | None) -> None:
            is_outsider = self._is_outsider(process)
            decided(NOT_SERVED if is_outsider else self.acquire(holder, f"client {host_of(peer)}", process))

        known = (self._process if holder is self._holder else None) or self._only_served
        if self._processes is None:
            found(None)
        elif self._clock is not None:  # a search in real time would make runs differ
            found(self._processes.holder(sock, peer, known))
        else:
            self._processes.seek(sock, peer, known, found)

    def _is_free_for(self, holder: object, process: Process | None) -> bool:
        """True if the lock is the same program's, or that of a process that has ended."""
        before = self._process
        if before is not None and not before.lives:
            return True
        if holder is not self._holder:
            return False
        # Processes that a program has started are in its session, and count as the same program.
        return process is None or before is None or session_of(process.pid) == session_of(before.pid)

    def release(self, holder: object) -> None:
        """Release the lock: the program of a link has left."""
        if holder is self._holder:
            self._holder = self._process = None

    def refusal(self, sock: socket.socket, peer: str) -> str:
        """The reason why a connection is not served: only the program of --run is, and it is not from it.
        Otherwise an empty text.

        Where the system does not report processes (other systems than Linux, a sandbox), or not within
        `LONGEST_SEARCH` seconds of processor time, everybody is served.
        """
        served = self._only_served
        if self._processes is None or served is None:
            return ""
        process = self._processes.holder(sock, peer, served, LONGEST_SEARCH)
        return NOT_SERVED if self._is_outsider(process) else ""

    @property
    def _only_served(self) -> Process | None:
        """The program of --run, if by the program's clock no other is served."""
        return None if self._clock is None or self._processes is None else self._processes.of_run

    def _is_outsider(self, process: Process | None) -> bool:
        """True for a process that is not of the program of --run, if only that is served."""
        # That program begins a session of its own, whose number is its process ID.
        served = self._only_served
        return (
            served is not None and process is not None and session_of(process.pid) not in (None, served.pid)
        )
