"""The MATLAB functions, run in Octave against a small robot on real sockets."""

from __future__ import annotations

import math
import os
import queue
import re
import shutil
import socket
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from simmer_tui.links.belief_parser import parse_belief
from simmer_tui.sim import Pose
from tests.listening import HOST, listening

FUNCTIONS = Path(__file__).parents[1] / "scripts" / "matlab"
READINGS = {"u1": 12.345, "u3": math.inf, "d1-2": math.inf, "r1-90": math.inf, "r1--90": math.inf}


@pytest.fixture(scope="module")
def octave() -> str:
    program = shutil.which("octave-cli")
    if program is None:
        pytest.skip("octave-cli is not installed")
    loaded = subprocess.run(
        [program, "--norc", "--eval", "pkg load instrument-control; tcpclient;"],
        capture_output=True,
        text=True,
        check=False,
    )
    if "Invalid call to tcpclient" not in loaded.stderr:
        pytest.skip("Octave's instrument-control package with tcpclient is not installed")
    return program


class Robot:
    """Answers each line by `answer`; None ends the connections. Takes one client after another."""

    def __init__(self, answer: Callable[[str], bytes | None], separate: bool) -> None:
        self.received: list[str] = []
        self._answer = answer
        self._separate = separate
        self._reply_connections: queue.Queue[socket.socket] = queue.Queue()
        self.port = self.reply_port = 0

    def take_commands(self, connection: socket.socket) -> None:
        replies = self._reply_connections.get(timeout=60) if self._separate else connection
        with connection.makefile("rb") as lines:
            for line in lines:
                self.received.append(line.decode("ascii").removesuffix("\n"))
                reply = self._answer(self.received[-1])
                if reply is None:
                    break
                replies.sendall(reply)
        replies.shutdown(socket.SHUT_RDWR)

    def take_replies(self, connection: socket.socket) -> None:
        self._reply_connections.put(connection)
        connection.recv(1)  # until either side ends it


def reading(command: str, form: str = ">d") -> bytes:
    return struct.pack(form, READINGS.get(command, math.nan))


@contextmanager
def robot(answer: Callable[[str], bytes | None] = reading, separate: bool = True) -> Iterator[Robot]:
    fake = Robot(answer, separate)
    with listening(fake.take_commands) as fake.port, listening(fake.take_replies) as reply_port:
        fake.reply_port = reply_port if separate else 0
        yield fake


