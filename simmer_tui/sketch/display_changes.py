"""Changes of a board's LED, of the text on its displays and of its busy share, for the log.

A sketch may change them thousands of times a second. They are looked at every `LOOK_PERIOD` of simulated
time, and told if they are others than before.
"""

from __future__ import annotations

from collections import deque

from msgspec.structs import replace

from simmer_tui.run.events import DisplayChanged
from simmer_tui.sketch.board_process import NEVER, BoardRecord, Told
from simmer_tui.sketch.parts import SECOND
from simmer_tui.sketch.text_display import TextDisplay

# A person reads no faster. Ten rows of some 100 bytes a second are less than the readings of one sensor.
LOOK_PERIOD = SECOND // 10
"""Nanoseconds between two looks."""
_MODE, _TEXT, _BUSY = int(Told.MODE), int(Told.TEXT), int(Told.BUSY)
_PERCENT = 10_000
"""Microseconds of a percent of a second."""
_OF_LED = frozenset(map(int, (Told.LEVEL, Told.DUTY, Told.FINE_DUTY, Told.SERVO, Told.MODE)))


class DisplayChanges:
    """LED, displays and busy share of a board, by its records. Times are nanoseconds."""

    def __init__(self, board: str, led: int, led_name: str) -> None:
        """`led` is the number of the pin of its own LED, and `led_name` its name. At time 0 it shows nothing,
        which is told."""
        self._board, self._led, self._led_name = board, led, led_name
        self._records: deque[BoardRecord] = deque()
        """Records that are not shown yet: a board may be ahead of the world."""
        self._is_on = False
        self._busy: float | None = None
        self._displays: dict[int, TextDisplay] = {}
        self._look = 0
        """Time of the next look; `NEVER` if nothing has changed since the last one."""
        self._newest: DisplayChanged | None = None
        self._changes: list[tuple[int, DisplayChanged]] = []
        """Changes that are not told yet, with their times."""

    def add(self, record: BoardRecord) -> None:
        """Add a record of its board. They are in order."""
        if record.kind in (_TEXT, _BUSY) or (record.pin == self._led and record.kind in _OF_LED):
            self._records.append(record)

    @property
    def next_due(self) -> int:
        """Time of the next change that may be told."""
        if self._changes:
            return self._changes[0][0]
        if self._look == NEVER and self._records:
            return _look_after(self._records[0].time)
        return self._look

    def due(self, time: int, *, at_end: bool = False) -> list[tuple[int, DisplayChanged]]:
        """The changes up to a time, each once, with their times. At the end of a run nothing waits for a
        look."""
        self._catch_up(time)
        if self._look <= time or (at_end and self._look < NEVER):
            self._take_look(min(self._look, time))
        changes, self._changes = self._changes, []
        return changes

    def shown(self, time: int) -> DisplayChanged:
        """LED and displays at a time."""
        self._catch_up(time)
        return self._now(time)

    def restart(self, time: int) -> None:
        """The board begins again at a time."""
        self._catch_up(time)
        self._is_on, self._busy = False, None
        self._displays.clear()
        self._plan_look(time)

    def _catch_up(self, time: int) -> None:
        """Take all that has happened by a time."""
        while self._records and self._records[0].time <= time:
            record = self._records.popleft()
            self._plan_look(record.time)
            if record.kind == _TEXT:
                self._displays.setdefault(record.pin, TextDisplay()).change(record.value)
            elif record.kind == _BUSY:
                # Whole percents: each other one is a line of the log.
                waited = min(max(round(record.value / _PERCENT), 0), 100)
                self._busy = (100 - waited) / 100
            else:
                self._is_on = record.kind != _MODE and record.value > 0

    def _plan_look(self, time: int) -> None:
        """Plan a look after a time, at which something changes, and take the one before."""
        if self._look < time:
            self._take_look(self._look)
        if self._look == NEVER:
            self._look = _look_after(time)

    def _take_look(self, time: int) -> None:
        self._look = NEVER
        now, newest = self._now(time), self._newest
        if newest is None or replace(now, time=newest.time) != newest:
            self._newest = now
            self._changes.append((time, now))

    def _now(self, time: int) -> DisplayChanged:
        rows = tuple(each.rows for _, each in sorted(self._displays.items()))
        return DisplayChanged(time / SECOND, self._board, self._is_on, self._led_name, rows, self._busy)


def _look_after(time: int) -> int:
    return -(-time // LOOK_PERIOD) * LOOK_PERIOD
