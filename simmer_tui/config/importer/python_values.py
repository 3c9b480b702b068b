"""Values of Python source: their kinds, operators, comparisons and formats, and the bounds of their sizes."""

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

from msgspec import Struct, field

from simmer_tui.errors import NotUnderstoodError, RaisedError
from simmer_tui.sim.command import cut

MAX_NUMBER = 1e300
"""Largest number: far enough below the largest float that sums of a list stay finite."""
MAX_ITEMS = 100_000
"""Longest list, dict or text. So a file takes at most some megabytes."""

_EXACT = 64
"""Largest whole exponent of a whole number that is worked out exactly: the result has at most some KB."""
_OPERATORS: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
}
_ORDERS: Mapping[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
# Formats of numbers and texts: two digits of width at most, since a width can fill the memory.
_FORMAT = re.compile(r"(.?[<>=^])?[-+ ]?#?0?\d{0,2}[,_]?(\.\d{1,2})?[bcdeEfFgGnosxX%]?")
_PERCENT = re.compile(r"%[-+ 0#]*\d{0,2}(\.\d{1,2})?[diouxXeEfFgGsc%]")


class Unreadable(Struct, frozen=True):
    """In place of a value that could not be read; `why` follows "cannot be read: "."""

    why: str


class Located(Struct, frozen=True):
    """A value with its line. The values of a dict are located too."""

    value: Any
    line: int


NamedValues = dict[str, Located]


class Call(Struct, frozen=True):
    """A call that was not made: the callee's last name (`Ultrasonic`) and its arguments, as they were then.

    `changes` has the attributes that were assigned to its result afterwards.
    """

    name: str
    arguments: tuple[Any, ...]
    keywords: Mapping[str, Located]
    line: int
    changes: dict[str, Located] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.name}(...)"


class Reference(Struct, frozen=True):
    """Something outside of the file by its full name: `math.cos`, `devices.ultrasonic.Ultrasonic`."""

    dotted: str

    @property
    def name(self) -> str:
        """The last part of its name."""
        return self.dotted.rpartition(".")[2]

    def __str__(self) -> str:
        return self.name


class Function(Struct, frozen=True, eq=False):
    """A function that the file defines: its node, the values of its defaults by argument, the scopes around
    it from the innermost, and the class it belongs to."""

    node: ast.FunctionDef | ast.Lambda
    defaults: Mapping[str, Located]
    scopes: tuple[dict[str, Located], ...]
    file: str
    owner: "Class | None" = None

    def __str__(self) -> str:
        return "a function"


class Class(Struct, frozen=True, eq=False):
    """A class that a file defines, with the values of its body. `bases` has the last name of each base."""

    node: ast.ClassDef
    names: NamedValues
    bases: tuple[str, ...]
    file: str

    @property
    def name(self) -> str:
        """Its name in the file."""
        return self.node.name

    def __str__(self) -> str:
        return f"the class {self.name}"


class Instance(Struct, frozen=True, eq=False):
    """An object with attributes: of a class of the file, or a plain namespace. `places` has the file and line
    of the statement that set an attribute. `call` is the call that made it. `descriptions` has the dicts that
    its `__init__` passed to those of its bases."""

    names: NamedValues
    owner: Class | None = None
    call: Call | None = None
    places: dict[str, str] = field(default_factory=dict)
    descriptions: list[dict[Any, Located]] = field(default_factory=list)

    def __str__(self) -> str:
        return "an object"


class Vector(list[Any]):
    """A `Vector2`: a list of two numbers that is added and multiplied as a vector."""

    def rotated(self, angle: float) -> "Vector":
        """The vector turned by an angle in degrees from x towards y, as by `Vector2.rotate`."""
        x, y = self
        cosine, sine = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        return Vector((x * cosine - y * sine, x * sine + y * cosine))


def is_plain(value: Any) -> bool:
    """True for a number, a text or None."""
    return value is None or isinstance(value, bool | int | float | str)


def as_key(value: Any) -> Any:
    """The value, if it is plain, so that it can be a key of a dict. Raises NotUnderstoodError."""
    if is_plain(value):
        return value
    raise NotUnderstoodError("a key of a dict must be text or a number")


