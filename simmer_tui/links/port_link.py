"""The serial port that one program at a time has open, by the hook in its pyserial or by a pseudo-terminal.

A subclass is the device behind it: the robot of a dialect, or a board.
"""

from __future__ import annotations

import socket
from abc import ABC, abstractmethod

from simmer_tui import platform_has
from simmer_tui.config.dialects import SERIAL
from simmer_tui.links.driver_lock import NOT_SERVED, DriverLock
from simmer_tui.links.hook_port import HookedProgram
from simmer_tui.links.link import LinkContext
from simmer_tui.links.peer import MOST_WAITING, PIECE, ReadBudget
from simmer_tui.links.pty_port import PtyDevice, PtyPort
from simmer_tui.links.serial_wire import SerialEndpoint
from simmer_tui.run.events import NOT_CONNECTED, Event, Notice, NoticeKind, ProgramEnded
from simmer_tui.sim.command import WORD, counted, cut

NO_HOOK = "it is no Python, it is frozen, or it was started with -I, -E or -S"
"""Reasons why a program may not use the hook."""


def no_hook_advice(terminal: PtyDevice | None) -> str:
    """The next step for a program without the hook, with the pseudo-terminal that there is."""
    if terminal is not None:
        other = f"let it open {terminal.path}"
    elif platform_has.POSIX:
        other = "give it a serial port with --pty PATH"
    else:
        other = "send commands over TCP (listeners)"
    return f"Run it as plain Python, or {other}"


