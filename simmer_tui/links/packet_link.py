"""The TCP ports of the connection-per-message dialects: requests on one port, replies on another."""

from __future__ import annotations

import asyncio
import contextlib
import math
import socket
from dataclasses import dataclass

from simmer_tui.backend import CommandBudget
from simmer_tui.config.dialects import PACKET_REPLIES, PACKETS
from simmer_tui.events import Notice, NoticeKind
from simmer_tui.links.access import TurnedAwayNotices
from simmer_tui.links.connection_doctor import ConnectionDoctor
from simmer_tui.links.driver_seat import NOT_SERVED
from simmer_tui.links.link import LinkContext
from simmer_tui.links.packet_connections import PacketDriver, Presence, Read, Sender, Unread, address_of
from simmer_tui.links.peer import MOST_CONNECTIONS, ReadBudget
from simmer_tui.program_clock import clock_of
from simmer_tui.protocol.packets import Mailbox, Reply, Request, RequestStyle
from simmer_tui.protocol.replies import ReplyForm, ReplyFormat

TURN = 512
"""Bytes of requests read in a turn of the event loop: a hundred short ones take a millisecond or two."""
# 64 KiB at most: a client that floods the reply port gets a reset instead.
DRAINED, DRAINS = 4096, 16
"""Bytes dropped at once of what a client sends to the reply port, and how often."""
# Judged: one line a second, however many replies are dropped.
REPORT_DELAY = 1.0
"""Seconds over which replies that nobody read are counted before they are reported."""


@dataclass(frozen=True, slots=True)
class Traffic:
    """Counts of what is in progress on the two ports."""

    connections: int
    """Connections on the request port."""
    speaking: int
    """Those of them on which something has come."""
    reads: int
    """Reads on the reply port that are not over yet."""
    unread: int
    """Replies handed to a client that has not taken all of them yet."""
    owed: int
    """Commands that have come in and are not answered yet."""