def readable(value: Any) -> Any:
    """The value. Raises NotUnderstoodError with the reason if it is an `Unreadable`."""
    if isinstance(value, Unreadable):
        raise NotUnderstoodError(value.why)
    return value


def truth(value: Any) -> bool:
    """The truth of a value in Python. Raises NotUnderstoodError for the result of an unknown call."""
    if isinstance(value, Call | Reference):
        raise NotUnderstoodError(f"{cut(str(value))} has no value that is known here")
    return bool(value) if is_plain(value) or isinstance(value, list | dict) else True


def items_of(value: Any) -> list[Any]:
    """The items of a value in a loop. Raises NotUnderstoodError."""
    if not isinstance(value, list | dict | str):
        raise NotUnderstoodError("a loop needs a list, a range or a dict")
    return list(value)


def bounded(value: Any) -> Any:
    """The value, if it is within bounds. Raises NotUnderstoodError."""
    if isinstance(value, int | float) and abs(value) > MAX_NUMBER:
        raise NotUnderstoodError("a number is too large")
    if isinstance(value, list | str | range | dict) and len(value) > MAX_ITEMS:
        raise NotUnderstoodError("a list is too long")
    # For example, (-8) ** 0.5 is complex.
    if isinstance(value, complex):
        raise NotUnderstoodError("a number is not real")
    return value


def checked(function: Callable[..., Any], *arguments: Any) -> Any:
    """The result of a function, if it is real and within bounds. Raises NotUnderstoodError."""
    try:
        return bounded(function(*arguments))
    except (TypeError, ValueError, ArithmeticError) as error:
        raise RaisedError(str(error)) from error


def snapshot(value: Any, charge: Callable[[int], None]) -> Any:
    """A copy of a value whose lists and dicts later statements cannot change. `charge` is called with the
    number of items copied."""
    return _copied(value, charge, {}, 0)


