"""A viewer: one connection of a browser, which gets the page, or the news of the run.

The protocol is that of `websockets`, without its input and output. Bytes are read and written as on every
other port, within the same limits.
"""

from __future__ import annotations

import contextlib
import socket
from collections import deque
from typing import Protocol

from websockets.frames import Frame, Opcode
from websockets.http11 import Request, Response
from websockets.protocol import State
from websockets.server import ServerProtocol

from simmer_tui.links.peer import Peer, ReadBudget
from simmer_tui.web.page_access import PageRole

# A line of the console is shorter, and so is a word.
LONGEST_MESSAGE = 2048
"""Bytes of a message from a browser."""
# Headers of browsers are 1 KB, and somewhat more behind a proxy.
_BEFORE_JOINING = 16 * 1024
"""Bytes that may come before a viewer has sent its word."""
_AT_ONCE = 32 * 1024
"""Bytes given to the system at a time: less than the limit of unsent bytes of a `Peer`."""
# A frame has some hundred bytes, so these are minutes of a calm run and seconds of a flood.
LARGEST_BACKLOG = 4 * 1024 * 1024
"""Bytes of frames that may wait for a viewer, without its first recording."""
# Otherwise the system would keep megabytes for each viewer that does not read.
SEND_BUFFER = 128 * 1024
"""Bytes that the system may keep for a viewer."""
STALLED = 5.0
"""Seconds within which a viewer must have read some of its waiting bytes."""


class PageHost(Protocol):
    """Answers viewers' requests."""

    def response(self, request: Request) -> Response | None:
        """The answer to a request; None if the connection becomes a viewer's."""

    def message_received(self, viewer: Viewer, data: bytes) -> None:
        """Take a viewer's message."""

    def viewer_gone(self, viewer: Viewer) -> None:
        """Remove a connection that has ended."""


class Viewer(Peer):
    """A connection to the page's port."""

    counted = False
    # All viewers together must end before anybody waits for them.
    closing = 0.3

    def __init__(self, sock: socket.socket, name: str, budget: ReadBudget, host: PageHost) -> None:
        self._host = host
        self._protocol = ServerProtocol(max_size=LONGEST_MESSAGE)
        self._waiting: deque[bytes] = deque()
        self._written = 0
        self._waiting_bytes = 0
        self._received = 0
        self._took = 0.0
        self._ending = False
        self.role: PageRole | None = None
        """Its role, once it has said its word; None before."""
        self.is_guessing = False
        """True once it has said a wrong word."""
        with contextlib.suppress(OSError):  # it has closed already
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        super().__init__(sock, name, budget)

    # -- what comes ------------------------------------------------------------------------------

    def data_received(self, data: bytes) -> None:
        if self._ending:
            return
        self._received += len(data)
        if self.role is None and self._received > _BEFORE_JOINING:
            self.abort()
            return
        self._protocol.receive_data(data)
        for event in self._protocol.events_received():
            if isinstance(event, Request):
                self._answer(event)
            elif isinstance(event, Frame) and event.opcode is Opcode.TEXT and event.fin:
                self._host.message_received(self, bytes(event.data))
        self._send_protocol()
        # A viewer that sends is read again with the next frame: a flood delays nobody else.
        if self.role is not None and not self._ending:
            self.hold(True)

    def connection_lost(self, error: OSError | None) -> None:
        self._host.viewer_gone(self)

    def _answer(self, request: Request) -> None:
        if self._protocol.eof_sent:  # the bytes after the request were wrong
            return
        response = self._host.response(request)
        self._protocol.send_response(self._protocol.accept(request) if response is None else response)

    # -- what goes -------------------------------------------------------------------------------

    def send(self, data: bytes) -> None:
        """Send bytes as soon as the viewer takes them. They are not copied: all viewers share them."""
        if self._ending:
            return
        if not (self._waiting or self._unsent):
            self._took = self._loop.time()
        self._waiting.append(data)
        self._waiting_bytes += len(data)
        self._pump()

    def reset_backlog(self) -> None:
        """Do not count the bytes sent up to now as waiting."""
        self._waiting_bytes = 0

    def has_stalled(self) -> bool:
        """True if it does not read."""
        if not self._waiting and not self._unsent:
            return False
        return self._waiting_bytes > LARGEST_BACKLOG or self._loop.time() - self._took > STALLED

    def end(self, code: int, reason: str) -> None:
        """Close the connection, after all waiting bytes have been sent."""
        if self._protocol.state is State.OPEN:
            self._protocol.send_close(code, reason)
            self._send_protocol()
        self._end_soon()

    def _send_protocol(self) -> None:
        for data in self._protocol.data_to_send():
            if data:
                self.send(data)
            else:  # the protocol's end of the connection
                self._end_soon()

    def _end_soon(self) -> None:
        if not self._ending:
            self._ending = True
            self._loop.call_later(self.closing, self.abort)
            self._pump()

    def _pump(self) -> None:
        while self._waiting and not self._unsent and not self._finished:
            data = self._waiting[0]
            piece = data[self._written : self._written + _AT_ONCE] if len(data) > _AT_ONCE else data
            self._written += len(piece)
            if self._written == len(data):
                self._waiting.popleft()
                self._written = 0
                self._waiting_bytes = max(self._waiting_bytes - len(data), 0)
            self.write(piece)
        if self._ending and not self._waiting and not self._unsent:
            self.close()

    def _flush(self) -> None:
        before = len(self._unsent)
        super()._flush()
        if len(self._unsent) < before:
            self._took = self._loop.time()
        self._pump()


def framed(data: bytes) -> bytes:
    """A text as a frame, the same for all receivers."""
    return Frame(Opcode.TEXT, data).serialize(mask=False)
