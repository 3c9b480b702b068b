"""The connection-per-message dialects: requests out of bytes, replies into bytes.

No sockets and no clock. One `RequestReader` serves one connection on the request port, one
`Mailbox` holds the replies that wait for the reply port.

| dialect | request | reply |
|---|---|---|
| framed | `[u0,w0:36]`; `][` also joins | `[u0:12.345,w0:True]` |
| legacy | `u0,w0-36`, ended by closing or falling silent | doubles, singles or text, as the user says |

A lidar's reply is many numbers: `[sc:12.345;11.220;inf]`, joined in the same way in text. In doubles and
singles it is their count and the numbers.

A code is the first two characters of a command, the third is ignored, the rest is the value; the
code `xx` stops all motion. What cannot be a command is answered all the same, so that every request
but the empty one has one reply.
"""

import math
import re
from collections import OrderedDict
from collections.abc import Iterable, Sequence
from enum import StrEnum
from itertools import groupby, takewhile

from msgspec import Struct

from simmer_tui.config.reply_formats import NUMBER_STRUCTS, ReplyForm, ReplyFormat
from simmer_tui.config.settings import ServerSettings
from simmer_tui.links.protocol.binary import GRACE, LONGEST_COMMAND
from simmer_tui.links.protocol.line_marks import has_marks_alone, without_marks
from simmer_tui.links.protocol.replies import pack_reply
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.command import Command, code_problem
from simmer_tui.sim.records import CommandResult, Status

# Some 4,000 commands with a value; a request has at most a thousand.
MAX_REQUEST = 64 * 1024
"""Longest request, bytes."""
# Judged: a program that never reads must not fill the memory.
MAX_WAITING = 1000
"""Most items a mailbox keeps."""
MAX_COMMANDS = MAX_WAITING
"""Most commands in a request: as many as a mailbox holds replies."""
STOP = "xx"
"""The code by which programs stop all motion, in every dialect."""

_BRACKET = re.compile(rb"[\[\]]")
_BLANK = b" \t\r\n"


class RequestStyle(StrEnum):
    """Style of a request."""

    FRAMED = "framed"
    LEGACY = "legacy"


# Without garbage collection (gc=False): requests hold no cycles, and many thousands may wait.
class Request(Struct, frozen=True, gc=False):
    """The commands of one message. An empty message (`[]`) asks for no reply, but for a log line.

    `data` is the message as sent; no bytes if it must not be passed on to a robot.
    """

    dialect: RequestStyle
    commands: tuple[Command, ...] = ()
    data: bytes = b""


_EMPTY = Request(RequestStyle.FRAMED)


class RequestReader:
    """Cuts the bytes of one connection into requests; it holds at most `MAX_REQUEST` bytes.

    Call `receive` for each piece, `end` at the end of the stream, and `silence` when nothing has come for
    `idle_timeout` seconds. A packet whose brackets do not pair up is refused as a whole: the meaning of half
    a packet is not known.
    """

    def __init__(self, grace: float = GRACE) -> None:
        self._grace = grace
        self._pending = bytearray()
        self._open = False
        self._discarding = False

    @property
    def idle_timeout(self) -> float | None:
        """Seconds of silence after which to call `silence`. None if nothing ends by silence: a packet with an
        open bracket may pause for any time."""
        if self._open:
            return None
        return self._grace if self._discarding or self._pending.strip(_BLANK) else None

    @property
    def unfinished(self) -> bool:
        """True if bytes of an unfinished request have come."""
        return self._open or self._discarding or bool(self._pending.strip(_BLANK))

    def receive(self, data: bytes) -> list[Request]:
        """The requests that `data` completes, in order. Never raises, whatever the bytes."""
        requests: list[Request] = []
        start = 0
        for bracket in _BRACKET.finditer(data):
            self._collect(data[start : bracket.start()], requests)
            if bracket.group() == b"[":
                self._open_packet(requests)
            else:
                self._close_packet(requests)
            start = bracket.end()
        self._collect(data[start:], requests)
        return requests

    def silence(self) -> list[Request]:
        """The request without brackets that a silence of `idle_timeout` seconds ends, if there is one."""
        return [] if self._open else self._end_legacy()

    def end(self) -> list[Request]:
        """The unfinished request when the sender closes."""
        if not self._open:
            return self._end_legacy()
        requests: list[Request] = []
        self._refuse_unclosed(requests)
        if not requests and not self._discarding:
            requests.append(_EMPTY)
        self._reset()
        return requests

    def _reset(self) -> None:
        self._pending.clear()
        self._open = self._discarding = False

    def _collect(self, data: bytes, requests: list[Request]) -> None:
        if self._discarding:
            return
        room = MAX_REQUEST - len(self._pending)
        self._pending += data[:room]
        if len(data) > room:
            dialect = RequestStyle.FRAMED if self._open else RequestStyle.LEGACY
            requests.append(_refusal(dialect, self._pending, f"a request has at most {MAX_REQUEST} bytes"))
            self._pending.clear()
            self._discarding = True

    def _open_packet(self, requests: list[Request]) -> None:
        if self._open:
            self._refuse_unclosed(requests)
        else:
            if has_marks_alone(bytes(self._pending)):
                self._pending.clear()
            requests += self._end_legacy()
        self._reset()
        self._open = True

    def _close_packet(self, requests: list[Request]) -> None:
        if not self._discarding:
            if self._open:
                requests.append(_request(RequestStyle.FRAMED, bytes(self._pending)))
            elif stray := self._pending.strip(_BLANK):
                requests.append(_refusal(RequestStyle.FRAMED, stray, "a packet starts with ["))
            else:
                requests.append(_EMPTY)
        self._reset()

    def _refuse_unclosed(self, requests: list[Request]) -> None:
        if self._pending:
            requests.append(_refusal(RequestStyle.FRAMED, self._pending, "a packet ends with ]"))

    def _end_legacy(self) -> list[Request]:
        text = without_marks(bytes(self._pending)).strip(_BLANK)
        self._reset()
        return [_request(RequestStyle.LEGACY, text)] if text else []