def run(octave: str, fake: Robot, program: str) -> tuple[int, str, str]:
    """Exit code, output and errors of a program that finds the robot by the environment."""
    environment = {
        **os.environ,
        "SIMMER_HOST": HOST,
        "SIMMER_PORT": str(fake.port),
        "SIMMER_REPLY_PORT": str(fake.reply_port),
    }
    ended = subprocess.run(
        [octave, "--norc", "--path", str(FUNCTIONS), "--eval", program],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    return ended.returncode, ended.stdout, ended.stderr


def failing(statement: str) -> str:
    """A statement that prints the identifier and message of the error it ends in."""
    return f"try, {statement}; disp('no error'); catch e, disp([e.identifier ' ' e.message]); end;"


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("separate", [True, False], ids=["two connections", "one connection"])
@pytest.mark.parametrize(
    ("form", "settings"),
    [
        (">d", ""),
        ("<d", "robot('byte_order') = 'little';"),
        (">f", "robot('reply_format') = 'float32';"),
        ("<f", "robot('reply_format') = 'float32'; robot('byte_order') = 'little';"),
    ],
)
def test_octave_reads_and_drives_in_every_route_format_and_byte_order(
    octave: str, separate: bool, form: str, settings: str
) -> None:
    program = (
        f"robot = simmer_open(); {settings}"
        "for command = {'u1', 'u3', 'd1-2', 'zz', ''}, printf('%.4f ', simmer_send(robot, command{1})); end;"
        "simmer_close(robot); simmer_close(robot);" + failing("simmer_send(robot, 'u1')")
    )
    with robot(lambda command: reading(command, form), separate) as fake:
        code, output, errors = run(octave, fake, program)
    values, _, closed = output.partition("simmer:closed ")
    assert (code, values) == (0, "12.3450 Inf Inf NaN NaN "), errors
    assert closed.startswith("the connection has ended (simmer_close was called)")
    assert fake.received == ["u1", "u3", "d1-2", "zz", ""]


@pytest.mark.slow
def test_octave_finds_the_robot_by_its_arguments_and_without_a_reply_port(octave: str) -> None:
    with robot(separate=False) as fake, socket.socket() as unused:
        unused.bind((HOST, 0))
        nobody = unused.getsockname()[1]
        opened = (f"'localhost', {fake.port}, {nobody}", f"'{HOST}', {fake.port}, 0")
        program = "".join(
            f"robot = simmer_open({arguments}); printf('%g ', simmer_send(robot, 'u1')); simmer_close(robot);"
            for arguments in opened
        )
        code, output, errors = run(octave, fake, program)
    assert (code, output) == (0, "12.345 12.345 "), errors


@pytest.mark.slow
def test_octave_says_what_is_wrong(octave: str) -> None:
    statements = [
        "simmer_send(robot, sprintf('u1\\nu2'))",
        "simmer_send(robot, repmat('u', 1, 256))",
        f"simmer_open('{HOST}', 70000)",
        "setenv('SIMMER_PORT', 'abc'); simmer_open()",
        f"simmer_open('{HOST}', 1, 0)",
    ]
    with robot() as fake:
        program = "robot = simmer_open();" + "".join(map(failing, statements)) + "simmer_send(robot, 'u1')"
        code, output, errors = run(octave, fake, program)
    lines = output.splitlines()
    assert code == 0, errors
    assert [line.split()[0] for line in lines[:5]] == [*["simmer:invalid"] * 4, "simmer:unreachable"]
    assert "SIMMER_PORT is 'abc'" in lines[3]
    assert "Start it with simmer-tui" in lines[4]
    assert lines[5] == "ans = 12.345"
    assert fake.received == ["u1"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("reply", "message"),
    [
        (b"half", r"simmer:timeout no reply to 'u1' within 0.2 s \([04] of 8 bytes came"),
        (None, "simmer:closed the simulator closed the connection before it answered 'u1'"),
    ],
    ids=["timeout", "closed"],
)
def test_octave_closes_the_robot_when_a_reply_does_not_come(
    octave: str, reply: bytes | None, message: str
) -> None:
    program = "robot = simmer_open(); robot('timeout') = 0.2;" + failing("simmer_send(robot, 'u1')") * 2
    with robot(lambda command: reply) as fake:
        code, output, errors = run(octave, fake, program)
    first, second = output.splitlines()
    assert code == 0, errors
    assert re.match(message, first), first
    assert second.startswith("simmer:closed the connection has ended")
    assert second.endswith("call simmer_open again")
    assert fake.received == ["u1"]


RANGES = (12.345, 11.22, math.inf, 7.0)


def scanned(command: str, form: str = ">d") -> bytes:
    """The reply to a command: of `sc` a count and so many numbers."""
    if command != "sc":
        return reading(command, form)
    return struct.pack(f"{form[0]}{len(RANGES) + 1}{form[1]}", len(RANGES), *RANGES)


@pytest.mark.slow
@pytest.mark.parametrize("separate", [True, False], ids=["two connections", "one connection"])
@pytest.mark.parametrize(
    ("form", "settings"),
    [(">d", ""), ("<f", "robot('reply_format') = 'float32'; robot('byte_order') = 'little';")],
)
def test_octave_reads_a_scan(octave: str, separate: bool, form: str, settings: str) -> None:
    program = (
        f"robot = simmer_open(); {settings}"
        "printf('%.3f ', simmer_scan(robot, 'sc')); printf('%.3f ', simmer_read(robot, 'u1'));"
        "printf('%d ', size(simmer_scan(robot, 'sc'))); disp('');"
        + failing("simmer_scan(robot, 'q9')")
        + failing("simmer_scan(robot, 'u1')")
        + failing("simmer_scan(robot, 'sc-90')")
        + "printf('%.3f\\n', simmer_read(robot, 'u1'));"
        + failing("simmer_read(robot, 'sc')")
        + "printf('%.3f\\n', simmer_read(robot, 'u1'));"
        + failing("simmer_read(robot, 'u1', 'sc')")
    )
    with robot(lambda command: scanned(command, form), separate) as fake:
        code, output, errors = run(octave, fake, program)
    lines = output.splitlines()
    assert (code, lines[0]) == (0, "12.345 11.220 Inf 7.000 12.345 1 4 "), errors
    assert lines[1].startswith("simmer:refused the robot knows no lidar q9")
    assert lines[2] == "simmer:refused u1 is no lidar: read it with simmer_read"
    assert lines[3].startswith("simmer:invalid the code of a lidar has two characters")
    assert lines[4] == "12.345"
    assert lines[5].startswith("simmer:refused sc is a lidar: simmer_scan gives all its ranges")
    assert lines[6] == "12.345"
    assert "'u1 sc' is " in lines[7]
    assert "a lidar is among them (see simmer_scan)" in lines[7]


@pytest.mark.slow
def test_octave_waits_longer_for_the_end_of_a_sleep(octave: str) -> None:
    answers = {"wt-2": struct.pack(">d", math.inf), "wt-0.5": b""}
    program = (
        "robot = simmer_open(); robot('timeout') = 0.25; simmer_sleep(robot, 2);"
        + failing("simmer_sleep(robot, 0.5)")
        + "printf('%g', robot('timeout'));"
    )
    with robot(lambda command: answers[command]) as fake:
        code, output, errors = run(octave, fake, program)
    assert (code, output.splitlines()) == (
        0,
        ["simmer:timeout no reply to 'wt-0.5' within 0.75 s (0 of 8 bytes came)", "0.25"],
    ), errors


WRONG_FORMAT = (
    "robot('reply_format') and robot('byte_order') must be the simulator's own (its settings.toml); "
    "call simmer_open again"
)


@pytest.mark.slow
@pytest.mark.parametrize("separate", [True, False], ids=["two connections", "one connection"])
def test_octave_notices_a_reply_that_is_longer_than_its_format(octave: str, separate: bool) -> None:
    """The simulator sends doubles and the program reads singles: each reply would be half of another."""
    program = "robot = simmer_open(); robot('reply_format') = 'float32';"
    program += failing("simmer_send(robot, 'u1')") + failing("simmer_send(robot, 'u2')")
    with robot(separate=separate) as fake:
        code, output, errors = run(octave, fake, program)
    first, second = output.splitlines()
    assert code == 0, errors
    assert first == f"simmer:format the reply to 'u1' is 4 bytes longer than a float32: {WRONG_FORMAT}"
    assert second.startswith("simmer:closed the connection has ended (the reply to 'u1' is 4 bytes longer")
    assert fake.received == ["u1"]


@pytest.mark.slow
@pytest.mark.parametrize("separate", [True, False], ids=["two connections", "one connection"])
def test_octave_notices_bytes_that_came_after_a_reply(octave: str, separate: bool) -> None:
    program = (
        "robot = simmer_open(); simmer_send(robot, 'u1'); write(robot('commands'), uint8(['u3' 10]));"
        "replies = robot('replies'); while replies.NumBytesAvailable < 8, end;"
    ) + failing("simmer_send(robot, 'u1')")
    with robot(separate=separate) as fake:
        code, output, errors = run(octave, fake, program)
    assert code == 0, errors
    said = output.splitlines()[-1]
    assert said == f"simmer:format 8 bytes were left over before 'u1': {WRONG_FORMAT}"
    assert fake.received == ["u1", "u3"]


@pytest.mark.slow
def test_octave_hints_at_the_format_when_half_a_number_comes(octave: str) -> None:
    program = "robot = simmer_open(); robot('timeout') = 0.2;" + failing("simmer_send(robot, 'u1')")
    with robot(lambda command: reading(command, ">f")) as fake:
        _, output, _ = run(octave, fake, program)
    assert output.strip().endswith("of 8 bytes came: does robot('reply_format') match the simulator's?)")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("distances", "moves"),
    [
        ((20, 20, 20), ["d1-2"]),
        ((4, 20, 4), ["r1-90", "d1-2"]),
        ((4, 4, 20), ["r1--90", "d1-2"]),
        ((20, 1.5, 20), ["r1--90", "d1-2"]),
        ((4, 4, 4), ["r1-90"]),
    ],
    ids=["open", "left clear", "right clear", "left near", "blocked"],
)
def test_the_octave_sample_wanders(octave: str, distances: tuple[float, ...], moves: list[str]) -> None:
    sensors = dict.fromkeys(["u1", "u2", "u3", "u4", "u5", "i1", "o3", "g1", "c1"], 1.0)
    sensors |= dict(zip(["u1", "u2", "u4"], distances, strict=True))
    with robot(lambda command: struct.pack(">d", sensors.get(command, math.inf))) as fake:
        code, output, errors = run(octave, fake, "wander(2)")
    assert code == 0, errors
    assert fake.received == [*sensors, *moves] * 2
    assert [line.split(" -> ")[1] for line in output.splitlines()] == [" ".join(moves)] * 2


