"""Events for those who need not have each at once: they get them together.

Readings that follow each other are done in one pass then. With the app open a reading takes 4 us of the
robot's thread for all of them, in place of 9 (measured).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Protocol

from simmer_tui.run.events import (
    ActionDone,
    CommandResult,
    Event,
    MissionEvent,
    Notice,
    ProgramEnded,
)

TOGETHER = 64
"""Most events that wait. Those of movements are 0.8 ms of work, by which a reply may be late. A process that
is killed loses them, unless a picture was made since they came."""
_AT_ONCE = frozenset((ActionDone, Notice, MissionEvent, ProgramEnded))
"""Rare events that do not wait, nor do those before them: they begin and end a run."""


class EventReader(Protocol):
    """A receiver of late events; a `Reducer` is one. `lines` are 0, real times those of `time.monotonic`."""

    def apply(self, event: Event, line: int, real_time: float) -> None:
        """Take one event."""

    def apply_readings(
        self, results: Sequence[CommandResult], lines: Sequence[int], real_times: Sequence[float]
    ) -> None:
        """Take readings that follow each other."""


class LateEvents:
    """A watcher that keeps events until there are some, one is rare, or somebody asks. Only for the robot's
    thread."""

    def __init__(self, fault: Callable[[str], None]) -> None:
        """`fault` is called with a sentence about a reader that failed."""
        self.together = TOGETHER
        """Events that are passed on without being asked for."""
        self.readers: list[EventReader] = []
        """Those who get the events, each all of them in order."""
        self._waiting: list[tuple[Event, float]] = []
        self._passes = False
        self._fault = fault

    def __len__(self) -> int:
        """Number of events that wait. Any thread may ask."""
        return len(self._waiting)

    def watch(self, event: Event) -> None:
        """Take an event."""
        self._waiting.append((event, time.monotonic()))
        if len(self._waiting) >= self.together or type(event) in _AT_ONCE:
            self.pass_on()

    def pass_on(self) -> None:
        """Pass on the events that wait, and those that a reader tells meanwhile."""
        if self._passes:
            return
        self._passes = True
        while self._waiting:
            waiting, self._waiting = self._waiting, []
            for reader in tuple(self.readers):
                try:
                    _pass(waiting, reader)
                except Exception as error:  # noqa: BLE001 - whatever a reader does, the robot must continue
                    self.readers.remove(reader)
                    self._fault(f"a watcher failed and was dropped: {type(error).__name__}: {error}")
        self._passes = False


def _pass(waiting: Sequence[tuple[Event, float]], reader: EventReader) -> None:
    """Pass events to one reader."""
    results: list[CommandResult] = []
    real_times: list[float] = []
    for event, real_time in waiting:
        if type(event) is CommandResult and event.reading is not None:
            results.append(event)
            real_times.append(real_time)
            continue
        if results:
            reader.apply_readings(results, (0,) * len(results), real_times)
            results, real_times = [], []
        reader.apply(event, 0, real_time)
    if results:
        reader.apply_readings(results, (0,) * len(results), real_times)
