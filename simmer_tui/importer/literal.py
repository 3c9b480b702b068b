"""Python source read for its values, without running any of it.

Understood are literals, names assigned before, arithmetic, `[...]`, `{...}` and their
comprehensions, subscripts, `for` loops that fill a list, and a short list of functions of Python,
`math` and `numpy`. Any other call (`Ultrasonic(u0_info)`) becomes a `Call` record. What is not
understood becomes an `Unreadable` with its line; so does every name that such a statement may have
changed.
"""

from __future__ import annotations

import ast
import math
import operator
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from simmer_tui.errors import ConfigurationError, NotUnderstoodError, Problem
from simmer_tui.importer.python_values import (
    MAX_ITEMS,
    Call,
    Located,
    Unreadable,
    Vector,
    arithmetic,
    as_key,
    as_text,
    checked,
    evenly_spaced,
    item_of,
    numbers_only,
    readable,
    vector,
)
from simmer_tui.sim.command import escape

MAX_STEPS = 100_000
"""Most expressions evaluated in one file, each turn of a comprehension counted."""
MAX_DEPTH = 60
"""Deepest nesting of expressions."""

_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    **{name: getattr(math, name) for name in ("cos", "sin", "tan", "acos", "asin", "atan", "atan2", "sqrt")},
    **{name: getattr(math, name) for name in ("radians", "degrees", "hypot", "floor", "ceil")},
    "deg2rad": math.radians,
    "rad2deg": math.degrees,
    "arctan2": math.atan2,
}
"""Functions of `math` and `numpy`, of numbers only."""
_BUILTINS: Mapping[str, Callable[..., Any]] = {
    item.__name__: item for item in (abs, round, min, max, sum, float, int, bool, range)
}
"""Functions of Python, of numbers and lists of numbers only."""
_LISTS = ("list", "tuple", "array", "asarray")
_CONSTANTS = {"pi": math.pi, "tau": math.tau, "e": math.e, "inf": math.inf}
_UNARY: Mapping[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
}


_JUMPS = (ast.Break, ast.Continue)
"""What makes a loop more than all its statements, turn after turn."""


@dataclass(slots=True)
class Source:
    """The values a file assigns at its top level.

    `used` holds the names that some expression refers to or some loop counts with, `skipped` the
    (line, reason) of statements that were not understood, each once.
    """

    names: dict[str, Located] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    skipped: dict[tuple[int, str], None] = field(default_factory=dict)


