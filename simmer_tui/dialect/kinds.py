"""Kinds of expressions, from their text: mistakes that can be found without a message."""

import ast
from collections.abc import Iterator, Mapping
from enum import StrEnum

from msgspec import Struct

from simmer_tui.dialect.expressions import CONSTANTS, Expression, FieldValue, RealNumber
from simmer_tui.dialect.templates import Field
from simmer_tui.sim.command import counted


class ValueKind(StrEnum):
    """Kind of a value."""

    NUMBER = "a number"
    TEXT = "a text"
    LIST = "a list"
    ANY = "of any kind"


class StaticType(Struct, frozen=True):
    """The static type of a name: its kind, all its values if they are few, and for a sensor that reads a
    list its length."""

    kind: ValueKind = ValueKind.ANY
    values: tuple[FieldValue, ...] = ()
    length: int | None = None


NUMBER_TYPE, TEXT_TYPE, LIST_TYPE, ANY_TYPE = (StaticType(each) for each in ValueKind)
_KINDS: Mapping[type, ValueKind] = {str: ValueKind.TEXT, tuple: ValueKind.LIST}
"""Kinds of values by type; all others are numbers."""
_RESULTS = {"scan": ValueKind.LIST, "named": ValueKind.TEXT, "pick": ValueKind.ANY}
"""Kinds of functions; all others give numbers."""
_TAKES = {"len": "lists and texts", "named": "codes: a {name:list}, or a text"}
"""Functions that take no numbers, and what they take; all others but `pick` take numbers alone."""
_ONE_VALUE = "calculate with one value of it, as in scan(0, 30, 12)[2]*cm"


def kind_of(value: FieldValue) -> ValueKind:
    """The kind of a value."""
    return _KINDS.get(type(value), ValueKind.NUMBER)


def field_mistakes(field: Field, names: Mapping[str, StaticType]) -> Iterator[str]:
    """The mistakes in the kinds of a reply's field."""
    reader = _Reader(names)
    if reader.kind(field.expression.tree) is ValueKind.LIST and field.joint is None and not reader.mistakes:
        reader.mistakes.append("is a list; write {...|,} to join it, or take one value of it: [0]")
    yield from (f"'{field.expression.source}': {each}" for each in reader.mistakes)


def kind(expression: Expression, names: Mapping[str, StaticType]) -> ValueKind:
    """The kind of an expression's value."""
    return _Reader(names).kind(expression.tree)


def mistakes(expression: Expression, names: Mapping[str, StaticType]) -> Iterator[str]:
    """The mistakes in the kinds of an expression."""
    reader = _Reader(names)
    reader.kind(expression.tree)
    yield from (f"'{expression.source}': {each}" for each in reader.mistakes)


