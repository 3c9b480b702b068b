"""The inverse of a dialect.toml's rules: the message for a command of ours, if there is one.

A rule can be inverted in two cases. It has one step, a movement or a run, and at most one unknown number, on
which the step depends as `a*n + b`. Or it has no step, and a reading is alone in a field of its reply. Each
message is checked by the rules after it has been made: it must match this rule, and do what was requested.
"""

import itertools
import math
import struct
from collections.abc import Iterator, Mapping

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.dialect.dialect_rules import (
    DialectRules,
    MessageRule,
    MoveStep,
    RunStep,
    StopStep,
    Velocity,
    expressions_of,
    scaled,
)
from simmer_tui.dialect.expressions import FieldValue, FieldValues
from simmer_tui.dialect.frames import Deframer, Frame
from simmer_tui.dialect.patterns import NUMERIC, Pattern
from simmer_tui.dialect.readings import ROUNDING, MessageScope, readable_sensors, straight_line
from simmer_tui.dialect.templates import pack_codes
from simmer_tui.errors import ExpressionError
from simmer_tui.sim.command import parse_command, parse_value

# The choices of a public team's rule have 4 combinations.
MOST_CHOICES = 256
"""Combinations of a rule's choices that are tried."""
# A robot's resolution is coarser than four decimals of an inch or a degree.
_DECIMALS = 4


class DialectMessage(Struct, frozen=True):
    """A message that does what a command asks.

    `number` is the one in it, NaN if there is none. `rule` is the rule that it matches.
    """

    data: bytes
    text: str
    rule: MessageRule
    number: float = math.nan
    seconds: float = 0.0
    """Duration of a timed run."""


class _Found(Struct, frozen=True):
    """The movement of a message: its direction, distance and duration."""

    direction: Velocity | str
    """A unit velocity, or the code of a part without one, such as the gripper."""
    distance: float
    """Signed along the direction; infinite for a run without an end."""
    seconds: float = 0.0
    """Duration of a run."""


