"""The request port of the connection-per-message dialects; replies go to another port, or back."""

from __future__ import annotations

import asyncio
import math
import socket
from collections import deque
from collections.abc import Sequence
from functools import partial

from simmer_tui.config.dialects import PACKETS
from simmer_tui.config.reply_formats import ReplyForm, ReplyFormat
from simmer_tui.links.access import RefusalNotices
from simmer_tui.links.backend import CommandBudget, Message
from simmer_tui.links.connection_doctor import ConnectionDoctor
from simmer_tui.links.driver_lock import DriverLock
from simmer_tui.links.link import LinkContext
from simmer_tui.links.packet_presence import PacketDriver, Presence
from simmer_tui.links.packet_replies import EMPTY_DELAY, LONGEST_WAIT, REPORT_DELAY, ReplyPort
from simmer_tui.links.peer import MOST_CONNECTIONS, Peer, ReadBudget, host_of
from simmer_tui.links.ports import Crowd
from simmer_tui.links.protocol.diagnosis import is_http
from simmer_tui.links.protocol.packets import (
    Mailbox,
    Reply,
    Request,
    RequestReader,
    RequestStyle,
    encode,
    passed_on,
)
from simmer_tui.robot.timers import LoopTimer
from simmer_tui.sim.records import CommandResult, Status

_TURN = 512
"""Bytes of requests read in a turn of the event loop: a hundred short ones take a millisecond or two."""
# Clients wait 40 to 300 ms before they read, but have closed their sending connection by then.
DIRECT_DELAY = 0.05
"""Seconds after which the reply goes to a sender that has stayed connected, if nobody has fetched it."""
# Judged: packet clients connect in order to send; one that does not may have hung.
SILENT_AFTER = 1.0
"""Seconds after which a connection that has sent nothing is reported in the log."""
# Judged: a robot left alone for ten minutes; forgotten connections must not fill the port.
IDLE_LIMIT = 600.0
"""Seconds after which a connection that sends nothing more is closed."""
_TOO_MANY = f"{MOST_CONNECTIONS} connections at once are the most"