class PacketLink:
    """Serves the connection-per-message dialects on a request port and a reply port.

    Any number of clients, on many connections at once. Replies wait in a mailbox until someone
    reads on the reply port; a client that keeps its connection on the request port and does not
    read there gets them on that connection.
    """

    def __init__(self, context: LinkContext) -> None:
        """Begin to listen. Needs a running event loop. A client has left when nothing has come from its
        address for the seconds of the setting `idle`."""
        settings = context.settings
        self.engine = context.engine
        self.backend = context.backend
        self.legacy_reply = settings.legacy_reply
        self.grace = settings.grace
        # simmer-python answers drives at once: "auto" means accepted here, and done in the binary dialects.
        self.answer_at_end = context.reply == "done"
        self.loop = asyncio.get_running_loop()
        self._clock = clock_of(self.loop)
        self.mailbox = Mailbox()
        self.doctor = ConnectionDoctor(context.engine, context.listeners)
        self.budget = ReadBudget(TURN)
        self._forms = {
            RequestStyle.FRAMED: ReplyForm(ReplyFormat.FRAMED),
            RequestStyle.LEGACY: ReplyForm(ReplyFormat(settings.legacy_reply)),
        }
        self._senders: set[Sender] = set()
        self._users = context.processes if settings.any_user else None
        self._budgets: dict[tuple[str, int | None], CommandBudget] = {}
        self._reads: dict[Read, None] = {}
        """Those that are not over yet, the oldest first."""
        self._unread: set[Unread] = set()
        self._owed = 0
        self._dropped = 0
        self._delivering = False
        self._reply_port = context.listeners[PACKET_REPLIES.purpose].port
        self._on_client_left = context.client_left
        self._seat = context.seat
        self._turned_away = TurnedAwayNotices(context.engine)
        self._presence = Presence(
            context.engine, settings.idle, self._is_connected, self._client_left, self, context.processes
        )
        self._requests = context.accept(PACKETS, self._request_connection)
        self._replies = context.accept(PACKET_REPLIES, self._reply_connection)

    @property
    def has_clients(self) -> bool:
        """True if a connection for requests is open, or a request unanswered."""
        return bool(self._senders) or self._owed > 0

    def close(self) -> None:
        """Stop listening and end all connections."""
        self._requests.close()
        self._replies.close()
        self._presence.close()
        for sender in tuple(self._senders):
            sender.forget()
            sender.abort()
        for read in tuple(self._reads):
            self.end_empty(read)
        for unread in tuple(self._unread):
            unread.abort()

    @property
    def busy(self) -> bool:
        """True if a request is being received or answered."""
        return self._owed > 0 or self.receiving

    @property
    def receiving(self) -> bool:
        """True if a request is being received."""
        return any(sender.receiving for sender in self._senders)

    @property
    def traffic(self) -> Traffic:
        """Counts of what is in progress now."""
        return Traffic(
            len(self._senders),
            sum(sender.spoken for sender in self._senders),
            len(self._reads),
            len(self._unread),
            self._owed,
        )

    # -- requests --------------------------------------------------------------------------------

    def _request_connection(self, sock: socket.socket, peer: str) -> None:
        if len(self._senders) >= MOST_CONNECTIONS:
            self._make_room()
        refused = self._refused(sock, peer)
        if refused:
            self._requests.turn_away(sock, peer)
            self._turned_away.tell(f"client {peer} turned away: {refused}", refused)
            return
        self._presence.connected(sock, peer)
        self._senders.add(Sender(sock, peer, self))

    def _refused(self, sock: socket.socket, peer: str) -> str:
        """The reason why a program may not drive the robot of a set with a dialect."""
        if self._seat is None:
            return ""
        if self._seat.outsider(sock, peer):
            return NOT_SERVED
        return self._seat.take_by(self, sock, peer)

    def _make_room(self) -> None:
        """Close the connection that has been silent longest; never one that has sent what is still unread."""
        # The longest silent first: it is the likeliest to have been forgotten by its program.
        for sender in sorted(self._senders, key=lambda sender: sender.heard):
            if sender.silent:
                text = f"client {sender.peer} closed: {MOST_CONNECTIONS} connections at once are the most"
                self.tell_fault(text)
                self._senders.discard(sender)
                sender.close()
                return

    def sender_lost(self, sender: Sender) -> None:
        """A connection on the request port has ended."""
        self._senders.discard(sender)
        self._presence.disconnected(sender.peer)
        self._leave_seat()

    def form_of(self, request: Request) -> ReplyForm:
        """Form of the reply to a request."""
        return self._forms[request.dialect]

    def note_request(self, sender: Sender, request: Request) -> PacketDriver:
        """A complete request has arrived. Gives whose velocities it sets."""
        driver = self._presence.asked(sender.peer)
        if not request.commands:
            self.tell_fault(f"client {sender.peer}: an empty request, [], gets no reply")
        self._owed += len(request.commands)
        return driver

    def note_answered(self, count: int) -> None:
        """A request of so many commands has been answered."""
        self._owed -= count
        self._presence.look_after_velocity()

    def budget_of(self, sock: socket.socket, peer: str) -> CommandBudget:
        """The budget of waiting commands that all connections of a user from one address share."""
        # Where no other user is let in there is nothing to be told apart.
        sender = (address_of(peer), self._users.user(sock, peer) if self._users is not None else None)
        if sender not in self._budgets:
            # Of those who have nothing waiting nothing need be remembered.
            self._budgets = {each: budget for each, budget in self._budgets.items() if budget.is_used}
            self._budgets[sender] = CommandBudget(sender[0], self.engine.tell)
        return self._budgets[sender]

    def _is_connected(self, address: str) -> bool:
        """True if a client that has sent something is still connected, or waits for an answer."""
        return self._owed > 0 or any(
            sender.spoken and address_of(sender.peer) == address for sender in self._senders
        )

    # -- replies ---------------------------------------------------------------------------------

    def _reply_connection(self, sock: socket.socket, peer: str) -> None:
        self._presence.connected(sock, peer)
        self._presence.read(peer)
        if len(self._reads) >= MOST_CONNECTIONS:
            self.end_empty(next(iter(self._reads)))
        self._reads[Read(sock, peer, self)] = None

    def end_empty(self, read: Read) -> None:
        """Close a read without bytes."""
        read.cancel()
        del self._reads[read]
        with contextlib.suppress(OSError):
            _has_closed(read.sock)
        read.sock.close()

    def answer(self, read: Read) -> None:
        """Send a read everything in the mailbox and close it, unless its client has gone."""
        read.cancel()
        del self._reads[read]
        rest = b""
        try:
            # A read that waited and has closed was given up: its reply stays for the next one.
            if not (_has_closed(read.sock) and read.waits):
                self._presence.takes(read.peer)
                rest = self.mailbox.take()
                with contextlib.suppress(BlockingIOError):
                    sent = read.sock.send(rest)
                    if self._clock is not None:
                        self._clock.written += sent
                    rest = rest[sent:]
        except OSError as error:
            self.tell_fault(f"client {read.peer} broke off on the reply port: {error.strerror or error}")
            rest = b""
        if rest and len(self._unread) < MOST_CONNECTIONS:
            self._unread.add(Unread(read.sock, read.peer, self, rest))
        else:
            read.sock.close()

    def unread_lost(self, unread: Unread) -> None:
        """A reply has been sent completely, or its client has gone."""
        self._unread.discard(unread)

    def _client_left(self, address: str) -> None:
        """Drop what waits for a client that has left: the next program's first read is its own."""
        self.drop(address, f"client {address} left without reading them")
        self._leave_seat()
        self._on_client_left()

    def _leave_seat(self) -> None:
        if self._seat is not None and not self._presence.any and not self._senders:
            self._seat.leave(self)

    def wait_for(self, address: str, since: float = -math.inf) -> bool:
        """True if replies wait for a client of an address, those that came at a time or later."""
        return self.mailbox.has(address, since)

    def drop(self, address: str, why: str, before: float = math.inf) -> None:
        """Drop what waits for an address, or has waited since `before` a time, and say so."""
        dropped = self.mailbox.drop(address, before)
        if dropped:
            self.tell_fault(f"{dropped} replies dropped: {why}")

    def post(self, reply: Reply, peer: str = "") -> None:
        """Put a reply for `peer` into the mailbox, or hand it to a read that is waiting for it."""
        dropped = self.mailbox.put(reply, address_of(peer), self.loop.time())
        if dropped:
            if not self._dropped:
                self.loop.call_later(REPORT_DELAY, self._report_dropped)
            self._dropped += dropped
        if self._reads and not self._delivering:
            self._delivering = True
            self.loop.call_soon(self._deliver)  # after the rest of what came with it

    def _deliver(self) -> None:
        self._delivering = False
        # The rest of a request is about to come; its reply belongs into the same message.
        if self.receiving:
            return
        waiting = [read for read in self._reads if read.waits]
        for read in reversed(waiting):  # an older one may be a connection that never reads
            if not self.mailbox:
                return
            self.answer(read)

    def _report_dropped(self) -> None:
        text = f"{self._dropped} replies dropped: nobody reads them on port {self._reply_port}"
        self._dropped = 0
        self.tell_fault(text)

    def tell_fault(self, text: str) -> None:
        """Report a fault to the engine's watchers."""
        self.engine.tell(Notice(NoticeKind.FAULT, text))


def _has_closed(sock: socket.socket) -> bool:
    """True if the other end has closed its side; raises OSError if it broke off. Drops what it
    sent, which would make our own end a reset."""
    for _ in range(DRAINS):
        try:
            if not sock.recv(DRAINED):
                return True
        except BlockingIOError:
            return False
    return False
