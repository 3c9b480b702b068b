"""The connections that are admitted, by the same rule on every port: those of our own user, and those with
the token. Only Linux says whose a local connection is: on other systems the token alone counts."""

from __future__ import annotations

import asyncio
import hmac
import os
import socket
import struct
import sys
from collections.abc import Callable
from functools import lru_cache
from ipaddress import ip_address

from simmer_tui.engine import Engine
from simmer_tui.events import Notice, NoticeKind
from simmer_tui.links.peer import CLOSING
from simmer_tui.sim.command import escape

# As long as a command may be, which is what a program without a token sends first.
LONGEST_TOKEN = 256
"""Bytes of a first line in which a token is looked for."""
# Judged: a program that tries in a loop must not fill log and screen.
_AGAIN = 1.0
"""Seconds before the same complaint is told again."""


class TurnedAwayNotices:
    """The notices that say who was turned away: of many, one line a second."""

    def __init__(self, engine: Engine) -> None:
        """Needs a running event loop, whose clock it goes by."""
        self._engine = engine
        self._loop = asyncio.get_running_loop()
        self._told: dict[str, float] = {}

    def tell(self, text: str, complaint: str = "") -> None:
        """Say why somebody was turned away, unless the same `complaint` (by default the text) was
        told within the last second."""
        # Texts differ by the port of the client, so the complaint is told apart by its kind.
        complaint = complaint or text
        now = self._loop.time()
        if now >= self._told.get(complaint, now):
            self._told = {each: until for each, until in self._told.items() if until > now}
            self._told[complaint] = now + _AGAIN
            self._engine.tell(Notice(NoticeKind.TURNED_AWAY, text))


class AccessCheck:
    """The rule for admission of connections."""

    def __init__(self, engine: Engine, *, any_user: bool = True, token: str = "") -> None:
        """`any_user` lets programs of other users of this machine in. With a `token`, each
        connection has to send it as its first line."""
        self.tell = TurnedAwayNotices(engine).tell
        self._lookup = None if any_user else OwnerLookup()
        self._token = token.encode()
        self._ours = ourselves()
        self._stranger_seen = False
        """True once a connection of another user has been seen on any port of this run."""

    def close(self) -> None:
        """Stop looking up the owners of connections."""
        if self._lookup is not None:
            self._lookup.close()

    def admits(self, sock: socket.socket, there: tuple[str, int]) -> bool:
        """True if the program at the other end, `there`, may connect. If not, a notice names its owner."""
        if self._lookup is None:
            return True
        uid = self._lookup.owner(sock, there)
        if uid in self._ours:
            return True
        if uid is None:
            return self._admits_unknown(sock, there)
        self._stranger_seen = True
        user = escape(user_name(uid), 40)
        self.tell(
            f"a program of user {user} turned away from port {sock.getsockname()[1]}: this robot is "
            "somebody else's; --any-user lets all users of this machine in"
        )
        return False

    def _admits_unknown(self, sock: socket.socket, there: tuple[str, int]) -> bool:
        """True if a connection may stay of which the system does not tell whose it is."""
        # On another machine, or who has the token will be asked for it.
        if self._token or not ip_address(there[0]).is_loopback:
            return True
        # Its program has closed it already, as those of simmer-python do. The system tells whose it was only
        # for a moment after the close; of one that was reset, it tells nothing.
        broken = _is_reset(sock)
        if not broken and not self._stranger_seen:
            return True
        what = "it broke off" if broken else "it was closed, and other users connect as well"
        self.tell(
            f"a connection turned away from port {sock.getsockname()[1]}: whose it was cannot be told, "
            f"{what}. Set a --token",
            "whose it was cannot be told",
        )
        return False

    def check_token(
        self, sock: socket.socket, peer: str, decided: Callable[[TokenCheck, bool], None]
    ) -> TokenCheck | None:
        """Wait for the token on a connection, then call `decided`. None if no token is asked for."""
        return TokenCheck(self, sock, peer, decided) if self._token else None

    def is_token(self, line: bytes) -> bool:
        """True if a first line is the token."""
        # Compared in constant time: the time of == tells how many characters are right.
        return hmac.compare_digest(line.removesuffix(b"\r"), self._token)


