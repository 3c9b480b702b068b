"""Accepting connections on a port, all that wait at once, before anything else happens."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable

from simmer_tui.links.ports import BACKLOG, Listener

ACCEPT_PAUSE = 1.0
"""Seconds before connections are accepted again after the system ran out of room for them."""


class Acceptor:
    """Passes each connection that comes to a port to `welcome(socket, peer)`.

    An own accept loop instead of asyncio's server, because a link may need to know of a
    connection before the next byte of another is looked at (`accept_waiting`).
    """

    def __init__(self, listener: Listener, welcome: Callable[[socket.socket, str], None]) -> None:
        """Begin to listen. Needs a running event loop."""
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._welcome = welcome
        self._tasks: set[asyncio.Task[object]] = set()
        for sock in listener.sockets:
            self._listen(sock)

    def accept_waiting(self) -> None:
        """Accept everything that waits now."""
        for sock in self._listener.sockets:
            self._accept(sock)

    def set_up(self, sock: socket.socket, protocol: asyncio.BaseProtocol) -> None:
        """Give an accepted socket its transport."""
        made = self._loop.connect_accepted_socket(lambda: protocol, sock)
        task: asyncio.Task[object] = self._loop.create_task(made)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def close(self) -> None:
        """Give the port back."""
        self.pause()
        self._listener.close()

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

    def _accept(self, listening: socket.socket) -> None:
        for _ in range(BACKLOG + 1):  # all that can wait now; a flood must leave others their turn
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
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            self._welcome(sock, f"{address[0]}:{address[1]}")
