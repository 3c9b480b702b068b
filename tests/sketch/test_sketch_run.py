"""Both programs of a team in one run: the laptop's, unchanged, and the sketch of its board."""

from __future__ import annotations

import json
import os
import queue
import re
import signal
import socket
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from simmer_tui.cli.command_line import ExitCode
from simmer_tui.cli.main import main
from simmer_tui.cli.run_life import FrontEnd, RunLife
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.settings import with_any_ports
from simmer_tui.live.server import Server
from simmer_tui.run.events import Event, ProgramEnded
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.sketch_robot import compile_set, with_boards
from simmer_tui.sketch.wiring import wiring_of
from tests.sketch.rovers import DRIVE, MOTORS, ROVER, STOPPABLE, made_set

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler"),
]
LAPTOP = """
import serial, time
port = serial.Serial("COM6", 9600, timeout=1)
time.sleep(0.3)
port.write(b"F"); time.sleep(0.4); port.write(b"?"); print(port.readline()); port.write(b"S")
time.sleep(0.2)
"""
ANSWERS = STOPPABLE.replace(
    "if (what == 'S')", "if (what == '?') Serial.println(millis());\n  if (what == 'S')"
)


def run(folder: Path, log: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [
        sys.executable,
        "-m",
        "simmer_tui",
        "--no-ui",
        "--sketch",
        str(folder),
        "--port",
        "0",
        "--seed",
        "4",
    ]
    return subprocess.run(
        [*command, "--log", str(log), *options],
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        check=False,
    )


def records(log: Path) -> list[dict[str, Any]]:
    """The records of a log without what is of the real clock, or of the system's ports."""
    made = [json.loads(line) for line in log.read_text("utf-8").splitlines()]
    kept = [each for each in made if each["kind"] not in ("header", "program")]
    return [{key: each[key] for key in each if key not in ("real", "subject")} for each in kept]


def test_a_program_and_its_board_run_twice_the_same(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    made_set(folder, ROVER + MOTORS, {"rover.ino": ANSWERS})
    program = tmp_path / "laptop.py"
    program.write_text(LAPTOP, "utf-8")
    words = ("--clock", "program", "--run", f"{sys.executable} {program}")
    done = [run(folder, tmp_path / f"{name}.jsonl", *words) for name in ("first", "second")]
    assert [each.returncode for each in done] == [0, 0], done[0].stderr
    assert "b'70" in done[0].stdout
    first, second = records(tmp_path / "first.jsonl"), records(tmp_path / "second.jsonl")
    assert first == second
    wires = [(each["data"], bool(each.get("reply"))) for each in first if each["kind"] == "wire"]
    assert wires[0] == ("F", False)
    assert wires[-1] == ("S", False)
    assert next(each.get("cmd") for each in first if each["kind"] == "answer") == "ww-12;0"
    header = json.loads((tmp_path / "first.jsonl").read_text("utf-8").split("\n", 1)[0])
    assert header["sketches"]["rover"].startswith("rover.ino ")
    log = str(tmp_path / "first.jsonl")
    assert main(["rerun", log, "--sketch", str(folder)]) == 0
    assert main(["rerun", log]) == 0
    # Another sketch is not that of the run; another byte of the laptop makes another run.
    changed = tmp_path / "changed.jsonl"
    changed.write_text(
        (tmp_path / "first.jsonl").read_text("utf-8").replace('"data":"?"', '"data":"x"'), "utf-8"
    )
    assert main(["rerun", str(changed), "--sketch", str(folder)]) == 1
    (folder / "rover.ino").write_text(STOPPABLE, "utf-8")
    assert main(["rerun", log, "--sketch", str(folder)]) == 2


READY = """
void setup() { Serial.begin(9600); Serial.println("ready"); }
void loop() { if (Serial.available()) { Serial.read(); Serial.println(millis()); } }
"""
READS = """
import serial, time
time.sleep(0.3)
port = serial.Serial("COM6", 9600, timeout=5)
print(port.readline())
port.write(b"?")
print(int(port.readline()) < 1000)
"""


def test_opening_the_usb_port_resets_the_board(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    made_set(folder, ROVER + MOTORS, {"rover.ino": READY})
    program, log = tmp_path / "laptop.py", tmp_path / "run.jsonl"
    program.write_text(READS, "utf-8")
    done = run(folder, log, "--run", f"{sys.executable} {program}")
    assert done.stdout.endswith("b'ready\\r\\n'\nTrue\n"), done.stdout + done.stderr
    assert main(["rerun", str(log), "--sketch", str(folder)]) == 0


def test_a_board_that_dies_fails_the_mission(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "set"
    text = "void setup() {}\nvoid loop() {\n  delay(100);\n  volatile int *place = 0; *place = 1;\n}\n"
    made_set(folder, ROVER + MOTORS, {"rover.ino": text})
    done = run(folder, tmp_path / "run.jsonl", "--mission")
    assert done.returncode == 1, done.stderr
    assert "mission: failed" in done.stderr
    assert "board rover died at rover.ino:4" in done.stderr
    # The mission ended then too, and the report has that time, not that of the event before it.
    assert "failed after 0.1 s" in done.stderr
    main(["report", str(tmp_path / "run.jsonl")])
    assert re.search(r"\n +0\.10 +[^\n]*board rover died", capsys.readouterr().out)


def test_a_quiet_run_tells_why_a_board_has_died(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    made_set(folder, ROVER + MOTORS, {"rover.ino": "void setup() { delay(50); abort(); }\nvoid loop() {}\n"})
    done = run(folder, tmp_path / "run.jsonl", "--quiet", "--mission")
    assert done.returncode == 1
    assert re.search(r"the boards have ended: board rover died at rover\.ino:1 .*", done.stderr), done.stderr
    assert "verdict" not in done.stderr


def test_a_program_opens_a_port_that_no_board_has(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    wiring = ROVER.partition("[laptop]")[0] + MOTORS
    made_set(folder, wiring, {"rover.ino": "void setup() {}\nvoid loop() {}\n"})
    program = tmp_path / "laptop.py"
    program.write_text(LAPTOP, "utf-8")
    for clock in ("program", "real"):
        log = tmp_path / f"{clock}.jsonl"
        done = run(folder, log, "--clock", clock, "--run", f"{sys.executable} {program}")
        assert done.returncode == 1
        why = "wiring.toml has no [laptop], the line of a board to the program. Add it, with board = "
        assert f"could not open port 'COM6': {why}" in done.stdout + done.stderr
        assert f"a program opened COM6, but {why}" in done.stderr


def test_by_the_programs_clock_time_stops_at_the_death_of_a_board(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    text = "void setup() {}\nvoid loop() {\n  delay(100);\n  volatile int *place = 0; *place = 1;\n}\n"
    made_set(folder, ROVER + MOTORS, {"rover.ino": text})
    program, log = tmp_path / "laptop.py", tmp_path / "run.jsonl"
    # A program that ends only when it is killed.
    program.write_text(
        "import signal, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "while True:\n    time.sleep(0.01)\n"
    )
    done = run(folder, log, "--mission", "--clock", "program", "--run", f"{sys.executable} {program}")
    assert done.returncode == 1, done.stderr
    times = [float(each) for each in re.findall(r'"t": ?([0-9.]+)', log.read_text("utf-8"))]
    assert max(times) < 0.101


class Screen(FrontEnd):
    """A front end that goes on after the end of its run, as the app does, until the program has ended."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._ends: queue.Queue[int] = queue.Queue()

    def watch(self, event: Event) -> None:
        if isinstance(event, ProgramEnded):
            self._ends.put(0)

    def show(self) -> int:
        return self._ends.get(timeout=60)

    def finish(self, code: int) -> None:
        self._ends.put(code)


def test_on_the_screen_time_and_program_stop_at_the_death_of_a_board(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    text = "void setup() {}\nvoid loop() {\n  delay(100);\n  volatile int *place = 0; *place = 1;\n}\n"
    made_set(folder, ROVER + MOTORS, {"rover.ino": DRIVE + text.replace("delay", "drive(90, 90); delay")})
    program, log = tmp_path / "laptop.py", tmp_path / "run.jsonl"
    program.write_text("import time\nwhile True:\n    time.sleep(0.01)\n", "utf-8")
    configuration = load(folder)
    wiring = wiring_of(configuration)
    assert wiring is not None
    sketches = compile_set(wiring, configuration.directory)
    server = Server(any_ports(with_boards(configuration)), sketches=sketches)
    life = RunLife(server, Screen(server), command=f"{sys.executable} {program}", log=str(log))
    assert life.run() == ExitCode.NO
    told = [json.loads(line) for line in log.read_text("utf-8").splitlines()]
    (death,) = [each["t"] for each in told if "the boards have ended" in each.get("text", "")]
    assert told[-1]["kind"] == "program"
    assert max(each["t"] for each in told if "t" in each) == death
    assert main(["rerun", str(log), "--sketch", str(folder)]) == 0


def test_a_set_without_boards_is_refused(tmp_path: Path) -> None:
    made_set(tmp_path / "set", "", {})
    (tmp_path / "set" / "wiring.toml").unlink()
    done = run(tmp_path / "set", tmp_path / "run.jsonl")
    assert done.returncode == 2
    assert "has no wiring.toml" in done.stderr


def any_ports(configuration: Configuration) -> Configuration:
    return replace(configuration, settings=with_any_ports(configuration.settings))


def begun(folder: Path, *options: str) -> subprocess.Popen[str]:
    """A run without a screen whose boards have begun."""
    command = [sys.executable, "-m", "simmer_tui", "--no-ui", "--sketch", str(folder), "--port", "0"]
    process = subprocess.Popen(
        [*command, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        start_new_session=True,
    )
    assert process.stdout is not None
    while "waiting for connection" not in process.stdout.readline():
        pass
    return process


@pytest.mark.skipif(sys.platform == "win32", reason="signals are those of POSIX")
def test_a_run_with_boards_that_is_ended_has_no_fault(tmp_path: Path) -> None:
    made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": STOPPABLE})
    # A terminal that closes, and one's ctrl+C, reach every process that was started in it.
    for each in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        process = begun(tmp_path / "set")
        os.killpg(process.pid, each)
        out, err = process.communicate(timeout=60)
        assert "fault" not in out + err


def test_boards_that_cannot_keep_pace_are_no_fault_of_the_run(tmp_path: Path) -> None:
    made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": STOPPABLE})
    log = tmp_path / "run.jsonl"
    process = begun(tmp_path / "set", "--time-scale", "1000", "--log", str(log))
    assert process.stderr is not None
    while "cannot keep pace" not in process.stderr.readline():
        pass
    process.terminate()
    process.communicate(timeout=60)
    (told,) = [each for each in records(log) if "cannot keep pace" in each.get("text", "")]
    assert told["about"] == "board"


def test_boards_and_a_real_robot_do_not_drive_at_once(tmp_path: Path) -> None:
    made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": STOPPABLE})
    done = run(tmp_path / "set", tmp_path / "run.jsonl", "--serial", "/dev/nosuch")
    assert (done.returncode, "leave --serial out" in done.stderr) == (2, True)
    configuration = load(tmp_path / "set")
    wiring = wiring_of(configuration)
    assert wiring is not None
    sketches = compile_set(wiring, configuration.directory)
    server = Server(any_ports(with_boards(configuration)), sketches=sketches)
    told: queue.Queue[Event] = queue.Queue()
    server.engine.watch(told.put)
    server.start()
    try:
        server.use_robot("/dev/nosuch")
        while "boards drive this robot" not in getattr(told.get(timeout=60), "text", ""):
            pass
        with socket.create_connection(("127.0.0.1", server.ports["commands"]), 60) as client:
            client.sendall(b"d1-3\n")
            assert struct.unpack(">d", client.recv(8))
    finally:
        server.stop()


def test_a_terminal_that_no_board_serves_is_not_opened(tmp_path: Path) -> None:
    configuration = made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": STOPPABLE})
    port = tmp_path / "COM6"
    server = Server(any_ports(configuration).with_settings({"server.pty": str(port)}))
    server.stop()
    assert server.warnings == ["--pty: no boards run; --sketch DIR runs those of wiring.toml"]
    assert not port.exists()
