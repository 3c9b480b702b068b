"""The side door for beliefs: what is understood, what is not, and that it harms nothing else."""

from __future__ import annotations

import json
import queue
import re
import socket
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.client import Robot
from simmer_tui.config.loader import Override, load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.links.belief_link import LONGEST_LINE
from simmer_tui.links.belief_parser import MOST_PARTICLES, parse_belief
from simmer_tui.live.server import Server
from simmer_tui.run.events import Belief, Event, Notice, NoticeKind
from simmer_tui.sim import Pose

TRUE = Pose(1.0, 2.0, 3.0)
MAZE = (0.0, 0.0, 96.0, 48.0)
SECONDS = 120.0


def parse(value: Any) -> Belief:
    return parse_belief(json.dumps(value).encode(), 4.0, TRUE, MAZE)


def test_all_fields_are_taken() -> None:
    belief = parse(
        {"x": 1, "y": 2.5, "heading": -90, "spread": -2, "particles": [[1, 2], [3, 4, 5]], "note": "a"}
    )
    assert belief == Belief(4.0, Pose(1.0, 2.5, -90.0), TRUE, 2.0, ((1.0, 2.0), (3.0, 4.0, 5.0)), "a")
    assert parse({"x": 1, "y": 2, "heading": 0, "note": None, "particles": None}) == Belief(
        4.0, Pose(1, 2, 0), TRUE
    )


@pytest.mark.parametrize(
    ("value", "mistake"),
    [
        ([1], 'a belief is an object, such as {"x": 6, "y": 42, "heading": 0}'),
        ({"x": 1, "y": 2}, "heading must be a number"),
        ({"x": True, "y": 2, "heading": 0}, "x must be a number"),
        ({"x": "1", "y": 2, "heading": 0}, "x must be a number"),
        ({"x": 1, "y": float("inf"), "heading": 0}, "y must be finite"),
        ({"x": 10**400, "y": 2, "heading": 0}, "x must be finite"),
        ({"x": 1, "y": 2, "heading": 0, "hea\x1b": 1}, "'hea\x1b' is no field of a belief"),
        ({"x": 1, "y": 2, "heading": 0, "note": 5}, "note must be text"),
        ({"x": 1, "y": 2, "heading": 0, "particles": 5}, "particles must be a list"),
        ({"x": 1, "y": 2, "heading": 0, "particles": [[1]]}, "each particle must be"),
        ({"x": 1, "y": 2, "heading": 0, "particles": [[1, None]]}, "a particle's number must be a number"),
    ],
)
def test_what_is_wrong_is_named(value: Any, mistake: str) -> None:
    with pytest.raises(ValueError, match=re.escape(mistake)):
        parse(value)


def test_particles_and_notes_are_bounded() -> None:
    rows = [[n, n] for n in range(3 * MOST_PARTICLES)]
    belief = parse({"x": 1, "y": 2, "heading": 0, "particles": rows, "note": "n" * 1000})
    assert len(belief.particles) == MOST_PARTICLES
    assert belief.particles[:2] == ((0.0, 0.0), (3.0, 3.0))
    assert len(belief.note) == 200


@settings(max_examples=20)
@given(st.binary(max_size=60) | st.recursive(st.none() | st.floats() | st.text(), st.lists).map(json.dumps))
def test_any_bytes_are_a_belief_or_a_mistake(line: bytes | str) -> None:
    data = line if isinstance(line, bytes) else line.encode()
    mistake = ""
    try:
        parse_belief(data, 0.0, TRUE, MAZE)
    except ValueError as error:
        mistake = str(error)
    assert mistake.isprintable()


class Served:
    """A server, and what it told."""

    def __init__(self) -> None:
        overrides = {"server.port": Override("--port", 0), "seed": Override("--seed", 5)}
        self.server = Server(load(bundled_folder(), overrides))
        self.events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self.server.start(self.events.put)

    def connect(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.server.ports["beliefs"]), SECONDS)

    def next(self) -> Event:
        return self.events.get(timeout=SECONDS)


@pytest.fixture
def served() -> Iterator[Served]:
    made = Served()
    yield made
    made.server.stop()


GOOD = b'{"x": 6, "y": 42, "heading": 1}\n'


def test_beliefs_come_in_any_pieces_with_the_truth_of_the_moment(served: Served) -> None:
    with served.connect() as sock:
        for piece in (GOOD[:7], GOOD[7:] + b"\n\r\n" + GOOD, GOOD.rstrip(), b"\r\n"):
            sock.sendall(piece)
        for _ in range(3):
            event = served.next()
            assert isinstance(event, Belief)
            assert event.pose == Pose(6.0, 42.0, 1.0)
            assert event.true == Pose(9.5, 42.0, 0.0)


def test_a_program_that_errs_is_told_of_once_and_its_good_lines_count(served: Served) -> None:
    with served.connect() as sock:
        sock.sendall(b"nonsense\n{}\n" + GOOD)
        first, second = served.next(), served.next()
    assert first == Notice(NoticeKind.FAULT, "belief not understood: a belief is one JSON object a line")
    assert isinstance(second, Belief)


def test_a_line_without_an_end_is_dropped_and_the_next_one_counts(served: Served) -> None:
    with served.connect() as sock:
        sock.sendall(b"[" * (LONGEST_LINE + 70_000))
        sock.sendall(b"\n" + GOOD)
        while not isinstance(event := served.next(), Belief):
            assert isinstance(event, Notice)
        assert event.pose.x == 6.0


def test_several_programs_believe_at_once_and_none_touches_the_commands(served: Served) -> None:
    ports = served.server.ports
    with served.connect() as one, served.connect() as two:
        one.sendall(GOOD)
        two.sendall(GOOD)
        assert isinstance(served.next(), Belief)
        assert isinstance(served.next(), Belief)
        with Robot("127.0.0.1", ports["commands"], ports["replies"], belief_port=ports["beliefs"]) as robot:
            robot.believe(7.0, 8.0, 9.0, 0.5, [(1.0, 2.0)], "here")
            assert robot.send("d1-1") == float("inf")
        while not isinstance(event := served.next(), Belief):
            assert isinstance(event, Notice)
        assert event.note == "here"


def test_a_hundred_programs_that_believe_and_leave_at_once_are_all_believed(served: Served) -> None:
    with served.connect() as patient:
        busy, done = threading.Event(), threading.Event()
        served.server.call(busy.set)
        served.server.call(done.wait, SECONDS)
        assert busy.wait(SECONDS)
        for _ in range(100):
            with served.connect() as sock:
                sock.sendall(GOOD)
        done.set()
        for _ in range(100):
            assert isinstance(served.next(), Belief)
        patient.sendall(GOOD)
        assert isinstance(served.next(), Belief)


def test_a_belief_port_in_use_is_only_a_warning() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1]
        overrides = {
            "server.port": Override("--port", 0),
            "server.belief_port": Override("--belief-port", number),
        }
        server = Server(load(bundled_folder(), overrides))
        server.start()
        try:
            assert "beliefs" not in server.ports
            assert "SIMMER_BELIEF_PORT" not in server.environment
            assert [warning.startswith("no beliefs will be shown: ") for warning in server.warnings] == [True]
        finally:
            server.stop()
