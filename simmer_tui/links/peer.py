"""Limits per peer: bytes per turn of the event loop, unread bytes, connections and seconds.

Every connection of every link is a `Peer`, so that none can delay another, or the end of the program. Bytes
are read in pieces, from a `ReadBudget` shared with similar peers. A peer that does not read its replies is
dropped. A peer that is to end has `CLOSING` seconds to take its last replies.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Callable

from simmer_tui.robot.program_clock import clock_of
from simmer_tui.robot.timers import LoopTimer

# Well below the 1024 descriptors that a process has by default, for two such ports.
MOST_CONNECTIONS = 128
"""Connections kept on a port that serves many at once."""
# Judged: nobody has more programs for one robot; more are a fault.
MOST_WAITING = 16
"""Connections that may wait on a port that serves one, or on a port of minor importance."""
# 8,000 replies of eight bytes: a client that far behind has stopped reading.
UNREAD_LIMIT = 64 * 1024
"""Bytes of replies waiting here for the operating system; with more a peer is dropped."""
# Some 1,000 commands of four bytes.
PIECE = 4 * 1024
"""Bytes read at once: small, so that a flood from one peer delays nothing else."""
# Judged: a client on the same network needs milliseconds; Ctrl-C must not wait for a dead one.
CLOSING = 1.0
"""Seconds within which an ending peer must have taken its last replies."""


class ReadBudget:
    """The bytes that its peers may still read together in this turn of the event loop.

    Once half of it is spent, it is full again in the next turn. Peers that found it empty then go first, in
    order.
    """

    def __init__(self, size: int, *, counted: bool = True) -> None:
        """The bytes are `counted` by the program's clock, if that is in force."""
        self._loop = asyncio.get_running_loop()
        self._clock = clock_of(self._loop) if counted else None
        self._size = self.left = size
        self._renewing = False
        self._behind: dict[Callable[[], None], None] = {}

    def spend(self, count: int) -> None:
        """Take this number of bytes from the budget."""
        if self._clock is not None:
            self._clock.received += count
        self.left -= count
        # Not after each read: a turn of the loop costs as much as a short command.
        if self.left < self._size / 2 and not self._renewing:
            self._renewing = True
            self._loop.call_soon(self._renew)

    def wait(self, callback: Callable[[], None]) -> None:
        """Call `callback` in the next turn: the budget is empty."""
        self._behind[callback] = None

    def _renew(self) -> None:
        self.left, self._renewing = self._size, False
        # Waiting peers go before new bytes, or a flood from one could block them forever.
        behind, self._behind = self._behind, {}
        for callback in behind:
            callback()


def host_of(peer: str) -> str:
    """The host of a peer, without its port, which differs from one connection to the next."""
    return peer.rpartition(":")[0]


def port_of(peer: str) -> int:
    """The port of a peer; 0 if it has none."""
    port = peer.rpartition(":")[2]
    return int(port) if port.isdecimal() else 0


