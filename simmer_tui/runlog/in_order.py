"""The records of a log in the order in which commands were taken up.

A log has events in the order in which they happened: an answer when it was given. In timed motion a
reading takes time and an answer is delayed on the link, so it may come after commands that were taken
up later. A rerun needs commands in the order in which they were taken up.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator

from simmer_tui.config.loader import Configuration
from simmer_tui.events import ActionName
from simmer_tui.runlog.log_records import (
    ActionRecord,
    AnswerRecord,
    AnyRecord,
    MoveRecord,
    PlanRecord,
    ReadingRecord,
)

# Chosen: the event loop answers within milliseconds, unless the computer is overloaded.
_LATE = 1.0
"""Longest delay of an answer by a busy computer, seconds of real time."""


class InOrder:
    """Takes records as they stand in a log and gives them back in order, some of them later."""

    def __init__(self, configuration: Configuration) -> None:
        settings, sensors = configuration.settings, configuration.simulation.sensors
        link, motion = settings.link, settings.motion
        longest = max((sensor.read_time for sensor in sensors), default=0.0) + link.latency + link.jitter
        self._longest = longest if motion.motion == "timed" else 0.0
        """Longest time of an answer, simulated seconds. If it is 0 all records are in order."""
        self._scale = motion.time_scale
        self._held: list[tuple[float, float, int, AnyRecord]] = []
        self._begun = 0
        """Number of the latest command so far."""

    def take(self, line: int, record: AnyRecord) -> Iterator[tuple[int, AnyRecord]]:
        """Take a record. Gives those that no later record can precede."""
        if not self._longest:
            yield line, record
            return
        if isinstance(record, ActionRecord) and not record.refused:
            if record.action is ActionName.SPEED:
                self._scale = max(self._scale, *record.arguments)
            if record.action.restarts:
                yield from self.rest()  # nothing of the run before comes after this
                self._begun = 0
                yield line, record
                return
        heapq.heappush(self._held, (*self._key(record), line, record))
        settled = record.t - self._longest - _LATE * self._scale
        while self._held and self._held[0][0] < settled:
            yield self._held[0][2:]
            heapq.heappop(self._held)

    def rest(self) -> Iterator[tuple[int, AnyRecord]]:
        """The records still held back."""
        while self._held:
            yield heapq.heappop(self._held)[2:]

    def _key(self, record: AnyRecord) -> tuple[float, float]:
        """The sort key of a record: when its command was taken up, then its command's number, so that a
        late answer goes before later commands of the same moment."""
        if isinstance(record, ReadingRecord | AnswerRecord | PlanRecord | MoveRecord | ActionRecord):
            self._begun = max(self._begun, record.n)
        if isinstance(record, ReadingRecord | AnswerRecord) and record.taken is not None:
            return record.taken, record.n
        if isinstance(record, ReadingRecord | AnswerRecord | PlanRecord | MoveRecord):
            return record.t, record.n
        return record.t, self._begun + 0.5
