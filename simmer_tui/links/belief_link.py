"""The side door where programs say what they believe: newline-delimited JSON, one belief a line."""

from __future__ import annotations

import asyncio
import json
import math
import socket
from typing import Any

from simmer_tui.engine import Engine
from simmer_tui.events import Belief, Notice, NoticeKind
from simmer_tui.links.acceptor import Acceptor
from simmer_tui.links.ports import Listener
from simmer_tui.sim.command import escape
from simmer_tui.sim.pose import Pose

LONGEST_LINE = 1024 * 1024
"""Longest line, bytes; room for some 20,000 particles."""
_READ = 256 * 1024
MOST_PARTICLES = 5000
"""Particles kept of one belief, evenly picked; a screen shows no more."""


def parse_belief(line: bytes, time: float, true: Pose) -> Belief:
    """A belief from one line of JSON. Raises ValueError that says what is allowed."""
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        raise ValueError("a belief is one JSON object a line") from None
    if not isinstance(fields, dict):
        raise ValueError('a belief is an object, such as {"x": 6, "y": 42, "heading": 0}')
    unknown = sorted(set(fields) - {"x", "y", "heading", "spread", "particles", "note"})
    if unknown:
        raise ValueError(
            f"'{escape(unknown[0], 20)}' is not a field; there are x, y, heading, spread, particles, note"
        )
    pose = Pose(*(_number(fields.get(name), name) for name in ("x", "y", "heading")))
    spread = None if fields.get("spread") is None else abs(_number(fields["spread"], "spread"))
    note = fields.get("note") or ""
    if not isinstance(note, str):
        raise ValueError("note must be text")
    return Belief(time, pose, true, spread, _particles(fields.get("particles")), note[:200])


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name} must be a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite")
    return number


def _particles(value: Any) -> tuple[tuple[float, ...], ...]:
    if value is None:
        return ()
    if not isinstance(value, list):
        raise ValueError("particles must be a list of [x, y] or [x, y, heading]")
    particles = []
    for row in value[:: max(1, math.ceil(len(value) / MOST_PARTICLES))]:
        if not isinstance(row, list) or len(row) not in (2, 3):
            raise ValueError("each particle must be [x, y] or [x, y, heading]")
        particles.append(tuple(_number(number, "a particle's number") for number in row))
    return tuple(particles)


class _Believer:
    """One program's connection."""

    def __init__(self, sock: socket.socket, engine: Engine) -> None:
        self.sock = sock
        self._engine = engine
        self._buffer = bytearray()
        self._complained = False

    def read(self) -> bool:
        """Take in all that has come. Returns whether the connection is still open."""
        while True:
            try:
                data = self.sock.recv(_READ)
            except BlockingIOError:
                return True
            except OSError:
                return False
            if not data:
                return False
            self._receive(data)

    def _receive(self, data: bytes) -> None:
        self._buffer += data
        *lines, rest = self._buffer.split(b"\n")
        for line in lines:
            if line.strip() and len(line) <= LONGEST_LINE:
                self._take(bytes(line))
        self._buffer = bytearray() if len(rest) > LONGEST_LINE else rest

    def _take(self, line: bytes) -> None:
        time, simulator = self._engine.now(), self._engine.simulator
        try:
            self._engine.tell(parse_belief(line, time, simulator.pose))
        except ValueError as error:
            if not self._complained:  # a program that errs does so with every line
                self._complained = True
                self._engine.tell(Notice(NoticeKind.FAULT, f"belief not understood: {error}"))


class BeliefLink:
    """Serves the belief port; any number of programs may be connected.

    What a program believed before it drives on is held against the pose of that moment, although
    it comes by another connection: the engine has all beliefs read before each movement.
    """

    def __init__(self, engine: Engine, listener: Listener) -> None:
        """Begin to listen. Needs a running event loop."""
        self._loop = asyncio.get_running_loop()
        self._engine = engine
        self._believers: list[_Believer] = []
        self._door = Acceptor(listener, self._welcome)

    def _welcome(self, sock: socket.socket, peer: str) -> None:
        believer = _Believer(sock, self._engine)
        self._believers.append(believer)
        self._engine.before_drive = self._read_all
        self._loop.add_reader(sock, self._read, believer)

    def _read_all(self) -> None:
        for believer in tuple(self._believers):
            self._read(believer)

    def _read(self, believer: _Believer) -> None:
        if not believer.read():
            self._drop(believer)

    def _drop(self, believer: _Believer) -> None:
        self._loop.remove_reader(believer.sock)
        believer.sock.close()
        self._believers.remove(believer)
        if not self._believers:
            self._engine.before_drive = None

    def close(self) -> None:
        """Stop listening and end all connections."""
        self._door.close()
        for believer in tuple(self._believers):
            self._drop(believer)
