"""A clock that tests set, in place of an event loop's."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any


@dataclass
class _Call:
    """A call that the loop has yet to make."""

    time: float
    function: Callable[..., object]
    arguments: tuple[Any, ...]
    cancelled: bool = False

    def when(self) -> float:
        return self.time

    def cancel(self) -> None:
        self.cancelled = True


@dataclass
class ManualLoop:
    """As much of an event loop as the engine uses; time stands still but for `run_until`."""

    now: float = 100.0
    _calls: list[tuple[float, int, _Call]] = field(default_factory=list)
    _order: itertools.count[int] = field(default_factory=itertools.count)

    def time(self) -> float:
        return self.now

    def call_at(self, when: float, function: Callable[..., object], *arguments: Any) -> _Call:
        call = _Call(when, function, arguments)
        heapq.heappush(self._calls, (when, next(self._order), call))
        return call

    def call_later(self, delay: float, function: Callable[..., object], *arguments: Any) -> _Call:
        return self.call_at(self.now + delay, function, *arguments)

    def call_soon(self, function: Callable[..., object], *arguments: Any) -> _Call:
        return self.call_at(self.now, function, *arguments)

    def run_until(self, time: float, late: float = 0.0) -> None:
        """Let time pass; what is due is called up to `late` seconds after its time."""
        while self._calls and self._calls[0][0] <= time:
            when, _, call = heapq.heappop(self._calls)
            self.now = max(self.now, when + late)
            if not call.cancelled:
                call.function(*call.arguments)
        self.now = max(self.now, time)
