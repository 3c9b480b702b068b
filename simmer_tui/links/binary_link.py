"""The TCP ports of the binary dialects: one client at a time, on two ports."""

from __future__ import annotations

import asyncio
import math
import socket
from collections.abc import Sequence
from dataclasses import dataclass

from simmer_tui.config.dialects import COMMANDS, REPLIES
from simmer_tui.links.access import RefusalNotices
from simmer_tui.links.backend import CommandBudget, Message
from simmer_tui.links.connection_doctor import CHECKED_COMMANDS, LONE_LIMIT, ClientWatch, ConnectionDoctor
from simmer_tui.links.driver_lock import DriverLock
from simmer_tui.links.link import LinkContext
from simmer_tui.links.peer import MOST_WAITING, PIECE, UNREAD_LIMIT, Peer, ReadBudget, host_of
from simmer_tui.links.processes import children
from simmer_tui.links.protocol.binary import CommandReader, NumberEncoder
from simmer_tui.links.protocol.diagnosis import is_http
from simmer_tui.links.protocol.line_marks import without_marks
from simmer_tui.robot.timers import LoopTimer
from simmer_tui.run.events import Notice, NoticeKind
from simmer_tui.sim.command import Command, counted
from simmer_tui.sim.records import REFUSALS, CommandResult

# Judged: a wait that nobody notices. A program that is started again connects before the old one's end is
# seen.
RETRY_DELAY = 0.05
"""Seconds that a newcomer waits for the present client to leave."""
# Judged: a program asks for a dozen sensors; the limit is for one that always sends new numbers.
KNOWN = 100
"""Most lines of a client that are kept with their commands."""
# More than `CLOSING`, within which the present client must be gone.
_LONGEST_WAIT = 1.5
"""Seconds after which a newcomer is refused even if the present client is about to leave."""
# Whoever waits for the port (`nc -z`, a health check) closes the connection at once.
PROBE = 0.5
"""Seconds after which a client that has sent nothing is told as connected."""


@dataclass(frozen=True, slots=True)
class _Newcomer:
    """A connection that waits for the present client to leave, and its time limit by the loop's clock."""

    peer: str
    until: float


def _has_left(sock: socket.socket) -> bool:
    """True if the other end has closed a connection, and has sent nothing."""
    try:
        return sock.recv(1, socket.MSG_PEEK) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True


class ReplyConnection(Peer):
    """A connection on the reply port. Bytes that the client sends there are ignored, after one notice."""

    def __init__(self, sock: socket.socket, peer: str, link: BinaryLink) -> None:
        super().__init__(sock, peer, link.reply_budget)
        self._link = link
        client = link.client
        self._after = client if client is not None and client.leaves else None
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNREAD_LIMIT)

    @property
    def not_of(self) -> Client | None:
        """A client that had sent all before this connection came, while a newcomer waits."""
        # Asked for when a reply is due: the newcomer's two connections may be accepted in either order.
        return self._after if self._link.has_newcomers else None

    def data_received(self, data: bytes) -> None:
        self._link.sent_to_replies(self.peer)

    def connection_lost(self, error: OSError | None) -> None:
        self._link.reply_lost(self)

    def was_reset(self) -> bool:
        """True if the other end reset the connection, as a socket does that is closed with unread replies."""
        if not self._finished:  # closed, and its end not seen yet
            try:
                self.sock.recv(1, socket.MSG_PEEK)
            except BlockingIOError:
                return False
            except OSError:
                return True
        return self.ended_with_error


