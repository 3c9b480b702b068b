"""Event loops whose time passes only when a test says so."""

from __future__ import annotations

import asyncio
import math
import selectors
import time
from collections.abc import Callable

SECONDS = 120.0
"""Longest wait for anything, real seconds; nothing waits that long unless it is broken."""


class _Jump(selectors.SelectSelector):
    """Does not wait for timers: moves the clock on to the next one, at most to `until`. From there on it
    waits for sockets, in real time."""

    def __init__(self, now: float, until: float) -> None:
        super().__init__()
        self.now, self.until = now, until

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0)
        if ready or timeout == 0:
            return ready
        if self.now < self.until:
            self.now = min(self.until, self.now + (timeout or 0.0))
            return []
        ready = super().select(SECONDS)
        assert ready, "nothing happens any more"
        return ready


class _Loop(asyncio.SelectorEventLoop):
    """An event loop whose clock begins at `now`, seconds, and moves by itself at most to `until`."""

    def __init__(self, now: float, until: float) -> None:
        self.selector = _Jump(now, until)
        super().__init__(self.selector)

    def time(self) -> float:
        return self.selector.now


class Clock(_Loop):
    """A loop that a test runs for as long as `pass_by` says. It begins at `now`, seconds."""

    def __init__(self, now: float = 50.0) -> None:
        super().__init__(now, math.inf)

    def pass_by(self, seconds: float) -> None:
        self.run_until_complete(asyncio.sleep(seconds))

    def settle(self) -> None:
        """Do what is due now, and what that brings about."""
        for _ in range(5):
            self.run_until_complete(asyncio.sleep(0))


class StandingClock(_Loop):
    """A loop for tests that run in it, with real sockets: time stands still except in `pass_by`."""

    def __init__(self) -> None:
        super().__init__(0.0, 0.0)

    async def pass_by(self, seconds: float) -> None:
        """Let time pass."""
        self.selector.until = self.selector.now + seconds
        await asyncio.sleep(seconds)

    async def until(self, condition: Callable[[], object]) -> None:
        """Wait for a condition while time stands still."""
        deadline = time.monotonic() + SECONDS
        while not condition():
            assert time.monotonic() < deadline, "it never came true"
            await asyncio.sleep(0)
