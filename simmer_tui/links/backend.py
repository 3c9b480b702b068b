"""The robot that carries out clients' commands: simulated or real. It can be switched while they stay
connected.

A link passes each message of its client, bytes and commands, to a `BackendSession` and gets the answer back.
The link does not know which robot answered.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Hashable, Sequence
from functools import partial
from typing import Protocol

from msgspec import Struct

from simmer_tui.links.protocol.mission_query import MissionQuery
from simmer_tui.links.protocol.replies import ReplyForm
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.sessions import Session
from simmer_tui.run.events import Notice, NoticeKind
from simmer_tui.sim.command import Command
from simmer_tui.sim.records import CommandResult

# Judged: far more than a program sends ahead, and little memory.
MOST_COMMANDS, _MOST_BYTES = 1000, 64 * 1024
"""Commands of a sender that may wait for their answer, and bytes of them. Further ones are busy."""
# Some megabytes of memory: a sender that far ahead of its replies will never read them.
MOST_REFUSED = 16 * 1024
"""Messages of a sender that are answered busy while earlier answers are pending. With more, its connection
ends."""
# About a millisecond of processor time.
_SLICE = 100
"""Busy answers given to a sender in one turn of the event loop."""
# Judged: one line a second, however fast a program sends.
_AGAIN = 1.0
"""Seconds between two notices about the same sender."""


class Message(Struct, frozen=True):
    """A client's message: its bytes, the commands in it (at least one), and the form in
    which the client wants the reply."""

    data: bytes
    commands: tuple[Command, ...]
    form: ReplyForm


Answered = Callable[[Sequence[CommandResult], bytes | None], None]
"""Takes the results, one a command, and the bytes to pass on unchanged as the reply. Without bytes (None) the
link writes the results in its own dialect. A query is no command: it has bytes and no results."""


class Backend(Protocol):
    """A robot that clients drive. Each client is known by its session."""

    def submit(self, message: Message, session: BackendSession, answered: Answered) -> None:
        """Queue a message; `answered` may be called before this returns."""

    def urgent_part(self, message: Message) -> Message | None:
        """The stops of a message, which are done even for a sender with too many waiting. None if it has
        none, or if there is nothing to stop."""

    def refuse(self, command: Command) -> CommandResult:
        """Answer a command of a sender with too many waiting: busy, at once."""

    def append_late(self, data: bytes, session: BackendSession) -> None:
        """Late bytes that belong to the end of the session's previous message. Ignored where messages are
        not passed on as they are."""
        return

    def cut_waits(self, session: BackendSession) -> None:
        """End the waits of a session whose answers nobody will read. A real robot's time cannot be moved:
        there its program's waits stay."""
        return

    def forget(self, session: BackendSession) -> None:
        """Drop everything of a session that has not been answered yet."""

    def close(self) -> None:
        """Release the robot. Messages that were submitted are still answered."""


