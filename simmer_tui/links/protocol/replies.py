"""Numbers of replies as bytes, in every dialect: packed, searched for in what a real robot sends, and read.

Their formats are the table of `config/reply_formats.py`. The search has no port and no clock. Robots print
greetings when they boot, lose bytes and answer late. So a reply is searched for only while one is expected;
all other bytes are discarded, and counted.
"""

import math
import re
import struct
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np

from simmer_tui.config.reply_formats import NUMBER_SIZES, NUMBER_STRUCTS, ReplyEnd, ReplyForm
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.command import NUMBER


def pack_reply(layout: struct.Struct, number: float, ranges: FloatArray | None = None) -> bytes:
    """A reply in binary: a number, or to a lidar's code the count of the ranges, and the ranges. Numbers too
    large for a float32 become infinite."""
    if ranges is not None:
        # struct's letters for byte order and size mean the same to numpy.
        with np.errstate(over="ignore"):
            return np.concatenate(((len(ranges),), ranges)).astype(layout.format).tobytes()
    try:
        return layout.pack(number)
    # struct refuses numbers that MATLAB's single() makes infinite.
    except OverflowError:
        return layout.pack(math.copysign(math.inf, number))


# At 9600 baud a byte takes 1 ms, and USB adapters pass bytes on every 16 ms: 50 ms is a clear end.
GAP = 0.05
"""Seconds of silence that end a reply without another end, and a burst of bytes in doubt."""
# Enough for a reply to 1000 commands at 16 bytes each, or three of a lidar with 2,000 rays.
LIMIT = 64 * 1024
"""Most bytes kept while looking for the end of a reply."""
# The width of a line of the event list.
SAMPLE = 60
"""Most discarded bytes kept to be shown."""

# A sensor may have 2,000 rays. A robot's own lidar may have more; a larger number is no count.
MOST_RANGES = 4000
"""Most numbers of a scan."""

_FRAME = re.compile(rb"\[[^\[\]]*\]")
_LINE = re.compile(rb"[^\n]*\n")
_SEPARATORS = re.compile(r"[|,;\s]+")
_ITEMS = re.compile(r"[|,\s]+")
"""Separators of items, where one may be many numbers."""
_WORDS = {"inf": math.inf, "+inf": math.inf, "-inf": -math.inf, "infinity": math.inf}
# "ovf" is printed by Arduino for a float beyond 4294967040.
_WORDS |= {"nan": math.nan, "ovf": math.inf, "drive stop": math.inf, "not found": math.nan}
_TRUTH = {"true": True, "false": False}
_ANSWERS = frozenset((*_WORDS, *_TRUTH))
"""Words that a line of numbers may contain; with any other it is a greeting."""
_PLAIN = bytes((*b"\t\r\n", *range(0x20, 0x7F)))
"""Characters of a greeting."""
# Four or eight printable characters read as a float are mostly outside this range.
_LIKELY = 1e-9, 1e9
"""Magnitudes of numbers that may come from a robot even if their bytes are all printable."""


