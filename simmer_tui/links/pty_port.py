"""The serial port of programs in any language: a pseudo-terminal in place of the cable. Unix alone."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import stat
import struct
import sys
import time
from collections import deque
from functools import cache
from pathlib import Path

from simmer_tui import platform_has
from simmer_tui.errors import PortError, reason_of
from simmer_tui.links.peer import PIECE
from simmer_tui.links.serial_wire import DRIVER_BUFFER, USB_FRAME, SerialRobot
from simmer_tui.robot.timers import LoopTimer
from simmer_tui.sim.command import cut

NOT_ON_WINDOWS = (
    "--pty: Windows has no pseudo-terminals. A Python program is led to the robot by --run, or by what "
    "simmer-tui env prints"
)
"""The warning about it."""
# TCGETS2 of Linux' asm-generic/ioctls.h, as in pyserial: it has rates without a constant of their own. Its
# struct termios2 has four flags, the line, 19 characters, and two rates as plain numbers.
_TCGETS2, _TERMIOS2 = 0x802C542A, struct.Struct("=IIIIB19sII")


class PtyDevice:
    """The robot's end of a pseudo-terminal, open until closed."""

    descriptor: int
    name: str
    """The system's name of the program's end."""

    def __init__(self, path: str) -> None:
        """Make one, and the link to it. Raises PortError."""
        self.path = platform_has.expanded(path).absolute()
        try:
            # Before a pseudo-terminal is made, which may get the number of the one that the link led to.
            self._clear()
            self._make()
        except OSError as error:
            raise PortError(f"--pty {path}: {reason_of(error)}") from None
        try:
            self._link()
        except OSError as error:
            os.close(self.descriptor)
            raise PortError(f"--pty {path}: {reason_of(error)}") from None

    def _make(self) -> None:
        if sys.platform == "win32" or not platform_has.POSIX:
            raise PortError(NOT_ON_WINDOWS)
        import termios
        import tty

        try:
            self.descriptor, end = os.openpty()
        except OSError as error:
            raise PortError(f"--pty: no pseudo-terminal can be made: {reason_of(error)}") from None
        self.name = os.ttyname(end)
        # Bytes pass unchanged, also for programs that set nothing, such as cat.
        tty.setraw(end)
        # Of a program that sets none. Otherwise it would be 38400.
        attributes = termios.tcgetattr(end)
        attributes[4:6] = [termios.B9600] * 2
        termios.tcsetattr(end, termios.TCSANOW, attributes)
        os.close(end)
        os.set_blocking(self.descriptor, False)

    def _clear(self) -> None:
        """Remove the link of an earlier run that was killed. Raises OSError, PortError."""
        if not self.path.is_symlink():
            return
        if not _is_dead(self.path):
            raise PortError(
                f"--pty {self.path}: it leads to {self.path.readlink()} already: end the simmer-tui that "
                "made it, remove it, or name another path"
            )
        self.path.unlink()

    def _link(self) -> None:
        """Set the link at the path. Raises OSError."""
        self.path.symlink_to(self.name)
        with contextlib.suppress(OSError, NotImplementedError):
            # By this machine's clock, which may differ from a file server's (see `_is_dead`).
            os.utime(self.path, ns=(time.time_ns(),) * 2, follow_symlinks=False)

    def hang_up(self) -> None:
        """Disconnect the program that has it open: its next read or write fails. The path leads to a new
        pseudo-terminal."""
        old = self.descriptor
        self._unlink()
        self._make()
        with contextlib.suppress(OSError):  # another program has taken the path meanwhile
            self._link()
        os.close(old)

    def close(self) -> None:
        """Remove the link and end the pseudo-terminal."""
        self._unlink()
        os.close(self.descriptor)

    def _unlink(self) -> None:
        with contextlib.suppress(OSError):
            if str(self.path.readlink()) == self.name:  # not one that another program has put there
                self.path.unlink()

    @property
    def baud(self) -> float | None:
        """The rate that the program has set, bits a second; None if it is not known."""
        if sys.platform == "win32":
            return None
        import termios

        try:
            rate = termios.tcgetattr(self.descriptor)[5]
        except (termios.error, OSError):
            return None
        known = _rates().get(rate)
        if known is None and platform_has.LINUX:
            import fcntl

            try:
                answer = fcntl.ioctl(self.descriptor, _TCGETS2, bytes(_TERMIOS2.size))
            except OSError:
                return None
            known = _TERMIOS2.unpack(answer)[-1]
        return float(known) if known is not None else float(rate)

    def forget_unread(self) -> int:
        """Drop the bytes that a program which has left did not read. Returns their count, as far as it is
        known."""
        if sys.platform == "win32":
            return 0
        import fcntl
        import termios

        try:
            end = os.open(self.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError:
            return 0
        try:
            (count,) = struct.unpack("=i", fcntl.ioctl(end, termios.FIONREAD, bytes(4)))
            termios.tcflush(end, termios.TCIOFLUSH)
        except (termios.error, OSError):
            return 0
        finally:
            os.close(end)
        return int(count)


def _is_dead(path: Path) -> bool:
    """True if a link leads to no pseudo-terminal, or to one that was made after the link: it has the number
    of an earlier one. Raises OSError."""
    made = path.lstat().st_mtime_ns
    try:
        target = path.stat()
    except FileNotFoundError:
        return True
    # Linux makes the device with its pseudo-terminal; elsewhere it is older than any.
    return platform_has.LINUX and stat.S_ISCHR(target.st_mode) and target.st_ctime_ns > made


@cache
def _rates() -> dict[int, int]:
    """Baud rates by the values of their constants."""
    import termios

    names = [name for name in dir(termios) if name[0] == "B" and name[1:].isdigit()]
    return {int(getattr(termios, name)): int(name[1:]) for name in names}


# No event reports an open: without one, reading fails at once. A person does not notice 20 ms.
_LOOK_AGAIN = 0.02
"""Seconds between two checks that a program has opened the port."""


class PtyPort:
    """The serial port at the path of a pseudo-terminal: a `SerialEndpoint` while a program has it open. It is
    opened, written, read and closed in the event loop, without blocking."""

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
        self._has_lost = False
        """True once bytes were lost; reported once, since more of them mean the same."""
        self.port = self.peer = str(device.path)
        self.by_clock = False
        self._look_again = LoopTimer(self._look, self._loop)
        self._look_again.set_in(0.0)

    def close(self) -> None:
        """Stop serving it; the device is closed separately."""
        self._leave()
        self._look_again.cancel()

    # -- coming and going ------------------------------------------------------------------------

    def _look(self) -> None:
        """Check that a program has opened the port."""
        self._read()
        self._look_later()

    def _look_later(self) -> None:
        if not self._open and self._look_again.due == math.inf:
            self._look_again.set_in(_LOOK_AGAIN)

    def _readable(self) -> None:
        if self._robot.budget.left > 0:
            self._read()
        else:
            self._robot.budget.wait(self._catch_up)

    def _catch_up(self) -> None:
        if self._open:
            self._readable()

    def _read(self) -> None:
        """Read what the program has written. On Linux a read fails while nobody has the port open; on macOS
        it returns an end."""
        size = min(PIECE, max(self._robot.budget.left, 1))
        try:
            data = os.read(self._device.descriptor, size)
        except BlockingIOError:
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
        """Note that a program has opened the port."""
        if self._open:
            return
        self._open = True
        self._has_lost = False
        self._loop.add_reader(self._device.descriptor, self._readable)
        self._robot.opened(self, self.port, None)

    def answer(self, refused: str) -> None:
        """Answer that the port is open, or disconnect the program at its other end."""
        if not refused:
            self._note_baud()
            return
        self._forget()
        self._device.hang_up()
        self._look_later()

    def _leave(self) -> None:
        """Note that the program has closed the port."""
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
        """Deliver the robot's bytes to the program, each at its due time."""
        if not self._open:
            return
        self._coming.append((begin, byte, data))
        # A program that only listens sends nothing that shows its rate: it takes effect with the next reply.
        self._note_baud()
        if self._next.due == math.inf:
            self._pass_on()

    def _pass_on(self) -> None:
        """Pass on the bytes that have arrived by now."""
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
                self._next.set_at(max(due, now + USB_FRAME))
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
        if len(data) > room and not self._has_lost:
            self._has_lost = True
            where = cut(self.port)
            self._robot.engine.tell_fault(f"the program at {where} does not read: replies are lost")
        self._unread += data[:room]

    def _flush(self) -> None:
        del self._unread[: self._send(bytes(self._unread))]
        if not self._unread:
            self._loop.remove_writer(self._device.descriptor)

    def _send(self, data: bytes) -> int:
        """Send bytes. Returns the count that the system has taken."""
        try:
            return os.write(self._device.descriptor, data)
        except BlockingIOError:
            return 0
        except OSError:  # the program has closed the port, which a read reports
            return len(data)