class SimulatorBackend(Backend):
    """The simulated robot."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._sessions: dict[BackendSession, Session] = {}

    def submit(self, message: Message, session: BackendSession, answered: Answered) -> None:
        sender = self._sessions.get(session)
        if sender is None:
            sender = self._engine.session(
                answer_at_end=session.answer_at_end, lane=session.lane, driver=session.driver
            )
            self._sessions[session] = sender
        commands = message.commands
        # Nearly every message is one command: it needs neither a list nor a count.
        if len(commands) == 1:
            sender.submit(commands[0], lambda result: answered((result,), None))
            return
        results: list[CommandResult] = []

        def collect(result: CommandResult) -> None:
            results.append(result)
            if len(results) == len(commands):
                answered(results, None)

        for place, command in enumerate(commands):
            sender.submit(command, collect, () if place else commands)

    def urgent_part(self, message: Message) -> Message | None:
        """The commands that stop, unless no drive has come since the last stop."""
        stops = tuple(command for command in message.commands if command.stops)
        return Message(message.data, stops, message.form) if stops and not self._engine.halted else None

    def refuse(self, command: Command) -> CommandResult:
        return self._engine.refuse(command)

    def cut_waits(self, session: BackendSession) -> None:
        sender = self._sessions.get(session)
        if sender is not None:
            self._engine.cut_waits(sender)

    def forget(self, session: BackendSession) -> None:
        sender = self._sessions.pop(session, None)
        if sender is not None:
            sender.close()

    def close(self) -> None:
        """Drives that wait do not begin, but are answered."""
        self._engine.forget_drives()


class ByteRobot(Protocol):
    """A real robot that takes the bytes of a program unchanged."""

    def joined(self, baud: float | None) -> None:
        """A program has opened the port, at a rate in bits a second if it said one."""

    def wrote(self, data: bytes) -> None:
        """The program has written bytes."""

    def left(self) -> None:
        """The program has closed the port."""


class BackendSwitch:
    """The robot that clients drive now; it can be replaced while they are connected."""

    def __init__(self, backend: Backend) -> None:
        self.backend = backend
        self.byte_robot: ByteRobot | None = None
        """The real robot, if it is one whose language is the team's own."""
        self.program: Callable[[bytes], None] | None = None
        """Takes that robot's bytes for the program that has the serial port open."""
        self.query: MissionQuery | None = None
        """Answers queries for the facts of the mission. None if their code is one of the robot's."""

    def open_session(
        self, *, answer_at_end: bool = True, lane: str = "", budget: CommandBudget | None = None
    ) -> BackendSession:
        """A new client. `answer_at_end`, `lane`: see `engine.Session` and `Engine.session`. Its waiting
        commands count in its `budget`; people have none."""
        return BackendSession(self, answer_at_end, lane, budget)

    def use(self, backend: Backend) -> None:
        """Send later messages to `backend`. The previous one is closed: it answers the messages that it
        already has."""
        before, self.backend = self.backend, backend
        before.close()

    def close(self) -> None:
        self.backend.close()


class CommandBudget:
    """The commands of one sender that wait for their answer. A sender is a connection, or all connections
    from an address."""

    def __init__(self, sender: str, tell: Callable[[Notice], None]) -> None:
        """`tell` is called with notices about `sender`. Needs a running event loop."""
        self._sender = sender
        self._tell = tell
        self._loop = asyncio.get_running_loop()
        self._again = 0.0
        self._commands = self._bytes = 0
        self.refused = 0
        """Messages answered busy, and queries, whose replies have not had their turn yet."""

    @property
    def has_room(self) -> bool:
        """True if a further message may wait."""
        return self._commands < MOST_COMMANDS and self._bytes < _MOST_BYTES

    @property
    def is_used(self) -> bool:
        """True if any message waits."""
        return self._commands > 0 or self.refused > 0

    @property
    def is_exceeded(self) -> bool:
        """True if the sender is too far ahead of its replies ever to read them."""
        return self.refused > MOST_REFUSED

    def take(self, message: Message) -> None:
        """Count a message that begins to wait."""
        self._commands += len(message.commands)
        self._bytes += len(message.data)

    def give_back(self, message: Message) -> None:
        """Stop counting a message."""
        self._commands -= len(message.commands)
        self._bytes -= len(message.data)

    def report_busy(self) -> None:
        """Report that a message is answered busy."""
        now = self._loop.time()
        if now >= self._again:
            self._again = now + _AGAIN
            what = f"{MOST_COMMANDS} commands" if self._commands >= MOST_COMMANDS else f"{_MOST_BYTES} bytes"
            text = f"client {self._sender}: {what} wait already; further ones are answered busy"
            self._tell(Notice(NoticeKind.FAULT, f"{text}. Read each reply before the next command"))


class _Pending(Struct, eq=False):
    """A message, and its answer once there is one. `counted` is the part of it that counts as waiting."""

    answered: Answered
    counted: Message | None = None
    refused: bool = False
    """True if nothing of it was passed on to the robot: it was answered busy, or is a query."""
    results: Sequence[CommandResult] | None = None
    data: bytes | None = None


