"""Facts of boards for a report: bytes that waited, edges that were lost, and waits at a contact. Each is told
with its line in the sketch; none says why the run went as it did.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable

from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import LegEnded, Notice, NoticeKind
from simmer_tui.sim.legs import Leg
from simmer_tui.sketch.board_process import BoardRecord, BoardWait, Waits
from simmer_tui.sketch.boards import BoardKind
from simmer_tui.sketch.lockstep import Board
from simmer_tui.sketch.parts import SECOND
from simmer_tui.sketch.steppers import IDLE
from simmer_tui.sketch.wiring import WiredStepper

# A long wait is rarely over a second, and a second has few legs.
_KEPT_LEGS, _KEPT_BYTES = 100, 200
# Judged: half of it is within the errors of most drives.
_TOLD_DISTANCE = 0.5
"""Inches that the robot has gone while a byte waited, from which it is told."""
_TOLD_WAIT = 20_000_000
"""Nanoseconds of a wait at a contact from which it is told, as for those that the board tells itself."""
_CALLS = {
    Waits.DELAY: "in delay()",
    Waits.PULSE: "in pulseIn()",
    Waits.READ: "in a read with a timeout",
    Waits.STEPS: "in a stepper's movement",
    Waits.TASK: "in vTaskDelay()",
    Waits.SLEEP: "asleep",
}


class BoardFacts:
    """Tells the facts of a run's boards, each at its own time, nanoseconds. Each kind is told at its place
    the first time, the tenth, the hundredth: so a log stays small."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._legs: deque[Leg] = deque(maxlen=_KEPT_LEGS)
        self._bytes: deque[tuple[int, int]] = deque(maxlen=_KEPT_BYTES)
        """Bytes of the laptop: their arrival, nanoseconds, and their value."""
        self._counts: Counter[tuple[str, str]] = Counter()
        self._farthest = 0.0
        self._edges: dict[tuple[str, str], tuple[int, int, Counter[str]]] = {}
        """By board and pin: edges lost, edges in all, and the lost ones by line."""
        self._told_edges: dict[tuple[str, str], int] = {}
        self._contact = -1.0

    def received(self, time: int, value: int) -> None:
        """A byte of the laptop arrives at a time."""
        self._bytes.append((time, value))

    def leg_ended(self, event: LegEnded, boards: Iterable[Board]) -> None:
        """Keep a leg, and tell the boards that were waiting at its contact."""
        self._legs.append(event.leg)
        contact = event.contact
        if contact is None or event.leg.pressed or contact.time == self._contact:
            return
        self._contact = contact.time
        at = round(contact.time * SECOND)
        for board in boards:
            wait = board.wait_at(at)
            if wait is None or at - wait.begin < _TOLD_WAIT:
                continue
            line = board.process.line_of(wait.place)
            begin = wait.begin / SECOND
            took, gone = (at - wait.begin) / 1e6, self._gone(begin, contact.time)
            text = (
                f"at the contact, board {board.name} was {_call(board, wait, line)} for {took:.0f} ms; "
                f"the robot had gone {gone:.1f} in meanwhile"
            )
            waiting = [value for time, value in self._bytes if wait.begin <= time <= at]
            if waiting:
                text += f", and {bytes(waiting).decode('latin-1')!r} of the program waited to be read"
            if self._is_due("contact", line):
                self._tell(text, line, at)

    def was_late(self, board: Board, record: BoardRecord, until: int) -> None:
        """Tell that a board has read a byte long after it had arrived, if the robot went on meanwhile."""
        gone = self._gone(record.time / SECOND, until / SECOND)
        if gone < _TOLD_DISTANCE:
            return
        line, place = board.line_of(record), record.value & 0xFFFFFFFF
        wait = next((each for each in board.waited if each.place == place and each.end > record.time), None)
        is_farther = gone > 2 * self._farthest
        self._farthest = max(self._farthest, gone)
        if not self._is_due("late", line) and not is_farther:
            return
        value = next((value for time, value in self._bytes if time == record.time), None)
        which = "a byte" if value is None else f"the byte {chr(value)!r}"
        where = f"at {line or 'work'}{in_task(board, record.task)}"
        if wait is not None:
            where = _call(board, wait, line)
        took = (until - record.time) / 1e6
        text = f"{which} waited {took:.0f} ms to be read: board {board.name} was {where}"
        self._tell(f"{text}; the robot went {gone:.1f} in meanwhile", line, until)

    def fifo_overflow(self, board: Board, part: str, record: BoardRecord, time: int) -> None:
        """Tell that the FIFO of a part has lost packets, which the sketch has not read in time."""
        line = board.line_of(record)
        if self._is_due(f"fifo {part}", line):
            held = "it holds 1,024 bytes of packets, one each 10 ms, and nothing read them"
            text = f"the FIFO of {part} overflowed{at_line(line)}: {held}"
            self._tell(f"board {board.name}: {text}", line, time)

    def bus_stuck(self, board: Board, record: BoardRecord, time: int) -> None:
        """Tell that a board waits for its bus, and goes on waiting: interrupts are off."""
        line = board.line_of(record)
        if not self._is_due(f"bus {board.name}", line):
            return
        where = at_line(line) + in_task(board, record.task)
        because = "Wire needs interrupts, which are off there, as in an interrupt's function"
        self._tell(f"board {board.name} waits without end{where}: {because}", line, time)

    def lost_byte(self, board: Board, pin: str, record: BoardRecord, time: int) -> None:
        """Tell the first byte that is lost at a pin, the tenth, the hundredth ..."""
        line, key = board.line_of(record), (f"byte {board.name}", pin)
        if not self._is_due(*key):
            return
        text = f"a byte at pin {pin} was lost{at_line(line)}: the queue was full, or interrupts were off"
        more = f"; {self._counts[key]} so far" if self._counts[key] > 1 else ""
        self._tell(f"board {board.name}: {text}{more}", line, time)

    def lost_edge(self, board: Board, pin: str, record: BoardRecord, edges: int, time: int) -> None:
        """Count an edge that a board has lost, one of so many at a pin."""
        key = (board.name, pin)
        lost, _, lines = self._edges.get(key, (0, 0, Counter()))
        lines[board.line_of(record)] += 1
        self._edges[key] = lost + 1, edges, lines
        if is_told(lost + 1):
            self._tell_edges(key, time)

    def missed_step(self, stepper: WiredStepper, kind: BoardKind, line: str, reason: str, time: int) -> None:
        """Tell a step that moves nothing: its driver is not enabled, or the wheel cannot follow."""
        key = (f"{reason} {stepper.label}", line)
        if not self._is_due(*key):
            return
        count = self._counts[key]
        steps = f"a step of {stepper.label}" if count == 1 else f"{count} steps of {stepper.label}"
        where = at_line(line)
        if reason == IDLE:
            pin = kind.pin_name(stepper.pins["enable"])
            now, wanted = ("LOW", "HIGH") if stepper.enable_high else ("HIGH", "LOW")
            what = f"moved nothing{where}: its enable, pin {pin}, is {now}; the driver is on at {wanted}"
        else:
            were = "was" if count == 1 else "were"
            what = f"{were} lost{where}: faster than the wheel, {stepper.top_speed:g} in/s"
        self._tell(f"board {stepper.board}: {steps} {what}", line, time)

    def tell_totals(self, time: int) -> None:
        """Tell how many edges were lost in all, at the end of a run."""
        for key, (lost, _, _) in self._edges.items():
            if lost != self._told_edges.get(key):
                self._tell_edges(key, time)

    def _tell_edges(self, key: tuple[str, str], time: int) -> None:
        name, pin = key
        lost, edges, lines = self._edges[key]
        self._told_edges[key] = lost
        line, most = lines.most_common(1)[0]
        where = at_line(line)
        because = "interrupts were off since the one before"
        if lost == 1:
            text = f"an edge at pin {pin} was lost{where}: {because}"
        else:
            share = f", {most} of them{where}" if where and most < lost else where
            text = f"{lost} of the first {edges} edges at pin {pin} were lost{share}: {because}"
        self._tell(f"board {name}: {text}", line, time)

    def _is_due(self, kind: str, line: str) -> bool:
        self._counts[kind, line] += 1
        return is_told(self._counts[kind, line])

    def _gone(self, begin: float, end: float) -> float:
        """Inches that the robot has gone between two times, seconds."""
        legs = list(self._legs)
        now = self._engine.simulator.leg
        if now is not None and (not legs or now.start_time >= legs[-1].end_time):
            legs.append(now)
        return sum(each.travelled(end) - each.travelled(begin) for each in legs)

    def _tell(self, text: str, line: str, time: int) -> None:
        self._engine.tell(Notice(NoticeKind.BOARD, text, line, moment=time / SECOND))


def at_line(line: str) -> str:
    """A line, for a sentence; empty for an unknown one."""
    return f" at {line}" if line else ""


def _call(board: Board, wait: BoardWait, line: str) -> str:
    call = _CALLS.get(Waits(wait.kind), "")
    where = f"{call} at {line}" if line else call
    return where + in_task(board, wait.task)


def in_task(board: Board, number: int) -> str:
    """The task of a sketch with FreeRTOS, for a sentence; empty for loop()."""
    name = board.process.task_name(number)
    return f" in task {name}" if name else ""


def is_told(count: int) -> bool:
    """True for the counts at which a fact is told again: 1, 10, 100 ..."""
    return str(count).strip("0") == "1"
