"""The clients of the connection-per-message dialects: the program behind each address, and its presence."""

from __future__ import annotations

import asyncio
import math
import socket
from collections.abc import Callable
from dataclasses import dataclass

from simmer_tui.links.link import LinkContext
from simmer_tui.links.peer import host_of
from simmer_tui.links.processes import Process
from simmer_tui.links.protocol.packets import Mailbox
from simmer_tui.robot.sessions import LoopTimer
from simmer_tui.run.events import Notice, NoticeKind
from simmer_tui.sim.command import counted

# Judged: a long computation or a coffee. After a longer halt in a debugger a program asks again.
LONGEST_KEPT = 600.0
"""Seconds after its program's last request for which a reply is kept while the program lives."""
# Programs pause 40 to 300 ms between two messages, and starting another program takes longer than this.
SAME_PROGRAM = 0.03
"""Seconds within which the next message from an address counts as the same program's."""
# Judged: soon enough for a robot whose program has crashed, and cheap.
_LOOK = 0.25
"""Seconds between two checks that the program that owns the velocity still lives."""


@dataclass(frozen=True, slots=True)
class PacketDriver:
    """The owner of a velocity that came in a packet: the process, if it is known, otherwise the address."""

    address: str
    process: Process | None


@dataclass(slots=True)
class _Client:
    """State of an address: times of its last message and last request, count of its requests, and the process
    if known."""

    last: float
    last_request: float
    timer: asyncio.TimerHandle
    requests: int = 0
    process: Process | None = None


@dataclass(eq=False)
class Presence:
    """Tells watchers when a client's first request has come, and when no more have for `idle` seconds.

    Replies in the mailbox whose program has gone are dropped.

    Args:
        context: The processes of connections, and the engine that tells.
        mailbox: Replies that wait.
        is_connected: True for a silent address that is there all the same.
        on_left: Called with the address of a client that has left, and True if it has sent a request that
            counts.
    """

    context: LinkContext
    mailbox: Mailbox
    is_connected: Callable[[str], bool]
    on_left: Callable[[str, bool], None]

    def __post_init__(self) -> None:
        self._engine = self.context.engine
        self._idle = self.context.settings.idle
        self._processes = self.context.processes
        self._loop = asyncio.get_running_loop()
        self._clients: dict[str, _Client] = {}
        self._connecting: dict[str, Process] = {}
        """The processes of connections on which nothing has come yet, by peer."""
        self._next_look = LoopTimer(self._look, self._loop)

    def connected(self, sock: socket.socket, peer: str) -> None:
        """Take a connection on either port. Its process is asked for now, since it may be closed the next
        moment."""
        client = self._clients.get(host_of(peer))
        # In a quick exchange it is the same program as before, and needs no look-up.
        if self._processes is None or (client is not None and self._loop.time() - client.last < SAME_PROGRAM):
            return
        found = self._processes.holder(sock, peer, client.process if client is not None else None)
        if found is not None:
            self._connecting[peer] = found

    @property
    def any(self) -> bool:
        """True if a client is present."""
        return bool(self._clients)

    def disconnected(self, peer: str) -> None:
        """A connection for requests has ended."""
        self._connecting.pop(peer, None)

    def read(self, peer: str) -> None:
        """A read on the reply port has come."""
        client, process = self._clients.get(host_of(peer)), self._connecting.pop(peer, None)
        if client is not None:
            client.last = self._loop.time()
            # Its program reads: many close their request before its process can be looked up.
            client.process = process or client.process

    def takes(self, peer: str) -> None:
        """Prepare a read that is about to get the waiting replies.

        Replies from before its program began are another's, and are dropped if there are newer ones. A
        program that only reads, such as the second of two `nc`, gets all of them.
        """
        address = host_of(peer)
        client = self._clients.get(address)
        if client is not None and client.process is not None:
            began = self._loop.time() - client.process.age
            if self.mailbox.has(address, began):
                self._drop(address, "the program that reads was not there yet", began)

    def asked(self, peer: str, *, counts: bool = True) -> PacketDriver:
        """Take a request: replies that wait for another process, or from long before, are dropped. Returns
        the request's owner. A probe of the port has no request that `counts`."""
        address, now = host_of(peer), self._loop.time()
        process = self._connecting.pop(peer, None)
        client = self._clients.get(address)
        if client is None:
            timer = self._loop.call_later(self._idle, self._look_for, address)
            client = self._clients[address] = _Client(now, now, timer, process=process)
            self._engine.tell(Notice(NoticeKind.CONNECTED, f"client {address} sends packets", address))
        elif now - client.last_request > SAME_PROGRAM:
            self._ask_again(client, address, process, now)
        client.last = client.last_request = now
        client.requests += counts
        return PacketDriver(address, client.process)

    def _ask_again(self, client: _Client, address: str, process: Process | None, now: float) -> None:
        before = client.process
        if process is not None and before is not None and process != before:
            self._drop(address, "another program asks")
        elif now - client.last_request > self._idle:
            self._drop(address, f"its program asks again after {now - client.last_request:.0f} s")
        # A message closed before its process could be looked up counts as the same process's while that
        # lives.
        if process is not None or (before is not None and not before.lives):
            client.process = process

    def _drop(self, address: str, why: str, before: float = math.inf) -> None:
        """Drop the waiting replies of an address, or those from before the time `before`, and report it."""
        dropped = self.mailbox.drop(address, before)
        if dropped:
            self._engine.tell_fault(f"{dropped} replies dropped: {why}")

    def watch_velocity(self) -> None:
        """Watch the velocity after a command's answer: one that came in a packet ends with its program."""
        if isinstance(self._engine.driving.driver, PacketDriver) and self._next_look.due == math.inf:
            self._next_look.set_in(_LOOK)

    def _look(self) -> None:
        driver = self._engine.driving.driver
        if isinstance(driver, PacketDriver):
            process = driver.process
            if not (driver.address in self._clients if process is None else process.lives):
                self._engine.driver_left(driver)
            self.watch_velocity()

    def close(self) -> None:
        """Stop tracking clients."""
        self._next_look.cancel()
        for client in self._clients.values():
            client.timer.cancel()
        self._clients.clear()

    def _look_for(self, address: str) -> None:
        client = self._clients[address]
        # A connection that stays open is a sign of life, even if nothing comes on it.
        if self.is_connected(address):
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
        # The next program's first read is its own.
        self._drop(address, f"client {address} left without reading them")
        self.on_left(address, client.requests > 0)

    def _is_kept(self, client: _Client, address: str) -> bool:
        """True if replies wait for a process that lives."""
        process = client.process
        if process is None and self._processes is not None:  # closed before its process could be looked up
            process = self._processes.of_run
        return process is not None and self.mailbox.has(address) and process.lives
