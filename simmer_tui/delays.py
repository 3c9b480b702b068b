"""Simulated delays: the latency of the link to the robot, and calls that are due later."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable

from simmer_tui.sim import noise

# A stream of its own: noise of sensors and drives stays the same with and without a link.
LINK_STREAM = "link"
"""The name of the stream that jitter is drawn from: nothing else draws from it."""


class LinkDelay:
    """Latency of each message, each way, simulated seconds: a constant and a uniformly distributed jitter."""

    def __init__(self, latency: float, jitter: float, seed: int) -> None:
        self._latency = latency
        self._jitter = jitter
        self.restart(seed)

    def restart(self, seed: int) -> None:
        """Draw as at the start of a run of this seed."""
        self._random = noise.stream(seed, LINK_STREAM)

    def way(self) -> float:
        """Latency of the next message, simulated seconds."""
        return self._latency + (self._jitter * self._random.random() if self._jitter else 0.0)


class TimerQueue:
    """Calls that are due at later simulated times, in order."""

    def __init__(self) -> None:
        self._items: list[tuple[float, int, Callable[[], None]]] = []
        # Calls at the same time go in the order they were added; functions cannot be compared.
        self._order = itertools.count()

    @property
    def due(self) -> float:
        """Time of the next call; infinity if there is none."""
        return self._items[0][0] if self._items else math.inf

    def add(self, time: float, call: Callable[[], None]) -> None:
        """Have something done at a simulated time."""
        heapq.heappush(self._items, (time, next(self._order), call))

    def pop(self) -> Callable[[], None]:
        """Take what is due next."""
        return heapq.heappop(self._items)[2]
