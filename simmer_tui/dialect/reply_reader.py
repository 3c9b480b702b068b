"""Parser of a real robot's replies by the rules of its dialect. Sans-IO.

A reply is matched with the pending ones: those of sent messages, in their order, and of streams.
"""

import itertools
import math
import re
import struct
from collections.abc import Iterator, Mapping, Sequence

from msgspec import Struct, field

from simmer_tui.dialect.dialect_rules import AnyReply, DialectRules, MessageRule
from simmer_tui.dialect.expressions import Expression, FieldValues
from simmer_tui.dialect.frames import TYPE, Deframer, Frame
from simmer_tui.dialect.readings import MessageScope, read_by
from simmer_tui.dialect.templates import BinaryReply, Field, TextReply

# At 9600 baud a byte takes 1 ms, and USB adapters pass bytes on every 16 ms.
SILENCE = 0.05
"""Seconds without a byte after which the received bytes are a reply, even without its end."""
# A robot that answers nothing must not fill the memory; a buffer of 64 bytes has fewer messages.
MOST_PENDING = 64
"""Most pending replies; beyond it the oldest are dropped, those that may never come first."""
# A line of 360 rays with 7 characters each.
_LONGEST = 4096
"""Bytes of a reply; longer ones are only passed on."""
# Each of these may end anywhere, so that every further one multiplies the possible matches.
MOST_TEXTS = 2
"""Most fields of a reply that are texts, or numbers without an end of their own; a reply with more is only
passed on."""
# Each has a few ends.
_MOST_PADDED = 8
"""Most numbers with leading zeros that follow each other without anything in between."""
_ENDS = ("done", "stopped")
# A double has at most 309 digits before the point. Each text is a number in one way only.
_NUMBER = rb"[+-]?(?:[0-9]{1,%d}(?:\.[0-9]{0,%d})?|\.[0-9]{1,%d})(?:[eE][+-]?[0-9]{1,3})?"
_LONG, _SHORT = _NUMBER % (310, 99, 99), _NUMBER % (17, 17, 17)
"""Regular expressions of a number with an end, and of one that a field follows."""
_DIGITS = {"x": (16, b"[0-9a-fA-F]"), "X": (16, b"[0-9a-fA-F]"), "o": (8, b"[0-7]"), "b": (2, b"[01]")}
"""Bases of formats that are not decimal, with their digits."""
_WORDS = (b"inf", b"-inf", b"nan", b"ovf")
_TEXT = rb"([^\r\n]{0,400}?)"


class RobotReply(Struct, frozen=True):
    """A reply of the robot. `readings` are those that it contains, by the sensor's code, infinite for a
    missing one. `rule` and `part` (`reply`, `done`, `stopped` or `stream`) are those that it matches; an
    unknown one has neither."""

    data: bytes
    part: str = ""
    rule: MessageRule | None = None
    readings: Mapping[str, float] = field(default_factory=dict)
    values: FieldValues | None = None
    """Values of the message that it answers, the same object that `asked` got."""

    @property
    def ends(self) -> bool:
        """True if it is the reply at the end of a movement."""
        return self.part in _ENDS


class PendingReply(Struct, eq=False):
    """A pending reply: its remaining templates. `rule` and `values` are its message's; the rule of a stream
    has no message. `cut` is True if the message was lost, or ended by something else."""

    rule: MessageRule
    part: str
    templates: list[AnyReply]
    values: FieldValues
    patterns: list[re.Pattern[bytes]]
    cut: bool = False

    @property
    def ends(self) -> bool:
        """True if it is a reply at the end of a movement."""
        return self.part in _ENDS

    @property
    def optional(self) -> bool:
        """True if it may never come."""
        return self.cut or self.part == "stopped"

    @property
    def look(self) -> tuple[re.Pattern[bytes], int | None]:
        """The look of its next reply: text, or type of the frame."""
        template = self.templates[0]
        return self.patterns[0], template.type if isinstance(template, BinaryReply) else None

    @property
    def expressions(self) -> list[Expression]:
        """The expressions of its remaining templates."""
        return [each for template in self.templates for each in template.expressions]


