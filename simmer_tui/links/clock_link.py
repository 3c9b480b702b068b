"""The port of the program's clock: processes of the program report their waits, and learn when to continue.

The protocol is lines of text, with times in nanoseconds. A process sends

- `H PID TOKEN` when it begins; `PARENT.NUMBER` is the token that its parent gave it,
- `S UNTIL SENT [again]` when it sleeps and has sent `SENT` bytes to the robot,
- `W UNTIL SENT [again] [outside] [after BEGIN]` when it waits for a reply or for another process (`inf`
  without an end); with `after` it sleeps until then first, and waits if nothing was sent to it by then,
- `F` when it waits for another process that may have no clock, `G` when that wait is over,
- `B TOKEN` when it has started a process, `N TOKEN` when that has no clock,
- `Z PID` when it has seen the end of a process that has left,
- `X TEXT` when it ends because it does something that this clock cannot follow.

`again` and `outside` are those of `ProgramClock.wait`. S, W and G are answered with the time and `PORT=COUNT`
for the ports to which bytes were sent meanwhile, or with `never`. B is answered with `joined` once that
process has begun, N with `none`. `left PID` tells a parent that a process has left.
"""

from __future__ import annotations

import math
import socket

from simmer_tui.config.dialects import DialectPort
from simmer_tui.links.link import LinkContext
from simmer_tui.links.peer import MOST_CONNECTIONS, PIECE, Peer, ReadBudget
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
        self.pid = 0
        """Its process ID."""
        self.ended: set[int] = set()
        """Its processes that have left the clock."""
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
            self._join(rest)
        elif kind in ("S", "W"):
            words: list[str] = rest.split()
            begin: float | None = None
            try:
                until, sent = float(words[0]) / 1e9, int(words[1])
                if words[-2] == "after":
                    begin = float(words[-1]) / 1e9
            except (ValueError, IndexError):
                until, sent = math.nan, 0
            if not (until >= 0 and 0 <= (begin or 0.0) < math.inf):
                self.abort()
                return
            clock.wait(
                self.wait,
                until,
                listens=kind == "W",
                sent=sent,
                again="again" in words,
                outside="outside" in words,
                begin=begin,
            )
        elif kind == "F":
            clock.step_aside(self.wait)
            clock.unconfirmed -= self.ended  # it reads nothing until its wait is over
        elif kind == "G":
            self.wait.away = False
            clock.wait(self.wait, clock.now, listens=False, sent=self.wait.sent)
        elif kind in ("B", "N"):
            self._link.await_child(self, rest, has_clock=kind == "B")
        elif kind == "Z" and rest.isdecimal():
            clock.unconfirmed.discard(int(rest))
        elif kind == "X":
            # The program has written it itself, on its own output.
            clock.unfit = clock.unfit or rest.partition(NOT_FOLLOWED)[0]

    def _join(self, rest: str) -> None:
        pid, _, token = rest.partition(" ")
        self.pid = int(pid) if pid.isdecimal() else 0
        self._link.clock.join(self.wait)
        self._link.join(self, token)

    def _wake(self, now: float) -> None:
        written = "".join(f" {port}={count}" for port, count in self.wait.written.items())
        self.wait.written.clear()
        self.write(f"{round(now * 1e9)}{written}\n".encode())

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
        self._joined: set[str] = set()
        self._awaited: dict[str, _Process] = {}
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
        self.clock.unconfirmed -= process.ended
        parent = next((each for each in self._processes if each.wait is process.wait.parent), None)
        if parent is not None and not parent.wait.away:
            parent.ended.add(process.pid)
            self.clock.unconfirmed.add(process.pid)
            parent.write(f"left {process.pid}\n".encode())
        self.clock.note()

    def join(self, process: _Process, token: str) -> None:
        """Note a process that has begun, by the token that its parent gave it."""
        parent = token.partition(".")[0]
        process.wait.parent = next((each.wait for each in self._processes if str(each.pid) == parent), None)
        self._joined.add(token)
        if (waiting := self._awaited.pop(token, None)) is not None:
            waiting.write(b"joined\n")

    def await_child(self, process: _Process, token: str, *, has_clock: bool) -> None:
        """Answer a process once the process that it has started has begun, or if that has no clock."""
        if not has_clock:
            if self._awaited.pop(token, None) is not None:
                process.write(b"none\n")
        elif token in self._joined:
            process.write(b"joined\n")
        else:
            self._awaited[token] = process

    def close(self) -> None:
        """End all connections."""
        self._acceptor.close()
        for process in tuple(self._processes):
            process.close()

    def _welcome(self, sock: socket.socket, peer: str) -> None:
        if len(self._processes) >= MOST_CONNECTIONS:
            self._acceptor.refuse(sock, peer)
            return
        process = _Process(sock, peer, self)
        self._processes.add(process)
        self.clock.quiet.add(sock.fileno())
