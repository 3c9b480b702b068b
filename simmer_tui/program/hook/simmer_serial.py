"""The serial port of a program that the simulator runs: `serial.Serial` connected to the simulated robot.

It is imported into other people's programs, by whatever Python they use: standard library alone, Python 3.8
on, and nothing of the package. `links/port_link.py` is the other end; `links/hook_port.py` describes the
frames.
"""

from __future__ import annotations

import collections
import json
import math
import os
import select
import socket
import struct
import sys
import threading
import time
from typing import Any

PORT = "SIMMER_DIALECT_PORT"
_NAMES = "SIMMER_SERIAL_NAMES"
_HEAD = struct.Struct(">cI")
_TIMES = struct.Struct(">ddI")
# Seconds. A simulator on this machine accepts in milliseconds; one that has ended refuses at once.
_CONNECTING = 10.0
# Seconds. Every Python that is started connects once: a failure must not delay it.
_HELLO = 0.5
# Seconds. Loopback takes less than a millisecond, and somewhat more on an overloaded machine.
_ON_ITS_WAY = 0.05
# Seconds. A read that waits longer waits forever, or for a person.
_LONG = 10.0


# By now the program's clock is installed, if it is in force (sitecustomize.py).
_now = time.monotonic
_LAST: list[bytes] = []


def last_written() -> bytes:
    """The last bytes that this process has written to the robot."""
    return _LAST[0] if _LAST else b""


def _host() -> str:
    return os.environ.get("SIMMER_HOST", "127.0.0.1")


def _connected(timeout: float) -> socket.socket:
    """A connection to the simulator, on which the token has been sent. Raises OSError, ValueError."""
    # For a name as text Python loads its codec of international names, which takes milliseconds.
    host: Any = _host().encode() if _host().isascii() else _host()
    sock = socket.create_connection((host, int(os.environ[PORT])), timeout)
    token = os.environ.get("SIMMER_TOKEN", "")
    if token:
        sock.sendall(token.encode() + b"\n")
    return sock