class _Sender(Peer):
    """A connection on the request port."""

    def __init__(self, sock: socket.socket, peer: str, link: PacketLink, *, is_expected: bool) -> None:
        """`is_expected` is true if a request is expected at once."""
        super().__init__(sock, peer, link.budget)
        self._is_expected = is_expected
        self._link = link
        self._reader = RequestReader(link.context.settings.grace)
        self._command_budget = link.budget_of(sock, peer)
        at_end = link.context.answers_at_end(in_packets=True)
        self._session = link.engine.session(answer_at_end=at_end, lane="packets")
        self._silence = LoopTimer(lambda: self._submit(self._reader.silence()), self._loop)
        self._direct_reply = LoopTimer(self._reply_here, self._loop)
        self._on_answered = self._answered  # made once, for thousands of requests
        self._open_requests = self._open_commands = 0
        self._ended = False
        self._unfetched: deque[tuple[float, Reply]] = deque()
        """Its replies in the mailbox, and when they are to be given to it here."""
        self.direct = False
        """True if replies go back on this connection: its client reads them here."""
        self.spoken = False
        """True if anything has come."""
        self.is_probe = False
        """True if it sends a request of HTTP, which only looks for the port."""
        self.last_received = self._loop.time()
        """Time of the last received bytes, at first of the connection, by the loop's clock."""
        self._watch = LoopTimer(self._look_after, self._loop)
        self._watch.set_in(SILENT_AFTER)

    @property
    def receiving(self) -> bool:
        """True if a request is just coming in, or is expected at once."""
        # A new connection is about to send: clients connect for one message.
        if not self.spoken and not self._is_expected:
            return False
        idle = self._loop.time() - self.last_received
        return self._reader.unfinished and idle < LONGEST_WAIT if self.spoken else idle < EMPTY_DELAY

    @property
    def has_open_requests(self) -> bool:
        """True if any of its commands are not answered yet."""
        return self._open_requests > 0

    def data_received(self, data: bytes) -> None:
        if not self.spoken:
            self._link.doctor.packet_came(data)
            self.is_probe = is_http(data.decode("latin-1"))
            if not self._is_expected:
                self._link.presence.seek(self.sock, self.peer)
        self.last_received, self.spoken = self._loop.time(), True
        self._link.received(self)
        self._submit(self._reader.receive(data))
        self._silence.set_in(None if self._closing else self._reader.idle_timeout)

    def eof_received(self) -> bool:
        """Take the client's end of sending. If it reads here, it stays until all is answered."""
        self._ended = True
        self._submit(self._reader.end())
        return self.direct and self._open_requests > 0

    def connection_lost(self, error: OSError | None) -> None:
        if not self._ended:
            self._ended = True
            if error is not None:
                self._link.engine.tell_fault(f"client {self.peer} broke off: {error}")
            self._submit(self._reader.end())
        for timer in (self._silence, self._direct_reply, self._watch):
            timer.cancel()
        self._link.sender_lost(self)
        self._close_talk_if_done()

    def forget(self) -> None:
        """Drop its pending commands."""
        self._session.close()

    def _submit(self, requests: Sequence[Request]) -> None:
        for request in requests:
            self._session.driver = self._link.note_request(self, request)
            if request.commands:
                self._open_requests += 1
                self._open_commands += len(request.commands)
                form = self._link.forms[request.dialect]
                message = Message(request.data, request.commands, form)
                answered = partial(self._on_answered, request, form.format)
                self._link.context.backend.submit(message, self._session, answered, self._command_budget)
        if self._command_budget.is_exceeded and not self.lost:
            self._drop()

    def _drop(self) -> None:
        self._link.engine.drop(self.peer)
        # Its waiting commands must not block others from the same address.
        self.forget()
        self._link.note_answered(self._open_commands)
        self._open_requests = self._open_commands = 0
        self._ended = True
        self.abort()

    def _answered(
        self, request: Request, form: ReplyFormat, results: Sequence[CommandResult], data: bytes | None
    ) -> None:
        self._open_requests -= 1
        self._open_commands -= len(request.commands)
        for result in results:
            if result.status is Status.UNKNOWN:
                self._link.doctor.refused(result)
        if data is None:
            answers = zip(request.commands, results, strict=True)
            reply = encode(request.dialect, self._link.context.settings.legacy_reply, answers)
        else:
            reply = passed_on(form, data)
        if not self.direct:
            self._link.replies.post(reply, self.peer)
            self._expect_to_be_read(reply)
        elif not self.lost and not self.write(reply.message()):
            self._drop()
        self._link.note_answered(len(request.commands))
        if self._ended:
            self._close_talk_if_done()

    def _expect_to_be_read(self, reply: Reply) -> None:
        # It has closed, so that it cannot read here: its replies wait for the reply port only.
        if self._ended or self.lost:
            return
        self._unfetched.append((self._loop.time() + DIRECT_DELAY, reply))
        if self._direct_reply.due == math.inf:
            self._direct_reply.set_in(DIRECT_DELAY)

    def _reply_here(self) -> None:
        """Send the client the replies that nobody has fetched on the reply port in time."""
        mailbox, unfetched = self._link.mailbox, self._unfetched
        while unfetched and not mailbox.holds(unfetched[0][1]):
            unfetched.popleft()
        if not unfetched or self._ended or self.has_left():
            return
        left = unfetched[0][0] - self._loop.time()
        if self.has_unread():  # its end is noticed when it is read
            left = DIRECT_DELAY
        if left > 0:
            self._direct_reply.set_in(left)
            return
        self.direct = True
        self.write(mailbox.withdraw([reply for _, reply in unfetched]))
        unfetched.clear()

    def _close_talk_if_done(self) -> None:
        if self._open_requests == 0:
            self._session.close()
            if not self.lost:
                self.close()

    def _look_after(self) -> None:
        """Report a silent connection, and close one that stays silent."""
        idle = self._loop.time() - self.last_received
        if not self.spoken and idle < IDLE_LIMIT / 2:
            self._link.engine.tell_fault(f"client {self.peer} has connected and sent nothing yet")
        if idle >= IDLE_LIMIT and self._open_requests == 0:
            text = f"client {self.peer} closed: it has sent nothing for {idle:.0f} s"
            self._link.engine.tell_fault(text)
            self.close()
        else:
            self._watch.set_in(max(IDLE_LIMIT - idle, SILENT_AFTER))


