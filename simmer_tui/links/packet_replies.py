"""The reply port of the connection-per-message dialects: replies wait in a mailbox until a client reads.

The messages are made in `protocol/packets.py` (`Mailbox`, `Reply.message`).
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import socket
from collections.abc import Callable
from dataclasses import dataclass

from simmer_tui.config.dialects import PACKET_REPLIES
from simmer_tui.errors import reason_of
from simmer_tui.links.link import LinkContext
from simmer_tui.links.packet_presence import Presence
from simmer_tui.links.peer import MOST_CONNECTIONS, Peer, ReadBudget, host_of, port_of
from simmer_tui.links.protocol.packets import Mailbox, Reply
from simmer_tui.robot.program_clock import clock_of
from simmer_tui.robot.timers import LoopTimer

# 64 KiB in all: a client that floods the reply port gets a reset instead.
DRAINED, DRAINS = 4096, 16
"""Bytes dropped at once of those that a client sends to the reply port, and how often."""
# Judged: one line a second, however many there are.
REPORT_DELAY = 1.0
"""Seconds for which unread replies, and connections that are closed, are counted before they are
reported."""
# simmer-python's clients read in a tight loop: without a limit they would use a whole processor.
EMPTY_DELAY = 1 / 60
"""Seconds that a read without a reply takes; it limits how often a client can try."""
# Judged: longer than a request takes that is answered at once, and not noticed by a client that polls.
LONGEST_WAIT = 0.1
"""Seconds that a read waits at most for a request being received or answered. An unfinished request counts as
being received for so long."""
# More than `CLOSING`: a merged reply of 1000 items may exceed the system's buffers.
UNREAD_TIMEOUT = 10.0
"""Seconds within which a client must have read its reply."""
# Judged: a long computation or a coffee. After a longer halt in a debugger a program asks again.
LONGEST_KEPT = 600.0
"""Seconds for which a reply is kept for its reader."""


class _Read:
    """A connection on the reply port until it is answered, or closed without bytes; it needs no transport. It
    waits for a reply only if it came while a request was under way."""

    def __init__(self, sock: socket.socket, peer: str, port: ReplyPort) -> None:
        self.sock = sock
        self.peer = peer
        self.waits = False
        """True if it is to get the next reply."""
        self.is_ready = True
        """False while its process is looked for, which cannot be found once it is answered."""
        self._port = port
        self._loop = asyncio.get_running_loop()
        self._came = self._loop.time()
        self._considering = self._loop.call_soon(self._consider)  # when all earlier ones have been accepted
        self._timer = self._loop.call_later(EMPTY_DELAY, self._end)

    def cancel(self) -> None:
        """Stop waiting."""
        self._considering.cancel()
        self._timer.cancel()

    def process_found(self) -> None:
        """Answer it, if anything has come: its process is not looked for any more."""
        self.is_ready = True
        if self in self._port.reads and self.waits:
            self._consider()

    def _consider(self) -> None:
        port = self._port
        if self.is_ready and port.mailbox and not port.receiving():
            port.answer(self)
        else:
            self.waits = bool(port.mailbox) or port.busy()

    def _end(self) -> None:
        port = self._port
        left = self._came + LONGEST_WAIT - self._loop.time()
        if self.waits and port.mailbox and (self.is_ready or left <= 0):
            port.answer(self)
        elif self.waits and left > 0 and (port.busy() or port.mailbox):
            self._timer = self._loop.call_later(left, self._end)
        else:
            port.end_empty(self)


class _Unread(Peer):
    """A connection on the reply port with a reply larger than the system takes at once."""

    closing = UNREAD_TIMEOUT

    def __init__(self, read: _Read, port: ReplyPort, rest: bytes) -> None:
        super().__init__(read.sock, read.peer, port.budget)
        self._port = port
        self.write(rest)
        self.close()

    def connection_lost(self, error: OSError | None) -> None:
        self._port.unread.discard(self)


@dataclass(eq=False)
class ReplyPort:
    """Serves the reply port from a mailbox.

    Args:
        context: The port, and the engine that tells faults.
        mailbox: Replies that wait.
        presence: The clients that read.
        budget: The bytes read in a turn of the event loop.
        receiving: True while a request is being received.
        busy: True while a request is being received or answered.
    """

    context: LinkContext
    mailbox: Mailbox
    presence: Presence
    budget: ReadBudget
    receiving: Callable[[], bool]
    busy: Callable[[], bool]

    def __post_init__(self) -> None:
        """Begin to listen. Needs a running event loop."""
        self.reads: dict[_Read, None] = {}
        """Those that are not over yet, the oldest first."""
        self.unread: set[_Unread] = set()
        """Connections to clients that have not taken all of their reply yet."""
        self._tell_fault = self.context.engine.tell_fault
        self._loop = asyncio.get_running_loop()
        self._clock = clock_of(self._loop)
        self._dropped = 0
        self._report = LoopTimer(self._report_dropped, self._loop)
        self._expiry = LoopTimer(self._expire, self._loop)
        self._delivering = False
        self._number = self.context.listeners[PACKET_REPLIES.purpose].port
        self._acceptor = self.context.accept(PACKET_REPLIES, self._welcome)

    def close(self) -> None:
        """Stop listening and end all connections."""
        self._acceptor.close()
        self._expiry.cancel()
        for read in tuple(self.reads):
            self.end_empty(read)
        for unread in tuple(self.unread):
            unread.abort()

    def _welcome(self, sock: socket.socket, peer: str) -> None:
        if len(self.reads) >= MOST_CONNECTIONS:
            self.end_empty(next(iter(self.reads)))
        read = _Read(sock, peer, self)
        self.reads[read] = None
        read.is_ready = not self.presence.read(sock, peer, read.process_found)

    def end_empty(self, read: _Read) -> None:
        """Close a read without bytes."""
        read.cancel()
        del self.reads[read]
        with contextlib.suppress(OSError):
            _has_closed(read.sock)
        read.sock.close()

    def answer(self, read: _Read) -> None:
        """Send a read everything in the mailbox and close it, unless its client has closed."""
        read.cancel()
        del self.reads[read]
        rest = b""
        try:
            # A waiting read that has closed was given up: its reply stays for the next one.
            if not (_has_closed(read.sock) and read.waits):
                rest = self.mailbox.take()
                with contextlib.suppress(BlockingIOError):
                    sent = read.sock.send(rest)
                    if self._clock is not None:
                        self._clock.count_written(port_of(read.peer), sent)
                    rest = rest[sent:]
        except OSError as error:
            self._tell_fault(f"client {read.peer} broke off on the reply port: {reason_of(error)}")
            rest = b""
        if rest and len(self.unread) < MOST_CONNECTIONS:
            self.unread.add(_Unread(read, self, rest))
        else:
            read.sock.close()

    def post(self, reply: Reply, peer: str = "") -> None:
        """Put a reply for `peer` into the mailbox, or give it to a read that waits for it."""
        dropped = self.mailbox.put(reply, host_of(peer), self._loop.time())
        if dropped:
            if not self._dropped:
                self._report.set_in(REPORT_DELAY)
            self._dropped += dropped
        if self._expiry.due == math.inf and self.mailbox:
            self._expiry.set_at(self.mailbox.oldest + LONGEST_KEPT)
        if self.reads and not self._delivering:
            self._delivering = True
            self._loop.call_soon(self._deliver)  # after the other replies to the same bytes

    def _deliver(self) -> None:
        self._delivering = False
        # The rest of a request is about to come; its reply belongs into the same message.
        if self.receiving():
            return
        waiting = [read for read in self.reads if read.waits and read.is_ready]
        for read in reversed(waiting):  # an older one may be a connection that never reads
            if not self.mailbox:
                return
            self.answer(read)

    def _report_dropped(self) -> None:
        self._tell_fault(f"{self._dropped} replies dropped: nobody reads them on port {self._number}")
        self._dropped = 0

    def _expire(self) -> None:
        """Drop the replies that nobody has read for long."""
        dropped = self.mailbox.expire(self._loop.time() - LONGEST_KEPT + EMPTY_DELAY)
        if dropped:
            self._tell_fault(f"{dropped} replies dropped: not read for {LONGEST_KEPT / 60:g} min")
        if self.mailbox:
            self._expiry.set_at(self.mailbox.oldest + LONGEST_KEPT)


def _has_closed(sock: socket.socket) -> bool:
    """True if the other end has closed its side. Raises OSError if it was reset.

    Drops what it has sent: unread bytes would turn our own end into a reset.
    """
    for _ in range(DRAINS):
        try:
            if not sock.recv(DRAINED):
                return True
        except BlockingIOError:
            return False
    return False
