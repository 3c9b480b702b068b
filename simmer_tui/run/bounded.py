"""Collections that stay small however many items they are given."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import Generic, Protocol, TypeVar

import numpy as np

from simmer_tui.sim.angles import FloatArray


class Timed(Protocol):
    """Something with a moment of the run."""

    @property
    def elapsed(self) -> float: ...


Item = TypeVar("Item")
TimedItem = TypeVar("TimedItem", bound=Timed)

BINS = 32
"""Bins of a histogram: the sixteen characters that show it take two each."""
LEAST_WIDTH = 1e-9
LISTED = 200
"""First items of a kind that are kept besides the newest: a report lists or draws no more."""


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

    def wanted(self, count: int = 1) -> range:
        """Count so many items; those at these places among them are to be given to `keep`."""
        begin = -self.given % self.stride
        self.given += count
        return range(begin, count, self.stride)

    def keep(self, items: Iterable[Item]) -> None:
        """Keep the items that were `wanted`."""
        self.items += items
        while len(self.items) > self._limit:
            del self.items[1::2]
            self.stride *= 2


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
        """Number of items that are not kept."""
        return self.given - len(self.items)


class Newest(Generic[TimedItem]):
    """The newest `limit` items, and the `first` ones; `since` is from when on, elapsed seconds, none is
    missing."""

    def __init__(self, limit: int) -> None:
        self.first: First[TimedItem] = First(LISTED)
        self.items: deque[TimedItem] = deque()
        self.since = 0.0
        self._limit = limit

    def add(self, item: TimedItem) -> None:
        self.first.add(item)
        self.items.append(item)
        if len(self.items) > self._limit:
            self.items.popleft()
            self.since = max(self.since, self.items[0].elapsed)

    @property
    def dropped(self) -> int:
        """Number of items that have given way to newer ones."""
        return self.first.given - len(self.items)


class Errors:
    """Mean, standard deviation and histogram of numbers, none of them kept.

    Mean and standard deviation are merged as Chan, Golub and LeVeque (1979) do. The histogram's `BINS` bins
    lie around 0; their width doubles whenever a number falls outside.
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

    def add(self, values: FloatArray) -> None:
        """Add finite numbers, (n,)."""
        if not len(values):
            return
        count, mean = len(values), float(values.mean())
        difference, total = mean - self.mean, self.count + count
        self._squares += float(np.square(values - mean).sum()) + difference**2 * self.count * count / total
        self.mean += difference * count / total
        self.count = total
        worst = float(values[np.abs(values).argmax()])
        if abs(worst) > abs(self.worst):
            self.worst = worst
        if not self.width and worst:
            first = float(np.abs(values[values.nonzero()[0][0]]))
            self.width = max(first / 4, LEAST_WIDTH)
        while abs(worst) >= self.reach and worst:
            self._widen()
        places = np.floor(values / self.width).astype(np.int64) if self.width else np.zeros(count, np.int64)
        fresh = np.bincount(places + BINS // 2, minlength=BINS).tolist()
        self.bins = [old + new for old, new in zip(self.bins, fresh, strict=True)]

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
