"""One program drives the robot of a set with a dialect, whichever door it comes by; a second is told."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import find_set, init_set, load
from simmer_tui.config.settings import with_any_ports
from simmer_tui.links import driver_lock
from simmer_tui.links.driver_lock import DriverLock
from simmer_tui.links.processes import LONGEST_LOOK, Process, ProcessLookup
from simmer_tui.live.server import Server
from simmer_tui.program.program_command import with_hook
from simmer_tui.robot.program_clock import ProgramClock
from simmer_tui.run.events import NOT_CONNECTED, Event, Notice, ProgramEnded

TIMEOUT = 120.0
DIALECT = '[[command]]\nmatch = "get"\nreply = "{u1:.2f}"\n'


class Told:
    def __init__(self, server: Server, events: queue.SimpleQueue[Event]) -> None:
        self.server = server
        self._events = events

    def until(self, text: str) -> str:
        """Wait for a notice with a text; returns it."""
        while True:
            event = self._events.get(timeout=TIMEOUT)
            if isinstance(event, Notice) and text in event.text:
                return event.text

    def connect(self, purpose: str) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.server.ports[purpose]), TIMEOUT)

    def open_serial(self, *, clock: bool = False) -> socket.socket:
        """A program that opens COM6, as the hook does."""
        sock = self.connect("serial")
        text = json.dumps({"name": "COM6", "baud": 9600, "clock": clock}).encode()
        sock.sendall(b"O" + len(text).to_bytes(4, "big") + text)
        return sock


@contextmanager
def running(tmp_path: Path, clock: str = "real") -> Iterator[Told]:
    """A set with a dialect that is served on all doors."""
    if not (tmp_path / "set").exists():
        init_set(tmp_path / "set", find_set("default"))
        (tmp_path / "set/dialect.toml").write_text(DIALECT, "utf-8")
    made = load(tmp_path / "set")
    server = replace(with_any_ports(made.settings).server, listeners=("binary", "packets", "dialect"))
    motion = replace(made.settings.motion, clock=clock)
    made = replace(made, settings=replace(made.settings, server=server, motion=motion))
    events: queue.SimpleQueue[Event] = queue.SimpleQueue()
    started = Server(made)
    started.start(events.put)
    try:
        yield Told(started, events)
    finally:
        started.stop()


def answer(sock: socket.socket) -> str:
    """Notices to a program that opens the serial port."""
    data = b""
    while len(data) < 5 or len(data) < 5 + int.from_bytes(data[1:5], "big"):
        data += sock.recv(4096)
    return data[13:].decode()


@pytest.mark.parametrize(("purpose", "said"), [("commands", b"u1\n"), ("packets", b"[u1]")])
def test_who_comes_by_another_door_is_told_and_closed(tmp_path: Path, purpose: str, said: bytes) -> None:
    with running(tmp_path) as run:
        first = run.open_serial()
        run.until("opened COM6")
        with run.connect(purpose) as second:
            second.sendall(said)
            assert "a program by COM6 drives the robot" in run.until("turned away")
            assert second.recv(100) == b""
        first.close()
        run.until("closed COM6")
        with run.connect(purpose) as third:
            third.sendall(said)
            assert third.recv(100) or purpose == "packets"
            run.until("client")


def test_a_program_that_drove_by_tcp_gets_no_advice_about_the_serial_port(tmp_path: Path) -> None:
    ended = ProgramEnded(1.0, 0)
    for drives in (True, False):
        with running(tmp_path) as run:
            if drives:
                with run.connect("commands") as first:
                    first.sendall(b"u1\n")
                    first.recv(8)
                run.until("disconnected")
            run.server.call(run.server.engine.tell, ended)
            run.server.call(run.server.engine.tell_fault, "the last one")
            assert run.until("the ").startswith("the last one" if drives else NOT_CONNECTED)


def test_the_serial_port_is_refused_while_a_program_drives_by_tcp(tmp_path: Path) -> None:
    with running(tmp_path) as run:
        with run.connect("commands") as first:
            first.sendall(b"u1\n")
            first.recv(8)
            with run.open_serial() as second:
                assert "Access is denied" in answer(second)
                assert second.recv(100) == b""
            assert "drives the robot, and one program at a time does" in run.until("it was refused")
        run.until("disconnected")
        with run.open_serial() as third:
            assert answer(third) == ""


def test_two_programs_of_one_address_do_not_both_send_packets(tmp_path: Path) -> None:
    program = (
        "import socket, sys\n"
        "sock = socket.create_connection(('127.0.0.1', int(sys.argv[1])))\n"
        "sock.sendall(b'[u1]')\nprint('sent', flush=True)\nsys.stdin.read()\n"
    )
    with running(tmp_path) as run:
        words = [sys.executable, "-c", program, str(run.server.ports["packets"])]
        first = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
        try:
            run.until("sends packets")
            with run.connect("packets") as second:
                if sys.platform == "linux":  # elsewhere they cannot be distinguished
                    assert "drives the robot" in run.until("turned away")
                    assert second.recv(100) == b""
        finally:
            first.communicate(timeout=TIMEOUT)
        if sys.platform == "linux":
            with run.open_serial() as third:  # the program has ended: the robot is free at once
                assert answer(third) == ""


def test_by_the_programs_clock_only_the_started_program_is_served(tmp_path: Path) -> None:
    with running(tmp_path, "program") as run:
        with run.open_serial() as other:
            assert "Access is denied" in answer(other)
        assert "only the program of --run is served" in run.until("it was refused")
        with run.open_serial(clock=True) as own:
            assert answer(own) == ""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells whose a connection is")
def test_by_the_programs_clock_others_are_turned_away_from_tcp_too(tmp_path: Path) -> None:
    program = (
        "import os, socket, time\n"
        "sock = socket.create_connection(('127.0.0.1', int(os.environ['SIMMER_PORT'])))\n"
        "sock.sendall(b'u1\\n')\nprint(len(sock.recv(8)))\n"
        "print('ready', flush=True)\ninput()\n"
    )
    if not (tmp_path / "set").exists():
        init_set(tmp_path / "set", find_set("default"))
        (tmp_path / "set/dialect.toml").write_text(DIALECT, "utf-8")
    (tmp_path / "program.py").write_text(program, "utf-8")
    words = [sys.executable, "-m", "simmer_tui", "--no-ui", "--config", "set", "--clock", "program"]
    words += ["--listeners", "binary,dialect", "--port", "0", "--run", f"{sys.executable} -u program.py"]
    run = subprocess.Popen(
        words,
        cwd=tmp_path,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert run.stdout is not None
    assert run.stderr is not None
    try:
        started = next(line for line in run.stderr if "commands on port" in line)
        port = int(started.split("commands on port ")[1].split(",")[0])
        assert next(line for line in run.stdout if line.strip()) == "8\n"
        with socket.create_connection(("127.0.0.1", port), TIMEOUT) as other:
            other.sendall(b"u1\n")
            assert other.recv(8) == b""
    finally:
        _, rest = run.communicate("\n", timeout=TIMEOUT)
    assert "turned away: by the program's clock only the program of --run is served" in rest


def test_a_read_that_waits_for_long_is_told_with_its_place_and_what_was_written(tmp_path: Path) -> None:
    with running(tmp_path) as run, run.open_serial() as program:
        for kind, payload in ((b"W", b"gett\n"), (b"N", b"robot.py:7")):
            program.sendall(kind + len(payload).to_bytes(4, "big") + payload)
        told = run.until("waits at")
        assert "the program waits at robot.py:7 for bytes that have not come for 10 s" in told
        assert told.endswith("; the last message was 'gett'")


def test_a_program_in_a_folder_called_serial_waits_at_its_own_line(tmp_path: Path) -> None:
    pytest.importorskip("serial")
    program = tmp_path / "serial" / "robot.py"
    program.parent.mkdir()
    program.write_text(
        "import sys\ndel sys.path[0]\nimport serial, simmer_serial\n"
        "simmer_serial._LONG = 0.01\nserial.Serial('COM6').read_until()\n",
        "utf-8",
    )
    with running(tmp_path) as run:
        variables = with_hook({**os.environ, **run.server.environment})
        process = subprocess.Popen([sys.executable, program], env=variables)
        try:
            assert "the program waits at robot.py:5 for bytes" in run.until("waits at")
        finally:
            process.kill()
            process.wait()


def test_the_process_of_a_packet_connection_is_looked_up_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each look-up reads /proc, before the first byte of the packet is."""
    looked_up: list[str] = []

    class Processes(ProcessLookup):
        def holder(
            self, sock: socket.socket, peer: str, known: Process | None, longest: float = LONGEST_LOOK
        ) -> Process | None:
            looked_up.append(peer)
            return self.of_run

    processes, clock, link = Processes(), ProgramClock(), object()
    processes.of_run = Process(pid=7, started=1)
    monkeypatch.setattr(driver_lock, "session_of", lambda pid: pid)
    with contextlib.closing(processes), socket.socket() as sock:
        lock = DriverLock(clock, processes)
        decided: list[str] = []
        lock.acquire_by_process(link, sock, "127.0.0.1:5", decided.append)
        lock.acquire_by_process(link, sock, "127.0.0.1:6", decided.append)
        assert decided == ["", ""]
    assert looked_up == ["127.0.0.1:5", "127.0.0.1:6"]
