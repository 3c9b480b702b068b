"""An open serial port in an event loop, read and written by a thread each.

The same on all systems and for all kinds of URL. The changes of thread take a fifth of a
millisecond a round trip; the bytes of the shortest command and its reply take twelve at 9600 baud.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from simmer_tui.links.peer import PIECE
from simmer_tui.links.port_list import close_port

READ_TIMEOUT = 0.1
"""Seconds a reading thread waits for a byte; how soon such a port is closed."""
CLOSE_TIMEOUT = 0.3
"""Seconds a port may take to close; it goes on alone then."""
INBOX = 64 * 1024
"""Most bytes a reading thread keeps for the event loop. What a robot sends beyond is lost."""

Received = Callable[[bytes], None]
Failed = Callable[[Exception], None]


class SerialChannel:
    """An open port. All methods are for the event loop; so are the calls it makes.

    `read(max(1, in_waiting))` with a short timeout wakes as soon as a byte is there. `failed` is
    called once, and should close the channel.
    """

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
        """Send a message, after those before it."""
        with self._changed:
            self._outbox.append(data)
            self._changed.notify()

    def write_instead(self, data: bytes) -> list[bytes]:
        """Send a message instead of those not begun yet; returns these."""
        with self._changed:
            waiting = list(self._outbox)
            self._outbox.clear()
            self._outbox.append(data)
            self._changed.notify()
        return waiting

    def close(self) -> None:
        """Close the port. No callback follows, and a driver that hangs is not waited for."""
        with self._changed:
            self._closing.set()
            self._changed.notify()
        closer = threading.Thread(target=self._close, name="serial close", daemon=True)
        closer.start()
        closer.join(CLOSE_TIMEOUT)

    def _close(self) -> None:
        for name in ("cancel_read", "cancel_write"):  # not every kind of port has them
            getattr(self._port, name, _nothing)()
        for thread in (self._reader, self._writer):
            thread.join(READ_TIMEOUT + CLOSE_TIMEOUT)  # one that is held up ends when its port is closed
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
            data = bytes(self._inbox[:PIECE])
            del self._inbox[:PIECE]
            more = bool(self._inbox)
        if self._closing.is_set():
            return
        if more:  # a robot that floods holds up nothing else
            self._loop.call_soon(self._deliver)
        self._received(data)

    def _fail(self, error: Exception) -> None:
        if not self._closing.is_set():
            self._failed(error)


def _nothing() -> None:
    """For ports that cannot cancel a read or write: theirs end soon by themselves."""
