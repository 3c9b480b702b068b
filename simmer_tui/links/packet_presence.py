"""The clients of the connection-per-message dialects: the program behind each address, and its presence.

Replies wait in the `Mailbox` for the address that asked, at most ten minutes. That needs nothing of this
module. These cases do:

- A program begins. The replies for the one before are dropped then. A packet has no connection that lasts, so
  only the process of a request, or a long silence, shows that it is another program.
- A program leaves. Watchers are told and the right to drive is released, and a velocity must not outlast its
  program. Nothing ends but the process. Where that is not known, `idle` seconds of silence count.
- A program is halted in a debugger. It is silent for longer than `idle`, but lives and will read its reply.
- A velocity was set by a connection that was closed at once. Its process cannot be found any more: a Python
  client closes 0.04 ms after it has connected, before the server has accepted. On a busy machine 5 of 60
  were found. A later read of the same address, or the program of `--run`, tells who it was.
"""

from __future__ import annotations

import asyncio
import math
import socket
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from ipaddress import ip_address

from simmer_tui import platform_has
from simmer_tui.links.link import LinkContext
from simmer_tui.links.peer import host_of
from simmer_tui.links.processes import Process
from simmer_tui.links.protocol.packets import Mailbox
from simmer_tui.robot.timers import LoopTimer
from simmer_tui.run.events import Notice, NoticeKind
from simmer_tui.sim.command import counted

# Programs pause 40 to 300 ms between two messages, and starting another program takes longer than this.
SAME_PROGRAM = 0.03
"""Seconds within which the next message from an address counts as the same program's."""
# Judged: soon enough for a robot whose program has crashed, and cheap.
_LOOK = 0.25
"""Seconds between two checks that the program that owns the velocity still lives."""
# Programs with simmer-python read within 0.3 s of their request, and are known from then on.
_UNSEEN = 1.0
"""Seconds after which the owner of a velocity whose process has not been seen is reported."""


@dataclass(slots=True)
class PacketDriver:
    """The owner of a velocity that came in a packet: the process, once it is known, otherwise the address.

    `came` is the time of its connection. While it `is_sought` its process is being looked for.
    """

    address: str
    came: float = field(default=0.0, compare=False)
    process: Process | None = None
    is_sought: bool = field(default=False, compare=False)
    has_asked: bool = field(default=False, compare=False)

    def __hash__(self) -> int:  # the process may become known later
        return hash(self.address)


@dataclass(slots=True)
class _Client:
    """State of an address: times of its last message and last request, count of its requests, and the process
    of the last one, if known."""

    last: float
    last_request: float
    timer: asyncio.TimerHandle
    requests: int = 0
    process: Process | None = None
    is_warned: bool = False
    lived: float = -math.inf
    """Time at which the process was last seen to live."""


