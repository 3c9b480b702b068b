"""Real processes on real ports: the emulated robot, the sketch for a board, and programs that drive them."""

from __future__ import annotations

import math
import os
import re
import select
import shlex
import shutil
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import serial

from simmer_tui import read_log
from simmer_tui.config.sets import bundled_folder, init_set
from simmer_tui.links.port_list import close_port, open_port
from simmer_tui.run.events import TwinReading
from tests.in_process import simmer

ROOT = Path(__file__).parents[1]
EMULATOR = ROOT / "scripts" / "robot_emulator.py"
SKETCH = ROOT / "scripts" / "arduino" / "simmer_robot" / "simmer_robot.ino"

unix_only = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no ptys")

Emulate = Callable[..., str]


@pytest.fixture
def emulate() -> Iterator[Emulate]:
    """Start emulators; gives the name of each one's port."""
    running: list[subprocess.Popen[str]] = []

    def start(*options: str) -> str:
        process = subprocess.Popen(
            [sys.executable, str(EMULATOR), *options], stdout=subprocess.PIPE, text=True
        )
        running.append(process)
        assert process.stdout is not None
        return process.stdout.readline().strip()

    yield start
    for process in running:
        process.terminate()
        process.wait(timeout=60)
        assert process.stdout is not None
        process.stdout.close()


def run(*options: str, program: str) -> subprocess.CompletedProcess[str]:
    """Run a program beside `simmer-tui --no-ui` on free ports."""
    words = ("--no-ui", "--port", "0", *options, "--run", program)
    return simmer(*words, cwd=ROOT, env={"PYTHONPATH": str(ROOT)})


def wander(steps: int) -> str:
    return f"{sys.executable} scripts/wander.py --steps {steps} --seed 1"


def asked(name: str, command: bytes, size: int) -> bytes:
    """The reply on a port."""
    port = open_port(name, 9600)
    port.timeout = 60
    port.write(command)
    reply = bytes(port.read(size))
    close_port(port)
    return reply


@pytest.mark.slow
@unix_only
@pytest.mark.parametrize(
    ("options", "command", "reply"),
    [
        ([], b"u1\n", struct.pack(">d", 7.5)),
        (["--byte-order", "little"], b"u1", struct.pack("<d", 7.5)),
        (["--reply", "float32"], b"u1\r\n", struct.pack(">f", 7.5)),
        (["--reply", "text"], b"d1-1\nu1\n", b"inf\r\n7.500\r\n"),
        ([], b"[u1,d1:1,q9,d1:x,xx]", b"[u1:7.500,d1:True,q9:Not Found,d1:False,xx:DRIVE STOP]"),
        (["--latency", "0.001"], b"xx\n", struct.pack(">d", math.inf)),
    ],
)
def test_emulator_answers_in_the_form_it_was_asked_for(
    emulate: Emulate, options: list[str], command: bytes, reply: bytes
) -> None:
    assert asked(emulate("--constant", "7.5", *options), command, len(reply)) == reply


@pytest.mark.slow
def test_emulator_on_tcp_serves_one_program_after_the_other(emulate: Emulate) -> None:
    name = emulate("--tcp", "0", "--constant", "2")
    assert name.startswith("socket://")
    for _ in range(2):
        assert asked(name, b"u1\n", 8) == struct.pack(">d", 2)


@pytest.mark.slow
@unix_only
def test_emulator_loses_bytes_and_greets_repeatably(emulate: Emulate) -> None:
    replies = []
    for _ in range(2):
        options = ("--boot-noise", "--loss", "0.5", "--seed", "3", "--reply", "text", "--constant", "123456")
        with serial.Serial(emulate(*options), timeout=60) as port:
            port.write(b"u1\n" * 20 + b"[xx]")
            replies.append(bytes(port.read_until(b"ready\r\n") + port.read(60)))
    assert replies[0] == replies[1]
    assert b"firmware" in replies[0]


