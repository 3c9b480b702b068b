"""Comparison of an exchange with a real robot with the rules of its dialect. Sans-IO."""

import heapq
import itertools
import math
import statistics
from collections.abc import Callable, Mapping, Sequence

from msgspec import Struct

from simmer_tui.dialect.device import DialectDevice, MoveEnd
from simmer_tui.dialect.dialect_rules import DialectRules, MessageRule, Velocity
from simmer_tui.dialect.expressions import FieldValues
from simmer_tui.dialect.readings import MessageScope
from simmer_tui.dialect.reply_reader import SILENCE, PendingReply, ReplyReader, RobotReply
from simmer_tui.dialect.templates import TextReply
from simmer_tui.dialect.timer import Timer
from simmer_tui.errors import ExpressionError
from simmer_tui.sim.command import cut, parse_command, parse_value
from simmer_tui.sim.velocity_commands import WAIT

# Enough for the loop of a sketch, and an adapter that passes bytes on every 16 ms.
LATE = 0.1
"""Seconds by which a reply may be later or earlier than by the dialect."""
# The last messages may be answered after the end of the record.
REPLY_TIMEOUT = 1.0
"""Seconds before the end of an exchange in which a reply may still be missing."""


class Exchanged(Struct, frozen=True):
    """A piece of an exchange: its line in the file, its time on the port (seconds), its bytes, and True if
    the robot sent them."""

    line: int
    time: float
    data: bytes
    from_robot: bool


class OtherAnswer(Struct, frozen=True, order=True):
    """A difference between dialect and robot, with the line of the exchange."""

    line: int
    text: str


class _PlannedHost:
    """A robot that moves at its drives' Speed; the exchange sets its time."""

    def __init__(self, rules: DialectRules, told: Callable[[str], None]) -> None:
        self.now = 0.0
        self.tell = told
        self._rules = rules
        self._due: list[tuple[float, int, Timer]] = []
        self._count = itertools.count()
        self._moving: Timer | None = None
        self.velocity_ended: Callable[[], None] = lambda: None
        """Called when a command has ended a velocity."""
        self._stopped: Callable[[], None] = lambda: None

    def pass_time(self, until: float) -> None:
        """Make the scheduled calls until a time."""
        while self._due and self._due[0][0] <= until:
            self.now, _, timer = heapq.heappop(self._due)
            timer()
        self.now = max(self.now, until)

    def call_later(self, seconds: float, call: Callable[[], None]) -> Timer:
        timer = Timer(call)
        heapq.heappush(self._due, (self.now + seconds, next(self._count), timer))
        return timer

    def read(self, codes: Sequence[str], done: Callable[[Mapping[str, float]], None]) -> None:
        done(dict.fromkeys(codes, math.nan))

    def move(self, command: str, done: Callable[[MoveEnd], None]) -> None:
        made = parse_command(command)
        if made.code != WAIT:
            self.velocity_ended()
        value = parse_value(made.argument)
        speed = math.hypot(*self._rules.parts.speeds.get(made.code, ()))
        seconds = abs(value) / speed if isinstance(value, float) and speed else 0.0
        self._stopped = lambda: done(MoveEnd(stopped=True))
        self._moving = self.call_later(seconds, lambda: done(MoveEnd()))

    def drive(self, velocity: Velocity | None, seconds: float | None) -> str:
        return ""

    def halt(self, by: str = "") -> None:
        if self._moving is not None and self._moving.pending:
            self._moving.cancel()
            self._stopped()

    def send(self, data: bytes, *, droppable: bool = False) -> None:
        """Search the robot's answers for the dialect's answer."""

    def inform(self, text: str) -> None:
        """Ignored: the robot sends nothing for it."""

    def done(self, message: bytes, meaning: str) -> None:
        """Ignored: `observer` gets the rule of each message."""


class _Asked(Struct, frozen=True):
    """A message: its line, its time (seconds), the delay of its answer by the dialect, and its values."""

    line: int
    time: float
    takes: float
    values: FieldValues


