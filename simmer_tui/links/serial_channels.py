"""An open serial port in an event loop: by its file descriptor where it has one, else by threads.

The descriptor saves four changes of thread a round trip, more than half of the time it takes.
Windows ports have none, nor have some kinds of URL.
"""

from __future__ import annotations

import asyncio
import os
import sys
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from simmer_tui.links.port_list import WRITE_TIMEOUT, close_port

READ_TIMEOUT = 0.1
"""Seconds a reading thread waits for a byte; how soon such a port is closed."""
READ_SIZE = 4096
"""Most bytes taken at once, so that a robot that floods holds up nothing else."""
INBOX = 64 * 1024
"""Most bytes a reading thread keeps for the event loop. What a robot sends beyond is lost."""

Received = Callable[[bytes], None]
Failed = Callable[[Exception], None]


class Channel(Protocol):
    """An open port. All methods are for the event loop; so are the calls it makes."""

    def write(self, data: bytes) -> None:
        """Send a message, after those before it."""
        ...

    def write_instead(self, data: bytes) -> list[bytes]:
        """Send a message instead of those not begun yet; returns these."""
        ...

    def close(self) -> None:
        """Close the port. Nothing is called any more."""
        ...


def channel_for(port: Any, loop: asyncio.AbstractEventLoop, received: Received, failed: Failed) -> Channel:
    """The best channel for a pyserial port. `failed` is called once, and should close it."""
    descriptor = _descriptor(port)
    if descriptor is None:
        return ThreadChannel(port, loop, received, failed)
    return DescriptorChannel(port, descriptor, loop, received, failed)


def _descriptor(port: Any) -> int | None:
    """The file descriptor of a port that can be waited for in an event loop; Unix only."""
    if sys.platform == "win32":
        return None
    try:
        descriptor: int = port.fileno()
        return None if os.get_blocking(descriptor) else descriptor
    except OSError:  # a URL without a file behind it
        return None


class DescriptorChannel:
    """A port that is read and written in the event loop itself."""

    def __init__(
        self,
        port: Any,
        descriptor: int,
        loop: asyncio.AbstractEventLoop,
        received: Received,
        failed: Failed,
    ) -> None:
        self._port = port
        self._descriptor = descriptor
        self._loop = loop
        self._received = received
        self._failed = failed
        self._begun = b""
        self._outbox: deque[bytes] = deque()
        self._stalled: asyncio.TimerHandle | None = None
        loop.add_reader(descriptor, self._read)

    def write(self, data: bytes) -> None:
        self._outbox.append(data)
        if self._stalled is None:
            self._write()

    def write_instead(self, data: bytes) -> list[bytes]:
        waiting = list(self._outbox)
        self._outbox.clear()
        self.write(data)
        return waiting

    def close(self) -> None:
        self._loop.remove_reader(self._descriptor)
        self._go_on()
        self._outbox.clear()
        close_port(self._port)

    def _read(self) -> None:
        try:
            data = os.read(self._descriptor, READ_SIZE)
        except BlockingIOError:
            return
        except OSError as error:
            self._failed(error)
            return
        if data:
            self._received(data)
        else:
            self._failed(EOFError("the other end is closed"))

    def _write(self) -> None:
        try:
            while self._begun or self._outbox:
                self._begun = self._begun or self._outbox.popleft()
                self._begun = self._begun[os.write(self._descriptor, self._begun) :]
        except BlockingIOError:
            if self._stalled is None:
                self._stalled = self._loop.call_later(WRITE_TIMEOUT, self._give_up)
                self._loop.add_writer(self._descriptor, self._write)
        except OSError as error:
            self._failed(error)
        else:
            self._go_on()

    def _go_on(self) -> None:
        """Nothing is left to write."""
        if self._stalled is not None:
            self._stalled.cancel()
            self._stalled = None
            self._loop.remove_writer(self._descriptor)

    def _give_up(self) -> None:
        self._failed(TimeoutError("write timeout"))


class ThreadChannel:
    """A port that two threads read and write: `read(max(1, in_waiting))` with a short timeout
    wakes as soon as a byte is there, and works everywhere."""

    def __init__(
        self, port: Any, loop: asyncio.AbstractEventLoop, received: Received, failed: Failed
    ) -> None:
        self._port = port
        self._loop = loop
        self._received = received
        self._failed = failed
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._outbox: deque[bytes] = deque()
        self._inbox = bytearray()
        self._inbox_lock = threading.Lock()
        port.timeout = READ_TIMEOUT
        self._reader = threading.Thread(target=self._read, name="serial read", daemon=True)
        self._writer = threading.Thread(target=self._write, name="serial write", daemon=True)
        self._reader.start()
        self._writer.start()

    def write(self, data: bytes) -> None:
        with self._changed:
            self._outbox.append(data)
            self._changed.notify()

    def write_instead(self, data: bytes) -> list[bytes]:
        with self._changed:
            waiting = list(self._outbox)
            self._outbox.clear()
            self._outbox.append(data)
            self._changed.notify()
        return waiting

    def close(self) -> None:
        with self._changed:
            self._closing.set()
            self._changed.notify()
        for name in ("cancel_read", "cancel_write"):  # not every kind of port has them
            getattr(self._port, name, _nothing)()
        for thread in (self._reader, self._writer):
            thread.join(timeout=5 * READ_TIMEOUT)  # one that is held up ends when its port is closed
        close_port(self._port)

    def _read(self) -> None:
        try:
            while not self._closing.is_set():
                data = self._port.read(max(1, self._port.in_waiting))
                if data:
                    self._pass_on(data)
        except Exception as error:  # noqa: BLE001 - pyserial lets through whatever its drivers raise
            self._call(self._fail, error)

    def _pass_on(self, data: bytes) -> None:
        with self._inbox_lock:
            waiting = len(self._inbox)
            self._inbox += data[: INBOX - waiting]
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
                self._port.write(data)
            except Exception as error:  # noqa: BLE001 - as in _read
                self._call(self._fail, error)
                return

    def _call(self, function: Callable[..., None], *arguments: object) -> None:
        try:
            self._loop.call_soon_threadsafe(function, *arguments)
        except RuntimeError:  # the loop has ended
            self._closing.set()

    def _deliver(self) -> None:
        with self._inbox_lock:
            data = bytes(self._inbox)
            self._inbox.clear()
        if not self._closing.is_set():
            self._received(data)

    def _fail(self, error: Exception) -> None:
        if not self._closing.is_set():
            self._failed(error)


def _nothing() -> None:
    """This port cannot cut short what it does; it ends soon by itself."""
