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
from simmer_tui.protocol.framing import ReplyForm
from simmer_tui.sim.command import Command
from simmer_tui.sim.records import Outcome


@dataclass(frozen=True, slots=True)
class Message:
    """What a client sent as one: its bytes, the commands in it (at least one), and the form in
    which the client wants the reply."""

    data: bytes
    commands: tuple[Command, ...]
    form: ReplyForm


Answered = Callable[[Sequence[Outcome], bytes | None], None]
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
    """A robot that clients drive. `answer_at_end`: see `engine.Session`."""

    def open_session(self, *, answer_at_end: bool = True) -> BackendSession: ...

    def close(self) -> None: ...


class SimulatorBackend:
    """The simulated robot."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def open_session(self, *, answer_at_end: bool = True) -> BackendSession:
        return _SimulatorSession(self._engine, answer_at_end)

    def close(self) -> None:
        """There is nothing to release."""


class _SimulatorSession:
    def __init__(self, engine: Engine, answer_at_end: bool) -> None:
        self._session = engine.session(answer_at_end=answer_at_end)

    def submit(self, message: Message, answered: Answered) -> None:
        commands = message.commands
        if len(commands) == 1:
            self._session.submit(commands[0], lambda outcome: answered((outcome,), None))
            return
        outcomes: list[Outcome] = []

        def collect(outcome: Outcome) -> None:
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

    def open_session(self, *, answer_at_end: bool = True) -> BackendSession:
        return _SwitchedSession(self, answer_at_end)

    def use(self, backend: Backend) -> None:
        """From here on messages go to `backend`. The one before is closed: it must answer what it
        has been asked."""
        before, self.backend = self.backend, backend
        before.close()

    def close(self) -> None:
        self.backend.close()


class _SwitchedSession:
    """Holds messages back while the backend before still owes answers, so that all come in order."""

    def __init__(self, switch: BackendSwitch, answer_at_end: bool) -> None:
        self._switch = switch
        self._answer_at_end = answer_at_end
        self._backend = switch.backend
        self._session = self._backend.open_session(answer_at_end=answer_at_end)
        self._owed = 0
        self._held: deque[tuple[Message, Answered]] = deque()

    def submit(self, message: Message, answered: Answered) -> None:
        if self._backend is not self._switch.backend:
            if self._owed:
                self._held.append((message, answered))
                return
            self._follow()
        self._owed += 1
        self._session.submit(message, partial(self._answered, answered))

    def trail(self, data: bytes) -> None:
        if not self._held:
            self._session.trail(data)

    def close(self) -> None:
        self._held.clear()
        self._session.close()

    def _follow(self) -> None:
        self._session.close()
        self._backend = self._switch.backend
        self._session = self._backend.open_session(answer_at_end=self._answer_at_end)

    def _answered(self, answered: Answered, outcomes: Sequence[Outcome], data: bytes | None) -> None:
        self._owed -= 1
        answered(outcomes, data)
        if self._held and not self._owed:
            held, self._held = self._held, deque()
            for message, waiting in held:
                self.submit(message, waiting)
