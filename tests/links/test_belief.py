"""The belief port: what programs say they believe, in order with what they do."""

from __future__ import annotations

import contextlib
import json
import queue
import re
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simmer_tui.client import Robot
from simmer_tui.config import load_default
from simmer_tui.config.loader import Override, find_set, load
from simmer_tui.engine import Belief, Event, Notice, NoticeKind
from simmer_tui.links.belief import LONGEST_LINE, MOST_PARTICLES, parse_belief
from simmer_tui.sim import Outcome, Pose
from simmer_tui.station import BELIEFS, COMMANDS, REPLIES, Station

TRUE = Pose(9.5, 42.0, 0.0)


@dataclass
class Served:
    """A station and the events it told."""

    station: Station
    events: queue.SimpleQueue[Event]

    def connect(self) -> socket.socket:
        port = self.station.port(BELIEFS)
        assert port is not None
        return socket.create_connection(("127.0.0.1", port), timeout=10)

    def robot(self) -> Robot:
        ports = self.station.ports
        return Robot("127.0.0.1", ports[COMMANDS], ports[REPLIES], belief_port=ports[BELIEFS])

    def next_event(self, kind: type[Any]) -> Any:
        while True:
            event = self.events.get(timeout=10)
            if isinstance(event, kind):
                return event


@pytest.fixture
def served() -> Iterator[Served]:
    options = {"server.port": Override("--port", "0"), "seed": Override("--seed", "5")}
    events: queue.SimpleQueue[Event] = queue.SimpleQueue()
    station = Station(load(find_set("default"), options))
    station.start(events.put)
    yield Served(station, events)
    station.stop()


def test_a_belief_is_told_beside_the_true_pose(served: Served) -> None:
    with served.connect() as program:
        line = {
            "x": 10,
            "y": 41.5,
            "heading": 5,
            "spread": 2,
            "particles": [[1, 2], [3, 4, 90]],
            "note": "lost?",
        }
        program.sendall(json.dumps(line).encode() + b"\n")
        belief = served.next_event(Belief)
    assert belief.pose == Pose(10.0, 41.5, 5.0)
    assert belief.true == TRUE
    assert belief.spread == 2.0
    assert belief.particles == ((1.0, 2.0), (3.0, 4.0, 90.0))
    assert belief.note == "lost?"


def test_what_is_believed_before_a_movement_is_held_against_the_pose_before_it(served: Served) -> None:
    with served.robot() as robot:
        robot.believe(0.0, 0.0, 0.0)
        served.next_event(Belief)
        for _ in range(200):
            before = served.station.simulator.pose
            robot.believe(before.x, before.y, before.heading)
            robot.drive("r1", 45)
            belief = served.next_event(Belief)
            assert belief.true == before
            assert served.next_event(Outcome).command.code == "r1"


def test_lines_cut_anywhere_and_several_at_once_are_understood(served: Served) -> None:
    lines = b"".join(b'{"x": %d, "y": 0, "heading": 0}\n' % x for x in range(5))
    with served.connect() as program:
        program.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for place in range(0, len(lines), 7):
            program.sendall(lines[place : place + 7])
        assert [served.next_event(Belief).pose.x for _ in range(5)] == [0, 1, 2, 3, 4]


def test_nonsense_is_complained_of_once_and_the_next_belief_is_taken(served: Served) -> None:
    with served.connect() as program:
        program.sendall(
            b"nonsense\n\xff\xfe\n[1]\n" + b"x" * (LONGEST_LINE + 10) + b'\n{"x": 1, "y": 2, "heading": 3}\n'
        )
        seen: list[Event] = []
        while not seen or not isinstance(seen[-1], Belief):
            seen.append(served.events.get(timeout=10))
    complaints = [each for each in seen if isinstance(each, Notice) and each.kind is NoticeKind.FAULT]
    assert len(complaints) == 1
    assert "JSON object a line" in complaints[0].text


def test_programs_come_and_go(served: Served) -> None:
    for x in range(20):
        with served.connect() as program:
            program.sendall(b'{"x": %d, "y": 0, "heading": 0}\n' % x)
            assert served.next_event(Belief).pose.x == x
    with served.robot() as robot:
        assert robot.read("u1") > 0


def test_a_taken_belief_port_is_only_a_warning() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = str(taken.getsockname()[1])
        options = {
            "server.port": Override("--port", "0"),
            "server.belief_port": Override("--belief-port", number),
        }
        station = Station(load(find_set("default"), options))
        try:
            assert station.port(BELIEFS) is None
            assert number in station.warnings[0]
            assert "SIMMER_BELIEF_PORT" not in station.environment
        finally:
            station.stop()


@pytest.mark.parametrize(
    ("line", "what"),
    [
        (b"", "JSON object"),
        (b"3", "an object"),
        (b'{"x": 1, "y": 2}', "heading must be a number"),
        (b'{"x": true, "y": 2, "heading": 0}', "x must be a number"),
        (b'{"x": 1e999, "y": 2, "heading": 0}', "x must be finite"),
        (b'{"x": NaN, "y": 2, "heading": 0}', "x must be finite"),
        (b'{"x": 1, "y": 2, "heading": 0, "colour": 1}', "'colour' is not a field"),
        (b'{"x": 1, "y": 2, "heading": 0, "note": 5}', "note must be text"),
        (b'{"x": 1, "y": 2, "heading": 0, "particles": 5}', "particles must be a list"),
        (b'{"x": 1, "y": 2, "heading": 0, "particles": [[1]]}', "each particle"),
        (b'{"x": 1, "y": 2, "heading": 0, "particles": [[1, "a"]]}', "a particle's number must be a number"),
        (b"[" * 100000, "JSON object"),
    ],
)
def test_what_is_wrong_with_a_belief_is_said(line: bytes, what: str) -> None:
    with pytest.raises(ValueError, match=re.escape(what)):
        parse_belief(line, 0.0, TRUE)


def test_particles_are_thinned_evenly() -> None:
    rows = [[i, 0] for i in range(3 * MOST_PARTICLES)]
    line = json.dumps({"x": 0, "y": 0, "heading": 0, "particles": rows}).encode()
    particles = parse_belief(line, 0.0, TRUE).particles
    assert len(particles) <= MOST_PARTICLES
    assert particles[1] == (3.0, 0.0)


@given(st.binary(max_size=200))
def test_no_bytes_do_anything_but_make_a_belief_or_a_value_error(line: bytes) -> None:
    with contextlib.suppress(ValueError):
        assert isinstance(parse_belief(line, 0.0, TRUE), Belief)


def test_the_default_port_is_9002() -> None:
    assert load_default().settings.server.belief_port == 9002
