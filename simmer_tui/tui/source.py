"""What the screen shows: a run that is going on, or one from a log. Both give the same snapshots."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Protocol

from simmer_tui.config.loader import Configuration
from simmer_tui.server import Server
from simmer_tui.snapshot import Snapshot

_CLOCK_TICK = 1.0
"""How often the clock of timed motion is shown while nothing else is new, seconds."""


class Source(Protocol):
    """Where snapshots come from."""

    @property
    def configuration(self) -> Configuration: ...

    @property
    def name(self) -> str:
        """What is shown, in a few words: the configuration, or where the run came from."""
        ...

    @property
    def ports(self) -> Mapping[str, int]:
        """Those a program may come by, by purpose; none for a run from a log."""
        ...

    @property
    def pace(self) -> str:
        """How fast simulated time goes, in a word or two; empty if there is nothing to say."""
        ...

    def has_news(self, known: int) -> bool:
        """Whether a snapshot would hold what one that was taken at event `known` did not."""
        ...

    async def snapshot(self, since: int, true_values: bool) -> Snapshot:
        """The run as it stands, with the events after number `since`."""
        ...


class LiveSource:
    """The run that a server is at."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._asked = 0.0

    @property
    def configuration(self) -> Configuration:
        return self._server.configuration

    @property
    def name(self) -> str:
        past = self._server.past
        return self.configuration.name if past is None else str(past.origin)

    @property
    def ports(self) -> Mapping[str, int]:
        return self._server.ports

    @property
    def pace(self) -> str:
        engine, pace = self._server.engine, self._server.pace
        if engine.timed:
            return f"timed {engine.time_scale:g}x"
        return f"pace {pace:g}x" if pace else "full speed"

    def has_news(self, known: int) -> bool:
        server = self._server
        if server.engine.timed and time.monotonic() - self._asked >= _CLOCK_TICK:
            return True  # simulated time goes on
        return server.recorder.number != known or server.moving

    async def snapshot(self, since: int, true_values: bool) -> Snapshot:
        self._asked = time.monotonic()
        return await self._server.snapshot(since, true_values)