class Comparison:
    """Plays an exchange by the rules.

    Args:
        rules: The dialect.
        baud: Bits a second of the line; 0 if it is not known.
    """

    def __init__(self, rules: DialectRules, baud: float = 0.0) -> None:
        self.messages = 0
        """Number of messages to the robot."""
        self._byte = 10.0 / baud if baud > 0 else 0.0
        self._found: set[OtherAnswer] = set()
        self._line = 0
        self._asked: dict[int, _Asked] = {}
        """Pending messages, by the identity of their values."""
        self._delays: dict[str, list[tuple[float, float, int]]] = {}
        self._host = _PlannedHost(rules, self._note)
        self._device = DialectDevice(
            rules.reactive, self._host, self._note_message, lambda values: self._reader.cut_short(values)
        )
        self._host.velocity_ended = self._device.velocity_ended
        self._reader = ReplyReader(rules, self._device.state)

    def differences(self, pieces: Sequence[Exchanged]) -> list[OtherAnswer]:
        """All differences, in the order of the lines."""
        last = -math.inf
        for piece in pieces:
            if piece.time - last > SILENCE:
                self._take(self._reader.silence())
            last = piece.time
            self._line = piece.line
            self._host.pass_time(piece.time)
            if piece.from_robot:
                self._take(self._reader.receive(piece.data))
            else:
                self._device.received(piece.data)
        self._take(self._reader.silence())
        self._find_missing(last)
        self._find_late()
        return sorted(self._found)

    def _note(self, text: str) -> None:
        self._found.add(OtherAnswer(self._line, text))

    def _note_message(self, rule: MessageRule, values: FieldValues) -> None:
        self.messages += 1
        if rule.stops:
            return
        takes = 0.0
        try:
            if rule.takes is not None:
                takes = rule.takes.number(MessageScope(self._device.state, values))
        except ExpressionError:
            takes = math.nan
        self._asked[id(values)] = _Asked(self._line, self._host.now, takes, values)
        self._reader.asked(rule, values)

    def _take(self, replies: Sequence[RobotReply]) -> None:
        for reply in replies:
            if not reply.part:
                self._find_unknown(reply)
                continue
            asked = self._asked.get(id(reply.values)) if reply.values is not None else None
            if reply.part == "reply" and reply.rule is not None and asked is not None:
                delay = self._host.now - asked.time - len(reply.data) * self._byte
                self._delays.setdefault(reply.rule.shown, []).append((delay, asked.takes, asked.line))

    def _find_unknown(self, reply: RobotReply) -> None:
        shown = cut(reply.data.decode("utf-8", "surrogateescape").strip())
        if not shown:
            return
        pending = next((each for each in self._reader.pending if not each.optional), None)
        if pending is None:
            self._note(f"the robot says '{shown}', and the dialect nothing")
            return
        self._note(f"'{pending.rule.shown}': the robot says '{shown}', and the dialect '{_said(pending)}'")
        self._reader.forget(pending.rule)

    def _find_missing(self, end: float) -> None:
        """Replies of the dialect that the robot never sent."""
        for pending in self._reader.pending:
            asked = self._asked.get(id(pending.values))
            if asked is None or pending.optional or asked.time > end - REPLY_TIMEOUT:
                continue
            if pending.part == "done" and self._device.doing is pending.values:
                continue
            what = {"reply": "does not answer", "done": "says nothing at its end"}[pending.part]
            text = f"'{pending.rule.shown}': the robot {what}, and the dialect says '{_said(pending)}'"
            self._found.add(OtherAnswer(asked.line, text))

    def _find_late(self) -> None:
        """Messages that are answered later, or earlier, than by the dialect."""
        for shown, delays in self._delays.items():
            measured = statistics.median(delay for delay, _, _ in delays)
            takes = statistics.median(takes for _, takes, _ in delays)
            if abs(measured - takes) > LATE:
                text = f"'{shown}' is answered after {measured:.2f} s; the dialect has takes = {takes:g}"
                self._found.add(OtherAnswer(delays[0][2], text))


def _said(pending: PendingReply) -> str:
    """The dialect's answer."""
    shown = (
        reply.source if isinstance(reply, TextReply) else f"a frame of type {reply.type}"
        for reply in pending.templates
    )
    return cut("; ".join(shown))