@pytest.mark.slow
@unix_only
@pytest.mark.parametrize("greets", [False, True])
def test_a_board_that_starts_again_at_each_opening_loses_no_command(emulate: Emulate, greets: bool) -> None:
    """Deaf for a second after each opening, which the second program causes too."""
    # It starts when it sees the opening: a busy machine may need a while for that.
    boot = ("--serial-boot", "60" if greets else "4")
    port = emulate("--boot", "1", *(["--boot-noise"] if greets else []))
    for _ in range(2):
        done = run("--serial", port, *boot, "--serial-timeout", "20", program=wander(2))
        told = done.stdout + done.stderr
        assert done.returncode == 0, told
        assert f"waiting {boot[1]} s for the board to start" in told
        assert ("robot: the board said " in told) is greets
        assert "no answer" not in told


@pytest.mark.slow
@unix_only
def test_emulator_is_the_robot_of_a_set(emulate: Emulate, tmp_path: Path) -> None:
    """Its readings, distances and durations are as the set says."""
    init_set(tmp_path, bundled_folder())
    for name, old, new in (
        ("drive.csv", "right,d1,1,0.02,0.05,0.02,0,0,0", "right,d1,1,0,0,0,0,0.5,0"),
        ("sensors.csv", "ultra1,u1,1,3,0,6,0,0.02,5", "ultra1,u1,1,3,0,6,0,0,5"),
        ("settings.toml", "randbias = true", "randbias = false"),
    ):
        text = (tmp_path / name).read_text()
        assert old in text
        (tmp_path / name).write_text(text.replace(old, new))
    name = emulate("--config", str(tmp_path), "--reply", "text", "--time-scale", "50")
    with serial.Serial(name, timeout=60) as port:
        port.write(b"u1\n")
        before = float(port.readline())
        asked_at = time.monotonic()
        port.write(b"d1-6\n")
        assert port.readline() == b"inf\r\n"
        assert time.monotonic() - asked_at >= 0.02  # 6 in at 6 in/s, 50 times as fast
        port.write(b"u1\n")
        assert before - float(port.readline()) == pytest.approx(9.0, abs=0.01)


@pytest.mark.slow
@unix_only
def test_wheels_of_the_emulator_slip_where_they_are_told_to(emulate: Emulate) -> None:
    done = []
    for options in ([], ["--slip", "0.5"]):
        name = emulate("--reply", "text", *options)  # the second movement begins on another cell
        with serial.Serial(name, timeout=60) as port:
            replies = []
            for command in (b"d1-6\n", b"d1-6\n", b"u1\n", b"o3\n"):
                port.write(command)
                replies.append(float(port.readline()))
            done.append(replies[-2:])
    (wall, counted), (slipped_wall, slipped_counted) = done
    assert slipped_wall > wall + 1.0
    assert slipped_counted == pytest.approx(counted, abs=0.5)


@pytest.mark.slow
@unix_only
def test_drives_of_the_emulator_weaken_and_end_short_where_they_are_told_to(emulate: Emulate) -> None:
    turned = []
    for options in ([], ["--weaken", "0.25"], ["--shortfall", "1"]):
        name = emulate("--reply", "text", *options)
        with serial.Serial(name, timeout=60) as port:
            for command in (b"r1-90\n", b"r1--45\n", b"g1\n"):
                port.write(command)
                reply = float(port.readline())
            turned.append(reply)
    as_asked, weak, short = turned
    assert as_asked == pytest.approx(45.0, abs=6.0)
    # The second turn is weaker by a quarter.
    assert weak == pytest.approx(as_asked + 0.25 * 45.0, abs=2.0)
    # Wheels an inch short, 3 in from the centre, make 19.1 degrees: of one turn as of the other.
    assert short == pytest.approx(as_asked, abs=2.0)
    with serial.Serial(emulate("--reply", "text", "--shortfall", "1"), timeout=60) as port:
        port.write(b"r1-90\n")
        port.readline()
        port.write(b"g1\n")
        assert float(port.readline()) == pytest.approx(90.0 - 19.1, abs=6.0)


@unix_only
def test_the_log_of_a_robot_on_a_port_can_be_read(emulate: Emulate, tmp_path: Path) -> None:
    log = tmp_path / "robot.jsonl"
    done = run("--serial", emulate(), "--log", str(log), program=wander(4))
    assert done.returncode == 0, done.stderr
    with read_log(log) as reader:
        assert not reader.header.simulated
        assert any(isinstance(logged.event, TwinReading) for logged in reader)


