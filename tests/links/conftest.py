"""The other ends of links to robots: in memory, on a pty, on TCP; each can be pulled out and put back."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.links import serial_channel
from simmer_tui.links.serial_link import BackOff, LinkListener, RobotLink, SerialLink

QUICK = BackOff(first=0.001, longest=0.002)
Hearer = Callable[[bytes], None]


class OtherEnd:
    """The far end of a link. Bytes that come go to `hear`."""

    by_threads = False
    """True if the near end is read by threads, as on Windows."""

    def __init__(self, _: Path) -> None:
        self.heard = bytearray()
        self.hear: Hearer = self.heard.extend

    def link(self) -> RobotLink:
        raise NotImplementedError

    def write(self, data: bytes) -> None:
        raise NotImplementedError

    def plug_in(self) -> None:
        raise NotImplementedError

    def unplug(self) -> None:
        raise NotImplementedError


class MemoryEnd(OtherEnd):
    """No port at all: a link made of two callbacks."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._listener: LinkListener | None = None
        self._connected = False

    def link(self) -> RobotLink:
        return MemoryLink(self)

    def write(self, data: bytes) -> None:
        if self._connected:
            asyncio.get_running_loop().call_soon(self._pass_on, data)

    def _pass_on(self, data: bytes) -> None:
        if self._listener is not None and self._connected:
            self._listener.received(data)

    def plug_in(self) -> None:
        self._connected = True
        if self._listener is not None:
            asyncio.get_running_loop().call_soon(self._listener.opened)

    def unplug(self) -> None:
        self._connected = False
        if self._listener is not None:
            self._listener.lost("memory has gone")

    def attach(self, listener: LinkListener | None) -> None:
        self._listener = listener
        if listener is not None and self._connected:
            asyncio.get_running_loop().call_soon(listener.opened)

    def take(self, data: bytes) -> None:
        if self._connected:
            self.hear(data)


class MemoryLink:
    """The near end of a `MemoryEnd`."""

    restarts_board = False

    def __init__(self, end: MemoryEnd) -> None:
        self._end = end

    @property
    def name(self) -> str:
        return "memory"

    def start(self, listener: LinkListener) -> None:
        self._end.attach(listener)

    def write(self, data: bytes) -> None:
        self._end.take(data)

    def write_instead(self, data: bytes) -> list[bytes]:
        self._end.take(data)
        return []

    def close(self) -> None:
        self._end.attach(None)


class PtyEnd(OtherEnd):
    """The far end of a pty, reached by one name however often it is pulled out."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.name = folder / "robot"
        self.master = self.slave = -1

    def link(self) -> RobotLink:
        return SerialLink(str(self.name), back_off=QUICK)

    def write(self, data: bytes) -> None:
        os.write(self.master, data)

    def plug_in(self) -> None:
        import tty

        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        new = self.name.with_suffix(".new")
        new.symlink_to(os.ttyname(self.slave))
        new.rename(self.name)
        asyncio.get_running_loop().add_reader(self.master, self.read)

    def read(self) -> None:
        self.hear(os.read(self.master, 4096))

    def unplug(self) -> None:
        if self.master == -1:
            return
        asyncio.get_running_loop().remove_reader(self.master)
        self.name.unlink()
        for each in (self.slave, self.master):
            os.close(each)
        self.master = self.slave = -1


class TcpEnd(OtherEnd):
    """A bridge: a server that the link connects to with socket://."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._port = 0
        self._listening: socket.socket | None = None
        self._connected: list[socket.socket] = []

    def link(self) -> RobotLink:
        return SerialLink(f"socket://127.0.0.1:{self._port}", back_off=QUICK)

    def write(self, data: bytes) -> None:
        self._connected[-1].sendall(data)

    def plug_in(self) -> None:
        self._listening = socket.create_server(("127.0.0.1", self._port))
        self._listening.setblocking(False)
        self._port = self._listening.getsockname()[1]
        asyncio.get_running_loop().add_reader(self._listening, self._accept)

    def _accept(self) -> None:
        assert self._listening is not None
        connection, _ = self._listening.accept()
        connection.setblocking(False)
        self._connected.append(connection)
        asyncio.get_running_loop().add_reader(connection, self.read, connection)

    def read(self, connection: socket.socket) -> None:
        data = connection.recv(4096)
        if data:
            self.hear(data)
        else:
            asyncio.get_running_loop().remove_reader(connection)

    def unplug(self) -> None:
        loop = asyncio.get_running_loop()
        for each in (*self._connected, self._listening):
            if each is not None:
                loop.remove_reader(each)
                each.close()
        self._connected.clear()
        self._listening = None


def _ends() -> list[Any]:
    unix_only = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no ptys")
    return [
        pytest.param((MemoryEnd, False), id="memory"),
        pytest.param((PtyEnd, False), id="pty", marks=unix_only),
        pytest.param((PtyEnd, True), id="pty by threads", marks=unix_only),
        pytest.param((TcpEnd, False), id="tcp"),
    ]


@pytest.fixture(params=_ends())
def other_end(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> OtherEnd:
    """The far end of a link, of every kind in turn; not plugged in yet."""
    kind, by_threads = request.param
    return _end(kind, tmp_path, monkeypatch, by_threads=by_threads)


@pytest.fixture(params=[False, True], ids=["loop", "threads"])
def pty_end(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> OtherEnd:
    """The far end of a pty, not plugged in yet; the near end read by the event loop, and by threads."""
    if sys.platform == "win32":
        pytest.skip("Windows has no ptys")
    return _end(PtyEnd, tmp_path, monkeypatch, by_threads=request.param)


def _end(
    kind: type[OtherEnd], folder: Path, monkeypatch: pytest.MonkeyPatch, *, by_threads: bool
) -> OtherEnd:
    if by_threads:  # as on Windows
        monkeypatch.setattr(serial_channel, "descriptor_of", lambda port: None)
    end = kind(folder)
    end.by_threads = by_threads
    return end
