"""A pseudo-terminal, and the link at a path of the user's choice that leads to it. Unix alone."""

from __future__ import annotations

import contextlib
import os
import struct
import sys
from functools import cache
from pathlib import Path

from simmer_tui import platform_has
from simmer_tui.errors import PortError

NOT_ON_WINDOWS = (
    "--pty: Windows has no pseudo-terminals. A Python program is led to the robot by --run, or by what "
    "simmer-tui env prints"
)
"""The line that says so."""
# TCGETS2 of Linux' asm-generic/ioctls.h, as pyserial has it: rates that have no constant of their own. Its
# struct termios2 has four flags, the line, 19 characters, and two rates as plain numbers.
_TCGETS2, _TERMIOS2 = 0x802C542A, struct.Struct("=IIIIB19sII")


class PtyDevice:
    """The robot's end of a pseudo-terminal, open until closed."""

    descriptor: int
    name: str
    """Of the program's end, in the system."""

    def __init__(self, path: str) -> None:
        """Make one, and the link to it. Raises PortError."""
        self.path = Path(path).expanduser().absolute()
        self._make()
        try:
            self._link()
        except (OSError, PortError) as error:
            os.close(self.descriptor)
            raise PortError(f"--pty {path}: {getattr(error, 'strerror', None) or error}") from None

    def _make(self) -> None:
        if sys.platform == "win32" or not platform_has.POSIX:
            raise PortError(NOT_ON_WINDOWS)
        import tty

        try:
            self.descriptor, end = os.openpty()
        except OSError as error:
            raise PortError(f"--pty: no pseudo-terminal can be made: {error.strerror}") from None
        self.name = os.ttyname(end)
        # Bytes as they are, also for programs that set nothing, such as cat.
        tty.setraw(end)
        os.close(end)
        os.set_blocking(self.descriptor, False)

    def _link(self) -> None:
        """Set the link at the path. Raises OSError, PortError."""
        if self.path.is_symlink() and not self.path.exists():
            self.path.unlink()  # of a run that was killed
        elif self.path.is_symlink():
            raise PortError(
                f"it leads to {self.path.readlink()} already: end the simmer-tui that made it, remove it, "
                "or name another path"
            )
        self.path.symlink_to(self.name)

    def hang_up(self) -> None:
        """End the program that has it open: its next read or write fails. The path leads to a new one."""
        old = self.descriptor
        self._unlink()
        self._make()
        with contextlib.suppress(OSError, PortError):  # somebody else has taken the path meanwhile
            self._link()
        os.close(old)

    def close(self) -> None:
        """Remove the link and end the pseudo-terminal."""
        self._unlink()
        os.close(self.descriptor)

    def _unlink(self) -> None:
        with contextlib.suppress(OSError):
            if str(self.path.readlink()) == self.name:  # not one that somebody else has put there
                self.path.unlink()

    @property
    def baud(self) -> float | None:
        """The rate that the program has set, bits a second; None if it cannot be told."""
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

    def set_baud(self, rate: int) -> None:
        """Set the rate, as if a program did."""
        if sys.platform == "win32":
            return
        import termios

        with contextlib.suppress(termios.error, OSError):
            flags = termios.tcgetattr(self.descriptor)
            flags[4] = flags[5] = getattr(termios, f"B{rate}")
            termios.tcsetattr(self.descriptor, termios.TCSANOW, flags)

    def forget_unread(self) -> int:
        """Drop what the program that has left did not read; the count of bytes, as far as it is known."""
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


@cache
def _rates() -> dict[int, int]:
    """The rates that have constants, by those."""
    import termios

    names = [name for name in dir(termios) if name[0] == "B" and name[1:].isdigit()]
    return {int(getattr(termios, name)): int(name[1:]) for name in names}