class Peer:
    """One accepted connection, read and written in the event loop it is made in.

    Received bytes go to `data_received`. `eof_received` is called when the other end has closed its side, and
    `connection_lost` once, when the connection has ended.
    """

    piece = PIECE
    closing = CLOSING
    counted = True
    """True if the program's clock counts the bytes that are sent."""

    def __init__(self, sock: socket.socket, name: str, budget: ReadBudget) -> None:
        """Begin to read. Bytes are taken from `budget`."""
        self.sock = sock
        # Not the socket: for a new one the selector writes its text, with two calls of the system, twice.
        self._descriptor = sock.fileno()
        self.peer = name
        self.lost = False
        self.ended_with_error = False
        """True if it ended with an error, such as the reset of one that closed with bytes unread."""
        self._loop = asyncio.get_running_loop()
        self._clock = clock_of(self._loop) if self.counted else None
        self._remote_port = port_of(name)
        self._budget = budget
        self._unsent = bytearray()
        self._closing = False
        self._finished = False
        self._reading = False
        self._held = False
        self._eof = False
        self._deadline = LoopTimer(self._finish, self._loop)
        self._set_reading()

    # -- callbacks -----------------------------------------------------------------------------

    def data_received(self, data: bytes) -> None:
        """Take received bytes. By default they are ignored."""

    def eof_received(self) -> bool:
        """Take the end of the other side's sending. Returns True if the connection stays open for replies."""
        return False

    def connection_lost(self, error: OSError | None) -> None:
        """Take the end of the connection; the error is None if it was closed here."""

    # -- reading -------------------------------------------------------------------------------

    def hold(self, holding: bool) -> None:
        """Stop reading, or continue."""
        self._held = holding
        self._set_reading()

    def _set_reading(self) -> None:
        wanted = not (self._held or self._closing or self._finished or self._eof)
        if wanted and not self._reading:
            self._loop.add_reader(self._descriptor, self.read)
        elif self._reading and not wanted:
            self._loop.remove_reader(self._descriptor)
        self._reading = wanted

    def _catch_up(self) -> None:
        if self._reading:
            self.read()

    def read(self) -> bool:
        """Read what has arrived, within the budget of this turn. Returns True if there was anything."""
        left = self._budget.left
        if left <= 0:
            # Sockets are read level-triggered: unread bytes are reported again in the next turn.
            self._budget.wait(self._catch_up)
            return False
        try:
            data = self.sock.recv(min(self.piece, left))
        except BlockingIOError:
            return False
        except OSError as error:
            self._finish(error)
            return False
        if data:
            self._budget.spend(len(data))
            self.data_received(data)
            return True
        self._eof = True
        self._set_reading()
        if not self.eof_received():
            self.close()
        return False

    def has_left(self) -> bool:
        """True if the other end has closed and all its bytes are read."""
        return self._finished or self._next() == b""

    def has_unread(self) -> bool:
        """True if bytes or an end have come that are still unread."""
        return self._next() is not None

    def _next(self) -> bytes | None:
        """The next unread byte, or no bytes at the end; None if nothing has come."""
        try:
            return self.sock.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return None
        except OSError:
            return b""

    # -- writing -------------------------------------------------------------------------------

    def write(self, data: bytes) -> bool:
        """Send at once. Returns False if the other end has stopped reading."""
        if self._closing or self._finished:
            return True
        if self._clock is not None:
            self._clock.count_written(self._remote_port, len(data))
        # Tried at once: a reply nearly always fits, which saves a second turn of the loop.
        if not self._unsent:
            try:
                sent = self.sock.send(data)
            except BlockingIOError:
                sent = 0
            except OSError as error:
                self._finish(error)
                return True
            if sent == len(data):
                return True
            data = data[sent:]
            self._loop.add_writer(self._descriptor, self._flush)
        self._unsent += data
        return len(self._unsent) <= UNREAD_LIMIT

    def _flush(self) -> None:
        try:
            del self._unsent[: self.sock.send(self._unsent)]
        except BlockingIOError:
            return
        except OSError as error:
            self._finish(error)
            return
        if not self._unsent:
            self._loop.remove_writer(self._descriptor)
            if self._closing:
                self._finish(None)

    # -- ending --------------------------------------------------------------------------------

    def close(self) -> None:
        """Close once all written bytes have been sent, within `closing` seconds."""
        if self._closing:
            return
        self._closing = True
        self._set_reading()
        # Pending replies have `closing` seconds; received bytes are not read any more.
        if not self._unsent:
            self._finish(None)
        elif not self._finished:
            self._deadline.set_in(self.closing, None)

    def abort(self) -> None:
        """Close at once."""
        self.close()
        self._finish(None)

    def _finish(self, error: OSError | None) -> None:
        if self._finished:
            return
        self._finished = True
        self.ended_with_error = error is not None
        self._set_reading()
        if self._unsent:
            self._loop.remove_writer(self._descriptor)
            self._unsent.clear()
        self._deadline.cancel()
        self._loop.call_soon(self._end, error)  # not in the middle of a write or close

    def _end(self, error: OSError | None) -> None:
        self.lost = True
        self.sock.close()
        self.connection_lost(error)


class RefusedPeer(Peer):
    """A refused connection: it gets a clean end, not a reset, and some time to notice it."""

    def __init__(
        self, sock: socket.socket, name: str, budget: ReadBudget, on_over: Callable[[Peer], None]
    ) -> None:
        super().__init__(sock, name, budget)
        self._on_over = on_over
        self._timeout = self._loop.call_later(CLOSING, self.abort)
        with contextlib.suppress(OSError):  # it has closed already
            sock.shutdown(socket.SHUT_WR)

    def connection_lost(self, error: OSError | None) -> None:
        self._timeout.cancel()
        self._on_over(self)
