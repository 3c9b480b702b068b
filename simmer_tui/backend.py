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
from simmer_tui.protocol.reply_form import ReplyForm
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
"""Takes the outcomes, one a command, and the bytes to pass on unchanged as the reply; without
such bytes (None) the link writes the outcomes in its own dialect."""


class BackendSession(Protocol):
    """One client's messages and their answers, in order."""

    def submit(self, message: Message, answered: Answered) -> None:
        """Queue a message; `answered` may be called before this returns."""
        ...

    def trail(self, data: bytes) -> None:
        """Late bytes that belong to the end of the previous message."""
        ...

    def close(self) -> None:
        """Drop everything that has not been answered yet."""
        ...


class Backend(Protocol):
    """A robot that clients drive. `answer_at_end`, `lane`: see `engine.Session` and `Engine.session`."""

    def open_session(self, *, answer_at_end: bool = True, lane: str = "") -> BackendSession: ...

    def close(self) -> None: ...


class SimulatorBackend:
    """The simulated robot."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def open_session(self, *, answer_at_end: bool = True, lane: str = "") -> BackendSession:
        return _SimulatorSession(self._engine.session(answer_at_end=answer_at_end, lane=lane))

    def close(self) -> None:
        """Drives that wait are not begun any more, but answered."""
        self._engine.forget_drives()


class _SimulatorSession:
    def __init__(self, session: Session) -> None:
        self._session = session

    def submit(self, message: Message, answered: Answered) -> None:
        commands = message.commands
        if len(commands) == 1:
            self._session.submit(commands[0], lambda outcome: answered((outcome,), None))
            return
        outcomes: list[CommandResult] = []

        def collect(outcome: CommandResult) -> None:
            outcomes.append(outcome)
            if len(outcomes) == len(commands):
                answered(outcomes, None)

        for command in commands:
            self._session.submit(command, collect)

    def trail(self, data: bytes) -> None:
        """Not needed: the command is already complete."""

    def close(self) -> None:
        self._session.close()


class BackendSwitch:
    """A backend that forwards to another one, which may be replaced while clients are connected."""

    def __init__(self, backend: Backend) -> None:
        self.backend = backend

    def open_session(self, *, answer_at_end: bool = True, lane: str = "") -> BackendSession:
        return _SwitchedSession(self, answer_at_end, lane)

    def use(self, backend: Backend) -> None:
        """From here on messages go to `backend`. The one before is closed: it must answer what it
        has been asked."""
        before, self.backend = self.backend, backend
        before.close()

    def close(self) -> None:
        self.backend.close()


@dataclass(slots=True, eq=False)
class _Owed:
    """A message, and its answer once that is there."""

    answered: Answered
    outcomes: Sequence[CommandResult] | None = None
    data: bytes | None = None


class _SwitchedSession:
    """Passes messages on at once, a stop above all, and answers on in the order of the messages: the
    backend before may still owe some."""

    def __init__(self, switch: BackendSwitch, answer_at_end: bool, lane: str) -> None:
        self._switch = switch
        self._answer_at_end = answer_at_end
        self._lane = lane
        self._backend = switch.backend
        self._sessions = [self._open()]
        """The one in use, last, behind those that still owed an answer when it was opened."""
        self._owed: deque[_Owed] = deque()

    def submit(self, message: Message, answered: Answered) -> None:
        if self._backend is not self._switch.backend:
            self._follow()
        owed = _Owed(answered)
        self._owed.append(owed)
        self._sessions[-1].submit(message, partial(self._answered, owed))

    def trail(self, data: bytes) -> None:
        self._sessions[-1].trail(data)

    def close(self) -> None:
        self._owed.clear()
        for session in self._sessions:
            session.close()

    def _open(self) -> BackendSession:
        return self._backend.open_session(answer_at_end=self._answer_at_end, lane=self._lane)

    def _follow(self) -> None:
        if not self._owed:
            self.close()
            self._sessions.clear()
        self._backend = self._switch.backend
        self._sessions.append(self._open())

    def _answered(self, owed: _Owed, outcomes: Sequence[CommandResult], data: bytes | None) -> None:
        owed.outcomes, owed.data = outcomes, data
        while self._owed and (first := self._owed[0]).outcomes is not None:
            self._owed.popleft()
            first.answered(first.outcomes, first.data)
