"""The TCP door of the binary dialects: one client at a time, on two ports."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Callable, Sequence

from simmer_tui.backend import Backend, Message, SimulatorBackend
from simmer_tui.engine import Engine
from simmer_tui.events import Notice, NoticeKind
from simmer_tui.links.acceptor import Acceptor
from simmer_tui.links.ports import Listener
from simmer_tui.protocol.binary import CommandReader, NumberEncoder
from simmer_tui.protocol.framing import ReplyForm
from simmer_tui.protocol.packets_reply import ReplyFormat
from simmer_tui.sim.command import Command
from simmer_tui.sim.records import Outcome

PATIENCE = 0.05
"""Seconds a newcomer waits for the client before it to leave."""
UNREAD_LIMIT = 64 * 1024
"""Bytes of replies the operating system has not taken after which a client is dropped."""
RECEIVE_SIZE = 4 * 1024
"""Bytes taken in at once: small, so that a flood from one connection holds up nothing else."""
_PROBES = (("TCP_KEEPIDLE", 30), ("TCP_KEEPALIVE", 30), ("TCP_KEEPINTVL", 10), ("TCP_KEEPCNT", 3))
QUEUE_HIGH, QUEUE_LOW = 1000, 250
"""Waiting commands at which reading from a client stops and goes on."""


class Connection(asyncio.BufferedProtocol):
    """One accepted connection. What is written before it is set up is kept till then."""

    def __init__(self, sock: socket.socket, peer: str, on_lost: Callable[[Connection], None]) -> None:
        self.sock = sock
        self.peer = peer
        self.transport: asyncio.Transport | None = None
        self.lost = False
        self._on_lost = on_lost
        self._early = bytearray()
        self._closing = False
        self._received = bytearray(RECEIVE_SIZE)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNREAD_LIMIT)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        if self._early:
            transport.write(bytes(self._early))
            self._early.clear()
        if self._closing:
            transport.close()

    def get_buffer(self, sizehint: int) -> bytearray:
        return self._received

    def buffer_updated(self, count: int) -> None:
        """Bytes nobody asked for are ignored."""

    def connection_lost(self, error: Exception | None) -> None:
        self.lost = True
        self._on_lost(self)

    def write(self, data: bytes) -> bool:
        """Send at once. Returns False if the other end has stopped reading."""
        transport = self.transport
        if transport is None:
            self._early += data
            return True
        if transport.is_closing():
            return True
        transport.write(data)
        return transport.get_write_buffer_size() <= UNREAD_LIMIT

    def close(self) -> None:
        """Close after what is written has gone out."""
        self._closing = True
        if self.transport is not None:
            self.transport.close()

    def abort(self) -> None:
        """Close at once."""
        self.close()
        if self.transport is not None:
            self.transport.abort()

    def has_left(self) -> bool:
        """Whether the other end has closed and nothing it sent is unread."""
        if self.lost:
            return True
        try:
            return self.sock.recv(1, socket.MSG_PEEK) == b""
        except BlockingIOError:
            return False
        except OSError:
            return True


class Reply(Connection):
    """A connection on the reply port. What the client sends there is ignored."""


class TurnedAway(Connection):
    """A connection that is not wanted: it gets a clean end, never a reset."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        assert self.transport is not None
        self.transport.write_eof()
        asyncio.get_running_loop().call_later(1.0, self.transport.close)


