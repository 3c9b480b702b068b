"""Events that are passed on together: all of them, in order, each with its time."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from simmer_tui.config.dialects import COMMANDS, REPLIES
from simmer_tui.config.loader import Override, load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.live.late_events import TOGETHER, LateEvents
from simmer_tui.live.server import Server
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Action, ActionName, CommandResult, Event, MovementEnded, Notice, NoticeKind
from simmer_tui.runlog.log_records import BrokenLine
from simmer_tui.runlog.reader import LogReader
from simmer_tui.sim import SimulationSpec, Simulator, parse_command


class Reader:
    """Keeps what it gets; `passes` has the number of events of each call."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.real_times: list[float] = []
        self.passes: list[int] = []

    def apply(self, event: Event, line: int, real_time: float) -> None:
        self.apply_any((event,), (line,), (real_time,))

    def apply_readings(
        self, results: Sequence[CommandResult], lines: Sequence[int], real_times: Sequence[float]
    ) -> None:
        assert all(each.reading is not None for each in results)
        self.apply_any(results, lines, real_times)

    def apply_any(self, events: Sequence[Event], lines: Sequence[int], real_times: Sequence[float]) -> None:
        assert set(lines) == {0}
        assert len(events) == len(lines) == len(real_times)
        self.events += events
        self.real_times += real_times
        self.passes.append(len(events))


class Bench:
    """An engine with late events, and a watcher that gets each at once."""

    def __init__(self, spec: SimulationSpec) -> None:
        self.engine = Engine(Simulator(spec, 5))
        self.late = LateEvents(self.engine.tell_fault)
        self.reader, self.told = Reader(), list[Event]()
        self.late.readers.append(self.reader)
        self.engine.watch(self.told.append)
        self.engine.watch(self.late.watch)
        self._session = self.engine.session()

    def give(self, *commands: str) -> None:
        for command in commands:
            self._session.submit(parse_command(command), lambda outcome: None)


@pytest.fixture
def bench(course_spec: SimulationSpec) -> Bench:
    return Bench(course_spec)


def test_readings_that_follow_each_other_are_one_call(bench: Bench) -> None:
    begun = time.monotonic()
    bench.give("u1", "u2", "d1-1", "u1", "zz", "u3", "u4")
    assert bench.reader.events == []
    assert len(bench.late) == len(bench.told)
    told = time.monotonic()
    bench.late.pass_on()
    assert bench.reader.events == bench.told
    assert bench.reader.passes == [2, 1, 1, 1, 1, 1, 2]
    assert len(bench.late) == 0
    times = [begun, *bench.reader.real_times, told]
    assert times == sorted(times), "each has the time at which it came"


def test_no_more_wait_than_are_passed_on_together(bench: Bench) -> None:
    bench.give(*["u1"] * (TOGETHER - 1))
    assert bench.reader.events == []
    bench.give("u1")
    assert bench.reader.passes == [TOGETHER]


def test_a_rare_event_takes_those_before_it_along(bench: Bench) -> None:
    bench.give("u1", "u2")
    bench.engine.perform(Action(ActionName.NOISE, (0.0,)))
    assert bench.reader.events == bench.told
    assert bench.reader.passes == [2, 1]


def test_a_reader_that_fails_is_dropped_and_the_others_get_all(bench: Bench) -> None:
    class Broken(Reader):
        def apply_any(self, *_: object) -> None:
            raise ValueError("it is broken")

    bench.late.readers.insert(0, Broken())
    bench.give("u1")
    bench.late.pass_on()
    assert bench.late.readers == [bench.reader]
    fault = Notice(NoticeKind.FAULT, "a watcher failed and was dropped: ValueError: it is broken")
    assert bench.reader.events == bench.told == [bench.told[0], fault]


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    """A server as the app has it."""
    monkeypatch.setattr("platformdirs.user_data_path", lambda *_, **__: tmp_path)
    made = Server(load(bundled_folder(), {"server.port": Override("--port", 0)}))
    made.save_run()
    made.record()
    yield made
    made.stop()


def kinds_in(path: Path) -> list[type]:
    """The kinds of events in a log, without notices."""
    with LogReader(path) as log:
        found = [logged.event for logged in log if not isinstance(logged, BrokenLine)]
    return [type(each) for each in found if type(each) is not Notice]


def test_who_asks_for_a_run_gets_all_of_it(server: Server) -> None:
    """Snapshot and saved run have the events that wait, and the saved run those at the end too."""
    told: list[Event] = []
    server.start(told.append)
    assert server.saved_run is not None
    path = server.saved_run.path
    sending, reading = (
        socket.create_connection(("127.0.0.1", server.ports[each.purpose])) for each in (COMMANDS, REPLIES)
    )
    with sending, reading:
        for order, command in enumerate((b"u1\n", b"d1-1\n", b"u2\n") * TOGETHER):
            sending.sendall(command)
            reading.recv(8, socket.MSG_WAITALL)
            if order == 4:
                # Its last event has been told before its reply.
                newest = server.newest
                snapshot = asyncio.run(server.snapshot())
                assert newest == snapshot.number == len(told)
                assert snapshot.state.commands == 5
                asyncio.run(server.flush_saved_run())
                assert kinds_in(path) == [type(each) for each in told if type(each) is not Notice]
        server.stop()
    assert kinds_in(path) == [type(each) for each in told if type(each) is not Notice]
    assert kinds_in(path).count(MovementEnded) == TOGETHER