class ReplyFramer:
    """Finds the reply to each command in the bytes of a robot; holds at most `LIMIT` bytes.

    Call `expect` before a command is sent, `receive` for bytes, and `silence` when nothing has come for
    `idle_timeout` seconds. At the start, and after `doubt`, a greeting or a late reply may come before the
    right one. Then only the last reply of a burst counts; if several are expected, as many from its end. The
    reply to a lidar's code is a count and so many numbers; one NaN is a refusal.
    """

    def __init__(self, gap: float = GAP) -> None:
        self._gap = gap
        self._buffer = b""
        self._end: ReplyEnd | None = None
        self._size = 0
        self._scans: Sequence[bool] = ()
        self._layout = NUMBER_STRUCTS["float64", "big"]
        self._doubtful = True
        self._sample = b""
        self.following = 0
        """Replies that are due after the one that is expected."""
        self.discarded = 0
        """Bytes discarded since the last `take_discarded`."""

    @property
    def idle_timeout(self) -> float | None:
        """Seconds of silence after which to call `silence`, or None."""
        if self._end is None or not self._buffer:
            return None
        return self._gap if self._doubtful or self._end is ReplyEnd.QUIET else None

    def expect(
        self,
        end: ReplyEnd,
        count: int = 1,
        *,
        keep: bool = False,
        scans: Sequence[bool] = (),
        byte_order: str = "little",
    ) -> None:
        """Expect a reply to `count` commands. Earlier bytes are discarded, unless `keep`.

        `scans` is true for each command that asks for a scan, whose count is a number in `byte_order`.
        """
        if not keep:
            self.abandon()
        self._end = end
        self._size = NUMBER_SIZES.get(end, 0) * count
        self._scans = scans if end in NUMBER_SIZES and any(scans) else ()
        if self._scans:
            self._layout = NUMBER_STRUCTS[end.value, byte_order]

    def abandon(self) -> None:
        """Stop expecting a reply: discard what has arrived and what still arrives."""
        self._discard(self._buffer)
        self._buffer = b""
        self._end = None

    def doubt(self) -> None:
        """Note a fault: stray bytes may arrive before the next reply."""
        self._doubtful = True

    def receive(self, data: bytes) -> bytes | None:
        """Take bytes. Returns the reply if they complete it. After a reply, call `expect` for the next."""
        if self._end is None:
            self._discard(data)
            return None
        self._buffer += data
        reply = self._take(first=True) if self.idle_timeout is None else None
        # A robot that never ends its reply must not use up the memory.
        if len(self._buffer) > LIMIT:
            self._drop_front(len(self._buffer) - LIMIT)
        return reply

    def silence(self) -> bytes | None:
        """Note that nothing has come for `idle_timeout` seconds. Returns the reply if that ends it."""
        return self._take(first=False) if self.idle_timeout is not None else None

    def take_discarded(self) -> tuple[int, bytes]:
        """Count of bytes discarded since the last call, and the first of them."""
        count, sample = self.discarded, self._sample
        self.discarded, self._sample = 0, b""
        return count, sample

    def _take(self, *, first: bool) -> bytes | None:
        span = self._find(first)
        if span is None:
            return None
        start, stop = span
        self._discard(self._buffer[:start])
        reply = self._buffer[start:stop]
        self._buffer = self._buffer[stop:]
        # A whole reply was found: from now on bytes and commands are in step again.
        self._end = None
        self._doubtful = False
        return reply

    def _find(self, first: bool) -> tuple[int, int] | None:
        """Begin and end of the first or the last reply in the buffer."""
        wanted = 1 + self.following
        if self._scans:
            return self._find_counted(first)
        if self._end in NUMBER_SIZES:
            whole = min(wanted, len(self._buffer) // self._size)
            if not whole:
                return None
            start = 0 if first else len(self._buffer) - whole * self._size
            stop = start + self._size
            # Arduinos print a greeting when the port is opened, which resets them.
            if _is_text(
                self._buffer[start:stop], NUMBER_SIZES[self._end]
            ):  # a greeting where a number should be
                self._doubtful = True
                return None
            return start, stop
        if self._end is ReplyEnd.QUIET:
            return None if first else (0, len(self._buffer))
        pattern = _FRAME if self._end is ReplyEnd.BRACKET else _LINE
        matches = pattern.finditer(self._buffer)
        good = (match.span() for match in matches if pattern is _FRAME or _is_numbers(match.group()))
        if first:
            return next(good, None)
        last = deque(good, wanted)
        return last[0] if last else None

    def _find_counted(self, first: bool) -> tuple[int, int] | None:
        """Begin and end of a reply that contains its length. It is at the front, or anywhere if only the
        expected replies follow it."""
        if first:
            stop = self._counted_end(0)
            # Text in place of a count, or a robot that sends none.
            self._doubtful = stop is None
            return None if stop is None or stop > len(self._buffer) else (0, stop)
        size = self._layout.size
        for start in range(len(self._buffer) - size + 1):
            stop = self._counted_end(start)
            behind = -1 if stop is None else len(self._buffer) - stop
            if stop is not None and 0 <= behind <= self.following * size and behind % size == 0:
                return start, stop
        return None

    def _counted_end(self, start: int) -> int | None:
        """End of the reply that begins at `start`, by the counts that have come; None if one is no count."""
        place, size = start, self._layout.size
        for is_scan in self._scans:
            if is_scan and place + size <= len(self._buffer):
                (count,) = self._layout.unpack_from(self._buffer, place)
                # NaN is a refusal, which has no ranges.
                if count == count:
                    if not _is_count(count):
                        return None
                    place += int(count) * size
            place += size
        return place

    def _drop_front(self, count: int) -> None:
        self._discard(self._buffer[:count])
        self._buffer = self._buffer[count:]

    def _discard(self, data: bytes) -> None:
        if not data:
            return
        self.discarded += len(data)
        self._sample += data[: SAMPLE - len(self._sample)]


def _is_text(data: bytes, size: int) -> bool:
    """True if bytes in place of numbers of this size are text: all printable, and not all of them likely
    numbers in either byte order."""
    if data.translate(None, _PLAIN):
        return False
    low, high = _LIKELY
    fitting = [number for number in NUMBER_STRUCTS.values() if number.size == size]
    return not any(all(low < abs(value) < high for (value,) in each.iter_unpack(data)) for each in fitting)


def _is_numbers(line: bytes) -> bool:
    """True if a line is an answer: one number or more, or a frame, and no greeting."""
    text = line.decode("latin-1").strip()
    if text.startswith("[") and text.endswith("]"):
        return True
    items = _SEPARATORS.split(text)
    return all(NUMBER.fullmatch(item) or item.lower() in _ANSWERS for item in items)


def _number(word: str) -> float:
    """The number a word represents; NaN for any other word."""
    return float(word) if NUMBER.fullmatch(word) else _WORDS.get(word.lower(), math.nan)


RobotAnswer = float | FloatArray
"""The answer of a robot to a command: a number, or the ranges of a scan."""


def read_numbers(
    reply: bytes, form: ReplyForm, sensing: Sequence[bool], scans: Sequence[bool] = ()
) -> tuple[RobotAnswer, ...]:
    """The answers in a reply, one for each command; NaN for missing ones and for text.

    `sensing` is true for each command that reads a sensor: its `True` and `False` are 1 and 0. In the answer
    to a drive they are infinity and NaN. `scans` is true for each command that asks for a scan: its answer is
    the ranges, or NaN.
    """
    found: list[RobotAnswer] = []
    number = NUMBER_STRUCTS.get((form.format, form.byte_order))
    if number is not None:
        usable = len(reply) - len(reply) % number.size
        values = (value for (value,) in number.iter_unpack(reply[:usable]))
        found.extend(_counted(values, scans) if any(scans) else values)
    else:
        scans = scans or (False,) * len(sensing)
        items = _items(reply.decode("latin-1").strip(), scans)
        for item, reads, is_scan in zip(items, sensing, scans, strict=False):
            found.append(_ranges(item) if is_scan else _answer(item, reads))
    found.extend([math.nan] * (len(sensing) - len(found)))
    return tuple(found[: len(sensing)])


def _counted(rest: Iterator[float], scans: Sequence[bool]) -> list[RobotAnswer]:
    """The answers in numbers, where the first number of a scan is its count."""
    found: list[RobotAnswer] = []
    for is_scan in scans:
        value = next(rest, math.nan)
        if not is_scan:
            found.append(value)
            continue
        ranges = list(islice(rest, int(value))) if _is_count(value) else []
        found.append(np.array(ranges) if ranges and len(ranges) == value else math.nan)
    return found


def _is_count(value: float) -> bool:
    return 1 <= value <= MOST_RANGES and value.is_integer()


def _items(text: str, scans: Sequence[bool]) -> list[str]:
    """The text of each command's answer."""
    if text.startswith("["):
        # Each item echoes its code, `u0:12.3`; programs and robots repeat it or leave it out.
        return [item.rpartition(":")[2].strip() for item in text.strip("[]").split(",")]
    if len(scans) == 1 and scans[0]:
        return [text]  # a single command's ranges may be joined by any separator
    return (_ITEMS if any(scans) else _SEPARATORS).split(text)


def _ranges(text: str) -> RobotAnswer:
    """The ranges of a scan as text; NaN if there is none."""
    ranges = np.array([_number(word) for word in _SEPARATORS.split(text)])
    return math.nan if np.isnan(ranges).all() else ranges


def _answer(word: str, reads_sensor: bool) -> float:
    truth = _TRUTH.get(word.lower())
    if truth is None:
        return _number(word)
    if reads_sensor:
        return float(truth)
    return math.inf if truth else math.nan