class Client(Connection):
    """The control program's connection on the command port."""

    def __init__(self, sock: socket.socket, peer: str, link: BinaryLink) -> None:
        super().__init__(sock, peer, link.client_lost)
        self._link = link
        self._reader = CommandReader(grace=link.grace)
        self._session = link.backend.open_session(answer_at_end=link.answer_at_end)
        self._timer: asyncio.TimerHandle | None = None
        self._ended = False
        self._holding = False
        self._waiting = 0
        self.replies: Connection | None = None
        """Where replies go, once the first has been routed."""
        self.commands = 0

    @property
    def ending(self) -> bool:
        """Whether it has said its last and waits for replies."""
        return self._ended

    def buffer_updated(self, count: int) -> None:
        data = bytes(self._received[:count])
        late_end = self._reader.late_end(data)
        if late_end:
            self._session.trail(late_end)
        self._submit(self._reader.receive(data))
        self._await_silence()

    def eof_received(self) -> bool:
        self._ended = True
        if self._timer is not None:
            self._timer.cancel()
        self._submit(self._reader.end())
        self._close_if_done()
        return True

    def connection_lost(self, error: Exception | None) -> None:
        self.close()
        super().connection_lost(error)

    def close(self) -> None:
        """Close after what is written has gone out; commands that wait are forgotten."""
        if self._timer is not None:
            self._timer.cancel()
        self._session.close()
        super().close()

    def _await_silence(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        quiet = self._reader.quiet
        if quiet is not None and not self._closing:
            self._timer = asyncio.get_running_loop().call_later(quiet, self._silence)

    def _silence(self) -> None:
        self._timer = None
        self._submit(self._reader.silence())

    def _submit(self, commands: list[Command]) -> None:
        self._waiting += len(commands)
        for command, sent in zip(commands, self._reader.sent, strict=True):
            self._session.submit(Message(sent, (command,), self._link.form), self._answer)
        if self._waiting > QUEUE_HIGH and not self._holding and self.transport is not None:
            self._holding = True
            self.transport.pause_reading()

    def _answer(self, outcomes: Sequence[Outcome], data: bytes | None) -> None:
        self._waiting -= 1
        self.commands += 1
        if self.replies is None:
            self.replies = self._link.reply_route(self)
        if data is None:
            data = self._link.encoder.encode(outcomes[0].reply)
        if not self.replies.write(data):
            self._link.drop(self)
            return
        if self._holding and self._waiting < QUEUE_LOW and self.transport is not None:
            self._holding = False
            self.transport.resume_reading()
        self._close_if_done()

    def _close_if_done(self) -> None:
        if self._ended and not self._waiting:
            self.close()


class BinaryLink:
    """Serves the binary dialects on a command port and a reply port.

    One client drives at a time. A second is sent away unless the first leaves within a moment.
    Replies go to the client's connection on the reply port if it has one, else back to it.
    """

    def __init__(
        self,
        engine: Engine,
        commands: Listener,
        replies: Listener,
        encoder: NumberEncoder,
        *,
        grace: float,
        answer_at_end: bool = True,
        on_client_left: Callable[[], None] = lambda: None,
        backend: Backend | None = None,
    ) -> None:
        """`backend` is the robot that clients drive, by default the engine's simulated one."""
        self.engine = engine
        self.backend = backend or SimulatorBackend(engine)
        self.encoder = encoder
        self.form = ReplyForm(ReplyFormat(encoder.reply_format), encoder.byte_order)
        self.grace = grace
        self.answer_at_end = answer_at_end
        self.client: Client | None = None
        self._on_client_left = on_client_left
        self._newcomers: list[tuple[socket.socket, str]] = []
        self._waiting_replies: list[Reply] = []
        self._loop = asyncio.get_running_loop()
        self._commands = Acceptor(commands, self._command_connection)
        self._replies = Acceptor(replies, self._reply_connection)

    def close(self) -> None:
        """Stop listening and end all connections."""
        self._commands.close()
        self._replies.close()
        if self.client is not None:
            self.client.close()
        for reply in self._waiting_replies:
            reply.close()
        for sock, _ in self._newcomers:
            sock.close()

    # -- coming --------------------------------------------------------------------------------

    def _command_connection(self, sock: socket.socket, peer: str) -> None:
        if self.client is None:
            self._admit(sock, peer)
        else:
            self._newcomers.append((sock, peer))
            self._loop.call_later(PATIENCE, self._turn_away, sock, peer)

    def _admit(self, sock: socket.socket, peer: str) -> None:
        _probe_silent_peer(sock)
        self.client = Client(sock, peer, self)
        self._commands.set_up(sock, self.client)
        self.engine.tell(Notice(NoticeKind.CONNECTED, f"client {peer} connected", peer))

    def _turn_away(self, sock: socket.socket, peer: str) -> None:
        if (sock, peer) not in self._newcomers:
            return
        client = self.client
        if client is not None and (client.ending or client.has_left()):  # the next may wait for its end
            self._loop.call_later(PATIENCE, self._turn_away, sock, peer)
            return
        self._newcomers.remove((sock, peer))
        self._commands.set_up(sock, TurnedAway(sock, peer, _nothing))
        text = f"client {peer} turned away: one program at a time drives the robot"
        self.engine.tell(Notice(NoticeKind.TURNED_AWAY, text))

    def _reply_connection(self, sock: socket.socket, peer: str) -> None:
        reply = Reply(sock, peer, self._reply_lost)
        self._waiting_replies.append(reply)
        self._replies.set_up(sock, reply)
        if self.client is not None and self.client.replies is not None:
            self._loop.call_later(PATIENCE, self._close_stray, reply)

    def _close_stray(self, reply: Reply) -> None:
        """A reply connection came too late for the client; the next one may want it."""
        client = self.client
        if reply in self._waiting_replies and client is not None and client.replies is not None:
            self._waiting_replies.remove(reply)
            reply.close()
            text = f"connection {reply.peer} on the reply port closed: it belongs to no client"
            self.engine.tell(Notice(NoticeKind.TURNED_AWAY, text))

    # -- replies -------------------------------------------------------------------------------

    def reply_route(self, client: Client) -> Connection:
        """Where a client's replies go: decided at its first reply, when all that waits on the
        reply port has been accepted."""
        self._replies.accept_waiting()
        waiting, self._waiting_replies = self._waiting_replies, []
        present = [reply for reply in waiting if not reply.has_left()]
        for reply in waiting:
            if not present or reply is not present[-1]:  # the newest is the client's own
                reply.close()
        return present[-1] if present else client

    # -- leaving -------------------------------------------------------------------------------

    def drop(self, client: Client) -> None:
        """End a client that does not read its replies."""
        text = f"client {client.peer} dropped: it does not read its replies"
        self.engine.tell(Notice(NoticeKind.FAULT, text))
        if client.replies is not None:
            client.replies.abort()
        client.abort()

    def client_lost(self, connection: Connection) -> None:
        """The command connection of a client has gone."""
        client = self.client
        if client is None or connection is not client:
            return
        self.client = None
        if client.replies is not None:
            client.replies.close()
        text = f"client {client.peer} left after {client.commands} commands"
        self.engine.tell(Notice(NoticeKind.LEFT, text, client.peer))
        self._on_client_left()
        if self._newcomers:
            self._admit(*self._newcomers.pop(0))

    def _reply_lost(self, connection: Connection) -> None:
        if connection in self._waiting_replies:
            self._waiting_replies.remove(connection)
        elif self.client is not None and self.client.replies is connection:
            self.client.close()


def _nothing(_: Connection) -> None:
    """Nobody needs to know."""


def _probe_silent_peer(sock: socket.socket) -> None:
    """Have the system find out within a minute that a client's machine is gone (a laptop shut, a
    cable pulled); it would keep others from the robot for hours."""
    for name, value in _PROBES:
        option = getattr(socket, name, None)
        if option is not None:
            with contextlib.suppress(OSError):  # known by name, unknown to an older system
                sock.setsockopt(socket.IPPROTO_TCP, option, value)
