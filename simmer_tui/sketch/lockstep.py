"""Boards in lockstep: each runs up to its horizon, the earliest time at which anything could reach it.

The board with the smallest clock runs next. What a board does to the world is done when its clock is the
smallest, so that all of it happens in order. How long slices are changes nothing.
"""

from __future__ import annotations

import time as real
from bisect import bisect_left, insort
from collections import deque
from collections.abc import Iterable, Mapping, Sequence

from msgspec import Struct, field

from simmer_tui.sketch.board_process import (
    ANSWER_HOLDS,
    BYTE,
    NEVER,
    STOP_WHEN_SENT,
    BoardEvent,
    BoardProcess,
    BoardRecord,
    BoardWait,
    Query,
    Reason,
    Told,
)
from simmer_tui.sketch.parts import FINEST_DUTY, LARGEST_DUTY, PULSE_PERIOD, SECOND, EncoderState
from simmer_tui.sketch.shared_processor import SharedProcessor
from simmer_tui.sketch.steppers import StepperState

BOARD_SLICE = 20_000_000
"""Nanoseconds that a board runs at most at a time, so that a person's stop is not late."""
# Boards with motors and encoders each wait for the other; then they go on in steps of this length.
_SHORT_SLICE = 10_000
_BITS, _USUAL_BAUD = 10, 9600
# The world is a slice behind a board at most, and a wait that is told lasts as long.
_KEPT_WAITS = 8
# A call must return to the event loop soon, for stops and Ctrl-C.
REAL_SLICE = 0.02
"""Real seconds after which `run` returns early."""


# Names of an enumeration take longer to read than its values, thousands of times a second.
_QUERY = int(Reason.QUERY)
HELD_QUERIES = frozenset(map(int, (Query.RATE, Query.DIGITAL)))
"""Questions whose answers a board keeps as long as they hold."""
_BYTE = int(Told.BYTE)
_SHOWN = frozenset(map(int, (Told.TEXT, Told.BUSY)))
_LEVEL, _DUTY, _FINE_DUTY, _SERVO, _STEP = map(
    int, (Told.LEVEL, Told.DUTY, Told.FINE_DUTY, Told.SERVO, Told.STEP)
)
_OF_PINS = frozenset((_LEVEL, _DUTY, _FINE_DUTY, _SERVO, _STEP, int(Told.MODE)))
_OF_THE_BUS = frozenset(map(int, (Told.FIFO_OVERFLOW, Told.BUS_STUCK)))
_FIRST_OF_TWO = frozenset(map(int, (Told.WAITED, Told.LATE_BYTE, Told.LOST_EDGE)))
"""Records of facts that go on in the next record."""


class PinState(Struct):
    """A pin as its board sets it: its mode, and the share of time that it is high."""

    mode: int = 0
    level: float = 0.0
    servo: int = 0
    """Microseconds of a servo's pulse; 0 without a servo."""
    steps: int = 0
    """Steps of a stepper so far."""


