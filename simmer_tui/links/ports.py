"""TCP ports: taking them, with error messages a student can act on, and accepting their connections."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import socket
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

from msgspec import Struct

from simmer_tui.config.dialects import BACKLOG
from simmer_tui.errors import PortError, reason_of
from simmer_tui.links.access import AccessCheck, TokenCheck
from simmer_tui.links.peer import MOST_WAITING, PIECE, Peer, ReadBudget, RefusedPeer

# Judged: a port free on 127.0.0.1 is nearly always free on ::1, so two tries are usually enough.
_TRIES = 50


class PortRequest(Struct, frozen=True):
    """A port to take: its number (0 for any free one), purpose, option, and backlog (connections that the
    system keeps until they are accepted). If it `falls_back` and is in use, any free one is taken."""

    number: int
    purpose: str
    option: str
    backlog: int = BACKLOG
    falls_back: bool = False


class Listener(Struct, frozen=True):
    """The listening sockets of one port, one for each address."""

    port: int
    sockets: Sequence[socket.socket]
    backlog: int = BACKLOG

    def close(self) -> None:
        """Stop listening and release the port."""
        for each in self.sockets:
            each.close()


def take_port(host: str, request: PortRequest) -> Listener:
    """Listen on a port of `host`. `127.0.0.1` and `localhost` take ::1 as well if there is one.

    Raises PortError if the port is in use or not allowed, or the host is not one of this machine's.
    """
    for _ in range(_TRIES if request.number == 0 else 1):
        sockets: list[socket.socket] = []
        try:
            port = request.number
            for family, address in _addresses(host):
                sockets.append(listen_on(family, address, port, request.backlog))
                port = sockets[0].getsockname()[1]
        except OSError as error:
            for each in sockets:
                each.close()
            if error.errno == errno.EADDRINUSE and request.number == 0:
                continue  # the number free on one address was taken on the other
            raise PortError(_explained(error, host, request)) from None
        return Listener(port, sockets, request.backlog)
    raise PortError(f"no free port was found for {request.purpose} on {host}")


def _addresses(host: str) -> list[tuple[socket.AddressFamily, str]]:
    # Clients say localhost, which is ::1 first on some systems and 127.0.0.1 on others.
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
    # Compiled in is not enough: containers often have no ::1. Only a bind shows it.
    try:
        listen_on(socket.AF_INET6, "::1", 0, 1).close()
    except OSError:
        return False
    return True


def listen_on(family: socket.AddressFamily, address: str, port: int, backlog: int) -> socket.socket:
    """A listening socket on one address; raises OSError."""
    made = socket.socket(family, socket.SOCK_STREAM)
    try:
        if sys.platform == "win32":  # SO_REUSEADDR would share the port there
            made.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            # Otherwise a restart would have to wait a minute for old connections to time out.
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            # Otherwise :: would take the IPv4 port as well, which has a socket of its own.
            made.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        made.bind((address, port))
        made.listen(backlog)
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
    return f"{what} on {host}: {reason_of(error)}"


# -- accepting --------------------------------------------------------------------------------------

# The listening socket stays readable: without a pause the loop would run at full load until a
# descriptor is free.
ACCEPT_PAUSE = 1.0
"""Seconds before connections are accepted again after the system ran out of descriptors."""
# Judged: few enough not to delay the command under way noticeably.
ACCEPTED = 16
"""Connections accepted in one turn of the event loop, so that a flood leaves time for others."""
# With those of two ports that are served they are below the 1024 descriptors that a process has by default.
# 64 take about a millisecond.
_CROWD, _TAKEN = 384, 64
"""Connections that are kept until they are let in, where a crowd is expected, and how many are taken from the
system in one turn of the event loop."""
# One let in takes 0.1 ms, a close 10 to 30 us: others have most of the time. A crowd of 500 is settled after
# 0.15 s. Done at once it would delay the round trips of 20 others by half.
_SETTLED, _CLOSED, _SETTLE_PAUSE = 2, 8, 0.001
"""Silent connections of a crowd let in at once, or closed, and seconds to the next ones."""
_CLOSED_IF_FULL = 48
"""Silent connections closed in one turn of the event loop if there is no room for more."""

GONE_AFTER = 60
"""Seconds after which a connection ends whose other machine is gone (a laptop closed).
Otherwise it would block the robot for hours."""
# 30 s of silence, then three probes 10 s apart. TCP_KEEPALIVE is macOS' name. While bytes are unacknowledged
# the system sends those again, for 15 minutes, and no probes. Linux limits that in milliseconds. macOS'
# TCP_RXT_CONNDROPTIME (0x80 in its tcp.h) and Windows' TCP_MAXRT (5) are seconds without a name in Python.
_LIMITS: list[tuple[int | None, int]] = [
    (getattr(socket, "TCP_KEEPIDLE", None), 30),
    (getattr(socket, "TCP_KEEPALIVE", None), 30),
    (getattr(socket, "TCP_KEEPINTVL", None), 10),
    (getattr(socket, "TCP_KEEPCNT", None), 3),
    (getattr(socket, "TCP_USER_TIMEOUT", None), GONE_AFTER * 1000),
    ({"darwin": 0x80, "win32": 5}.get(sys.platform), GONE_AFTER),
]


def end_with_machine(sock: socket.socket) -> None:
    """Make the system end a connection within a minute after the other machine is gone, if it can."""
    for option, value in _LIMITS:
        if option is not None:
            with contextlib.suppress(OSError):  # Python has the name, but an older system does not support it
                sock.setsockopt(socket.IPPROTO_TCP, option, value)


_Incoming = tuple[socket.socket, tuple[str, int]]
"""An accepted connection, with the address and port of its other end."""


class Crowd(Struct, frozen=True):
    """The silent connections of a port to which many may come at once. `most_silent` of them are kept, and
    `closed` is called with the peer of each further one, after it was closed."""

    most_silent: int
    closed: Callable[[str], None]


def _peer(there: tuple[str, int]) -> str:
    return f"{there[0]}:{there[1]}"


def _has_spoken(sock: socket.socket) -> bool:
    """True if anything has come on a connection, if only its end."""
    try:
        sock.recv(1, socket.MSG_PEEK)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


@dataclass(eq=False)
class Acceptor:
    """Passes each admitted connection to a port to `welcome(socket, peer)`.

    It has its own accept loop, not asyncio's server. A link may need to know of a connection before the next
    byte of another is read (`accept_waiting`). Needs a running event loop. Without `access` everybody may
    connect. With a `crowd` many connections may come at once. Those that have sent something are let in
    first; of the others the newest ones are kept.
    """

    listener: Listener
    welcome: Callable[[socket.socket, str], None]
    access: AccessCheck | None = None
    crowd: Crowd | None = None

    def __post_init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._checking: dict[TokenCheck, None] = {}
        self._refused_peers: set[Peer] = set()
        self._budget = ReadBudget(PIECE)
        self._spoken: deque[_Incoming] = deque()
        self._silent: deque[_Incoming] = deque()
        """Connections of a crowd that wait here: those that have sent something, and the others."""
        self._letting_in: asyncio.Handle | None = None
        self._kept = 0
        """Count of silent connections of this crowd that were let in."""
        self._is_full = False
        """True if more of a crowd may wait in the system."""
        self.in_crowd = False
        """True while a connection is let in that sent nothing though many others came."""
        self.resume()

    @property
    def is_behind(self) -> bool:
        """True if connections of a crowd are not let in yet."""
        return self._is_full or bool(self._spoken or self._silent)

    def accept_waiting(self) -> None:
        """Accept all waiting connections now."""
        for sock in self.listener.sockets:
            # As many as the system can keep, so that no earlier connection is missed.
            self._accept(sock, self.listener.backlog + 1)
        for check in tuple(self._checking):
            check.look()

    def refuse(self, sock: socket.socket, peer: str) -> None:
        """End a refused connection cleanly; if there are too many of them, at once."""
        if len(self._refused_peers) < MOST_WAITING:
            self._refused_peers.add(RefusedPeer(sock, peer, self._budget, self._refused_peers.discard))
        else:
            sock.close()

    def close(self) -> None:
        """Release the port, and end connections that are not admitted yet."""
        self.pause()
        self.listener.close()
        for check in self._checking:
            check.cancel()
            check.sock.close()
        self._checking.clear()
        if self._letting_in is not None:
            self._letting_in.cancel()
        for sock, _ in (*self._spoken, *self._silent):
            sock.close()
        for peer in tuple(self._refused_peers):
            peer.abort()

    def pause(self) -> None:
        """Accept nothing until `resume`; the system keeps new connections waiting."""
        for sock in self.listener.sockets:
            self._loop.remove_reader(sock)

    def resume(self) -> None:
        """Accept again."""
        for sock in self.listener.sockets:
            self._listen(sock)

    def _listen(self, sock: socket.socket) -> None:
        if sock.fileno() != -1:
            self._loop.add_reader(sock, self._accept, sock)

    def _accept(self, listening: socket.socket, most: int = ACCEPTED) -> None:
        if self.crowd is None:
            for sock, there in islice(self._incoming(listening), most):
                self._let_in(sock, there)
            return
        room = min(_TAKEN, _CROWD - len(self._spoken) - len(self._silent))
        come = list(islice(self._incoming(listening), room))
        self._is_full = len(come) == room
        if len(come) <= ACCEPTED and not self._is_full:
            self.in_crowd = self._letting_in is not None
            for sock, there in come:
                self._kept += self.in_crowd and not _has_spoken(sock)  # it is newer than those that wait
                self._let_in(sock, there)
            self.in_crowd = False
            return
        for incoming in come:
            (self._spoken if _has_spoken(incoming[0]) else self._silent).append(incoming)
        if self._letting_in is not None:
            self._letting_in.cancel()  # perhaps it pauses
        self._letting_in = self._loop.call_soon(self._let_crowd_in, self.crowd)

    def _incoming(self, listening: socket.socket) -> Iterator[_Incoming]:
        """The connections that wait in the system."""
        while True:
            try:
                sock, address = listening.accept()
            except ConnectionAbortedError:
                continue
            except BlockingIOError:
                return
            except OSError:  # the system has no room for more now; trying again at once would keep it busy
                self._loop.remove_reader(listening)
                self._loop.call_later(ACCEPT_PAUSE, self._listen, listening)
                return
            sock.setblocking(False)
            yield sock, address[:2]

    def _let_crowd_in(self, crowd: Crowd) -> None:
        """Let in some of a crowd. Connections that are served have their turns meanwhile."""
        self._letting_in = None
        spoken, silent = self._spoken, self._silent
        for _ in range(min(ACCEPTED, len(spoken))):
            self._let_in(*spoken.popleft())
        # Those that wait in the system come first: one of them may have sent something.
        is_full, self._is_full = self._is_full, False  # until the next accept
        has_room = len(spoken) + len(silent) <= _CROWD - _TAKEN
        surplus = min(self._kept + len(silent) - crowd.most_silent, len(silent))
        for _ in range(min(surplus, 0 if is_full and has_room else _CLOSED if has_room else _CLOSED_IF_FULL)):
            sock, there = oldest = silent.popleft()
            if _has_spoken(sock):  # meanwhile
                spoken.append(oldest)
                continue
            sock.close()
            crowd.closed(_peer(there))
        if surplus <= 0 and not is_full:
            self.in_crowd = True
            for _ in range(min(_SETTLED, len(silent))):
                self._let_in(*silent.popleft())
                self._kept += 1
            self.in_crowd = False
        if spoken or is_full:
            self._letting_in = self._loop.call_soon(self._let_crowd_in, crowd)
        elif silent:
            self._letting_in = self._loop.call_later(_SETTLE_PAUSE, self._let_crowd_in, crowd)
        else:
            self._kept = 0

    def _let_in(self, sock: socket.socket, there: tuple[str, int]) -> None:
        with contextlib.suppress(OSError):  # it has closed already, which the read will show
            # Replies are a few bytes: Nagle's algorithm would delay them.
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        end_with_machine(sock)
        peer = _peer(there)
        if self.access is None:
            self.welcome(sock, peer)
            return
        if not self.access.admits(sock, there):
            self.refuse(sock, peer)
            return
        check = self.access.check_token(sock, peer, self._decided)
        if check is None:
            self.welcome(sock, peer)
            return
        # Connections that send nothing must not fill the port for those that have the token.
        if len(self._checking) >= MOST_WAITING:
            oldest = next(iter(self._checking))
            oldest.cancel()
            self._decided(oldest, False)
        self._checking[check] = None
        check.look()

    def _decided(self, check: TokenCheck, good: bool) -> None:
        del self._checking[check]
        (self.welcome if good else self.refuse)(check.sock, check.peer)
