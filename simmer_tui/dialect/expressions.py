"""Expressions of a dialect.toml: arithmetic on a message's values and on sensors. None of it is executed.

The text is parsed with `ast` and walked by hand: only the entries of `_OPERATORS` and `FUNCTIONS` are
evaluated.
"""

import ast
import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Protocol

from simmer_tui.errors import ExpressionError
from simmer_tui.sim.command import counted

RealNumber = float | int
FieldValue = RealNumber | str | tuple["FieldValue", ...]
"""Result of an expression: a number, a text, or a list. A number that is not finite means a missing one."""

FieldValues = Mapping[str, FieldValue]
"""Values by name: those of a message, of the state, or readings."""

CONSTANTS: Mapping[str, float] = {"cm": 2.54, "mm": 25.4, "m": 0.0254}
"""Factors from inches to other units of length."""
# Far more than needed: no rule of the public teams has more than 90 characters.
LONGEST_EXPRESSION = 1000
"""Characters of an expression."""
# Evaluation takes about a microsecond a part, and no expression may take more than a millisecond.
MOST_NODES = 200
"""Parts of an expression: names, numbers, operators, calls."""
# 2**64 is the greatest number with a use in a protocol.
LARGEST_EXPONENT = 64
"""Greatest exponent of `**`."""
# An expression of 200 parts may have 60 texts at a time, which must stay below 64 KB.
LONGEST_TEXT = 1000
"""Characters of a text that an expression may make."""
# Above it not every whole number is a float. Without a bound, whole numbers would grow with each `**`.
_EXACT = 2**53


class Scope(Protocol):
    """The names an expression may use, while it is evaluated."""

    def value(self, name: str) -> FieldValue:
        """The value of a name."""

    def call(self, function: str, arguments: Sequence[FieldValue]) -> FieldValue:
        """The result of one of `SENSING`."""


def _number(value: FieldValue) -> RealNumber:
    if isinstance(value, int | float):
        return value
    raise ExpressionError(f"{_shown(value)} is not a number")


def _shown(value: FieldValue) -> str:
    if isinstance(value, tuple):
        return "a list"
    return f"'{value[:40]}'" if isinstance(value, str) else str(value)


def _bounded(value: RealNumber) -> RealNumber:
    """A number; as a float, if it is a whole number beyond the bound."""
    return float(value) if isinstance(value, int) and abs(value) > _EXACT else value


def _power(base: RealNumber, exponent: RealNumber) -> RealNumber:
    if abs(exponent) > LARGEST_EXPONENT:
        raise ExpressionError(f"exponents go up to {LARGEST_EXPONENT}")
    result = base**exponent if abs(base) <= _EXACT else float(base) ** exponent
    return math.nan if isinstance(result, complex) else result


def bounded_text(text: str) -> str:
    """The text. Raises ExpressionError if it is longer than `LONGEST_TEXT`."""
    if len(text) > LONGEST_TEXT:
        raise ExpressionError(f"texts go up to {LONGEST_TEXT} characters")
    return text