def _copied(value: Any, charge: Callable[[int], None], done: dict[int, Any], depth: int) -> Any:
    if not isinstance(value, list | dict):
        return value
    # Lists of lists of lists that are the same object are copied once.
    if id(value) not in done:
        if depth > 50:
            raise NotUnderstoodError("it is nested too deeply")
        charge(1 + len(value) // 10)
        if isinstance(value, dict):
            items = value.items()
            done[id(value)] = {
                key: Located(_copied(each.value, charge, done, depth + 1), each.line) for key, each in items
            }
        else:
            done[id(value)] = type(value)(_copied(each, charge, done, depth + 1) for each in value)
    return done[id(value)]


# -- operators -------------------------------------------------------------------------------


def as_text(value: Any) -> str:
    """A number or text as text; not lists, whose text could grow without bound. Raises NotUnderstoodError."""
    if is_plain(value):
        return str(value)
    raise NotUnderstoodError("only a number can be made text")


def formatted(value: Any, form: str) -> str:
    """A number or text in a format, as by `format`. Raises NotUnderstoodError."""
    if not is_plain(value) or not _FORMAT.fullmatch(form):
        raise NotUnderstoodError("a format is not understood")
    text: str = checked(format, value, form)
    return text


def item_of(container: Any, index: Any) -> Any:
    """One item, or a slice, of a value that was read. Raises NotUnderstoodError."""
    if isinstance(container, list | str) and isinstance(index, slice):
        return checked(operator.getitem, container, index)
    truth(container)  # the result of a call that was not made may be anything
    missing = "an item is asked for that is not there"
    if isinstance(container, dict):
        key = as_key(index)
        if key not in container:
            raise RaisedError(missing)
        return readable(container[key].value)
    if isinstance(container, list | str) and isinstance(index, int):
        if not -len(container) <= index < len(container):
            raise RaisedError(missing)
        return container[index]
    raise NotUnderstoodError(missing)


def compared(op: ast.cmpop, left: Any, right: Any) -> bool:
    """The result of a comparison. Raises NotUnderstoodError unless it is of numbers, texts or flat lists."""
    for each in (left, right):
        truth(each)  # the result of a call that was not made may be anything
    if isinstance(op, ast.In | ast.NotIn):
        return _contains(right, left) is isinstance(op, ast.In)
    if isinstance(op, ast.Is | ast.IsNot | ast.Eq | ast.NotEq):
        flat = [
            all(map(is_plain, each)) if isinstance(each, list) else is_plain(each) for each in (left, right)
        ]
        # Nested lists would take any amount of time; they are never equal to a number, a text or None.
        if not all(flat) and not is_plain(left) and not is_plain(right):
            raise NotUnderstoodError("a comparison of such values is not understood")
        same = all(flat) and left == right
        return same is isinstance(op, ast.Is | ast.Eq)
    numbers = isinstance(left, int | float) and isinstance(right, int | float)
    if type(op) not in _ORDERS or not (numbers or (isinstance(left, str) and isinstance(right, str))):
        raise NotUnderstoodError("a comparison of such values is not understood")
    return _ORDERS[type(op)](left, right)


def _contains(container: Any, item: Any) -> bool:
    if isinstance(container, dict):
        return as_key(item) in container
    if isinstance(container, str) and isinstance(item, str):
        return item in container
    if isinstance(container, list) and is_plain(item):
        return any(is_plain(each) and each == item for each in container)
    raise NotUnderstoodError("a comparison of such values is not understood")


def arithmetic(op: ast.operator, left: Any, right: Any) -> Any:
    """The result of an operator on two numbers, or of adding or repeating lists and texts, within bounds."""
    if isinstance(op, ast.BitOr) and isinstance(left, dict) and isinstance(right, dict):
        return bounded(left | right)
    if type(op) not in _OPERATORS:
        raise NotUnderstoodError(f"{type(op).__name__} is not understood")
    if isinstance(left, Vector) or isinstance(right, Vector):
        return _vector_arithmetic(op, left, right)
    if isinstance(op, ast.Mod) and isinstance(left, str):
        return _percent(left, right)
    if isinstance(op, ast.Mult) and isinstance(left, int) and isinstance(right, list | str):
        left, right = right, left
    if isinstance(op, ast.Mult) and isinstance(left, list | str) and isinstance(right, int):
        if len(left) * right > MAX_ITEMS:
            raise NotUnderstoodError("a list is too long")
        return left * right
    numbers = isinstance(left, int | float) and isinstance(right, int | float)
    sums = isinstance(op, ast.Add) and type(left) is type(right) and isinstance(left, list | str)
    if not numbers and not sums:
        raise NotUnderstoodError("arithmetic is understood with numbers only")
    if isinstance(op, ast.Pow) and not (
        isinstance(left, int) and isinstance(right, int) and abs(left) < 10**6 and 0 <= right <= _EXACT
    ):
        # As floats: 9 ** 9 ** 9 in whole numbers would never end.
        left, right = checked(float, left), checked(float, right)
    return checked(_OPERATORS[type(op)], left, right)


def _percent(text: str, values: Any) -> str:
    items = tuple(values) if isinstance(values, list) else (values,)
    if sum(len(each) for each in items if isinstance(each, str)) > MAX_ITEMS:
        raise NotUnderstoodError("a list is too long")
    if "%" in _PERCENT.sub("", text) or not all(map(is_plain, items)):
        raise NotUnderstoodError("a format is not understood")
    result: str = checked(operator.mod, text, items)
    return result


def _vector_arithmetic(op: ast.operator, left: Any, right: Any) -> Vector:
    match op, left, right:
        case ast.Add() | ast.Sub(), [_, _], [_, _]:
            pairs = zip(left, right, strict=True)
        case ast.Mult() | ast.Div(), Vector(), int() | float():
            pairs = zip(left, [right] * 2, strict=True)
        case ast.Mult(), int() | float(), Vector():
            pairs = zip([left] * 2, right, strict=True)
        case _:
            raise NotUnderstoodError("this arithmetic with a vector is not understood")
    return Vector(arithmetic(op, a, b) for a, b in pairs)
