"""A reply waits for its reader, and goes when the next program begins."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import socket
import subprocess
import sys
import threading
from dataclasses import dataclass
from typing import Any

import pytest

from simmer_tui.links import processes
from simmer_tui.links.packet_replies import LONGEST_KEPT
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

    def seek(self, sock: socket.socket, peer: str, known: Any, found: Any) -> None:
        found(self.now)


async def long_after(bench: Any, seconds: float) -> None:
    """Time passes in steps, so that every timer is called when it is due."""
    for _ in range(int(seconds)):
        await bench.clock.pass_by(1.0)


@pytest.mark.parametrize("seen", [True, False])
@pytest.mark.parametrize("pause", [12, LONGEST_KEPT - 5])
def test_a_reply_waits_for_its_reader_for_ten_minutes(on_clock: Any, pause: float, seen: bool) -> None:
    """A program that closes its request at once may not be seen, and is halted in a debugger."""

    async def scenario(bench: Any) -> None:
        await bench.send(b"[m0]", 1)
        await long_after(bench, pause)
        assert bench.left == (not seen)
        assert await bench.read() == b"[m0:0.0]"
        await bench.send(b"[m1]", 1)
        await long_after(bench, LONGEST_KEPT + IDLE + 1)
        assert "1 replies dropped: not read for 10 min" in bench.notices
        assert bench.link.mailbox.oldest == math.inf

    on_clock(scenario, link={"processes": Programs(Program() if seen else None)})


def test_a_reader_drops_nothing_and_a_program_that_begins_all_from_before(on_clock: Any) -> None:
    """As in a shell: one `nc` asks, the next one reads. A program is another one once the last has ended."""
    first, second, reader = Program(), Program(), Program(age=0.1)
    programs = Programs(first)

    async def scenario(bench: Any) -> None:
        await bench.send(b"[m0]", 1)
        first.lives = False
        programs.now = reader
        await long_after(bench, 2)
        assert await bench.read() == b"[m0:0.0]"
        programs.now = first
        first.lives = True
        await long_after(bench, 2)
        await bench.send(b"[m0]", 1)
        programs.now = second
        await long_after(bench, 2)
        await bench.send(b"[m1]", 1)
        assert await bench.read() == b"[m0:0.0,m1:0.0]", "two programs at once"
        await bench.send(b"[m0]", 1)
        second.lives = False
        programs.now = None
        await long_after(bench, 2)
        await bench.send(b"[m1]", 1)
        assert await bench.read() == b"[m1:0.0]", "the one before has ended"
        assert "1 replies dropped: another program asks" in bench.notices

    on_clock(scenario, link={"processes": programs})


@pytest.mark.parametrize("seen", [True, False])
def test_the_next_program_of_an_interpreter_gets_its_own_reply_alone(on_clock: Any, seen: bool) -> None:
    """An interpreter outlives its programs: what the one before never read is not the next one's."""

    async def scenario(bench: Any) -> None:
        await bench.send(b"[m0]", 1)
        await long_after(bench, 15)
        await bench.send(b"[m1]", 1)
        assert await bench.read() == b"[m1:0.0]"
        assert any(text.startswith("1 replies dropped: ") for text in bench.notices)

    on_clock(scenario, link={"processes": Programs(Program() if seen else None)})


def test_a_program_stays_a_client_while_its_reply_waits(on_clock: Any) -> None:
    """A program of --run may close its request before anybody can look whose it was."""
    programs, of_run = Programs(None), Program()
    programs.of_run = of_run

    async def scenario(bench: Any) -> None:
        await bench.send(b"[m0]", 1)
        await long_after(bench, 3 * IDLE)
        assert bench.left == 0
        of_run.lives = False
        await long_after(bench, IDLE + 1)
        assert bench.left == 1
        assert await bench.read() == b"[m0:0.0]"

    on_clock(scenario, link={"processes": programs})


@linux_only
def test_connections_that_wait_are_looked_for_together_and_in_another_thread(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """500 look-ups in the robot's thread kept it busy for seconds."""
    passes: list[int] = []
    search = processes._search

    def counted(*arguments: Any) -> Any:
        passes.append(threading.get_ident())
        return search(*arguments)

    monkeypatch.setattr(processes, "_search", counted)
    lookup, found = ProcessLookup(), []

    async def look() -> None:
        with socket.create_server(("127.0.0.1", 0)) as server, contextlib.ExitStack() as stack:
            for number in range(20):
                near = stack.enter_context(socket.create_connection(server.getsockname()))
                far, there = server.accept()
                stack.enter_context(far)
                if number == 10:
                    near.close()
                peer = f"{there[0]}:{there[1]}"
                lookup.seek(far, peer, None, lambda process, number=number: found.append((number, process)))
            while len(found) < 20:
                await asyncio.sleep(0.001)

    asyncio.run(look())
    lookup.close()
    assert [number for number, _ in found] == [*range(20)], "in order, though one was closed"
    assert {process and process.pid for number, process in found if number != 10} == {os.getpid()}
    assert found[10][1] is None
    assert len(passes) == 1
    assert passes != [threading.get_ident()]


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
