"""The TCP door of the connection-per-message dialects: requests on one port, replies on another."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

from simmer_tui.backend import Backend, Message, SimulatorBackend, Talk
from simmer_tui.engine import Engine, Notice, NoticeKind
from simmer_tui.links.door import Door
from simmer_tui.links.ports import Listener
from simmer_tui.links.presence import Presence
from simmer_tui.links.tcp import Connection
from simmer_tui.protocol.framing import ReplyForm
from simmer_tui.protocol.packets import GRACE, Dialect, Request, RequestReader
from simmer_tui.protocol.packets_reply import Mailbox, Reply, ReplyFormat, encode, passed_on
from simmer_tui.sim.records import Outcome

DIRECT_DELAY = 0.05
"""Seconds after which the reply goes to a sender that has stayed, if nobody has fetched it."""
EMPTY_DELAY = 1 / 60
"""Seconds a read with nothing to fetch takes, which bounds how often a client can try."""
LONGEST_WAIT = 0.1
"""Longest that a read waits for a request being received or answered, and that a request which
has stopped coming in counts as being received."""
MOST_CONNECTIONS = 128
"""Connections kept on each of the ports."""
SILENT_AFTER = 1.0
"""Seconds after which a connection that has sent nothing is worth a line in the log."""
IDLE_LIMIT = 600.0
"""Seconds after which a connection that sends nothing more is closed."""
UNREAD_PATIENCE = 10.0
"""Seconds in which a client must have read the reply it came for."""
QUEUE_HIGH, QUEUE_LOW = 2000, 500
"""Unanswered commands at which nothing more is read, and at which it goes on."""
DRAINED = 4096
"""Bytes dropped at once of what a client sends to the reply port."""
REPORT_DELAY = 1.0
"""Seconds over which replies that nobody read are counted before they are reported."""


class Sender(Connection):
    """A connection on the request port."""

    def __init__(self, sock: socket.socket, peer: str, link: PacketLink) -> None:
        super().__init__(sock, peer, link.sender_lost)
        self._link = link
        self._reader = RequestReader(link.grace)
        self._talk: Talk = link.backend.talk(answer_at_end=link.answer_at_end)
        self._silence: asyncio.TimerHandle | None = None
        self._direct: asyncio.TimerHandle | None = None
        self._owed = 0
        self._ended = False
        self._unfetched: deque[tuple[float, Reply]] = deque()
        """Its replies in the mailbox, and when they are to be given to it here."""
        self.direct = False
        """Whether replies go back on this connection: its client reads them here."""
        self.spoken = False
        """Whether anything has come."""
        self.heard = link.loop.time()
        """When something came last, at first when it connected."""
        self._watch = link.loop.call_later(SILENT_AFTER, self._look_after)

    @property
    def receiving(self) -> bool:
        """Whether a request is just coming in, or must be about to."""
        idle = self._link.loop.time() - self.heard
        return self._reader.unfinished and idle < LONGEST_WAIT if self.spoken else idle < EMPTY_DELAY

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self.hold(self._link.holding)

    def hold(self, holding: bool) -> None:
        """Stop reading, or go on."""
        if self.transport is not None and not self.transport.is_closing():
            if holding:
                self.transport.pause_reading()
            else:
                self.transport.resume_reading()

    def buffer_updated(self, count: int) -> None:
        self.heard, self.spoken = self._link.loop.time(), True
        self._submit(self._reader.receive(bytes(self._received[:count])))
        if self._silence is not None:
            self._silence.cancel()
            self._silence = None
        quiet = self._reader.quiet
        if quiet is not None and not self._closing:
            self._silence = self._link.loop.call_later(quiet, self._fell_silent)

    def eof_received(self) -> bool:
        """The client has said its last. If it reads here, it stays until all is answered."""
        self._ended = True
        self._submit(self._reader.end())
        return self.direct and self._owed > 0

    def connection_lost(self, error: Exception | None) -> None:
        if not self._ended:
            self._ended = True
            if error is not None:
                self._link.tell_fault(f"client {self.peer} broke off: {error}")
            self._submit(self._reader.end())
        for timer in (self._silence, self._direct, self._watch):
            if timer is not None:
                timer.cancel()
        super().connection_lost(error)
        self._close_talk_if_done()

    def forget(self) -> None:
        """Ask for nothing more."""
        self._talk.close()

    def _fell_silent(self) -> None:
        self._silence = None
        self._submit(self._reader.silence())

    def _submit(self, requests: Sequence[Request]) -> None:
        for request in requests:
            self._link.note_request(self, request)
            if request.commands:
                self._owed += 1
                form = self._link.form_of(request)
                message = Message(request.data, request.commands, form)
                self._talk.submit(message, partial(self._answered, request, form.format))

    def _answered(
        self, request: Request, form: ReplyFormat, outcomes: Sequence[Outcome], data: bytes | None
    ) -> None:
        self._owed -= 1
        if data is None:
            answers = zip(request.commands, outcomes, strict=True)
            reply = encode(request.dialect, self._link.legacy_reply, answers)
        else:
            reply = passed_on(form, data)
        if not self.direct:
            self._link.post(reply)
            self._expect_to_be_read(reply)
        elif not self.lost and not self.write(reply.message()):
            self._link.tell_fault(f"client {self.peer} dropped: it does not read its replies")
            self.abort()
        self._link.note_answered(len(request.commands))
        if self._ended:
            self._close_talk_if_done()

    def _expect_to_be_read(self, reply: Reply) -> None:
        if self._ended or self.lost:
            return
        self._unfetched.append((self._link.loop.time() + DIRECT_DELAY, reply))
        if self._direct is None:
            self._direct = self._link.loop.call_later(DIRECT_DELAY, self._reply_here)

    def _reply_here(self) -> None:
        """Give the client what nobody has come to the reply port for in time."""
        self._direct = None
        mailbox, unfetched = self._link.mailbox, self._unfetched
        while unfetched and not mailbox.holds(unfetched[0][1]):
            unfetched.popleft()
        if not unfetched or self._ended:
            return
        left = unfetched[0][0] - self._link.loop.time()
        if left > 0:
            self._direct = self._link.loop.call_later(left, self._reply_here)
            return
        self.direct = True
        self.write(mailbox.withdraw([reply for _, reply in unfetched]))
        unfetched.clear()

    def _close_talk_if_done(self) -> None:
        if self._owed == 0:
            self._talk.close()
            if not self.lost:
                self.close()

    def _look_after(self) -> None:
        """Say of a connection that it is silent, and end one that stays so."""
        idle = self._link.loop.time() - self.heard
        if not self.spoken and idle < IDLE_LIMIT / 2:
            self._link.tell_fault(f"client {self.peer} has connected and sent nothing yet")
        if idle >= IDLE_LIMIT and self._owed == 0:
            self._link.tell_fault(f"client {self.peer} closed: it has sent nothing for {idle:.0f} s")
            self.close()
        else:
            self._watch = self._link.loop.call_later(max(IDLE_LIMIT - idle, SILENT_AFTER), self._look_after)


class Read:
    """A connection on the reply port that waits, briefly, for a reply: it needs no transport.

    If there is something to fetch already, it waits for what else was sent before it.
    """

    def __init__(self, sock: socket.socket, peer: str, link: PacketLink) -> None:
        self.sock = sock
        self.peer = peer
        self._link = link
        self._came = link.loop.time()
        self._timer = link.loop.call_later(EMPTY_DELAY, self._end)

    def cancel(self) -> None:
        """Wait no longer."""
        self._timer.cancel()

    def _end(self) -> None:
        left = self._came + LONGEST_WAIT - self._link.loop.time()
        if left > 0 and self._link.busy and not self._link.mailbox:
            self._timer = self._link.loop.call_later(left, self._end)
        else:
            self._link.end_read(self)


class Unread(Connection):
    """A connection on the reply port that is sent more than the system takes at once."""

    def __init__(self, sock: socket.socket, peer: str, link: PacketLink, rest: bytes) -> None:
        super().__init__(sock, peer, link.unread_lost)
        self._patience = link.loop.call_later(UNREAD_PATIENCE, self.abort)
        self.write(rest)
        self.close()

    def connection_lost(self, error: Exception | None) -> None:
        self._patience.cancel()
        super().connection_lost(error)


class PacketLink:
    """Serves the connection-per-message dialects on a request port and a reply port.

    Any number of clients, on many connections at once. Replies wait in a mailbox until someone
    reads on the reply port; a client that keeps its connection on the request port and does not
    read there gets them on that connection.
    """

    def __init__(
        self,
        engine: Engine,
        requests: Listener,
        replies: Listener,
        *,
        legacy_reply: str = "float64",
        grace: float = GRACE,
        answer_at_end: bool = False,
        idle: float = 10.0,
        on_client_left: Callable[[], None] = lambda: None,
        backend: Backend | None = None,
    ) -> None:
        """`legacy_reply` (`float64`, `float32`, `text`) is for requests without brackets. A client
        has left when nothing has come from its address for `idle` seconds. `backend` is the robot
        that clients drive, by default the engine's simulated one."""
        self.engine = engine
        self.backend = backend or SimulatorBackend(engine)
        self.legacy_reply = legacy_reply
        self.grace = grace
        self.answer_at_end = answer_at_end
        self.loop = asyncio.get_running_loop()
        self.mailbox = Mailbox()
        self.holding = False
        """Whether too much is unanswered to read any more."""
        self._forms = {
            Dialect.FRAMED: ReplyForm(ReplyFormat.FRAMED),
            Dialect.LEGACY: ReplyForm(ReplyFormat(legacy_reply)),
        }
        self._senders: set[Sender] = set()
        self._reads: dict[Read, None] = {}
        """Those that wait for a reply, the oldest first."""
        self._unread: set[Unread] = set()
        self._owed = 0
        self._dropped = 0
        self._delivering = False
        self._reply_port = replies.port
        self._presence = Presence(engine, idle, self._is_connected, on_client_left)
        self._requests = Door(requests, self._request_connection)
        self._replies = Door(replies, self._reply_connection)

    def close(self) -> None:
        """Stop listening and end all connections."""
        self._requests.close()
        self._replies.close()
        self._presence.close()
        for sender in tuple(self._senders):
            sender.forget()
            sender.close()
        for read in tuple(self._reads):
            self.end_read(read)
        for unread in tuple(self._unread):
            unread.abort()

    @property
    def busy(self) -> bool:
        """Whether a request is being received or answered."""
        return self._owed > 0 or self._receiving

    @property
    def _receiving(self) -> bool:
        return any(sender.receiving for sender in self._senders)

    # -- requests --------------------------------------------------------------------------------

    def _request_connection(self, sock: socket.socket, peer: str) -> None:
        if len(self._senders) >= MOST_CONNECTIONS:
            idlest = min(self._senders, key=lambda sender: sender.heard)
            self.tell_fault(
                f"client {idlest.peer} closed: {MOST_CONNECTIONS} connections at once are the most"
            )
            self._senders.discard(idlest)
            idlest.close()
        sender = Sender(sock, peer, self)
        self._senders.add(sender)
        self._requests.set_up(sock, sender)

    def sender_lost(self, connection: Connection) -> None:
        """A connection on the request port has ended."""
        assert isinstance(connection, Sender)
        self._senders.discard(connection)

    def form_of(self, request: Request) -> ReplyForm:
        """How a request is to be answered."""
        return self._forms[request.dialect]

    def note_request(self, sender: Sender, request: Request) -> None:
        """A request has come in whole."""
        self._presence.seen(_address(sender.peer), request=True)
        if not request.commands:
            self.tell_fault(f"client {sender.peer}: an empty request, [], gets no reply")
        self._owed += len(request.commands)
        if self._owed > QUEUE_HIGH and not self.holding:
            self._hold(True)

    def note_answered(self, count: int) -> None:
        """A request of so many commands has been answered."""
        self._owed -= count
        if self.holding and self._owed < QUEUE_LOW:
            self._hold(False)

    def _hold(self, holding: bool) -> None:
        self.holding = holding
        for sender in self._senders:
            sender.hold(holding)
        if holding:
            self._requests.pause()
        else:
            self._requests.resume()

    def _is_connected(self, address: str) -> bool:
        """Whether a client that has sent something is still connected, or waits for an answer."""
        return self._owed > 0 or any(
            sender.spoken and _address(sender.peer) == address for sender in self._senders
        )

    # -- replies ---------------------------------------------------------------------------------

    def _reply_connection(self, sock: socket.socket, peer: str) -> None:
        self._presence.seen(_address(peer))
        if self.mailbox and not self._receiving:
            self._hand_over(sock, peer)
            return
        if len(self._reads) >= MOST_CONNECTIONS:
            self.end_read(next(iter(self._reads)))
        self._reads[Read(sock, peer, self)] = None

    def end_read(self, read: Read) -> None:
        """Let a read wait no longer: it gets what there is, perhaps no bytes."""
        read.cancel()
        del self._reads[read]
        if _has_closed(read.sock):
            read.sock.close()
        else:
            self._hand_over(read.sock, read.peer)

    def _hand_over(self, sock: socket.socket, peer: str) -> None:
        """Send all that waits and close, unless the reader has broken off."""
        rest = b""
        try:
            with contextlib.suppress(BlockingIOError):
                sock.recv(DRAINED)  # what is left unread would make the end a reset
            rest = self.mailbox.take()
            with contextlib.suppress(BlockingIOError):
                rest = rest[sock.send(rest) :]
        except OSError as error:
            self.tell_fault(f"client {peer} broke off on the reply port: {error.strerror or error}")
            rest = b""
        if rest:
            unread = Unread(sock, peer, self, rest)
            self._unread.add(unread)
            self._replies.set_up(sock, unread)
        else:
            sock.close()

    def unread_lost(self, connection: Connection) -> None:
        """A reply has gone out whole, or never will."""
        assert isinstance(connection, Unread)
        self._unread.discard(connection)

    def post(self, reply: Reply) -> None:
        """Have a reply wait to be read, or give it to a read that waits for it."""
        dropped = self.mailbox.put(reply)
        if dropped:
            if not self._dropped:
                self.loop.call_later(REPORT_DELAY, self._report_dropped)
            self._dropped += dropped
        if self._reads and not self._delivering:
            self._delivering = True
            self.loop.call_soon(self._deliver)  # after the rest of what came with it

    def _deliver(self) -> None:
        self._delivering = False
        while self.mailbox and self._reads and not self._receiving:
            self.end_read(next(iter(self._reads)))

    def _report_dropped(self) -> None:
        text = f"{self._dropped} replies dropped: nobody reads them on port {self._reply_port}"
        self._dropped = 0
        self.tell_fault(text)

    def tell_fault(self, text: str) -> None:
        """Have something that went wrong noted."""
        self.engine.tell(Notice(NoticeKind.FAULT, text))


def _has_closed(sock: socket.socket) -> bool:
    """Whether the other end has closed; of one that broke off, `send` will tell."""
    try:
        return sock.recv(1, socket.MSG_PEEK) == b""
    except OSError:
        return False


def _address(peer: str) -> str:
    """The host of a peer: its ports change with every message."""
    return peer.rpartition(":")[0]
