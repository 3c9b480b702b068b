"""The program's clock: the same run every time, and what it cannot follow, with real programs."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.robot.program_clock import ProgramClock, ProgramWait
from tests.in_process import simmer

FOLLOWER = """
import time
from simmer_tui.client import Robot
with Robot(protocol="{protocol}") as robot:
    began = time.monotonic()
    while time.monotonic() - began < {seconds}:
        ahead, left = robot.read("u1"), robot.read("u2")
        robot.send("vv-%g;0;%g" % ((4, 5 * (left - 4)) if ahead > 6 else (0, 60)))
        robot.believe(ahead, left, 0)
        time.sleep(0.02)
    robot.send("vv-0;0;0")
    until = time.time() + 0.5
    while time.time() < until:
        pass
    robot.drive("d1", 2)
    print(time.perf_counter())
"""


def run(tmp_path: Path, program: str, *options: str, flags: str = "") -> subprocess.CompletedProcess[str]:
    """A program by its own clock, without the screen; its log is run.jsonl."""
    (tmp_path / "program.py").write_text(textwrap.dedent(program), "utf-8")
    (tmp_path / "run.jsonl").unlink(missing_ok=True)
    words = ["--no-ui", "--seed", "3", "--port", "0", "--clock", "program", "--log", "run.jsonl"]
    return simmer(*words, *options, "--run", f'"{sys.executable}" {flags} program.py', cwd=tmp_path)


def log_of(tmp_path: Path) -> list[dict[str, Any]]:
    """The events, without what the system drew: real times and the numbers of ports."""
    lines = [json.loads(line) for line in (tmp_path / "run.jsonl").read_text("utf-8").splitlines()[1:]]
    kept = [line for line in lines if line["kind"] != "notice"]
    return [{key: value for key, value in line.items() if key not in ("real", "client")} for line in kept]


def test_a_program_that_sleeps_has_the_same_run_every_time(tmp_path: Path) -> None:
    program = FOLLOWER.format(seconds=0.7, protocol="binary")
    first = run(tmp_path, program)
    log = log_of(tmp_path)
    assert first.returncode == 0, first.stderr
    assert 1.2 < float(first.stdout) < 1.8
    again = run(tmp_path, program)
    assert again.stdout == first.stdout
    assert log_of(tmp_path) == log
    assert sum(line["kind"] == "leg" for line in log) > 30


@pytest.mark.slow
@pytest.mark.parametrize("dialect", ["binary", "packets"])
def test_five_runs_of_a_follower_are_the_same_and_rerun_exactly(tmp_path: Path, dialect: str) -> None:
    program = FOLLOWER.format(seconds=20, protocol=dialect)
    logs = []
    for _ in range(5):
        ended = run(
            tmp_path, program, "--listeners", dialect, "--packet-port", "0", "--packet-reply-port", "0"
        )
        assert ended.returncode == 0, ended.stderr
        logs.append(log_of(tmp_path))
    assert all(log == logs[0] for log in logs)
    rerun = simmer("rerun", "run.jsonl", cwd=tmp_path)
    assert "every reply the same" in rerun.stdout


def test_computing_costs_no_time_and_a_sleep_is_exact(tmp_path: Path) -> None:
    program = """
        import time
        from simmer_tui.client import Robot
        with Robot() as robot:
            before = time.time_ns()
            sum(range(1_000_000))
            time.sleep(0.25)
            print(time.time_ns() - before, time.gmtime(before // 10**9)[:3])
            time.sleep(-0.0)
            for wrong in (-1, "1"):
                try:
                    time.sleep(wrong)
                except (ValueError, TypeError) as error:
                    print(type(error).__name__)
    """
    ended = run(tmp_path, program)
    assert ended.stdout.splitlines() == ["250005000 (2026, 1, 1)", "ValueError", "TypeError"]


@pytest.mark.slow
def test_replies_are_all_there_however_quickly_a_program_reads(tmp_path: Path) -> None:
    """The second of two replies is on its way when the first is read: a read gets both, every time."""
    program = """
        import fcntl, os, socket, struct, termios, time
        sock = socket.create_connection(("127.0.0.1", int(os.environ["SIMMER_PORT"])))
        sock.settimeout(5.0)
        sizes = set()
        for _ in range(100):
            sock.sendall(b"u1\\n")
            while struct.unpack("i", fcntl.ioctl(sock, termios.FIONREAD, bytes(4)))[0] < 8:
                pass
            sock.sendall(b"u2\\n")
            sizes.add(len(sock.recv(100)))
        print(sizes)
    """
    assert run(tmp_path, program, "--reply-port", "0").stdout.strip() == "{16}"


@pytest.mark.slow
def test_a_socket_times_out_by_this_clock_whatever_its_timeout(tmp_path: Path) -> None:
    program = """
        import os, socket, time
        sock = socket.create_connection(("127.0.0.1", int(os.environ["SIMMER_PORT"])))
        before, waited = time.monotonic(), 0.0
        for place in range(1, 40):
            waited += 1 / (3 * place)
            sock.settimeout(1 / (3 * place))
            try:
                sock.recv(8)
            except TimeoutError:
                pass
        print(round(time.monotonic() - before - waited, 2))
    """
    assert run(tmp_path, program).stdout.strip() == "0.0"


@pytest.mark.slow
def test_a_child_lives_by_the_same_clock(tmp_path: Path) -> None:
    program = """
        import subprocess, sys, time
        before = time.monotonic()
        child = "import time; time.sleep(100)"
        subprocess.run([sys.executable, "-c", child], check=True)
        print(round(time.monotonic() - before, 3))
    """
    assert run(tmp_path, program).stdout.strip() == "100.0"


def test_a_wait_for_a_reply_that_never_comes_ends_the_program_with_its_line(tmp_path: Path) -> None:
    program = """
        import os, socket
        socket.create_connection(("127.0.0.1", int(os.environ["SIMMER_PORT"]))).recv(8)
    """
    ended = run(tmp_path, program)
    assert ended.returncode == 2
    assert "program.py:3: the program waits for a reply that never comes. Nothing more" in ended.stderr


def test_a_program_out_of_reach_is_told_and_goes_by_the_real_clock(tmp_path: Path) -> None:
    package = Path(__file__).parent.parent.parent
    program = f"""
        import sys
        sys.path.insert(0, {str(package)!r})
        from simmer_tui.client import Robot
        with Robot() as robot:
            robot.drive("d1", 1)
            print("there")
    """
    ended = run(tmp_path, program, flags="-I")
    assert ended.stdout.strip() == "there"
    assert "the program's clock does not reach this program" in ended.stderr


@pytest.mark.slow
def test_a_mission_ends_at_its_time_inside_a_sleep(tmp_path: Path) -> None:
    program = """
        import time
        from simmer_tui.client import Robot
        with Robot() as robot:
            robot.read("u1")
            time.sleep(100_000)
            print("after")
    """
    ended = run(tmp_path, program, "--mission")
    assert "after" not in ended.stdout
    assert ended.returncode == 1
    end = next(line for line in log_of(tmp_path) if line["kind"] == "mission" and line.get("reason"))
    assert end["t"] == pytest.approx(300.0, abs=1e-6)


def test_it_needs_a_program_and_no_screen(tmp_path: Path) -> None:
    ended = simmer("--no-ui", "--clock", "program", cwd=tmp_path)
    assert ended.returncode == 2
    assert (
        "--clock program: follows the clock of a Python program that is run: it needs --run" in ended.stderr
    )


class Process:
    """A process of the program, with the times it was woken at."""

    def __init__(self, clock: ProgramClock) -> None:
        self.woken: list[float] = []
        self.stuck = 0
        self.wait = ProgramWait(self.woken.append, self._stick)
        clock.join(self.wait)

    def _stick(self) -> None:
        self.stuck += 1


def test_time_stands_while_a_process_computes_and_moves_to_the_next_that_is_due() -> None:
    clock = ProgramClock()
    assert not clock.advance(1.0)  # no program yet
    one, other = Process(clock), Process(clock)
    clock.wait(one.wait, 1000.3, listens=False, sent=0)
    assert not clock.advance(math.inf)
    assert clock.now == 0.0
    clock.wait(other.wait, 1000.5, listens=False, sent=0)
    assert clock.advance(7.25)
    assert clock.now == 7.25
    assert not clock.advance(2000.0)
    assert (one.woken, other.woken, clock.now) == ([1000.3], [], 1000.3)
    clock.leave(one.wait)
    assert not clock.advance(math.inf)
    assert other.woken == [1000.5]


def test_who_waits_for_a_reply_looks_first_and_for_ever_is_told() -> None:
    clock = ProgramClock()
    one = Process(clock)
    clock.note()
    clock.wait(one.wait, math.inf, listens=True, sent=0)
    assert not clock.advance(5.0)
    assert (one.woken, clock.now) == ([0.0], 0.0)
    clock.wait(one.wait, math.inf, listens=True, sent=0)
    assert clock.advance(5.0)
    clock.wait(one.wait, math.inf, listens=True, sent=0)
    clock.advance(math.inf)  # the timer at 5 may have brought the reply
    clock.wait(one.wait, math.inf, listens=True, sent=0)
    assert not clock.advance(math.inf)
    assert one.stuck == 1


def test_a_wait_that_begins_later_is_over_by_what_was_sent_until_then_or_by_what_comes_after() -> None:
    clock = ProgramClock()
    one = Process(clock)

    def wait(until: float, begin: float) -> None:
        clock.wait(one.wait, until, listens=True, sent=0, begin=begin)

    wait(8.0, 2.0)
    clock.count_written(7, 5)
    clock.note()
    assert not clock.advance(math.inf)  # it had begun to wait when the reply came
    assert (one.woken, clock.now) == ([2.0], 2.0)
    one.wait.written.clear()
    wait(8.0, 3.0)
    clock.note()  # its own bytes have arrived
    assert clock.advance(math.inf)
    assert (one.woken, clock.now) == ([2.0], 3.0)
    assert clock.advance(4.0)  # a timer may bring the reply
    assert not clock.advance(math.inf)
    assert one.woken == [2.0, 4.0]
    wait(5.0, 4.0)
    assert not clock.advance(math.inf)
    assert one.woken == [2.0, 4.0, 5.0]
    wait(math.inf, 5.0)
    assert not clock.advance(math.inf)
    assert one.stuck == 1


@pytest.mark.parametrize(("arrives", "woken"), [(1.5, 2.25), (3.25, 3.25), (9.0, 8.0)])
def test_boards_run_on_beyond_the_beginning_of_a_wait(arrives: float, woken: float) -> None:
    clock = ProgramClock()
    one = Process(clock)
    runs = []

    def run(until: float) -> float:
        runs.append(until)
        if clock.now < arrives <= until and not one.wait.written:
            clock.count_written(7, 1)
            clock.note()
            return arrives
        return until

    clock.boards = run
    clock.wait(one.wait, 8.0, listens=True, sent=0, begin=2.25)
    while clock.advance(math.inf):
        pass
    assert one.woken == [woken]
    assert (2.25 in runs) == (arrives < 2.25)


def test_a_process_that_waits_for_another_does_not_hold_time() -> None:
    clock = ProgramClock()
    parent, child = Process(clock), Process(clock)
    child.wait.parent = parent.wait
    clock.step_aside(parent.wait)
    clock.wait(child.wait, 2.0, listens=False, sent=0)
    assert not clock.advance(math.inf)
    assert child.woken == [2.0]
    clock.leave(child.wait)
    assert not clock.advance(9.0)
    assert clock.now == 2.0


def test_a_process_that_steps_aside_may_have_ended_a_wait_and_may_do_so_when_it_is_back() -> None:
    clock = ProgramClock()
    parent, child = Process(clock), Process(clock)
    child.wait.parent = parent.wait
    clock.wait(child.wait, math.inf, listens=True, sent=0)
    clock.step_aside(parent.wait)
    assert not clock.advance(math.inf)
    assert child.woken == [0.0]  # it looks
    clock.wait(child.wait, math.inf, listens=True, sent=0, again=True)
    assert not clock.advance(math.inf)
    assert (child.woken, child.stuck) == ([0.0], 0)
    parent.wait.away = False
    clock.wait(parent.wait, 0.0, listens=False, sent=0)
    assert not clock.advance(math.inf)
    assert (child.woken, parent.woken) == ([0.0, 0.0], [])


def test_processes_run_one_at_a_time_in_the_order_of_their_times_and_waits() -> None:
    clock = ProgramClock()
    one, two, three = Process(clock), Process(clock), Process(clock)
    clock.wait(two.wait, 3.0, listens=False, sent=0)
    clock.wait(three.wait, 2.0, listens=False, sent=0)
    clock.wait(one.wait, 3.0, listens=False, sent=0)
    woken = []
    for _ in range(3):
        assert not clock.advance(math.inf)
        assert not clock.advance(math.inf)  # it computes: nobody else is woken
        runs = next(each for each in (one, two, three) if each.wait.until is None)
        woken.append((runs, clock.now))
        clock.leave(runs.wait)
    assert woken == [(three, 2.0), (two, 3.0), (one, 3.0)]


def test_who_listens_looks_once_another_has_done_something_and_not_after_a_look() -> None:
    clock = ProgramClock()
    one, two = Process(clock), Process(clock)
    clock.wait(two.wait, 9.0, listens=True, sent=0)
    clock.wait(one.wait, 5.0, listens=False, sent=0)
    assert not clock.advance(math.inf)
    assert (two.woken, one.woken) == ([0.0], [])
    clock.wait(two.wait, 9.0, listens=True, sent=0, again=True)
    assert not clock.advance(math.inf)
    assert (two.woken, one.woken) == ([0.0], [5.0])


def test_time_stands_until_the_end_of_a_process_has_been_seen() -> None:
    clock = ProgramClock()
    one = Process(clock)
    clock.wait(one.wait, 5.0, listens=False, sent=0)
    clock.unconfirmed.add(17)
    assert not clock.advance(math.inf)
    assert one.woken == []
    clock.unconfirmed.discard(17)
    clock.advance(math.inf)
    assert one.woken == [5.0]


def test_bytes_on_their_way_are_waited_for() -> None:
    clock = ProgramClock()
    one = Process(clock)
    clock.wait(one.wait, 3.0, listens=False, sent=12)
    clock.received += 5
    assert clock.is_behind
    clock.received += 7
    assert not clock.is_behind
