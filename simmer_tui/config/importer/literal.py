"""Values of Python source, worked out without running it.

Understood are literals, arithmetic, comparisons, comprehensions, f-strings, loops, branches, `try`, functions
and classes of the file, changes of lists and dicts, and a list of functions of Python, `math` and `numpy`.
Any other call (`Ultrasonic(u0_info)`) becomes a `Call` record. Other expressions become an `Unreadable` with
their line; so does every name that such a statement may have changed. Nothing is imported, and no attribute
of a real object is looked up. Steps, sizes and depth are bounded.
"""

import ast
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NoReturn

from msgspec.structs import replace

from simmer_tui.config.device_outline import python_tree
from simmer_tui.config.importer.python_builtins import NAMES_OF_MATH, method_called
from simmer_tui.config.importer.python_calls import CallReader, LoopEnd, ReturnValue
from simmer_tui.config.importer.python_names import Budget, Effects, Source, touched
from simmer_tui.config.importer.python_values import (
    Call,
    Class,
    Function,
    Instance,
    Located,
    NamedValues,
    Reference,
    Unreadable,
    Vector,
    arithmetic,
    items_of,
    truth,
)
from simmer_tui.errors import NotUnderstoodError, RaisedError
from simmer_tui.sim.command import WORD, cut

MAX_TURNS = 1000
"""Most turns of a `while` loop. One that never ends must not take the steps of the rest of the file."""


def read_source(text: str, file: str) -> Source:
    """Read Python source. Raises ConfigurationError if it is not Python."""
    return read_module(python_tree(text, file), file)


def read_module(
    module: ast.Module,
    file: str = "",
    modules: Mapping[str, NamedValues] | None = None,
    budget: Budget | None = None,
) -> Source:
    """Read the tree of Python source. `modules` has the names of modules that it may import."""
    # Statement by statement, never executed: the file may come from anywhere.
    reader = _Reader(file, modules or {}, budget or Budget())
    for statement in module.body:
        reader.read(statement)
    return reader.source


def read_expression(text: str) -> Any:
    """The value of one expression without names, or an `Unreadable`."""
    try:
        return _Reader("", {}, Budget()).evaluate(ast.parse(text.strip(), mode="eval").body)
    except (NotUnderstoodError, SyntaxError, ValueError, RecursionError, MemoryError) as error:
        return Unreadable(str(error))


def instance_of(
    cls: Class,
    call: Call,
    classes: Mapping[str, Class],
    modules: Mapping[str, NamedValues],
    budget: Budget,
) -> Instance:
    """The object that a class makes of the arguments of a call, as far as its `__init__` is understood.

    `classes` has the classes by name among which its bases are.
    """
    reader = _Reader("", modules, budget, classes)
    try:
        return reader.instance(cls, call, strict=False)
    except NotUnderstoodError:
        return Instance({}, cls, call)


