"""A board whose sketch is not trusted: what it tells on its channel must be what the runtime could tell.

A sketch shares its process with the runtime. It can write to the channel itself, or change the board's clock.
Neither may move the robot faster than its motors do, take the simulator's memory, or bring time to a stand.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from simmer_tui.errors import BoardError
from simmer_tui.sketch.board_host import BoardStart, LocalBoard
from simmer_tui.sketch.board_process import (
    NEVER,
    BoardProcess,
    BoardRecord,
    Mistake,
    Query,
    Reason,
    Told,
    Waits,
)
from simmer_tui.sketch.boards import BOARDS
from simmer_tui.sketch.parts import FINEST_DUTY, LARGEST_DUTY, SECOND
from simmer_tui.sketch.sketch_lines import SketchLines
from simmer_tui.sketch.text_display import MOST_DISPLAYS, DisplayChange

_MOST_PINS = max(each.pins for each in BOARDS.values())
_SHORTEST_BYTE = 4_000
"""Nanoseconds of a byte at 2,000,000 baud, the fastest rate, less a fifth for rounding."""
_LONGEST_QUEUE = 10 * SECOND
"""Nanoseconds by which a byte may be sent ahead: the 64 bytes of a port take 2.2 s at 300 baud."""
_LONGEST_PULSE = 3_000
"""Microseconds of a servo's pulse; Servo.h makes 2400 at most."""
_FASTEST_BAUD = 2_000_000
_SHORTEST_STEP = 400
"""Nanoseconds between two steps at a pin: it falls and rises, each in a digitalWrite, of an ESP32 whose other
core works too."""
# Every call that stops a board costs microseconds of its clock: some hundred stops are the most.
_MILLISECOND, _MOST_STOPS = 1_000_000, 10_000
"""Stops of a board's own in a millisecond of its clock."""
_SHORTEST_RANGE = 20_000_000
"""Nanoseconds of a VL53L0X's measurement with its shortest budget."""
_HIGHEST: dict[int, tuple[int, int]] = {
    Told.LEVEL: (0, 1),
    Told.DUTY: (0, LARGEST_DUTY),
    Told.FINE_DUTY: (0, FINEST_DUTY),
    Told.SERVO: (0, _LONGEST_PULSE),
    Told.BYTE: (0, 255),
    Told.BAUD: (1, _FASTEST_BAUD),
    Told.MODE: (0, 2),
    Told.BUSY: (0, SECOND // 1000),
    Told.TEXT: (0, (DisplayChange.ON << 24) + 0xFFFFFF),
}
"""The least and greatest value of a record, by its kind. Those of other kinds are addresses or counts."""
_KINDS, _REASONS, _QUERIES, _WAITS = (frozenset(map(int, each)) for each in (Told, Reason, Query, Waits))
_MISTAKES = frozenset(map(int, Mistake))
_CALLS = range(1, 5)
"""Calls in an interrupt's function."""
_MOST_MISTAKES = 800
"""Mistakes of a board: it tells 100, 100 of tasks that wait, and two of each of 255 tasks."""
_SPANS = frozenset((Told.WAITED, Told.LATE_BYTE))
"""Records that begin in the past."""


class CheckedBoard(BoardProcess):
    """A board that ends when it tells what no board can. Its program alone is at fault then."""

    def __init__(
        self,
        name: str,
        program: Path,
        options: Sequence[str],
        start: BoardStart = LocalBoard,
        lines: SketchLines | None = None,
    ) -> None:
        super().__init__(name, program, options, start, lines)
        self._sent: dict[int, int] = {}
        """Time of the last byte by the pin that sent it."""
        self._stepped: dict[int, int] = {}
        """Time of the last step by its pin."""
        self._since = self._stops = self._mistakes = 0
        self._detail: int | None = None
        """The value of the last detail of a mistake that is to come."""
        self._ranged: dict[int, int] = {}
        """Time of the last distance of each part on the bus."""

    def receive(self) -> list[BoardRecord]:
        before, place = self.now, self.place
        records = super().receive()
        now, wait = self.now, self.wait
        wrong = ""
        if not before <= now <= max(self._horizon, before):
            self.now, wrong = before, "its clock went where it may not"
        elif self.reason not in _REASONS or self.query not in _QUERIES:
            wrong = "it asked what no board asks"
        elif wait is not None and (wait.kind not in _WAITS or wait.begin > now):
            wrong = "it waits as no board does"
        else:
            wrong = next(filter(None, (self._wrong(each, before) for each in records)), "")
            wrong = wrong or self._too_soon() or self._stands()
        if wrong:
            self.wait = None
            # What was told last may be no address at all.
            line = self.line_of(self.place) or self.line_of(place)
            where = f" at {line}" if line else ""
            after = f"after {round(self.now / 1e9, 4):g} s"
            what = f"{wrong}; only the runtime may use the channel of the board, and set its clock"
            raise BoardError(f"board {self.name} was ended{where} {after}: {what}")
        return records

    def _wrong(self, record: BoardRecord, before: int) -> str:
        """The fault of a record; empty without one."""
        time, kind, pin, _, value = record
        low, high = _HIGHEST.get(kind, (-(1 << 31), NEVER))
        if kind not in _KINDS or not low <= value <= high:
            return f"it told {value} as {Told(kind).name if kind in _KINDS else kind}, which no board does"
        if kind == Told.WAITED:
            return "" if pin in _WAITS and time <= self.now else "it waited as no board does"
        if kind == Told.TASK_NAME:
            return ""
        if kind == Told.MISTAKE:
            return self._wrong_mistake(record)
        if pin >= _MOST_PINS:
            return f"it told of pin {pin}, which no board has"
        if kind == Told.BYTE:
            if not max(before, self._sent.get(pin, 0) + _SHORTEST_BYTE) <= time <= self.now + _LONGEST_QUEUE:
                return "it sent bytes faster than a line carries them"
            self._sent[pin] = time
        elif time > self.now or (time < before and kind not in _SPANS and kind != Told.UNTIL):
            return "it told what was not then"
        if kind == Told.DETAIL:
            self._detail = value
        if kind == Told.TEXT and pin >= MOST_DISPLAYS:
            return f"it told of display {pin}, which no board has"
        if kind == Told.STEP:
            if time < self._stepped.get(pin, -_SHORTEST_STEP) + _SHORTEST_STEP:
                return "it stepped faster than a pin changes"
            self._stepped[pin] = time
        return ""

    def _wrong_mistake(self, record: BoardRecord) -> str:
        """The fault of a mistake, whose details have come before it; empty without one."""
        kind, detail = record.pin, self._detail
        self._detail = None
        self._mistakes += 1
        if kind not in _MISTAKES:
            return f"it told of mistake {kind}, which no sketch makes"
        if self._mistakes > _MOST_MISTAKES:
            return "it told more mistakes than a board does"
        if record.time > self.now:
            return "it told what was not then"
        is_whole = detail is not None or kind == Mistake.WATCHDOG
        is_call = kind != Mistake.IN_INTERRUPT or detail in _CALLS
        return "" if is_whole and is_call else "it told half of a mistake"

    def _too_soon(self) -> str:
        """The fault of a distance that no part measures so soon after the last; empty without one."""
        if self.reason != Reason.QUERY or self.query != Query.RANGE:
            return ""
        if not 0 <= self.pin < _MOST_PINS:
            return "it asked what no board asks"
        last, self._ranged[self.pin] = self._ranged.get(self.pin, -_SHORTEST_RANGE), self.now
        return "" if self.now - last >= _SHORTEST_RANGE else "it measured faster than its part does"

    def _stands(self) -> str:
        """The reason why its time stands; empty while it passes."""
        if self.now - self._since >= _MILLISECOND:
            self._since, self._stops = self.now, 0
        elif self.reason != Reason.HORIZON:
            self._stops += 1
        if self._stops > _MOST_STOPS:
            return "its clock stands, however often it is asked"
        return ""
