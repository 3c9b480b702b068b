"""Bytes to and from a robot on a serial port, which may be connected and disconnected at any time.

A port is opened in a thread, because that may take seconds. Whenever it fails it is closed and opened again,
with a growing delay. Its bytes can be recorded in a file.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
import time
from dataclasses import dataclass
from typing import Any, Protocol

from simmer_tui import platform_has
from simmer_tui.config.settings import USUAL_BAUD
from simmer_tui.links.port_list import close_port, explain, is_usb, open_port
from simmer_tui.links.serial_channel import SerialChannel, channel_for
from simmer_tui.robot.timers import LoopTimer


class LinkListener(Protocol):
    """Receives the events of a link."""

    def opened(self) -> None: ...

    def received(self, data: bytes) -> None: ...

    def lost(self, reason: str) -> None:
        """The link failed or could not be opened, and will be retried. Called once per reason."""


class RobotLink(Protocol):
    """Bytes to and from a robot. It belongs to one event loop: all methods and callbacks run there."""

    name: str
    """Name of the port, as the user gave it."""

    @property
    def restarts_board(self) -> bool:
        """True if opening the port probably has the board start again; known when it is open."""

    def start(self, listener: LinkListener) -> None:
        """Open the port, and open it again whenever it is lost. Call once, in a running loop."""

    def write(self, data: bytes) -> None:
        """Send a message. While the link is closed it is dropped."""

    def write_instead(self, data: bytes) -> list[bytes]:
        """Send a message at once, instead of those that still wait; returns these."""

    def close(self) -> None:
        """Close the port. The listener is not called again."""


@dataclass(frozen=True, slots=True)
class BackOff:
    """Seconds between two attempts to open a port: at first, and doubled each time up to the longest."""

    # Judged: a cable is noticed at once, and a robot that is off costs one attempt in four seconds.
    first: float = 0.25
    longest: float = 4.0


class SerialLink:
    """A serial port, or a URL that pyserial opens (`socket://`, `rfc2217://`, `loop://`)."""

    def __init__(
        self, port: str, baud: int = USUAL_BAUD, back_off: BackOff | None = None, *, moves_dtr: bool = True
    ) -> None:
        """`moves_dtr`: see `open_port`."""
        self.name = port
        self.restarts_board = False
        self._baud = baud
        self._moves_dtr = moves_dtr
        self._back_off = back_off or BackOff()
        self._delay = self._back_off.first
        self._listener: LinkListener | None = None
        self._channel: SerialChannel | None = None
        self._retry = LoopTimer(self._try)
        self._told = ""

    def start(self, listener: LinkListener) -> None:
        self._listener = listener
        self._loop = self._retry.loop = asyncio.get_running_loop()
        self._try()

    def write(self, data: bytes) -> None:
        if self._channel is not None:
            self._channel.write(data)

    def write_instead(self, data: bytes) -> list[bytes]:
        return self._channel.write_instead(data) if self._channel is not None else []

    def close(self) -> None:
        self._listener = None
        self._retry.cancel()
        if self._channel is not None:
            self._channel.close()
            self._channel = None

    def _try(self) -> None:
        # A daemon: Bluetooth ports take many seconds to open, and the process must not wait for them.
        threading.Thread(target=self._open, name=f"open {self.name}", daemon=True).start()

    def _open(self) -> None:
        """Open the port, in a thread of its own."""
        port: Any = None
        reason = ""
        try:
            # Without DTR a board does not start again on Windows; elsewhere it may, the first time.
            self.restarts_board = is_usb(self.name) and (self._moves_dtr or platform_has.POSIX)
            port = open_port(self.name, self._baud, moves_dtr=self._moves_dtr)
        except Exception as error:  # noqa: BLE001 - pyserial lets through whatever its drivers raise
            reason = explain(error, self.name)
        try:
            self._loop.call_soon_threadsafe(self._tried, port, reason)
        except RuntimeError:  # the loop has ended, so that the port is not needed any more
            if port is not None:
                close_port(port)

    def _tried(self, port: Any, reason: str) -> None:
        listener = self._listener
        if listener is None:
            if port is not None:
                close_port(port)
        elif port is None:
            self._try_later(reason)
        else:
            self._delay = self._back_off.first
            self._told = ""
            self._channel = channel_for(port, self._loop, self._received, self._failed)
            listener.opened()

    def _received(self, data: bytes) -> None:
        if self._listener is not None:
            self._listener.received(data)

    def _failed(self, error: Exception) -> None:
        if self._channel is not None:
            self._channel.close()
            self._channel = None
            self._try_later(explain(error, self.name, was_open=True))

    def _try_later(self, reason: str) -> None:
        self._retry.set_in(self._delay)
        self._delay = min(2 * self._delay, self._back_off.longest)
        # Once per reason: attempts continue for as long as the robot is off.
        if reason != self._told and self._listener is not None:
            self._told = reason
            self._listener.lost(reason)


class RecordedLink:
    """A link whose bytes are kept: `{"t": SECONDS, "to": TEXT}` for those to the robot, `from` for those from
    it, one character a byte. `unsent` is what a stop overtook. The first line has the rate, `{"baud": N}`. A
    write that fails ends the record, and nothing else.

    Raises:
        OSError: The file cannot be written.
    """

    def __init__(self, link: RobotLink, path: str, baud: int) -> None:
        self._link = link
        self.name = link.name
        self._begun = time.monotonic()
        # Written line by line: the record is complete even if the run is killed.
        self._file = platform_has.expanded(path).open("w", encoding="utf-8", buffering=1)
        self._file.write(json.dumps({"baud": baud}) + "\n")
        self._listener: LinkListener

    @property
    def restarts_board(self) -> bool:
        """As for the link that is recorded."""
        return self._link.restarts_board

    def start(self, listener: LinkListener) -> None:
        self._listener = listener
        self._link.start(self)

    def write(self, data: bytes) -> None:
        self._keep("to", data)
        self._link.write(data)

    def write_instead(self, data: bytes) -> list[bytes]:
        dropped = self._link.write_instead(data)
        for each in dropped:
            self._keep("unsent", each)
        self._keep("to", data)
        return dropped

    def close(self) -> None:
        self._link.close()
        with contextlib.suppress(OSError):
            self._file.close()

    def opened(self) -> None:
        """The link is open."""
        self._listener.opened()

    def received(self, data: bytes) -> None:
        """Bytes have come from the robot."""
        self._keep("from", data)
        self._listener.received(data)

    def lost(self, reason: str) -> None:
        """The link is lost."""
        self._listener.lost(reason)

    def _keep(self, side: str, data: bytes) -> None:
        if self._file.closed:
            return
        line = {"t": round(time.monotonic() - self._begun, 4), side: data.decode("latin-1")}
        try:
            self._file.write(json.dumps(line) + "\n")
        except OSError:  # the disk is full; the run continues
            with contextlib.suppress(OSError):
                self._file.close()