class InverseRules:
    """The inverse of a dialect's rules.

    Args:
        rules: The dialect.
        state: The robot's present state, which messages change; by default that at its start.
    """

    def __init__(self, rules: DialectRules, state: FieldValues | None = None) -> None:
        self._rules = rules
        self._state = rules.state if state is None else state

    # -- messages for commands -----------------------------------------------------------------------

    def stop(self) -> DialectMessage | None:
        """The message of a rule that is a plain stop."""
        rules = self._rules.rules
        stops = (each for each in rules if each.steps and all(isinstance(s, StopStep) for s in each.steps))
        return next((message for rule in stops for message in self._messages(rule)), None)

    def drive(self, code: str, value: float) -> DialectMessage | str:
        """The message for a movement of known length, or the reason there is none."""
        made = self._moves(code, value)
        # The robot's own word for the opposite direction is tried before a negative number, which its sketch
        # may not expect.
        why_none = f"no rule of the dialect with one step and one number does {code}"
        return min(made, key=lambda each: each.number < 0, default=why_none)

    def code_of(self, velocity: Velocity) -> tuple[str, float] | None:
        """The drive along a velocity, and 1 for its direction or -1 for the opposite one."""
        size = math.hypot(*velocity)
        if not size:
            return None
        wanted = _Found(scaled(velocity, 1 / size), 1.0)
        for code in self._rules.parts.speeds:
            sign = _along(wanted, self._direction(code, 1.0))
            if abs(sign) == 1.0:
                return code, sign
        return None

    def held(self, code: str, value: float) -> DialectMessage | str:
        """The message for a key that drives while it is held. It is an untimed run, if a rule has one; else a
        movement by `value`, else one of the rule's own length."""
        wanted = self._direction(code, value)
        messages = [each for rule in self._rules.rules for each in self._messages(rule)]
        shares = [_along(self._does(each), wanted) for each in messages]
        if math.inf in shares:
            return messages[shares.index(math.inf)]
        driven = self.drive(code, value)
        if isinstance(driven, DialectMessage):
            return driven
        return next((each for each, share in zip(messages, shares, strict=True) if share > 0), driven)

    def read(self, code: str) -> DialectMessage | str:
        """The message that is answered with a reading of a sensor, or the reason there is none."""
        rules, single = self._rules.rules, self._rules.single
        answers = (
            each for each in rules if not each.steps and code in readable_sensors(each, single, self._state)
        )
        why_none = f"no message of the dialect without a movement is answered with {code} alone in a field"
        return next((message for rule in answers for message in self._messages(rule)), why_none)

    def dictionary(self) -> Iterator[tuple[str, str]]:
        """Each command of ours for which there is a message, with the message; the stop first."""
        stop = self.stop()
        if stop is None:
            return
        yield "stop", stop.text
        for code in self._rules.parts.speeds:
            for sign, shown in ((1.0, f"{code}-N"), (-1.0, f"{code}--N")):
                # A number that a robot of any size can do, and that no rule has as a constant.
                driven, held = self.drive(code, sign * 1.375), self.held(code, sign * 1.375)
                if isinstance(driven, DialectMessage):
                    yield shown, driven.rule.shown
                elif isinstance(held, DialectMessage):
                    yield f"{shown}, keys only", held.rule.shown
        for code in sorted(self._rules.single):
            asked = self.read(code)
            if isinstance(asked, DialectMessage):
                yield code, asked.text

    # -- movements -----------------------------------------------------------------------------------

    def _direction(self, code: str, value: float) -> Velocity | str:
        """The unit velocity of a drive, reversed for a negative value; any other code is returned itself."""
        speed = self._rules.parts.speeds.get(code)
        if speed is None:
            return code
        return scaled(speed, math.copysign(1.0, value) / math.hypot(*speed))

    def _moves(self, code: str, value: float) -> Iterator[DialectMessage]:
        wanted = self._direction(code, value)
        for rule in self._rules.rules:
            if len(rule.steps) == 1 and isinstance(rule.steps[0], MoveStep | RunStep):
                solved = (self._solved(form, wanted, abs(value)) for form in _forms(rule))
                yield from (message for message in solved if message is not None)

    def _solved(self, form: "_Form", wanted: Velocity | str, distance: float) -> DialectMessage | None:
        """The message that moves by this distance, with its number solved for."""
        numbers = form.numbers
        if len(numbers) > 1:
            return None
        number, slack, texts = math.nan, ROUNDING, {}
        if numbers:
            ((name, kind),) = numbers.items()

            def going(n: float) -> float:
                return _along(self._evaluated(form.rule, form.values({name: n})), wanted)

            line = straight_line(going)
            if line is None:
                return None
            number = (distance - line[1]) / line[0]
            text = _written(number, kind)
            if text is None:
                return None
            texts[name] = text
            # With whole numbers, the robot's language allows no more exact distance.
            slack = abs(line[0]) * (0.5 if kind in ("int", "digit") else 10.0**-_DECIMALS) + ROUNDING
        message = self._message(form, texts)
        found = self._does(message) if message is not None else None
        if message is None or found is None or not abs(_along(found, wanted) - distance) <= slack:
            return None
        return replace(message, number=number, seconds=found.seconds)

    def _does(self, message: DialectMessage) -> _Found | None:
        """The movement that a message makes."""
        frame = self._frame(message.data)
        values = message.rule.values(frame) if frame is not None else None
        return self._evaluated(message.rule, values) if values is not None else None

    def _evaluated(self, rule: MessageRule, values: FieldValues) -> _Found | None:
        """The movement of a rule with these values; None if it makes none."""
        if len(rule.steps) != 1:
            return None
        step, scope = rule.steps[0], MessageScope(self._state, values)
        try:
            if isinstance(step, MoveStep):
                command = parse_command(step.command.text(scope, "inf"))
                distance = parse_value(command.argument)
                if isinstance(distance, str):
                    return None
                return _Found(self._direction(command.code, 1.0), distance)
            if isinstance(step, RunStep):
                drive = step.drive.text(scope, "")
                code = drive.removeprefix("-")
                direction = self._direction(code, -1.0 if drive != code else 1.0)
                if isinstance(direction, str):
                    return None
                seconds = step.seconds.number(scope) if step.seconds is not None else math.inf
                return _Found(direction, seconds * math.hypot(*self._rules.parts.speeds[code]), seconds)
        except ExpressionError:
            return None
        return None

    # -- messages ------------------------------------------------------------------------------------

    def _messages(self, rule: MessageRule) -> Iterator[DialectMessage]:
        """The messages of a rule that need no number."""
        forms = _forms(rule)
        if rule.type is not None and not rule.patterns and not rule.unpack:
            forms = iter((_Form(rule),))
        made = (self._message(form, {}) for form in forms)
        yield from (message for message in made if message is not None)

    def _message(self, form: "_Form", numbers: Mapping[str, str]) -> DialectMessage | None:
        """The message with these numbers; None if one is missing, or an earlier rule matches it."""
        try:
            content, text = form.content(numbers)
            data = self._rules.framing.message(form.rule.type, content)
        except (KeyError, ValueError, struct.error):
            return None
        frame = self._frame(data)
        if frame is None:
            return None
        found = self._rules.found(frame, lambda values: MessageScope(self._state, values))
        if found is None or found[0] is not form.rule:
            return None
        return DialectMessage(data, text, form.rule)

    def _frame(self, data: bytes) -> Frame | None:
        """The frame that the robot would read from these bytes; None if they are not one whole message."""
        frames = Deframer(self._rules.framing, self._rules.types).receive(data)
        only = frames[0] if len(frames) == 1 else None
        return only if isinstance(only, Frame) and only.data == data else None


