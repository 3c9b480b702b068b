"""The client library against small robots on real sockets."""

from __future__ import annotations

import base64
import json
import math
import queue
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simmer_tui import client
from simmer_tui.client import (
    CommandRefusedError,
    InvalidInputError,
    Robot,
    RobotClosedError,
    RobotError,
    RobotTimeoutError,
    RobotUnreachableError,
    UnknownCodeError,
)
from simmer_tui.links.belief_parser import parse_belief
from simmer_tui.sim import Pose
from simmer_tui.version import requirement
from tests.listening import HOST, listening

READINGS = {"u1": 12.345, "u3": math.inf, "d1-3": math.inf, "r1--45": math.inf}

Piece = bytes | None
"""Bytes that a robot sends in one go; None ends the connections."""


@pytest.fixture(autouse=True)
def _no_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HOST", "PORT", "REPLY_PORT", "PACKET_PORT", "PACKET_REPLY_PORT", "BELIEF_PORT"):
        monkeypatch.delenv(f"SIMMER_{name}", raising=False)


def until_it_ends(connection: socket.socket) -> None:
    connection.recv(1)


@pytest.fixture
def free_port() -> int:
    """A port where nobody listens."""
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])


def encoded(command: str, form: str = ">d") -> list[Piece]:
    return [struct.pack(form, READINGS.get(command, math.nan))]


def finished(command: str) -> list[Piece]:
    """The reply to a movement."""
    return [struct.pack(">d", math.inf)]


class BinaryRobot:
    """The binary dialect: one client at a time, replies on a second connection or on the first."""

    def __init__(self, answer: Callable[[str], list[Piece]], separate: bool) -> None:
        self.received: list[str] = []
        self._answer = answer
        self._separate = separate
        self._driven = threading.Lock()
        self._reply_connections: queue.Queue[socket.socket | None] = queue.Queue()
        self.port = self.reply_port = 0

    def take_commands(self, connection: socket.socket) -> None:
        if not self._driven.acquire(blocking=False):
            return  # somebody drives already: a clean close
        try:
            replies = self._reply_connections.get(timeout=300) if self._separate else connection
            if replies is None:
                return
            replies.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._serve(connection, replies)
            replies.shutdown(socket.SHUT_RDWR)
        finally:
            self._driven.release()

    def expect_no_more(self) -> None:
        """No reply connection comes any more: one that nobody took is not waited for."""
        self._reply_connections.put(None)

    def take_replies(self, connection: socket.socket) -> None:
        self._reply_connections.put(connection)
        connection.recv(1)  # until either side ends it

    def _serve(self, connection: socket.socket, replies: socket.socket) -> None:
        with connection.makefile("rb") as lines:
            for line in lines:
                command = line.decode("ascii").removesuffix("\n")
                self.received.append(command)
                for piece in self._answer(command):
                    if piece is None:
                        return
                    replies.sendall(piece)


@contextmanager
def binary_robot(
    answer: Callable[[str], list[Piece]] = encoded, separate: bool = True
) -> Iterator[BinaryRobot]:
    robot = BinaryRobot(answer, separate)
    with listening(robot.take_commands) as robot.port:
        try:
            with listening(robot.take_replies) as reply_port:
                robot.reply_port = reply_port if separate else 0
                yield robot
        finally:
            robot.expect_no_more()


class PacketRobot:
    """RequestStyle 1.2: a connection a message; `answer` gives the reply item's value."""

    def __init__(self, answer: Callable[[str], str]) -> None:
        self.received: list[str] = []
        self.waiting: deque[bytes] = deque()
        self.port = self.reply_port = 0
        self._answer = answer

    def take_request(self, connection: socket.socket) -> None:
        with connection.makefile("rb") as stream:
            request = stream.read().decode("ascii")
        self.received.append(request)
        commands = request.removeprefix("[").removesuffix("]").split(",")
        items = ",".join(f"{command[:2]}:{self._answer(command)}" for command in commands)
        self.waiting.append(f"[{items}]".encode("ascii"))

    def give_reply(self, connection: socket.socket) -> None:
        if self.waiting:
            connection.sendall(self.waiting.popleft())


@contextmanager
def packet_robot(answer: Callable[[str], str]) -> Iterator[PacketRobot]:
    robot = PacketRobot(answer)
    with listening(robot.take_request) as robot.port, listening(robot.give_reply) as robot.reply_port:
        yield robot


def packets(fake: PacketRobot, timeout: float = 10.0) -> Robot:
    return Robot(HOST, fake.port, fake.reply_port, protocol="packets", timeout=timeout)


# --- the binary dialect ---------------------------------------------------------------------------


@pytest.mark.parametrize("separate", [True, False], ids=["two connections", "one connection"])
@pytest.mark.parametrize("reply_format", ["float64", "float32"])
@pytest.mark.parametrize("byte_order", ["big", "little"])
def test_reads_and_drives_in_every_route_format_and_byte_order(
    separate: bool, reply_format: Any, byte_order: Any
) -> None:
    form = (">" if byte_order == "big" else "<") + ("d" if reply_format == "float64" else "f")
    with (
        binary_robot(lambda command: encoded(command, form), separate) as fake,
        Robot(HOST, fake.port, fake.reply_port, reply_format=reply_format, byte_order=byte_order) as robot,
    ):
        assert robot.reply_port == fake.reply_port
        assert robot.read("u1") == pytest.approx(12.345, rel=1e-7)
        assert robot.read("u3") == math.inf
        robot.drive("d1", 3)
        assert robot.send("r1--45") == math.inf
        assert math.isnan(robot.send("zz"))
    assert fake.received == ["u1", "u3", "d1-3", "r1--45", "zz"]


