"""The line to a board: bytes that it cannot keep, a board without a rate, a program that never found it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from simmer_tui.config.dialects import SERIAL
from simmer_tui.links.backend import BackendSwitch
from simmer_tui.links.link import LinkContext
from simmer_tui.links.ports import PortRequest, take_port
from simmer_tui.links.serial_wire import MOST_IN_TRANSIT
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import NOT_CONNECTED, Event, Notice, ProgramEnded
from simmer_tui.sim import SimulationSpec, Simulator
from simmer_tui.sketch.board_link import BoardLink


class Line:
    """A link whose board only notes the bytes that arrive, and a program that has its port open."""

    port = peer = "COM6"
    by_clock = False

    def __init__(self, spec: SimulationSpec, baud: int) -> None:
        engine = Engine(Simulator(spec, seed=1), timed=False)
        self.told: list[str] = []
        engine.watch(self._note)
        self.arrived: list[int] = []
        board: Any = SimpleNamespace(
            laptop_baud=baud,
            lockstep=SimpleNamespace(laptop_listens=False, sent=[], reached=0),
            reset_by_usb=lambda: None,
            tell_line=lambda text, reply: None,
            receive=lambda time, value, rate: self.arrived.append(value),
        )
        ports = {SERIAL.purpose: take_port("127.0.0.1", PortRequest(0, SERIAL.purpose, "--it"))}
        self.link = BoardLink(LinkContext(engine, BackendSwitch(engine), ports), board)
        self.engine = engine

    def _note(self, event: Event) -> None:
        if isinstance(event, Notice):
            self.told.append(event.text)

    def answer(self, refused: str) -> None:
        assert not refused

    def deliver(self, begin: float, byte: float, data: bytes) -> None:
        raise AssertionError("the board sends nothing")

    def run(self, *writes: int) -> None:
        """A program opens the port, writes so many bytes at a time, and closes it."""
        self.link.opened(self, self.port, 9600)
        for count in writes:
            self.link.written(self, b"x" * count)
        self.link.closed(self, 0)


def run(body: Callable[[], None]) -> None:
    async def within() -> None:
        body()

    asyncio.run(within())


def test_bytes_beyond_the_line_are_lost_and_counted(course_spec: SimulationSpec) -> None:
    def body() -> None:
        line = Line(course_spec, 9600)
        line.link.send(b"x" * 40_000)
        assert not line.told, "a person has sent them"
        line.link.close()
        line = Line(course_spec, 9600)
        line.run(40_000, 1000)
        assert len(line.arrived) == MOST_IN_TRANSIT
        told = [each for each in line.told if "lost" in each]
        assert [f"{40_000 - MOST_IN_TRANSIT} more are lost" in told[0], "8232 bytes of" in told[1]] == [
            True
        ] * 2
        # The next program is told anew.
        line.run(10)
        assert "10 more are lost" in next(each for each in line.told[::-1] if "lost" in each)
        line.link.close()

    run(body)


@pytest.mark.parametrize("sender", ["program", "person"])
def test_a_board_that_has_opened_no_port_may_be_written_to(course_spec: SimulationSpec, sender: str) -> None:
    def body() -> None:
        line = Line(course_spec, 0)
        if sender == "program":
            line.run(3)
        else:
            line.link.send(b"xxx")
        assert len(line.arrived) == 3
        line.link.close()

    run(body)


def test_a_program_that_did_not_find_the_port_is_told(course_spec: SimulationSpec) -> None:
    def body() -> None:
        line = Line(course_spec, 9600)
        line.engine.tell(ProgramEnded(1.0, 0))
        assert line.told[-1].startswith(NOT_CONNECTED)
        before = list(line.told)
        line.link.reached()
        line.engine.tell(ProgramEnded(2.0, 0))
        assert line.told == before
        line.link.close()

    run(body)