class PacketLink:
    """Serves the connection-per-message dialects on a request port and a reply port.

    Any number of clients may use many connections at once. Replies wait in a mailbox until someone reads on
    the reply port. A client that keeps its request connection open, and does not read on the reply port, gets
    them on that connection.
    """

    def __init__(self, context: LinkContext) -> None:
        """Begin to listen. Needs a running event loop.

        A client has left when nothing has come from its address for `idle` seconds, a setting.
        """
        settings = context.settings
        self.context = context
        self.engine = context.engine
        self.mailbox = Mailbox()
        self.doctor = ConnectionDoctor(context.engine, context.listeners)
        self.budget = ReadBudget(_TURN)
        self.forms = {
            RequestStyle.FRAMED: ReplyForm(ReplyFormat.FRAMED),
            RequestStyle.LEGACY: ReplyForm(ReplyFormat(settings.legacy_reply)),
        }
        """Forms of the replies to requests."""
        self.senders: dict[_Sender, None] = {}
        """The open connections, the one that has been silent longest first."""
        self._arriving: dict[socket.socket, str] = {}
        """Connections whose program may not drive perhaps: its process is looked for."""
        self.unanswered = 0
        """Commands that have come in and are not answered yet."""
        self._users = context.processes if settings.any_user else None
        self._budgets: dict[tuple[str, int | None], CommandBudget] = {}
        self._lock = context.driver_lock or DriverLock()
        self._refusals = RefusalNotices(context.engine.tell)
        self.presence = Presence(context, self.mailbox, self._is_connected, self._client_left)
        self._crowded_out = 0
        self._report = LoopTimer(self._report_crowded_out, asyncio.get_running_loop())
        crowd = Crowd(MOST_CONNECTIONS, self._note_crowded_out)
        self._requests = context.accept(PACKETS, self._welcome, crowd)
        self.replies = ReplyPort(
            context, self.mailbox, self.presence, self.budget, self._is_receiving, lambda: self.busy
        )

    @property
    def has_clients(self) -> bool:
        """True if a connection for requests is open, or a request unanswered."""
        is_behind = self._requests.is_behind or bool(self._arriving)
        return bool(self.senders) or is_behind or self.unanswered > 0

    def close(self) -> None:
        """Stop listening and end all connections."""
        self._requests.close()
        self._report.cancel()
        self.presence.close()
        for sock in self._arriving:
            sock.close()
        self._arriving.clear()
        for sender in tuple(self.senders):
            sender.forget()
            sender.abort()
        self.replies.close()

    @property
    def busy(self) -> bool:
        """True if a request is being received or answered, or may wait in the system."""
        return self.unanswered > 0 or self._requests.is_behind or self._is_receiving()

    def _is_receiving(self) -> bool:
        return bool(self._arriving) or any(sender.receiving for sender in self.senders)

    def _welcome(self, sock: socket.socket, peer: str) -> None:
        if len(self.senders) + len(self._arriving) >= MOST_CONNECTIONS:
            self._make_room()
        self._arriving[sock] = peer
        decided = partial(self._decided, sock, peer, not self._requests.in_crowd)
        self._lock.acquire_by_process(self, sock, peer, decided)

    def _decided(self, sock: socket.socket, peer: str, is_expected: bool, refused: str) -> None:
        if self._arriving.pop(sock, None) is None:  # the link has been closed
            return
        if refused:
            self._requests.refuse(sock, peer)
            self._refusals.tell(f"client {peer} turned away: {refused}", refused)
            return
        self.presence.connected(peer)
        if is_expected:  # it may be closed the next moment
            self.presence.seek(sock, peer)
        self.senders[_Sender(sock, peer, self, is_expected=is_expected)] = None

    def _make_room(self) -> None:
        """Close the connection that has been silent longest: most likely its program has forgotten it.

        If all have requests, the replies of the one that is closed go to the reply port. One with unread
        bytes is closed only if all have some.
        """
        chosen = busy = unread = None
        for sender in self.senders:
            if sender.has_unread():
                unread = unread or sender
            elif sender.has_open_requests:
                busy = busy or sender
            else:
                chosen = sender
                break
        chosen = chosen or busy or unread
        if chosen is None:  # all are arriving
            return
        self._note_crowded_out(chosen.peer)
        del self.senders[chosen]
        chosen.abort()

    def _note_crowded_out(self, peer: str) -> None:
        """Report a connection that was closed for a newer one; further ones are counted for a second."""
        if self._report.due == math.inf:
            self.engine.tell_fault(f"client {peer} closed: {_TOO_MANY}")
            self._report.set_in(REPORT_DELAY)
        else:
            self._crowded_out += 1

    def _report_crowded_out(self) -> None:
        if self._crowded_out:
            self.engine.tell_fault(f"{self._crowded_out} more connections closed: {_TOO_MANY}")
            self._crowded_out = 0
            self._report.set_in(REPORT_DELAY)

    def received(self, sender: _Sender) -> None:
        """Note that something has come on a connection."""
        if sender in self.senders:
            del self.senders[sender]
            self.senders[sender] = None

    def sender_lost(self, sender: _Sender) -> None:
        """A connection on the request port has ended."""
        self.senders.pop(sender, None)
        self.presence.disconnected(sender.peer)
        self._release_lock()

    def note_request(self, sender: _Sender, request: Request) -> PacketDriver:
        """Take a complete request. Returns the owner of the velocities that it sets."""
        driver = self.presence.asked(sender.peer, counts=not sender.is_probe)
        if not request.commands:
            self.engine.tell_fault(f"client {sender.peer}: an empty request, [], gets no reply")
        self.unanswered += len(request.commands)
        return driver

    def note_answered(self, count: int) -> None:
        """Note that a request of so many commands has been answered."""
        self.unanswered -= count
        self.presence.watch_velocity()

    def budget_of(self, sock: socket.socket, peer: str) -> CommandBudget:
        """The budget of waiting commands shared by all connections of a user from one address."""
        # If no other user is admitted there is only one user.
        sender = (host_of(peer), self._users.user(sock, peer) if self._users is not None else None)
        if sender not in self._budgets:
            # Budgets without waiting commands need not be kept.
            self._budgets = {each: budget for each, budget in self._budgets.items() if budget.is_used}
            self._budgets[sender] = CommandBudget(sender[0], self.engine.tell)
        return self._budgets[sender]

    def _is_connected(self, address: str) -> bool:
        """True if a client that has sent something is still connected, or waits for an answer."""
        return self.unanswered > 0 or any(
            sender.spoken and host_of(sender.peer) == address for sender in self.senders
        )

    def _client_left(self, address: str, has_asked: bool) -> None:
        self._release_lock()
        if has_asked or self.context.probe_left is None:
            self.context.client_left()
        else:
            self.context.probe_left()

    def _release_lock(self) -> None:
        if not (self.presence.any or self.senders or self._arriving):
            self._lock.release(self)
