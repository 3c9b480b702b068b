"""Values of Python expressions of a foreign file, and assignments to their parts, without running it.

Calls are in `python_calls.py`, statements in `literal.py`.
"""

import ast
from abc import abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

from simmer_tui.config.importer.python_builtins import CALLS
from simmer_tui.config.importer.python_names import Scopes
from simmer_tui.config.importer.python_values import (
    Call,
    Class,
    Function,
    Instance,
    Located,
    Reference,
    Unreadable,
    Vector,
    arithmetic,
    as_key,
    as_text,
    bounded,
    checked,
    compared,
    formatted,
    is_plain,
    item_of,
    items_of,
    readable,
    truth,
)
from simmer_tui.errors import NotUnderstoodError, RaisedError
from simmer_tui.sim.command import WORD, cut

MAX_DEPTH = 60
"""Deepest nesting of expressions, statements and calls: each level takes several frames of Python's 1,000."""
SPECIAL = ("dict", "map")
"""Functions of Python without a module that have a meaning here, beside `CALLS`."""


class ExpressionReader(Scopes, ast.NodeVisitor):
    """Reads expressions, each type by its method. A type without one is not understood."""

    @abstractmethod
    def visit_Lambda(self, node: ast.Lambda) -> Function:
        """A function of one expression."""

    @abstractmethod
    def visit_Call(self, node: ast.Call) -> Any:
        """The result of a call, or its record."""

    def generic_visit(self, node: ast.AST) -> NoReturn:
        raise NotUnderstoodError(f"{type(node).__name__} is not understood")

    @contextmanager
    def _deeper(self) -> Iterator[None]:
        # Before Python's own limit, whose error could occur anywhere.
        if self._depth >= MAX_DEPTH:
            raise NotUnderstoodError("it is nested too deeply")
        self._depth += 1
        try:
            yield
        finally:
            self._depth -= 1

    def evaluate(self, node: ast.expr) -> Any:
        """The value of an expression. Raises NotUnderstoodError."""
        self._budget.charge()
        with self._deeper():
            value = self.visit(node)
        if isinstance(value, list | dict | str):
            # Otherwise lists of lists of lists would fill the memory.
            self._budget.charge(len(value) // 100)
        return value

    def _try(self, node: ast.expr) -> Any:
        try:
            return self.evaluate(node)
        except NotUnderstoodError as error:
            return self._unreadable(error)

    # -- assignments -------------------------------------------------------------------------

    def _assign(self, target: ast.expr, value: Any, line: int) -> None:
        match target:
            case ast.Name(id=name):
                self._bind(name, value, line)
            case ast.Tuple(elts=elements) | ast.List(elts=elements):
                parts = items_of(value) if isinstance(value, list | dict | str) else []
                if len(parts) != len(elements):
                    parts = [Unreadable("it is not taken apart")] * len(elements)
                for element, part in zip(elements, parts, strict=True):
                    self._assign(element, part, line)
            case ast.Subscript(value=node, slice=index):
                self._assign_item(self.evaluate(node), self.evaluate(index), value, line)
            case ast.Attribute(value=node, attr=name):
                self._assign_attribute(self.evaluate(node), name, value, line)
            case _:
                self.generic_visit(target)

    def _assign_item(self, container: Any, index: Any, value: Any, line: int) -> None:
        if isinstance(container, dict):
            container[as_key(index)] = Located(value, line)
            bounded(container)
        elif isinstance(container, list) and isinstance(index, slice) and isinstance(value, list):
            bounded([*container, *value])
            checked(container.__setitem__, index, value)
        elif isinstance(container, list) and isinstance(index, int):
            item_of(container, index)
            container[index] = readable(value)
        else:
            raise NotUnderstoodError("an assignment to part of a value is not followed")

    def _assign_attribute(self, of: Any, name: str, value: Any, line: int) -> None:
        if isinstance(of, Instance):
            of.places[name] = f"{self._file}:{line}"
            of.names[name] = Located(value, line)
        elif isinstance(of, Class):
            of.names[name] = Located(value, line)
        elif isinstance(of, Call):
            of.changes[name] = Located(value, line)
        else:
            raise NotUnderstoodError("an assignment to part of a value is not followed")

    # -- expressions -------------------------------------------------------------------------

    def visit_Constant(self, node: ast.Constant) -> Any:
        if not is_plain(node.value):
            raise NotUnderstoodError("Constant is not understood")
        return node.value

    def visit_List(self, node: ast.List | ast.Tuple) -> list[Any]:
        return list(self._elements(node.elts))

    visit_Tuple = visit_List  # noqa: N815 - as NodeVisitor calls them

    def visit_UnaryOp(self, node: ast.UnaryOp) -> Any:
        value = self.evaluate(node.operand)
        if isinstance(node.op, ast.Not):
            return not truth(value)
        if not isinstance(node.op, ast.USub | ast.UAdd) or not isinstance(value, int | float | Vector):
            raise NotUnderstoodError("UnaryOp is not understood")
        return arithmetic(ast.Mult(), -1 if isinstance(node.op, ast.USub) else 1, value)

    def visit_BinOp(self, node: ast.BinOp) -> Any:
        return arithmetic(node.op, self.evaluate(node.left), self.evaluate(node.right))

    def visit_BoolOp(self, node: ast.BoolOp) -> Any:
        value: Any = None
        for each in node.values:
            value = self.evaluate(each)
            if truth(value) is isinstance(node.op, ast.Or):
                break
        return value

    def visit_Compare(self, node: ast.Compare) -> bool:
        left = self.evaluate(node.left)
        for op, each in zip(node.ops, node.comparators, strict=True):
            right = self.evaluate(each)
            if not compared(op, left, right):
                return False
            left = right
        return True

    def visit_IfExp(self, node: ast.IfExp) -> Any:
        return self.evaluate(node.body if truth(self.evaluate(node.test)) else node.orelse)

    def visit_NamedExpr(self, node: ast.NamedExpr) -> Any:
        value = self.evaluate(node.value)
        self._assign(node.target, value, node.lineno)
        return value

    def visit_Slice(self, node: ast.Slice) -> slice:
        parts = [
            None if each is None else self.evaluate(each) for each in (node.lower, node.upper, node.step)
        ]
        if not all(each is None or isinstance(each, int) for each in parts):
            raise NotUnderstoodError("a slice is understood of whole numbers only")
        return slice(*parts)

    def visit_Subscript(self, node: ast.Subscript) -> Any:
        return item_of(self.evaluate(node.value), self.evaluate(node.slice))

    def visit_ListComp(self, node: ast.ListComp | ast.GeneratorExp) -> list[Any]:
        return [self.evaluate(node.elt) for _ in self._turns(node.generators)]

    visit_GeneratorExp = visit_ListComp  # noqa: N815

    def visit_DictComp(self, node: ast.DictComp) -> dict[Any, Located]:
        return {
            as_key(self.evaluate(node.key)): Located(self._try(node.value), node.lineno)
            for _ in self._turns(node.generators)
        }

    def visit_JoinedStr(self, node: ast.JoinedStr) -> str:
        text: str = bounded("".join(self._formatted(part) for part in node.values))
        return text

    def visit_Name(self, node: ast.Name) -> Any:
        for scope in self._scopes:
            if node.id in scope:
                value = readable(scope[node.id].value)
                return self._of_module(value.dotted) if isinstance(value, Reference) else value
        if node.id == "__name__":
            return "config"  # never the program that is started
        if node.id in CALLS or node.id in SPECIAL:
            return Reference(node.id)
        what = f"{cut(node.id, WORD)} has no value that is known here"
        # Any name may come from `import *`.
        raise NotUnderstoodError(what) if self._imports_all else RaisedError(what)

    def _elements(self, elements: list[ast.expr]) -> Iterator[Any]:
        for element in elements:
            if isinstance(element, ast.Starred):
                values = self.evaluate(element.value)
                if not isinstance(values, list | dict):
                    raise NotUnderstoodError("only a list can be unpacked")
                yield from values
            else:
                yield self.evaluate(element)

    def visit_Dict(self, node: ast.Dict) -> dict[Any, Located]:
        made: dict[Any, Located] = {}
        for key, value in zip(node.keys, node.values, strict=True):
            if key is None:
                inner = self.evaluate(value)
                if not isinstance(inner, dict):
                    raise NotUnderstoodError("only a dict can be unpacked into a dict")
                made |= inner
            else:
                # One entry that cannot be read must not lose the others.
                made[as_key(self.evaluate(key))] = Located(self._try(value), key.lineno)
        return made

    def visit_Attribute(self, node: ast.Attribute) -> Any:
        dotted = self._dotted(node)
        if dotted:
            value = self._of_module(dotted)
            if isinstance(value, Reference):
                raise NotUnderstoodError(f"{cut(dotted, WORD)} is not a value that is known here")
            return value
        of = self.evaluate(node.value)
        if isinstance(of, Reference):
            # A real module is not looked into.
            return self._of_module(f"{of.dotted}.{node.attr}")
        return self._attribute(of, node.attr)

    def _attribute(self, of: Any, name: str) -> Any:
        if isinstance(of, Vector) and name in ("x", "y"):
            return of["xy".index(name)]
        found: Located | None = None
        if isinstance(of, Instance):
            found = of.names.get(name) or self._member(of.owner, name)
        elif isinstance(of, Class):
            found = self._member(of, name)
        elif isinstance(of, Call):
            # The attributes of a device are named as its description is.
            inner = of.arguments[0] if of.arguments and isinstance(of.arguments[0], dict) else of.keywords
            found = of.changes.get(name) or inner.get(name)
        if found is None:
            raise RaisedError(f".{cut(name, WORD)} is not a value that is known here")
        return readable(found.value)

    def _turns(self, generators: list[ast.comprehension]) -> Iterator[None]:
        """One turn for each element of a comprehension's lists, its variables set."""
        # Evaluated before the new scope begins, because it is outside the comprehension.
        first = items_of(self.evaluate(generators[0].iter))
        outside = self._scopes
        try:
            self._scopes = ({}, *outside)
            yield from self._nested(generators, first)
        finally:
            self._scopes = outside

    def _nested(self, generators: list[ast.comprehension], values: list[Any]) -> Iterator[None]:
        generator, *inner = generators
        for value in values:
            self._budget.charge()
            self._assign(generator.target, value, generator.target.lineno)
            if not all(truth(self.evaluate(each)) for each in generator.ifs):
                continue
            if inner:
                yield from self._nested(inner, items_of(self.evaluate(inner[0].iter)))
            else:
                yield

    def _formatted(self, part: ast.expr) -> str:
        match part:
            case ast.Constant(value=text):
                return str(text)
            case ast.FormattedValue(value=value, conversion=-1 | 115, format_spec=form):
                found = self.evaluate(value)
                return as_text(found) if form is None else formatted(found, as_text(self.evaluate(form)))
        raise NotUnderstoodError("a format in an f-string is not understood")
