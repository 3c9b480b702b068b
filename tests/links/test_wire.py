"""The delay of bytes between a program and the robot of a dialect."""

from __future__ import annotations

import pytest

from simmer_tui.dialect.frames import Framing
from simmer_tui.links.serial_wire import MOST_IN_TRANSIT, Wire
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Event, MovementPlanned, Notice
from simmer_tui.sim import SimulationSpec, Simulator, parse_command
from tests.manual_loop import ManualLoop


class Line:
    """A wire of 1000 baud, 10 ms a byte, and what has arrived at its end, with the time."""

    def __init__(self, spec: SimulationSpec, loop: ManualLoop) -> None:
        self.loop = loop
        self.arrived: list[tuple[float, bytes]] = []
        self.engine = Engine(Simulator(spec, seed=3), timed=True)
        self.engine.start(loop)  # type: ignore[arg-type]
        self.wire = Wire(self.engine, Framing(), 1000)

    def receive(self, data: bytes) -> None:
        self.arrived.append((round(self.loop.now, 6), data))

    def transmit(self, data: bytes) -> None:
        self.wire.transmit(data, self.receive)


@pytest.fixture
def line(course_spec: SimulationSpec) -> Line:
    return Line(course_spec, ManualLoop(0.0))


class RunningLoop(ManualLoop):
    """Its clock runs on while it is read, as a real one does."""

    def time(self) -> float:
        self.now += 0.001
        return self.now


def test_each_message_arrives_with_its_last_byte(line: Line) -> None:
    line.transmit(b"ab\nc\nd")
    line.loop.run_until(1.0)
    assert line.arrived == [(0.03, b"ab\n"), (0.05, b"c\n"), (0.06, b"d")]


def test_a_port_that_was_closed_leaves_nothing_on_the_line(line: Line) -> None:
    line.transmit(b"get\n" * 10)
    assert line.wire.delay(100) == 0.0
    line.wire.flush()
    assert line.arrived == [(0.0, b"get\n")] * 10
    # Messages and replies of the next program come neither after those nor at the times of those.
    line.transmit(b"f 12\n")
    assert line.wire.delay(1) == 0.0
    line.loop.run_until(1.0)
    assert line.arrived[10:] == [(0.05, b"f 12\n")]


def test_a_program_that_writes_faster_than_the_line_loses_what_no_driver_would_keep(line: Line) -> None:
    """Each message under way is an object, and all of them arrive at once when the port is closed."""
    told: list[str] = []
    line.engine.watch(lambda event: told.append(event.text) if isinstance(event, Notice) else None)
    most = MOST_IN_TRANSIT // 4
    for _ in range(3):
        line.transmit(b"get\n" * most)
    line.loop.run_until(MOST_IN_TRANSIT * 0.01 + 1.0)
    assert most <= len(line.arrived) <= most + 1
    assert told == [
        f"the program writes faster than the line carries: {MOST_IN_TRANSIT} bytes wait, "
        f"{4 * (most - 1)} more are lost. A write to a real port would wait"
    ]
    line.transmit(b"x\n")
    line.loop.run_until(MOST_IN_TRANSIT * 0.01 + 2.0)
    assert line.arrived[-1][1] == b"x\n"


def test_at_a_higher_rate_nothing_is_lost_that_was_written_at_a_lower_one(line: Line) -> None:
    line.transmit(b"get\n" * 100)
    line.wire.set_baud(115200)
    line.transmit(b"x\n")
    line.loop.run_until(5.0)
    assert len(line.arrived) == 101


def test_all_that_a_message_brings_about_has_its_time(course_spec: SimulationSpec) -> None:
    line = Line(course_spec, RunningLoop(0.0))
    events: list[Event] = []
    times: list[float] = []
    line.engine.watch(events.append)
    session = line.engine.session()

    def receive(data: bytes) -> None:
        times.append(line.engine.now())
        session.submit(parse_command("d1-3"), lambda result: None)

    line.wire.transmit(b"f 3\n", receive)
    line.loop.run_until(0.1)
    (planned,) = (each for each in events if isinstance(each, MovementPlanned))
    assert times == [planned.time]
    assert line.engine.now() > planned.time
