"""Why a command was refused: asked on the belief port, by the client library and by hand."""

from __future__ import annotations

import json
import math
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from simmer_tui.client import CommandRefusedError, Robot, RobotError, UnknownCodeError
from simmer_tui.config.dialects import BELIEFS, COMMANDS, PACKET_REPLIES, PACKETS, REPLIES
from simmer_tui.config.loader import find_set, load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.config.settings_file import Override
from simmer_tui.live.server import Server
from simmer_tui.run.events import CommandResult, Event, MovementEnded, Notice
from tests.listening import HOST, listening

SECONDS = 120.0


@contextmanager
def serving(folder: Path | None = None, **settings: object) -> Iterator[tuple[Server, list[Event]]]:
    given: dict[str, object] = {"server.port": 0, "server.packet_port": 0, "seed": 1}
    given |= {name.replace("__", "."): value for name, value in settings.items()}
    overrides = {name: Override("--it", value) for name, value in given.items()}
    server = Server(load(folder or bundled_folder(), overrides))
    events: list[Event] = []
    server.start(events.append)
    try:
        yield server, events
    finally:
        server.stop()


def robot_of(server: Server) -> Robot:
    ports = server.ports
    return Robot(
        HOST, ports[COMMANDS.purpose], ports[REPLIES.purpose], belief_port=ports[BELIEFS.purpose], timeout=60
    )


def packet_robot_of(server: Server) -> Robot:
    ports = server.ports
    return Robot(
        HOST,
        ports[PACKETS.purpose],
        ports[PACKET_REPLIES.purpose],
        protocol="packets",
        belief_port=ports[BELIEFS.purpose],
        timeout=60,
    )


def test_a_sensor_driven_by_is_told() -> None:
    with serving() as (server, _), robot_of(server) as robot:
        with pytest.raises(CommandRefusedError, match=r"'u1' is no drive: u1 is a sensor, and it answered"):
            robot.drive("u1", 3)
        robot.drive("d1", 1)


def test_each_reason_of_a_refusal_is_told(tmp_path: Path) -> None:
    with serving() as (server, events), robot_of(server) as robot:
        with pytest.raises(CommandRefusedError, match=r"refused 'd1-2000000': .*beyond the limit of 1e\+06"):
            robot.drive("d1", 2e6)
        with pytest.raises(UnknownCodeError, match=r"no sensor or drive has the code d9; did you mean d1"):
            robot.drive("d9", 1)
        with pytest.raises(UnknownCodeError, match=r"no sensor 'd1' \('d1' is a drive\)"):
            robot.read("d1")
        with pytest.raises(UnknownCodeError, match=r"'u9' \(no sensor or drive has the code u9"):
            robot.read("u9")
        assert not [event.text for event in events if isinstance(event, Notice) and "belief" in event.text]


def test_a_robot_that_still_moves_is_the_reason() -> None:
    with serving(motion__motion="timed", motion__reply="accepted") as (server, _), robot_of(server) as robot:
        robot.drive("d1", 1)
        with pytest.raises(CommandRefusedError, match=r"refused 'd1-2': the robot is still moving$"):
            robot.drive("d1", 2)


def test_packets_say_at_once_that_a_value_is_refused() -> None:
    with serving(server__listeners=("packets",)) as (server, _), packet_robot_of(server) as robot:
        with pytest.raises(CommandRefusedError, match=r"refused 'd1:2000000': .*beyond the limit"):
            robot.drive("d1", 2e6)
        with pytest.raises(CommandRefusedError, match=r"u1 is a sensor"):
            robot.drive("u1", 2)
        robot.drive("d1", 1)


def test_what_is_refused_only_while_the_robot_moves_is_asked_again_in_packets() -> None:
    with (
        serving(server__listeners=("packets",), motion__motion="timed") as (server, events),
        packet_robot_of(server) as robot,
    ):
        assert robot.send("d1:2") == math.inf
        robot.drive("d1", 1)
    reasons = {event.reason for event in events if isinstance(event, CommandResult) and event.reason}
    assert reasons == {"the robot is still moving"}