class _Form(Struct, frozen=True):
    """Messages of a rule that differ in numbers alone: one of its patterns with the words of its choices, or
    its packed values."""

    rule: MessageRule
    pattern: Pattern | None = None
    choices: Mapping[str, str] = {}

    @property
    def kinds(self) -> Mapping[str, str]:
        """The kinds of its values."""
        if self.pattern is not None:
            return self.pattern.kinds
        packed = zip(self.rule.names, pack_codes(self.rule.unpack), strict=True)
        return {name: "number" if code in "fde" else "int" for name, code in packed}

    @property
    def numbers(self) -> dict[str, str]:
        """The kinds of the numbers on which the first step depends."""
        used = frozenset[str]().union(*(each.names for each in expressions_of(self.rule.steps[0])))
        return {name: kind for name, kind in self.kinds.items() if kind in NUMERIC and name in used}

    def values(self, numbers: Mapping[str, float]) -> dict[str, FieldValue]:
        """The values of a message with these numbers, defaults for the rest."""
        values: dict[str, FieldValue] = dict.fromkeys(self.rule.names, 0)
        pattern = self.pattern
        if pattern is not None:
            example = pattern.match(pattern.example) or {}
            values |= {name: example[name] for name in pattern.defaults if name in example}
            values |= {name: pattern.choices[name][word] for name, word in self.choices.items()}
        return {**values, **numbers}

    def content(self, numbers: Mapping[str, str]) -> tuple[bytes, str]:
        """The content of a message with these numbers, and the message as people read it. Raises KeyError,
        ValueError or struct.error if there is none."""
        rule, kinds = self.rule, self.kinds
        if rule.unpack:
            given = {name: float(numbers.get(name, "0")) for name in rule.names}
            packed = (n if kinds[name] == "number" else round(n) for name, n in given.items())
            return struct.pack(rule.unpack, *packed), f"{rule.shown} = {[*given.values()]}"
        if self.pattern is None:
            return b"", rule.shown
        text = self.pattern.filled({**self.choices, **numbers})
        return text.encode(), text


def _forms(rule: MessageRule) -> Iterator[_Form]:
    """The patterns of a rule, each with all combinations of the words of its choices."""
    if rule.unpack:
        yield _Form(rule)
        return
    for pattern in rule.patterns:
        words = [[(name, word) for word in words] for name, words in pattern.choices.items()]
        for combination in itertools.islice(itertools.product(*words), MOST_CHOICES):
            yield _Form(rule, pattern, dict(combination))


def _along(found: _Found | None, wanted: Velocity | str) -> float:
    """Length of a movement in a direction; NaN for another direction, or no movement."""
    if found is None:
        return math.nan
    if isinstance(wanted, str) or isinstance(found.direction, str):
        return found.distance if found.direction == wanted else math.nan
    aligned = sum(a * b for a, b in zip(found.direction, wanted, strict=True))
    if abs(abs(aligned) - 1.0) > ROUNDING:
        return math.nan
    return math.copysign(1.0, aligned) * found.distance


def _written(number: float, kind: str) -> str | None:
    """A number as written in a message; None if the kind does not allow it."""
    if not math.isfinite(number):
        return None
    if kind == "number":
        text = f"{number:.{_DECIMALS}f}".rstrip("0").rstrip(".")
        return "0" if text == "-0" else text
    if kind == "digit":
        return str(round(number)) if 0 <= round(number) <= 9 else None
    return str(round(number))