@pytest.mark.slow
def test_the_octave_sample_names_a_missing_sensor(octave: str) -> None:
    with robot() as fake:
        code, _, errors = run(octave, fake, "wander(1)")
    assert code == 1
    assert "the robot knows no sensor u2" in errors


@pytest.mark.slow
def test_octave_reads_several_sensors_in_one_round_trip(octave: str) -> None:
    asked: list[str] = []

    def all_at_last(command: str) -> bytes:
        asked.append(command)
        return b"".join(map(reading, asked[-3:])) if len(asked) == 3 else b""

    with robot(all_at_last) as fake:
        program = "robot = simmer_open(); disp(simmer_read(robot, 'u1', 'u3', 'u1'));"
        code, output, errors = run(octave, fake, program)
    assert (code, output.split()) == (0, ["12.345", "Inf", "12.345"]), errors


@pytest.mark.slow
def test_octave_drives_and_is_told_what_the_robot_said(octave: str) -> None:
    with robot() as fake:
        code, output, errors = run(
            octave,
            fake,
            "robot = simmer_open(); movement = simmer_drive(robot, 'd1', 2);"
            "printf('%s %g %d\\n', movement.command, movement.reply, movement.ended);"
            + failing("simmer_drive(robot, 'x9', 1)")
            + failing("simmer_drive(robot, 'd1', NaN)")
            + failing("simmer_drive(robot, 1, 3)")
            + failing("simmer_read(robot, 'u1', 'q9')"),
        )
    assert code == 0, errors
    lines = output.splitlines()
    assert lines[0] == "d1-2 Inf 1"
    assert lines[1].startswith("simmer:refused the robot refused x9-1")
    assert lines[2].startswith("simmer:invalid")
    assert lines[3] == "simmer:invalid the code of a drive must be text, such as 'd1'"
    assert "warning" not in errors
    assert lines[4].startswith("simmer:refused the robot knows no sensor q9")
    assert fake.received == ["d1-2", "x9-1", "u1", "q9"]


