"""Mistakes that a sketch makes while it runs and a board does not show by itself, in words: each once, with
its line. The text of the sketch tells what its author meant."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum

from msgspec import Struct

from simmer_tui.run.events import Notice, NoticeKind
from simmer_tui.sim.command import cut
from simmer_tui.sketch.board_facts import at_line
from simmer_tui.sketch.board_process import BoardRecord, Mistake
from simmer_tui.sketch.interrupt_check import from_isr, interrupt_functions, is_of_tasks, may_wake_tasks
from simmer_tui.sketch.lockstep import Board
from simmer_tui.sketch.parts import SECOND
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_source import SketchCall
from simmer_tui.sketch.task_check import TICKED

_LONGEST = 40
"""Characters of an argument that are shown."""
_NEVER_WAITS, _ON_CORE_0 = 1, 2
"""Flags of a task that others cannot pass."""
_HAS_INTERRUPTS, _LOOP_GOES_ON = 1, 2
"""Flags of what is left while all tasks wait."""
_SERIAL_EVENTS = ("serialEvent", "serialEvent1", "serialEvent2", "serialEvent3")
"""Functions that are called after each loop()."""
_MOST_TASKS = 6
"""Tasks that a notice names: a robot has fewer, and a notice has two lines or three."""


class _WaitsFor(IntEnum):
    """Things that a task waits for (`arduino/board/tasks.h`); the last three are of a report alone."""

    ITEM = 1
    ROOM = 2
    SEMAPHORE = 3
    MUTEX = 4
    NOTIFICATION = 5
    BITS = 6
    RESUME = 7
    HOLDER = 8
    OTHERS = 9
    DELETED = 10


_AWAITED = {
    _WaitsFor.ITEM: "an item of a queue",
    _WaitsFor.ROOM: "room in a queue",
    _WaitsFor.SEMAPHORE: "a semaphore",
    _WaitsFor.MUTEX: "a mutex",
    _WaitsFor.NOTIFICATION: "a notification",
    _WaitsFor.BITS: "bits of an event group",
    _WaitsFor.RESUME: "vTaskResume",
}


class _Call(IntEnum):
    """Calls in an interrupt's function, the numbers of that mistake (`arduino/board/mistakes.h`)."""

    DELAY = 1
    PULSE = 2
    PRINT = 3
    TASK = 4


class _StuckTask(Struct):
    """A task that waits for ever, and what for."""

    name: str
    line: str
    awaited: str
    holder: str = ""
    taken: str = ""

    def __str__(self) -> str:
        where = f" at {self.line}" if self.line else ""
        held = f", which {self.holder} took{at_line(self.taken)}" if self.holder else ""
        return f"{self.name}{where} for {self.awaited}{held}"


class BoardMistakes:
    """Tells the mistakes of a run's boards.

    Args:
        tell: Takes the notice.
        facts: The facts of each board's sketch.
    """

    def __init__(self, tell: Callable[[Notice], None], facts: Mapping[str, SketchFacts]) -> None:
        self._tell = tell
        self._facts = facts
        self._told: set[tuple[str, int, str, int]] = set()

    def add(self, board: Board, record: BoardRecord, details: Sequence[BoardRecord], time: int) -> None:
        """Tell a mistake of a board by its record and what belongs to it, at a time, nanoseconds."""
        line = board.line_of(record)
        kind = Mistake(record.pin)
        # Two calls of one kind in a line are one mistake; of pins and of tasks, each has its own.
        number = record.task if kind in _OF_TASKS else details[-1].value
        key = (board.name, kind, line, number)
        if line and key in self._told:
            return
        text = self._text(board, kind, record, details, line)
        if text:
            self._told.add(key)
            subject = f"{kind.name.lower()} {number} {line}"
            text = f"board {board.name}: {text}"
            self._tell(Notice(NoticeKind.BOARD, text, subject, moment=time / SECOND))

    def _text(
        self, board: Board, kind: Mistake, record: BoardRecord, details: Sequence[BoardRecord], line: str
    ) -> str:
        facts = self._facts.get(board.name)
        match kind:
            case Mistake.NO_WAIT | Mistake.NO_PERIOD:
                return _no_ticks(facts, kind, line)
            case Mistake.INPUT_PIN:
                what = f"pin {details[-1].value} is an input alone, and the sketch writes it{at_line(line)}"
                return f"{what}: nothing leaves it; take another pin"
            case Mistake.NO_PULL_UP:
                what = f"the sketch wants a pull-up or pull-down of pin {details[-1].value}{at_line(line)}"
                return f"{what}, which has none: add a resistor, or take another pin"
            case Mistake.FLASH_PIN:
                what = f"pin {details[-1].value}{at_line(line)} is one of the flash memory's, 6 to 11"
                return f"{what}: a real ESP32 crashes there; take another pin"
            case Mistake.IN_INTERRUPT:
                return _in_interrupt(facts, details[-1].value, line)
            case Mistake.LOST_ALARM:
                what = f"an alarm of a hardware timer was lost{at_line(line)}"
                return f"{what}: interrupts were off since the one before"
            case Mistake.STARVED:
                return self._starved(board, record, details, line)
            case Mistake.WATCHDOG:
                what = f"task {_name(board, record.task)}{at_line(line)} has not waited for 5 s, and core 0"
                return (
                    f"{what} was never idle: the task watchdog restarts a real ESP32; give it a vTaskDelay(1)"
                )
            case Mistake.CIRCLE:
                return _circle(board, details)
            case Mistake.ALL_WAIT:
                return _all_wait(board, facts, details)

    def _starved(self, board: Board, record: BoardRecord, details: Sequence[BoardRecord], line: str) -> str:
        *passed, about = details
        facts = self._facts.get(board.name)
        has_loop = facts is None or any(facts.calls_in("loop"))
        names = [
            _name(board, each.task) + (at_line(board.line_of(each)) if each.task else "")
            for each in passed
            if each.task or has_loop
        ]
        if not names:
            return ""
        flags = about.pin
        runs = _name(board, record.task)
        have = f"{', '.join(names[:_MOST_TASKS])} {'has' if len(names) == 1 else 'have'} not run for 1 s"
        if flags & _NEVER_WAITS:
            why = f"{runs}, of higher priority, has not waited meanwhile{at_line(line)}; give it a vTaskDelay"
        else:
            why = f"tasks of higher priority always have work, now {runs}{at_line(line)}"
        text = f"{have}: {why}"
        if flags & _ON_CORE_0:
            text += "; the task watchdog restarts a real ESP32 after 5 s of that on core 0"
        return text


