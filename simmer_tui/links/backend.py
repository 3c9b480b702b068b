"""The robot that carries out clients' commands: simulated or real. It can be switched while they stay
connected.

A link passes each message of its client, bytes and commands, to the `BackendSwitch` with the client's
session, and gets the answer back. The link does not know which robot answered.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Protocol

from msgspec import Struct

from simmer_tui.config.reply_formats import ReplyForm
from simmer_tui.links.protocol.mission_query import MissionQuery
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.sessions import Answered, Foreign, Queued, Session
from simmer_tui.run.events import Notice, NoticeKind
from simmer_tui.sim.command import MISSION_QUERY, Command
from simmer_tui.sim.records import CommandResult

# Judged: far more than a program sends ahead, and little memory.
MOST_COMMANDS, MOST_WAITING_BYTES = 1000, 64 * 1024
"""Commands of a sender that may wait for their answer, and bytes of them. Further ones are busy."""
# Some megabytes of memory: a sender that far ahead of its replies will never read them.
MOST_REFUSED = 16 * 1024
"""Messages of a sender that are answered busy while earlier answers are pending. With more, its connection
ends."""
# Judged: one line a second, however fast a program sends.
_AGAIN = 1.0
"""Seconds between two notices about the same sender."""


class Message(Struct, frozen=True):
    """A client's message: its bytes, the commands in it (at least one), and the form in
    which the client wants the reply."""

    data: bytes
    commands: tuple[Command, ...]
    form: ReplyForm


class Backend(Protocol):
    """A real robot that clients drive in place of the simulated one. Each client is known by its session."""

    def submit(self, message: Message, session: Session, answered: Answered) -> None:
        """Queue a message; `answered` may be called before this returns."""

    def urgent_part(self, message: Message) -> Message | None:
        """The stops of a message, which are done even for a sender with too many waiting. None if it has
        none, or if there is nothing to stop."""

    def append_late(self, data: bytes, session: Session) -> None:
        """Late bytes that belong to the end of the session's previous message. Ignored where messages are
        not passed on as they are."""
        return

    def forget(self, session: Session) -> None:
        """Drop everything of a session that has not been answered yet."""

    def close(self) -> None:
        """Release the robot. Messages that were submitted are still answered."""


class ByteRobot(Protocol):
    """A real robot that takes the bytes of a program unchanged."""

    def joined(self, baud: float | None) -> None:
        """A program has opened the port, at a rate in bits a second if it said one."""

    def wrote(self, data: bytes) -> None:
        """The program has written bytes."""

    def left(self) -> None:
        """The program has closed the port."""


class BackendSwitch:
    """The robot that clients drive now; it can be replaced while they are connected.

    The simulated robot does messages in turn, stops before all others. A real one gets them at once. Answers
    are given in the order of the messages, whoever answers them.
    """

    def __init__(self, engine: Engine, robot: Backend | None = None) -> None:
        """`robot` is a real robot, which is driven in place of the simulated one."""
        self._engine = engine
        self._robot = robot
        self.byte_robot: ByteRobot | None = None
        """The real robot, if it is one whose language is the team's own."""
        self.program: Callable[[bytes], None] | None = None
        """Takes that robot's bytes for the program that has the serial port open."""
        self.query: MissionQuery | None = None
        """Answers queries for the facts of the mission. None if their code is one of the robot's."""

    def use(self, robot: Backend | None) -> None:
        """Send later messages to a real robot, or to the simulated one (None). The previous one answers the
        messages that it already has."""
        self.close()
        self._robot = robot

    def close(self) -> None:
        """Release the robot. Drives of the simulated one that wait do not begin, but are answered."""
        if self._robot is None:
            self._engine.forget_drives()
        else:
            self._robot.close()

    def submit(
        self, message: Message, session: Session, answered: Answered, budget: CommandBudget | None = None
    ) -> None:
        """Queue a message of a client; `answered` may be called before this returns. It counts in the
        client's `budget`; people have none."""
        commands = message.commands
        if commands[0].code == MISSION_QUERY and self._answer_query(message, session, answered, budget):
            return
        if budget is not None and not budget.has_room:
            self._submit_urgent(message, session, answered, budget)
        elif self._robot is not None:
            self._pass_on(self._robot, message, session, answered, budget)
        elif session.open:
            queued = self._engine.submit(session, commands, answered)
            if not queued.given:  # most are answered by now
                _count(queued, message, budget)

    def append_late(self, data: bytes, session: Session) -> None:
        """Late bytes that belong to the end of the session's previous message."""
        if self._robot is not None and not session.asks:
            self._robot.append_late(data, session)

    def _pass_on(
        self,
        robot: Backend,
        message: Message,
        session: Session,
        answered: Answered,
        budget: CommandBudget | None,
    ) -> None:
        """Pass a message to a real robot, and keep its place among the answers."""
        session.asks = False
        if robot not in session.others:
            session.others[robot] = robot.forget
            if session.driver is None and not (session.queue or session.waiting):
                self._engine.driver_left(session)  # the simulated robot is the twin from now on
        foreign = self._engine.reserve(session, answered)
        robot.submit(
            message,
            session,
            lambda results, data: self._engine.answer_foreign(foreign, results, data),
        )
        _count(foreign, message, budget)

    def _answer_query(
        self, message: Message, session: Session, answered: Answered, budget: CommandBudget | None
    ) -> bool:
        """Answer a query in its turn; False if it is none. No robot is asked, simulated or real."""
        reply = None if self.query is None else self.query.answer(message.commands, message.form)
        if reply is None:
            return False
        session.asks = True
        self._answer_here(session, answered, budget, (), reply)
        return True

    def _answer_here(
        self,
        session: Session,
        answered: Answered,
        budget: CommandBudget | None,
        results: Sequence[CommandResult],
        data: bytes | None = None,
    ) -> None:
        """Give an answer that no robot has given, in its turn."""
        foreign = self._engine.reserve(session, answered, slices=budget is not None)
        if budget is not None:
            session.unsettled[foreign] = budget.take_refused()
        self._engine.answer_foreign(foreign, results, data)

    def _submit_urgent(
        self, message: Message, session: Session, answered: Answered, budget: CommandBudget
    ) -> None:
        """Pass on the stops of a message, and answer the rest busy, in its turn."""
        budget.report_busy()
        engine, robot = self._engine, self._robot
        urgent = self._urgent_part(message) if robot is None else robot.urgent_part(message)
        passed = urgent.commands if urgent is not None else ()
        refused = [None if each in passed else engine.refuse(each) for each in message.commands]
        if urgent is None:  # no more is kept of those that come by the thousand
            self._answer_here(session, answered, budget, tuple(filter(None, refused)))
            return

        def merge(results: Sequence[CommandResult], data: bytes | None) -> None:
            done = iter(results)
            answered([next(done) if each is None else each for each in refused], data)

        if robot is None:
            _count(engine.submit(session, passed, merge), urgent, budget)
        else:
            self._pass_on(robot, urgent, session, merge, budget)

    def _urgent_part(self, message: Message) -> Message | None:
        """The commands that stop, unless no drive has come since the last stop."""
        stops = tuple(command for command in message.commands if command.stops)
        return Message(message.data, stops, message.form) if stops and not self._engine.halted else None


