"""Calls that come later: in simulated time, or in the time of an event loop."""

from __future__ import annotations

import asyncio
import heapq
import itertools
import math
from collections.abc import Callable


class TimerQueue:
    """Calls that are due at later times, in order."""

    def __init__(self) -> None:
        self._items: list[tuple[float, int, Callable[[], object]]] = []
        # The count keeps calls at the same time in the order they were added; functions cannot be compared.
        self._order = itertools.count()

    @property
    def due(self) -> float:
        """Time of the next call; infinity if there is none."""
        return self._items[0][0] if self._items else math.inf

    def __len__(self) -> int:
        return len(self._items)

    def add(self, time: float, call: Callable[[], object]) -> None:
        """Call a function at a time."""
        heapq.heappush(self._items, (time, next(self._order), call))

    def run(self, until: float) -> None:
        """Make the calls that are due by a time, and those that they add."""
        while self._items and self._items[0][0] <= until:
            heapq.heappop(self._items)[2]()


class LoopTimer:
    """A call that an event loop makes later, once; it can be set again or cancelled before."""

    def __init__(self, call: Callable[..., None], loop: asyncio.AbstractEventLoop | None = None) -> None:
        self.loop = loop
        """The loop that makes the call; known before the timer is set."""
        self._call = call
        self._handle: asyncio.TimerHandle | None = None

    @property
    def due(self) -> float:
        """Time of the call by the loop's clock; infinity if the timer is not set."""
        return math.inf if self._handle is None else self._handle.when()

    def set_at(self, time: float, *arguments: object) -> None:
        """Make the call at a time of the loop's clock."""
        assert self.loop is not None, "timed motion needs a started engine"
        if self._handle is not None:
            self._handle.cancel()
        self._handle = self.loop.call_at(time, self._make, *arguments)

    def set_in(self, seconds: float | None, *arguments: object) -> None:
        """Make the call after so many seconds; None cancels it."""
        if seconds is None:
            self.cancel()
            return
        assert self.loop is not None, "timed motion needs a started engine"
        self.set_at(self.loop.time() + seconds, *arguments)

    def cancel(self) -> None:
        """Do not make the call."""
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None

    def _make(self, *arguments: object) -> None:
        self._handle = None
        self._call(*arguments)
