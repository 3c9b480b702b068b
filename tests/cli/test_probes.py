"""Connections that only look for the port, as `nc -z` and curl do, before the program starts."""

from __future__ import annotations

import re
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

_WAIT = 60


@contextmanager
def once(*options: str) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """A simulator with --once, and the first port of its first line."""
    command = [sys.executable, "-m", "simmer_tui", "--no-ui", "--once", "--port", "0", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        try:
            found = re.search(r"on port (\d+)", process.stdout.readline())
            assert found is not None
            yield process, int(found[1])
        finally:
            process.kill()


def connect(port: int, sent: bytes = b"") -> bytes:
    """Send something, and read 8 bytes, or what there is before the end."""
    with socket.create_connection(("127.0.0.1", port), timeout=_WAIT) as sock:
        if not sent:
            return b""
        sock.sendall(sent)
        return sock.recv(8, socket.MSG_WAITALL)


def test_once_waits_for_a_client_that_sends_something() -> None:
    with once() as (process, port):
        for _ in range(3):
            connect(port)
        connect(port, b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        (value,) = struct.unpack(">d", connect(port, b"\xef\xbb\xbfu1\n"))
        assert 0 < value < 200
        assert process.wait(_WAIT) == 0


@pytest.mark.slow
def test_once_waits_for_a_packet() -> None:
    with once("--listeners", "packets", "--packet-port", "0", "--idle", "0.2") as (process, port):
        connect(port)
        connect(port, b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(1)
        connect(port, b"\xef\xbb\xbf[u1]")
        assert process.wait(_WAIT) == 0