_OPERATORS: Mapping[type[ast.operator], Callable[[RealNumber, RealNumber], RealNumber]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: _power,
}
# Of float and a finite number other than 0: the result is a float, and missing where the float is.
_QUICK = frozenset((ast.Add, ast.Sub, ast.Mult))
_QUICK_BEFORE = _QUICK | {ast.Div, ast.FloorDiv, ast.Mod}
"""Operators that need no look at each value of a list: with a number before it, and with one behind it."""
_COMPARISONS: Mapping[type[ast.cmpop], Callable[[FieldValue, FieldValue], bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: lambda left, right: _number(left) < _number(right),
    ast.LtE: lambda left, right: _number(left) <= _number(right),
    ast.Gt: lambda left, right: _number(left) > _number(right),
    ast.GtE: lambda left, right: _number(left) >= _number(right),
}


def _unless_missing(values: Sequence[FieldValue]) -> Sequence[RealNumber]:
    """The numbers, or the missing ones alone if there are any."""
    numbers = [_number(each) for each in values]
    return [each for each in numbers if not math.isfinite(each)] or numbers


def _int(value: FieldValue) -> FieldValue:
    number = _number(value)
    return int(number) if math.isfinite(number) else number


def _round(value: FieldValue, digits: FieldValue = 0) -> FieldValue:
    number, places = _number(value), _number(digits)
    if not math.isfinite(number) or not abs(places) <= 15:
        return number
    return round(number, int(places)) if places else round(number)


def _pick(index: FieldValue, *values: FieldValue) -> FieldValue:
    place = _number(index)
    if not values or not 0 <= place < len(values):
        length = counted(len(values), "value")
        raise ExpressionError(f"pick({_shown(place)}, ...) has {length}, counted from 0")
    return values[int(place)]


def _length(value: FieldValue) -> FieldValue:
    if isinstance(value, int | float):
        raise ExpressionError("len() is for lists and texts")
    return len(value)


FUNCTIONS: Mapping[str, tuple[Callable[..., FieldValue], int, int]] = {
    "min": (lambda *values: min(_unless_missing(values)), 1, 100),
    "max": (lambda *values: max(_unless_missing(values)), 1, 100),
    "abs": (lambda value: abs(_number(value)), 1, 1),
    "round": (_round, 1, 2),
    "int": (_int, 1, 1),
    "pick": (_pick, 2, 100),
    "len": (_length, 1, 1),
}
"""Functions by name, with the least and the greatest number of their arguments."""
# Measured: a ray takes 0.09 ms, and a scan of 360 rays 0.35 ms.
SENSING: Mapping[str, tuple[int, int]] = {"ray": (1, 1), "scan": (3, 4), "named": (1, 4)}
"""Functions that read the robot's sensors, with the number of their arguments and their cost, in rays."""
MOST_SENSING = 4
# One a degree. Lidars of the public teams have 360 to 1,450 rays a turn, in frames of few: more take longer
# than an expression may.
MOST_RAYS = 360
"""Rays of one scan."""
# At 0.1 us each, the time that an expression may take. A sensor has at most 2,000 rays: four calculations
# with all of them, beside 200 parts.
MOST_STEPS = 10_000
"""Steps of one evaluation: `_PART` for each part, 1 for each value of a list, `_SLOW` more for one with which
Python cannot calculate at once."""
_PART, _SLOW = 10, 3


class _Bounded:
    """A scope, with the number of steps that are left."""

    def __init__(self, scope: Scope, steps: int) -> None:
        self.value, self.call = scope.value, scope.call
        self.left = steps

    def spend(self, steps: int) -> None:
        """Count steps. Raises ExpressionError beyond the limit."""
        self.left -= steps
        if self.left < 0:
            raise ExpressionError(f"takes more than {MOST_STEPS} steps: its lists are too long")


class Expression:
    """An expression that has been checked.

    Args:
        source: Its text.

    Raises:
        ValueError: The text is no expression, or has a part that is not allowed.
    """

    def __init__(self, source: str) -> None:
        self.source = source.strip()
        if not self.source:
            raise ValueError("is empty; write a number, a name or a calculation")
        if len(self.source) > LONGEST_EXPRESSION:
            raise ValueError(f"has {len(self.source)} characters; {LONGEST_EXPRESSION} are allowed")
        try:
            self.tree = ast.parse(self.source, mode="eval").body
            """The parsed source."""
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            reason = error.msg if isinstance(error, SyntaxError) else str(error)
            raise ValueError(f"'{self.source}' is no expression: {reason}") from None
        count = sum(1 for node in ast.walk(self.tree) if not isinstance(node, ast.expr_context))
        if count > MOST_NODES:
            raise ValueError(f"'{self.source[:40]}...' has {count} parts; {MOST_NODES} are allowed")
        self._steps = MOST_STEPS - _PART * count
        for node in ast.walk(self.tree):
            _check(node)
        called = _called(self.tree)
        if sum(SENSING[name][1] for name in called) > MOST_SENSING:
            raise ValueError(f"asks the robot {len(called)} times; one scan() or four ray() are allowed")
        self.names = frozenset(_names(self.tree))
        """The names it uses, without those of functions and constants."""
        self.sensing = frozenset(called)
        """The functions of `SENSING` that it calls."""
        self.texts = frozenset(
            node.value
            for node in ast.walk(self.tree)
            if isinstance(node, ast.Constant) and isinstance(node.value, str)
        )
        """The texts in it."""

    def value(self, scope: Scope) -> FieldValue:
        """Its value. Division by zero gives a missing number, and so does an index beyond a list. Raises
        ExpressionError."""
        return _value(self.tree, _Bounded(scope, self._steps))

    def number(self, scope: Scope) -> float:
        """Its value as a number. Raises ExpressionError."""
        return float(_number(self.value(scope)))


def _called(tree: ast.expr) -> list[str]:
    """The functions of `SENSING` that an expression calls, each as often as it does."""
    return [
        call.func.id
        for call in ast.walk(tree)
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in SENSING
    ]


def _check(node: ast.AST) -> None:
    """Raise ValueError for a part that is not allowed."""
    match node:
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
            least, most = _arguments_of(name)
            if not least <= len(arguments) <= most:
                wanted = str(least) if least == most else f"{least} to {most}"
                noun = "value" if most == 1 else "values"
                raise ValueError(f"{name}() takes {wanted} {noun}, not {len(arguments)}")
        case ast.Constant(value=value):
            if isinstance(value, bool) or not isinstance(value, int | float | str):
                raise ValueError(f"{value!r} is neither a number nor a text in quotes")
            if isinstance(value, int) and abs(value) > _EXACT:
                raise ValueError(f"{str(value)[:20]}... is too large; whole numbers go up to 2**53")
        case ast.BinOp(op=made) if type(made) not in _OPERATORS:
            raise ValueError("uses an operator that is not known; there are + - * / // % **")
        case ast.Compare(ops=compared) if not _COMPARISONS.keys() >= set(map(type, compared)):
            raise ValueError("uses a comparison that is not known; there are == != < <= > >=")
        case ast.Subscript(slice=ast.Slice()):
            raise ValueError("takes a part of a list; only one value can be taken, such as sc[3]")
        case ast.Call() | ast.UnaryOp(op=ast.Invert()):
            raise _unknown(node)
        case _ if type(node) not in _VALUES and not isinstance(node, _BESIDE):
            raise _unknown(node)


def _unknown(node: ast.AST) -> ValueError:
    return ValueError(f"uses {type(node).__name__.lower()}, which expressions do not have")


def _arguments_of(function: str) -> tuple[int, int]:
    """Least and greatest count of a function's arguments. Raises ValueError if it is not known."""
    if function in FUNCTIONS:
        return FUNCTIONS[function][1:]
    if function in SENSING:
        return SENSING[function][0], SENSING[function][0]
    raise ValueError(f"{function}() is not known; there are {', '.join([*FUNCTIONS, *SENSING])}")


def _names(tree: ast.AST) -> Iterator[str]:
    functions = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and id(node) not in functions and node.id not in CONSTANTS:
            yield node.id


def _value(node: ast.expr, scope: _Bounded) -> FieldValue:
    return _VALUES[type(node)](node, scope)


def _named(node: ast.Name, scope: _Bounded) -> FieldValue:
    factor = CONSTANTS.get(node.id)
    return scope.value(node.id) if factor is None else factor


def _calculated(node: ast.BinOp, scope: _Bounded) -> FieldValue:
    """The result of an operator; with a list and a number, value by value."""
    left, made, right = _value(node.left, scope), type(node.op), _value(node.right, scope)
    if isinstance(left, tuple) and isinstance(right, int | float):
        return _for_each(left, made, right, scope)
    if isinstance(right, tuple) and isinstance(left, int | float):
        return _for_each(right, made, left, scope, reverse=True)
    return _combined(left, made, right)


def _for_each(
    values: tuple[FieldValue, ...],
    made: type[ast.operator],
    number: RealNumber,
    scope: _Bounded,
    *,
    reverse: bool = False,
) -> FieldValue:
    """The results of an operator with each value of a list, and a number behind it, or before it."""
    scope.spend(len(values))
    quick = _QUICK if reverse else _QUICK_BEFORE
    if made in quick and number and math.isfinite(number) and {*map(type, values)} == {float}:
        calculate: Any = _OPERATORS[made]
        return tuple([calculate(number, each) if reverse else calculate(each, number) for each in values])
    scope.spend(_SLOW * len(values))
    pairs = [(number, each) if reverse else (each, number) for each in values]
    return tuple([_combined(left, made, right) for left, right in pairs])


def _combined(left: FieldValue, made: type[ast.operator], right: FieldValue) -> FieldValue:
    if isinstance(left, str) and isinstance(right, str) and made is ast.Add:
        return bounded_text(left + right)
    one, other = _number(left), _number(right)
    if not (math.isfinite(one) and math.isfinite(other)):
        return other if math.isfinite(one) else one
    try:
        return _bounded(_OPERATORS[made](one, other))
    except ZeroDivisionError:
        return math.nan
    except OverflowError:
        return math.inf


def _signed(node: ast.UnaryOp, scope: _Bounded) -> FieldValue:
    value = _value(node.operand, scope)
    if isinstance(node.op, ast.Not):
        return int(not value)
    return -_number(value) if isinstance(node.op, ast.USub) else _number(value)


def _joined(node: ast.BoolOp, scope: _Bounded) -> FieldValue:
    """The result of `and` or `or`: as in Python, the value that decides."""
    every = isinstance(node.op, ast.And)
    value: FieldValue = 0
    for part in node.values:
        value = _value(part, scope)
        if bool(value) is not every:
            break
    return value


def _compared(node: ast.Compare, scope: _Bounded) -> FieldValue:
    left = _value(node.left, scope)
    for made, other in zip(node.ops, node.comparators, strict=True):
        right = _value(other, scope)
        if isinstance(left, tuple) and isinstance(right, tuple):
            scope.spend(len(left))
        if not _COMPARISONS[type(made)](left, right):
            return 0
        left = right
    return 1


def _chosen(node: ast.IfExp, scope: _Bounded) -> FieldValue:
    return _value(node.body if _value(node.test, scope) else node.orelse, scope)


def _result(node: ast.Call, scope: _Bounded) -> FieldValue:
    assert isinstance(node.func, ast.Name), "checked"
    name, values = node.func.id, [_value(each, scope) for each in node.args]
    if name == "named" and not isinstance(values[0], int | float):
        # A code with its reading, or about three characters of a text.
        scope.spend((1 + _SLOW) * len(values[0]) if isinstance(values[0], tuple) else len(values[0]))
    return FUNCTIONS[name][0](*values) if name in FUNCTIONS else scope.call(name, values)


def _item(node: ast.Subscript, scope: _Bounded) -> FieldValue:
    sequence, index = _value(node.value, scope), _number(_value(node.slice, scope))
    if isinstance(sequence, int | float):
        raise ExpressionError(f"{_shown(sequence)} is not a list")
    # A message may have any index, and its sender waits for an answer: it gets a missing number.
    return sequence[int(index)] if 0 <= index < len(sequence) else math.nan


_VALUES: Mapping[type[ast.AST], Callable[[Any, _Bounded], FieldValue]] = {
    ast.Constant: lambda node, scope: node.value,
    ast.Name: _named,
    ast.BinOp: _calculated,
    ast.UnaryOp: _signed,
    ast.BoolOp: _joined,
    ast.Compare: _compared,
    ast.IfExp: _chosen,
    ast.Call: _result,
    ast.Subscript: _item,
}
"""Functions that compute the values of parts, by their type."""
_BESIDE = (ast.operator, ast.unaryop, ast.boolop, ast.cmpop, ast.expr_context)
"""Types of parts without a value, such as operators."""


def listed_codes(value: FieldValue) -> tuple[str, ...]:
    """The codes in a {name:list}, or in a text."""
    if isinstance(value, tuple):
        return tuple(each for each in value if isinstance(each, str))
    return tuple(each.strip() for each in value.split(",")) if isinstance(value, str) and value else ()


def finite(arguments: Sequence[FieldValue], function: str) -> list[float]:
    """The arguments of a function that takes finite numbers. Raises ExpressionError."""
    numbers = [each for each in arguments if isinstance(each, int | float)]
    if len(numbers) != len(arguments) or not all(map(math.isfinite, numbers)):
        raise ExpressionError(f"{function} needs numbers")
    return numbers


def scan_bearings(arguments: Sequence[FieldValue]) -> list[float]:
    """The bearings of scan(first, step, count). Raises ExpressionError."""
    first, step, count = finite(arguments, "scan")
    if not 1 <= count <= MOST_RAYS:
        raise ExpressionError(f"scan takes 1 to {MOST_RAYS} rays")
    return [first + each * step for each in range(int(count))]
