"""What values read from Python source are made of, and how they are worked out within bounds."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from simmer_tui.errors import NotUnderstoodError
from simmer_tui.sim.command import escape

MAX_NUMBER = 1e300
"""Largest number."""
MAX_ITEMS = 100_000
"""Longest list or text."""

_OPERATORS: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
}


@dataclass(frozen=True, slots=True)
class Unreadable:
    """In place of a value that could not be read; `why` follows "cannot be read: "."""

    why: str


@dataclass(frozen=True, slots=True)
class Located:
    """A value and the line it stands on. The values of a dict are located too."""

    value: Any
    line: int


@dataclass(frozen=True, slots=True)
class Call:
    """A call that was not made: the callee's last name (`Ultrasonic`) and what it was given."""

    name: str
    arguments: tuple[Any, ...]
    keywords: Mapping[str, Located]
    line: int


def numbers_only(arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """The arguments, if they are numbers and lists of numbers. Raises NotUnderstoodError."""
    for argument in arguments:
        items = argument if isinstance(argument, list | range) else [argument]
        if not all(isinstance(item, int | float) for item in items):
            raise NotUnderstoodError("a function is understood with numbers only")
    return arguments


def as_text(value: Any) -> str:
    """A number or text as text; of lists, a text could grow without bound."""
    if isinstance(value, bool | int | float | str):
        return str(value)
    raise NotUnderstoodError("only a number can be made text")


def readable(value: Any) -> Any:
    """The value, or NotUnderstoodError with the reason why there is none."""
    if isinstance(value, Unreadable):
        raise NotUnderstoodError(value.why)
    return value


def as_key(value: Any) -> Any:
    """The value, if it can be a key of a dict. Raises NotUnderstoodError."""
    if isinstance(value, bool | int | float | str):
        return value
    raise NotUnderstoodError("a key of a dict must be text or a number")


def item_of(container: Any, index: Any) -> Any:
    """One item of a list or dict that were read. Raises NotUnderstoodError."""
    if isinstance(container, dict) and isinstance(index, bool | int | float | str) and index in container:
        return readable(container[index].value)
    if isinstance(container, list) and isinstance(index, int) and -len(container) <= index < len(container):
        return container[index]
    raise NotUnderstoodError("an item is asked for that is not there")


def arithmetic(op: ast.operator, left: Any, right: Any) -> Any:
    """The result of an operator on two numbers, or of adding two lists or texts, within bounds."""
    if type(op) not in _OPERATORS:
        raise NotUnderstoodError(f"{type(op).__name__} is not understood")
    numbers = isinstance(left, int | float) and isinstance(right, int | float)
    sums = isinstance(op, ast.Add) and type(left) is type(right) and isinstance(left, list | str)
    if not numbers and not sums:
        raise NotUnderstoodError("arithmetic is understood with numbers only")
    if isinstance(op, ast.Pow) and numbers:
        # As floats: 9 ** 9 ** 9 in whole numbers would never end.
        left, right = float(left), float(right)
    return checked(_OPERATORS[type(op)], left, right)


def checked(function: Callable[..., Any], *arguments: Any) -> Any:
    """The result of a function if it has one that is real and within bounds. Raises NotUnderstoodError."""
    try:
        value = function(*arguments)
        if isinstance(value, int | float) and abs(value) > MAX_NUMBER:
            raise NotUnderstoodError("a number is too large")
        if isinstance(value, list | str | range) and len(value) > MAX_ITEMS:
            raise NotUnderstoodError("a list is too long")
    except (TypeError, ValueError, ArithmeticError) as error:
        raise NotUnderstoodError(escape(str(error))) from error
    if isinstance(value, complex):
        raise NotUnderstoodError("a number is not real")
    return value
