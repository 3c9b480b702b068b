"""A thousand hostile streams to the ports of one server: none is trouble for the program that behaves."""

from __future__ import annotations

import contextlib
import math
import random
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.config.loader import Override, load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.live.server import Server
from simmer_tui.run.events import Event, Notice
from simmer_tui.sim import CommandResult

BATCH = 50
SECONDS = 120.0
CORPUS = Path(__file__).parent / "corpus" / "network"
STREAMS = {
    folder.name.replace("_", " "): {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
    for folder in sorted(CORPUS.iterdir())
}
"""By port; kept because they were trouble once, or say what is common there."""
WORDS = (
    *(b"u1", b"d1-1", b"r1--45", b"xx", b"i1", b"w1:3", b"zz", b"[", b"]", b",", b":", b"-", b"\n", b"\r\n"),
    *(b"[u1]", b"[]", b"[xx]", b'{"x":1,"y":2,"heading":3}\n', b'"particles":', b"[1,2],", b'"note":'),
)


class Attacked:
    """A server, and what it told."""

    def __init__(self) -> None:
        given = {"server.port": 0, "server.listeners": "binary,packets", "seed": 5}
        self.told: list[str] = []
        self.readings: dict[float, float] = {}
        """The answer to u1, and the true value then."""
        self.server = Server(load(bundled_folder(), {name: Override("--it", v) for name, v in given.items()}))
        self.server.start(self._watch)

    def _watch(self, event: Event) -> None:
        if isinstance(event, Notice):
            self.told.append(event.text)
        elif isinstance(event, CommandResult) and event.reading is not None and event.command.text == "u1":
            self.readings[event.reply] = event.reading.true

    def connect(self, purpose: str) -> socket.socket:
        sock = socket.create_connection(("127.0.0.1", self.server.ports[purpose]), SECONDS)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return sock

    def attack(self, purpose: str, data: bytes, chance: random.Random) -> socket.socket | None:
        """Send a stream in pieces and end it in one of four ways, one of which is not to."""
        sock = self.connect(purpose)
        with contextlib.suppress(ConnectionError):  # it may well be turned away
            while data:
                size = chance.choice((1, 2, 7, 100, 5000, len(data)))
                sock.sendall(data[:size])
                data = data[size:] if chance.random() > 0.02 else b""
            match chance.randrange(4):
                case 0:
                    sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                case 1 if purpose not in ("commands", "replies"):  # who stays there has the next turn
                    return sock
                case 2:
                    with contextlib.suppress(OSError):  # ENOTCONN, which is no ConnectionError: reset already
                        sock.shutdown(socket.SHUT_WR)
                    sock.settimeout(SECONDS if purpose == "commands" else 0.001)
                    with contextlib.suppress(TimeoutError):
                        while sock.recv(65536):
                            pass
                case _:
                    pass
        sock.close()
        return None

    def check(self) -> None:
        """A program that behaves gets its right answers, and nothing has failed inside."""
        for _ in range(100):  # the one before may be about to leave
            with self.connect("commands") as client, contextlib.suppress(ConnectionError):
                client.sendall(b"u1\n")
                if reply := client.recv(8):
                    break
        reading = struct.unpack(">d", reply)[0]
        assert math.isclose(reading, self.readings[reading], rel_tol=0.2)
        self.readings.clear()
        pose = self.server.simulator.pose
        assert all(map(math.isfinite, (pose.x, pose.y, pose.heading)))
        faults = [text for text in self.told if "Error" in text or "xception" in text or "failed" in text]
        assert not faults
        assert all(text.isprintable() and len(text) < 500 for text in self.told)
        self.told.clear()


@pytest.fixture
def attacked() -> Iterator[Attacked]:
    made = Attacked()
    yield made
    made.server.stop()
    assert not made.server.running


@pytest.mark.parametrize("cases", [60, pytest.param(1000, marks=pytest.mark.slow)])
def test_hostile_streams(cases: int, attacked: Attacked, mutate: Any) -> None:
    for first in range(0, cases, BATCH):
        with contextlib.ExitStack() as left_open:
            for seed in range(first, first + BATCH):
                chance = random.Random(seed)
                purpose = chance.choice(sorted(STREAMS))
                data = STREAMS[purpose][chance.choice(sorted(STREAMS[purpose]))]
                if still := attacked.attack(purpose, mutate(data, chance, WORDS), chance):
                    left_open.enter_context(still)
            try:
                attacked.check()
            except AssertionError as error:
                error.add_note(f"seeds {first} to {first + BATCH - 1}")
                raise


@pytest.mark.parametrize(
    ("purpose", "name"), [(purpose, name) for purpose, streams in STREAMS.items() for name in streams]
)
def test_streams_that_once_were_trouble(attacked: Attacked, purpose: str, name: str) -> None:
    chance = random.Random(name)
    for _ in range(3):
        if still := attacked.attack(purpose, STREAMS[purpose][name], chance):
            still.close()
    attacked.check()
