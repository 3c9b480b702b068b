"""The clients of the connection-per-message dialects: their connections, and how long they are present."""

from __future__ import annotations

import asyncio
import math
import socket
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from simmer_tui.backend import BackendSwitch, CommandBudget, Message
from simmer_tui.engine import Engine
from simmer_tui.events import Notice, NoticeKind
from simmer_tui.links.connection_doctor import ConnectionDoctor
from simmer_tui.links.peer import Peer, ReadBudget
from simmer_tui.links.processes import Process, ProcessLookup
from simmer_tui.phrases import counted
from simmer_tui.protocol.packets import Mailbox, Reply, Request, RequestReader, encode, passed_on
from simmer_tui.protocol.replies import ReplyForm, ReplyFormat
from simmer_tui.sim.records import CommandResult, Status

# Clients wait 40 to 300 ms before they read, but have closed their sending connection by then.
DIRECT_DELAY = 0.05
"""Seconds after which the reply goes to a sender that has stayed, if nobody has fetched it."""
# simmer-python's clients read in a tight loop: unbounded, they would use up a processor.
EMPTY_DELAY = 1 / 60
"""Seconds a read with nothing to fetch takes, which bounds how often a client can try."""
# Judged: longer than any request takes to be answered at once, and not felt by a client that polls.
LONGEST_WAIT = 0.1
"""Longest that a read waits for a request being received or answered, and that a request which
has stopped coming in counts as being received."""
# Judged: packet clients connect in order to send; one that does not may have hung.
SILENT_AFTER = 1.0
"""Seconds after which a connection that has sent nothing is worth a line in the log."""
# Judged: a robot left alone for ten minutes; forgotten connections must not fill the port.
IDLE_LIMIT = 600.0
"""Seconds after which a connection that sends nothing more is closed."""
# More than `CLOSING`: a merged reply of 1000 items may exceed the system's buffers.
UNREAD_PATIENCE = 10.0
"""Seconds in which a client must have read the reply it came for."""


class PostOffice(Protocol):
    """State shared by the connections of the two ports: requests in progress, and a mailbox."""

    loop: asyncio.AbstractEventLoop
    backend: BackendSwitch
    mailbox: Mailbox
    legacy_reply: str
    grace: float
    answer_at_end: bool
    budget: ReadBudget

    @property
    def engine(self) -> Engine: ...
    @property
    def busy(self) -> bool: ...
    @property
    def receiving(self) -> bool: ...
    def budget_of(self, sock: socket.socket, peer: str) -> CommandBudget: ...
    def form_of(self, request: Request) -> ReplyForm: ...
    def note_request(self, sender: Sender, request: Request) -> PacketDriver: ...
    def note_answered(self, count: int) -> None: ...
    @property
    def doctor(self) -> ConnectionDoctor: ...
    def post(self, reply: Reply, peer: str = "") -> None: ...
    def tell_fault(self, text: str) -> None: ...
    def sender_lost(self, sender: Sender) -> None: ...
    def answer(self, read: Read) -> None: ...
    def end_empty(self, read: Read) -> None: ...
    def unread_lost(self, unread: Unread) -> None: ...