def read_source(text: str, file: str) -> Source:
    """Read Python source. Raises ConfigurationError if it is no Python at all."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a backslash in a text of theirs, say
            module = ast.parse(text)
    except SyntaxError as error:
        place = f"{file}:{error.lineno}" if error.lineno else file
        raise ConfigurationError([Problem(place, f"is not Python here: {escape(error.msg)}")]) from error
    except (ValueError, RecursionError, MemoryError) as error:
        # What the parser raises for null bytes and for brackets nested by the thousand.
        raise ConfigurationError([Problem(file, f"is not Python that can be read: {error}")]) from error
    reader = _Reader()
    for statement in module.body:
        reader.read(statement)
    return reader.source


def read_expression(text: str) -> Any:
    """The value of one expression without names, or an `Unreadable`."""
    try:
        return _Reader().evaluate(ast.parse(text.strip(), mode="eval").body)
    except (NotUnderstoodError, SyntaxError, ValueError, RecursionError, MemoryError) as error:
        return Unreadable(str(error))


class _Reader:
    def __init__(self) -> None:
        self.source = Source()
        self._modules: dict[str, str] = {}
        self._steps = 0
        self._depth = 0

    def read(self, statement: ast.stmt) -> None:
        """Take in one statement of the top level."""
        self.source.used |= {
            node.id
            for node in ast.walk(statement)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
        }
        self._follow(statement)

    def _follow(self, statement: ast.stmt) -> None:
        match statement:
            case ast.Import(names=names):
                for name in names:
                    self._modules[name.asname or name.name.split(".")[0]] = (
                        name.name if name.asname else name.name.split(".")[0]
                    )
            case ast.ImportFrom(module=module, names=names):
                for name in names:
                    self._modules[name.asname or name.name] = f"{module or ''}.{name.name}"
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                return
            case ast.Assign(targets=targets, value=value):
                for target in targets:
                    self._assign(target, self._try(value), statement.lineno)
            case ast.AnnAssign(target=target, value=ast.expr() as value):
                self._assign(target, self._try(value), statement.lineno)
            case ast.AugAssign(target=ast.Name(id=name) as target, op=op, value=value):
                old = ast.copy_location(ast.Name(name, ast.Load()), target)
                sum_ = ast.copy_location(ast.BinOp(old, op, value), statement)
                self._assign(target, self._try(sum_), statement.lineno)
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                self.source.names.pop(name, None)
            case ast.For(orelse=[]) if not any(isinstance(n, _JUMPS) for n in ast.walk(statement)):
                self._loop(statement)
            case ast.Expr(
                value=ast.Call(
                    func=ast.Attribute(value=ast.Name(id=name), attr=way), args=[item], keywords=[]
                )
            ) if way in ("append", "extend") and isinstance(self._table(name), list):
                self._add(statement, self._table(name), way, item)
            case _:
                self._skip(statement)

    def _loop(self, statement: ast.For) -> None:
        """Follow a loop turn by turn. Where that goes wrong, nothing that it changes is trusted."""
        self.source.used |= _touched(statement.target)
        try:
            for value in self._values(statement.iter):
                self._assign(statement.target, value, statement.lineno)
                for inner in statement.body:
                    self._count_step()
                    self._follow(inner)
        except NotUnderstoodError:
            self._skip(statement)

    def _add(self, statement: ast.stmt, to: list[Any], way: str, item: ast.expr) -> None:
        """`list.append` and `list.extend`; the list is changed where it stands, whatever its names."""
        try:
            value = self.evaluate(item)
            more = [value] if way == "append" else list(value) if isinstance(value, list | range) else None
            if more is None or len(to) + len(more) > MAX_ITEMS:
                raise NotUnderstoodError("what is added is no list, or too long")
            to.extend(more)
        except NotUnderstoodError:
            self._skip(statement)

    def _skip(self, statement: ast.stmt) -> None:
        word = "a call" if isinstance(statement, ast.Expr) else type(statement).__name__.lower()
        why = f"{word} on line {statement.lineno} is not followed"
        self.source.skipped[statement.lineno, f"{word} is not followed"] = None
        for name in _touched(statement):
            self.source.names[name] = Located(Unreadable(why), statement.lineno)

    def _try(self, node: ast.expr) -> Any:
        try:
            return self.evaluate(node)
        except NotUnderstoodError as error:
            return Unreadable(str(error))

    def _assign(self, target: ast.expr, value: Any, line: int) -> None:
        match target:
            case ast.Name(id=name):
                self.source.names[name] = Located(value, line)
            case ast.Tuple(elts=elements) | ast.List(elts=elements):
                whole = isinstance(value, list | tuple) and len(value) == len(elements)
                parts = value if whole else [Unreadable("it is not taken apart")] * len(elements)
                for element, part in zip(elements, parts, strict=True):
                    self._assign(element, part, line)
            case ast.Subscript(value=ast.Name(id=name), slice=ast.Constant(value=key)) if isinstance(
                self._table(name), dict
            ):
                self.source.names[name].value[key] = Located(value, line)
            case _:
                self.source.skipped[line, "an assignment to part of a value is not followed"] = None
                for name in _touched(target):
                    self.source.names[name] = Located(Unreadable(f"line {line} changes it"), line)

    def _table(self, name: str) -> Any:
        return self.source.names[name].value if name in self.source.names else None

    def evaluate(self, node: ast.expr) -> Any:
        """The value of an expression. Raises NotUnderstoodError."""
        self._count_step()
        if self._depth >= MAX_DEPTH:
            raise NotUnderstoodError("it is nested too deeply")
        self._depth += 1
        try:
            value = self._value(node)
        finally:
            self._depth -= 1
        if isinstance(value, list):
            self._steps += len(value) // 100  # or lists of lists of lists would fill the memory
        return value

    def _count_step(self) -> None:
        self._steps += 1
        if self._steps > MAX_STEPS:
            raise NotUnderstoodError("the file takes too long to work out")

    def _value(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=bool() | int() | float() | str() | None as value):
                return value
            case ast.Name(id=name):
                return self._name(name)
            case ast.List(elts=elements) | ast.Tuple(elts=elements) | ast.Set(elts=elements):
                return list(self._elements(elements))
            case ast.Dict(keys=keys, values=values):
                return self._dict(keys, values)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
                value = self.evaluate(operand)
                if isinstance(op, ast.USub) and isinstance(value, Vector):
                    return arithmetic(ast.Mult(), -1, value)
                return checked(_UNARY[type(op)], value)
            case ast.BinOp(left=left, op=op, right=right):
                return arithmetic(op, self.evaluate(left), self.evaluate(right))
            case ast.Attribute():
                return self._attribute(node)
            case ast.Subscript(value=value, slice=index):
                return item_of(self.evaluate(value), self.evaluate(index))
            case ast.ListComp(elt=element, generators=generators):
                return [self.evaluate(element) for _ in self._turns(generators)]
            case ast.GeneratorExp(elt=element, generators=generators):
                return [self.evaluate(element) for _ in self._turns(generators)]
            case ast.DictComp(key=key, value=value, generators=generators):
                return {
                    as_key(self.evaluate(key)): Located(self._try(value), node.lineno)
                    for _ in self._turns(generators)
                }
            case ast.JoinedStr(values=parts):
                return "".join(self._formatted(part) for part in parts)
            case ast.Call():
                return self._call(node)
        raise NotUnderstoodError(f"{type(node).__name__} is not understood")

    def _name(self, name: str) -> Any:
        if name not in self.source.names:
            raise NotUnderstoodError(f"{escape(name, 40)} has no value that is known here")
        return readable(self.source.names[name].value)

    def _elements(self, elements: list[ast.expr]) -> Iterator[Any]:
        for element in elements:
            if isinstance(element, ast.Starred):
                values = self.evaluate(element.value)
                if not isinstance(values, list | range):
                    raise NotUnderstoodError("only a list can be unpacked")
                yield from values
            else:
                yield self.evaluate(element)

    def _dict(self, keys: list[ast.expr | None], values: list[ast.expr]) -> dict[Any, Located]:
        table: dict[Any, Located] = {}
        for key, value in zip(keys, values, strict=True):
            if key is None:
                inner = self.evaluate(value)
                if not isinstance(inner, dict):
                    raise NotUnderstoodError("only a dict can be unpacked into a dict")
                table |= inner
            else:
                # One entry that cannot be read must not lose the others.
                table[as_key(self.evaluate(key))] = Located(self._try(value), key.lineno)
        return table

    def _attribute(self, node: ast.Attribute) -> float:
        module, _, name = self._dotted(node).rpartition(".")
        if module not in ("math", "numpy") or name not in _CONSTANTS:
            raise NotUnderstoodError(f"{escape(ast.unparse(node), 40)} is not a value that is known here")
        return _CONSTANTS[name]

    def _dotted(self, node: ast.expr) -> str:
        """A callee's full name, import aliases resolved: `pm.Vector2` is `pygame.math.Vector2`."""
        match node:
            case ast.Name(id=name):
                return self._modules.get(name, {"np": "numpy"}.get(name, name))
            case ast.Attribute(value=value, attr=name):
                return f"{self._dotted(value)}.{name}"
        raise NotUnderstoodError("a call of something that has no plain name")

    def _turns(self, generators: list[ast.comprehension]) -> Iterator[None]:
        """One turn for each element of a comprehension's list, its variables set."""
        if len(generators) != 1 or generators[0].ifs:
            raise NotUnderstoodError("only a comprehension with one for and no if is understood")
        values = self._values(generators[0].iter)
        outside = dict(self.source.names)
        try:
            for value in values:
                self._assign(generators[0].target, value, generators[0].target.lineno)
                yield
        finally:
            self.source.names = outside

    def _values(self, node: ast.expr) -> list[Any]:
        """What a loop or comprehension goes through, as it stands when it begins."""
        values = self.evaluate(node)
        if not isinstance(values, list | range | dict):
            raise NotUnderstoodError("a loop needs a list, a range or a dict")
        return list(values)

    def _formatted(self, part: ast.expr) -> str:
        match part:
            case ast.Constant(value=text):
                return str(text)
            case ast.FormattedValue(value=value, conversion=-1, format_spec=None):
                return as_text(self.evaluate(value))
        raise NotUnderstoodError("a format in an f-string is not understood")

    def _parts(self, node: ast.expr, part: str) -> list[Any]:
        table = self.evaluate(node)
        if not isinstance(table, dict):
            raise NotUnderstoodError(f".{part}() is understood of a dict only")
        if part == "keys":
            return list(table)
        values = [readable(item.value) for item in table.values()]
        return values if part == "values" else [list(pair) for pair in zip(table, values, strict=True)]

    def _call(self, node: ast.Call) -> Any:
        if isinstance(node.func, ast.Attribute) and node.func.attr in ("items", "keys", "values"):
            return self._parts(node.func.value, node.func.attr)
        if isinstance(node.func, ast.Attribute) and node.func.attr == "rotate" and len(node.args) == 1:
            turned, angle = self.evaluate(node.func.value), self.evaluate(node.args[0])
            if not isinstance(turned, Vector):
                raise NotUnderstoodError("only a vector is rotated")
            return checked(turned.rotated, *numbers_only((angle,)))
        dotted = self._dotted(node.func)
        module, _, name = dotted.rpartition(".")
        arguments = tuple(self._elements(node.args))
        if name == "Vector2":
            return vector(arguments)
        if module in ("math", "numpy") and name in _FUNCTIONS:
            return checked(_FUNCTIONS[name], *numbers_only(arguments))
        if not module and name in _BUILTINS:
            return checked(_BUILTINS[name], *numbers_only(arguments))
        if module in ("", "numpy") and name in _LISTS:
            return checked(list, *arguments)
        if dotted in ("enumerate", "zip") and all(isinstance(item, list | range) for item in arguments):
            rows = checked(enumerate if dotted == "enumerate" else zip, *arguments)
            return [list(row) for row in rows]
        if dotted == "len":
            return checked(len, *arguments)
        if dotted == "str" and len(arguments) == 1:
            return as_text(arguments[0])
        if any(keyword.arg is None for keyword in node.keywords):
            raise NotUnderstoodError("** in a call is not understood")
        keywords = {
            str(item.arg): Located(self._try(item.value), item.value.lineno) for item in node.keywords
        }
        if module == "numpy" and name in ("linspace", "arange"):
            return evenly_spaced(name, arguments, keywords)
        if dotted == "dict" and not arguments:
            return keywords
        return Call(name, arguments, keywords, node.lineno)


def _touched(node: ast.AST) -> set[str]:
    """The names a statement may change: assigned ones, and those whose parts or methods it uses."""
    names: set[str] = set()
    for part in ast.walk(node):
        match part:
            case ast.Name(id=name, ctx=ast.Store() | ast.Del()):
                names.add(name)
            case ast.Subscript(value=ast.Name(id=name), ctx=ast.Store() | ast.Del()):
                names.add(name)
            case ast.Call(func=ast.Attribute(value=ast.Name(id=name))):
                names.add(name)
    return names