_OF_TASKS = (Mistake.STARVED, Mistake.WATCHDOG, Mistake.CIRCLE, Mistake.ALL_WAIT)


def _name(board: Board, task: int) -> str:
    return board.process.task_name(task) or "loop()"


def _call_at(facts: SketchFacts | None, line: str, names: Sequence[str]) -> list[SketchCall]:
    """The calls of these names in a line."""
    return [] if facts is None else [call for call in facts.named(*names) if call.token.spot == line]


def _no_ticks(facts: SketchFacts | None, kind: Mistake, line: str) -> str:
    """A wait or a period of no tick; empty if its author wrote 0, to let others run."""
    if facts is None:
        return ""
    is_wait = kind is Mistake.NO_WAIT
    names = [name for name in TICKED if name.startswith("xTimer") is not is_wait]
    found = _call_at(facts, line, names)
    meant = [call for call in found if facts.spelled(call, TICKED[call.name]) not in ("0", "")]
    if found and not meant:
        return ""
    name, ticks = "a wait" if is_wait else "a timer", "its ticks"
    if meant:
        name = meant[0].name
        ticks = cut(facts.spelled(meant[0], TICKED[name]), _LONGEST)
    did = "did not wait" if is_wait else "was refused"
    tick = f"a tick of the {facts.kind.title} has {facts.kind.tick} ms"
    return f"{name}{at_line(line)} {did}: {ticks} was 0, and {tick}"


def _in_interrupt(facts: SketchFacts | None, number: int, line: str) -> str:
    is_esp32 = facts is not None and facts.kind.int_bits == 32
    crash = "a real ESP32 may crash there" if is_esp32 else ""
    match _Call(number):
        case _Call.DELAY:
            name, why = "delay()", crash or "it needs interrupts, which are off, to end at its time"
        case _Call.PULSE:
            name, why = "pulseIn()", "no other interrupt comes while it waits"
        case _Call.PRINT:
            name, why = "a print", crash or "it lasts as long as its bytes once the queue is full"
        case _Call.TASK:
            called = [] if facts is None else [call.name for call in facts.calls if call.token.spot == line]
            name = next(filter(is_of_tasks, called), "a call of FreeRTOS")
            other = from_isr(name)
            why = f"only tasks may call it; there is {other}" if other else "only tasks may call it"
    return f"{name}{at_line(line)} is in an interrupt's function: {why}"


def _stuck(board: Board, details: Sequence[BoardRecord]) -> list[_StuckTask]:
    found: list[_StuckTask] = []
    for each in details:
        if each.pin == _WaitsFor.HOLDER and found:
            found[-1].holder, found[-1].taken = _name(board, each.task), board.line_of(each)
        elif each.pin in _AWAITED:
            awaited = _AWAITED[_WaitsFor(each.pin)]
            found.append(_StuckTask(_name(board, each.task), board.line_of(each), awaited))
    return found


def _shown(stuck: Sequence[_StuckTask]) -> str:
    more = f"; and {len(stuck) - _MOST_TASKS} more" if len(stuck) > _MOST_TASKS else ""
    return "; ".join(map(str, stuck[:_MOST_TASKS])) + more


def _all_wait(board: Board, facts: SketchFacts | None, details: Sequence[BoardRecord]) -> str:
    """Tasks that wait for ever; empty if loop() or the function of an interrupt can wake them."""
    *waits, others = details
    loops = ("loop", *_SERIAL_EVENTS) if others.value & _LOOP_GOES_ON else ()
    if facts is None or any(may_wake_tasks(facts, each) for each in loops):
        return ""
    if others.value & _HAS_INTERRUPTS and any(
        may_wake_tasks(facts, each) for each in interrupt_functions(facts)
    ):
        return ""
    but = " but loop()" if any(facts.calls_in(each) for each in loops) else ""
    return f"all tasks{but} wait for ever: {_shown(_stuck(board, waits))}"


def _circle(board: Board, details: Sequence[BoardRecord]) -> str:
    *waits, deleted = details
    stuck = _stuck(board, waits)
    if deleted.value:
        return f"{_shown(stuck)}: it waits for ever, since that task was deleted with its mutex"
    if len(stuck) == 1:
        one = stuck[0]
        what = f"{one.name} waits for ever{at_line(one.line)} for the mutex that it took itself"
        return f"{what}{at_line(one.taken)}; give it back first, or make it recursive"
    remedy = "take them in the same order in all tasks"
    return f"tasks wait for each other for ever: {_shown(stuck)}; {remedy}"