def _request(dialect: RequestStyle, text: bytes) -> Request:
    text = without_marks(text)
    if not text:
        return Request(dialect)
    pieces = text.split(b",")
    if len(pieces) > MAX_COMMANDS:
        return _refusal(dialect, text, f"a request has at most {MAX_COMMANDS} commands")
    data = b"[" + text + b"]" if dialect is RequestStyle.FRAMED else text
    return Request(dialect, tuple(_command(piece) for piece in pieces), data)


def _refusal(dialect: RequestStyle, text: bytes | bytearray, problem: str) -> Request:
    return Request(dialect, (_command(bytes(text[:LONGEST_COMMAND]), problem),))


def _command(piece: bytes, problem: str = "") -> Command:
    """A command with code and value. Spaces are kept: unlike in a line, the position counts."""
    if len(piece) > LONGEST_COMMAND:
        problem = problem or f"a command has at most {LONGEST_COMMAND} bytes"
    text = piece[:LONGEST_COMMAND].decode("latin-1")  # one character a byte, so that any byte is kept
    problem = problem or code_problem(text)
    # The third character is a separator of any kind, as in simmer-python.
    argument = text[3:] if len(text) > 2 else None
    return Command(text, text[:2], argument, problem=problem, stops=text[:2] == STOP and not problem)


# -- replies --------------------------------------------------------------------------------------

# As simmer-python prints them; programs match \d+\.\d+.
_DECIMALS = 3
# The replies of simmer-python since Aug 2024, and the numbers of the earlier formats without brackets.
_ANSWERS = {
    Status.DONE: ("True", math.inf),
    Status.ACCEPTED: ("True", math.inf),
    Status.BUSY: ("False", math.nan),
    Status.REFUSED: ("False", math.nan),
    Status.UNKNOWN: ("Not Found", math.nan),
    Status.UNANSWERED: ("Not Found", math.nan),
    Status.STOPPED: ("DRIVE STOP", math.inf),
}


class Reply(Struct, frozen=True):
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
    """The reply to a request in `dialect`. Raises ValueError for an unknown `legacy_reply`.

    `legacy_reply` (`float64`, `float32` or `text`) is the format for requests without brackets.
    """
    if dialect is RequestStyle.FRAMED:
        items = (f"{_echo(command)}:{_word(command, result)}".encode() for command, result in answers)
        return Reply(ReplyFormat.FRAMED, tuple(items))
    reply_format = ReplyFormat(legacy_reply)
    if reply_format is ReplyFormat.FRAMED:
        raise ValueError("a request without brackets is answered in float64, float32 or text")
    return Reply(reply_format, tuple(_legacy_item(reply_format, result) for _, result in answers))


def typed(text: bytes, settings: ServerSettings) -> tuple[bytes, ReplyForm]:
    """A command as a program would send it, and the form of its reply."""
    return b"[" + text + b"]", ReplyForm(ReplyFormat.FRAMED)


def number_text(value: float) -> str:
    """A number rounded to three decimals, always with a decimal point: `12.0`, `inf`, `nan`."""
    value = round(float(value), _DECIMALS)
    # repr of a float always has a point, unless it is written with an exponent.
    text = repr(value)
    return f"{value:.1f}" if "e" in text else text


