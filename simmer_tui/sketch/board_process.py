"""A board as a process: the compiled sketch at the other end of two pipes (`arduino/board/exchange.h`)."""

from __future__ import annotations

import os
import re
import signal
import struct
import sys
import threading
import time
from collections.abc import Sequence
from enum import IntEnum
from itertools import repeat
from pathlib import Path
from typing import NamedTuple

from simmer_tui import platform_has
from simmer_tui.errors import BoardError, SimmerError, reason_of
from simmer_tui.sketch.board_host import BoardHost, BoardStart, LocalBoard
from simmer_tui.sketch.sketch_lines import SketchLines

_REQUEST = struct.Struct("<QBBHiIIQII")
_GRANT = struct.Struct("<QdII")
_RECORD = struct.Struct("<QBBHi")
# A request with as many records as a board keeps is half of it.
_LARGEST_READ = 65536
# A slice takes milliseconds. A board that says nothing for this long is in a loop that no clock sees.
SILENT = 5.0
"""Real seconds of silence after which a board is ended."""
_NAME_PARTS = 4
"""Records of a task's name, each of four characters."""
_LOOKS = 10
"""Looks at a board in this time. They do not happen while the simulator itself is suspended."""
_CAUSES: dict[int, str] = {
    0: "its sketch called exit()",
    signal.SIGSEGV: "it used memory that is not its own, or its stack is full",
    signal.SIGFPE: "it divided by zero",
    signal.SIGABRT: "it gave up",
    200: "the function of a task returned; end it with vTaskDelete(NULL)",
    201: "its sketch called ESP.restart(), which no simulated board does",
    202: "it used a queue, semaphore, timer or event group that is not there (NULL): create it first",
    203: "it gave back a mutex that {task} holds; only the task that took it may give it back",
    204: "its period has 0 ticks, and FreeRTOS asserts that it has one at least",
    205: "it called a function at address 0, which starts an AVR again, and no simulated board",
    206: "it set the mode of a timer, and registers are not simulated; only its rate may be set",
}
"""Causes of a board's death by its signal; 0 is none. `{task}` is another one that had a part in it."""
if sys.platform != "win32" and platform_has.POSIX:
    _CAUSES[signal.SIGBUS] = _CAUSES[signal.SIGSEGV]  # bad memory on macOS
NEVER = 1 << 62
"""A time that no board reaches."""
STOP_WHEN_SENT = 0x100
"""Flag of a grant: the first byte sent at the pin in the low byte ends the slice when it has arrived."""
ANSWER_HOLDS = 0x200
"""Flag of a grant: the answers since the last one without it stay the same until its horizon, as long as the
board changes no output."""


class BoardSilence:
    """The silence of a board by looks at the time since when it has been silent, 0 while it is not."""

    def __init__(self) -> None:
        self._since = 0.0
        self._looks = 0

    def is_too_long(self, since: float, now: float) -> bool:
        """True at the look at which it has lasted too long, in real time and in looks."""
        if since != self._since:
            self._since, self._looks = since, 0
            return False
        self._looks += 1
        return since > 0.0 and self._looks >= _LOOKS and now - since > SILENT


class Reason(IntEnum):
    """Reasons for which a board has stopped."""

    HORIZON = 0
    OUTPUT = 1
    QUERY = 2
    FULL = 3


class Query(IntEnum):
    """Questions of a board about the world."""

    NONE = 0
    SONAR = 1
    ANALOG = 2
    DIGITAL = 3
    RANGE = 4
    ANGLE = 5
    RATE = 6


class Told(IntEnum):
    """Kinds of a board's records."""

    LEVEL = 1
    DUTY = 2
    SERVO = 3
    BYTE = 4
    LOST_EDGE = 5
    LOST_BYTE = 6
    BAUD = 7
    MODE = 8
    WAITED = 9
    LATE_BYTE = 10
    UNTIL = 11
    EDGES = 12
    STEP = 13
    TEXT = 14
    FIFO_OVERFLOW = 15
    BUS_STUCK = 16
    TASK_NAME = 17
    FINE_DUTY = 18
    MISTAKE = 19
    DETAIL = 20
    BUSY = 21


