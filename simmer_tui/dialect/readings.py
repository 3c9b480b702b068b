"""Readings told from replies: expressions turned round, as far as they are `a*reading + b`."""

import math
from collections.abc import Callable, Mapping, Sequence

from simmer_tui.dialect.dialect_rules import AnyReply, MessageRule
from simmer_tui.dialect.expressions import Expression, FieldValue
from simmer_tui.dialect.templates import BinaryReply, Field, TextReply
from simmer_tui.errors import ExpressionError

# Two sides of one equation in floating point, some operations apart.
SAME = 1e-6
"""Difference of two numbers that are the same but for rounding."""


class MessageScope:
    """The names of an expression that reads no sensor: values of a message, and of the state."""

    def __init__(self, state: Mapping[str, FieldValue], values: Mapping[str, FieldValue]) -> None:
        self._names = {"contact": 0, "time": 0.0, **state, **values}

    def value(self, name: str) -> FieldValue:
        if name not in self._names:
            raise ExpressionError(f"'{name}' is not known before it is read")
        return self._names[name]

    def call(self, function: str, arguments: Sequence[FieldValue]) -> FieldValue:
        raise ExpressionError(f"{function}() asks the robot")


def straight_line(function: Callable[[float], float]) -> tuple[float, float] | None:
    """a and b of a function that is `a*n + b` with a that is not 0; None for any other."""
    try:
        low, high = function(1.0), function(2.0)
        a = high - low
        b = low - a
        probes = [(function(n), a * n + b) for n in (0.0, 7.0, 90.0)]
    except (ExpressionError, ArithmeticError, ValueError):
        return None
    if not (math.isfinite(a) and math.isfinite(b)) or abs(a) < SAME:
        return None
    scale = max(1.0, *(abs(wanted) for _, wanted in probes))
    return (a, b) if all(abs(got - wanted) <= SAME * scale for got, wanted in probes) else None


def reply_fields(reply: AnyReply) -> tuple[Field, ...]:
    """The fields of a text reply."""
    return (
        tuple(part for part in reply.parts if isinstance(part, Field)) if isinstance(reply, TextReply) else ()
    )


def packed_values(reply: AnyReply) -> tuple[Expression, ...]:
    """The values that a binary reply packs."""
    return reply.values if isinstance(reply, BinaryReply) else ()


def readable(rule: MessageRule, codes: frozenset[str], state: Mapping[str, FieldValue]) -> frozenset[str]:
    """The sensors whose readings can be told from the reply of a rule."""
    values: dict[str, FieldValue] = dict.fromkeys(rule.names, 0)
    if rule.patterns:
        values |= rule.patterns[0].match(rule.patterns[0].example) or {}
    found = set()
    for reply in rule.reply:
        for expression in (*(each.expression for each in reply_fields(reply)), *packed_values(reply)):
            code, line = read_by(expression, codes, MessageScope(state, values))
            if line is not None:
                found.add(code)
    return frozenset(found)


class _WithReading:
    """The names of an expression with one reading among them."""

    def __init__(self, scope: MessageScope, code: str) -> None:
        self._scope = scope
        self._code = code
        self.reading = 0.0

    def value(self, name: str) -> FieldValue:
        return self.reading if name == self._code else self._scope.value(name)

    def call(self, function: str, arguments: Sequence[FieldValue]) -> FieldValue:
        return self._scope.call(function, arguments)


def read_by(
    expression: Expression, codes: frozenset[str], scope: MessageScope
) -> tuple[str, tuple[float, float] | None]:
    """The one sensor that an expression reads, and a and b if its value is `a*reading + b`."""
    sensors = expression.names & codes
    if len(sensors) != 1:
        return "", None
    (code,) = sensors
    names = _WithReading(scope, code)

    def at(reading: float) -> float:
        names.reading = reading
        return expression.number(names)

    return code, straight_line(at)