def ranges_text(ranges: FloatArray) -> str:
    """Ranges with three decimals each, joined by semicolons, since commas join items."""
    return ";".join([f"{value:.{_DECIMALS}f}" for value in ranges.tolist()])


def _echo(command: Command) -> str:
    """The code, with a question mark for each character that would break the reply's framing."""
    return "".join(c if c.isascii() and c.isprintable() and c not in "[],:" else "?" for c in command.code)


def _word(command: Command, result: CommandResult) -> str:
    if result.status is not Status.READING:
        # A text that is no command has no wrong value: its code does not exist.
        return _ANSWERS[Status.UNKNOWN if command.problem else result.status][0]
    if result.reading is not None and result.reading.sensor.is_yes_or_no:
        return str(result.reply >= 0.5)
    ranges = result.ranges
    return number_text(result.reply) if ranges is None else ranges_text(ranges)


def _legacy_item(reply_format: ReplyFormat, result: CommandResult) -> bytes:
    is_reading = result.status is Status.READING
    number = result.reply if is_reading else _ANSWERS[result.status][1]
    ranges = result.ranges if is_reading else None
    if reply_format is ReplyFormat.TEXT:
        return (number_text(number) if ranges is None else ranges_text(ranges)).encode()
    return pack_reply(NUMBER_STRUCTS[reply_format.value, "little"], number, ranges)


def passed_on(reply_format: ReplyFormat, data: bytes) -> Reply:
    """A robot's own reply, whose bytes stay unchanged. One in brackets is joined to others like ours."""
    if reply_format is not ReplyFormat.FRAMED:
        return Reply(reply_format, (data,))
    if data.startswith(b"[") and data.endswith(b"]"):
        return Reply(reply_format, (data[1:-1],))
    return Reply(ReplyFormat.FLOAT64, (data,))  # as for numbers: no bytes are added around or between


class _Waiting(Struct):
    """A reply that waits, its owner, its time, and the count of its items dropped to make room."""

    reply: Reply
    owner: str
    since: float
    dropped: int = 0

    @property
    def items(self) -> tuple[bytes, ...]:
        return self.reply.items[self.dropped :]


class Mailbox:
    """Replies that wait to be fetched: at most `limit` items, of which the oldest are dropped first.

    A reply costs the same whatever waits: a flood fills the mailbox and keeps it full.
    """

    def __init__(self, limit: int = MAX_WAITING) -> None:
        self._limit = limit
        self._count = 0
        self._waiting: OrderedDict[int, _Waiting] = OrderedDict()
        """By the identity of the reply: those that are alike are not the same."""

    def __len__(self) -> int:
        """Count of waiting items."""
        return self._count

    def put(self, reply: Reply, owner: str = "", now: float = 0.0) -> int:
        """Add a reply to `owner`, which waits from `now` on. Returns the count of old items dropped to make
        room."""
        if not reply.items:
            return 0
        # By identity: two equal readings are two replies.
        self._waiting[id(reply)] = _Waiting(reply, owner, now)
        self._count += len(reply.items)
        # The oldest ones: a program that reads again needs the newest.
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

    def has(self, owner: str) -> bool:
        """True if a reply waits for an owner."""
        return any(each.owner == owner for each in self._waiting.values())

    def drop(self, owner: str, before: float = math.inf) -> int:
        """Drop an owner's replies from before the time `before`. Returns the count of items."""
        theirs = [
            key for key, waiting in self._waiting.items() if waiting.owner == owner and waiting.since < before
        ]
        return sum(len(self._remove(key)) for key in theirs)

    @property
    def oldest(self) -> float:
        """Time since which the oldest reply waits; infinity if none does."""
        return next((each.since for each in self._waiting.values()), math.inf)

    def expire(self, before: float) -> int:
        """Drop the replies that have waited since before a time. Returns the count of items."""
        old = [key for key, waiting in self._waiting.items() if waiting.since < before]
        return sum(len(self._remove(key)) for key in old)

    def take(self) -> bytes:
        """All waiting items as one message, oldest first; no bytes if there are none.

        A message has one format. If replies of several formats wait (two programs at once), the oldest ones
        of one format are taken, and the others by the next call.
        """
        first = next(iter(self._waiting.values()), None)
        if first is None:
            return b""
        reply_format = first.reply.format
        same = takewhile(lambda entry: entry[1].reply.format is reply_format, self._waiting.items())
        keys = [key for key, _ in same]
        return Reply(reply_format, tuple(item for key in keys for item in self._remove(key))).message()

    def holds(self, reply: Reply) -> bool:
        """True if any item of a reply still waits."""
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
        """Remove a reply. Returns its items that still waited."""
        items = self._waiting.pop(key).items
        self._count -= len(items)
        return items
