"""Names of a foreign file while it is read: scopes, modules, classes, and what a statement may change."""

import ast
from collections.abc import Mapping
from typing import Any

from msgspec import Struct, field

from simmer_tui.config.importer.python_builtins import MODULE_CONSTANTS
from simmer_tui.config.importer.python_values import (
    Class,
    Located,
    NamedValues,
    Reference,
    Unreadable,
    readable,
)
from simmer_tui.errors import NotUnderstoodError, RaisedError

MAX_STEPS = 100_000
"""Most expressions evaluated in one file, counting each turn of a loop: a short file can require any amount
of work."""
# Parts of a statement after which the next statement of a body is not executed, or later.
_JUMPS = (ast.Break, ast.Continue, ast.Return, ast.Raise, ast.Yield, ast.YieldFrom)


class Budget(Struct):
    """Steps that were taken, of all readers that share it."""

    steps: int = 0

    def charge(self, steps: int = 1) -> None:
        """Count steps. Raises NotUnderstoodError above `MAX_STEPS`."""
        self.steps += steps
        if self.steps > MAX_STEPS:
            raise NotUnderstoodError("the file takes too long to work out")


class Source(Struct):
    """The values a file assigns at its top level.

    `used` has the names in expressions and the variables of loops. `skipped` has (line, reason) of the
    statements that were not understood, each once.
    """

    names: NamedValues = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    skipped: dict[tuple[int, str], None] = field(default_factory=dict)


class Scopes:
    """Names by scope, from the innermost one; values of modules that the file imports, and known classes."""

    def __init__(
        self,
        file: str,
        modules: Mapping[str, NamedValues],
        budget: Budget,
        classes: Mapping[str, Class] | None = None,
    ) -> None:
        self.source = Source()
        self._file = file
        self._known_modules = modules
        self._classes = classes or {}
        self._scopes: tuple[NamedValues, ...] = (self.source.names,)
        self._globals: set[str] = set()
        self._budget = budget
        self._imports_all = False
        self._tries = 0  # `try` statements around a statement
        self._bodies = 0  # loops and functions around it
        self._depth = 0

    def _scope_of(self, name: str) -> NamedValues:
        """The scope that has a name; the innermost, if none has it."""
        if name in self._globals:
            return self._scopes[-1]
        return next((scope for scope in self._scopes if name in scope), self._scopes[0])

    def _bind(self, name: str, value: Any, line: int) -> None:
        scope = self._scopes[-1] if name in self._globals else self._scopes[0]
        scope[name] = Located(value, line)

    def _unreadable(self, error: NotUnderstoodError) -> Unreadable:
        if self._tries and isinstance(error, RaisedError):
            raise error
        return Unreadable(str(error))

    def _of_module(self, dotted: str) -> Any:
        if dotted in MODULE_CONSTANTS:
            return MODULE_CONSTANTS[dotted]
        module, _, name = dotted.rpartition(".")
        if name in self._known_modules.get(module, ()):
            return readable(self._known_modules[module][name].value)
        return Reference(dotted)

    def _dotted(self, node: ast.expr) -> str:
        """The full name of something outside whose first part has no value here; else empty."""
        parts: list[str] = []
        while isinstance(node, ast.Attribute):
            parts.append(node.attr)
            node = node.value
        if not isinstance(node, ast.Name) or any(node.id in scope for scope in self._scopes):
            return ""
        # Files may be read without their imports.
        return ".".join([{"np": "numpy"}.get(node.id, node.id), *reversed(parts)])

    def _class(self, name: str) -> Class | None:
        for scope in self._scopes:
            if name in scope and isinstance(scope[name].value, Class):
                cls: Class = scope[name].value
                return cls
        return self._classes.get(name)

    def _line_of(self, cls: Class | None) -> list[Class]:
        """A class and its bases that are known, in the order in which they are searched."""
        found: list[Class] = []
        waiting = [cls] if cls is not None else []
        while waiting:
            each = waiting.pop(0)
            if each in found:
                continue
            found.append(each)
            waiting += [base for name in each.bases if (base := self._class(name)) is not None]
        return found

    def _member(self, cls: Class | None, name: str) -> Located | None:
        """The value of a class's body, or of its bases."""
        return next((each.names[name] for each in self._line_of(cls) if name in each.names), None)


class Effects(Struct, frozen=True):
    """The possible effects of a statement: the names it may change (assigned ones, and those whose parts or
    methods it uses), attributes of objects by name, the functions it calls, and its jumps."""

    names: frozenset[str]
    attributes: frozenset[tuple[str, str]]
    calls: frozenset[str] = frozenset()
    jumps: bool = False

    def outside(self, node: ast.FunctionDef | ast.Lambda) -> "Effects":
        """Those of a function outside of its own names."""
        own = {each.arg for each in ast.walk(node.args) if isinstance(each, ast.arg)}
        declared = {n for each in ast.walk(node) if isinstance(each, ast.Global) for n in each.names}
        own |= {
            each.id
            for each in ast.walk(node)
            if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store) and each.id not in declared
        }
        attributes = frozenset(each for each in self.attributes if each[0] not in own)
        return Effects(self.names - own, attributes, self.calls)


def touched(node: ast.AST) -> Effects:
    """The possible effects of a statement."""
    names: set[str] = set()
    attributes: set[tuple[str, str]] = set()
    calls: set[str] = set()
    jumps = False
    for part in ast.walk(node):
        match part:
            case ast.Name(id=name, ctx=ast.Store() | ast.Del()):
                names.add(name)
            case ast.Attribute(value=ast.Name(id=name), attr=attribute, ctx=ast.Store() | ast.Del()):
                attributes.add((name, attribute))
            case (
                ast.Subscript(value=inner, ctx=ast.Store() | ast.Del())
                | ast.Call(func=ast.Attribute(value=inner))
            ):
                while isinstance(inner, ast.Subscript | ast.Attribute):
                    inner = inner.value
                if isinstance(inner, ast.Name):
                    names.add(inner.id)
            case ast.Call(func=ast.Name(id=name)):
                calls.add(name)
        jumps = jumps or isinstance(part, _JUMPS)
    return Effects(frozenset(names), frozenset(attributes), frozenset(calls), jumps)