class Sender(Peer):
    """A connection on the request port."""

    def __init__(self, sock: socket.socket, peer: str, link: PostOffice) -> None:
        super().__init__(sock, peer, link.budget)
        self._link = link
        self._reader = RequestReader(link.grace)
        self._command_budget = link.budget_of(sock, peer)
        self._session = link.backend.open_session(
            answer_at_end=link.answer_at_end, lane="packets", budget=self._command_budget
        )
        self._silence: asyncio.TimerHandle | None = None
        self._direct: asyncio.TimerHandle | None = None
        self._owed = self._owed_commands = 0
        self._ended = False
        self._unfetched: deque[tuple[float, Reply]] = deque()
        """Its replies in the mailbox, and when they are to be given to it here."""
        self.direct = False
        """True if replies go back on this connection: its client reads them here."""
        self.spoken = False
        """True if anything has come."""
        self.heard = link.loop.time()
        """When something came last, at first when it connected."""
        self._watch = link.loop.call_later(SILENT_AFTER, self._look_after)

    @property
    def receiving(self) -> bool:
        """True if a request is just coming in, or must be about to."""
        # A connection that has just been made is about to send: clients connect for one message.
        idle = self._link.loop.time() - self.heard
        return self._reader.unfinished and idle < LONGEST_WAIT if self.spoken else idle < EMPTY_DELAY

    @property
    def silent(self) -> bool:
        """True if nothing is owed to it, and nothing has come, not even an end, that is still to be read."""
        return not self._owed and not self.has_unread()

    def data_received(self, data: bytes) -> None:
        if not self.spoken:
            self._link.doctor.packet_came(data)
        self.heard, self.spoken = self._link.loop.time(), True
        self._submit(self._reader.receive(data))
        if self._silence is not None:
            self._silence.cancel()
            self._silence = None
        idle_timeout = self._reader.idle_timeout
        if idle_timeout is not None and not self._closing:
            self._silence = self._link.loop.call_later(idle_timeout, self._fell_silent)

    def eof_received(self) -> bool:
        """The client has said its last. If it reads here, it stays until all is answered."""
        self._ended = True
        self._submit(self._reader.end())
        return self.direct and self._owed > 0

    def connection_lost(self, error: OSError | None) -> None:
        if not self._ended:
            self._ended = True
            if error is not None:
                self._link.tell_fault(f"client {self.peer} broke off: {error}")
            self._submit(self._reader.end())
        for timer in (self._silence, self._direct, self._watch):
            if timer is not None:
                timer.cancel()
        self._link.sender_lost(self)
        self._close_talk_if_done()

    def forget(self) -> None:
        """Ask for nothing more."""
        self._session.close()

    def _fell_silent(self) -> None:
        self._silence = None
        self._submit(self._reader.silence())

    def _submit(self, requests: Sequence[Request]) -> None:
        for request in requests:
            self._session.driver = self._link.note_request(self, request)
            if request.commands:
                self._owed += 1
                self._owed_commands += len(request.commands)
                form = self._link.form_of(request)
                message = Message(request.data, request.commands, form)
                self._session.submit(message, partial(self._answered, request, form.format))
        if self._command_budget.is_hopeless and not self.lost:
            self._drop()

    def _drop(self) -> None:
        self._link.engine.drop(self.peer)
        # What it has waiting must not keep those from the same address busy.
        self.forget()
        self._link.note_answered(self._owed_commands)
        self._owed = self._owed_commands = 0
        self._ended = True
        self.abort()

    def _answered(
        self, request: Request, form: ReplyFormat, outcomes: Sequence[CommandResult], data: bytes | None
    ) -> None:
        self._owed -= 1
        self._owed_commands -= len(request.commands)
        for outcome in outcomes:
            if outcome.status is Status.UNKNOWN:
                self._link.doctor.refused(outcome)
        if data is None:
            answers = zip(request.commands, outcomes, strict=True)
            reply = encode(request.dialect, self._link.legacy_reply, answers)
        else:
            reply = passed_on(form, data)
        if not self.direct:
            self._link.post(reply, self.peer)
            self._expect_to_be_read(reply)
        elif not self.lost and not self.write(reply.message()):
            self._drop()
        self._link.note_answered(len(request.commands))
        if self._ended:
            self._close_talk_if_done()

    def _expect_to_be_read(self, reply: Reply) -> None:
        # It has closed, so that it cannot read here: its replies wait for the reply port alone.
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
        if not unfetched or self._ended or self.has_left():
            return
        left = unfetched[0][0] - self._link.loop.time()
        if self.has_unread():  # whether it has closed is known when that is read
            left = DIRECT_DELAY
        if left > 0:
            self._direct = self._link.loop.call_later(left, self._reply_here)
            return
        self.direct = True
        self.write(mailbox.withdraw([reply for _, reply in unfetched]))
        unfetched.clear()

    def _close_talk_if_done(self) -> None:
        if self._owed == 0:
            self._session.close()
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
    """A connection on the reply port until it is answered, or closed without bytes: it needs no
    transport. Only one that came while a request was under way waits for the reply."""

    def __init__(self, sock: socket.socket, peer: str, link: PostOffice) -> None:
        self.sock = sock
        self.peer = peer
        self.waits = False
        """True if it is to get the next reply."""
        self._link = link
        self._came = link.loop.time()
        self._considering = link.loop.call_soon(self._consider)  # when all that came before it is seen
        self._timer = link.loop.call_later(EMPTY_DELAY, self._end)

    def cancel(self) -> None:
        """Wait no longer."""
        self._considering.cancel()
        self._timer.cancel()

    def _consider(self) -> None:
        link = self._link
        if link.mailbox and not link.receiving:
            link.answer(self)
        else:
            self.waits = bool(link.mailbox) or link.busy

    def _end(self) -> None:
        link = self._link
        left = self._came + LONGEST_WAIT - link.loop.time()
        if self.waits and link.mailbox:
            link.answer(self)
        elif self.waits and link.busy and left > 0:
            self._timer = link.loop.call_later(left, self._end)
        else:
            link.end_empty(self)


