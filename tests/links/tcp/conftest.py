"""A running server on free ports, and control programs that speak the binary dialects to it."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from collections.abc import Callable, Iterator

import pytest

from simmer_tui.config.dialects import COMMANDS, REPLIES
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.config.settings_file import Override
from simmer_tui.live.server import Server
from simmer_tui.run.events import Event, Notice
from simmer_tui.sim import Simulator

SECONDS = 120.0
"""Longest wait for anything; nothing waits that long unless it is broken."""
SEED = 7


class Program:
    """A control program: a connection to the command port, perhaps one to the reply port."""

    def __init__(self, served: Served, layout: str) -> None:
        self._served = served
        self.layout = layout
        self.commands: socket.socket | None = None
        self.replies: socket.socket | None = None

    def open_commands(self, host: str = "127.0.0.1") -> Program:
        self.commands = socket.create_connection((host, self._served.server.ports[COMMANDS.purpose]), SECONDS)
        return self

    def open_replies(self, host: str = "127.0.0.1") -> Program:
        self.replies = socket.create_connection((host, self._served.server.ports[REPLIES.purpose]), SECONDS)
        return self

    def send(self, data: bytes) -> None:
        assert self.commands is not None
        self.commands.sendall(data)

    def number(self) -> float:
        """The next reply, wherever this program expects it."""
        source = self.replies or self.commands
        assert source is not None
        data = b""
        while len(data) < struct.calcsize(self.layout):
            more = source.recv(struct.calcsize(self.layout) - len(data))
            assert more, f"the connection ended after {len(data)} bytes of a reply"
            data += more
        return float(struct.unpack(self.layout, data)[0])

    def ask(self, text: str) -> float:
        self.send(text.encode() + b"\n")
        return self.number()

    def rest(self) -> bytes:
        """All that comes until a clean end. A reset raises."""
        assert self.commands is not None
        data = b""
        while more := self.commands.recv(65536):
            data += more
        return data

    def vanish(self) -> None:
        """End as a killed program on a broken network does: with a reset."""
        for each in (self.commands, self.replies):
            if each is not None:
                each.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.close()

    def close(self) -> None:
        for each in (self.commands, self.replies):
            if each is not None:
                each.close()


class Served:
    """A running server, and what it told its watcher."""

    def __init__(self, server: Server) -> None:
        self.server = server
        self.events: list[Event] = []
        self.clients_left = 0
        self._changed = threading.Condition()
        server.start(self._watch, self._left)

    def _watch(self, event: Event) -> None:
        with self._changed:
            self.events.append(event)
            self._changed.notify_all()

    def _left(self) -> None:
        with self._changed:
            self.clients_left += 1
            self._changed.notify_all()

    @property
    def notices(self) -> list[str]:
        return [event.text for event in tuple(self.events) if isinstance(event, Notice)]

    def wait(self, condition: Callable[[], bool]) -> None:
        """Wait until something told makes the condition true."""
        with self._changed:
            assert self._changed.wait_for(condition, SECONDS), self.notices

    def wait_notice(self, part: str, times: int = 1) -> None:
        self.wait(lambda: sum(part in text for text in self.notices) >= times)

    def twin(self) -> Simulator:
        """The same robot without any sockets."""
        return Simulator(self.server.configuration.simulation, SEED)


class Serve:
    """Starts stations and programs, and ends them."""

    def __init__(self, stack: contextlib.ExitStack) -> None:
        self._stack = stack

    def __call__(self, **settings: object) -> Served:
        """A server with these settings (`step_time`, `server__grace`, ...)."""
        server = Server(self.configuration(**settings))
        self._stack.callback(server.stop)
        return Served(server)

    @staticmethod
    def configuration(**settings: object) -> Configuration:
        given: dict[str, object] = {"server.port": 0, "seed": SEED}
        given |= {name.replace("__", "."): value for name, value in settings.items()}
        return load(bundled_folder(), {name: Override("--it", value) for name, value in given.items()})

    def program(self, served: Served, layout: str = ">d") -> Program:
        program = Program(served, layout)
        self._stack.callback(program.close)
        return program


@pytest.fixture
def serve() -> Iterator[Serve]:
    with contextlib.ExitStack() as stack:
        yield Serve(stack)