@pytest.mark.slow
def test_octave_says_why_it_does_not_sleep(octave: str) -> None:
    with robot() as fake:
        code, output, errors = run(
            octave,
            fake,
            "robot = simmer_open();"
            + failing("simmer_sleep(robot, 3)")
            + failing("simmer_sleep(robot, -1)")
            + failing("simmer_sleep(robot, [1 2])"),
        )
    assert code == 0, errors
    assert output.splitlines() == [
        "simmer:refused the robot refused to wait: use pause(3)",
        *["simmer:invalid the seconds to sleep must be one number, 0 or more"] * 2,
    ]
    assert fake.received == ["wt-3"]


@pytest.mark.slow
def test_octave_knows_the_maze(octave: str, tmp_path: Path) -> None:
    program = (
        "cells = simmer_maze('mission'); disp(size(cells)); disp(cells(1, :)); disp(simmer_maze()(end, 1));"
    ) + failing("simmer_maze('nosuch')")
    folder = tmp_path / "bin"
    folder.mkdir()
    command = folder / "simmer-tui"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m simmer_tui "$@"\n')
    command.chmod(0o755)
    (tmp_path / "maze.csv").write_text("2,1\n3,0\n")
    root = str(Path(__file__).parents[1])
    environment = {
        **os.environ,
        "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": root,
        "SIMMER_MAZE": str(tmp_path / "maze.csv"),
    }
    done = subprocess.run(
        [octave, "--norc", "--path", str(FUNCTIONS), "--eval", program],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    numbers, _, refused = done.stdout.partition("simmer:maze ")
    assert numbers.split() == ["4", "8", *"33110202", "3"], done.stderr
    assert refused.startswith("nosuch: there is no such folder")
    assert "{" not in refused


@pytest.mark.slow
def test_octave_tells_beliefs_that_the_simulator_understands(octave: str) -> None:
    lines: queue.Queue[bytes] = queue.Queue()

    def collect(connection: socket.socket) -> None:
        with connection.makefile("rb") as stream:
            for line in stream:
                lines.put(line)

    program = (
        "robot = simmer_open();"
        "simmer_believe(robot, 'x', 12, 'y', 42.5, 'heading', -90, 'spread', 1, 'note', 'a \"b\"');"
        "p = zeros(4, 8, 3); p(2, 3, 2) = 3; p(2, 3, 3) = 1; simmer_believe(robot, 'grid', p);"
        "simmer_believe(robot, 'grid', [0 2; 1 0], 'bounds', [0 0 8 8], 'first', 45);"
        + failing("simmer_believe(robot, 'grid', [0 NaN])")
        + failing("simmer_believe(robot, 'grid', ones(300))")
        + failing("simmer_believe(robot, 'z', 1)")
        + failing("simmer_believe(robot, 12)")
        + failing("simmer_believe(robot, 'x', 1, 'y', 2)")
        + failing("simmer_believe(robot, 'x', 1, 'y', 2, 'heading', 0, 'first', 45)")
        + failing("simmer_believe(robot, 'grid', [0 1], 'spread', -1)")
        + "simmer_close(robot); simmer_believe(robot, 'x', 1, 'y', 1, 'heading', 1);"
    )
    with robot() as fake, listening(collect) as port:
        program = f"setenv('SIMMER_BELIEF_PORT', '{port}');" + program
        code, output, errors = run(octave, fake, program)
    assert code == 0, errors
    assert output.splitlines() == [
        "simmer:invalid grid must be rows x columns x headings of finite numbers, 0 or more, and one of "
        "them more than 0",
        "simmer:invalid grid has 90000 states: it may have 65536",
        "simmer:invalid 'z' is not known; there are x, y, heading, spread, grid, bounds, first, note",
        "simmer:invalid simmer_believe takes pairs, such as 'x', 12, or 'grid', p",
        "simmer:invalid heading is missing: only a belief with a grid may leave it out",
        "simmer:invalid bounds and first are those of a grid: there is none",
        "simmer:invalid spread is -1: it must be 0 or more",
    ]
    assert "warning" not in errors
    told = [parse_belief(lines.get(timeout=60), 0.0, Pose(0, 0, 0), (0, 0, 96, 48)) for _ in range(3)]
    assert lines.empty()
    assert (told[0].pose, told[0].spread, told[0].note) == (Pose(12.0, 42.5, -90.0), 1.0, 'a "b"')
    assert told[1].pose == Pose(30.0, 30.0, 120.0)
    assert told[1].grid is not None
    assert told[1].grid.best_probability == 0.75
    assert (told[2].pose, told[2].grid and told[2].grid.shape) == (Pose(6.0, 6.0, 45.0), (2, 2, 1))


@pytest.mark.slow
def test_octave_goes_on_where_nobody_listens_to_beliefs(octave: str) -> None:
    with socket.create_server((HOST, 0)) as closed:
        port = closed.getsockname()[1]
    program = (
        f"setenv('SIMMER_BELIEF_PORT', '{port}'); robot = simmer_open();"
        "for k = 1:2, simmer_believe(robot, 'grid', [1 2]); end; printf('%g', simmer_send(robot, 'u1'));"
    )
    with robot() as fake:
        assert run(octave, fake, program)[:2] == (0, "12.345")