@pytest.mark.parametrize("motion", ["instant", "timed"])
def test_a_gripper_that_closed_stays_closed_in_packets(motion: str) -> None:
    with (
        serving(find_set("mission"), server__listeners=("packets",), motion__motion=motion) as (
            server,
            events,
        ),
        packet_robot_of(server) as robot,
    ):
        robot.drive("p1", 1)
        robot.drive("d1", 0)
    grips = [event.grip.closed for event in events if isinstance(event, MovementEnded) and event.grip]
    assert grips
    assert all(grips)


def answering(number: bytes) -> Callable[[socket.socket], None]:
    """A robot that answers each line with one number."""

    def serve(connection: socket.socket) -> None:
        while connection.recv(4096):
            connection.sendall(number)

    return serve


def test_a_real_robots_finite_answer_to_a_drive_is_an_answer() -> None:
    """Nobody says that it is a sensor: no question is answered, or the code is a drive's."""
    zero = bytes(8)
    silent = threading.Event()

    def never(connection: socket.socket) -> None:
        assert b'{"why": "d1"}' in connection.recv(4096)
        asked.append(1)
        silent.wait(SECONDS)

    asked: list[int] = []
    with listening(answering(zero)) as port, listening(never) as beliefs:
        with Robot(HOST, port, 0, belief_port=beliefs) as robot:
            assert robot.drive("d1", 3).reply == 0.0
            assert robot.drive("d1", 3).reply == 0.0
            assert robot.drive("d1", 3).reply == 0.0
        silent.set()
    assert len(asked) == 1, "an older simulator is asked only once"


def test_another_simulators_word_does_not_count() -> None:
    with (
        serving() as (server, _),
        listening(answering(bytes(8))) as port,
        Robot(HOST, port, 0, belief_port=server.ports[BELIEFS.purpose]) as robot,
    ):
        assert robot.drive("u1", 3).reply == 0.0


@pytest.mark.parametrize(
    "answer", [b"", b"\n", b"[]\n", b'{"ports": 3}\n', b"\xff\n", b'{"ports": [1], "why": 3}\n', b"x" * 9000]
)
def test_an_answer_that_is_none_is_not_taken_for_one(answer: bytes) -> None:
    def nonsense(connection: socket.socket) -> None:
        connection.recv(4096)
        connection.sendall(answer)

    nan = b"\x7f\xf8" + bytes(6)
    with (
        listening(answering(nan)) as port,
        listening(nonsense) as beliefs,
        Robot(HOST, port, 0, belief_port=beliefs) as robot,
        pytest.raises(CommandRefusedError, match="the robot is still moving") as told,
    ):
        robot.drive("d1", 3)
    assert isinstance(told.value, RobotError)


def test_questions_and_beliefs_share_a_connection() -> None:
    with serving() as (server, _), robot_of(server) as robot:
        robot.send("u9")
        place = (HOST, server.ports[BELIEFS.purpose])
        with socket.create_connection(place, SECONDS) as connection, connection.makefile("rb") as answers:
            connection.sendall(b'{"x": 1, "y": 2, "heading": 3}\n{"why": "u9"}\n{"why": "u1"}\n')
            first, second = json.loads(answers.readline()), json.loads(answers.readline())
    assert first["kind"] == "unknown"
    assert first["why"].startswith("no sensor or drive has the code u9")
    assert (second["why"], second["kind"]) == ("", "sensor")
    assert server.ports[COMMANDS.purpose] in first["ports"]


def test_many_refusals_keep_the_newest() -> None:
    with serving() as (server, _), robot_of(server) as robot:
        for number in range(200):
            robot.send(f"d1-{number}x")
        with pytest.raises(CommandRefusedError, match="beyond the limit"):
            robot.drive("d1", 1e7)
