"""The user behind a local connection, as far as the system reports it. Only Linux does.

Linux reports the owner of an open socket. For a socket that its program has closed, only kernels from 6.17 on
do, and only until the close is acknowledged, some 40 ms later. Programs that send packets close at once, and
a busy server may take longer than 40 ms. So the ends of connections are held back until they are accepted
(`OwnerLookup.hold_ends`). A filter on the listening socket drops them; the far end stays, because it must
send its end again. Of a reset socket nothing is left to ask about.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import sys
from array import array
from collections.abc import Iterator
from functools import cached_property, lru_cache
from typing import NamedTuple

from simmer_tui import platform_has

# Numbers of linux/netlink.h, linux/sock_diag.h and linux/inet_diag.h, which Python does not name.
_SOCK_DIAG, _TCP_ALL_STATES = 4, 0xFFFFFFFF
_REQUEST = struct.Struct("=IHHII BBBBI")
"""Header of a netlink message, and the head of `struct inet_diag_req_v2` (linux/inet_diag.h)."""
_PORTS = struct.Struct("!HH")
_PLACES = struct.Struct("16s16s")
_REST = struct.pack("=III", 0, 0xFFFFFFFF, 0xFFFFFFFF)
"""Any interface, any cookie."""
_BY_FAMILY, _NLM_F_REQUEST = 20, 1
_SIZE = _REQUEST.size + _PORTS.size + _PLACES.size + len(_REST)
_ANSWER = struct.Struct("=4xH10x xB2x48x4x IIII")
"""The fields of an answer: its kind, and from `struct inet_diag_msg` state, bytes not read, bytes not
acknowledged, owner, inode."""
_WITH_INFO = 2
"""Number of the extension `struct tcp_info` in a request, and of the attribute in the answer."""
_ATTRIBUTE = struct.Struct("=HH")
"""Length and kind of an attribute, after the answer."""
_BYTES = struct.Struct("=120xQQ")
"""The fields of `struct tcp_info` (linux/tcp.h) for bytes acknowledged, the opening counting as one, and
bytes received."""
_SYN_SENT, _FIN_WAIT1, _CLOSE = 2, 4, 7
"""States of a socket that is connecting, has sent its end, or is closed (include/net/tcp_states.h)."""
# SO_ATTACH_FILTER and SO_DETACH_FILTER of asm-generic/socket.h, which Python does not name either.
_ATTACH_FILTER, _DETACH_FILTER = 26, 27
# A program of four steps (linux/filter.h): load the byte of TCP's flags. If its first bit, FIN, is set, drop
# the packet; otherwise keep all of it.
_STEPS = ((48, 0, 0, 13), (69, 0, 1, 1), (6, 0, 0, 0), (6, 0, 0, 1 << 18))
_WITHOUT_ENDS = array("Q", b"".join(struct.pack("=HBBI", *step) for step in _STEPS))
# Any user but the administrator, 0: older kernels report 0 for every closed socket.
_SOMEBODY = 65534
"""The user `nobody`, as the owner of a probe."""


class RemoteSocket(NamedTuple):
    """The socket at the other end of a connection, as the system reports it."""

    uid: int
    inode: int
    """0 if its program has closed it."""
    state: int
    unacknowledged: int
    """Bytes that have not been acknowledged; the end counts as one."""
    unread: int = 0
    """Bytes received that its program has not read."""

    @property
    def has_ended(self) -> bool:
        """True if it will send no more bytes."""
        return self.state == _FIN_WAIT1


class OwnerLookup:
    """Asks the system for the owner of the far socket, once for each connection. No answer is kept: the port
    may soon belong to another program."""

    def __init__(self) -> None:
        self._netlink: socket.socket | None = None
        self._holds = False
        if sys.platform == "linux" and platform_has.LINUX:
            try:
                self._netlink = socket.socket(
                    socket.AF_NETLINK, socket.SOCK_RAW | socket.SOCK_CLOEXEC, _SOCK_DIAG
                )
                self._netlink.connect((0, 0))
                self._netlink.setblocking(False)
            except OSError:  # a system that does not report owners
                self.close()

    @property
    def is_possible(self) -> bool:
        """True if the system reports owners at all."""
        return self._netlink is not None

    @property
    def is_complete(self) -> bool:
        """True if the system reports the owner of every local connection, even a closed one, unless it was
        reset."""
        return self._holds and self.tells_closed

    def hold_ends(self, listening: socket.socket) -> None:
        """Hold back the end of each connection to a socket until its `owner` is asked for, if possible."""
        if self._netlink is not None:
            with contextlib.suppress(OSError):
                _drop_ends(listening)
                self._holds = True

    def owner(self, sock: socket.socket, there: tuple[str, int]) -> int | None:
        """The user id of the other end, whose address and port are `there`. Its end is no longer held back.

        None if it is on another machine, was reset, or is not reported.
        """
        if self._holds:
            # Before the question, or an end might be lost between the two. An end that comes now is
            # acknowledged late enough.
            with contextlib.suppress(OSError):
                sock.setsockopt(socket.SOL_SOCKET, _DETACH_FILTER, 0)
        far = self.ask(sock, there)
        # If it was reset, or closed and forgotten by the system, its port may be somebody else's by now.
        if far is None or far.state == _SYN_SENT or is_reset(sock):
            return None
        if far.has_ended and self._holds:
            self._end(sock, there, far)
        if far.uid or far.inode:
            return far.uid
        return 0 if far.has_ended and self.tells_closed else None

    def _end(self, sock: socket.socket, there: tuple[str, int], far: RemoteSocket) -> None:
        """Close a connection after all bytes that have come: its end was dropped, and is sent again only
        after 200 ms."""
        # Unacknowledged bytes may be on their way, with the end behind them, or may have come just now.
        if far.unacknowledged <= 1 or self._has_arrived(sock, there):
            with contextlib.suppress(OSError):
                sock.shutdown(socket.SHUT_RD)

    def _has_arrived(self, sock: socket.socket, there: tuple[str, int]) -> bool:
        """True if all bytes of the other end have arrived, except for its end."""
        if sys.platform != "linux":
            return False
        answer = self._answer(sock, there, _WITH_INFO)
        for kind, payload in attributes(answer[_ANSWER.size :]):
            if kind == _WITH_INFO and len(payload) >= _BYTES.size:
                acknowledged, _ = _BYTES.unpack_from(payload)
                unacknowledged = _ANSWER.unpack_from(answer)[3]
                info = sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _BYTES.size)
                # The opening and the end count as a byte each.
                return bool(acknowledged + unacknowledged - 2 == _BYTES.unpack(info)[1])
        return False

    def ask(self, sock: socket.socket, there: tuple[str, int]) -> RemoteSocket | None:
        """The socket at the other end; None if the system does not report it."""
        answer = self._answer(sock, there)
        if len(answer) < _ANSWER.size:
            return None
        kind, state, unread, unacknowledged, uid, inode = _ANSWER.unpack_from(answer)
        return RemoteSocket(uid, inode, state, unacknowledged, unread) if kind == _BY_FAMILY else None

    def _answer(self, sock: socket.socket, there: tuple[str, int], extensions: int = 0) -> bytes:
        """The system's answer to a question about the other end; empty if there is none."""
        if self._netlink is None:
            return b""
        try:
            here = sock.getsockname()
            before, after = _around_ports(there[0], here[0], extensions)
            # Our end is the far end of theirs, so the addresses are swapped.
            self._netlink.send(before + _PORTS.pack(there[1], here[1]) + after)
            return self._netlink.recv(1024)
        except OSError:
            return b""

    @cached_property
    def tells_closed(self) -> bool:
        """True if the system reports the owner of a socket that its program has closed."""
        # Tried, since version numbers say little: distributions change their kernels.
        if sys.platform != "linux":
            return False
        try:
            with socket.create_server(("127.0.0.1", 0)) as listening, socket.socket() as probe:
                _drop_ends(listening)
                if os.geteuid() == 0:
                    os.fchown(probe.fileno(), _SOMEBODY, -1)
                probe.connect(listening.getsockname())
                accepted, there = listening.accept()
                probe.close()
                with accepted:
                    far = self.ask(accepted, there)
        except OSError:
            return False
        return far is not None and far.uid == (os.geteuid() or _SOMEBODY)

    def close(self) -> None:
        """Close the socket to the kernel."""
        if self._netlink is not None:
            self._netlink.close()
            self._netlink = None


