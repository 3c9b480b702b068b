"""Shared by tests of links: waiting in an event loop, and a listener that remembers."""

from __future__ import annotations

import asyncio
from collections.abc import Callable


async def until(condition: Callable[[], bool]) -> None:
    """Wait for a condition, turn by turn of the event loop."""
    async with asyncio.timeout(20):
        while not condition():
            await asyncio.sleep(0.0005)


class RecordingListener:
    """A link's listener that remembers what it was told."""

    def __init__(self) -> None:
        self.told: list[str] = []
        self.bytes = bytearray()

    def opened(self) -> None:
        self.told.append("opened")

    def received(self, data: bytes) -> None:
        self.bytes += data

    def lost(self, reason: str) -> None:
        self.told.append(reason)