class Client(Peer):
    """The control program's connection on the command port."""

    def __init__(self, sock: socket.socket, peer: str, link: BinaryLink) -> None:
        super().__init__(sock, peer, ReadBudget(PIECE))
        # Otherwise the system takes megabytes of replies before we notice that nobody reads them.
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNREAD_LIMIT)
        self._link = link
        self._reader = CommandReader(grace=link.context.settings.grace)
        self._command_budget = CommandBudget(peer, link.engine.tell)
        self._robot = link.context.backend
        self._session = link.engine.session(answer_at_end=link.context.answers_at_end(in_packets=False))
        self._messages: dict[bytes, Message] = {}
        """Messages by the whole lines that came before: programs repeat the same few."""
        self._timer = LoopTimer(self._silence, self._loop)
        self.ending = False
        """True if the client has closed its side and waits for replies."""
        self.reads_nothing = False
        """True if the system reports that it has closed entirely."""
        self._waiting = 0
        self._is_timed = False
        """True if a timer may run for the rest of a line."""
        self._watch = ClientWatch(link.doctor, self, link.encoder.form, link.encoder.size)
        self.is_http = False
        """True if its first line is a request of HTTP."""
        self.replies: Peer | None = None
        """Connection for replies, once the first has been routed."""
        self.has_sent = False
        """True if a command has come."""
        self.is_told = False
        """True once it has been told as connected: it has sent something, or stays."""
        self._probe_timer = LoopTimer(self._tell, self._loop)
        self._probe_timer.set_in(PROBE)

    def _tell(self) -> None:
        self._probe_timer.cancel()
        if not self.is_told:
            self.is_told = True
            self._link.engine.tell(Notice(NoticeKind.CONNECTED, f"client {self.peer} connected", self.peer))

    @property
    def commands(self) -> int:
        """Commands that were answered."""
        return self._watch.commands

    @property
    def leaves(self) -> bool:
        """True if the client has closed its side, or that is about to be read."""
        return self.ending or self.has_left()

    def data_received(self, data: bytes) -> None:
        if not self.is_told:
            self._tell()
        reader = self._reader
        if reader.at_rest and (known := self._messages.get(data)) is not None:
            self._send(known)
            return
        # A real robot may wait for the line end too: it is passed on even though the command has been sent.
        late_end = b"" if reader.at_rest else reader.late_end(data)
        if late_end:
            self._robot.append_late(late_end, self._session)
        self._submit(reader.receive(data))
        # Between whole lines there is nothing to wait for.
        if self._is_timed or not reader.at_rest:
            self._is_timed = not reader.at_rest
            self._watch.line_began(reader.unended)
            self._timer.set_in(None if self._closing else reader.idle_timeout)

    def eof_received(self) -> bool:
        # Closed for sending only: programs may close their side and still read the replies.
        self.ending = True
        self._timer.cancel()
        self._submit(self._reader.end())
        if self._waiting and self._link.has_closed(self.sock, self.peer):
            self.reads_nothing = True
            # A connection on the reply port that is still open is the next client's.
            self.replies = self.replies or self
            # If the program was ended, its robot must not drive on to the end of a wait.
            self._link.engine.cut_waits(self._session)
        self._close_if_done()
        return True

    def connection_lost(self, error: OSError | None) -> None:
        self.close()
        replies = self.replies
        ended_with_error = error is not None or (isinstance(replies, ReplyConnection) and replies.was_reset())
        self._watch.left(ended_with_error=ended_with_error)
        self._link.client_lost(self)

    def close(self) -> None:
        """Close after all written bytes have been sent; waiting commands are dropped."""
        self._timer.cancel()
        self._probe_timer.cancel()
        self._session.close()
        super().close()

    def _silence(self) -> None:
        commands = self._reader.silence()
        for command in commands:
            self._link.doctor.bare(command)
        self._submit(commands)

    def _submit(self, commands: list[Command]) -> None:
        if not self.has_sent and commands:
            self.has_sent, self.is_http = True, is_http(commands[0].text)
        for command, sent in zip(commands, self._reader.sent, strict=True):
            message = Message(without_marks(sent), (command,), self._link.encoder.form)
            # Never emptied: the commands that a program repeats are among its first hundred.
            if sent.endswith(b"\n") and len(self._messages) < KNOWN:
                self._messages[sent] = message
            self._send(message)

    def _send(self, message: Message) -> None:
        self._waiting += 1
        self._robot.submit(message, self._session, self._answer, self._command_budget)
        if self._command_budget.refused and self._command_budget.is_exceeded:
            self._link.drop(self)

    def _answer(self, results: Sequence[CommandResult], data: bytes | None) -> None:
        self._waiting -= 1
        # As late as possible: the client may open its reply connection after its first command.
        if self.replies is None:
            self.replies = self._link.reply_route(self)
        if results:
            watch, first = self._watch, results[0]
            watch.commands += len(results)
            if watch.commands <= CHECKED_COMMANDS or first.status in REFUSALS:
                watch.answered(first, self.replies)
        if data is None:
            data = self._link.encoder.reply(results[0])
        if not self.replies.write(data):
            self._link.drop(self)
        elif self.ending:
            self._close_if_done()

    def _close_if_done(self) -> None:
        if self.ending and not self._waiting:
            self.close()


