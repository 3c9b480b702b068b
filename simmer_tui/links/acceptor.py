"""Accepting connections on a port: all that are waiting, before anything else happens."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Callable

from simmer_tui.links.access import AccessCheck, TokenCheck
from simmer_tui.links.peer import MOST_WAITING, PIECE, Peer, ReadBudget, TurnedAway
from simmer_tui.links.ports import BACKLOG, Listener

ACCEPT_PAUSE = 1.0
"""Seconds before connections are accepted again after the system ran out of room for them."""
ACCEPTED = 16
"""Connections accepted in a turn of the event loop: a flood must leave others their turn."""


class Acceptor:
    """Passes each connection to a port that is admitted to `welcome(socket, peer)`.

    An own accept loop instead of asyncio's server, because a link may need to know of a
    connection before the next byte of another is looked at (`accept_waiting`).
    """

    def __init__(
        self,
        listener: Listener,
        welcome: Callable[[socket.socket, str], None],
        access: AccessCheck | None = None,
    ) -> None:
        """Begin to listen. Needs a running event loop. Without `access` everybody may connect."""
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._welcome = welcome
        self._access = access
        self._checking: dict[TokenCheck, None] = {}
        self._turned_away: set[Peer] = set()
        self._budget = ReadBudget(PIECE)
        for sock in listener.sockets:
            self._listen(sock)

    def accept_waiting(self) -> None:
        """Accept everything that waits now."""
        for sock in self._listener.sockets:
            self._accept(sock, BACKLOG + 1)
        for check in tuple(self._checking):
            check.look()

    def turn_away(self, sock: socket.socket, peer: str) -> None:
        """End a connection that is not wanted, cleanly; if there are too many of them, at once."""
        if len(self._turned_away) < MOST_WAITING:
            self._turned_away.add(TurnedAway(sock, peer, self._budget, self._turned_away.discard))
        else:
            sock.close()

    def close(self) -> None:
        """Give the port back, and end those who have not come in."""
        self.pause()
        self._listener.close()
        for check in self._checking:
            check.cancel()
            check.sock.close()
        for peer in tuple(self._turned_away):
            peer.abort()

    def pause(self) -> None:
        """Accept nothing until `resume`; the system keeps who comes waiting."""
        for sock in self._listener.sockets:
            self._loop.remove_reader(sock)

    def resume(self) -> None:
        """Accept again."""
        for sock in self._listener.sockets:
            self._listen(sock)

    def _listen(self, sock: socket.socket) -> None:
        if sock.fileno() != -1:
            self._loop.add_reader(sock, self._accept, sock)

    def _accept(self, listening: socket.socket, most: int = ACCEPTED) -> None:
        for _ in range(most):
            try:
                sock, address = listening.accept()
            except ConnectionAbortedError:
                continue
            except BlockingIOError:
                return
            except OSError:  # the system has no room for more now; asking on would keep it busy
                self._loop.remove_reader(listening)
                self._loop.call_later(ACCEPT_PAUSE, self._listen, listening)
                return
            sock.setblocking(False)
            with contextlib.suppress(OSError):  # it has gone already, which is found out soon enough
                sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            self._let_in(sock, address[:2])

    def _let_in(self, sock: socket.socket, there: tuple[str, int]) -> None:
        peer = f"{there[0]}:{there[1]}"
        if self._access is None:
            self._welcome(sock, peer)
            return
        if not self._access.admits(sock, there):
            self.turn_away(sock, peer)
            return
        check = self._access.check_token(sock, peer, self._decided)
        if check is None:
            self._welcome(sock, peer)
            return
        if len(self._checking) >= MOST_WAITING:
            oldest = next(iter(self._checking))
            oldest.cancel()
            self._decided(oldest, False)
        self._checking[check] = None
        check.look()

    def _decided(self, check: TokenCheck, good: bool) -> None:
        del self._checking[check]
        (self._welcome if good else self.turn_away)(check.sock, check.peer)
