"""An open serial port in an event loop: the loop watches it if it has a file descriptor, otherwise two
threads read and write.

A descriptor saves four changes of thread in each round trip, two thirds of its cost. Windows ports have none,
nor have some kinds of URL.
"""

from __future__ import annotations

import asyncio
import os
import sys
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from simmer_tui import platform_has
from simmer_tui.links import port_list
from simmer_tui.links.peer import PIECE
from simmer_tui.links.port_list import close_port

# Judged: pyserial cannot interrupt a read on every system, so a read has to end by itself.
READ_TIMEOUT = 0.1
"""Seconds that a thread's read takes at most. Closing the port waits for it."""
# Less than the 0.7 s in which the server's thread has to end.
CLOSE_TIMEOUT = 0.3
"""Seconds for closing a port. After that its thread continues alone."""
# About a minute of a robot that sends at 9600 baud.
INBOX = 64 * 1024
"""Limit of unread bytes between a reading thread and the event loop. Bytes beyond it are lost."""

Received = Callable[[bytes], None]
Failed = Callable[[Exception], None]


@dataclass(eq=False)
class SerialChannel:
    """An open port, which is read from the start. All its methods and callbacks run in the event loop."""

    port: Any
    loop: asyncio.AbstractEventLoop
    received: Received
    failed: Failed
    """Called once; it should close the channel."""

    def __post_init__(self) -> None:
        self._outbox: deque[bytes] = deque()
        self._closing = threading.Event()

    def write(self, data: bytes) -> None:
        """Send a message after all earlier ones."""
        raise NotImplementedError

    def write_instead(self, data: bytes) -> list[bytes]:
        """Send a message instead of those that are not begun yet; returns these."""
        waiting = list(self._outbox)
        self._outbox.clear()
        self.write(data)
        return waiting

    def close(self) -> None:
        """Close the port. No callback follows, and it does not wait for a driver that hangs."""
        self._closing.set()
        # The close of a tty waits in the driver until all written bytes have been sent.
        closer = threading.Thread(target=self._close_port, name="serial close", daemon=True)
        closer.start()
        closer.join(CLOSE_TIMEOUT)

    def _close_port(self) -> None:
        close_port(self.port)

    def _fail(self, error: Exception) -> None:
        if not self._closing.is_set():
            self.failed(error)


def channel_for(
    port: Any, loop: asyncio.AbstractEventLoop, received: Received, failed: Failed
) -> SerialChannel:
    """The fastest channel that a pyserial port allows."""
    kind = ThreadChannel if descriptor_of(port) is None else DescriptorChannel
    return kind(port, loop, received, failed)


def descriptor_of(port: Any) -> int | None:
    """The file descriptor that carries a port's bytes unchanged, or None."""
    kind = type(port)
    # A kind of URL that wraps another port (spy://) reads itself, with the other's descriptor. Both methods
    # must come from the same class, otherwise `read` does not use the descriptor.
    own = getattr(kind.read, "__module__", "") == getattr(getattr(kind, "fileno", None), "__module__", None)
    if sys.platform == "win32" or not platform_has.POSIX or not own:
        return None
    descriptor: int = port.fileno()
    return None if os.get_blocking(descriptor) else descriptor