class ReplyReader:
    """Finds replies.

    Args:
        rules: The dialect.
        state: Its state, which messages change.
    """

    def __init__(self, rules: DialectRules, state: FieldValues) -> None:
        self._rules = rules
        self._state = state
        self._end = rules.reply_end.encode()
        self.pending: list[PendingReply] = []
        """Pending replies; for a movement both `done` and `stopped`."""
        self._numbers = rules.single.union(
            ("time", "contact", "tick", "k"),
            (name for name, value in rules.state.items() if isinstance(value, int | float)),
        )
        """Names that are always numbers."""
        self._streams = [
            self._made_pending(MessageRule(number=0), "stream", each.send, {})
            for each in rules.streams
            if each.send
        ]
        self._buffer = bytearray()
        answers = [each for rule in rules.rules for each in (rule.reply, rule.done, rule.stopped)]
        sent = itertools.chain(*answers, *(each.send for each in rules.streams))
        is_binary = any(isinstance(each, BinaryReply) for each in sent)
        self._deframer = Deframer(rules.framing) if is_binary else None

    @property
    def waits(self) -> bool:
        """True if a reply has been received in part."""
        return bool(self._buffer) or (self._deframer is not None and self._deframer.unfinished)

    def asked(self, rule: MessageRule, values: FieldValues) -> None:
        """Add the replies of a sent message to the pending ones."""
        for part, replies in (("reply", rule.reply), ("done", rule.done), ("stopped", rule.stopped)):
            if replies:
                self.pending.append(self._made_pending(rule, part, replies, values))
        surplus = max(len(self.pending) - MOST_PENDING, 0)
        self._remove(sorted(self.pending, key=lambda each: not each.optional)[:surplus])

    def _made_pending(
        self, rule: MessageRule, part: str, replies: Sequence[AnyReply], values: FieldValues
    ) -> PendingReply:
        patterns = [self._pattern(each) for each in replies]
        return PendingReply(rule, part, [*replies], values, patterns)

    def cut_short(self, values: FieldValues) -> None:
        """A message, by its values, is lost or ended by something else. The robot may still answer it, if its
        answer is already under way."""
        for each in self.pending:
            each.cut = each.cut or each.values is values

    def _remove(self, gone: Sequence[PendingReply]) -> None:
        self.pending = [each for each in self.pending if each not in gone]

    @property
    def _candidates(self) -> list[PendingReply]:
        """Pending replies and streams, in the order in which a reply is compared with them."""
        return [*sorted(self.pending, key=lambda each: each.optional), *self._streams]

    def forget(self, rule: MessageRule) -> None:
        """Remove the replies of a message from the pending ones."""
        self.pending = [each for each in self.pending if each.rule is not rule]

    def receive(self, data: bytes) -> list[RobotReply]:
        """The replies that these bytes complete."""
        if self._deframer is not None:
            parts = self._deframer.receive(data)
            return [self._frame(part) if isinstance(part, Frame) else RobotReply(part.data) for part in parts]
        self._buffer += data
        return list(self._lines(at_end=False))

    def silence(self) -> list[RobotReply]:
        """Called after `SILENCE` seconds without bytes. Returns the replies that end by it."""
        if self._deframer is not None:
            return [RobotReply(each.data) for each in self._deframer.silence()]
        return list(self._lines(at_end=True))

    # -- text --------------------------------------------------------------------------------------

    def _lines(self, *, at_end: bool) -> Iterator[RobotReply]:
        while self._buffer:
            found = self._first(at_end=at_end)
            if found is not None:
                yield found
                continue
            line = self._buffer.find(self._end or b"\n")
            size = line + len(self._end or b"\n") if line >= 0 else 0
            if not size and (at_end or len(self._buffer) > _LONGEST):
                size = len(self._buffer)
            if not size:
                return
            yield RobotReply(self._take(size))

    def _first(self, *, at_end: bool) -> RobotReply | None:
        """The reply at the beginning of the received bytes, if it matches a pending one."""
        window = bytes(self._buffer[:_LONGEST])
        for pending in self._candidates:
            match = pending.patterns[0].match(window)
            if match is None or not match.end():
                continue
            # A number at the very end may continue: 12. and then 5.
            if match.end() == len(window) and not at_end and not self._is_closed(pending):
                continue
            template = pending.templates[0]
            readings = self._readings(template, match, pending.values)
            reply = RobotReply(self._take(match.end()), pending.part, pending.rule, readings, pending.values)
            self._settle(pending)
            return reply
        return None

    def _is_closed(self, pending: PendingReply) -> bool:
        """True if nothing can follow the last character of a reply."""
        template = pending.templates[0]
        return bool(self._end) or not (
            isinstance(template, TextReply) and template.parts and isinstance(template.parts[-1], Field)
        )

    def _take(self, size: int) -> bytes:
        taken = bytes(self._buffer[:size])
        del self._buffer[:size]
        return taken

    def _settle(self, pending: PendingReply) -> None:
        """Remove a received reply from the pending ones."""
        if pending.part == "stream":
            return
        look = pending.look
        del pending.templates[0], pending.patterns[0]
        if pending.templates:
            return
        gone = [pending]
        if pending.ends:  # the one instead of the other
            gone = [each for each in self.pending if each.values is pending.values and each.ends]
        # Answers come in the order of messages, but a robot may answer questions while it comes to rest. A
        # reply that looks the same may have been that of the earlier message.
        for each in self.pending[: self.pending.index(pending)]:
            if each.cut and each.look != look and (pending.ends or each.part != "stopped"):
                gone.append(each)
        self._remove(gone)

    def _pattern(self, reply: AnyReply) -> re.Pattern[bytes]:
        """Regular expression of a text reply, with a group for each field."""
        if isinstance(reply, BinaryReply):
            return re.compile(rb"(?!)")
        made, loose, padded = b"", 0, 0
        for part, following in itertools.pairwise((*reply.parts, self._rules.reply_end)):
            if isinstance(part, str):
                made += re.escape(part.encode())
            elif not self._is_number(part):
                made, loose = made + _TEXT, loose + 1
            elif _ends_before(part.format, following):
                number = _number(part.format, _LONG)
                made += rb"[ ]*+((?>(?:%b)(?![0-9.])|%b))" % (self._words(number), number)
            else:
                number = _number(part.format, _SHORT)
                made += rb"[ ]*+(%b|%b)" % (number, self._words(number))
                padded, loose = (padded + 1, loose) if _padded(part.format) else (padded, loose + 1)
        if loose > MOST_TEXTS or padded > _MOST_PADDED:
            return re.compile(rb"(?!)")
        return re.compile(made + re.escape(self._end))

    def _words(self, number: bytes) -> bytes:
        """Regular expression of what stands for a missing number, and is not a number itself."""
        missing = self._rules.missing.encode()
        words = {*_WORDS, *((missing,) if missing and not re.fullmatch(number, missing) else ())}
        return b"|".join(re.escape(each) for each in sorted(words, key=len, reverse=True))

    def _is_number(self, part: Field) -> bool:
        """True if a field is a number, and cannot be a text."""
        if part.joint is not None or part.format.endswith(("s", "c", "%")) or "," in part.format:
            return False
        return bool(part.format) or part.expression.names <= self._numbers

    def _readings(self, template: AnyReply, match: re.Match[bytes], values: FieldValues) -> dict[str, float]:
        if not isinstance(template, TextReply):
            return {}
        fields = (part for part in template.parts if isinstance(part, Field))
        found: dict[str, float] = {}
        for part, text in zip(fields, match.groups(), strict=True):
            code, line = read_by(part.expression, self._rules.single, MessageScope(self._state, values))
            if line is None or not self._is_number(part):
                continue
            shown = text.decode("latin-1").strip()
            found[code] = math.inf if shown == self._rules.missing else _solved(shown, part.format, line)
        return found

    # -- binary ------------------------------------------------------------------------------------

    def _frame(self, frame: Frame) -> RobotReply:
        kind = frame.head.get(TYPE)
        for pending in self._candidates:
            template = pending.templates[0]
            if not isinstance(template, BinaryReply) or template.type not in (None, kind):
                continue
            readings: dict[str, float] = {}
            if template.pack and struct.calcsize(template.pack) == len(frame.content):
                numbers = struct.unpack(template.pack, frame.content)
                for expression, number in zip(template.values, numbers, strict=True):
                    scope = MessageScope(self._state, pending.values)
                    code, line = read_by(expression, self._rules.single, scope)
                    if line is not None and isinstance(number, int | float):
                        readings[code] = (number - line[1]) / line[0]
            reply = RobotReply(frame.data, pending.part, pending.rule, readings, pending.values)
            if template.times == 1:
                self._settle(pending)
            return reply
        return RobotReply(frame.data)