class _Reader:
    """Walks through an expression, and notes operations that its values do not allow."""

    def __init__(self, names: Mapping[str, StaticType]) -> None:
        self._names = names
        self.mistakes: list[str] = []

    def kind(self, node: ast.expr) -> ValueKind:
        """The kind of a part."""
        match node:
            case ast.Constant(value=str()):
                return ValueKind.TEXT
            case ast.Name(id=name):
                return ValueKind.NUMBER if name in CONSTANTS else self._names.get(name, ANY_TYPE).kind
            case ast.BinOp(left=left, op=made, right=right):
                return self._combined(left, made, right)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                self.kind(operand)
            case ast.UnaryOp(operand=operand):
                self._number(operand)
            case ast.BoolOp(values=parts):
                return self._common(parts)
            case ast.Compare(left=left, ops=compared, comparators=others):
                self._compared([left, *others], compared)
            case ast.IfExp(test=test, body=body, orelse=other):
                self.kind(test)
                return self._common([body, other])
            case ast.Call(func=ast.Name(id=name), args=arguments):
                return self._called(name, arguments)
            case ast.Subscript(value=sequence, slice=index):
                return self._item(sequence, index)
        return ValueKind.NUMBER

    def _number(self, node: ast.expr) -> None:
        found = self.kind(node)
        if found is ValueKind.LIST:
            self.mistakes.append(f"a list is no number; {_ONE_VALUE}")
        elif found is ValueKind.TEXT:
            self.mistakes.append(f"{ast.unparse(node)} is a text, and no number")

    def _common(self, parts: list[ast.expr]) -> ValueKind:
        found = {self.kind(each) for each in parts}
        return found.pop() if len(found) == 1 else ValueKind.ANY

    def _combined(self, left: ast.expr, made: ast.operator, right: ast.expr) -> ValueKind:
        if isinstance(made, ast.Add):
            both = {self.kind(left), self.kind(right)}
            if both <= {ValueKind.TEXT, ValueKind.ANY}:
                return ValueKind.TEXT if ValueKind.TEXT in both else ValueKind.ANY
        kinds = [self.kind(left), self.kind(right)]
        if kinds.count(ValueKind.LIST) == 1:
            # Value by value: every distance of a lidar in mm.
            self._number(right if kinds[0] is ValueKind.LIST else left)
            return ValueKind.LIST
        self._number(left)
        self._number(right)
        return ValueKind.NUMBER

    def _compared(self, parts: list[ast.expr], compared: list[ast.cmpop]) -> None:
        any_kind = all(isinstance(each, ast.Eq | ast.NotEq) for each in compared)
        for part in parts:
            self.kind(part) if any_kind else self._number(part)

    def _called(self, name: str, arguments: list[ast.expr]) -> ValueKind:
        if name == "pick":
            self._picked(arguments)
            return self._common(arguments[1:])
        for each in arguments:
            if name not in _TAKES:
                self._number(each)
            elif self.kind(each) is ValueKind.NUMBER:
                self.mistakes.append(f"{name}() is for {_TAKES[name]}")
        return _RESULTS.get(name, ValueKind.NUMBER)

    def _picked(self, arguments: list[ast.expr]) -> None:
        index, *values = arguments
        self._number(index)
        for each in self._numbers(index):
            if not 0 <= each < len(values):
                length = counted(len(values), "value")
                self.mistakes.append(f"pick({each:g}, ...) has {length}, counted from 0")

    def _numbers(self, node: ast.expr) -> tuple[RealNumber, ...]:
        """The possible numbers of a part, if they are certain (of a remainder the greatest); else empty."""
        match node:
            case ast.Constant(value=int() | float() as number):
                return (number,)
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as number)):
                return (-number,)
            case ast.Name(id=name):
                values = self._names.get(name, ANY_TYPE).values
                return tuple(each for each in values if isinstance(each, int | float))
            case ast.BinOp(op=ast.Mod(), right=ast.Constant(value=int() as number)) if number > 0:
                return (number - 1,)
        return ()

    def _item(self, sequence: ast.expr, index: ast.expr) -> ValueKind:
        self._number(index)
        found = self.kind(sequence)
        if found is ValueKind.NUMBER:
            self.mistakes.append(f"{ast.unparse(sequence)} is a number, and no list")
        of_scan = isinstance(sequence, ast.Call) and ast.unparse(sequence.func) == "scan"
        length = self._length(sequence)
        for each in self._numbers(index):
            if length is not None and not 0 <= each < length:
                self.mistakes.append(
                    f"the list has {counted(length, 'value')}, counted from 0; there is none at {each:g}"
                )
        # A list from the set is a sensor's, with numbers; one from a message may have texts.
        if of_scan or length is not None:
            return ValueKind.NUMBER
        return ValueKind.TEXT if found is ValueKind.TEXT else ValueKind.ANY

    def _length(self, sequence: ast.expr) -> int | None:
        """The length of a sensor's list, or of a scan; None if it is not certain."""
        match sequence:
            case ast.Name(id=name):
                return self._names.get(name, ANY_TYPE).length
            case ast.Call(func=ast.Name(id="scan"), args=[_, _, count]):
                counts = self._numbers(count)
                return int(counts[0]) if counts else None
            case ast.BinOp(left=left, right=right):  # value by value
                return self._length(left) or self._length(right)
        return None