class DescriptorChannel(SerialChannel):
    """A port that is read and written in the event loop itself, which never blocks."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._descriptor: int = self.port.fileno()
        self._rest = b""
        """Unsent rest of the message begun last."""
        self._stalled: asyncio.TimerHandle | None = None
        self.loop.add_reader(self._descriptor, self._read)

    def write(self, data: bytes) -> None:
        self._outbox.append(data)
        if self._stalled is None:
            self._write()

    def close(self) -> None:
        self.loop.remove_reader(self._descriptor)
        self._set_stalled(False)
        super().close()

    def _read(self) -> None:
        try:
            data = os.read(self._descriptor, PIECE)  # a robot that floods must not delay anything else
        except BlockingIOError:
            return
        except OSError as error:
            self.failed(error)
            return
        if data:
            self.received(data)
        else:
            self.failed(EOFError("the other end is closed"))

    def _write(self) -> None:
        """Write as much as the port takes; the loop calls again when it takes more."""
        try:
            while self._rest or self._outbox:
                self._rest = self._rest or self._outbox.popleft()
                self._rest = self._rest[os.write(self._descriptor, self._rest) :]
        except BlockingIOError:
            self._set_stalled(True)
        except OSError as error:
            # Not in the middle of a caller's write. The port is not used until then.
            self._set_stalled(False)
            self._outbox.clear()
            self._rest = b""
            self.loop.call_soon(self._fail, error)
        else:
            self._set_stalled(False)

    def _set_stalled(self, stalled: bool) -> None:
        """Wait for the port to take more bytes, for a limited time; or stop waiting."""
        if self._stalled is not None:
            self._stalled.cancel()
            self._stalled = None
            self.loop.remove_writer(self._descriptor)
        if stalled:
            self._stalled = self.loop.call_later(
                port_list.WRITE_TIMEOUT, self._fail, TimeoutError("write timeout")
            )
            self.loop.add_writer(self._descriptor, self._write)


class ThreadChannel(SerialChannel):
    """A port that two threads read and write.

    `read(max(1, in_waiting))` with a short time limit wakes as soon as a byte is there, on all systems.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        self._changed = threading.Condition()
        self._inbox = bytearray()
        self._inbox_lock = threading.Lock()
        self.port.timeout = READ_TIMEOUT
        self._reader = threading.Thread(target=self._read, name="serial read", daemon=True)
        self._writer = threading.Thread(target=self._write, name="serial write", daemon=True)
        self._reader.start()
        self._writer.start()

    def write(self, data: bytes) -> None:
        with self._changed:
            self._outbox.append(data)
            self._changed.notify()

    def write_instead(self, data: bytes) -> list[bytes]:
        with self._changed:  # a condition's lock can be taken again by the same thread, in `write`
            return super().write_instead(data)

    def close(self) -> None:
        with self._changed:
            self._closing.set()
            self._changed.notify()
        super().close()

    def _close_port(self) -> None:
        # Not every kind of port has them; a read or write of such a port ends soon by itself.
        for name in ("cancel_read", "cancel_write"):
            getattr(self.port, name, lambda: None)()
        for thread in (self._reader, self._writer):
            thread.join(READ_TIMEOUT + CLOSE_TIMEOUT)  # a thread that hangs ends when its port is closed
        close_port(self.port)

    def _read(self) -> None:
        try:
            while not self._closing.is_set():
                data = self.port.read(max(1, self.port.in_waiting))
                if data:
                    self._pass_on(data)
        except Exception as error:  # noqa: BLE001 - pyserial lets through all errors of its drivers
            self._call(self._fail, error)

    def _pass_on(self, data: bytes) -> None:
        with self._inbox_lock:
            waiting = len(self._inbox)
            self._inbox += data[: INBOX - waiting]
        # Called only when the inbox was empty: a flood causes no flood of calls.
        if not waiting:
            self._call(self._deliver)
        elif waiting >= INBOX:
            self._closing.wait(READ_TIMEOUT)  # a flood: let it fill the system's buffer instead

    def _write(self) -> None:
        while True:
            with self._changed:
                while not self._outbox and not self._closing.is_set():
                    self._changed.wait()
                if self._closing.is_set():
                    return
                data = self._outbox.popleft()
            try:
                self.port.write(data)
            except Exception as error:  # noqa: BLE001 - as in _read
                self._call(self._fail, error)
                return

    def _call(self, function: Callable[..., None], *arguments: object) -> None:
        try:
            self.loop.call_soon_threadsafe(function, *arguments)
        except RuntimeError:  # the loop has ended
            self._closing.set()

    def _deliver(self) -> None:
        with self._inbox_lock:
            data = bytes(self._inbox[:PIECE])
            del self._inbox[:PIECE]
            more = bool(self._inbox)
        if self._closing.is_set():
            return
        if more:  # a robot that floods must not delay anything else
            self.loop.call_soon(self._deliver)
        self.received(data)