class Board(Struct, eq=False):
    """A board that runs.

    Attributes:
        byte: the shortest time of a byte that it may send, nanoseconds.
        lines: the pins that its bytes go to, by the pin that sends.
        sources: the boards whose bytes reach it.
        encoders: encoders at its pins.
        driving: its pins that drive motors or a servo.
        led: the pin of its own LED.
        steppers: steppers by the pins of theirs.
        events: what will reach it, by time: bytes, and echoes.
        pins: its pins that the sketch has used.
        baud: rates of its ports, by pin.
        records: what it has done, and what has not been done to the world yet.
        granted: its last horizon.
        answer: the answer to its question.
        holds: the time until which its answers stay the same; 0 if it is not known.
        forgets: true if something has changed for which no answer holds any more.
        is_alone: true if nothing but its own outputs drives the robot, and no stepper does.
    """

    name: str
    process: BoardProcess
    byte: int
    lines: dict[int, list[tuple[Board, int]]] = field(default_factory=dict)
    sources: list[Board] = field(default_factory=list)
    encoders: list[EncoderState] = field(default_factory=list)
    driving: frozenset[int] = frozenset()
    led: int = -1
    steppers: Mapping[int, Sequence[StepperState]] = {}
    events: list[BoardEvent] = field(default_factory=list)
    pins: dict[int, PinState] = field(default_factory=dict)
    baud: dict[int, int] = field(default_factory=dict)
    records: list[BoardRecord] = field(default_factory=list)
    waited: deque[BoardWait] = field(default_factory=lambda: deque(maxlen=_KEPT_WAITS))
    """Its last long waits in delay() and the like, that are over."""
    granted: int = 0
    answer: float = 0.0
    holds: int = 0
    forgets: bool = False
    is_alone: bool = False
    waits: bool = False
    """True while it has stopped, and what it did has not been done to the world yet."""

    @property
    def now(self) -> int:
        """Its clock, nanoseconds."""
        return self.process.now

    def level(self, number: int) -> float:
        """The share of time that a pin is high."""
        state = self.pins.get(number)
        return 0.0 if state is None else state.level

    def line_of(self, record: BoardRecord) -> str:
        """The line of the block whose address a record has."""
        return self.process.line_of(record.value & 0xFFFFFFFF)

    def wait_at(self, time: int) -> BoardWait | None:
        """The call in which it waited at a time that it has reached; None if it did not, or not for long."""
        waits = self.waited if self.process.wait is None else (*self.waited, self.process.wait)
        return next((each for each in waits if each.begin <= time < each.end), None)

    def pin(self, number: int) -> PinState:
        """The state of a pin."""
        state = self.pins.get(number)
        if state is None:
            state = self.pins[number] = PinState()
        return state


class LockstepWorld:
    """The world that boards act on (see `sketch_robot.py`).

    It learns facts about a board as soon as they are known: it may not have reached their times yet.
    """

    def advance(self, time: int) -> None:
        """Let the world go on to a time."""

    def settle(self) -> None:
        """The boards pause: the world is looked at."""

    @property
    def next_wheel_change(self) -> int:
        """Time of the next change of the wheels' speed."""
        return NEVER

    def changed(self, board: Board, pins: Iterable[int]) -> None:
        """Pins of a board have changed."""

    def answer(self, board: Board, query: int, pin: int) -> float:
        """The answer to a board's question; echoes are put into its events."""
        return 0.0

    @property
    def steady_until(self) -> int:
        """Time until which the answer of `HELD_QUERIES` stays the same, if no motor changes; 0 if unknown."""
        return 0

    def sent(self, time: int, value: int, byte: int) -> None:
        """A byte arrives at the laptop at a time; `byte` is its duration."""

    def printed(self, board: Board, pin: int, time: int, value: int, byte: int) -> None:
        """A byte leaves a port that is not the laptop's; `byte` is its duration."""

    def shows(self, board: Board, record: BoardRecord) -> None:
        """A board may show something else."""

    def lost(self, board: Board, record: BoardRecord) -> None:
        """A board has lost a byte."""

    def bus_told(self, board: Board, record: BoardRecord) -> None:
        """A board has a full FIFO at its I2C bus, or uses the bus while interrupts are off."""

    def mistake(self, board: Board, record: BoardRecord, details: Sequence[BoardRecord]) -> None:
        """A sketch has made a mistake that its board does not show by itself."""

    def lost_edge(self, board: Board, record: BoardRecord, edges: int) -> None:
        """A board has lost one of so many edges that a pin has had."""

    def was_late(self, board: Board, record: BoardRecord, until: int) -> None:
        """A board has read a byte long after it had arrived, at `until`."""


