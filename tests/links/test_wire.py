"""The delay of bytes between a program and the robot of a dialect."""

from __future__ import annotations

import pytest

from simmer_tui.dialect.frames import Framing
from simmer_tui.engine import Engine
from simmer_tui.links.serial_wire import Wire
from simmer_tui.sim import SimulationSpec, Simulator
from tests.manual_loop import ManualLoop


class Line:
    """A wire of 1000 baud, 10 ms a byte, and what has arrived at its end, with the time."""

    def __init__(self, spec: SimulationSpec) -> None:
        self.loop = ManualLoop(0.0)
        self.arrived: list[tuple[float, bytes]] = []
        engine = Engine(Simulator(spec, seed=3), timed=True)
        engine.start(self.loop)  # type: ignore[arg-type]
        self.wire = Wire(engine, Framing(), 1000)

    def receive(self, data: bytes) -> None:
        self.arrived.append((round(self.loop.now, 6), data))

    def transmit(self, data: bytes) -> None:
        self.wire.transmit(data, self.receive)


@pytest.fixture
def line(course_spec: SimulationSpec) -> Line:
    return Line(course_spec)


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
