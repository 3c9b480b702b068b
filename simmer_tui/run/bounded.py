"""Collections that stay small however many items they are given."""

from __future__ import annotations

import math
from collections import deque
from typing import Generic, Protocol, TypeVar


class Timed(Protocol):
    """What happened at a moment of the run."""

    @property
    def elapsed(self) -> float: ...


Item = TypeVar("Item")
TimedItem = TypeVar("TimedItem", bound=Timed)

BINS = 32
LEAST_WIDTH = 1e-9


class Thinned(Generic[Item]):
    """Up to `limit` items, evenly spread over all that were given.

    When full, every second one goes, and from then on only every second, fourth... is taken.
    """

    def __init__(self, limit: int) -> None:
        self.items: list[Item] = []
        self.stride = 1
        """One in so many is kept."""
        self.given = 0
        self._limit = limit

    def add(self, item: Item) -> None:
        """Take in an item; where making one is dear, `count` tells whether there is need to."""
        if self.count():
            self.keep(item)

    def count(self) -> bool:
        """Count an item; tells whether it is one of those to `keep`."""
        order = self.given
        self.given = order + 1
        return order % self.stride == 0

    def keep(self, item: Item) -> None:
        """Keep the item counted last."""
        if len(self.items) >= self._limit:
            del self.items[1::2]
            self.stride *= 2
        if (self.given - 1) % self.stride == 0:
            self.items.append(item)


class First(Generic[Item]):
    """The first `limit` items, and how many there were."""

    def __init__(self, limit: int) -> None:
        self.items: list[Item] = []
        self.given = 0
        self._limit = limit

    def add(self, item: Item) -> None:
        self.given += 1
        if len(self.items) < self._limit:
            self.items.append(item)

    @property
    def more(self) -> int:
        """How many are not kept."""
        return self.given - len(self.items)


class Newest(Generic[TimedItem]):
    """The newest `limit` items; `since` is from when on, elapsed seconds, none is missing."""

    def __init__(self, limit: int) -> None:
        self.items: deque[TimedItem] = deque()
        self.since = 0.0
        self.dropped = 0
        self._limit = limit

    def add(self, item: TimedItem) -> None:
        self.items.append(item)
        if len(self.items) > self._limit:
            self.items.popleft()
            self.dropped += 1
            oldest = self.items[0].elapsed
            if oldest > self.since:
                self.since = oldest


class Errors:
    """Mean, standard deviation and histogram of numbers, none of them kept.

    Mean and standard deviation by Welford's method. The histogram's `BINS` bins lie around 0; their width
    doubles whenever a number falls outside.
    """

    def __init__(self) -> None:
        self.count = 0
        self.mean = 0.0
        self.worst = 0.0
        """The number farthest from 0."""
        self.bins = [0] * BINS
        self.width = 0.0
        """Width of a bin, 0 as long as all numbers were."""
        self._squares = 0.0

    def add(self, value: float) -> None:
        self.count += 1
        difference = value - self.mean
        self.mean += difference / self.count
        self._squares += difference * (value - self.mean)
        size = abs(value)
        if not size:
            self.bins[BINS // 2] += 1
            return
        if size > abs(self.worst):
            self.worst = value
        if not self.width:
            self.width = max(size / 4, LEAST_WIDTH)
        while size >= self.reach:
            self._widen()
        self.bins[BINS // 2 + math.floor(value / self.width)] += 1

    @property
    def std(self) -> float:
        """The standard deviation; NaN of fewer than two numbers."""
        return math.sqrt(self._squares / (self.count - 1)) if self.count > 1 else math.nan

    @property
    def reach(self) -> float:
        """The histogram goes from minus this to plus this."""
        return self.width * BINS / 2

    def _widen(self) -> None:
        self.width *= 2
        bins, self.bins = self.bins, [0] * BINS
        for place, count in enumerate(bins):
            self.bins[(place - BINS // 2) // 2 + BINS // 2] += count