def attributes(data: bytes) -> Iterator[tuple[int, bytes]]:
    """The attributes after the head of a netlink answer, each with its kind and payload."""
    at = 0
    while at + _ATTRIBUTE.size <= len(data):
        length, kind = _ATTRIBUTE.unpack_from(data, at)
        yield kind, data[at + _ATTRIBUTE.size : at + length]
        at += max(length + 3 & ~3, _ATTRIBUTE.size)


def _drop_ends(listening: socket.socket) -> None:
    """Make the system drop the ends of connections to a socket."""
    address, steps = _WITHOUT_ENDS.buffer_info()
    listening.setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, struct.pack("HP", steps, address))


@lru_cache(64)
def _around_ports(there: str, here: str, extensions: int) -> tuple[bytes, bytes]:
    """Parts of a request before and after the ports, for two addresses of one family."""
    family = socket.AF_INET6 if ":" in here else socket.AF_INET
    places = _PLACES.pack(socket.inet_pton(family, there), socket.inet_pton(family, here))
    asked = (family, socket.IPPROTO_TCP, extensions, 0, _TCP_ALL_STATES)
    return _REQUEST.pack(_SIZE, _BY_FAMILY, _NLM_F_REQUEST, 0, 0, *asked), places + _REST


def is_reset(sock: socket.socket) -> bool:
    """True if the other end has reset the connection: it cannot be answered any more."""
    tcp_info = getattr(socket, "TCP_INFO", None)
    if tcp_info is None:
        return False
    try:
        return sock.getsockopt(socket.IPPROTO_TCP, tcp_info, 1)[0] == _CLOSE
    except OSError:
        return False
