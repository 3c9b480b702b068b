"""Replies of the connection-per-message dialects: encoding outcomes, and the mailbox they wait in."""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import groupby

from simmer_tui.protocol.packets import Dialect
from simmer_tui.sim.command import Command
from simmer_tui.sim.records import Outcome, Status

MAX_WAITING = 1000
"""Most items a mailbox keeps."""

_DECIMALS = 3
_WORDS = {
    Status.DONE: "True",
    Status.ACCEPTED: "True",
    Status.BUSY: "False",
    Status.REFUSED: "False",
    Status.UNKNOWN: "Not Found",
    Status.UNANSWERED: "Not Found",
    Status.STOPPED: "DRIVE STOP",
}
_NUMBERS = {
    Status.DONE: math.inf,
    Status.ACCEPTED: math.inf,
    Status.BUSY: math.nan,
    Status.REFUSED: math.nan,
    Status.UNKNOWN: math.nan,
    Status.UNANSWERED: math.nan,
    Status.STOPPED: math.inf,
}


class ReplyFormat(StrEnum):
    """How a reply is written. All but `FRAMED` are what `legacy_reply` may say."""

    FRAMED = "framed"
    FLOAT64 = "float64"
    FLOAT32 = "float32"
    TEXT = "text"


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to one request: one item a command, not yet joined."""

    format: ReplyFormat
    items: tuple[bytes, ...]

    def message(self) -> bytes:
        """The items as one message; no bytes if there are none."""
        if not self.items:
            return b""
        if self.format is ReplyFormat.FRAMED:
            return b"[" + b",".join(self.items) + b"]"
        return (b"|" if self.format is ReplyFormat.TEXT else b"").join(self.items)


def encode(
    dialect: Dialect, legacy_reply: ReplyFormat | str, answers: Iterable[tuple[Command, Outcome]]
) -> Reply:
    """The reply to a request in `dialect`; `legacy_reply` (`float64`, `float32` or `text`) says how
    one without brackets is answered. Raises ValueError for another `legacy_reply`."""
    if dialect is Dialect.FRAMED:
        items = (f"{_echo(command)}:{_word(command, outcome)}".encode() for command, outcome in answers)
        return Reply(ReplyFormat.FRAMED, tuple(items))
    reply_format = ReplyFormat(legacy_reply)
    if reply_format is ReplyFormat.FRAMED:
        raise ValueError("a request without brackets is answered in float64, float32 or text")
    return Reply(reply_format, tuple(_legacy_item(reply_format, outcome) for _, outcome in answers))


def number_text(value: float) -> str:
    """A number rounded to three decimals, always with a decimal point: `12.0`, `inf`, `nan`."""
    value = round(float(value), _DECIMALS)
    text = repr(value)
    return f"{value:.1f}" if "e" in text else text


def _echo(command: Command) -> str:
    """The code, with whatever would break the reply's own framing made a question mark."""
    return "".join(c if c.isascii() and c.isprintable() and c not in "[],:" else "?" for c in command.code)


def _word(command: Command, outcome: Outcome) -> str:
    if outcome.status is not Status.READING:
        # A text that is no command at all has no value to be wrong: there is no such code.
        return _WORDS[Status.UNKNOWN] if command.problem else _WORDS[outcome.status]
    if outcome.reading is not None and outcome.reading.sensor.is_yes_or_no:
        return str(outcome.reply >= 0.5)
    return number_text(outcome.reply)


def _legacy_item(reply_format: ReplyFormat, outcome: Outcome) -> bytes:
    number = outcome.reply if outcome.status is Status.READING else _NUMBERS[outcome.status]
    if reply_format is ReplyFormat.TEXT:
        return number_text(number).encode()
    if reply_format is ReplyFormat.FLOAT64:
        return struct.pack("<d", number)
    try:
        return struct.pack("<f", number)
    except OverflowError:  # beyond what a single holds
        return struct.pack("<f", math.copysign(math.inf, number))


def passed_on(reply_format: ReplyFormat, data: bytes) -> Reply:
    """A robot's own reply, whose bytes stay as they are; one in brackets is joined to others as ours are."""
    if reply_format is not ReplyFormat.FRAMED:
        return Reply(reply_format, (data,))
    if data.startswith(b"[") and data.endswith(b"]"):
        return Reply(reply_format, (data[1:-1],))
    return Reply(ReplyFormat.FLOAT64, (data,))  # as numbers are: nothing is put around or between


class Mailbox:
    """Replies waiting to be fetched: at most `limit` items; beyond that the oldest are dropped."""

    def __init__(self, limit: int = MAX_WAITING) -> None:
        self._limit = limit
        self._waiting: deque[tuple[Reply, bytes, str]] = deque()

    def __len__(self) -> int:
        """How many items wait."""
        return len(self._waiting)

    def put(self, reply: Reply, owner: str = "") -> int:
        """Add a reply to `owner`. Returns how many old items were dropped to make room."""
        self._waiting.extend((reply, item, owner) for item in reply.items)
        dropped = max(0, len(self._waiting) - self._limit)
        for _ in range(dropped):
            self._waiting.popleft()
        return dropped

    def drop(self, owner: str) -> int:
        """Drop what waits for an owner. Returns how many items that were."""
        before = len(self._waiting)
        self._waiting = deque(entry for entry in self._waiting if entry[2] != owner)
        return before - len(self._waiting)

    def take(self) -> bytes:
        """All that waits as one message, oldest first; no bytes if nothing does.

        A message has one format. Should replies of several wait (two programs at once), the
        oldest ones of one format go now and the others with the next call.
        """
        if not self._waiting:
            return b""
        reply_format = self._waiting[0][0].format
        items: list[bytes] = []
        while self._waiting and self._waiting[0][0].format is reply_format:
            items.append(self._waiting.popleft()[1])
        return Reply(reply_format, tuple(items)).message()

    def holds(self, reply: Reply) -> bool:
        """Whether some of a reply still waits."""
        return any(waiting is reply for waiting, _, _ in self._waiting)

    def withdraw(self, replies: Sequence[Reply]) -> bytes:
        """What still waits of these replies, joined as by `take`; no bytes if all has been fetched."""
        wanted = {id(reply) for reply in replies}
        chosen = [entry for entry in self._waiting if id(entry[0]) in wanted]
        self._waiting = deque(entry for entry in self._waiting if id(entry[0]) not in wanted)
        by_format = groupby(chosen, key=lambda entry: entry[0].format)
        return b"".join(
            Reply(reply_format, tuple(item for _, item, _ in entries)).message()
            for reply_format, entries in by_format
        )