class TokenCheck:
    """A connection whose first line has not arrived yet. No byte after that line is consumed."""

    def __init__(
        self,
        access: AccessCheck,
        sock: socket.socket,
        peer: str,
        decided: Callable[[TokenCheck, bool], None],
    ) -> None:
        self.sock = sock
        self.peer = peer
        self._access = access
        self._decided = decided
        self._line = b""
        self._open = True
        self._loop = asyncio.get_running_loop()
        self._patience = self._loop.call_later(CLOSING, self._decide, False)
        self._loop.add_reader(sock, self.look)

    def look(self) -> None:
        """Check whether the line has arrived."""
        if not self._open:
            return
        try:
            # Peeked at first: the bytes after the line are commands, and not ours to take.
            seen = self.sock.recv(LONGEST_TOKEN, socket.MSG_PEEK)
            line, end, _ = seen.partition(b"\n")
            self._line += self.sock.recv(len(line + end)) if seen else b""
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self._decide(False)
            return
        if end:
            self._decide(self._access.is_token(self._line.removesuffix(b"\n")))
        # The other end has closed, or has sent a whole line's worth without an end.
        elif not seen or len(self._line) > LONGEST_TOKEN:
            self._decide(False)

    def cancel(self) -> None:
        """Stop waiting for the token, without calling `decided`."""
        if self._open:
            self._open = False
            self._patience.cancel()
            self._loop.remove_reader(self.sock)

    def _decide(self, good: bool) -> None:
        self.cancel()
        if not good:
            host = self.peer.rpartition(":")[0]
            self._access.tell(f"a connection from {host} turned away: its first line is not the --token")
        self._decided(self, good)


# -- the user at the other end ----------------------------------------------------------------------

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
_HEADS = {
    family: _REQUEST.pack(
        _SIZE, _BY_FAMILY, _NLM_F_REQUEST, 0, 0, family, socket.IPPROTO_TCP, 0, 0, _TCP_ALL_STATES
    )
    for family in (socket.AF_INET, socket.AF_INET6)
}
_TCP_CLOSE = 7
"""State of a connection that is no more (include/net/tcp_states.h)."""
_ANSWER = struct.Struct("=4xH10x 4x48x12x II")
"""The kind of the answer, and the owner and the inode, behind most of `struct inet_diag_msg`."""


def _is_reset(sock: socket.socket) -> bool:
    """True if the other end has broken off: nothing that it sent can be answered on this connection."""
    tcp_info = getattr(socket, "TCP_INFO", None)
    if tcp_info is None:
        return False
    try:
        return sock.getsockopt(socket.IPPROTO_TCP, tcp_info, 1)[0] == _TCP_CLOSE
    except OSError:
        return False


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
        told = self.ask(sock, there)
        # A socket that its program has closed has no inode. Newer kernels (6.18) still tell whose it
        # was, older ones say 0.
        return told[0] if told is not None and any(told) else None

    def ask(self, sock: socket.socket, there: tuple[str, int]) -> tuple[int, int] | None:
        """The user id and the inode of the other end as the system tells them; None if it does not."""
        if self._netlink is None:
            return None
        try:
            here = sock.getsockname()
            before, after = _around_ports(there[0], here[0])
            # Our end is the far end of theirs, so the addresses are given the other way round.
            self._netlink.send(before + _PORTS.pack(there[1], here[1]) + after)
            answer = self._netlink.recv(512)
        except OSError:
            return None
        if len(answer) < _ANSWER.size:
            return None
        kind, uid, inode = _ANSWER.unpack_from(answer)
        return (uid, inode) if kind == _BY_FAMILY else None

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
    # The administrator can do everything anyway; services and containers often run as that user.
    return frozenset((0, os.geteuid())) if hasattr(os, "geteuid") else frozenset()
