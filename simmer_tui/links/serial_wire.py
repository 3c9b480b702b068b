"""The robot's serial port between a program and a robot that a dialect simulates.

It has the interface of ports that programs open, the robot's side of one, and the wire, which delays bytes
both ways.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Protocol

from simmer_tui.config.settings import BITS_OF_A_BYTE
from simmer_tui.dialect.frames import Framing
from simmer_tui.dialect.timer import Timer
from simmer_tui.links.peer import ReadBudget
from simmer_tui.robot.engine import Engine


class SerialEndpoint(Protocol):
    """A program with an open serial port, by the hook in its pyserial or by a pseudo-terminal."""

    peer: str
    port: str
    """The name of the port that it has opened."""
    by_clock: bool
    """True if the program uses the program's clock."""

    def answer(self, refused: str) -> None:
        """Answer that the port is open, or the reason why it is not."""

    def deliver(self, begin: float, byte: float, data: bytes) -> None:
        """Pass on bytes of the robot: they begin to arrive at `begin`, by the loop's clock, and each takes
        `byte` seconds."""


class SerialRobot(Protocol):
    """The robot's side of the port. One program at a time has it open."""

    engine: Engine
    budget: ReadBudget

    def reached(self) -> None:
        """A program with the hook has begun: it will find the port."""

    def opened(self, endpoint: SerialEndpoint, name: str, baud: float | None) -> None:
        """A program opens a port, at a baud rate if that is known. Its `answer` is called."""

    def written(self, endpoint: SerialEndpoint, data: bytes) -> None:
        """The program has written bytes."""

    def set_baud(self, endpoint: SerialEndpoint, baud: float) -> None:
        """The program has set another baud rate."""

    def waits(self, endpoint: SerialEndpoint, place: str) -> None:
        """A read of the program has waited for long, at the line `place`."""

    def closed(self, endpoint: SerialEndpoint, unread: int) -> None:
        """The program has closed the port, or has ended, and has left so many bytes unread."""


# The size of a serial driver's buffer: Linux' tty layer has 4,096 bytes.
DRIVER_BUFFER = 4096
"""Bytes of replies that may wait; beyond it whole messages of a stream are dropped."""

# Half a minute at 9600 baud. Linux' driver would let the program wait at 4,096 bytes. All of them arrive at
# once when the port is closed, which takes half a second.
MOST_IN_TRANSIT = 8 * DRIVER_BUFFER
"""Bytes of a program that may be under way to the robot; further ones are lost."""

# USB serial adapters and boards pass on their bytes once a frame of USB, which is 1 ms. A program that reads
# up to a bracket and clears its buffer relies on it: at 115200 baud the line end comes in the same frame.
USB_FRAME = 0.001
"""Seconds of bytes that become readable together, if the robot has written them in one piece."""


class LostBytes:
    """Count of a program's bytes that the line could not keep. It is told at the first loss, and in sum."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._count = self._told = 0

    def add(self, count: int) -> None:
        """Count bytes that are lost, if `count` is above 0."""
        if count <= 0:
            return
        self._count += count
        if not self._told:
            self._told = count
            self._engine.tell_fault(
                f"the program writes faster than the line carries: {MOST_IN_TRANSIT} bytes wait, "
                f"{count} more are lost. A write to a real port would wait"
            )

    def report(self) -> None:
        """Tell the sum, unless it is known, and begin again: the program has closed the port."""
        if self._count > self._told:
            self._engine.tell_fault(f"{self._count} bytes of the program were lost on the line")
        self._count = self._told = 0


class Wire:
    """The delay of bytes on a line of `baud` bits a second, both ways; 0 is a line without delay. Times are
    simulated seconds."""

    def __init__(self, engine: Engine, framing: Framing, baud: float) -> None:
        self._engine = engine
        self._framing = framing
        self._in_free = self._out_free = -math.inf
        self.byte = 0.0
        """Time of a byte, seconds."""
        self._in_transit: deque[Timer] = deque()
        """The arrivals of messages to the robot, in order; the first ones may be over."""
        self._under_way = 0
        """The bytes of these messages."""
        self.left_out = 0
        """Count of messages of streams that were left out."""
        self._lost = LostBytes(engine)
        self.set_baud(baud)

    def set_baud(self, baud: float) -> None:
        """Use another rate from now on."""
        self.byte = BITS_OF_A_BYTE / baud if baud > 0 else 0.0

    def transmit(self, data: bytes, receive: Callable[[bytes], None]) -> None:
        """Send bytes of the program to the robot. Each message arrives with its last byte."""
        now = self._engine.now()
        at = max(self._in_free, now)
        taken = 0
        for part in self._framing.pieces(data):
            while self._in_transit and not self._in_transit[0].pending:
                self._in_transit.popleft()
            if self._under_way > MOST_IN_TRANSIT:
                self._lost.add(len(data) - taken)
                break
            taken += len(part)
            self._under_way += len(part)
            at += len(part) * self.byte
            if at <= now and not self._in_transit:
                self._arrive(receive, part)
            else:
                arrival = Timer(partial(self._arrive, receive, part))
                self._in_transit.append(arrival)
                self._engine.call_at(at, arrival)
        self._in_free = at

    def _arrive(self, receive: Callable[[bytes], None], data: bytes) -> None:
        self._under_way -= len(data)
        with self._engine.moment():
            receive(data)

    def flush(self) -> None:
        """Deliver all bytes under way to the robot now: the program has closed the port. For the next one the
        line is free."""
        while self._in_transit:
            self._in_transit.popleft()()
        self._in_free = self._out_free = -math.inf
        self._lost.report()

    def delay(self, count: int, *, droppable: bool = False) -> float | None:
        """Time until the first of `count` bytes of the robot begins; they are sent. None if too many bytes
        wait and these are `droppable`."""
        now = self._engine.now()
        begin = max(self._out_free, now)
        if droppable and self.byte and (begin - now) / self.byte + count > DRIVER_BUFFER:
            self.left_out += 1
            return None
        self._out_free = begin + count * self.byte
        return begin - now
