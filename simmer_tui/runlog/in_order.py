"""Lines of a log put into the order in which commands were taken up.

A log has events in the order in which they are told: an answer when it has been given. In timed motion
a reading that takes its time, or an answer that is on the link, may be told after commands that were
taken up later; who runs the commands again needs them as they were taken up.
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

_LATE = 1.0
"""Seconds of real time by which an answer may be told late."""


class InOrder:
    """Takes lines as they stand in a log and gives them back in order, some of them later."""

    def __init__(self, configuration: Configuration) -> None:
        settings, sensors = configuration.settings, configuration.simulation.sensors
        link, motion = settings.link, settings.motion
        longest = max((sensor.read_time for sensor in sensors), default=0.0) + link.latency + link.jitter
        self._longest = longest if motion.motion == "timed" else 0.0
        """The longest that an answer takes, simulated seconds; where it is 0 all are in order."""
        self._scale = motion.time_scale
        self._held: list[tuple[float, float, int, AnyRecord]] = []
        self._begun = 0
        """The latest command told of so far."""

    def take(self, line: int, said: AnyRecord) -> Iterator[tuple[int, AnyRecord]]:
        """Take a line; gives those that no later one can come before."""
        if not self._longest:
            yield line, said
            return
        if isinstance(said, ActionRecord) and not said.refused:
            if said.action is ActionName.SPEED:
                self._scale = max(self._scale, *said.arguments)
            if said.action.restarts:
                yield from self.rest()  # nothing of the run before is told after this
                self._begun = 0
                yield line, said
                return
        heapq.heappush(self._held, (*self._place(said), line, said))
        settled = said.t - self._longest - _LATE * self._scale
        while self._held and self._held[0][0] < settled:
            yield self._held[0][2:]
            heapq.heappop(self._held)

    def rest(self) -> Iterator[tuple[int, AnyRecord]]:
        """The lines still held back."""
        while self._held:
            yield heapq.heappop(self._held)[2:]

    def _place(self, said: AnyRecord) -> tuple[float, float]:
        """When a line's command was taken up, and of lines of one moment, which comes first: they keep
        their order, and an answer that was told late goes before what has a greater number."""
        if isinstance(said, ReadingRecord | AnswerRecord | PlanRecord | MoveRecord | ActionRecord):
            self._begun = max(self._begun, said.n)
        if isinstance(said, ReadingRecord | AnswerRecord) and said.taken is not None:
            return said.taken, said.n
        if isinstance(said, ReadingRecord | AnswerRecord | PlanRecord | MoveRecord):
            return said.t, said.n
        return said.t, self._begun + 0.5