class PortLink(ABC):
    """A `Link`, and the `SerialRobot` of its endpoints."""

    device = "robot"
    """Device behind the port, for messages."""

    def __init__(self, context: LinkContext) -> None:
        """Serve the port. Needs a running event loop."""
        self.budget = ReadBudget(PIECE)
        self.engine = context.engine
        self._context = context
        self._lock = context.driver_lock or DriverLock()
        self._programs: set[HookedProgram] = set()
        self._driver: SerialEndpoint | None = None
        """The program that has the port open."""
        self._instant = context.settings.line == "instant"
        self._last = ""
        """End of what the program wrote last."""
        self._has_exchanged = False
        """True once bytes have passed between the device and the program that has the port open."""
        self._reached = False
        """True once a program is known to find the port."""
        self._acceptor = context.accept(SERIAL, self._welcome)
        self._terminal: PtyPort | None = None
        if context.terminal is not None:
            self._terminal = PtyPort(context.terminal, self)
            where = str(context.terminal.path)
            self.engine.tell(Notice(NoticeKind.HINT, f"the {self.device}'s serial port is at {where}"))
        self.engine.watch(self._watch)

    @property
    def has_clients(self) -> bool:
        """True if a program is connected."""
        return bool(self._programs) or self._driver is not None

    def close(self) -> None:
        """End all connections."""
        self._acceptor.close()
        if self._terminal is not None:
            self._terminal.close()
        for program in tuple(self._programs):
            program.close()

    def _welcome(self, sock: socket.socket, peer: str) -> None:
        if len(self._programs) >= MOST_WAITING:
            self._acceptor.refuse(sock, peer)
            return
        self._programs.add(HookedProgram(sock, peer, self))

    def _watch(self, event: Event) -> None:
        """Report at its end that a program could not find the port."""
        if isinstance(event, Notice) and event.text.startswith(NOT_CONNECTED):
            self._reached = True
        elif isinstance(event, ProgramEnded) and event.started and not event.stopped:
            clock = self._context.clock
            if not (self._reached or self._lock.used or (clock is not None and clock.reached)):
                advice = no_hook_advice(self._context.terminal)
                self.engine.tell_fault(f"{NOT_CONNECTED}: {NO_HOOK}. {advice}")

    # -- the program's side ------------------------------------------------------------------------

    def reached(self) -> None:
        """Note that a program with the hook has begun: it will find the port."""
        self._reached = True

    def opened(self, endpoint: SerialEndpoint, name: str, baud: float | None) -> None:
        """Answer a program that opens a port, at `baud` bits a second if that is known."""
        names = self._context.settings.serial_names
        # A person has chosen the path of a pseudo-terminal.
        if isinstance(endpoint, HookedProgram) and names and name not in names:
            endpoint.answer(f"could not open port '{name}': there is only {', '.join(names)}")
            return
        refused = self._refused(endpoint, name)
        if refused:
            self.engine.tell_fault(f"a program opened {cut(name, WORD)}{refused}: it was refused")
            endpoint.answer(f"could not open port '{name}': Access is denied.")
            return
        # What the device sent before is nobody's.
        self.engine.now()
        self._driver = endpoint
        self._reached, self._has_exchanged, self._last = True, False, ""
        rate = ""
        if baud is not None:
            self.set_baud(endpoint, baud)
            rate = f" at {baud:g} baud"
        text = f"a program opened {cut(name, WORD)}{rate}"
        self.engine.tell(Notice(NoticeKind.CONNECTED, text, endpoint.peer))
        endpoint.answer("")
        self._joined(baud)

    def _refused(self, endpoint: SerialEndpoint, name: str) -> str:
        """The reason why a program may not open the port, with that port's name; empty if it may."""
        if self._context.clock is not None and not endpoint.by_clock:
            return f", but {NOT_SERVED}"
        if self._driver is not None:
            return f" while another one has {cut(self._driver.port, WORD)} open"
        refused = self._lock.acquire(self, f"a program by {name}")
        return f", but {refused}" if refused else ""

    def set_baud(self, endpoint: SerialEndpoint, baud: float) -> None:
        """Take another rate that the program has set, bits a second."""
        if endpoint is self._driver:
            self._set_rate(baud)

    def written(self, endpoint: SerialEndpoint, data: bytes) -> None:
        """Take bytes that the program has written."""
        if endpoint is self._driver and data:
            self._has_exchanged = True
            self.send(data)
            self._last = data[-60:].decode("utf-8", "surrogateescape").strip()

    def waits(self, endpoint: SerialEndpoint, place: str) -> None:
        """Note a read of the program that has waited for long, at the line `place`."""
        if endpoint is self._driver:
            last = f"; the last message was '{cut(self._last)}'" if self._last else ""
            self.engine.tell_fault(
                f"the program waits at {cut(place)} for bytes that have not come for 10 s{last}"
            )

    def closed(self, endpoint: SerialEndpoint, unread: int) -> None:
        """End with a program that has closed its port or has ended, and has left `unread` bytes unread."""
        if isinstance(endpoint, HookedProgram):
            self._programs.discard(endpoint)
        if endpoint is not self._driver:
            return
        self._flush()
        self._driver = None
        self._lock.release(self)
        self._left(endpoint)
        if unread:
            text = f"the program left {counted(unread, 'byte')} of replies unread"
            self.engine.tell(Notice(self._kind_of_unread(unread), text))
        text = f"the program closed {cut(endpoint.port, WORD)}"
        self.engine.tell(Notice(NoticeKind.LEFT, text, endpoint.peer))
        # One that only looks which ports there are is no client.
        if self._has_exchanged:
            self._context.client_left()

    # -- the device's side -------------------------------------------------------------------------

    @abstractmethod
    def send(self, data: bytes) -> None:
        """Send bytes to the device."""

    @abstractmethod
    def _joined(self, baud: float | None) -> None:
        """Begin with a program that has opened the port, and knows it."""

    @abstractmethod
    def _set_rate(self, baud: float) -> None:
        """Send the program's bytes at `baud` bits a second from now on."""

    @abstractmethod
    def _flush(self) -> None:
        """Deliver what is on the line: the program is about to leave."""

    @abstractmethod
    def _left(self, endpoint: SerialEndpoint) -> None:
        """End with a program that has left."""

    def _kind_of_unread(self, unread: int) -> NoticeKind:
        """Kind of the notice about bytes that the program did not read."""
        return NoticeKind.ROBOT
