"""An event loop whose time passes only when a test says so."""

from __future__ import annotations

import asyncio
import selectors


class _Jump(selectors.SelectSelector):
    """Instead of waiting, moves the clock on to when the wait would have ended."""

    def __init__(self, now: float) -> None:
        super().__init__()
        self.now = now

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        self.now += timeout or 0.0
        return super().select(0)


class Clock(asyncio.SelectorEventLoop):
    """An event loop whose time passes only when `pass_by` says so. It begins at `now`, seconds."""

    def __init__(self, now: float = 50.0) -> None:
        self.selector = _Jump(now)
        super().__init__(self.selector)

    def time(self) -> float:
        return self.selector.now

    def pass_by(self, seconds: float) -> None:
        self.run_until_complete(asyncio.sleep(seconds))

    def settle(self) -> None:
        """Do what is due now, and what that brings about."""
        for _ in range(5):
            self.run_until_complete(asyncio.sleep(0))
