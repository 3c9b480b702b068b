"""A viewer: one connection of a browser, which gets the page, or what is new of the run.

The protocol is that of `websockets`, without its input and output: bytes are read and written as on every
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

# A line of the console is shorter; so is a word.
LONGEST_MESSAGE = 2048
"""Bytes of a message from a browser."""
# Headers of browsers are 1 KB; behind a proxy some more.
_BEFORE_JOINING = 16 * 1024
"""Bytes that may come before a viewer has said its word."""
_AT_ONCE = 32 * 1024
"""Bytes handed to the system at a time: less than a `Peer` may owe."""
# A frame is some hundred bytes, so these are minutes of a calm run and seconds of a flood.
MOST_OWED = 4 * 1024 * 1024
"""Bytes of frames that may wait for a viewer, beside the recording that it began with."""
# The system would keep megabytes for each viewer that does not read.
SEND_BUFFER = 128 * 1024
"""Bytes that the system may keep for a viewer."""
STALLED = 5.0
"""Seconds in which a viewer must have taken something of what waits for it."""


class PageHost(Protocol):
    """Answers what viewers ask for."""

    def response(self, request: Request) -> Response | None:
        """The answer to a request; None if the connection is to become a viewer's."""

    def message_received(self, viewer: Viewer, data: bytes) -> None:
        """A viewer has sent a message."""

    def viewer_gone(self, viewer: Viewer) -> None:
        """A connection is no more."""


class Viewer(Peer):
    """A connection to the page's port."""

    counted = False
    # All viewers together are to end before anybody waits for them.
    closing = 0.3

    def __init__(self, sock: socket.socket, name: str, budget: ReadBudget, host: PageHost) -> None:
        self._host = host
        self._protocol = ServerProtocol(max_size=LONGEST_MESSAGE)
        self._owed: deque[bytes] = deque()
        self._written = 0
        self._owes = 0
        self._received = 0
        self._took = 0.0
        self._ending = False
        self.role: PageRole | None = None
        """Its role, once it has said its word; None before."""
        self.is_guessing = False
        """True once it has said a wrong word."""
        with contextlib.suppress(OSError):  # it has gone already
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
        # One that talks is read again with the next frame: a flood costs nobody else anything.
        if self.role is not None and not self._ending:
            self.hold(True)

    def connection_lost(self, error: OSError | None) -> None:
        self._host.viewer_gone(self)

    def _answer(self, request: Request) -> None:
        if self._protocol.eof_sent:  # what came behind the request was wrong
            return
        response = self._host.response(request)
        self._protocol.send_response(self._protocol.accept(request) if response is None else response)

    # -- what goes -------------------------------------------------------------------------------

    def owe(self, data: bytes) -> None:
        """Send bytes as soon as the viewer takes them. They are not copied: all viewers share them."""
        if self._ending:
            return
        if not (self._owed or self._unsent):
            self._took = self._loop.time()
        self._owed.append(data)
        self._owes += len(data)
        self._pump()

    def forgive(self) -> None:
        """Do not count as owed whatever it has been sent up to now."""
        self._owes = 0

    def has_stalled(self) -> bool:
        """True if it does not read what it is sent."""
        if not self._owed and not self._unsent:
            return False
        return self._owes > MOST_OWED or self._loop.time() - self._took > STALLED

    def end(self, code: int, reason: str) -> None:
        """Say good-bye, once all that it is owed is sent."""
        if self._protocol.state is State.OPEN:
            self._protocol.send_close(code, reason)
            self._send_protocol()
        self._end_soon()

    def _send_protocol(self) -> None:
        for data in self._protocol.data_to_send():
            if data:
                self.owe(data)
            else:  # the protocol's end of the connection
                self._end_soon()

    def _end_soon(self) -> None:
        if not self._ending:
            self._ending = True
            self._loop.call_later(self.closing, self.abort)
            self._pump()

    def _pump(self) -> None:
        while self._owed and not self._unsent and not self._finished:
            data = self._owed[0]
            piece = data[self._written : self._written + _AT_ONCE] if len(data) > _AT_ONCE else data
            self._written += len(piece)
            if self._written == len(data):
                self._owed.popleft()
                self._written = 0
                self._owes = max(self._owes - len(data), 0)
            self.write(piece)
        if self._ending and not self._owed and not self._unsent:
            self.close()

    def _flush(self) -> None:
        before = len(self._unsent)
        super()._flush()
        if len(self._unsent) < before:
            self._took = self._loop.time()
        self._pump()


def framed(data: bytes) -> bytes:
    """A text as a frame, the same for all who get it."""
    return Frame(Opcode.TEXT, data).serialize(mask=False)