class _Reader(CallReader, ast.NodeVisitor):
    """Reads statements and expressions, each type by its method. A type without one is not understood, and a
    statement that is not understood is skipped."""

    def read(self, statement: ast.stmt) -> None:
        """Read one statement of the top level."""
        self.source.used |= {
            node.id
            for node in ast.walk(statement)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
        }
        self._follow(statement)

    def _follow(self, statement: ast.stmt) -> None:
        try:
            with self._deeper():
                self.visit(statement)
        except NotUnderstoodError as error:
            # A jump that may have been taken leaves all that follows unknown.
            unknown = self._bodies and self._effects_of(statement).jumps
            if unknown or (self._tries and isinstance(error, RaisedError)):
                raise
            self._skip(statement, str(error))
        except (LoopEnd, ReturnValue):
            if self._bodies:
                raise
            self._skip(statement, "it is outside of a loop or a function")

    def _run(self, body: Sequence[ast.stmt]) -> None:
        for statement in body:
            self._budget.charge()
            self._follow(statement)

    def visit_Import(self, statement: ast.Import) -> None:
        for name in statement.names:
            package = name.name.split(".")[0]
            dotted = name.name if name.asname else package
            self._bind(name.asname or package, Reference(dotted), statement.lineno)

    def visit_ImportFrom(self, statement: ast.ImportFrom) -> None:
        for name in statement.names:
            if name.name == "*" and statement.module == "math":
                for each in NAMES_OF_MATH:
                    self._bind(each, Reference(f"math.{each}"), statement.lineno)
                continue
            if name.name == "*":
                self._imports_all = True
                self._scopes[0].update(self._known_modules.get(statement.module or "", {}))
                continue
            value = self._of_module(f"{statement.module or ''}.{name.name}")
            self._bind(name.asname or name.name, value, statement.lineno)

    def visit_Assign(self, statement: ast.Assign) -> None:
        value = self._try(statement.value)
        for target in statement.targets:
            self._assign(target, value, statement.lineno)

    def visit_AnnAssign(self, statement: ast.AnnAssign) -> None:
        if statement.value is not None:
            self._assign(statement.target, self._try(statement.value), statement.lineno)

    def visit_AugAssign(self, statement: ast.AugAssign) -> None:
        target = statement.target
        try:
            old = self.evaluate(target)
            more = self.evaluate(statement.value)
            if isinstance(old, list) and not isinstance(old, Vector) and isinstance(statement.op, ast.Add):
                # The list object itself changes, for all its names.
                method_called(old, "extend", (more,), {})
                return
            if isinstance(old, dict) and isinstance(statement.op, ast.BitOr):
                method_called(old, "update", (more,), {})
                return
            value = arithmetic(statement.op, old, more)
        except NotUnderstoodError as error:
            value = self._unreadable(error)
        self._assign(target, value, statement.lineno)

    def visit_Delete(self, statement: ast.Delete) -> None:
        for target in statement.targets:
            match target:
                case ast.Name(id=name):
                    self._scope_of(name).pop(name, None)
                case ast.Subscript(value=value, slice=index):
                    container = self.evaluate(value)
                    if not isinstance(container, dict | list):
                        self.generic_visit(statement)
                    method_called(container, "pop", (self.evaluate(index),), {})
                case _:
                    self.generic_visit(statement)

    def visit_Pass(self, _: ast.Pass) -> None:
        """Nothing to do."""

    def visit_Global(self, statement: ast.Global) -> None:
        self._globals |= set(statement.names)

    def visit_Assert(self, _: ast.Assert) -> None:
        """It changes nothing."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self._define(node, self._function(node))

    def _define(self, node: ast.FunctionDef | ast.ClassDef, value: Any) -> None:
        # A decorator may make anything of it.
        why = f"{cut(node.name, WORD)} has a decorator"
        self._bind(node.name, Unreadable(why) if node.decorator_list else value, node.lineno)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        names: NamedValues = {}
        outside, self._scopes = self._scopes, (names, *self._scopes)
        try:
            self._run(node.body)
        finally:
            self._scopes = outside
        bases = tuple(name for base in node.bases if (name := self._last_name(base)))
        cls = Class(node, names, bases, self._file)
        for name, located in names.items():
            if isinstance(located.value, Function):
                # Its functions do not see the names of its body.
                own = replace(located.value, scopes=outside, owner=cls)
                names[name] = Located(own, located.line)
        self._define(node, cls)

    def _last_name(self, node: ast.expr) -> str:
        match node:
            case ast.Name(id=name):
                found = self._scope_of(name).get(name)
                return found.value.name if found and isinstance(found.value, Reference) else name
            case ast.Attribute(attr=name):
                return name
        return ""

    def visit_Return(self, statement: ast.Return) -> None:
        raise ReturnValue(None if statement.value is None else self.evaluate(statement.value))

    def visit_Raise(self, _: ast.Raise) -> NoReturn:
        raise RaisedError("an exception is raised")

    def visit_Break(self, _: ast.Break) -> None:
        raise LoopEnd(again=False)

    def visit_Continue(self, _: ast.Continue) -> None:
        raise LoopEnd(again=True)

    def visit_Expr(self, statement: ast.Expr) -> None:
        match statement.value:
            case ast.Constant():
                return
            case ast.Call():
                self.evaluate(statement.value)
                if self._recorded is statement.value:
                    # A call that was not made may have done anything.
                    raise NotUnderstoodError("its effect is unknown")
            case _:
                self.evaluate(statement.value)

    def visit_If(self, statement: ast.If) -> None:
        # A thousand `elif` are nested in the tree, but not in the text.
        branch: Sequence[ast.stmt] = [statement]
        while len(branch) == 1 and isinstance(branch[0], ast.If):
            self._budget.charge()
            node = branch[0]
            branch = node.body if truth(self.evaluate(node.test)) else node.orelse
            if branch is node.body:
                break
        self._run(branch)

    def visit_For(self, statement: ast.For) -> None:
        """Execute a loop turn by turn. If that fails, all names that it changes become unreadable."""
        if len(self._scopes) == 1:
            self.source.used |= touched(statement.target).names
        values = items_of(self.evaluate(statement.iter))

        def turns() -> Iterator[None]:
            for value in values:
                self._assign(statement.target, value, statement.lineno)
                yield

        self._loop(turns(), statement)

    def visit_While(self, statement: ast.While) -> None:
        """Execute a loop, as long as its condition is known."""

        def turns() -> Iterator[None]:
            for _ in range(MAX_TURNS):
                if not truth(self.evaluate(statement.test)):
                    return
                yield
            raise NotUnderstoodError("a loop does not end")

        self._loop(turns(), statement)

    def _loop(self, turns: Iterator[None], statement: ast.For | ast.While) -> None:
        self._bodies += 1
        try:
            for _ in turns:
                self._budget.charge()
                try:
                    self._run(statement.body)
                except LoopEnd as end:
                    if not end.again:
                        return
        finally:
            self._bodies -= 1
        self._run(statement.orelse)

    def visit_Try(self, statement: ast.Try) -> None:
        self._tries += 1
        try:
            self._run(statement.body)
            error = None
        except RaisedError as raised:
            error = raised
        finally:
            self._tries -= 1
        if error is None:
            self._run(statement.orelse)
        elif len(statement.handlers) == 1:
            # In a file that works, it takes what is raised.
            self._run(statement.handlers[0].body)
        else:
            raise error
        self._run(statement.finalbody)

    def _skip(self, statement: ast.stmt, reason: str) -> None:
        word = "a call" if isinstance(statement, ast.Expr) else type(statement).__name__.lower()
        why = f"{word} on line {statement.lineno} is not followed"
        self.source.skipped[statement.lineno, f"{word} is not followed: {reason}"] = None
        self._forget(self._effects_of(statement), why, statement.lineno)

    def _forget(self, effects: Effects, why: str, line: int, seen: frozenset[int] = frozenset()) -> None:
        """Old values of names that a statement may have changed must not be used."""
        for name, attribute in effects.attributes:
            found = self._scope_of(name).get(name)
            if found is not None and isinstance(found.value, Instance):
                found.value.names[attribute] = Located(Unreadable(why), line)
        for name in effects.names:
            scope = self._scope_of(name)
            if name not in scope or not isinstance(scope[name].value, Instance):
                scope[name] = Located(Unreadable(why), line)
        for name in effects.calls:
            found = self._scope_of(name).get(name)
            if found is not None and isinstance(found.value, Function) and id(found.value.node) not in seen:
                node = found.value.node
                inner = self._effects_of(node).outside(node)
                self._forget(inner, why, line, seen | {id(node)})
