"""The connection of a program whose pyserial has our hook in it.

Frames between our side of a program and this port, both ways: a letter, the length of the payload as four
bytes, big-endian, and the payload.

    to the robot     H   a process has begun that has our pyserial; it sends no more
                     O   a port is opened: JSON with its `name` and `baud`, and `clock`, true
                         if the process lives by the program's clock
                     W   bytes written
                     B   another baud rate, as text
                     N   a read has waited for long: the line of the program, as text
                     C   the port is closed: the count of bytes that were not read, as text
    to the program   A   the answer to O: our clock as a double, and nothing, or why it cannot be opened
                     R   bytes read: when they begin to arrive, by our clock, and the time of each byte,
                         seconds, as two doubles; how many come together, four bytes; and the bytes
"""

from __future__ import annotations

import contextlib
import json
import socket
import struct

from simmer_tui.links.peer import Peer
from simmer_tui.links.serial_wire import USB_FRAME, SerialRobot

_HEAD = struct.Struct(">cI")
_TIMES = struct.Struct(">ddI")
# pyserial sends a program's bytes as one payload; nobody writes a megabyte to a robot.
LONGEST_PAYLOAD = 1 << 20
"""Bytes of a frame's payload; a program that sends more is disconnected."""


class HookedProgram(Peer):
    """The connection of a program that opens the serial port."""

    def __init__(self, sock: socket.socket, peer: str, robot: SerialRobot) -> None:
        super().__init__(sock, peer, robot.budget)
        self._robot = robot
        self._buffer = bytearray()
        self._asked = False
        self._unread = 0
        self.port = ""
        """The name of the port that it has opened; empty until then."""
        self.by_clock = False
        """True if the program lives by the program's clock."""

    def data_received(self, data: bytes) -> None:
        self._buffer += data
        while len(self._buffer) >= _HEAD.size and not self._closing:
            kind, size = _HEAD.unpack_from(self._buffer)
            if size > LONGEST_PAYLOAD:
                self._drop()
                return
            if len(self._buffer) < _HEAD.size + size:
                return
            payload = bytes(self._buffer[_HEAD.size : _HEAD.size + size])
            del self._buffer[: _HEAD.size + size]
            self._take(kind, payload)

    def connection_lost(self, error: OSError | None) -> None:
        self._robot.closed(self, self._unread)

    def _take(self, kind: bytes, payload: bytes) -> None:
        if kind == b"H":
            self._robot.reached()
        elif (kind == b"O") == self._asked:
            self._drop()
        elif kind == b"O":
            self._open(payload)
        elif kind == b"W":
            self._robot.written(self, payload)
        elif kind == b"B":
            with contextlib.suppress(ValueError):
                self._robot.set_baud(self, float(payload))
        elif kind == b"N":
            self._robot.waits(self, payload.decode("utf-8", "replace"))
        elif kind == b"C" and payload.isdigit():
            self._unread = int(payload[:9])

    def _open(self, payload: bytes) -> None:
        self._asked = True
        try:
            asked = json.loads(payload)
            self.port, baud = str(asked["name"]), float(asked["baud"])
            self.by_clock = asked.get("clock") is True
        except (ValueError, KeyError, TypeError, RecursionError):
            self._drop()
            return
        self._robot.opened(self, self.port, baud)

    def _drop(self) -> None:
        self._robot.engine.tell_fault(f"{self.peer} dropped: it is no program with a serial port of ours")
        self.abort()

    def answer(self, refused: str) -> None:
        """Answer that the port is open, or the reason why it is not."""
        self._send(b"A", struct.pack(">d", self._loop.time()) + refused.encode())
        if refused:
            self.close()

    def deliver(self, begin: float, byte: float, data: bytes) -> None:
        """Send bytes of the robot, with the times at which they arrive."""
        together = max(1, min(int(USB_FRAME / byte), len(data))) if byte > 0 else 1
        self._send(b"R", _TIMES.pack(begin, byte, together) + data)

    def _send(self, kind: bytes, payload: bytes) -> None:
        if not self.write(_HEAD.pack(kind, len(payload)) + payload):
            # The robot goes on, as one at a serial cable would.
            self._robot.engine.tell_dropped(self.peer)
            self.abort()