@pytest.mark.slow
def test_emulator_refuses_what_cannot_be(tmp_path: Path) -> None:
    no_set = ["--config", str(tmp_path / "no-set")]
    for options in (["--loss", "2"], ["--latency", "-1"], ["--port", str(tmp_path / "none")], no_set):
        done = subprocess.run(
            [sys.executable, str(EMULATOR), *options],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode in (1, 2)
        assert done.stderr.strip()
        assert "Traceback" not in done.stderr


@pytest.mark.slow
@unix_only
@pytest.mark.parametrize(
    ("robot", "simulator"),
    [
        ([], []),
        (["--boot-noise", "--reply", "text"], ["--robot-reply", "text"]),
        pytest.param(
            ["--reply", "float32", "--byte-order", "little"],
            ["--robot-reply", "float32"],
            marks=pytest.mark.slow,
        ),
    ],
    ids=["the same form", "a robot that prints", "a robot with short numbers"],
)
def test_wander_runs_unchanged_on_a_robot_at_a_serial_port(
    emulate: Emulate, robot: list[str], simulator: list[str]
) -> None:
    done = run("--serial", emulate(*robot), *simulator, program=wander(5))
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.split(":")[0] for line in lines] == ["1", "2", "3", "4", "5"]
    assert "nan" not in done.stdout
    assert "disconnected after" in done.stderr


@pytest.mark.slow
def test_wander_runs_through_a_tcp_bridge(emulate: Emulate) -> None:
    done = run("--serial", emulate("--tcp", "0"), program=wander(3))
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 3


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("tmux") is None, reason="needs tmux")
def test_wander_runs_unchanged_with_the_screen_which_shows_both_robots(
    emulate: Emulate, tmp_path: Path
) -> None:
    environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}

    def tmux(*arguments: str) -> str:
        command = ["tmux", "-S", str(tmp_path / "tmux"), "-f", os.devnull, *arguments]
        done = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120, check=True
        )
        return done.stdout

    app = [sys.executable, "-m", "simmer_tui", "--serial", emulate(), "--port", "0", "--run", wander(4)]
    tmux("new-session", "-d", "-x", "140", "-y", "45", shlex.join(app))
    try:
        shown = ""
        deadline = time.monotonic() + 120
        while not ("disconnected after 40 commands" in shown and re.search(r"u1 .* sim \S+", shown)):
            assert time.monotonic() < deadline, shown
            shown = tmux("capture-pane", "-p")
    finally:
        tmux("kill-server")


TALK_PACKETS = """
from simmer_tui.client import Robot
with Robot(protocol="packets") as robot:
    print(robot.read("u1"))
    robot.drive("d1", 1)
    print(robot.read("o3"))
"""


@pytest.mark.slow
@unix_only
def test_program_that_talks_packets_drives_a_robot_that_does(emulate: Emulate, tmp_path: Path) -> None:
    program = tmp_path / "open_session.py"
    program.write_text(TALK_PACKETS)
    options = [
        "--serial",
        emulate("--boot-noise", "--seed", "1"),
        "--listeners",
        "packets",
        "--packet-port",
        "0",
    ]
    done = run(*options, program=f"{sys.executable} {program}")
    assert done.returncode == 0, done.stderr
    ahead, driven = map(float, done.stdout.split())
    assert 30 < ahead < 40
    assert driven == pytest.approx(1, abs=0.2)


ASK_ON = """
import math, os, socket, struct
with socket.create_connection(("127.0.0.1", int(os.environ["SIMMER_PORT"]))) as robot:
    for _ in range(40):
        robot.sendall(b"u1\\n")
        print(*struct.unpack(">d", robot.recv(64)))
"""