class _Piece:
    """Bytes that the robot has written in one piece, with the time of their beginning and of each byte.

    They become readable packet by packet. The first packet may be shorter.
    """

    def __init__(self, start: float, byte: float, packet: int, data: bytes) -> None:
        self.start, self.byte, self.packet, self.data = start, byte, max(packet, 1), data
        self.taken = 0

    def readable(self, now: float) -> int:
        """The count of bytes that can be read, without those already taken."""
        size = len(self.data)
        here = size if now >= self.start else 0
        if self.byte:
            here = max(0, min(size, int((now - self.start) / self.byte + 1e-9)))
        missing = -(-(size - here) // self.packet) * self.packet
        return max(size - missing - self.taken, 0)

    def next(self) -> float:
        """The time when more bytes can be read."""
        size = len(self.data)
        return self.start + (size - (size - self.taken - 1) // self.packet * self.packet) * self.byte


class SerialLine:
    """The connection of an open port: bytes are sent, and arrive at their times.

    A program may read in one thread and write in another.
    """

    def __init__(self, name: str, baud: int) -> None:
        try:
            self._sock = _connected(_CONNECTING)
        except ConnectionRefusedError:
            where = f"{_host()}, port {os.environ[PORT]}"
            raise OSError(f"no simmer-tui with a dialect.toml runs at {where}: start it first") from None
        self._sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._sending = threading.Lock()
        self._receiving = threading.Lock()
        self._buffer = bytearray()
        self._coming: collections.deque[_Piece] = collections.deque()
        self._answer: str | None = None
        self._cancelling: tuple[socket.socket, socket.socket] | None = None
        """By the program's clock: readable while a read is to be cancelled."""
        self._broken = ""
        self._told = False
        self._byte = 10.0 / baud if baud else 0.0
        self._free = 0.0
        self._offset = 0.0
        self._send(
            b"O", json.dumps({"name": name, "baud": baud, "clock": _program_clock() is not None}).encode()
        )
        received = -1
        while self._answer is None and not self._broken and len(self._buffer) > received:
            received = len(self._buffer)
            self._receive(_CONNECTING)
        if self._answer != "":
            self._sock.close()
            raise OSError(self._answer or self._broken or "the simulator does not answer")

    def fileno(self) -> int:
        """The descriptor of the connection."""
        return self._sock.fileno()

    def close(self) -> None:
        """Close the port, and report how many bytes nobody has read."""
        try:
            unread = self.waiting()
            if unread:
                self._send(b"C", str(unread).encode())
        except OSError:
            pass  # the simulator has ended
        self._sock.close()
        for each in self._cancelling or ():
            each.close()

    # -- writing -----------------------------------------------------------------------------------

    def write(self, data: bytes) -> None:
        """Send bytes to the robot. Raises OSError."""
        _LAST[:] = [bytes(data[-60:])]
        self._send(b"W", bytes(data))
        self._free = max(self._free, _now()) + len(data) * self._byte

    def set_baud(self, baud: int) -> None:
        """Send and receive at another rate from now on."""
        self._byte = 10.0 / baud if baud else 0.0
        self._send(b"B", str(baud).encode())

    def unsent(self) -> tuple[float, int]:
        """Seconds until all written bytes have been sent, and the count of waiting bytes."""
        left = max(0.0, self._free - _now())
        return left, int(left / self._byte + 0.999999) if self._byte else 0

    def _send(self, kind: bytes, payload: bytes) -> None:
        with self._sending:
            self._sock.settimeout(None)
            self._sock.sendall(_HEAD.pack(kind, len(payload)) + payload)

    # -- reading -----------------------------------------------------------------------------------

    def waiting(self) -> int:
        """The count of bytes that have arrived. Raises OSError if none will come, like an unplugged port."""
        self._receive(0.0)
        now = _now()
        with self._receiving:
            if self._broken and not self._coming:
                raise OSError(self._broken)
            return sum(part.readable(now) for part in self._coming)

    def take(self, size: int) -> bytes:
        """At most `size` of the bytes that have arrived."""
        now, taken = _now(), bytearray()
        with self._receiving:
            while self._coming and len(taken) < size:
                part = self._coming[0]
                count = min(part.readable(now), size - len(taken))
                if not count:
                    break
                taken += part.data[part.taken : part.taken + count]
                part.taken += count
                if part.taken == len(part.data):
                    self._coming.popleft()
        return bytes(taken)

    def wait(self, seconds: float | None, wake: threading.Event | None = None) -> bool:
        """Wait at most `seconds` until a byte has arrived. True if one has. Raises OSError at the end of the
        connection."""
        until = None if seconds is None else _now() + seconds
        begun = now = _now()
        # Checked first, since readline() reads byte by byte: a read of the connection costs more than a byte.
        first = self._first()
        while first is None or first > now:
            if first is not None and _program_clock() is not None:
                return _pass_time_until(first, until, now)
            # By the program's clock a wait looks first by itself, and a look is a question to the simulator.
            if _program_clock() is None or (until is not None and until <= now):
                self._receive(0.0)
                now, first = _now(), self._first()
                if first is not None and first <= now:
                    break
            if self._broken and first is None:
                raise OSError(self._broken)
            # It has waited until its end, or was cancelled.
            if (wake is not None and wake.is_set()) or (until is not None and until <= now):
                return False
            if until is None and now - begun > _LONG:
                self._tell_waiting()
            self._pause(first, until, now)
            now, first = _now(), self._first()
        return True

    def cancel(self) -> None:
        """Make a wait of another thread check if it is cancelled."""
        if self._cancelling is not None:
            self._cancelling[1].send(b"x")

    def _await(self, seconds: float | None) -> bool:
        """By the program's clock: wait at most `seconds` for bytes of the robot. False if there are none."""
        if self._cancelling is None:
            self._cancelling = socket.socketpair()
        inner = self._cancelling[0]
        # Others look at the port meanwhile. Nothing outside of the program cancels.
        ready = select.select([self._sock, inner], [], [], seconds, inner=[inner])[0]  # type: ignore[call-arg]
        if inner in ready:
            inner.recv(4096)
        return self._sock in ready

    def _pause(self, first: float | None, until: float | None, now: float) -> None:
        """Wait for bytes of the robot, until the next known byte arrives, or until the end of the wait."""
        if _program_clock() is not None and until is None:
            self._receive(None)  # the clock knows if nothing will ever come
            return
        end = math.inf if until is None else until - now
        arrives = math.inf if first is None else first - now
        pause = min(0.5, end, arrives)
        if first is not None and pause < 0.0005:
            time.sleep(max(pause, 0.0))
        else:
            self._receive(pause)

    def _first(self) -> float | None:
        """The time when the next byte on its way arrives; None if there is none."""
        with self._receiving:
            return self._coming[0].next() if self._coming else None

    def _receive(self, seconds: float | None) -> None:
        """Receive bytes of the robot; wait at most `seconds` for them."""
        if _program_clock() is not None and seconds != 0.0 and not self._broken:
            if not self._await(seconds):  # without the lock
                return
            seconds = 0.0
        with self._receiving:
            if self._broken:
                return
            try:
                self._sock.settimeout(None if seconds is None else max(seconds, 0.0))
                data = self._sock.recv(65536)
            except (socket.timeout, BlockingIOError):  # TimeoutError since Python 3.10
                return
            except OSError as error:
                self._broken = str(error)
                return
            if not data:
                self._broken = "the simulator has ended"
                return
            self._buffer += data
            self._take_frames()

    def _take_frames(self) -> None:
        while len(self._buffer) >= _HEAD.size:
            kind, size = _HEAD.unpack_from(self._buffer)
            if len(self._buffer) < _HEAD.size + size:
                return
            payload = bytes(self._buffer[_HEAD.size : _HEAD.size + size])
            del self._buffer[: _HEAD.size + size]
            if kind == b"A":
                (there,) = struct.unpack_from(">d", payload)
                behind = _now() - there
                # On one machine both clocks are the same: the difference is the delay of this frame.
                self._offset = 0.0 if 0 <= behind < _ON_ITS_WAY else behind
                self._answer = payload[8:].decode("utf-8", "replace")
            elif kind == b"R":
                start, byte, packet = _TIMES.unpack_from(payload)
                data = payload[_TIMES.size :]
                self._coming.append(_Piece(start + self._offset, byte, packet, data))

    def _tell_waiting(self) -> None:
        """Report once which line of the program waits."""
        if self._told:
            return
        self._told = True
        # Only a program has this folder on its path.
        from simmer_clock import place  # type: ignore[import-not-found]

        self._send(b"N", place().encode("utf-8", "replace"))


def _program_clock() -> Any:
    """The program's clock, if this process uses it."""
    module = sys.modules.get("simmer_clock")
    return module.PROGRAM_CLOCK[0] if module is not None and module.PROGRAM_CLOCK else None


def _pass_time_until(first: float, until: float | None, now: float) -> bool:
    """By the program's clock: let time pass until the next known byte arrives, or until the end of the wait.

    True if it arrives. The simulator learns of the time with the next message or wait.
    """
    comes = until is None or first <= until
    _program_clock().pass_time((first if comes or until is None else until) - now)
    return comes


def make_class(serialutil: Any) -> Any:
    """The class that replaces `serial.Serial`: pyserial's own base, with the bytes of a `SerialLine`."""

    class Serial(serialutil.SerialBase):  # type: ignore[misc]
        _line: Any = None
        is_open: bool

        def open(self) -> None:
            if self._port is None:
                raise serialutil.SerialException("Port must be configured before it can be used.")
            if self.is_open:
                raise serialutil.SerialException("Port is already open.")
            try:
                self._line = SerialLine(self._port, self._baudrate)
            except (OSError, ValueError, KeyError) as error:
                text = str(error)
                if not text.startswith("could not open"):
                    text = f"could not open port {self._port!r}: {error}"
                raise serialutil.SerialException(text) from None
            self._baud = self._baudrate
            self._wake = threading.Event()
            self.is_open = True

        def close(self) -> None:
            if self.is_open:
                self._line.close()
                self._line = None
                self.is_open = False

        def _reconfigure_port(self, force_update: bool = False) -> None:
            if self._baudrate != self._baud:
                self._baud = self._baudrate
                self._line.set_baud(self._baud)

        def _use(self) -> SerialLine:
            if not self.is_open:
                raise serialutil.PortNotOpenError() if hasattr(serialutil, "PortNotOpenError") \
                    else serialutil.portNotOpenError  # fmt: skip
            line: SerialLine = self._line
            return line

        @property
        def in_waiting(self) -> int:
            line = self._use()
            try:
                return line.waiting()
            except OSError as error:
                raise serialutil.SerialException(str(error)) from None

        def read(self, size: int = 1) -> bytes:
            line = self._use()
            # Nearly all reads are of one byte that has arrived, by readline().
            taken = bytearray(line.take(size))
            if len(taken) == size:
                return bytes(taken)
            timeout = serialutil.Timeout(self._timeout)
            try:
                while len(taken) < size:
                    left = timeout.time_left()
                    if taken and self._inter_byte_timeout is not None:
                        gap = self._inter_byte_timeout
                        left = gap if left is None else min(left, gap)
                    if not line.wait(left, self._wake):
                        self._wake.clear()
                        break
                    taken += line.take(size - len(taken))
                    if timeout.expired():
                        break
            except OSError as error:
                if not self.is_open:
                    return bytes(taken)
                raise serialutil.SerialException(f"read failed: {error}") from None
            return bytes(taken)

        def cancel_read(self) -> None:
            if self.is_open:
                self._wake.set()
                self._line.cancel()

        def write(self, data: Any) -> int:
            line = self._use()
            data = serialutil.to_bytes(data)
            try:
                line.write(data)
            except OSError as error:
                raise serialutil.SerialException(f"write failed: {error}") from None
            return len(data)

        def flush(self) -> None:
            left, _ = self._use().unsent()
            if left:
                time.sleep(left)

        @property
        def out_waiting(self) -> int:
            return self._use().unsent()[1]

        def reset_input_buffer(self) -> None:
            line = self._use()
            line.take(self.in_waiting)

        def send_break(self, duration: float = 0.25) -> None:
            self._use()
            time.sleep(duration)

        def _do_nothing(self, *settings: Any, **named: Any) -> None:
            """Do nothing, on an open port: the line has no such signals and buffers."""
            self._use()

        cancel_write = reset_output_buffer = nonblocking = set_buffer_size = _do_nothing
        _update_break_state = _update_rts_state = _update_dtr_state = _do_nothing
        cts = dsr = cd = property(lambda self: self._use() is not None)
        ri = property(lambda self: self._use() is None)

        def fileno(self) -> int:
            return self._use().fileno()

    Serial.__module__ = "serial"
    Serial.__qualname__ = "Serial"
    return Serial


def names() -> list[str]:
    """The names of the program's serial ports."""
    return [each for each in os.environ.get(_NAMES, "").split(",") if each] or ["COM6"]


def _patch_serial(module: Any) -> None:
    module.Serial = make_class(module.serialutil)


def _patch_ports(module: Any) -> None:
    common = sys.modules["serial.tools.list_ports_common"]

    def comports(include_links: bool = False) -> list[Any]:
        found = []
        for name in names():
            try:
                port = common.ListPortInfo(name, skip_link_detection=True)
            except TypeError:  # pyserial before 3.5
                port = common.ListPortInfo(name)
            port.name, port.description = name, f"Arduino Uno ({name})"
            port.vid, port.pid = 0x2341, 0x0043
            port.hwid, port.manufacturer = "USB VID:PID=2341:0043", "Arduino (www.arduino.cc)"
            found.append(port)
        return found

    module.comports = comports


_PATCHES = {"serial": _patch_serial, "serial.tools.list_ports": _patch_ports}


def install() -> None:
    """Connect `serial.Serial` to the simulated robot, when the program imports it."""
    # Only a program has this folder on its path.
    from simmer_imports import patch_when_imported  # type: ignore[import-not-found]

    patch_when_imported(_PATCHES)
    if _program_clock() is None:
        _say_hello()


def _say_hello() -> None:
    """Report that this process will find the port. For programs without a report the simulator gives
    advice."""
    try:
        with _connected(_HELLO) as sock:
            sock.sendall(_HEAD.pack(b"H", 0))
    except (OSError, ValueError):
        pass  # the error comes when the port is opened
