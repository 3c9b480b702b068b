"""Messages of a board that no runtime could send: it ends, and nothing of them reaches the robot."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from simmer_tui.errors import BoardError, ProgramError
from simmer_tui.sketch.board_host import BoardHost
from simmer_tui.sketch.board_process import BoardProcess, BoardRecord, Mistake, Query, Reason, Told
from simmer_tui.sketch.boards import UNO
from simmer_tui.sketch.build import build_sketch
from simmer_tui.sketch.checked_board import CheckedBoard
from simmer_tui.sketch.compiler import find_compiler

_REQUEST = struct.Struct("<QBBHiIIQII")
_RECORD = struct.Struct("<QBBHi")
_HORIZON = 20_000_000


class Pipes:
    """A board without a process: what it tells is written by the test (`BoardHost`)."""

    def __init__(self) -> None:
        self.output, self.told = os.pipe()
        self.given, self.input = os.pipe()
        self.words, self.calls = "", list[str]()
        self.pids: tuple[int, ...] = ()

    def interrupt(self) -> None:
        self.calls.append("interrupt")

    def kill(self) -> None:
        self.calls.append("kill")

    def end(self) -> tuple[str, str]:
        return self.words, "exit code 7"

    def close(self) -> None:
        self.hang_up()
        for each in (self.output, self.given, self.input):
            os.close(each)

    def hang_up(self) -> None:
        """End what it tells."""
        if self.told >= 0:
            os.close(self.told)
        self.told = -1


@pytest.fixture
def pipes() -> Iterator[Pipes]:
    made = Pipes()
    yield made
    made.close()


def request(
    now: int,
    *records: BoardRecord,
    reason: int = Reason.HORIZON,
    query: int = 0,
    pin: int = 0,
    wait: tuple[int, int] = (0, 0),
) -> bytes:
    begin, kind = wait
    head = _REQUEST.pack(now, reason, query, len(records), pin, 0, 0, begin, kind, 0)
    return head + b"".join(_RECORD.pack(*each) for each in records)


def record(kind: int, value: int = 0, time: int = 100, pin: int = 5) -> BoardRecord:
    return BoardRecord(time, kind, pin, 0, value)


Begun = Callable[..., BoardProcess]


@pytest.fixture
def begun(pipes: Pipes) -> Begun:
    def make(kind: type[BoardProcess] = CheckedBoard) -> BoardProcess:
        def start(program: Path, options: Sequence[str]) -> BoardHost:
            return pipes

        board = kind("rover", Path("rover.exe"), [], start)
        os.write(pipes.told, request(0))
        assert board.receive() == []
        board.grant(_HORIZON, [], 0.0, 0)
        return board

    return make


@pytest.mark.parametrize(
    "fine",
    [
        request(_HORIZON),
        request(100, record(Told.LEVEL, 1), record(Told.DUTY, 255), record(Told.MODE, 2)),
        request(100, record(Told.BYTE, 65, 9_000), record(Told.BYTE, 66, 13_000)),
        request(100, record(Told.WAITED, 7, 0, pin=1), record(Told.UNTIL)),
        request(100, reason=Reason.QUERY, query=Query.ANALOG, wait=(90, 1)),
        request(9_000, record(Told.STEP, -7, 1_000), record(Told.STEP, -7, 9_000), wait=(90, 4)),
        request(100, record(Told.TEXT, 4 << 24 | 1)),
        request(100, record(Told.FIFO_OVERFLOW, 0x400123, pin=31), reason=Reason.QUERY, query=Query.RATE),
        request(100, record(Told.BUS_STUCK, 0x400123, pin=0)),
        request(100, record(Told.BUSY, 250_000, pin=0)),
        request(100, record(Told.DETAIL, 34), record(Told.MISTAKE, 0x400123, pin=3), reason=Reason.OUTPUT),
        request(100, record(Told.MISTAKE, 0x400123, pin=Mistake.WATCHDOG), reason=Reason.OUTPUT),
    ],
)
def test_what_boards_tell_is_taken(begun: Begun, pipes: Pipes, fine: bytes) -> None:
    board = begun()
    os.write(pipes.told, fine)
    assert len(board.receive()) == (len(fine) - _REQUEST.size) // _RECORD.size


@pytest.mark.parametrize(
    ("told", "what"),
    [
        (request(_HORIZON + 1), "its clock went where it may not"),
        (request(1 << 63), "its clock went where it may not"),
        (request(100, reason=9), "it asked what no board asks"),
        (request(100, query=9), "it asked what no board asks"),
        (request(100, wait=(0, 9)), "it waits as no board does"),
        (request(100, wait=(101, 1)), "it waits as no board does"),
        # A pin that is high for a thousand times the time would turn its wheel as much faster.
        (request(100, record(Told.LEVEL, 1000)), "it told 1000 as LEVEL"),
        (request(100, record(Told.DUTY, 256)), "it told 256 as DUTY"),
        (request(100, record(Told.DUTY, -1)), "it told -1 as DUTY"),
        (request(100, record(Told.BYTE, -1)), "it told -1 as BYTE"),
        (request(100, record(Told.BAUD, 0)), "it told 0 as BAUD"),
        (request(100, record(99)), "it told 0 as 99"),
        (request(100, query=Query.RATE + 1), "it asked what no board asks"),
        (request(100, reason=Reason.QUERY, query=Query.RANGE, pin=70), "it asked what no board asks"),
        (request(100, reason=Reason.QUERY, query=Query.RANGE, pin=-1), "it asked what no board asks"),
        (request(100, record(Told.FIFO_OVERFLOW, 7, pin=200)), "it told of pin 200"),
        (request(100, record(Told.FIFO_OVERFLOW, 7, time=101)), "it told what was not then"),
        (request(100, record(Told.LEVEL, 1, pin=70)), "it told of pin 70"),
        (request(100, record(Told.WAITED, 7, 0, pin=9)), "it waited as no board does"),
        (request(100, record(Told.LEVEL, 1, time=101)), "it told what was not then"),
        (request(9_000, record(Told.STEP, 7, 1_000), record(Told.STEP, 7, 1_399)), "it stepped faster than"),
        (request(100, record(Told.STEP, 7, 101)), "it told what was not then"),
        (request(100, record(Told.TEXT, 5 << 24)), "it told 83886080 as TEXT"),
        (request(100, record(Told.TEXT, -1)), "it told -1 as TEXT"),
        (request(100, record(Told.TEXT, 0, pin=8)), "it told of display 8"),
        (request(100, wait=(0, 7)), "it waits as no board does"),
        (request(100, record(Told.DETAIL), record(Told.MISTAKE, pin=14)), "it told of mistake 14"),
        (request(100, record(Told.BUSY, 1_000_001)), "it told 1000001 as BUSY"),
        (request(100, record(Told.MISTAKE, pin=Mistake.INPUT_PIN)), "it told half of a mistake"),
        (
            request(100, record(Told.DETAIL, 5), record(Told.MISTAKE, pin=Mistake.IN_INTERRUPT)),
            "it told half of a mistake",
        ),
        (request(100, *[record(Told.DETAIL, 3), record(Told.MISTAKE, pin=3)] * 900), "more mistakes than"),
        (request(100, record(Told.BYTE, 65, 1 << 62)), "faster than a line carries them"),
        (request(100, record(Told.BYTE, 65, 9000), record(Told.BYTE, 65, 9001)), "faster than a line"),
    ],
)
def test_what_no_board_tells_ends_it(begun: Begun, pipes: Pipes, told: bytes, what: str) -> None:
    board = begun()
    os.write(pipes.told, told)
    with pytest.raises(
        BoardError, match=r"^board rover was ended after .*only the runtime may use"
    ) as caught:
        board.receive()
    assert what in str(caught.value)
    assert 0 <= board.now <= _HORIZON


def test_a_distance_takes_the_time_of_its_part(begun: Begun, pipes: Pipes) -> None:
    board = begun()
    asked = {"reason": Reason.QUERY, "query": Query.RANGE}
    os.write(pipes.told, request(_HORIZON // 2, **asked))
    board.receive()
    board.grant(3 * _HORIZON, [], 0.0, 0)
    os.write(pipes.told, request(_HORIZON // 2 + 20_000_000, **asked))
    board.receive()
    os.write(pipes.told, request(_HORIZON // 2 + 39_999_999, **asked))
    with pytest.raises(BoardError, match="it measured faster than its part does"):
        board.receive()


def test_a_clock_goes_neither_back_nor_stands(begun: Begun, pipes: Pipes) -> None:
    board = begun()
    os.write(pipes.told, request(500))
    board.receive()
    os.write(pipes.told, request(499))
    with pytest.raises(BoardError, match="its clock went where it may not"):
        board.receive()
    assert board.now == 500
    board = begun()
    for _ in range(10_000):
        os.write(pipes.told, request(0, reason=Reason.OUTPUT))
        board.receive()
    os.write(pipes.told, request(0, reason=Reason.OUTPUT))
    with pytest.raises(BoardError, match="its clock stands, however often it is asked"):
        board.receive()


def test_last_words_may_be_those_of_the_sketch(begun: Begun, pipes: Pipes) -> None:
    """A sketch that writes the words itself cannot set the world's clock, and no number is too long."""
    board = begun()
    pipes.words = "simmer-board died 11 0 0 4000000000 -1\n"
    pipes.hang_up()
    with pytest.raises(BoardError, match=r"died after 0\.02 s: it used memory"):
        board.receive()
    pipes.words = f"simmer-board died 11 0 0 {'9' * 5000} -1\n"
    with pytest.raises(BoardError, match=r"died after 0\.02 s: exit code 7"):
        board.receive()