class Unread(Peer):
    """A connection on the reply port that is sent more than the system takes at once."""

    closing = UNREAD_PATIENCE

    def __init__(self, sock: socket.socket, peer: str, link: PostOffice, rest: bytes) -> None:
        super().__init__(sock, peer, link.budget)
        self._link = link
        self.write(rest)
        self.close()

    def connection_lost(self, error: OSError | None) -> None:
        self._link.unread_lost(self)


# Judged: a long computation or a coffee; who has a program stand in a debugger for longer asks again.
LONGEST_KEPT = 600.0
"""Seconds after its program's last request for which a reply is kept while the program lives."""
# Programs pause 40 to 300 ms between two messages; no other program is started in less.
SAME_PROGRAM = 0.03
"""Seconds within which the next message from an address is taken for the same program's."""


# Judged: soon enough for a robot whose program has crashed, and no work.
LOOK = 0.25
"""Seconds between two looks whether the program whose velocity it is still lives."""


@dataclass(frozen=True, slots=True)
class PacketDriver:
    """Whose a velocity is that came in a packet: the process's, if it is known, else the address's."""

    address: str
    process: Process | None


@dataclass(slots=True)
class _Client:
    """State of an address: times of its last message and its last request, count of its requests, and the
    process that asked, if it is known."""

    last: float
    last_request: float
    timer: asyncio.TimerHandle
    requests: int = 0
    process: Process | None = None


class Replies(Protocol):
    """The replies that wait for the clients of each address."""

    def wait_for(self, address: str, since: float = -math.inf) -> bool: ...
    def drop(self, address: str, why: str, before: float = math.inf) -> None: ...


def address_of(peer: str) -> str:
    """The host of a peer: its ports change with every message."""
    return peer.rpartition(":")[0]