class Mistake(IntEnum):
    """Mistakes of a sketch that a board does not show by itself (`arduino/board/mistakes.h`)."""

    NO_WAIT = 1
    NO_PERIOD = 2
    INPUT_PIN = 3
    NO_PULL_UP = 4
    FLASH_PIN = 5
    IN_INTERRUPT = 6
    STARVED = 7
    WATCHDOG = 8
    CIRCLE = 9
    ALL_WAIT = 10
    LOST_ALARM = 11
    SOME_WAIT = 12
    NOT_FED = 13


class Waits(IntEnum):
    """Calls in which a sketch waits."""

    NOT = 0
    DELAY = 1
    PULSE = 2
    READ = 3
    STEPS = 4
    TASK = 5
    SLEEP = 6


class BoardWait(NamedTuple):
    """A wait of a sketch: the call, the address of its block, its times in nanoseconds, and the number of
    its task."""

    kind: int
    place: int
    begin: int
    end: int
    task: int = 0


EDGE, BYTE = 1, 2
"""Kinds of events for a board."""


class BoardRecord(NamedTuple):
    """A record of a board: its time in nanoseconds, its kind, its pin, the number of the task that it is of
    (0 is loop()), and a value."""

    time: int
    kind: int
    pin: int
    task: int
    value: int


class BoardEvent(NamedTuple):
    """An event for a board, at a time in nanoseconds: the edge of a pin, or a byte that has arrived."""

    time: int
    kind: int
    pin: int
    value: int


