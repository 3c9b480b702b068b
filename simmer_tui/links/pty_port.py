"""The robot's serial port for programs in any language: a pseudo-terminal in place of the cable."""

from __future__ import annotations

import asyncio
import math
import os
from collections import deque

from simmer_tui.links.peer import PIECE
from simmer_tui.links.pty_device import PtyDevice
from simmer_tui.links.serial_door import SerialRobot
from simmer_tui.links.serial_wire import DRIVER_BUFFER, FRAME
from simmer_tui.sessions import LoopTimer
from simmer_tui.sim.command import escape

# Nobody tells of an open: without one, reading fails at once. A person notices no 20 ms.
LOOK_AGAIN = 0.02
"""Seconds between two looks whether a program has opened the port."""


class PtyPort:
    """The serial port at the path of a pseudo-terminal; a door of the robot while a program has it open.

    It is opened, written, read and closed in the event loop, and never waited for.
    """

    def __init__(self, device: PtyDevice, robot: SerialRobot) -> None:
        self._device = device
        self._robot = robot
        self._loop = asyncio.get_running_loop()
        self._open = False
        self._coming: deque[tuple[float, float, bytes]] = deque()
        """Replies on the line: when they begin to arrive, the time of a byte, and the bytes."""
        self._passed = 0
        """Count of bytes of the first of them that were passed on."""
        self._next = LoopTimer(self._pass_on, self._loop)
        self._unread = bytearray()
        """Bytes that have arrived, and that the system takes no more."""
        self._lost = 0
        self.port = self.peer = str(device.path)
        self.by_clock = False
        self._look_again = LoopTimer(self._look, self._loop)
        self._look_again.set_in(0.0)

    def close(self) -> None:
        """Serve it no more; the device closes by itself."""
        self._leave()
        self._look_again.cancel()

    # -- coming and going ------------------------------------------------------------------------

    def _look(self) -> None:
        """Look whether a program has opened the port."""
        self._read()
        self._look_later()

    def _look_later(self) -> None:
        if not self._open and self._look_again.due == math.inf:
            self._look_again.set_in(LOOK_AGAIN)

    def _readable(self) -> None:
        if self._robot.budget.left > 0:
            self._read()
        else:
            self._robot.budget.wait(self._catch_up)

    def _catch_up(self) -> None:
        if self._open:
            self._readable()

    def _read(self) -> None:
        """Read what the program has written. On Linux reading fails while nobody has the port open; on macOS
        there is an end instead."""
        size = min(PIECE, max(self._robot.budget.left, 1))
        try:
            data = os.read(self._device.descriptor, size)
        except (BlockingIOError, InterruptedError):
            self._enter()
            return
        except OSError:
            data = b""
        if not data:
            self._leave()
            return
        self._robot.budget.spend(len(data))
        self._enter()
        if self._open:
            self._note_baud()
            self._robot.written(self, data)

    def _enter(self) -> None:
        """A program has opened the port."""
        if self._open:
            return
        self._open = True
        self._lost = 0
        self._loop.add_reader(self._device.descriptor, self._readable)
        self._robot.opened(self, self.port, None)

    def answer(self, refused: str) -> None:
        """The port is open; or the program at its other end is hung up on."""
        if not refused:
            self._note_baud()
            return
        self._forget()
        self._device.hang_up()
        self._look_later()

    def _leave(self) -> None:
        """The program has closed the port."""
        if not self._open:
            return
        waiting = len(self._unread) + sum(len(data) for _, _, data in self._coming) - self._passed
        self._forget()
        unread = self._device.forget_unread() + max(waiting, 0)
        self._robot.closed(self, unread)
        self._look_later()

    def _forget(self) -> None:
        self._open = False
        self._loop.remove_reader(self._device.descriptor)
        self._next.cancel()
        if self._unread:
            self._loop.remove_writer(self._device.descriptor)
        self._unread.clear()
        self._coming.clear()
        self._passed = 0

    def _note_baud(self) -> None:
        baud = self._device.baud
        if baud is not None:
            self._robot.set_baud(self, baud)

    # -- to the program --------------------------------------------------------------------------

    def deliver(self, begin: float, byte: float, data: bytes) -> None:
        """Have bytes of the robot arrive at the program at their times."""
        if not self._open:
            return
        self._coming.append((begin, byte, data))
        # A program that only listens says its rate by nothing else: it holds from the next reply on.
        self._note_baud()
        if self._next.due == math.inf:
            self._pass_on()

    def _pass_on(self) -> None:
        """Pass on what has arrived by now."""
        now = self._loop.time()
        while self._coming:
            begin, byte, data = self._coming[0]
            count = len(data)
            if byte > 0:
                count = min(count, int((now - begin) / byte + 1e-9))
            elif now < begin:
                count = 0
            if count > self._passed:
                self._write(data[self._passed : count])
                self._passed = count
            if self._passed < len(data):
                due = begin + (self._passed + 1) * byte
                self._next.set_at(max(due, now + FRAME))
                return
            self._coming.popleft()
            self._passed = 0

    def _write(self, data: bytes) -> None:
        if not self._unread:
            sent = self._send(data)
            data = data[sent:]
            if data:
                self._loop.add_writer(self._device.descriptor, self._flush)
        room = max(DRIVER_BUFFER - len(self._unread), 0)
        if len(data) > room:
            # Said for the first: more of them say the same.
            if not self._lost:
                where = escape(self.port, 80)
                self._robot.engine.tell_fault(
                    f"dialect: the program at {where} does not read: replies are lost"
                )
            self._lost += len(data) - room
        self._unread += data[:room]

    def _flush(self) -> None:
        del self._unread[: self._send(bytes(self._unread))]
        if not self._unread:
            self._loop.remove_writer(self._device.descriptor)

    def _send(self, data: bytes) -> int:
        """The count of bytes that the system has taken."""
        try:
            return os.write(self._device.descriptor, data)
        except (BlockingIOError, InterruptedError):
            return 0
        except OSError:  # the program has gone, which reading tells
            return len(data)