class Presence:
    """Tells watchers when a client's first request has come, and when no more have for `idle` seconds."""

    def __init__(
        self,
        engine: Engine,
        idle: float,
        is_connected: Callable[[str], bool],
        on_left: Callable[[str], None],
        replies: Replies,
        processes: ProcessLookup | None,
    ) -> None:
        """`is_connected` says of a silent address that it is there all the same; `on_left` is given
        the address of one that has left. `replies` wait for their programs; `processes` finds those."""
        self._engine = engine
        self._idle = idle
        self._is_connected = is_connected
        self._on_left = on_left
        self._replies = replies
        self._processes = processes
        self._loop = asyncio.get_running_loop()
        self._clients: dict[str, _Client] = {}
        self._connecting: dict[str, Process] = {}
        """The processes of connections on which nothing has come yet, by peer."""
        self._next_look: asyncio.TimerHandle | None = None

    def connected(self, sock: socket.socket, peer: str) -> None:
        """A connection has come, on either port. Whose it is can be told only now: it may be closed the next
        moment."""
        address = address_of(peer)
        now = self._loop.time()
        client = self._clients.get(address)
        # In a quick exchange it is the same program's as before, and costs no look.
        if self._processes is None or (client is not None and now - client.last < SAME_PROGRAM):
            return
        before = client.process if client is not None else None
        found = self._processes.holder(sock, peer, before)
        if found is not None:
            self._connecting[peer] = found

    @property
    def any(self) -> bool:
        """True if a client is there."""
        return bool(self._clients)

    def disconnected(self, peer: str) -> None:
        """A connection for requests has ended."""
        self._connecting.pop(peer, None)

    def read(self, peer: str) -> None:
        """A read on the reply port has come."""
        client, process = self._clients.get(address_of(peer)), self._connecting.pop(peer, None)
        if client is not None:
            client.last = self._loop.time()
            # Its program reads: many close their request before anybody can look whose it was.
            client.process = process or client.process

    def takes(self, peer: str) -> None:
        """A read is about to get what waits. What was asked for before its program began is another's, if
        there is something newer: a program that only reads, as the second of two `nc`, gets all of it."""
        address = address_of(peer)
        client = self._clients.get(address)
        if client is not None and client.process is not None:
            began = self._loop.time() - client.process.age
            if self._replies.wait_for(address, began):
                self._replies.drop(address, "the program that reads was not there yet", began)

    def asked(self, peer: str) -> PacketDriver:
        """A request has come: replies that wait for another process, or from long before, are dropped. Gives
        whose it is."""
        address, now = address_of(peer), self._loop.time()
        process = self._connecting.pop(peer, None)
        client = self._clients.get(address)
        if client is None:
            timer = self._loop.call_later(self._idle, self._look_for, address)
            client = self._clients[address] = _Client(now, now, timer, process=process)
            self._engine.tell(Notice(NoticeKind.CONNECTED, f"client {address} sends packets", address))
        elif now - client.last_request > SAME_PROGRAM:
            self._ask_again(client, address, process, now)
        client.last = client.last_request = now
        client.requests += 1
        return PacketDriver(address, client.process)

    def _ask_again(self, client: _Client, address: str, process: Process | None, now: float) -> None:
        before = client.process
        if process is not None and before is not None and process != before:
            self._replies.drop(address, "another program asks")
        elif now - client.last_request > self._idle:
            self._replies.drop(address, f"its program asks again after {now - client.last_request:.0f} s")
        # A message that was closed before anybody could look is the same process's while that lives.
        if process is not None or (before is not None and not before.lives):
            client.process = process

    def look_after_velocity(self) -> None:
        """A command has been answered: a velocity that came in a packet ends with its program."""
        if self._next_look is None and isinstance(self._engine.driving.driver, PacketDriver):
            self._next_look = self._loop.call_later(LOOK, self._look)

    def _look(self) -> None:
        self._next_look = None
        driver = self._engine.driving.driver
        if isinstance(driver, PacketDriver):
            process = driver.process
            if not (driver.address in self._clients if process is None else process.lives):
                self._engine.driver_left(driver)
            self.look_after_velocity()

    def close(self) -> None:
        """Stop tracking clients."""
        if self._next_look is not None:
            self._next_look.cancel()
        for client in self._clients.values():
            client.timer.cancel()
        self._clients.clear()

    def _look_for(self, address: str) -> None:
        client = self._clients[address]
        # A connection that stays open is a sign of life, even if nothing comes on it.
        if self._is_connected(address):
            client.last = self._loop.time()
        now = self._loop.time()
        left = client.last + self._idle - now
        if left <= 0 and self._is_kept(client, address):
            left = min(self._idle, client.last_request + LONGEST_KEPT - now)
        if left > 0:
            client.timer = self._loop.call_later(left, self._look_for, address)
            return
        del self._clients[address]
        requests = counted(client.requests, "request")
        text = f"client {address} gone after {requests}: silent for {self._idle:g} s"
        self._engine.tell(Notice(NoticeKind.LEFT, text, address))
        self._on_left(address)

    def _is_kept(self, client: _Client, address: str) -> bool:
        """True if replies wait for a process that lives."""
        process = client.process
        if process is None and self._processes is not None:  # closed before anybody could look whose it was
            process = self._processes.of_run
        return process is not None and self._replies.wait_for(address) and process.lives
