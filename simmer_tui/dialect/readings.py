"""Readings from replies: the inverse of expressions, if they are `a*reading + b`."""

import math
from collections.abc import Callable, Sequence

from simmer_tui.dialect.dialect_rules import MessageRule
from simmer_tui.dialect.expressions import Expression, FieldValue, FieldValues
from simmer_tui.dialect.templates import BinaryReply
from simmer_tui.errors import ExpressionError

# Above the rounding of a few floating-point operations.
ROUNDING = 1e-6
"""Greatest difference of two numbers that are equal except for rounding."""


class MessageScope:
    """The names of an expression that reads no sensor: values of a message, and of the state."""

    def __init__(self, state: FieldValues, values: FieldValues) -> None:
        self.names = {"contact": 0, "time": 0.0, **state, **values}

    def value(self, name: str) -> FieldValue:
        if name not in self.names:
            raise ExpressionError(f"'{name}' is not known before it is read")
        return self.names[name]

    def call(self, function: str, arguments: Sequence[FieldValue]) -> FieldValue:
        raise ExpressionError(f"{function}() asks the robot")


def straight_line(function: Callable[[float], float]) -> tuple[float, float] | None:
    """The a and b of a function `a*n + b` with a not 0; None for any other function."""
    try:
        low, high = function(1.0), function(2.0)
        a = high - low
        b = low - a
        probes = [(function(n), a * n + b) for n in (0.0, 7.0, 90.0)]
    except (ExpressionError, ArithmeticError, ValueError):
        return None
    if not (math.isfinite(a) and math.isfinite(b)) or abs(a) < ROUNDING:
        return None
    scale = max(1.0, *(abs(wanted) for _, wanted in probes))
    return (a, b) if all(abs(got - wanted) <= ROUNDING * scale for got, wanted in probes) else None


def readable_sensors(rule: MessageRule, codes: frozenset[str], state: FieldValues) -> frozenset[str]:
    """The sensors whose readings can be computed from the reply of a rule."""
    scope = MessageScope(state, rule.example(0))
    found = set()
    for reply in rule.reply:
        # A binary reply's text is not read.
        for expression in reply.values if isinstance(reply, BinaryReply) else reply.expressions:
            code, line = read_by(expression, codes, scope)
            if line is not None:
                found.add(code)
    return frozenset(found)


def read_by(
    expression: Expression, codes: frozenset[str], scope: MessageScope
) -> tuple[str, tuple[float, float] | None]:
    """The one sensor that an expression reads, and a and b if its value is `a*reading + b`."""
    sensors = expression.names & codes
    if len(sensors) != 1:
        return "", None
    (code,) = sensors
    with_reading = MessageScope(scope.names, {})

    def at(reading: float) -> float:
        with_reading.names[code] = reading
        return expression.number(with_reading)

    return code, straight_line(at)
