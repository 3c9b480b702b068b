"""What takes time besides driving: the link to the robot, and what is due at a later simulated time."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable

from simmer_tui.sim import noise

LINK_STREAM = "link"
"""The name of the stream that jitter is drawn from: nothing else draws from it."""


class LinkDelay:
    """How long each message is under way, on the way there and on the way back: the latency, and on
    top a part of the jitter, every part as likely as every other. Simulated seconds."""

    def __init__(self, latency: float, jitter: float, seed: int) -> None:
        self._latency = latency
        self._jitter = jitter
        self.restart(seed)

    def restart(self, seed: int) -> None:
        """Draw as at the start of a run of this seed."""
        self._random = noise.stream(seed, LINK_STREAM)

    def way(self) -> float:
        """How long the next message takes."""
        return self._latency + (self._jitter * self._random.random() if self._jitter else 0.0)


class Agenda:
    """What is due at later simulated times, in order."""

    def __init__(self) -> None:
        self._items: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()

    @property
    def due(self) -> float:
        """When the next thing is due; infinity for nothing."""
        return self._items[0][0] if self._items else math.inf

    def add(self, time: float, call: Callable[[], None]) -> None:
        """Have something done at a simulated time."""
        heapq.heappush(self._items, (time, next(self._order), call))

    def pop(self) -> Callable[[], None]:
        """Take what is due next."""
        return heapq.heappop(self._items)[2]