@pytest.mark.slow
@unix_only
def test_replies_that_lost_bytes_become_nan_and_leave_the_others_whole(
    emulate: Emulate, tmp_path: Path
) -> None:
    program = tmp_path / "ask_on.py"
    program.write_text(ASK_ON)
    port = emulate("--loss", "0.02", "--seed", "5", "--boot-noise", "--constant", "7.5")
    done = run("--serial", port, "--serial-timeout", "1", program=f"{sys.executable} {program}")
    assert done.returncode == 0, done.stderr
    numbers = done.stdout.split()
    lost = numbers.count("nan")
    assert 1 <= lost <= 10
    assert numbers.count("7.5") == 40 - lost
    # Each as it happens, and the first among the moments of the run.
    assert done.stderr.count("did not answer within 1 s") == lost + 1


@unix_only
def test_program_without_a_robot_gets_nan_and_everybody_is_told(tmp_path: Path) -> None:
    port = tmp_path / "none"
    done = run("--serial", str(port), "--serial-timeout", "0.1", program=wander(1))
    assert done.returncode == 1
    assert f"there is no port {port}" in done.stderr
    assert "no answer to 'u1'" in done.stderr


Board = Callable[[str], "subprocess.Popen[bytes]"]


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    """Compile the sketch for this machine, with replies in one form, and start it."""
    compiler = shutil.which("c++") or shutil.which("g++")
    if compiler is None or sys.platform == "win32":
        pytest.skip("no C++ compiler here")
    running: list[subprocess.Popen[bytes]] = []

    def start(reply: str) -> subprocess.Popen[bytes]:
        text, count = re.subn(r"#define REPLY \w+", f"#define REPLY {reply}", SKETCH.read_text())
        assert count == 1
        source, program = tmp_path / "sketch.cpp", tmp_path / "sketch"
        source.write_text(f'#include "Arduino.h"\n{text}\nint main() {{ setup(); for (;;) loop(); }}\n')
        include = f"-I{ROOT / 'tests' / 'arduino'}"
        subprocess.run([compiler, "-Wall", "-Werror", include, str(source), "-o", str(program)], check=True)
        running.append(subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE))
        return running[-1]

    yield start
    for process in running:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            assert pipe is not None
            pipe.close()


def exchange(process: Any, command: bytes, size: int) -> bytes:
    """Answer of the board."""
    process.stdin.write(command)
    process.stdin.flush()
    reply = b""
    while len(reply) < size:
        ready, _, _ = select.select([process.stdout], [], [], 10)
        assert ready, f"only {reply!r} in answer to {command!r}"
        reply += os.read(process.stdout.fileno(), size - len(reply))
    return reply


READING = 341 * (36.0 / 1023)


@pytest.mark.slow
def test_sketch_prints_replies(board: Board) -> None:
    robot = board("TEXT")
    assert exchange(robot, b"u1\r\n", 7) == b"12.000\n"
    assert exchange(robot, b"u1", 7) == b"12.000\n", "a command that stays alone is whole"
    assert exchange(robot, b"d1-0.1\n", 4) == b"inf\n"
    assert exchange(robot, b"d1-x\nq9-1\nd1\nu\n" + b"u" * 100 + b"\n", 20) == b"nan\n" * 5
    assert exchange(robot, b"[u1,i1,d1:0,q9:2,r1]", 47) == b"[u1:12.000,i1:1.000,d1:True,q9:Not Found,r1:Fal"
    assert exchange(robot, b"", 3) == b"se]"


def test_sketch_stops_a_drive_at_once(board: Board) -> None:
    robot = board("TEXT")
    assert exchange(robot, b"d1-1000\nxx\n", 8) == b"inf\ninf\n", "after far less than 100 seconds"


@pytest.mark.slow
@pytest.mark.parametrize(("reply", "form"), [("FLOAT32", "<f"), ("FLOAT64", ">d")])
def test_sketch_sends_numbers_in_binary(board: Board, reply: str, form: str) -> None:
    robot = board(reply)
    number = struct.Struct(form)
    assert number.unpack(exchange(robot, b"u1\n", number.size)) == (pytest.approx(READING),)
    assert number.unpack(exchange(robot, b"i1\n", number.size)) == (1.0,)
    assert number.unpack(exchange(robot, b"d1-0\n", number.size)) == (math.inf,)
    assert math.isnan(*number.unpack(exchange(robot, b"q9\n", number.size)))