def test_a_board_that_is_silent_is_asked_where_it_is_and_then_killed(begun: Begun, pipes: Pipes) -> None:
    """It may have a handler of its own. A board that reads no grants is silent too."""
    board = begun(BoardProcess)
    assert board._waits_since > 0.0
    begin = board._waits_since
    for count in range(30):
        board.look(begin + count)
    assert pipes.calls[0] == "interrupt"
    begin = board._waits_since
    for count in range(30):
        board.look(begin + count)
    assert pipes.calls[1] == "kill"


def test_a_board_that_cannot_be_started_is_told_as_that() -> None:
    def refused(program: Path, options: Sequence[str]) -> BoardHost:
        raise ProgramError("the sandbox has no rover.exe")

    for board in (
        BoardProcess("rover", Path("nosuch-folder/rover.exe"), []),
        CheckedBoard("rover", Path("rover.exe"), [], refused),
    ):
        with pytest.raises(BoardError, match=r"^board rover could not be started: "):
            board.receive()
        board.look(1e9)
        board.close()


CONSTRUCTED = """
struct Lamp {
  Lamp(int pin) { pinMode(pin, OUTPUT); digitalWrite(pin, HIGH); Serial.begin(9600); delay(5); }
};
Lamp lamp(5);
void setup() {}
void loop() {}
"""


@pytest.mark.slow
@pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
def test_constructors_of_globals_tell_at_the_beginning(tmp_path: Path) -> None:
    sketch = tmp_path / "rover.ino"
    sketch.write_text(CONSTRUCTED, "utf-8")
    board = CheckedBoard("rover", build_sketch(sketch, UNO).program, ["--drives", "5"])
    try:
        told = [(each.kind, each.pin, each.value, each.time) for each in board.receive()]
    finally:
        board.close()
    assert (Told.LEVEL, 5, 1, 0) in told
    assert (Told.BAUD, 1, 9600, 0) in told
    assert board.now == 0


def test_a_board_that_ends_before_it_begins_was_not_started(pipes: Pipes) -> None:
    board = CheckedBoard("rover", Path("rover.exe"), [], lambda program, options: pipes)
    pipes.hang_up()
    with pytest.raises(BoardError, match=r"^board rover could not be started: exit code 7$"):
        board.receive()