class BinaryLink:
    """Serves the binary dialects on a command port and a reply port.

    One client drives at a time. A second is refused unless the first leaves within a moment. Replies go to
    the client's connection on the reply port if it has one, otherwise back on the command connection.
    """

    def __init__(self, context: LinkContext) -> None:
        """Begin to listen. Needs a running event loop."""
        settings = context.settings
        self.context = context
        self.engine = context.engine
        self.encoder = NumberEncoder(settings.reply_format, settings.byte_order)
        self.client: Client | None = None
        self.doctor = ConnectionDoctor(context.engine, context.listeners, context.processes)
        self._newcomers: dict[socket.socket, _Newcomer] = {}
        self._sent_away = -math.inf
        """Time of the last refusal of a program, by the loop's clock."""
        self._waiting_replies: list[ReplyConnection] = []
        self._loop = asyncio.get_running_loop()
        self._lock = context.driver_lock or DriverLock()
        self._refusals = RefusalNotices(context.engine.tell)
        self.reply_budget = ReadBudget(PIECE)
        self._commands = context.accept(COMMANDS, self._command_connection)
        self._replies = context.accept(REPLIES, self._reply_connection)

    @property
    def has_clients(self) -> bool:
        """True if a program is connected, or waits for another to leave."""
        return self.client is not None or bool(self._newcomers)

    @property
    def has_newcomers(self) -> bool:
        """True if a program waits for the present client to leave."""
        return bool(self._newcomers)

    def has_closed(self, sock: socket.socket, peer: str) -> bool:
        """True if a program is known to have closed its connection, so that it reads no answer."""
        processes = self.context.processes
        return processes is not None and processes.has_closed(sock, peer)

    def close(self) -> None:
        """Stop listening and end all connections."""
        self._commands.close()
        self._replies.close()
        for sock in self._newcomers:
            sock.close()
        self._newcomers.clear()
        if self.client is not None:
            if self.client.replies is not None:
                self.client.replies.abort()
            self.client.abort()
        for reply in tuple(self._waiting_replies):
            reply.abort()

    # -- coming --------------------------------------------------------------------------------

    def _command_connection(self, sock: socket.socket, peer: str) -> None:
        # At once: by the program's clock no time passes for others while the program computes.
        if refused := self._lock.refusal(sock, peer):
            self._refuse(sock, peer, refused)
            return
        if self.client is None:
            self._admit(sock, peer)
            return
        self._newcomers[sock] = _Newcomer(peer, self._loop.time() + _LONGEST_WAIT)
        if len(self._newcomers) > MOST_WAITING:
            self._refuse_newcomer(next(iter(self._newcomers)))
        self._loop.call_later(RETRY_DELAY, self._consider, sock)

    def _admit(self, sock: socket.socket, peer: str) -> None:
        if refused := self._lock.acquire(self, f"client {peer}"):
            self._refuse(sock, peer, refused)
            return
        self.client = Client(sock, peer, self)

    def _refuse(self, sock: socket.socket, peer: str, reason: str) -> None:
        self._commands.refuse(sock, peer)
        self._refusals.tell(f"client {peer} turned away: {reason}", reason)

    def _consider(self, sock: socket.socket) -> None:
        """Refuse a newcomer unless the present client is about to leave."""
        newcomer, client = self._newcomers.get(sock), self.client
        if newcomer is None:
            return
        # The movement of a client that is gone may last long, but no other program drives. A newcomer that
        # has given up meanwhile must not drive later.
        if (
            client is not None
            and client.leaves
            and (
                self._loop.time() < newcomer.until
                or (client.reads_nothing and not self.has_closed(sock, newcomer.peer))
            )
        ):
            self._loop.call_later(RETRY_DELAY, self._consider, sock)
        else:
            self._refuse_newcomer(sock)

    def _refuse_newcomer(self, sock: socket.socket) -> None:
        self._sent_away = self._loop.time()
        peer = self._newcomers.pop(sock).peer
        if _has_left(sock):
            sock.close()
        else:
            self._refuse(sock, peer, "one program at a time drives the robot")

    def _reply_connection(self, sock: socket.socket, peer: str) -> None:
        if len(self._waiting_replies) >= MOST_WAITING:
            self._waiting_replies.pop(0).close()
        reply = ReplyConnection(sock, peer, self)
        self._waiting_replies.append(reply)
        if self.client is not None and self.client.replies is not None:
            self._loop.call_later(RETRY_DELAY, self._close_stray, reply)
        elif self.client is None:
            self._loop.call_later(LONE_LIMIT, self._look_for_lone, reply)

    def _look_for_lone(self, reply: ReplyConnection) -> None:
        if self.client is None and reply in self._waiting_replies and not reply.has_left():
            self.doctor.alone(reply.peer)

    def sent_to_replies(self, peer: str) -> None:
        """Report that a connection on the reply port has sent something."""
        if self.client is None or not self.client.has_sent:
            self.doctor.sent_to_reply_port(peer)

    def _close_stray(self, reply: ReplyConnection) -> None:
        """Close a reply connection that came too late for the client; the next client may need the place."""
        client = self.client
        if client is None or client.replies is None or client.leaves:
            return
        if reply in self._waiting_replies:
            self._waiting_replies.remove(reply)
            # For a second program, which was refused, it is no mistake: a notice has said so.
            second = self._newcomers or self._loop.time() - self._sent_away < LONE_LIMIT
            same = host_of(reply.peer) == host_of(client.peer)
            if client.replies is client and same and not second and not self._of_others(client, [reply]):
                self.doctor.too_late(reply.peer)
            reply.close()
            text = f"connection {reply.peer} on the reply port closed: it belongs to no client"
            self._refusals.tell(text, "no client's")

    # -- replies -------------------------------------------------------------------------------

    def reply_route(self, client: Client) -> Peer:
        """The connection for a client's replies, decided at its first reply. Waiting connections on the reply
        port are accepted first."""
        self._replies.accept_waiting()
        waiting = self._waiting_replies
        # A connection that has closed already belonged to an earlier client.
        present = [reply for reply in waiting if not reply.has_left()]
        others = self._of_others(client, present)
        if others:
            text = f"connection {others[-1].peer} on the reply port is another program's"
            self._refusals.tell(f"{text}: client {client.peer} gets its own replies", "another program's")
        # Another program's connection waits: its own client may be about to connect.
        self._waiting_replies = others
        own = [reply for reply in present if reply not in others]
        for reply in waiting:
            if reply not in others and reply not in own[-1:]:  # the newest is the client's own
                reply.close()
        return own[-1] if own else client

    def _of_others(self, client: Client, present: list[ReplyConnection]) -> list[ReplyConnection]:
        """Connections on the reply port that are known to belong to another client, or to another process
        than the client's."""
        processes = self.context.processes
        later = [reply for reply in present if reply.not_of is client]
        if processes is None or not present:
            return later
        inodes = {reply: processes.inode(reply.sock, reply.peer) for reply in present}
        of_client = processes.inode(client.sock, client.peer)
        # Nearly always the program that this process has started last.
        holders = processes.holders({of_client, *inodes.values()} - {0}, first=reversed(children()))
        ours = holders.get(of_client, set())
        # A process that forks has both sockets in several processes: one with both is enough.
        return [
            reply
            for reply in present
            if reply in later or (ours and inodes[reply] and not ours & holders[inodes[reply]])
        ]

    # -- leaving -------------------------------------------------------------------------------

    def drop(self, client: Client) -> None:
        """End a client that does not read its replies."""
        self.engine.drop(client.peer)
        if client.replies is not None:
            client.replies.abort()
        client.abort()

    def client_lost(self, client: Client) -> None:
        """The command connection of a client has gone."""
        self.client = None
        self._lock.release(self)
        if client.replies is not None:
            client.replies.close()
        if client.is_told:
            text = f"client {client.peer} disconnected after {counted(client.commands, 'command')}"
            self.engine.tell(Notice(NoticeKind.LEFT, text, client.peer))
        if client.is_http and self.context.probe_left is not None:
            self.context.probe_left()
        elif client.has_sent:
            self.context.client_left()
        if self._newcomers:
            sock = next(iter(self._newcomers))
            self._admit(sock, self._newcomers.pop(sock).peer)

    def reply_lost(self, reply: ReplyConnection) -> None:
        """A connection on the reply port has ended."""
        if reply in self._waiting_replies:
            self._waiting_replies.remove(reply)
        elif self.client is not None and self.client.replies is reply:
            self.client.close()
