"""Replies of the connection-per-message dialects: encoding outcomes, and the mailbox they wait in."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby, takewhile

from simmer_tui.config.settings import ServerSettings
from simmer_tui.protocol.packets import RequestStyle
from simmer_tui.protocol.reply_form import NUMBERS, ReplyForm, ReplyFormat, pack_number
from simmer_tui.sim.command import Command
from simmer_tui.sim.records import CommandResult, Status

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
    dialect: RequestStyle, legacy_reply: ReplyFormat | str, answers: Iterable[tuple[Command, CommandResult]]
) -> Reply:
    """The reply to a request in `dialect`; `legacy_reply` (`float64`, `float32` or `text`) says how
    one without brackets is answered. Raises ValueError for another `legacy_reply`."""
    if dialect is RequestStyle.FRAMED:
        items = (f"{_echo(command)}:{_word(command, outcome)}".encode() for command, outcome in answers)
        return Reply(ReplyFormat.FRAMED, tuple(items))
    reply_format = ReplyFormat(legacy_reply)
    if reply_format is ReplyFormat.FRAMED:
        raise ValueError("a request without brackets is answered in float64, float32 or text")
    return Reply(reply_format, tuple(_legacy_item(reply_format, outcome) for _, outcome in answers))


def typed(text: bytes, settings: ServerSettings) -> tuple[bytes, ReplyForm]:
    """A command as a program would send it, and the form of its reply."""
    return b"[" + text + b"]", ReplyForm(ReplyFormat.FRAMED)


def number_text(value: float) -> str:
    """A number rounded to three decimals, always with a decimal point: `12.0`, `inf`, `nan`."""
    value = round(float(value), _DECIMALS)
    text = repr(value)
    return f"{value:.1f}" if "e" in text else text


def _echo(command: Command) -> str:
    """The code, with whatever would break the reply's own framing made a question mark."""
    return "".join(c if c.isascii() and c.isprintable() and c not in "[],:" else "?" for c in command.code)


def _word(command: Command, outcome: CommandResult) -> str:
    if outcome.status is not Status.READING:
        # A text that is no command at all has no value to be wrong: there is no such code.
        return _WORDS[Status.UNKNOWN] if command.problem else _WORDS[outcome.status]
    if outcome.reading is not None and outcome.reading.sensor.is_yes_or_no:
        return str(outcome.reply >= 0.5)
    return number_text(outcome.reply)


def _legacy_item(reply_format: ReplyFormat, outcome: CommandResult) -> bytes:
    number = outcome.reply if outcome.status is Status.READING else _NUMBERS[outcome.status]
    if reply_format is ReplyFormat.TEXT:
        return number_text(number).encode()
    return pack_number(NUMBERS[reply_format.value, "little"], number)


def passed_on(reply_format: ReplyFormat, data: bytes) -> Reply:
    """A robot's own reply, whose bytes stay as they are; one in brackets is joined to others as ours are."""
    if reply_format is not ReplyFormat.FRAMED:
        return Reply(reply_format, (data,))
    if data.startswith(b"[") and data.endswith(b"]"):
        return Reply(reply_format, (data[1:-1],))
    return Reply(ReplyFormat.FLOAT64, (data,))  # as numbers are: nothing is put around or between


@dataclass(slots=True)
class _Waiting:
    """A reply that waits, whose it is, and how many of its items were dropped to make room."""

    reply: Reply
    owner: str
    dropped: int = 0

    @property
    def items(self) -> tuple[bytes, ...]:
        return self.reply.items[self.dropped :]


class Mailbox:
    """Replies that wait to be fetched; at most `limit` items, of which the oldest go first.

    Whatever waits, what one reply costs is the same: a flood fills the mailbox and keeps it full.
    """

    def __init__(self, limit: int = MAX_WAITING) -> None:
        self._limit = limit
        self._count = 0
        self._waiting: OrderedDict[int, _Waiting] = OrderedDict()
        """By the identity of the reply: those that are alike are not the same."""

    def __len__(self) -> int:
        """Count of waiting items."""
        return self._count

    def put(self, reply: Reply, owner: str = "") -> int:
        """Add a reply to `owner`. Returns how many old items were dropped to make room."""
        if not reply.items:
            return 0
        self._waiting[id(reply)] = _Waiting(reply, owner)
        self._count += len(reply.items)
        surplus = dropped = max(0, self._count - self._limit)
        while surplus:
            oldest = next(iter(self._waiting.values()))
            going = min(surplus, len(oldest.reply.items) - oldest.dropped)
            oldest.dropped += going
            self._count -= going
            surplus -= going
            if oldest.dropped == len(oldest.reply.items):
                self._waiting.popitem(last=False)
        return dropped

    def drop(self, owner: str) -> int:
        """Drop what waits for an owner. Returns how many items that were."""
        theirs = [key for key, waiting in self._waiting.items() if waiting.owner == owner]
        return sum(len(self._remove(key)) for key in theirs)

    def take(self) -> bytes:
        """All that waits as one message, oldest first; no bytes if nothing does.

        A message has one format. Should replies of several wait (two programs at once), the
        oldest ones of one format go now and the others with the next call.
        """
        first = next(iter(self._waiting.values()), None)
        if first is None:
            return b""
        reply_format = first.reply.format
        same = takewhile(lambda entry: entry[1].reply.format is reply_format, self._waiting.items())
        keys = [key for key, _ in same]
        return Reply(reply_format, tuple(item for key in keys for item in self._remove(key))).message()

    def holds(self, reply: Reply) -> bool:
        """True if some of a reply still waits."""
        return id(reply) in self._waiting

    def withdraw(self, replies: Sequence[Reply]) -> bytes:
        """The waiting items of these replies, oldest first, joined as by `take`; no bytes if all has
        been fetched."""
        chosen = [(reply.format, self._remove(id(reply))) for reply in replies if self.holds(reply)]
        by_format = groupby(chosen, key=lambda entry: entry[0])
        return b"".join(
            Reply(reply_format, tuple(item for _, items in entries for item in items)).message()
            for reply_format, entries in by_format
        )

    def _remove(self, key: int) -> tuple[bytes, ...]:
        """The items that still waited of a reply, which waits no more."""
        items = self._waiting.pop(key).items
        self._count -= len(items)
        return items
