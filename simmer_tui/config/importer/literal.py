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

from simmer_tui.config.device_outline import python_tree
from simmer_tui.config.importer.python_calls import (
    NAMES_OF_MATH,
    items_of,
    method_called,
)
from simmer_tui.config.importer.python_expressions import (
    Budget,
    Effects,
    ExpressionReader,
    LoopEnd,
    NamedValues,
    ReturnValue,
    Source,
    decorators_of,
    touched,
)
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
    compared,
    truth,
)
from simmer_tui.errors import NotUnderstoodError, RaisedError
from simmer_tui.sim.command import escape_word

MAX_TURNS = 1000
"""Most turns of a `while` loop. One that never ends must not take the steps of the rest of the file."""

# The exceptions that a handler of this name takes too.
_HANDLED = {
    "LookupError": ("KeyError", "IndexError"),
    "ArithmeticError": ("ZeroDivisionError", "OverflowError"),
}
# Decorators that change nothing for a call by its class.
_DECORATORS = ("staticmethod", "classmethod", "property", "lru_cache", "cache")


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


# Bases and decorators of classes whose annotated names are the arguments of a call.
_WITH_FIELDS = ("dataclass", "NamedTuple")


class _Reader(ExpressionReader, ast.NodeVisitor):
    """Reads statements and expressions, each type by its method. A type without one is not understood, and a
    statement that is not understood is skipped."""

    # -- statements --------------------------------------------------------------------------

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
            self._skip(statement)
        except (LoopEnd, ReturnValue):
            if not self._bodies:
                self._skip(statement)
            else:
                raise

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
            old = self.evaluate(ast.copy_location(_loaded(target), target))
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
        if decorators_of(node) <= set(_DECORATORS):
            self._bind(node.name, self._function(node), node.lineno)
        else:
            why = f"{escape_word(node.name)} has a decorator"
            self._bind(node.name, Unreadable(why), node.lineno)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        names: NamedValues = {}
        outside, self._scopes = self._scopes, (names, *self._scopes)
        try:
            self._run(node.body)
        finally:
            self._scopes = outside
        bases = tuple(name for base in node.bases if (name := self._last_name(base)))
        fields: list[str] = []
        if not decorators_of(node).union(bases).isdisjoint(_WITH_FIELDS):
            fields = [
                each.target.id
                for each in node.body
                if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
            ]
        members: tuple[Instance, ...] | None = None
        if "Enum" in bases:
            for name, located in names.items():
                parts = {"value": located, "name": Located(name, located.line)}
                names[name] = Located(Instance(parts), located.line)
            members = tuple(each.value for each in names.values())
        cls = Class(node.name, names, bases, tuple(fields), members)
        for name, located in names.items():
            if isinstance(located.value, Function):
                # Its functions do not see the names of its body.
                each = located.value
                own = Function(each.node, each.defaults, outside, each.file, cls)
                names[name] = Located(own, located.line)
        self._bind(node.name, cls, node.lineno)

    def visit_Return(self, statement: ast.Return) -> None:
        raise ReturnValue(None if statement.value is None else self.evaluate(statement.value))

    def visit_Raise(self, statement: ast.Raise) -> NoReturn:
        error = statement.exc.func if isinstance(statement.exc, ast.Call) else statement.exc
        raise RaisedError(error.id if isinstance(error, ast.Name) else "Exception", "an exception is raised")

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
                    self.generic_visit(statement)
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

    def visit_Match(self, statement: ast.Match) -> None:
        """Execute the first case that fits; patterns are values, names and their alternatives."""
        value = self.evaluate(statement.subject)
        for case in statement.cases:
            if self._fits(case.pattern, value) and (case.guard is None or truth(self.evaluate(case.guard))):
                self._run(case.body)
                return

    def _fits(self, pattern: ast.pattern, value: Any) -> bool:
        match pattern:
            case ast.MatchValue(value=node):
                return compared(ast.Eq(), value, self.evaluate(node))
            case ast.MatchSingleton(value=single):
                return compared(ast.Is(), value, single)
            case ast.MatchOr(patterns=patterns):
                return any(self._fits(each, value) for each in patterns)
            case ast.MatchAs(pattern=inner, name=name):
                fits = inner is None or self._fits(inner, value)
                if fits and name is not None:
                    self._bind(name, value, pattern.lineno)
                return fits
        raise NotUnderstoodError("a pattern is not understood")

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
        except RaisedError as error:
            self._tries -= 1
            try:
                handler = next((each for each in statement.handlers if _takes(each, error.kind)), None)
                if handler is None:
                    raise
                self._run(handler.body)
            finally:
                self._tries += 1
        else:
            self._run(statement.orelse)
        finally:
            self._tries -= 1
        self._run(statement.finalbody)

    def _skip(self, statement: ast.stmt) -> None:
        word = "a call" if isinstance(statement, ast.Expr) else type(statement).__name__.lower()
        why = f"{word} on line {statement.lineno} is not followed"
        self.source.skipped[statement.lineno, f"{word} is not followed"] = None
        self._forget(self._effects_of(statement), why, statement.lineno)

    def _forget(self, effects: "Effects", why: str, line: int, seen: frozenset[int] = frozenset()) -> None:
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


def _takes(handler: ast.ExceptHandler, kind: str) -> bool:
    """True if a handler takes an exception, by its name."""
    if handler.type is None:
        return True
    names = {node.id for node in ast.walk(handler.type) if isinstance(node, ast.Name)}
    return any(
        name in ("Exception", "BaseException", kind) or kind in _HANDLED.get(name, ()) for name in names
    )


def _loaded(target: ast.expr) -> ast.expr:
    """The expression of a target's old value."""
    match target:
        case ast.Name(id=name):
            return ast.Name(name, ast.Load())
        case ast.Subscript(value=value, slice=index):
            return ast.Subscript(value, index, ast.Load())
        case ast.Attribute(value=value, attr=name):
            return ast.Attribute(value, name, ast.Load())
    raise NotUnderstoodError("an assignment to part of a value is not followed")