@pytest.mark.parametrize("separate", [True, False])
def test_several_sensors_are_read_in_one_round_trip(separate: bool) -> None:
    """The robot answers nothing before all have been asked for."""
    asked: list[str] = []

    def all_at_last(command: str) -> list[Piece]:
        asked.append(command)
        if asked[-1] != "u1":
            return []
        return [encoded(each)[0] for each in asked[-3:]]

    with binary_robot(all_at_last, separate) as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
        assert robot.read("u1") == 12.345
        assert robot.read("u3", "u3", "u1") == (math.inf, math.inf, 12.345)
    assert fake.received == ["u1", "u3", "u3", "u1"]


def test_of_several_sensors_the_one_that_is_not_there_is_named() -> None:
    with binary_robot() as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
        with pytest.raises(UnknownCodeError, match="'q9'"):
            robot.read("u1", "q9", "u3")
        assert robot.read("u1", "u3") == (12.345, math.inf)
        with pytest.raises(InvalidInputError):
            robot.read("u1", "u12")


def test_several_sensors_of_packets_are_one_message_and_one_reply() -> None:
    with packet_robot(lambda command: f"{command[1]}.5") as fake, packets(fake) as robot:
        fake.waiting.append(b"[u2:99.0]")
        assert robot.read("u2", "u1", "u2") == (2.5, 1.5, 2.5)
    assert fake.received == ["[u2,u1,u2]"]


RANGES = [12.345, 11.22, math.inf, 7.0]


def scanned(command: str, form: str = ">d") -> list[Piece]:
    """The reply to a command: of `sc` a count and so many numbers."""
    if command != "sc":
        return encoded(command, form)
    numbers = struct.Struct(f"{form[0]}{len(RANGES) + 1}{form[1]}")
    return [numbers.pack(len(RANGES), *RANGES)]


def lidar_named(port: int, line: str) -> dict[str, Any]:
    """A simulator's answer to why a command was refused."""
    kinds = {"sc": "sensor", "u1": "sensor", "d1": "drive"}
    kind = kinds.get(line[:2], "unknown")
    told = {"why": "" if kind != "unknown" else "no such code", "kind": kind, "ports": [port]}
    return {**told, "scan": True} if line == "sc" else told


@contextmanager
def reasons_given(fake: BinaryRobot | PacketRobot) -> Iterator[int]:
    """The belief port of a simulator that says what a code is."""

    def answer(connection: socket.socket) -> None:
        with connection.makefile("rb") as lines:
            for line in lines:
                told = lidar_named(fake.port, json.loads(line)["why"])
                connection.sendall(json.dumps(told).encode() + b"\n")

    with listening(answer) as port:
        yield port


@pytest.mark.parametrize("separate", [True, False], ids=["two connections", "one connection"])
@pytest.mark.parametrize("reply_format", ["float64", "float32"])
@pytest.mark.parametrize("byte_order", ["big", "little"])
def test_a_scan_is_a_list_of_ranges_in_every_route_format_and_byte_order(
    separate: bool, reply_format: Any, byte_order: Any
) -> None:
    form = (">" if byte_order == "big" else "<") + ("d" if reply_format == "float64" else "f")
    with (
        binary_robot(lambda command: scanned(command, form), separate) as fake,
        Robot(HOST, fake.port, fake.reply_port, reply_format=reply_format, byte_order=byte_order) as robot,
    ):
        assert robot.scan("sc") == pytest.approx(RANGES, rel=1e-6)
        assert robot.read("u1") == pytest.approx(12.345, rel=1e-6)
        assert robot.scan("sc") == pytest.approx(RANGES, rel=1e-6)
    assert fake.received == ["sc", "u1", "sc"]


def test_a_scan_may_come_byte_by_byte() -> None:
    [whole] = scanned("sc")
    assert whole is not None
    with (
        binary_robot(lambda command: [whole[i : i + 1] for i in range(len(whole))]) as fake,
        Robot(HOST, fake.port, fake.reply_port) as robot,
    ):
        assert robot.scan("sc") == RANGES
        assert robot.scan("sc") == RANGES


def test_a_scan_of_what_is_no_lidar_is_refused_and_the_robot_stays_usable() -> None:
    answers = {"i1": 1.0, "u1": 12.345, "q9": math.nan}
    with (
        binary_robot(lambda command: [struct.pack(">d", answers[command])]) as fake,
        reasons_given(fake) as port,
        Robot(HOST, fake.port, fake.reply_port, belief_port=port) as robot,
    ):
        with pytest.raises(CommandRefusedError, match=r"'u1' is no lidar: it answered 12.345.*robot.read"):
            robot.scan("u1")
        with pytest.raises(CommandRefusedError, match="'i1' is no lidar: it answered 1"):
            robot.scan("i1")  # as good as a count; the simulator says that it is none
        with pytest.raises(UnknownCodeError, match=r"no lidar 'q9' \(no such code\)"):
            robot.scan("q9")
        with pytest.raises(InvalidInputError):
            robot.scan("sc-90")
        assert robot.read("u1") == 12.345