class BoardProcess:
    """One board's process. It is stopped whenever it has told something, until the next grant.

    Attributes:
        now: the board's clock, nanoseconds.
        reason, query, pin: why it has stopped, and its question.
        place: the address of the basic block of its sketch.
        wait: the call in which it waits, if it does; its end is not known.
        task: the number of the task that runs; 0 is loop().
    """

    def __init__(
        self,
        name: str,
        program: Path,
        options: Sequence[str],
        start: BoardStart = LocalBoard,
        lines: SketchLines | None = None,
    ) -> None:
        """Start the board. A failure is told when it is received from."""
        self.name = name
        self.now = 0
        self.reason = self.query = self.pin = self.place = self.task = 0
        self._task_names: dict[int, list[bytes]] = {}
        self.wait: BoardWait | None = None
        self.line_of = (lines or SketchLines(program)).line_of
        self._horizon = 0
        self._waits_since = 0.0
        self._silence = BoardSilence()
        self._is_hung = False
        self.exchanges = 0
        self._host: BoardHost | None = None
        self._not_started = ""
        try:
            self._host = start(program, options)
        except (OSError, SimmerError) as error:
            self._not_started = f"board {name} could not be started: {reason_of(error)}"

    @property
    def pids(self) -> tuple[int, ...]:
        """The numbers of its processes."""
        return () if self._host is None else self._host.pids

    def receive(self) -> list[BoardRecord]:
        """Wait until the board stops again. Returns its records. Raises BoardError if it was not started, has
        died or hangs."""
        self._waits_since = time.monotonic()
        # The board sends one request with its records, mostly in one piece, and waits for a grant.
        data = self._read_more(b"", _REQUEST.size)
        self.now, self.reason, self.query, count, *rest = _REQUEST.unpack_from(data)
        self.pin, self.place, place, begin, waits, self.task = rest
        kind, task = waits & 0xFF, waits >> 8
        self.wait = BoardWait(kind, place, begin, NEVER, task) if kind else None
        self.exchanges += 1
        records: list[BoardRecord] = []
        if count:
            size = _REQUEST.size + count * _RECORD.size
            # A board that dies sends its last words behind a request that has no answer yet.
            told = self._read_more(data, size)[_REQUEST.size : size]
            # As BoardRecord._make does it, in a third of the time.
            records = list(map(tuple.__new__, repeat(BoardRecord), _RECORD.iter_unpack(told)))
        self._waits_since = 0.0
        return records

    def _read_more(self, data: bytes, size: int) -> bytes:
        """The data with what follows, of this size at least."""
        host = self._host
        if host is None:
            raise BoardError(self._not_started)
        while len(data) < size:
            more = os.read(host.output, _LARGEST_READ)
            if not more:
                raise BoardError(self._end(host))
            data += more
        return data

    def name_task(self, record: BoardRecord) -> None:
        """Take a part of a task's name."""
        parts = self._task_names.setdefault(record.pin, [])
        if len(parts) == _NAME_PARTS:  # another task has the number now
            parts.clear()
        parts.append(struct.pack("<i", record.value))

    def task_name(self, number: int) -> str:
        """The name of a task, printable; empty for loop()."""
        name = b"".join(self._task_names.get(number, ())).partition(b"\0")[0]
        return "".join(chr(each) if 32 <= each < 127 else "?" for each in name)

    def grant(self, horizon: int, events: Sequence[BoardEvent], answer: float, flags: int) -> None:
        """Let the board continue to a horizon, nanoseconds. The events replace those of the last grant."""
        host = self._host
        assert host is not None, "a board that was not started has asked for nothing"
        self._horizon = horizon
        data = _GRANT.pack(horizon, answer, len(events), flags)
        if events:
            pack = _RECORD.pack
            data += b"".join([pack(time, kind, pin, 0, value) for time, kind, pin, value in events])
        # A board that reads no grants fills the pipe: that is a silence too.
        self._waits_since = time.monotonic()
        try:
            while data:
                data = data[os.write(host.input, data) :]
        except OSError:
            pass  # it has died, which the next read tells

    def look(self, now: float) -> None:
        """End the board if it has been silent for too long; any thread may call it."""
        since = self._waits_since
        if self._host is None or not self._silence.is_too_long(since, now):
            return
        if self._is_hung:  # a sketch may have a handler of its own
            self._host.kill()
        else:
            self._is_hung = True
            self._waits_since = now
            self._host.interrupt()

    def close(self) -> None:
        """End the process."""
        if self._host is not None:
            self._host.close()

    def _end(self, host: BoardHost) -> str:
        """The sentence about the end of the process."""
        told, ended = host.end()
        # Values of the sketch are made before the first exchange. A sandbox ends by a signal too what is too
        # large to begin.
        by_signal = ended.startswith("exit code -")
        if not self.exchanges and not told and not self._is_hung and not by_signal:
            return f"board {self.name} could not be started: {ended}"
        died = re.search(r"simmer-board died (\d{1,3}) (\d{1,10}) (\d{1,10}) (\d{1,10}) (-1|\d{1,3})\n", told)
        # Where it died may be a function of C; the last block is the sketch's own.
        places = (int(died[2]) + 1, int(died[3])) if died else (self.place,)
        at = next((line for line in map(self.line_of, places) if line), "")
        if died:
            # Up to its last grant: a board cannot have gone farther.
            self.now = max(self.now, min(int(died[4]) * 1000, self._horizon))
        where = f" at {at}" if at else ""
        name = self.task_name(self.task)
        where += f" in task {name}" if name else ""
        clock = f"after {round(self.now / 1e9, 4):.10g} s"
        if self._is_hung:
            return (
                f"board {self.name} hangs{where} {clock}: it has done nothing for {SILENT:g} s of real time"
            )
        if died:
            holder = self.task_name(int(died[5]))
            by = f"task {holder}" if holder else "loop()"
            ended = _CAUSES.get(int(died[1]), f"signal {died[1]}").format(task=by)
        return f"board {self.name} died{where} {clock}: {ended}"


class Watchdog:
    """A thread that ends boards which are silent for too long."""

    def __init__(self, boards: Sequence[BoardProcess]) -> None:
        self._boards = list(boards)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="boards", daemon=True)
        self._thread.start()

    def replace(self, board: BoardProcess, by: BoardProcess) -> None:
        """Look at another process in the place of one."""
        self._boards[self._boards.index(board)] = by

    def close(self) -> None:
        """End the thread."""
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._over.wait(SILENT / _LOOKS):
            now = time.monotonic()
            for each in tuple(self._boards):
                each.look(now)
