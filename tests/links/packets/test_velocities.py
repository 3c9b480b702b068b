"""A velocity that came in a packet is its program's, which closes each connection after one message."""

from __future__ import annotations

from typing import Any

import pytest

from simmer_tui.run.events import VelocityEnd, VelocityEnded
from tests.links.packets.test_keeping import IDLE, Program, Programs, long_after


def endings(bench: Any) -> list[VelocityEnd]:
    return [event.reason for event in bench.events if isinstance(event, VelocityEnded)]


def test_it_goes_on_when_the_connection_is_closed(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        begun = bench.simulator.pose
        await bench.send(b"[vv-1;0;0]", 1)
        await bench.send(b"[wt-2]", 1)
        assert bench.simulator.velocity.moves
        assert bench.simulator.pose.y - begun.y == pytest.approx(2.0)
        assert not endings(bench)

    on_clock(scenario, engine={"timed": False}, link={"processes": Programs(Program())})


def test_it_ends_with_its_process_though_another_program_asks_on(on_clock: Any) -> None:
    first = Program()
    programs = Programs(first)

    async def scenario(bench: Any) -> None:
        await bench.send(b"[vv-0;0;1]", 1)
        await long_after(bench, 5 * IDLE)
        assert bench.simulator.velocity.moves
        programs.now = Program()
        await bench.send(b"[m0]", 1)
        first.lives = False
        await long_after(bench, 1)
        assert endings(bench) == [VelocityEnd.LEFT]
        assert not bench.simulator.velocity.moves

    on_clock(scenario, link={"processes": programs})


def test_where_no_process_is_known_it_ends_after_idle(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        await bench.send(b"[vv-0;0;1]", 1)
        await long_after(bench, IDLE - 2)
        await bench.send(b"[m0]", 1)
        await bench.read()
        await long_after(bench, IDLE - 2)
        assert bench.simulator.velocity.moves
        await long_after(bench, 4)
        assert endings(bench) == [VelocityEnd.LEFT]

    on_clock(scenario, link={"processes": Programs(None)})


def test_it_stays_its_programs_when_that_sends_it_again(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        for speed in range(1, 4):
            await bench.send(b"[vv-0;0;%d]" % speed, 1)
            await long_after(bench, IDLE)
        assert not endings(bench)
        await bench.send(b"[vv-0;0;0]", 1)
        await long_after(bench, 2 * IDLE)
        assert not endings(bench)

    on_clock(scenario, link={"processes": Programs(Program())})


@pytest.mark.parametrize("age", [60.0, 0.1])
def test_a_sender_that_closed_before_it_was_seen_is_known_by_its_read(on_clock: Any, age: float) -> None:
    """As simmer-python's programs do. One that began after the request is not its sender."""
    programs, reader = Programs(None), Program(age=age)

    async def scenario(bench: Any) -> None:
        await bench.send(b"[vv-0;0;1]", 1)
        await long_after(bench, 2)
        assert sum("its velocity lasts up to 10 s (--idle)" in text for text in bench.notices) == 1
        programs.now = reader
        assert await bench.read()
        reader.lives = False
        await long_after(bench, 1)
        assert endings(bench) == ([VelocityEnd.LEFT] if age > 2 else [])
        await long_after(bench, IDLE)
        assert endings(bench) == [VelocityEnd.LEFT]

    on_clock(scenario, link={"processes": programs})