def test_one_number_asked_of_a_lidar_is_refused_and_the_robot_stays_usable() -> None:
    with (
        binary_robot(scanned) as fake,
        reasons_given(fake) as port,
        Robot(HOST, fake.port, fake.reply_port, belief_port=port) as robot,
    ):
        hint = r"'sc' is a lidar.*robot.scan\('sc'\).*robot.send\('sc-90'\)"
        with pytest.raises(CommandRefusedError, match=hint):
            robot.read("sc")
        with pytest.raises(CommandRefusedError, match=hint):
            robot.read("u1", "sc", "u3")
        with pytest.raises(CommandRefusedError, match=hint):
            robot.send("sc")
        assert robot.read("u1", "u3") == (12.345, math.inf)
        assert robot.scan("sc") == RANGES


@pytest.mark.parametrize("separate", [True, False], ids=["two connections", "one connection"])
@pytest.mark.parametrize("rays", [1, 2])
def test_a_scan_that_fits_in_the_room_for_other_readings_is_refused_and_keeps_the_robot_in_step(
    separate: bool, rays: int
) -> None:
    """A lidar of one ray and a second sensor: two numbers are asked for and three come."""

    def answer(command: str) -> list[Piece]:
        ranges = RANGES[:rays]
        return [struct.pack(f">{rays + 1}d", rays, *ranges)] if command == "sc" else encoded(command)

    with (
        binary_robot(answer, separate) as fake,
        reasons_given(fake) as port,
        Robot(HOST, fake.port, fake.reply_port, belief_port=port) as robot,
    ):
        for codes in (("sc", "u1"), ("u1", "sc", "u3"), ("sc", "u1", "u3"), ("sc",)):
            with pytest.raises(CommandRefusedError, match=r"'sc' is a lidar.*robot.scan\('sc'\)"):
                robot.read(*codes)
            assert robot.read("u1", "u3") == (12.345, math.inf)
        assert robot.scan("sc") == RANGES[:rays]


def test_whole_numbers_of_other_sensors_are_readings() -> None:
    with (
        binary_robot(lambda command: [struct.pack(">d", 1.0)]) as fake,
        reasons_given(fake) as port,
        Robot(HOST, fake.port, fake.reply_port, belief_port=port) as robot,
    ):
        assert robot.read("i1", "o1", "i2") == (1.0, 1.0, 1.0)


def test_one_number_asked_of_a_lidar_where_nobody_says_what_it_is_ends_the_connection(free_port: int) -> None:
    with (
        binary_robot(scanned) as fake,
        Robot(HOST, fake.port, fake.reply_port, belief_port=free_port) as robot,
    ):
        with pytest.raises(RobotError, match=r"more came back for 'sc'.*robot.scan"):
            robot.read("sc")
        assert robot.closed


def test_a_scan_that_breaks_off_or_is_too_long_closes_the_robot(free_port: int) -> None:
    half, much = struct.pack(">2d", 3, 1.0), struct.pack(">3d", 1, 1.0, 2.0)
    for reply, problem in (([half, None], "before it answered"), ([much], "more came back")):
        with (
            binary_robot(lambda command, reply=reply: reply) as fake,
            Robot(HOST, fake.port, fake.reply_port, belief_port=free_port) as robot,
        ):
            with pytest.raises(RobotError, match=problem):
                robot.scan("sc")
            assert robot.closed


def test_scans_of_packets() -> None:
    answers = {"sc": "12.345;11.220;inf;7.000", "u1": "12.345", "d1": "True", "q9": "Not Found"}
    with packet_robot(lambda command: answers[command]) as fake, reasons_given(fake) as port:
        robot = Robot(HOST, fake.port, fake.reply_port, protocol="packets", belief_port=port)
        assert robot.scan("sc") == RANGES
        with pytest.raises(CommandRefusedError, match=r"'u1' is no lidar: it answered 12\.345"):
            robot.scan("u1")
        with pytest.raises(UnknownCodeError, match="no lidar 'q9'"):
            robot.scan("q9")
        with pytest.raises(CommandRefusedError, match=r"'sc' is a lidar.*robot.scan"):
            robot.read("u1", "sc")
        assert robot.read("u1") == 12.345
    assert fake.received == ["[sc]", "[u1]", "[q9]", "[u1,sc]", "[u1]"]


def test_drive_returns_what_the_robot_said() -> None:
    with binary_robot() as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
        movement = robot.drive("d1", 3.0)
        assert movement == ("d1-3", math.inf)
        assert movement.ended
    with (
        binary_robot(lambda _: [struct.pack(">d", 2.75)]) as fake,
        Robot(HOST, fake.port, fake.reply_port) as robot,
    ):
        movement = robot.drive("d1", 3)  # a robot that says how far it came
        assert (movement.reply, movement.ended) == (2.75, False)
    with packet_robot(lambda _: "True") as fake, packets(fake) as robot:
        assert robot.drive("w0", 3).ended


