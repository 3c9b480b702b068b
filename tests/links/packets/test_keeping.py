"""A reply is kept while its program lives, and goes with it."""

from __future__ import annotations

import math
import os
import socket
import subprocess
import sys
from dataclasses import dataclass
from typing import Any

import pytest

from simmer_tui.links.packet_presence import LONGEST_KEPT
from simmer_tui.links.processes import ProcessLookup

linux_only = pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells whose a connection is")
IDLE = 10.0


@dataclass(eq=False)
class Program:
    lives: bool = True
    age: float = math.inf


class Programs:
    """The programs behind connections, as a test says."""

    def __init__(self, *programs: Program | None) -> None:
        self.now: Program | None = programs[0]
        self.of_run: Program | None = None

    def holder(self, sock: socket.socket, peer: str, known: Any) -> Any:
        return self.now


async def long_after(bench: Any, seconds: float) -> None:
    """Time passes in steps, so that every timer is called when it is due."""
    for _ in range(int(seconds)):
        await bench.clock.pass_by(1.0)


@pytest.mark.parametrize("pause", [12, 300, LONGEST_KEPT - 5])
def test_a_reply_waits_while_the_program_that_asked_pauses(on_clock: Any, pause: float) -> None:
    async def scenario(bench: Any) -> None:
        await bench.send(b"[m0]", 1)
        await long_after(bench, pause)
        assert await bench.read() == b"[m0:0.0]"
        assert bench.left == 0

    on_clock(scenario, link={"processes": Programs(Program())})


def test_it_goes_with_its_program_and_after_ten_minutes(on_clock: Any) -> None:
    programs = Programs(Program())

    async def scenario(bench: Any) -> None:
        await bench.send(b"[m0]", 1)
        await long_after(bench, LONGEST_KEPT + 1)
        assert "1 replies dropped: client 127.0.0.1 left without reading them" in bench.notices
        await bench.send(b"[m0]", 1)
        await long_after(bench, 3 * IDLE)
        assert bench.left == 1
        assert programs.now is not None
        programs.now.lives = False
        await long_after(bench, IDLE + 1)
        assert bench.left == 2

    on_clock(scenario, link={"processes": programs})


def test_where_no_process_is_known_it_waits_as_long_as_is_idle(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        await bench.send(b"[m0]", 1)
        await long_after(bench, IDLE + 1)
        assert bench.left == 1

    on_clock(scenario, link={"processes": Programs(None)})


def test_another_program_that_asks_gets_its_own_reply_alone(on_clock: Any) -> None:
    programs = Programs(Program())

    async def scenario(bench: Any) -> None:
        await bench.send(b"[m0]", 1)
        await long_after(bench, 2)
        programs.now = Program()
        await bench.send(b"[m1]", 1)
        assert await bench.read() == b"[m1:0.0]"
        assert "1 replies dropped: another program asks" in bench.notices

    on_clock(scenario, link={"processes": programs})


def test_the_next_program_of_an_interpreter_gets_its_own_reply_alone(on_clock: Any) -> None:
    """An interpreter outlives its programs: what the one before never read is not the next one's."""

    async def scenario(bench: Any) -> None:
        await bench.send(b"[m0]", 1)
        await long_after(bench, 15)
        await bench.send(b"[m1]", 1)
        assert await bench.read() == b"[m1:0.0]"
        assert "1 replies dropped: its program asks again after 15 s" in bench.notices

    on_clock(scenario, link={"processes": Programs(Program())})


def test_who_closed_before_it_could_be_seen_is_known_by_its_last_read(on_clock: Any) -> None:
    """As simmer-python's programs do."""
    programs = Programs(None)

    async def scenario(bench: Any) -> None:
        await bench.send(b"[m0]", 1)
        programs.now = Program()
        await long_after(bench, 1)
        assert await bench.read() == b"[m0:0.0]"
        programs.now = None
        await long_after(bench, 1)
        await bench.send(b"[m1]", 1)
        await long_after(bench, 60)
        assert await bench.read() == b"[m1:0.0]"

    on_clock(scenario, link={"processes": programs})


def test_a_program_that_reads_gets_nothing_that_was_asked_for_before_it_began(on_clock: Any) -> None:
    """Both close their requests before anybody can look whose they are, as simmer-python's programs do."""
    programs = Programs(None)

    async def scenario(bench: Any) -> None:
        await bench.send(b"[m0]", 1)
        await long_after(bench, 2)
        await bench.send(b"[m1]", 1)
        await long_after(bench, 1)
        programs.now = Program(age=1.5)
        assert await bench.read() == b"[m1:0.0]"
        assert "1 replies dropped: the program that reads was not there yet" in bench.notices

    on_clock(scenario, link={"processes": programs})


def test_a_program_that_only_reads_gets_what_another_has_asked_for(on_clock: Any) -> None:
    """As in a shell: one `nc` asks, the next one reads."""
    programs = Programs(None)

    async def scenario(bench: Any) -> None:
        await bench.send(b"[m0]", 1)
        await long_after(bench, 2)
        programs.now = Program(age=0.1)
        assert await bench.read() == b"[m0:0.0]"

    on_clock(scenario, link={"processes": programs})


def test_a_reply_to_a_program_of_the_run_waits_while_that_lives(on_clock: Any) -> None:
    """Its first request may be closed before anybody can look whose it was."""
    programs, of_run = Programs(None), Program()
    programs.of_run = of_run

    async def scenario(bench: Any) -> None:
        await bench.send(b"[m0]", 1)
        await long_after(bench, 60)
        assert await bench.read() == b"[m0:0.0]"
        await bench.send(b"[m0]", 1)
        of_run.lives = False
        await long_after(bench, IDLE + 1)
        assert bench.left == 1

    on_clock(scenario, link={"processes": programs})


@linux_only
def test_the_system_says_which_process_a_connection_is_of_and_whether_it_lives() -> None:
    lookup = ProcessLookup()
    code = (
        "import socket, sys; s = socket.create_connection(('127.0.0.1', int(sys.argv[1]))); sys.stdin.read()"
    )
    with socket.create_server(("127.0.0.1", 0)) as server:
        # A child that fails must not hold up the tests.
        server.settimeout(30.0)
        port = str(server.getsockname()[1])
        child = subprocess.Popen([sys.executable, "-c", code, port], stdin=subprocess.PIPE)
        accepted, there = server.accept()
        peer = f"{there[0]}:{there[1]}"
        with accepted, child:
            process = lookup.holder(accepted, peer, None)
            assert process is not None
            assert (process.pid, process.lives) == (child.pid, True)
            assert lookup.holder(accepted, peer, process) == process
            child.communicate(b"\n")
            assert not process.lives
            assert lookup.holder(accepted, peer, process) is None
        with socket.create_connection(server.getsockname()) as own:
            accepted, there = server.accept()
            with accepted:
                known = lookup.holder(accepted, f"{there[0]}:{there[1]}", process)
                assert known is not None
                assert known.pid == os.getpid()
                assert own.fileno() >= 0
    lookup.close()
