"""Values read from Python source, and their evaluation within bounds."""

import ast
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

from msgspec import Struct

from simmer_tui.errors import NotUnderstoodError
from simmer_tui.sim.command import escape

MAX_NUMBER = 1e300
"""Largest number: far enough below the largest float that sums of a list stay finite."""
MAX_ITEMS = 100_000
"""Longest list or text. So a file takes at most some megabytes."""

_OPERATORS: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
}


class Unreadable(Struct, frozen=True):
    """In place of a value that could not be read; `why` follows "cannot be read: "."""

    why: str


class Located(Struct, frozen=True):
    """A value with its line. The values of a dict are located too."""

    value: Any
    line: int


class Call(Struct, frozen=True):
    """A call that was not made: the callee's last name (`Ultrasonic`) and its arguments."""

    name: str
    arguments: tuple[Any, ...]
    keywords: Mapping[str, Located]
    line: int

    def __str__(self) -> str:
        return f"{self.name}(...)"


def numbers_only(arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """The arguments, if they are numbers and lists of numbers. Raises NotUnderstoodError."""
    for argument in arguments:
        items = argument if isinstance(argument, list | range) else [argument]
        if not all(isinstance(item, int | float) for item in items):
            raise NotUnderstoodError("a function is understood with numbers only")
    return arguments


def as_text(value: Any) -> str:
    """A number or text as text; not lists, whose text could grow without bound. Raises NotUnderstoodError."""
    if isinstance(value, bool | int | float | str):
        return str(value)
    raise NotUnderstoodError("only a number can be made text")


def as_key(value: Any) -> Any:
    """The value, if it can be a key of a dict. Raises NotUnderstoodError."""
    if isinstance(value, bool | int | float | str):
        return value
    raise NotUnderstoodError("a key of a dict must be text or a number")


def readable(value: Any) -> Any:
    """The value. Raises NotUnderstoodError with the reason if it is an `Unreadable`."""
    if isinstance(value, Unreadable):
        raise NotUnderstoodError(value.why)
    return value


def item_of(container: Any, index: Any) -> Any:
    """One item of a list or dict that was read. Raises NotUnderstoodError."""
    if isinstance(container, dict) and isinstance(index, bool | int | float | str) and index in container:
        return readable(container[index].value)
    if isinstance(container, list) and isinstance(index, int) and -len(container) <= index < len(container):
        return container[index]
    raise NotUnderstoodError("an item is asked for that is not there")


def arithmetic(op: ast.operator, left: Any, right: Any) -> Any:
    """The result of an operator on two numbers, or of adding two lists or texts, within bounds."""
    if type(op) not in _OPERATORS:
        raise NotUnderstoodError(f"{type(op).__name__} is not understood")
    if isinstance(left, Vector) or isinstance(right, Vector):
        return _vector_arithmetic(op, left, right)
    numbers = isinstance(left, int | float) and isinstance(right, int | float)
    sums = isinstance(op, ast.Add) and type(left) is type(right) and isinstance(left, list | str)
    if not numbers and not sums:
        raise NotUnderstoodError("arithmetic is understood with numbers only")
    if isinstance(op, ast.Pow) and numbers:
        # As floats: 9 ** 9 ** 9 in whole numbers would never end.
        left, right = float(left), float(right)
    return checked(_OPERATORS[type(op)], left, right)


class Vector(list[Any]):
    """A `Vector2`: a list of two numbers that is added and multiplied as a vector."""

    def rotated(self, angle: float) -> "Vector":
        """The vector turned by an angle in degrees from x towards y, as by `Vector2.rotate`."""
        x, y = self
        cosine, sine = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        return Vector((x * cosine - y * sine, x * sine + y * cosine))


def vector(arguments: tuple[Any, ...]) -> Any:
    """The `Vector2` of two numbers; of other arguments, just a list."""
    numbers = arguments[0] if len(arguments) == 1 else list(arguments)
    if isinstance(numbers, list) and len(numbers) == 2 and all(isinstance(n, int | float) for n in numbers):
        return Vector(numbers)
    # The later use of the list reports the mistake.
    return numbers


def _vector_arithmetic(op: ast.operator, left: Any, right: Any) -> Vector:
    match op, left, right:
        case ast.Add() | ast.Sub(), Vector(), Vector():
            pairs = zip(left, right, strict=True)
        case ast.Mult() | ast.Div(), Vector(), int() | float():
            pairs = zip(left, [right] * 2, strict=True)
        case ast.Mult(), int() | float(), Vector():
            pairs = zip([left] * 2, right, strict=True)
        case _:
            raise NotUnderstoodError("this arithmetic with a vector is not understood")
    return Vector(arithmetic(op, a, b) for a, b in pairs)


def _linspace(start: Any, stop: Any, /, num: Any = 50, *, endpoint: Any = True) -> tuple[Any, Any, Any]:
    """Start, step and count of the numbers of `linspace`; 50 is numpy's default count."""
    parts = num - 1 if endpoint else num
    # A single number is the start, without a step to divide by.
    return start, (stop - start) / max(parts, 1), num


def _arange(start: Any, stop: Any = None, step: Any = 1, /) -> tuple[Any, Any, Any]:
    """The same for `arange`."""
    start, stop = (0, start) if stop is None else (start, stop)
    return start, step, max(0, checked(math.ceil, checked(operator.truediv, stop - start, step)))


SPACED: Mapping[str, Callable[..., tuple[Any, Any, Any]]] = {
    "numpy.linspace": _linspace,
    "numpy.arange": _arange,
}
"""The functions of evenly spaced numbers."""


def evenly_spaced(dotted: str, numbers: tuple[Any, ...], keywords: Mapping[str, Located]) -> list[float]:
    """The numbers that one of `SPACED` yields. Raises NotUnderstoodError."""
    name = dotted.rpartition(".")[2]
    given = {key: readable(item.value) for key, item in keywords.items()}
    if not all(isinstance(number, int | float) for number in (*numbers, *given.values())):
        raise NotUnderstoodError(f"{name} is understood with numbers only")
    try:
        start, step, count = SPACED[dotted](*numbers, **given)
    except TypeError:
        raise NotUnderstoodError(f"{name} is not understood with these arguments") from None
    if not isinstance(count, int) or not 0 <= count <= MAX_ITEMS:
        raise NotUnderstoodError("a list is too long")
    return [start + step * i for i in range(count)]


def checked(function: Callable[..., Any], *arguments: Any) -> Any:
    """The result of a function, if it is real and within bounds. Raises NotUnderstoodError."""
    try:
        value = function(*arguments)
        if isinstance(value, int | float) and abs(value) > MAX_NUMBER:
            raise NotUnderstoodError("a number is too large")
        if isinstance(value, list | str | range) and len(value) > MAX_ITEMS:
            raise NotUnderstoodError("a list is too long")
    except (TypeError, ValueError, ArithmeticError) as error:
        raise NotUnderstoodError(escape(str(error))) from error
    # For example, (-8) ** 0.5 is complex.
    if isinstance(value, complex):
        raise NotUnderstoodError("a number is not real")
    return value