def test_maze_and_robot_are_those_the_simulator_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("CONFIG", "MAZE", "DRIVE_PROFILE", "SENSOR_PROFILE"):
        monkeypatch.delenv(f"SIMMER_{name}", raising=False)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "maze.csv").write_text("2,1\n1,3\n")
    with binary_robot() as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
        assert robot.maze()[0] == (3, 3, 1, 1, 0, 2, 0, 2)
        assert robot.configuration().simulation.gripper is None
        monkeypatch.setenv("SIMMER_CONFIG", "mission")
        monkeypatch.setenv("SIMMER_DRIVE_PROFILE", "diff-dc")
        monkeypatch.setenv("SIMMER_MAZE", "maze.csv")
        assert robot.maze() == ((2, 1), (1, 3))
        simulation = robot.configuration().simulation
        assert simulation.gripper.code == "p1"
        assert [each.code for each in simulation.drives if each.enabled] == ["a1", "d1", "r1"]
        (tmp_path / "maze.csv").write_text("7")
        with pytest.raises(RobotError, match=r"mistakes: maze.csv:1:A"):
            robot.maze()
        monkeypatch.setitem(sys.modules, "simmer_tui.notebook", None)
        with pytest.raises(RobotError, match=re.escape(f"pip install '{requirement()}'")):
            robot.maze()


def test_commands_leave_without_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[socket.socket] = []

    def connect(*args: Any, **options: Any) -> socket.socket:
        made.append(create_connection(*args, **options))
        return made[-1]

    create_connection = socket.create_connection
    monkeypatch.setattr(socket, "create_connection", connect)
    with binary_robot() as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
        (commands,) = [each for each in made if each.getpeername()[1] == fake.port]
        assert commands.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        assert robot.read("u1") == 12.345


def test_without_a_reply_port_replies_come_on_the_command_connection(free_port: int) -> None:
    with binary_robot(separate=False) as fake, Robot(HOST, fake.port, free_port) as robot:
        assert robot.reply_port == 0
        assert robot.read("u1") == 12.345


def test_a_reply_may_come_byte_by_byte() -> None:
    number = struct.pack(">d", 12.345)
    with (
        binary_robot(lambda command: [number[i : i + 1] for i in range(8)]) as fake,
        Robot(HOST, fake.port, fake.reply_port) as robot,
    ):
        assert [robot.read("u1") for _ in range(20)] == [12.345] * 20


def test_nan_is_an_unknown_sensor_or_a_refused_drive_and_the_robot_stays_usable() -> None:
    with binary_robot() as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
        with pytest.raises(UnknownCodeError, match=r"no sensor 'q9'"):
            robot.read("q9")
        with pytest.raises(CommandRefusedError, match=r"refused 'q9-2000000'"):
            robot.drive("q9", 2e6)
        assert robot.read("u1") == 12.345


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (3, "3"),
        (3.0, "3"),
        (-45, "-45"),
        (2.4, "2.4"),
        (-0.0, "0"),
        (0.1 + 0.2, "0.30000000000000004"),
        (1e-5, "1e-05"),
        (np.float64(2.5), "2.5"),
        (np.float32(0.5), "0.5"),
        (np.int16(-7), "-7"),
        (Decimal("1.25"), "1.25"),
        (Fraction(1, 4), "0.25"),
    ],
)
def test_numbers_of_all_kinds_are_sent_as_decimals(value: Any, text: str) -> None:
    with binary_robot(finished) as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
        robot.drive("d1", value)
    assert fake.received == [f"d1-{text}"]


def test_a_number_reads_back_exactly() -> None:
    with binary_robot(finished) as fake, Robot(HOST, fake.port, fake.reply_port) as robot:

        @given(st.floats(allow_nan=False, allow_infinity=False))
        def sent(value: float) -> None:
            robot.drive("d1", value)
            assert float(fake.received[-1].removeprefix("d1-")) == value

        sent()


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "3", True, None, [1], 10**400, np.nan])
def test_a_value_that_is_no_finite_number_is_never_sent(value: Any) -> None:
    with binary_robot() as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
        with pytest.raises(ValueError, match="must be a finite number"):
            robot.drive("d1", value)
        assert robot.read("u1") == 12.345
    assert fake.received == ["u1"]


@pytest.mark.parametrize("code", ["", "u", "u12", "u\n", "\u00fc1", "u\x00", 11])
def test_a_code_that_is_not_two_printable_ascii_characters_is_never_sent(code: Any) -> None:
    with binary_robot() as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
        with pytest.raises(InvalidInputError, match="two printable ASCII characters"):
            robot.read(code)
        with pytest.raises(InvalidInputError, match="two printable ASCII characters"):
            robot.drive(code, 1)
        assert robot.read("u1") == 12.345
    assert fake.received == ["u1"]


@pytest.mark.parametrize("command", ["u1\nu2", "u1\r", "d1-\u0663", "x" * 256, b"u1"])
def test_a_command_that_would_come_apart_is_never_sent(command: Any) -> None:
    with binary_robot() as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
        with pytest.raises(InvalidInputError, match="is no command"):
            robot.send(command)
        assert math.isnan(robot.send(""))
    assert fake.received == [""]


@pytest.mark.parametrize("seconds", [math.nan, math.inf, "2", None])
def test_a_sleep_that_is_no_finite_number_is_never_sent(seconds: Any) -> None:
    with binary_robot() as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
        with pytest.raises(
            InvalidInputError, match=r"the seconds to sleep is .*: it must be a finite number"
        ):
            robot.sleep(seconds)
        assert robot.read("u1") == 12.345
    assert fake.received == ["u1"]


