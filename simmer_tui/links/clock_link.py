"""The port of the program's clock: processes of the program report their waits, and learn when to continue.

The protocol is lines of text, with times in nanoseconds. A process sends

- `H` when it begins,
- `S UNTIL SENT` when it sleeps and has sent `SENT` bytes to the robot,
- `W UNTIL SENT` when it waits for a reply (`inf` without an end),
- `F` when it waits for another process, `G` when that wait is over,
- `X TEXT` when it ends because it does something that this clock cannot follow.

S, W and G are answered with the time and the count of all bytes sent to programs, or with `never`.
"""

from __future__ import annotations

import math
import socket

from simmer_tui.config.dialects import DialectPort
from simmer_tui.links.link import LinkContext
from simmer_tui.links.peer import MOST_WAITING, PIECE, Peer, ReadBudget
from simmer_tui.robot.program_clock import ProgramClock, ProgramWait
from simmer_tui.run.events import Event, MissionEvent, Notice, NoticeKind, Result

CLOCK = DialectPort("clock", "clock_port", 0, "")
"""The port of the clock: any free one. The program gets its number in its environment."""
_NOT_REACHED = (
    "the program's clock does not reach this program: it is not Python, or was started with -I, -E or -S"
)
NOT_FOLLOWED = ", which the program's clock cannot follow"
"""The words of the program after the name of what it did."""
# Bytes. Enough for `W 0.123456789012345678` and for a text with a path.
_LONGEST_LINE = 2000


class _Process(Peer):
    """The connection of one process."""

    counted = False

    def __init__(self, sock: socket.socket, peer: str, link: ClockLink) -> None:
        super().__init__(sock, peer, link.budget)
        self._link = link
        self._buffer = b""
        self.wait = ProgramWait(self._wake, self._stuck)

    def data_received(self, data: bytes) -> None:
        *lines, self._buffer = (self._buffer + data).split(b"\n")
        if len(self._buffer) > _LONGEST_LINE:
            self.abort()
            return
        for line in lines:
            self._take(line.decode("utf-8", "replace"))

    def _take(self, line: str) -> None:
        clock = self._link.clock
        kind, _, rest = line.partition(" ")
        if kind == "H":
            clock.join(self.wait)
        elif kind in ("S", "W"):
            try:
                until, sent = float(rest.split()[0]) / 1e9, int(rest.split()[1])
            except (ValueError, IndexError):
                until, sent = math.nan, 0
            if not until >= 0:
                self.abort()
                return
            clock.wait(self.wait, until, listens=kind == "W", sent=sent)
        elif kind == "F":
            self.wait.away = True
        elif kind == "G":
            self.wait.away = False
            self._wake(clock.time())
        elif kind == "X":
            # The program has written it itself, on its own output.
            clock.unfit = clock.unfit or rest.partition(NOT_FOLLOWED)[0]

    def _wake(self, now: float) -> None:
        self.write(f"{round(now * 1e9)} {self._link.clock.written}\n".encode())

    def _stuck(self) -> None:
        self.wait.until, self.wait.listens = None, False
        self.write(b"never\n")

    def connection_lost(self, error: OSError | None) -> None:
        self._link.lost(self)

    def _finish(self, error: OSError | None) -> None:
        self._link.clock.quiet.discard(self.sock.fileno())
        super()._finish(error)


class ClockLink:
    """Serves the program's clock to the processes of the program."""

    def __init__(self, context: LinkContext) -> None:
        assert context.clock is not None, "served only where the program's clock is in force"
        self.clock: ProgramClock = context.clock
        self.budget = ReadBudget(PIECE, counted=False)
        self.engine = context.engine
        self._processes: set[_Process] = set()
        self._acceptor = context.accept(CLOCK, self._welcome)
        context.engine.watch(self._watch)

    def _watch(self, event: Event) -> None:
        """Use the real clock if a program connects that does not use the program's clock. Freeze the clock
        when a mission has failed."""
        clock = self.clock
        if isinstance(event, Notice) and event.kind is NoticeKind.CONNECTED and not clock.reached:
            if not clock.is_real:
                self.engine.tell_fault(f"{_NOT_REACHED}. The real clock is in force: use --clock real")
                clock.unfit = _NOT_REACHED
            clock.use_real_clock()
        elif isinstance(event, MissionEvent) and event.over:
            clock.frozen = event.subject is not Result.SUCCESS

    @property
    def has_clients(self) -> bool:
        """True if a process has not ended, or its last line has not been read yet."""
        return bool(self._processes)

    def lost(self, process: _Process) -> None:
        """Remove a process that has ended."""
        self._processes.discard(process)
        self.clock.leave(process.wait)

    def close(self) -> None:
        """End all connections."""
        self._acceptor.close()
        for process in tuple(self._processes):
            process.close()

    def _welcome(self, sock: socket.socket, peer: str) -> None:
        if len(self._processes) >= MOST_WAITING:
            self._acceptor.refuse(sock, peer)
            return
        process = _Process(sock, peer, self)
        self._processes.add(process)
        self.clock.quiet.add(sock.fileno())
