"""The port where programs report the pose they believe in: newline-delimited JSON, one belief a line.

A line may also be a question (`questions.py`), which is answered on the same connection.
"""

from __future__ import annotations

import contextlib
import json
import math
import socket
from itertools import chain, islice
from typing import Any

import numpy as np

from simmer_tui.config.dialects import BELIEFS
from simmer_tui.events import Belief, Notice, NoticeKind
from simmer_tui.links.link import LinkContext
from simmer_tui.links.peer import MOST_WAITING, Peer, ReadBudget
from simmer_tui.links.questions import RefusalReasons
from simmer_tui.sim.command import escape
from simmer_tui.sim.pose import Pose

# A particle as JSON takes some 50 bytes.
LONGEST_LINE = 256 * 1024
"""Longest line, bytes; room for some 5,000 particles."""
# A line costs time even if it is short, so each counts as 4 KiB more than it has.
TURN, LINE = LONGEST_LINE // 2, 4 * 1024
"""Bytes read in a turn of the event loop, and as how many more a line counts: 32 lines at most, or one
with some 5,000 particles, which takes 3 to 8 ms."""
# Judged: more than a large terminal has cells, so that none would be seen apart.
MOST_PARTICLES = 5000
"""Particles kept of one belief, evenly picked; a screen shows no more."""
# Finer than any filter's estimate. Screen, log and replay get the same rounded numbers, and a log of
# particles with all their digits would be three times as large.
DECIMALS = 2
"""Decimals of a belief, inches and degrees."""
_LARGEST = 1e12  # beyond it adding 0.01 to a float loses digits, and run logs refuse it
_NUMBERS = frozenset({int, float})
"""The types of number in JSON, `True` being none of them."""


def parse_belief(line: bytes, time: float, true: Pose) -> Belief:
    """A belief from one line of JSON. Raises ValueError that says what is allowed."""
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        raise ValueError("a belief is one JSON object a line") from None
    if not isinstance(fields, dict):
        raise ValueError('a belief is an object, such as {"x": 6, "y": 42, "heading": 0}')
    # Told, not ignored: a misspelt field would silently never be drawn.
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
    # JSON's true is an int in Python, and no coordinate.
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name} must be a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite")
    if abs(number) > _LARGEST:
        raise ValueError(f"{name} must be between -{_LARGEST:g} and {_LARGEST:g}")
    return round(number, DECIMALS) + 0.0  # the sum makes 0.0 of -0.0


def _particles(value: Any) -> tuple[tuple[float, ...], ...]:
    if value is None:
        return ()
    if not isinstance(value, list):
        raise ValueError("particles must be a list of [x, y] or [x, y, heading]")
    # Thinned out before they are checked: a million particles cost no more than 5,000.
    rows = value[:: max(1, math.ceil(len(value) / MOST_PARTICLES))]
    for row in rows:
        if not isinstance(row, list) or len(row) not in (2, 3):
            raise ValueError("each particle must be [x, y] or [x, y, heading]")
    numbers = iter(_rounded(list(chain.from_iterable(rows))))
    return tuple([tuple(islice(numbers, len(row))) for row in rows])


def _rounded(values: list[Any]) -> list[float]:
    """The numbers of particles. Thousands come at once: usually this takes no call for each."""
    if _NUMBERS.issuperset(map(type, values)):
        with contextlib.suppress(OverflowError):  # an integer beyond all bounds
            numbers = np.array(values, dtype=np.float64)
            if (np.abs(numbers) <= _LARGEST).all():
                rounded: list[float] = (np.round(numbers, DECIMALS) + 0.0).tolist()
                return rounded
    return [_number(value, "a particle's number") for value in values]


class _Believer(Peer):
    """One program's connection."""

    piece = 64 * 1024

    def __init__(self, sock: socket.socket, peer: str, link: BeliefLink) -> None:
        super().__init__(sock, peer, link.budget)
        self._link = link
        self._buffer = bytearray()
        self._seen = 0
        """Bytes of the buffer known to hold no line end."""
        self._complained = False
        self.heard = self._loop.time()
        """When something came last, at first when it connected."""

    def data_received(self, data: bytes) -> None:
        self.heard = self._loop.time()
        self._buffer += data
        self._take_lines()

    def connection_lost(self, error: OSError | None) -> None:
        self._link.believer_lost(self)

    def read_all(self) -> None:
        """Take in what has come, as far as this turn of the event loop has room for it."""
        self._take_lines()
        while self._budget.left > 0 and self._reading and self.read():
            pass

    def _take_lines(self) -> None:
        while self._budget.left > 0:
            end = self._buffer.find(b"\n", self._seen)
            if end < 0:
                self._seen = len(self._buffer)
                if self._seen > LONGEST_LINE:
                    self._buffer.clear()
                    self._seen = 0
                if self._held:
                    self.hold(False)
                return
            line = bytes(self._buffer[:end])
            del self._buffer[: end + 1]
            self._seen = 0
            self._budget.spend(LINE)
            if line.strip() and len(line) <= LONGEST_LINE:
                self._take(line)
        if not self._held:
            self.hold(True)
        self._budget.wait(self._go_on)

    def _go_on(self) -> None:
        if not self._finished:
            self._take_lines()

    def _take(self, line: bytes) -> None:
        answer = self._link.reasons.answer(line)
        if answer is not None:
            if not self.write(answer):  # it asks and asks, and never reads
                self.abort()
            return
        engine = self._link.engine
        time, simulator = engine.now(), engine.simulator
        try:
            engine.tell(parse_belief(line, time, simulator.pose))
        except ValueError as error:
            if not self._complained:  # a program that errs does so with every line
                self._complained = True
                engine.tell(Notice(NoticeKind.FAULT, f"belief not understood: {error}"))


class BeliefLink:
    """Serves the belief port; several programs may be connected.

    What a program believed before it drives on is held against the pose of that moment, although
    it comes by another connection: the engine has the beliefs that have come read before each
    movement, as many as a turn of the event loop has room for.
    """

    def __init__(self, context: LinkContext) -> None:
        """Begin to listen. Needs a running event loop."""
        self.engine = context.engine
        self.budget = ReadBudget(TURN)
        self.reasons = RefusalReasons(context.engine, [each.port for each in context.listeners.values()])
        self._believers: dict[_Believer, None] = {}
        self._acceptor = context.accept(BELIEFS, self._welcome)

    def _welcome(self, sock: socket.socket, peer: str) -> None:
        if len(self._believers) >= MOST_WAITING:
            silent = min(self._believers, key=lambda believer: believer.heard)
            text = f"belief connection {silent.peer} closed: {MOST_WAITING} at once are the most"
            self.engine.tell(Notice(NoticeKind.FAULT, text))
            silent.abort()
            self.believer_lost(silent)
        self._believers[_Believer(sock, peer, self)] = None
        # Only while somebody is connected: without beliefs a drive costs nothing more.
        self.engine.before_drive = self._read_all

    def _read_all(self) -> None:
        for believer in tuple(self._believers):
            believer.read_all()

    def believer_lost(self, believer: _Believer) -> None:
        """A connection has ended."""
        self._believers.pop(believer, None)
        if not self._believers:
            self.engine.before_drive = None

    @property
    def has_clients(self) -> bool:
        """True if a program is connected."""
        return bool(self._believers)

    def close(self) -> None:
        """Stop listening and end all connections."""
        self._acceptor.close()
        self.reasons.close()
        for believer in tuple(self._believers):
            believer.abort()
