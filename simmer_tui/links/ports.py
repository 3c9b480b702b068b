"""Binds TCP ports, with error messages a student can act on."""

from __future__ import annotations

import errno
import socket
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from simmer_tui.errors import PortError

BACKLOG = 128
_TRIES = 50


@dataclass(frozen=True, slots=True)
class PortRequest:
    """A port to take: its number (0 for any free one), what it is for, the option that sets it."""

    number: int
    purpose: str
    option: str


class Listener:
    """The listening sockets of one port, one for each address."""

    def __init__(self, port: int, sockets: Sequence[socket.socket]) -> None:
        self.port = port
        self.sockets = tuple(sockets)

    def close(self) -> None:
        """Stop listening and release the port."""
        for each in self.sockets:
            each.close()


def take_port(host: str, request: PortRequest) -> Listener:
    """Listen on a port of `host`. `127.0.0.1` and `localhost` take ::1 as well where there is one.

    Raises PortError if the port is in use, not allowed, or the host is not one of this machine's.
    """
    for _ in range(_TRIES if request.number == 0 else 1):
        sockets: list[socket.socket] = []
        try:
            port = request.number
            for family, address in _addresses(host, request):
                sockets.append(listen_on(family, address, port))
                port = sockets[0].getsockname()[1]
        except OSError as error:
            for each in sockets:
                each.close()
            if error.errno == errno.EADDRINUSE and request.number == 0:
                continue  # the number free on one address was taken on the other
            raise PortError(_explained(error, host, request)) from None
        return Listener(port, sockets)
    raise PortError(f"no free port was found for {request.purpose} on {host}")


def _addresses(host: str, request: PortRequest) -> list[tuple[socket.AddressFamily, str]]:
    if host in ("127.0.0.1", "localhost"):
        pair = [(socket.AF_INET, "127.0.0.1")]
        if _has_ipv6_loopback():
            pair.append((socket.AF_INET6, "::1"))
        return pair
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except OSError:
        raise PortError(
            f"--host {host}: no such host; give an address of this machine, such as 127.0.0.1 or 0.0.0.0"
        ) from None
    return list(dict.fromkeys((family, str(address[0])) for family, _, _, _, address in found))


def _has_ipv6_loopback() -> bool:
    if not socket.has_ipv6:
        return False
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_STREAM) as probe:
            probe.bind(("::1", 0))
    except OSError:
        return False
    return True


def listen_on(family: socket.AddressFamily, address: str, port: int) -> socket.socket:
    """A listening socket on one address; raises OSError."""
    made = socket.socket(family, socket.SOCK_STREAM)
    try:
        if sys.platform == "win32":  # SO_REUSEADDR would share the port there
            made.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            made.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        made.bind((address, port))
        made.listen(BACKLOG)
        made.setblocking(False)
    except OSError:
        made.close()
        raise
    return made


def _explained(error: OSError, host: str, request: PortRequest) -> str:
    what = f"port {request.number} ({request.purpose})"
    if error.errno in (errno.EADDRINUSE, getattr(errno, "WSAEADDRINUSE", None)):
        return (
            f"{what} is in use on {host}: stop the program that has it (perhaps another simmer-tui), "
            f"or choose another with {request.option} N (0 takes any free one)"
        )
    if error.errno == errno.EACCES:
        return f"{what} may not be used by you: choose one above 1023 with {request.option} N"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"--host {host}: not an address of this machine; try 127.0.0.1 or 0.0.0.0"
    return f"{what} on {host}: {error.strerror or error}"
