"""Runs for programs that send packets, as whole processes: ports, variables, ends, and what is printed."""

from __future__ import annotations

import contextlib
import re
import shlex
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest

from simmer_tui.cli.headless import READY, LinePrinter
from simmer_tui.run.events import MovementPlanned
from simmer_tui.sim import CommandResult, SimulationSpec, Simulator
from tests import in_process

SECONDS = 120.0
Start = Callable[..., tuple[subprocess.Popen[str], dict[str, int]]]

PROGRAM = """
from simmer_tui.client import Robot, UnknownCodeError
with Robot(protocol="packets") as robot:
    start = robot.read("u0")
    robot.drive("w0", 12)
    robot.drive("r0", 90)
    robot.drive("r0", -90)
    print(round(robot.read("m0"), 3), robot.read("u0") < start, robot.send("xx"))
    try:
        robot.read("q9")
    except UnknownCodeError as error:
        print(error)
"""

RAW = """
import os, socket, threading, time
host = os.environ["SIMMER_HOST"]
port, replies = int(os.environ["SIMMER_PACKET_PORT"]), int(os.environ["SIMMER_PACKET_REPLY_PORT"])
def transmit(text):
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as s:
        s.connect((host, port))
        s.send(text.encode("ascii"))
def receive():
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as s:
        s.connect((host, replies))
        return s.recv(1024).decode("ascii")
heard, done = [], threading.Event()
def listen():
    while not done.is_set():
        text = receive()
        if text:
            heard.extend(text.strip("[]").split(","))
        if len(heard) == 4:
            done.set()
threading.Thread(target=listen).start()
for text in ("[u0]", "[w0:3,r0:90]", "[m0]"):
    transmit(text)
    time.sleep(0.04)
done.wait()
print(" ".join(item.split(":")[0] for item in heard))
"""


def simmer(*options: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "simmer_tui", "--no-ui", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
    )


def run(*options: str) -> tuple[int, str, str]:
    """Exit code and both outputs of a run that ends by itself."""
    done = in_process.simmer("--no-ui", "--config", "simmer-python", *options)
    return done.returncode, done.stdout, done.stderr


def python(code: str) -> str:
    return (
        f'"{sys.executable}" -c "{code}"'
        if sys.platform == "win32"
        else shlex.join([sys.executable, "-c", code])
    )


@pytest.fixture
def started() -> Iterator[Start]:
    """Starts a run; gives it and its ports once it is ready."""
    with contextlib.ExitStack() as stack:

        def start(*options: str) -> tuple[subprocess.Popen[str], dict[str, int]]:
            process = stack.enter_context(simmer(*options))
            stack.callback(process.kill)
            assert process.stdout is not None
            head = ""
            for line in process.stdout:
                head += line
                if line.strip() == READY:
                    break
            return process, {name: int(port) for name, port in re.findall(r", ([a-z ]+) on port (\d+)", head)}

        yield start


def test_a_python_program_drives_the_stock_robot_to_the_end() -> None:
    code, out, err = run("--packet-port", "0", "--time-scale", "100", "--run", python(PROGRAM))
    assert code == 0, err
    assert out.splitlines() == [
        "12.0 True inf",
        "the robot knows no sensor 'q9' (no sensor or drive has the code q9): see its sensors.csv",
    ]
    assert "client 127.0.0.1 sends packets" in err
    assert err.count("not begun: the robot is still moving") <= 3, "one line a movement, however often asked"


def test_a_program_with_two_threads_and_raw_sockets_hears_every_answer() -> None:
    code, out, err = run("--packet-port", "0", "--run", python(RAW))
    # In which order depends on the machine: a slow one sends m0 while the robot still moves.
    assert (code, sorted(out.split())) == (0, ["m0", "r0", "u0", "w0"]), err


@pytest.mark.slow
def test_once_ends_after_the_time_given_without_a_packet(started: Start) -> None:
    process, ports = started("--config", "simmer-python", "--packet-port", "0", "--once", "--idle", "0.2")
    assert set(ports) == {"packets", "packet replies", "beliefs"}
    for _ in range(2):
        with socket.create_connection(("127.0.0.1", ports["packets"]), SECONDS) as sender:
            sender.sendall(b"[m0]")
    _, err = process.communicate(timeout=SECONDS)
    assert process.returncode == 0
    assert "client 127.0.0.1 gone after 2 requests: silent for 0.2 s" in err


@pytest.mark.slow
def test_listeners_say_which_ports_there_are(started: Start) -> None:
    _, ports = started("--listeners", "binary,packets", "--port", "0")
    assert list(ports) == ["commands", "replies", "packets", "packet replies", "beliefs"]
    assert len(set(ports.values())) == 5
    assert not set(ports.values()) & {9000, 9001, 9002, 61200, 61201}


@pytest.mark.slow
@pytest.mark.parametrize("option", ["--packet-port", "--packet-reply-port"])
def test_a_port_in_use_is_one_line_and_exit_code_2(option: str) -> None:
    other = "--packet-port" if option == "--packet-reply-port" else "--packet-reply-port"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1]
        code, out, err = run(option, str(number), other, "0")
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    for part in (f"port {number} (packet", "in use on 127.0.0.1", f"{option} N", "0 takes any free one"):
        assert part in err


def test_that_a_robot_is_busy_is_told_once_a_movement(
    capsys: pytest.CaptureFixture[str], course_spec: SimulationSpec
) -> None:
    simulator, console = Simulator(course_spec), LinePrinter(quiet=False)

    def tell(text: str) -> CommandResult:
        outcome = simulator.begin(text)
        console.watch(outcome)
        return outcome

    for distance in ("3", "2"):
        accepted = simulator.begin(f"d1-{distance}")
        assert simulator.trajectory is not None
        console.watch(MovementPlanned(1, 0.0, accepted.command, simulator.trajectory))
        for _ in range(3):
            tell("d1-0")
            tell("u1")
        simulator.finish(accepted)
    console.finish(0)
    console.show()
    assert capsys.readouterr().err.splitlines() == ["client: 'd1-0' not begun: the robot is still moving"] * 2
