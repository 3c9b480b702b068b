"""An event loop whose time passes only when a test says so."""

from __future__ import annotations

import asyncio
import selectors


class _Jump(selectors.SelectSelector):
    now = 50.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        self.now += timeout or 0.0
        return super().select(0)


class Clock(asyncio.SelectorEventLoop):
    """An event loop whose time passes only when `pass_by` says so."""

    def __init__(self) -> None:
        self.selector = _Jump()
        super().__init__(self.selector)

    def time(self) -> float:
        return self.selector.now

    def pass_by(self, seconds: float) -> None:
        self.run_until_complete(asyncio.sleep(seconds))