@dataclass(eq=False)
class Presence:
    """Tells watchers when a client's first request has come, and when no more have for `idle` seconds.

    When another program begins, the replies that wait for the one before it are dropped.

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
        self._senders: dict[str, PacketDriver] = {}
        """The senders that are connected, by peer."""
        self._next_look = LoopTimer(self._look, self._loop)

    @property
    def any(self) -> bool:
        """True if a client is present."""
        return bool(self._clients)

    def connected(self, peer: str) -> None:
        """Take a connection for requests."""
        self._senders[peer] = PacketDriver(host_of(peer), self._loop.time())

    def seek(self, sock: socket.socket, peer: str) -> None:
        """Look for the process of a connection, as long as it is open."""
        sender, now = self._senders.get(peer), self._loop.time()
        if self._processes is None or sender is None:
            return
        address = sender.address
        client = self._clients.get(address)
        # By the program's clock no other program drives, and a search in real time would make runs differ.
        if self.context.clock is not None:
            sender.process = self._of_run(address)
        # In a quick exchange it is the same program as before, and needs no look-up.
        elif client is not None and now - client.last < SAME_PROGRAM and self._lives(client):
            sender.process = client.process
        else:
            sender.is_sought = True
            known = client.process if client is not None else None
            self._processes.seek(sock, peer, known, partial(self._found, sender))

    def disconnected(self, peer: str) -> None:
        """A connection for requests has ended."""
        self._senders.pop(peer, None)

    def _found(self, sender: PacketDriver, process: Process | None) -> None:
        sender.is_sought, sender.process = False, process
        if sender.has_asked:
            self._identify(sender)

    def asked(self, peer: str, *, counts: bool = True) -> PacketDriver:
        """Take a request. Replies that wait for another process, which has ended, or from before a long
        silence, are dropped. Returns the request's owner. A probe of the port has no request that `counts`.
        """
        address, now = host_of(peer), self._loop.time()
        sender = self._senders.get(peer) or PacketDriver(address, now)
        client = self._clients.get(address)
        if client is None:
            self._drop(address, "another program begins")
            timer = self._loop.call_later(self._idle, self._look_for, address)
            client = self._clients[address] = _Client(now, now, timer)
            self._engine.tell(Notice(NoticeKind.CONNECTED, f"client {address} sends packets", address))
        elif now - client.last_request > self._idle:
            self._drop(address, f"its program asks again after {now - client.last_request:.0f} s")
        sender.has_asked = True
        if not sender.is_sought:
            self._identify(sender)
        client.last = client.last_request = now
        client.requests += counts
        return sender

    def _identify(self, sender: PacketDriver) -> None:
        """Note the process of a request, as far as it was seen."""
        client = self._clients.get(sender.address)
        if client is None:
            return
        before = client.process
        if before is not None and before != sender.process and not before.lives:
            self._drop(sender.address, "another program asks", sender.came)
            client.process = None
        # A request whose process was not seen counts as the last one's while that lives.
        client.process = sender.process = sender.process or client.process or self._of_run(sender.address)
        if client.process != before:
            client.lived = -math.inf

    def _of_run(self, address: str) -> Process | None:
        """The program of --run while it lives: a local sender that closed before it was seen."""
        process = self._processes.of_run if self._processes is not None else None
        is_here = process is not None and ip_address(address).is_loopback and process.lives
        return process if is_here else None

    def read(self, sock: socket.socket, peer: str, done: Callable[[], None]) -> bool:
        """Take a read on the reply port: its program asked, unless it began later.

        Its process is needed only where that of the request was not seen. It is looked for while the read
        waits: then this returns True, and calls `done`.
        """
        address = host_of(peer)
        client = self._clients.get(address)
        if client is None:
            return False
        client.last = self._loop.time()
        if self._processes is None or self._lives(client) or self.context.clock is not None:
            return False
        waits = True

        def found(process: Process | None) -> None:
            nonlocal waits
            waits = False
            if process is not None:
                self._reads(address, process)
            done()

        self._processes.seek(sock, peer, None, found)
        return waits

    def _lives(self, client: _Client) -> bool:
        """True if a client's process is known, and lives, or did so a moment ago: the system is asked often
        enough."""
        now = self._loop.time()
        if client.process is not None and now - client.lived >= SAME_PROGRAM and client.process.lives:
            client.lived = now
        return client.process is not None and now - client.lived < SAME_PROGRAM

    def _reads(self, address: str, process: Process) -> None:
        """A process reads: it has sent the requests whose process was not seen, if it was there."""
        began = self._loop.time() - process.age
        client, driver = self._clients.get(address), self._engine.driving.driver
        if client is not None and client.process is None and began <= client.last_request:
            client.process, client.lived = process, -math.inf
        if isinstance(driver, PacketDriver) and driver.address == address and began <= driver.came:
            driver.process = driver.process or process

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
            process, client = driver.process, self._clients.get(driver.address)
            if not (client is not None if process is None else process.lives):
                self._engine.driver_left(driver)
            elif process is None and client is not None and not client.is_warned:
                client.is_warned = self._warn(driver)
            self.watch_velocity()

    def _warn(self, driver: PacketDriver) -> bool:
        """Report that a velocity does not end with its program, once that is sure; True if it was."""
        if self._processes is None or self._loop.time() - driver.came < _UNSEEN:
            return False
        text = (
            f"the process of client {driver.address} is not known: after its end its velocity lasts up to "
            f"{self._idle:g} s (--idle)"
        )
        if platform_has.LINUX and ip_address(driver.address).is_loopback:
            text += ". Read each reply, or keep the connection open"
        self._engine.tell(Notice(NoticeKind.HINT, text))
        return True

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
        left = client.last + self._idle - self._loop.time()
        # A program that computes for long, or is halted in a debugger, will read its reply.
        if left <= 0 and self.mailbox.has(address) and self._lives(client):
            left = self._idle
        if left > 0:
            client.timer = self._loop.call_later(left, self._look_for, address)
            return
        del self._clients[address]
        requests = counted(client.requests, "request")
        text = f"client {address} gone after {requests}: silent for {self._idle:g} s"
        self._engine.tell(Notice(NoticeKind.LEFT, text, address))
        self.on_left(address, client.requests > 0)
