"""Tracks which clients are present when each message has its own connection: a long silence means gone."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from simmer_tui.engine import Engine
from simmer_tui.events import Notice, NoticeKind


@dataclass(slots=True)
class _Client:
    """State of an address: time of its last message, and count of its requests."""

    last: float
    timer: asyncio.TimerHandle
    requests: int = 0


class Presence:
    """Tells watchers when a client's first request has come, and when no more have for `idle` seconds."""

    def __init__(
        self,
        engine: Engine,
        idle: float,
        is_connected: Callable[[str], bool],
        on_left: Callable[[str], None],
    ) -> None:
        """`is_connected` says of a silent address that it is there all the same; `on_left` is given
        the address of one that has left."""
        self._engine = engine
        self._idle = idle
        self._is_connected = is_connected
        self._on_left = on_left
        self._loop = asyncio.get_running_loop()
        self._clients: dict[str, _Client] = {}

    def seen(self, address: str, *, request: bool = False) -> None:
        """Something has come from an address; only a request makes it a client."""
        client = self._clients.get(address)
        if client is not None:
            client.last = self._loop.time()
        elif request:
            timer = self._loop.call_later(self._idle, self._look_for, address)
            client = self._clients[address] = _Client(self._loop.time(), timer)
            self._engine.tell(Notice(NoticeKind.CONNECTED, f"client {address} talks packets", address))
        else:
            return
        client.requests += request

    def close(self) -> None:
        """Stop tracking clients."""
        for client in self._clients.values():
            client.timer.cancel()
        self._clients.clear()

    def _look_for(self, address: str) -> None:
        client = self._clients[address]
        if self._is_connected(address):
            client.last = self._loop.time()
        left = client.last + self._idle - self._loop.time()
        if left > 0:
            client.timer = self._loop.call_later(left, self._look_for, address)
            return
        del self._clients[address]
        text = f"client {address} left after {client.requests} requests: silent for {self._idle:g} s"
        self._engine.tell(Notice(NoticeKind.LEFT, text, address))
        self._on_left(address)
