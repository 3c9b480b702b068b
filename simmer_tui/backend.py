"""The robot that carries out clients' commands: simulated or real, and switched while they stay connected.

A link hands each message of its client, bytes and commands both, to a `BackendSession` and gets the answer
back. It never learns which robot gave it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from simmer_tui.engine import Engine
from simmer_tui.protocol.replies import ReplyForm
from simmer_tui.sessions import Session
from simmer_tui.sim.command import Command
from simmer_tui.sim.records import CommandResult


@dataclass(frozen=True, slots=True)
class Message:
    """A client's message: its bytes, the commands in it (at least one), and the form in
    which the client wants the reply."""

    data: bytes
    commands: tuple[Command, ...]
    form: ReplyForm


Answered = Callable[[Sequence[CommandResult], bytes | None], None]
"""Takes the results, one a command, and the bytes to pass on unchanged as the reply; without
such bytes (None) the link writes the results in its own dialect."""


class Backend(Protocol):
    """A robot that clients drive. Each client is known by its session."""

    def submit(self, message: Message, session: BackendSession, answered: Answered) -> None:
        """Queue a message; `answered` may be called before this returns."""
        ...

    def trail(self, data: bytes, session: BackendSession) -> None:
        """Late bytes that belong to the end of the session's previous message."""
        ...

    def forget(self, session: BackendSession) -> None:
        """Drop everything of a session that has not been answered yet."""
        ...

    def close(self) -> None:
        """Give the robot back. Messages that were submitted are answered all the same."""
        ...


class SimulatorBackend:
    """The simulated robot."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._sessions: dict[BackendSession, Session] = {}

    def submit(self, message: Message, session: BackendSession, answered: Answered) -> None:
        sender = self._sessions.get(session)
        if sender is None:
            sender = self._engine.session(answer_at_end=session.answer_at_end, lane=session.lane)
            self._sessions[session] = sender
        commands = message.commands
        # Nearly every message is one command: it is answered without a list and a count.
        if len(commands) == 1:
            sender.submit(commands[0], lambda result: answered((result,), None))
            return
        results: list[CommandResult] = []

        def collect(result: CommandResult) -> None:
            results.append(result)
            if len(results) == len(commands):
                answered(results, None)

        for command in commands:
            sender.submit(command, collect)

    def trail(self, data: bytes, session: BackendSession) -> None:
        """Not needed: the command is already complete."""

    def forget(self, session: BackendSession) -> None:
        sender = self._sessions.pop(session, None)
        if sender is not None:
            sender.close()

    def close(self) -> None:
        """Drives that wait are not begun any more, but answered."""
        self._engine.forget_drives()


class BackendSwitch:
    """The robot that clients drive at the moment; it may be replaced while they are connected."""

    def __init__(self, backend: Backend) -> None:
        self.backend = backend

    def open_session(self, *, answer_at_end: bool = True, lane: str = "") -> BackendSession:
        """A new client. `answer_at_end`, `lane`: see `engine.Session` and `Engine.session`."""
        return BackendSession(self, answer_at_end, lane)

    def use(self, backend: Backend) -> None:
        """From here on messages go to `backend`. The one before is closed: it must answer what it
        has been asked."""
        before, self.backend = self.backend, backend
        before.close()

    def close(self) -> None:
        self.backend.close()


@dataclass(slots=True, eq=False)
class _Pending:
    """A message, and its answer once that is there."""

    answered: Answered
    results: Sequence[CommandResult] | None = None
    data: bytes | None = None


class BackendSession:
    """One client's messages and their answers.

    Messages are passed on at once, a stop above all. Answers are given in the order of the messages:
    after a switch the backend before may still have some to give.
    """

    def __init__(self, switch: BackendSwitch, answer_at_end: bool, lane: str) -> None:
        self.answer_at_end = answer_at_end
        self.lane = lane
        self._switch = switch
        self._backends = [switch.backend]
        """The one in use, last, behind those that may still have an answer to give."""
        self._pending: deque[_Pending] = deque()

    def submit(self, message: Message, answered: Answered) -> None:
        """Queue a message; `answered` may be called before this returns."""
        backend = self._switch.backend
        if backend is not self._backends[-1]:
            if not self._pending:  # those before have nothing more to give
                self.close()
                self._backends.clear()
            self._backends.append(backend)
        pending = _Pending(answered)
        self._pending.append(pending)
        backend.submit(message, self, partial(self._answered, pending))

    def trail(self, data: bytes) -> None:
        """Late bytes that belong to the end of the previous message."""
        self._backends[-1].trail(data, self)

    def close(self) -> None:
        """Drop everything that has not been answered yet."""
        self._pending.clear()
        for backend in self._backends:
            backend.forget(self)

    def _answered(self, pending: _Pending, results: Sequence[CommandResult], data: bytes | None) -> None:
        pending.results, pending.data = results, data
        while self._pending and (first := self._pending[0]).results is not None:
            self._pending.popleft()
            first.answered(first.results, first.data)