class Lockstep:
    """Runs boards against one world."""

    def __init__(
        self,
        boards: Sequence[Board],
        world: LockstepWorld,
        laptop: tuple[Board, int] | None,
        slice_length: int,
        processor: SharedProcessor,
    ) -> None:
        """`laptop` is the board, and its pin, whose bytes go to the laptop's program. `processor` keeps the
        calling thread: release it in the end."""
        self.boards = tuple(boards)
        self._world = world
        self._laptop = laptop
        self._slice = slice_length
        self.sent: list[tuple[int, int]] = []
        """Bytes for the laptop: when they have arrived there, nanoseconds, and their value."""
        self.laptop_listens = False
        """True if `run` returns before the first byte for the laptop arrives."""
        self._drivers = tuple(each for each in self.boards if each.driving or each.steppers)
        for each in self.boards:
            each.is_alone = not each.steppers and all(driver is each for driver in self._drivers)
        self._has_begun = False
        self._processor = processor

    @property
    def reached(self) -> int:
        """The time that all boards have reached."""
        return min(each.process.now for each in self.boards)

    def run(self, until: int, most_real: float = REAL_SLICE) -> int:
        """Let the boards run to a time, nanoseconds. Returns the time that all have reached: it is earlier if
        a byte arrives at the laptop, or if that takes too long. Raises BoardError."""
        for each in self.boards:
            each.forgets = True  # others may have moved the robot meanwhile
        with self._processor.turns(tuple([pid for each in self.boards for pid in each.process.pids])):
            until = self._run_steps(until, most_real)
        reached = min(self.reached, until)
        self._world.advance(reached)
        self._world.settle()
        return reached

    def _run_steps(self, until: int, most_real: float) -> int:
        """Let boards take turns. Returns the time to run to, which a byte for the laptop makes earlier."""
        begun = real.perf_counter()
        count = 0
        if not self._has_begun:
            self._has_begun = True
            for each in self.boards:
                self._receive(each)
        boards = self.boards
        while True:
            if self.laptop_listens and self.sent:
                until = min(until, self.sent[0][0])
            board = boards[0] if len(boards) == 1 else min(boards, key=_clock)
            if board.process.now >= until:
                break
            self._step(board, until)
            count += 1
            if count & 31 == 0 and real.perf_counter() - begun > most_real:
                break
        return until

    def reset(self, board: Board) -> None:
        """A board begins again at its clock, in another process. What waited to leave its ports is gone."""
        now = board.process.now
        for lines in board.lines.values():
            for other, rx in lines:
                other.events[:] = [
                    each for each in other.events if each.time <= now or (each.kind, each.pin) != (BYTE, rx)
                ]
        if self._laptop is not None and self._laptop[0] is board:
            self.sent[:] = [each for each in self.sent if each[0] <= now]
        board.records.clear()
        board.pins.clear()
        board.baud.clear()
        board.waited.clear()
        board.granted, board.waits, board.holds = board.process.now, False, 0
        self._receive(board)

    def put(self, board: Board, event: BoardEvent) -> None:
        """Add an event that reaches a board, at its clock or later."""
        insort(board.events, event)

    def _step(self, board: Board, until: int) -> None:
        """Let the board with the smallest clock run to its horizon."""
        boards = self.boards
        now = board.process.now
        # Edges are known up to the next change of the wheels' speed.
        self._world.advance(now)
        if board.waits:
            self._settle(board)
        horizon = self._horizon(board, until)
        if horizon <= now:
            for other in boards:
                if other is not board and other.process.now == now:
                    self._settle(other)
                    horizon = self._horizon(other, until)
                    if horizon > now:
                        board = other
                        break
            else:
                # The same steps whatever the slices are.
                horizon = min((now // _SHORT_SLICE + 1) * _SHORT_SLICE, until)
        self._grant(board, horizon)

    def _settle(self, board: Board) -> None:
        """Do to the world what a stopped board did at its clock, and answer its question."""
        if not board.waits:
            return
        board.waits = False
        now = board.process.now
        self._world.advance(now)
        changed = []
        for record in board.records:
            kind = record.kind
            state = board.pin(record.pin)
            if kind == _STEP:
                state.steps += 1
            elif kind == _LEVEL:
                state.level = float(record.value)
            elif kind == _DUTY:
                state.level = record.value / LARGEST_DUTY
            elif kind == _FINE_DUTY:
                state.level = record.value / FINEST_DUTY
            elif kind == _SERVO:
                state.servo = record.value
                state.level = record.value / PULSE_PERIOD
            else:
                state.mode = record.value
                state.level = 0.0
            changed.append(record.pin)
        board.records.clear()
        if not board.driving.isdisjoint(changed):
            self._world.changed(board, changed)
        process = board.process
        board.answer = 0.0
        if process.reason == _QUERY:
            board.answer = self._world.answer(board, process.query, process.pin)
            # A sketch that sums up a gyro's rate, or follows a line, asks thousands of times a second.
            if process.query in HELD_QUERIES:
                until = self._world.steady_until if board.is_alone else 0
                board.holds = min(until, board.holds or NEVER) if until > now else 0

    def _horizon(self, board: Board, until: int) -> int:
        """The earliest time at which anything could reach a board, its slice at most."""
        horizon = board.process.now + self._slice
        if until < horizon:
            horizon = until
        if board.holds:
            horizon = min(horizon, board.holds)
        for source in board.sources:
            first = source.process.now + source.byte
            if first < horizon:
                horizon = first
        if board.encoders:
            horizon = min(horizon, self._world.next_wheel_change)
            for driver in self._drivers:
                if driver is not board and driver.process.now < horizon:
                    horizon = driver.process.now
        return horizon

    def _grant(self, board: Board, horizon: int) -> None:
        # They are in order.
        known = board.events
        events = known[: bisect_left(known, (horizon,))] if known else []
        if board.encoders:
            now = board.process.now
            for encoder in board.encoders:
                events += encoder.edges(now, horizon)
            events.sort()
        flags = 0
        if self.laptop_listens and self._laptop is not None and self._laptop[0] is board and not self.sent:
            flags = STOP_WHEN_SENT | self._laptop[1]
        if board.forgets or horizon > board.holds:
            board.holds, board.forgets = 0, False
        else:
            flags |= ANSWER_HOLDS
        board.granted = horizon
        board.process.grant(horizon, events, board.answer, flags)
        self._receive(board)

    def _receive(self, board: Board) -> None:
        records = board.process.receive()
        process = board.process
        now = process.now
        events = board.events
        # All before the horizon and up to its clock have been applied.
        while events and events[0].time <= now and events[0].time < board.granted:
            del events[0]
        board.waits = process.reason == _QUERY
        if not board.waits:
            board.holds = 0  # a motor may have changed, or their time is over
        for states in board.steppers.values():
            for stepper in states:
                stepper.known_until = now
        before: BoardRecord | None = None
        details: list[BoardRecord] = []
        for record in records:
            kind = record.kind
            if kind == _BYTE:
                self._pass_on(board, record)
            elif kind in _OF_PINS:
                if record.pin == board.led:
                    self._world.shows(board, record)
                for stepper in board.steppers.get(record.pin, ()):
                    if kind != _STEP or record.pin == stepper.step_pin:
                        stepper.add(record)
                board.records.append(record)
                board.waits = True
            elif kind in _SHOWN:
                self._world.shows(board, record)
            elif kind in _FIRST_OF_TWO:
                before = record
            elif before is not None:
                self._take_two(board, before, record)
                before = None
            elif kind == Told.TASK_NAME:
                process.name_task(record)
            elif kind == Told.BAUD:
                board.baud[record.pin] = record.value if record.value > 0 else _USUAL_BAUD
            elif kind == Told.DETAIL:
                details.append(record)
            elif kind == Told.MISTAKE:
                self._world.mistake(board, record, details)
                details = []
            elif kind == Told.LOST_BYTE:
                self._world.lost(board, record)
            elif kind in _OF_THE_BUS:
                self._world.bus_told(board, record)

    def _take_two(self, board: Board, before: BoardRecord, record: BoardRecord) -> None:
        """Take a fact of two records: the second has its end, or a count."""
        if before.kind == Told.LATE_BYTE:
            self._world.was_late(board, before, record.time)
        elif before.kind == Told.LOST_EDGE:
            self._world.lost_edge(board, before, record.value)
        else:
            place = before.value & 0xFFFFFFFF
            board.waited.append(BoardWait(before.pin, place, before.time, record.time, before.task))

    def _pass_on(self, board: Board, record: BoardRecord) -> None:
        """Bytes on the lines of a board: they arrive when their stop bit is over."""
        time, _, pin, _, value = record
        baud = board.baud.get(pin, _USUAL_BAUD)
        byte = _BITS * SECOND // baud
        arrives = time if byte >= board.byte else time + board.byte - byte
        for other, rx in board.lines.get(pin, ()):
            self.put(other, BoardEvent(arrives, BYTE, rx, value | baud << 8))
        if self._laptop is not None and self._laptop[0] is board and self._laptop[1] == pin:
            self.sent.append((arrives, value))
            self._world.sent(arrives, value, byte)
        else:
            self._world.printed(board, pin, time, value, byte)


def _clock(board: Board) -> int:
    return board.process.now
