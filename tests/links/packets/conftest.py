"""A packet link with real sockets on a clock that the test moves, and servers in real time."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from simmer_tui.config.dialects import PACKET_REPLIES, PACKETS
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_sets
from simmer_tui.config.settings import ServerSettings
from simmer_tui.config.settings_file import Override
from simmer_tui.links.backend import BackendSwitch
from simmer_tui.links.link import LinkContext
from simmer_tui.links.packet_link import PacketLink
from simmer_tui.links.ports import PortRequest, take_port
from simmer_tui.live.server import Server
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Event, MovementPlanned, Notice
from simmer_tui.sim import CommandResult, Simulator, Status
from tests.stepped_clock import SECONDS, StandingClock

HOST = "127.0.0.1"


@dataclass
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
    unanswered: int
    """Commands that have come in and are not answered yet."""


class Bench:
    """A packet link on a clock, with all that was told."""

    def __init__(
        self, clock: StandingClock, engine: dict[str, Any], link: dict[str, Any], **settings: Any
    ) -> None:
        configuration = load(
            bundled_sets()["simmer-python"],
            {name.replace("__", "."): Override("--it", value) for name, value in settings.items()},
        )
        self.clock = clock
        self.simulator = Simulator(configuration.simulation, seed=5)
        self.engine = Engine(self.simulator, **({"timed": True} | engine))
        self.events: list[Event] = []
        self.engine.watch(self.events.append)
        self.engine.start(clock)
        self.left = 0
        self.ports = [take_port(HOST, PortRequest(0, name, "--it")) for name in ("packets", "replies")]
        self._options = link
        self._processes = self._options.pop("processes", None)
        self.link: PacketLink
        self.sockets: list[socket.socket] = []

    async def open(self) -> None:
        reply = "done" if self._options.pop("answer_at_end", False) else "auto"
        self.link = PacketLink(
            LinkContext(
                self.engine,
                BackendSwitch(self.engine),
                dict(zip((PACKETS.purpose, PACKET_REPLIES.purpose), self.ports, strict=True)),
                ServerSettings(**self._options),
                reply,
                processes=self._processes,
                client_left=self._left,
            )
        )

    def _left(self) -> None:
        self.left += 1

    @property
    def traffic(self) -> Traffic:
        """Counts of what is in progress now."""
        link, speaking = self.link, sum(sender.spoken for sender in self.link.senders)
        reads, unread = len(link.replies.reads), len(link.replies.unread)
        return Traffic(len(link.senders), speaking, reads, unread, link.unanswered)

    @property
    def outcomes(self) -> list[CommandResult]:
        return [event for event in self.events if isinstance(event, CommandResult)]

    @property
    def busy(self) -> list[CommandResult]:
        return [each for each in self.outcomes if each.status is Status.BUSY]

    @property
    def movements(self) -> list[MovementPlanned]:
        return [event for event in self.events if isinstance(event, MovementPlanned)]

    @property
    def notices(self) -> list[str]:
        return [event.text for event in self.events if isinstance(event, Notice)]

    async def connect(self, port: int) -> socket.socket:
        made = socket.socket()
        made.setblocking(False)
        self.sockets.append(made)
        await self.clock.sock_connect(made, (HOST, self.ports[port].port))
        return made

    def connect_now(self, port: int) -> socket.socket:
        """A connection that the loop has no turn to accept meanwhile."""
        made = socket.create_connection((HOST, self.ports[port].port))
        made.setblocking(False)
        self.sockets.append(made)
        return made

    async def send(self, data: bytes, items: int) -> None:
        """One message on a connection of its own, closed at once; returns when so many commands
        have been answered."""
        wanted, others = len(self.outcomes) + items, self.traffic.connections
        sender = await self.connect(0)
        await self.clock.sock_sendall(sender, data)
        sender.close()
        await self.clock.until(lambda: len(self.outcomes) >= wanted)
        await self.clock.until(lambda: self.traffic.connections <= others and len(self.outcomes) >= wanted)

    async def stay(self, data: bytes, items: int) -> socket.socket:
        """The same on a connection that stays open."""
        wanted = len(self.outcomes) + items
        sender = await self.connect(0)
        await self.clock.sock_sendall(sender, data)
        await self.clock.until(lambda: len(self.outcomes) >= wanted)
        return sender

    async def read(self) -> bytes:
        """The result of one read when something waits: all bytes up to a clean end."""
        reader = await self.connect(1)
        return await self.rest(reader)

    async def rest(self, reader: socket.socket) -> bytes:
        data = b""
        while more := await self.clock.sock_recv(reader, 65536):
            data += more
        reader.close()
        return data

    async def begin_read(self) -> socket.socket:
        """A read that waits."""
        waiting = self.traffic.reads
        reader = await self.connect(1)
        await self.clock.until(lambda: self.traffic.reads > waiting)
        return reader

    async def ask(self, data: bytes, items: int = 1) -> bytes:
        """Send and read, as the programs do."""
        await self.send(data, items)
        return await self.read()

    def reset(self, connection: socket.socket) -> None:
        """End a connection as a killed program does."""
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        connection.close()


class OnClock:
    """Runs a scenario, a coroutine function of a bench, on a clock."""

    def __init__(self, stack: contextlib.ExitStack) -> None:
        self._stack = stack

    def __call__(
        self,
        scenario: Callable[[Bench], Awaitable[Any]],
        *,
        engine: dict[str, Any] | None = None,
        link: dict[str, Any] | None = None,
        **settings: Any,
    ) -> Any:
        clock = StandingClock()
        self._stack.callback(clock.close)
        bench = Bench(clock, engine or {}, link or {}, **settings)

        async def run() -> Any:
            await bench.open()
            try:
                return await scenario(bench)
            finally:
                bench.link.close()
                for each in bench.sockets:
                    each.close()
                for _ in range(5):
                    await asyncio.sleep(0)

        return clock.run_until_complete(run())


@pytest.fixture
def on_clock() -> Iterator[OnClock]:
    with contextlib.ExitStack() as stack:
        yield OnClock(stack)


class Served:
    """A server in real time, in its own thread, and what it told."""

    def __init__(self, **settings: object) -> None:
        given: dict[str, object] = {"server.packet_port": 0}
        given |= {name.replace("__", "."): value for name, value in settings.items()}
        overrides = {name: Override("--it", value) for name, value in given.items()}
        self.server = Server(load(bundled_sets()["simmer-python"], overrides))
        self.events: list[Event] = []
        self._changed = threading.Condition()
        self.server.start(self._watch)

    def _watch(self, event: Event) -> None:
        with self._changed:
            self.events.append(event)
            self._changed.notify_all()

    @property
    def notices(self) -> list[str]:
        return [event.text for event in tuple(self.events) if isinstance(event, Notice)]

    @property
    def answered(self) -> int:
        return sum(isinstance(event, CommandResult) for event in tuple(self.events))

    def wait(self, condition: Callable[[], object]) -> None:
        """Wait until something told makes the condition true."""
        with self._changed:
            assert self._changed.wait_for(condition, SECONDS), self.notices

    def connect(self, purpose: str = PACKETS.purpose) -> socket.socket:
        return socket.create_connection((HOST, self.server.ports[purpose]), SECONDS)

    def send(self, data: bytes) -> None:
        with self.connect() as sender:
            sender.sendall(data)

    def read(self) -> bytes:
        """One `recv`, as the programs do it."""
        with self.connect(PACKET_REPLIES.purpose) as reader:
            return reader.recv(1024)

    def read_all(self) -> bytes:
        """One read, up to its end."""
        with self.connect(PACKET_REPLIES.purpose) as reader:
            return b"".join(iter(lambda: reader.recv(1024), b""))

    def ask(self, data: bytes) -> bytes:
        """The next reply, read again and again until there is one."""
        self.send(data)
        return self.next_reply()

    def next_reply(self) -> bytes:
        deadline = time.monotonic() + SECONDS
        while time.monotonic() < deadline:
            if reply := self.read():
                return reply
        raise AssertionError("no reply")


@pytest.fixture
def served() -> Iterator[Callable[..., Served]]:
    with contextlib.ExitStack() as stack:

        def start(**settings: object) -> Served:
            made = Served(**settings)
            stack.callback(made.server.stop)
            return made

        yield start