def _count(queued: Queued | Foreign, message: Message, budget: CommandBudget | None) -> None:
    """Count a message as waiting, unless it has been answered, or an answer has closed its session."""
    if budget is not None and not queued.given and queued.session.open:
        queued.session.unsettled[queued] = budget.take(message)


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
        self.has_room = True
        """True if a further message may wait."""
        self.refused = 0
        """Messages answered busy, and queries, whose replies have not had their turn yet."""
        # Made once: each of thousands of messages would have its own.
        self._on_refusal_given = self._refusal_given

    @property
    def is_used(self) -> bool:
        """True if any message waits."""
        return self._commands > 0 or self.refused > 0

    @property
    def is_exceeded(self) -> bool:
        """True if the sender is too far ahead of its replies ever to read them."""
        return self.refused > MOST_REFUSED

    def take(self, message: Message) -> Callable[[], None]:
        """Count a message that begins to wait. Returns the call that stops counting it."""
        self._count(len(message.commands), len(message.data))
        return lambda: self._count(-len(message.commands), -len(message.data))

    def _count(self, commands: int, size: int) -> None:
        self._commands += commands
        self._bytes += size
        self.has_room = self._commands < MOST_COMMANDS and self._bytes < MOST_WAITING_BYTES

    def take_refused(self) -> Callable[[], None]:
        """Count a message that is answered busy, or a query. Returns the call that stops counting it."""
        self.refused += 1
        return self._on_refusal_given

    def _refusal_given(self) -> None:
        self.refused -= 1

    def report_busy(self) -> None:
        """Report that a message is answered busy."""
        now = self._loop.time()
        if now >= self._again:
            self._again = now + _AGAIN
            what = (
                f"{MOST_COMMANDS} commands"
                if self._commands >= MOST_COMMANDS
                else f"{MOST_WAITING_BYTES} bytes"
            )
            text = f"client {self._sender}: {what} wait already; further ones are answered busy"
            self._tell(Notice(NoticeKind.FAULT, f"{text}. Read each reply before the next command"))