class BackendSession:
    """One client's messages and their answers.

    Messages are passed on at once, stops before all others. Answers are given in the order of the messages.
    After a switch the previous backend may still have answers to give.
    """

    def __init__(
        self, switch: BackendSwitch, answer_at_end: bool, lane: str, budget: CommandBudget | None
    ) -> None:
        self.answer_at_end = answer_at_end
        self.lane = lane
        self.driver: Hashable | None = None
        """Whose velocities it sets, None for its own. It is known before the first message."""
        self._switch = switch
        self._budget = budget
        self._backends = [switch.backend]
        """The one in use, last, behind those that may still have an answer to give."""
        self._pending: deque[_Pending] = deque()
        self._handing_out = False
        """True if the next turn of the event loop continues to give answers."""
        self._has_asked = False
        """True if the newest message was a query."""

    def submit(self, message: Message, answered: Answered) -> None:
        """Queue a message; `answered` may be called before this returns."""
        query = self._switch.query
        reply = None if query is None else query.answer(message.commands, message.form)
        self._has_asked = reply is not None
        if reply is not None:
            self._answer_query(reply, answered)
            return
        backend = self._switch.backend
        if backend is not self._backends[-1]:
            if not self._pending:  # the previous backends have no answers left to give
                self.close()
                self._backends.clear()
            self._backends.append(backend)
        if self._budget is not None and not self._budget.has_room:
            self._submit_urgent(message, answered, self._budget)
            return
        pending = _Pending(answered)
        self._pending.append(pending)
        backend.submit(message, self, partial(self._answered, pending))
        # Most are answered by now, and are never counted. An answer may also have closed the session.
        if pending.results is None and self._pending:
            self._count(pending, message)

    def _count(self, pending: _Pending, message: Message) -> None:
        """Count a message that begins to wait."""
        if self._budget is not None:
            self._budget.take(message)
            pending.counted = message

    def _answer_query(self, reply: bytes, answered: Answered) -> None:
        """Answer a query in its turn. No robot is asked, simulated or real."""
        pending = _Pending(answered, refused=True)
        self._pending.append(pending)
        if self._budget is not None:
            self._budget.refused += 1
        self._answered(pending, (), reply)

    def _submit_urgent(self, message: Message, answered: Answered, budget: CommandBudget) -> None:
        """Pass on the stops of a message, and answer the rest busy, in its turn."""
        budget.report_busy()
        backend = self._switch.backend
        urgent = backend.urgent_part(message)
        passed = urgent.commands if urgent is not None else ()
        refused = [None if each in passed else backend.refuse(each) for each in message.commands]
        pending = _Pending(answered, refused=urgent is None)
        self._pending.append(pending)

        def merge(results: Sequence[CommandResult], data: bytes | None) -> None:
            done = iter(results)
            merged = [next(done) if each is None else each for each in refused]
            self._answered(pending, merged, data)

        if urgent is None:
            budget.refused += 1
            merge((), None)
        else:
            self._count(pending, urgent)
            backend.submit(urgent, self, merge)

    def _settle(self, pending: _Pending) -> None:
        """Stop counting a message: its sender may have another one waiting."""
        if self._budget is not None and pending.counted is not None:
            self._budget.give_back(pending.counted)
            pending.counted = None

    def append_late(self, data: bytes) -> None:
        """Late bytes that belong to the end of the previous message."""
        if not self._has_asked:
            self._backends[-1].append_late(data, self)

    def cut_waits(self) -> None:
        """End the waits of this client: nobody will read its answers."""
        self._backends[-1].cut_waits(self)

    def close(self) -> None:
        """Drop everything that has not been answered yet."""
        for pending in self._pending:
            self._settle(pending)
            if pending.refused and self._budget is not None:
                self._budget.refused -= 1
        self._pending.clear()
        for backend in self._backends:
            backend.forget(self)

    def _answered(self, pending: _Pending, results: Sequence[CommandResult], data: bytes | None) -> None:
        pending.results, pending.data = results, data
        if pending.counted is not None:
            self._settle(pending)
        if not self._handing_out:
            self._hand_out()

    def _hand_out(self) -> None:
        """Give the answers whose turn has come. After a slice of refusals the event loop has a turn."""
        self._handing_out = False
        left = _SLICE
        while self._pending and (first := self._pending[0]).results is not None:
            if first.refused and self._budget is not None:
                if not left:
                    try:
                        loop = asyncio.get_running_loop()
                    except RuntimeError:  # the run has ended: there is no loop to share
                        left = len(self._pending)
                    else:
                        self._handing_out = True
                        loop.call_soon(self._hand_out)
                        return
                left -= 1
                self._budget.refused -= 1
            self._pending.popleft()
            first.answered(first.results, first.data)