def test_a_sleep_may_be_longer_than_a_socket_can_wait() -> None:
    with binary_robot(finished) as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
        robot.sleep(1e300)
    assert fake.received == ["wt-1e+300"]


# --- what can go wrong ----------------------------------------------------------------------------


def test_nobody_listening_says_where_and_what_to_start(free_port: int) -> None:
    with pytest.raises(RobotUnreachableError, match=rf"port {free_port} .*Start it with 'simmer-tui'"):
        Robot(HOST, free_port)
    with pytest.raises(RobotUnreachableError, match=rf"port {free_port} .*--config simmer-python"):
        Robot(HOST, 1, free_port, protocol="packets")


def test_a_simulator_that_takes_packets_only_is_named(
    free_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A set such as simmer-python: the simulator gives its program the ports of packets alone."""
    monkeypatch.setenv("SIMMER_PACKET_PORT", "61200")
    monkeypatch.setattr(client, "DEFAULT_PORT", free_port)
    with pytest.raises(RobotUnreachableError, match=r'takes packets.*Robot\(protocol="packets"\)'):
        Robot()


def test_a_simulator_that_ends_in_the_middle_of_a_reply_closes_the_robot() -> None:
    with (
        binary_robot(lambda command: [b"\x40\x28", None]) as fake,
        Robot(HOST, fake.port, fake.reply_port) as robot,
    ):
        with pytest.raises(RobotClosedError, match="before it answered 'u1'"):
            robot.read("u1")
        assert robot.closed
        with pytest.raises(RobotClosedError, match=r"'u1' was cut short .* open a new Robot"):
            robot.read("u2")


def test_a_second_program_is_told_that_another_one_drives() -> None:
    with binary_robot() as fake, Robot(HOST, fake.port, fake.reply_port) as first:
        assert first.read("u1") == 12.345
        with (
            Robot(HOST, fake.port, fake.reply_port) as second,
            pytest.raises(RobotClosedError, match="another program is driving"),
        ):
            second.read("u1")
        assert first.read("u1") == 12.345


def test_after_a_timeout_the_robot_is_closed_and_says_so() -> None:
    with (
        binary_robot(lambda command: []) as fake,
        Robot(HOST, fake.port, fake.reply_port, timeout=0.05) as robot,
    ):
        with pytest.raises(RobotTimeoutError, match=r"no reply to 'd1-3' within 0.05 s"):
            robot.drive("d1", 3)
        with pytest.raises(RobotClosedError, match=r"closed after 'd1-3' was cut short"):
            robot.read("u1")
    assert fake.received == ["d1-3"]


def test_half_a_number_at_the_timeout_hints_at_the_reply_format() -> None:
    with (
        binary_robot(lambda command: [bytes(4)]) as fake,
        Robot(HOST, fake.port, fake.reply_port, timeout=0.5) as robot,
        pytest.raises(RobotTimeoutError, match=r"4 of 8 bytes came: does reply_format match"),
    ):
        robot.read("u1")


def test_more_than_one_number_is_an_error_instead_of_a_wrong_reading() -> None:
    with (
        binary_robot() as fake,
        Robot(HOST, fake.port, fake.reply_port, reply_format="float32") as robot,
        pytest.raises(RobotError, match="reply_format and byte_order must be the simulator's"),
    ):
        robot.read("u1")


def test_a_reply_on_the_wrong_connection_says_how_to_open_the_robot() -> None:
    with (
        listening(until_it_ends) as silent,
        binary_robot(separate=False) as fake,
        Robot(HOST, fake.port, silent) as robot,
        pytest.raises(RobotError, match="reply_port=0"),
    ):
        robot.read("u1")


@pytest.mark.skipif(sys.platform == "win32", reason="needs a signal sent to one thread")
def test_an_interrupt_in_the_middle_of_a_reply_closes_the_robot() -> None:
    main_thread = threading.main_thread().ident
    assert main_thread is not None

    def interrupt(command: str) -> list[Piece]:
        signal.pthread_kill(main_thread, signal.SIGINT)
        return [b"half"]

    with binary_robot(interrupt) as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
        with pytest.raises(KeyboardInterrupt):
            robot.read("u1")
        with pytest.raises(RobotClosedError, match=r"'u1' was cut short \(KeyboardInterrupt\)"):
            robot.read("u1")


def test_closing_twice_is_harmless_and_ends_the_connection() -> None:
    with binary_robot() as fake:
        robot = Robot(HOST, fake.port, fake.reply_port)
        assert robot.read("u1") == 12.345
        assert not robot.closed
        robot.close()
        robot.close()
        assert robot.closed
        with pytest.raises(RobotClosedError, match="this connection is closed"):
            robot.send("u1")


# --- where the robot is ---------------------------------------------------------------------------


def test_a_robot_that_is_dropped_without_close_gives_the_simulator_free() -> None:
    """A cell of a notebook, `robot = Robot()`, is run again: one program at a time drives."""
    with binary_robot(separate=False) as fake:
        robot = Robot(HOST, fake.port, reply_port=0)
        [commands] = [key.fileobj for key in robot._link._selector.get_map().values()]  # type: ignore[union-attr]
        del robot
        assert commands.fileno() == -1  # type: ignore[union-attr]


def test_the_environment_says_where_the_robot_is(monkeypatch: pytest.MonkeyPatch) -> None:
    with binary_robot() as fake:
        monkeypatch.setenv("SIMMER_HOST", f" {HOST} ")
        monkeypatch.setenv("SIMMER_PORT", f" {fake.port} ")
        monkeypatch.setenv("SIMMER_REPLY_PORT", str(fake.reply_port))
        with Robot() as robot:
            assert (robot.port, robot.reply_port) == (fake.port, fake.reply_port)
            assert robot.read("u1") == 12.345
    with binary_robot(separate=False) as fake:
        monkeypatch.setenv("SIMMER_REPLY_PORT", "0")
        with Robot(port=fake.port) as robot:
            assert (robot.port, robot.reply_port) == (fake.port, 0)
            assert robot.read("u1") == 12.345


def test_beside_an_unusual_command_port_nobody_elses_reply_port_is_opened() -> None:
    with binary_robot(separate=False) as fake, Robot(HOST, fake.port) as robot:
        assert robot.reply_port == 0
        assert robot.read("u1") == 12.345


@pytest.mark.parametrize("text", ["abc", "-1", "65536", "9_000", "9e3", "0"])
def test_a_malformed_port_variable_is_named(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv("SIMMER_PORT", text)
    with pytest.raises(InvalidInputError, match=rf"SIMMER_PORT is '{text}': a port is .* 1 to 65535"):
        Robot()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"port": 0}, "port is 0"),
        ({"port": "9000"}, "port is '9000'"),
        ({"reply_port": 70000}, "reply_port is 70000"),
        ({"belief_port": -1}, "belief_port is -1"),
        ({"timeout": 0}, "timeout is 0"),
        ({"timeout": math.nan}, "timeout is nan"),
        ({"timeout": 1e300}, r"timeout is 1e\+300"),
        ({"host": 7}, "host is 7"),
        ({"host": b"127.0.0.1"}, "host is b'127.0.0.1'"),
        ({"protocol": "udp"}, "'binary' or 'packets'"),
        ({"reply_format": "double"}, "'float64' or 'float32'"),
        ({"byte_order": "native"}, "'big' or 'little'"),
    ],
)
def test_an_argument_out_of_range_is_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        Robot(**arguments)


# --- packets --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "answer", "value"),
    [
        ("u0", "12.345", 12.345),
        ("u0", "inf", math.inf),
        ("i0", "True", 1.0),
        ("i0", "False", 0.0),
        ("w0:36", "True", math.inf),
        ("w0-36", "True", math.inf),
        ("w0:36", "False", math.nan),
        ("zz", "Not Found", math.nan),
        ("xx", "DRIVE STOP", math.inf),
    ],
)
def test_packet_replies_become_numbers(command: str, answer: str, value: float) -> None:
    with packet_robot(lambda _: answer) as fake, packets(fake) as robot:
        assert robot.send(command) == pytest.approx(value, nan_ok=True)
    assert fake.received == [f"[{command}]"]


def test_packet_ports_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    with packet_robot(lambda _: "1.5") as fake:
        monkeypatch.setenv("SIMMER_PACKET_PORT", str(fake.port))
        monkeypatch.setenv("SIMMER_PACKET_REPLY_PORT", str(fake.reply_port))
        with Robot(protocol="packets") as robot:
            assert robot.read("u0") == 1.5


def test_a_packet_drive_is_resent_until_accepted_and_waits_for_its_end() -> None:
    answers = iter(["False", "False", "True", "False", "False", "True"])
    with packet_robot(lambda _: next(answers)) as fake, packets(fake) as robot:
        robot.drive("w0", 36)
    assert fake.received == ["[w0:36]"] * 3 + ["[w0:0]"] * 3


def test_packet_drives_that_cannot_work_are_refused_and_the_robot_stays_usable() -> None:
    replies = {"zz:1": "Not Found", "u0:1": "7.000", "u0": "7.000"}
    with packet_robot(replies.__getitem__) as fake, packets(fake) as robot:
        with pytest.raises(UnknownCodeError, match="no drive 'zz'"):
            robot.drive("zz", 1)
        with pytest.raises(CommandRefusedError, match="'u0' is no drive"):
            robot.drive("u0", 1)
        for command in ("[u0", "u0,u1", "u", "u0\n"):
            with pytest.raises(InvalidInputError):
                robot.send(command)
        with pytest.raises(InvalidInputError, match="must not contain"):
            robot.drive("[]", 1)
        assert robot.read("u0") == 7


def test_a_packet_drive_that_stays_busy_times_out() -> None:
    with packet_robot(lambda _: "False") as fake, packets(fake, timeout=0.05) as robot:
        with pytest.raises(RobotTimeoutError, match=r"'w0:36' within 0.05 s|'w0:36' was not accepted"):
            robot.drive("w0", 36)
        assert robot.closed


def test_an_empty_read_is_tried_again() -> None:
    seen = threading.Event()
    with packet_robot(lambda _: "3.000") as fake:
        give = fake.give_reply
        empty_reads: list[int] = []

        def give_late(connection: socket.socket) -> None:
            if seen.is_set() and len(empty_reads) < 3:
                empty_reads.append(1)
                return
            give(connection)

        with (
            listening(give_late) as reply_port,
            Robot(HOST, fake.port, reply_port, protocol="packets") as robot,
        ):
            seen.set()
            assert robot.read("u0") == 3
        assert len(empty_reads) == 3


def test_replies_nobody_read_are_not_taken_for_ours() -> None:
    with packet_robot(lambda _: "3.000") as fake:
        fake.waiting.append(b"[u0:99.000,u0:98.000]")
        with packets(fake) as robot:
            assert robot.read("u0") == 3
            fake.waiting.extend([b"[u1:5.000]", b"[u0:97.000,u1:8.000,u0:4.000,u1:9.000]"])
            assert robot.read("u0") == 4


@pytest.mark.parametrize(
    ("piece", "error"),
    [(b"[u0:1", RobotClosedError), (b"[u0:quick]", RobotError), (b"", RobotTimeoutError)],
    ids=["half a reply", "no number", "no reply"],
)
def test_a_broken_packet_reply_is_a_clear_error(piece: bytes, error: type[RobotError]) -> None:
    with (
        packet_robot(lambda _: "") as fake,
        listening(lambda connection: connection.sendall(piece) if fake.received else None) as reply_port,
        Robot(HOST, fake.port, reply_port, protocol="packets", timeout=10.0 if piece else 0.2) as robot,
    ):
        with pytest.raises(error, match="'u0'"):
            robot.send("u0")
        assert robot.closed


def test_a_packet_simulator_that_has_ended_is_a_clear_error() -> None:
    with packet_robot(lambda _: "1.000") as fake:
        robot = packets(fake)
    with robot, pytest.raises(RobotClosedError, match="has ended"):
        robot.read("u0")


# --- belief ---------------------------------------------------------------------------------------


@contextmanager
def believing() -> Iterator[tuple[Robot, Callable[[], dict[str, Any]]]]:
    """A robot, and what returns the next belief that reached the other side."""
    lines: queue.Queue[bytes] = queue.Queue()

    def collect(connection: socket.socket) -> None:
        with connection.makefile("rb") as stream:
            for line in stream:
                lines.put(line)

    with (
        listening(collect) as belief_port,
        binary_robot() as fake,
        Robot(HOST, fake.port, fake.reply_port, belief_port=belief_port) as robot,
    ):
        yield robot, lambda: json.loads(lines.get(timeout=60))


def test_a_belief_is_one_json_line_with_the_fields_that_were_given() -> None:
    with believing() as (robot, received):
        robot.believe(9.5, 42, -725)
        assert received() == {"x": 9.5, "y": 42, "heading": -725}
        robot.believe(np.float32(1), np.int64(2), 3, 0.5, [(1, 2), [3, 4.5, 90]], 'lost\n"here"')
        assert received() == {
            "x": 1,
            "y": 2,
            "heading": 3,
            "spread": 0.5,
            "particles": [[1, 2], [3, 4.5, 90]],
            "note": 'lost\n"here"',
        }
        assert robot.read("u1") == 12.345


def test_particles_may_be_a_numpy_array_of_any_number() -> None:
    with believing() as (robot, received):
        particles = np.arange(15000.0).reshape(5000, 3)
        robot.believe(0, 0, 0, particles=particles)
        robot.close()
        assert received()["particles"] == particles.tolist()


def test_particles_may_be_numpy_rows_in_a_list() -> None:
    with believing() as (robot, received):
        robot.believe(0, 0, 0, particles=list(np.array([[1.5, 2.5]])))
        assert received()["particles"] == [[1.5, 2.5]]


@pytest.mark.parametrize("kind", ["<f4", "<f8", "u1", "i8"])
def test_a_grid_is_packed_from_an_array_or_from_lists(kind: str) -> None:
    table = np.arange(24.0).reshape(2, 3, 4).astype(kind)
    with believing() as (robot, received):
        robot.believe(grid=table)
        robot.believe(grid=table.tolist(), bounds=(0, 0, 9, 6), first=45, note="n")
        robot.believe(1, 2, 3, grid=tuple(map(tuple, table[..., 1])))
        first, second, third = (received() for _ in range(3))
    assert (first.keys(), third["x"]) == ({"grid"}, 1)
    data = base64.b64decode(first["grid"]["f32"])
    assert np.frombuffer(data, "<f4").reshape(2, 3, 4) * 23 == pytest.approx(table)
    assert second["grid"] == first["grid"] | {"bounds": [0, 0, 9, 6], "first": 45}
    assert first["grid"].keys() == {"rows", "cols", "headings", "f32"}
    assert third["grid"].keys() == {"rows", "cols", "f32"}
    parsed = parse_belief(json.dumps(second).encode(), 0.0, Pose(0, 0, 0), (0, 0, 96, 48))
    assert parsed.pose == Pose(7.5, 1.5, -45.0)


@pytest.mark.quick_cases(8)
@pytest.mark.parametrize(
    ("arguments", "mistake"),
    [
        ({}, "x is missing: only a belief with a grid may leave it out"),
        ({"grid": 5}, "grid must be rows of numbers"),
        ({"grid": [1, 2]}, "grid must be rows of numbers"),
        ({"grid": []}, "grid has 0 rows: it may have 1 to 1000"),
        ({"grid": [[1, 2], [1]]}, "row 2 of grid has 1 numbers, not 2"),
        ({"grid": [[[1, 2], [1]]]}, "cell 2 of grid has 1 numbers, not 2"),
        ({"grid": [[[1, 2], 1]]}, "grid must be rows of numbers"),
        ({"grid": [[1, math.nan]]}, "grid holds a number that is not finite"),
        ({"grid": [[1, -1]]}, "probabilities must be 0 or more, and one of them more than 0"),
        ({"grid": [[0, 0]]}, "probabilities must be 0 or more, and one of them more than 0"),
        ({"grid": np.array([[1.0, math.inf]])}, "grid holds a number that is not finite"),
        ({"grid": np.array([[math.nan, 1.0]])}, "grid holds a number that is not finite"),
        ({"grid": np.array([1.0])}, "grid must have rows and columns, and may have headings"),
        ({"grid": np.array([["a"]])}, "grid must be an array of numbers"),
        ({"grid": np.ones((1, 1001))}, "grid has 1001 columns: it may have 1 to 1000"),
        ({"grid": np.ones((1, 1, 361))}, "grid has 361 headings: it may have 1 to 360"),
        ({"grid": np.ones((300, 300))}, "grid has 90000 states: it may have 65536"),
        ({"grid": [[1]], "bounds": [0, 0, 0, 1]}, "it must be x0, y0, x1, y1 with x0 < x1 and y0 < y1"),
        ({"grid": [[1]], "bounds": 7}, "bounds is 7: it must be x0, y0, x1, y1 with x0 < x1 and y0 < y1"),
        ({"grid": [[1]], "first": math.inf}, "first is inf: it must be a finite number"),
        ({"x": 1, "y": 2, "heading": 3, "first": 4}, "bounds and first are those of a grid: there is none"),
    ],
)
def test_a_grid_of_another_shape_is_refused(arguments: dict[str, Any], mistake: str) -> None:
    with believing() as (robot, received):
        with pytest.raises(InvalidInputError, match=re.escape(mistake)):
            robot.believe(**arguments)
        robot.believe(7, 8, 9)
        assert received()["x"] == 7


@pytest.mark.parametrize(
    "arguments",
    [
        {"x": math.nan},
        {"heading": math.inf},
        {"y": "3"},
        {"spread": math.nan},
        {"spread": -1},
        {"particles": [[1]]},
        {"particles": [[1, 2, 3, 4]]},
        {"particles": [[1, math.nan]]},
        {"particles": np.array([1.0, 2.0])},
        {"particles": 3},
        {"particles": [["a", "b"]]},
    ],
)
def test_a_belief_that_is_no_pose_is_refused(arguments: dict[str, Any]) -> None:
    with believing() as (robot, received):
        with pytest.raises(ValueError, match="must be"):
            robot.believe(**({"x": 1, "y": 2, "heading": 3} | arguments))
        robot.believe(7, 8, 9)
        assert received()["x"] == 7


def test_a_belief_nobody_listens_to_is_harmless(free_port: int) -> None:
    with (
        binary_robot() as fake,
        Robot(HOST, fake.port, fake.reply_port, belief_port=free_port) as robot,
    ):
        robot.believe(1, 2, 3)
        robot.believe(1, 2, 3)
        assert robot.read("u1") == 12.345
    robot.believe(1, 2, 3)


@pytest.mark.slow
def test_a_listener_that_goes_away_or_never_reads_never_stops_the_robot() -> None:
    many = [[float(i), float(i)] for i in range(20000)]
    done = threading.Event()

    def stay_silent(connection: socket.socket) -> None:
        done.wait(60)

    with (
        binary_robot() as fake,
        listening(stay_silent) as never_reads,
        listening(lambda connection: None) as goes_away,
    ):
        for belief_port in (never_reads, goes_away):
            with Robot(HOST, fake.port, fake.reply_port, belief_port=belief_port) as robot:
                for _ in range(40):
                    robot.believe(1, 2, 3, particles=many)
                assert robot.read("u1") == 12.345
        done.set()


def test_the_belief_port_comes_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    lines: queue.Queue[bytes] = queue.Queue()
    with listening(lambda connection: lines.put(connection.recv(1000))) as belief_port:
        monkeypatch.setenv("SIMMER_BELIEF_PORT", str(belief_port))
        with binary_robot() as fake, Robot(HOST, fake.port, fake.reply_port) as robot:
            robot.believe(1, 2, 3)
            assert json.loads(lines.get(timeout=60)) == {"x": 1, "y": 2, "heading": 3}


# --- the file on its own --------------------------------------------------------------------------


def test_a_copy_of_the_file_works_beside_a_program_in_bare_python(tmp_path: Path) -> None:
    shutil.copy(client.__file__, tmp_path / "client.py")
    with binary_robot() as fake:
        program = (
            "import sys; from client import Robot\n"
            f"with Robot('{HOST}', {fake.port}, {fake.reply_port}) as robot: print(robot.read('u1'))\n"
            "assert not {'numpy', 'simmer_tui', 'asyncio'} & set(sys.modules)"
        )
        (tmp_path / "program.py").write_text(program)
        run = subprocess.run(
            [sys.executable, "-S", "program.py"], cwd=tmp_path, capture_output=True, text=True, check=False
        )
    assert (run.stdout, run.stderr, run.returncode) == ("12.345\n", "", 0)
