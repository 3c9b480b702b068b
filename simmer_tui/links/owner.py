"""The user who owns the other end of a local connection. Linux only: other systems do not say."""

from __future__ import annotations

import os
import socket
import struct
import sys
from functools import lru_cache

_SOCK_DIAG, _TCP_ALL_STATES = 4, 0xFFFFFFFF
_REQUEST = struct.Struct("=IHHII BBBBI")
"""Header of a netlink message, and the head of `struct inet_diag_req_v2` (linux/inet_diag.h)."""
_PORTS = struct.Struct("!HH")
_PLACES = struct.Struct("16s16s")
_REST = struct.pack("=III", 0, 0xFFFFFFFF, 0xFFFFFFFF)
"""Any interface, any cookie."""
_BY_FAMILY, _NLM_F_REQUEST = 20, 1
_SIZE = _REQUEST.size + _PORTS.size + _PLACES.size + len(_REST)
_HEADS = {
    family: _REQUEST.pack(
        _SIZE, _BY_FAMILY, _NLM_F_REQUEST, 0, 0, family, socket.IPPROTO_TCP, 0, 0, _TCP_ALL_STATES
    )
    for family in (socket.AF_INET, socket.AF_INET6)
}
_ANSWER = struct.Struct("=4xH10x 4x48x12x II")
"""The kind of the answer, and the owner and the inode, behind most of `struct inet_diag_msg`."""


@lru_cache(64)
def _around_ports(there: str, here: str) -> tuple[bytes, bytes]:
    """Parts of a request before and after the ports, for two addresses of one family."""
    family = socket.AF_INET6 if ":" in here else socket.AF_INET
    places = _PLACES.pack(socket.inet_pton(family, there), socket.inet_pton(family, here))
    return _HEADS[family], places + _REST


class OwnerLookup:
    """Asks the system who owns the far socket of a connection, one question a connection.

    Nothing is remembered: a port belongs to somebody else the next moment.
    """

    def __init__(self) -> None:
        self._netlink: socket.socket | None = None
        if sys.platform == "linux":
            try:
                self._netlink = socket.socket(
                    socket.AF_NETLINK, socket.SOCK_RAW | socket.SOCK_CLOEXEC, _SOCK_DIAG
                )
                self._netlink.connect((0, 0))
                self._netlink.setblocking(False)
            except OSError:  # a system that keeps it to itself
                self.close()

    def owner(self, sock: socket.socket, there: tuple[str, int]) -> int | None:
        """The user id of the other end, whose address and port are `there`, or None: on another
        machine, closed already, or not told."""
        if self._netlink is None:
            return None
        try:
            here = sock.getsockname()
            before, after = _around_ports(there[0], here[0])
            self._netlink.send(before + _PORTS.pack(there[1], here[1]) + after)
            answer = self._netlink.recv(512)
        except OSError:
            return None
        if len(answer) < _ANSWER.size:
            return None
        kind, uid, inode = _ANSWER.unpack_from(answer)
        if kind != _BY_FAMILY:
            return None
        # A socket that its program has closed has no inode. Newer kernels (6.18) still tell whose it
        # was, older ones say 0.
        return uid if inode or uid else None

    def close(self) -> None:
        """Ask no more."""
        if self._netlink is not None:
            self._netlink.close()
            self._netlink = None


def user_name(uid: int) -> str:
    """Name of a user on this machine."""
    import pwd

    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)


def ourselves() -> frozenset[int]:
    """User ids that may drive this robot: this process's user, and the administrator. None on Windows, where
    users have no numbers."""
    return frozenset((0, os.geteuid())) if hasattr(os, "geteuid") else frozenset()