def _padded(shape: str) -> re.Match[str] | None:
    """The width of a format with leading zeros and a base."""
    return re.search(r"(#?)0(\d+)", shape) if shape[-1:] in _DIGITS else None


def _ends_before(shape: str, following: str | Field) -> bool:
    """True if a number in a format ends where the next part of its reply begins."""
    continues = "0123456789abcdefABCDEFxX" if shape[-1:] in _DIGITS else "0123456789.eE"
    return isinstance(following, str) and (not following or following[0] not in continues)


def _number(shape: str, decimal: bytes) -> bytes:
    """Regular expression of a number in a format, `decimal` if it has no base. Numbers with leading zeros may
    follow each other without anything in between."""
    if shape[-1:] not in _DIGITS:
        return decimal
    _, digit = _DIGITS[shape[-1]]
    padded = _padded(shape)
    if padded is None:
        return rb"[+-]?(?:0[xXob])?%b{1,%d}" % (digit, 64 if decimal is _LONG else 17)
    # The width counts the sign, and the 0x of a #.
    width = int(padded[2]) - 2 * len(padded[1])
    less, full, lazy = max(width - 1, 1), max(width, 1), b"" if decimal is _LONG else b"?"
    sizes = (digit, less, less + 3, lazy, digit, full, full + 3, lazy)
    return rb"(?:[+-](?:0[xXob])?%b{%d,%d}%b|(?:0[xXob])?%b{%d,%d}%b)" % sizes


def _solved(text: str, shape: str, line: tuple[float, float]) -> float:
    """The reading in a field, from its text in a format."""
    try:
        number = int(text, _DIGITS[shape[-1]][0]) if shape[-1:] in _DIGITS else float(text)
        return (number - line[1]) / line[0]
    except ValueError:  # ovf, which an Arduino prints for what is too great
        return math.inf
