"""Values of Python expressions, and calls of functions and classes of a foreign file, without running it.

`literal.py` has the statements.
"""

import ast
import operator
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

from msgspec import Struct, field

from simmer_tui.config.device_outline import python_tree
from simmer_tui.config.importer.python_calls import (
    CALLS,
    MODULE_CONSTANTS,
    OF_SCREEN,
    called,
    items_of,
    method_called,
    table,
    unique,
)
from simmer_tui.config.importer.python_values import (
    SPACED,
    Call,
    Class,
    Function,
    Instance,
    Located,
    Partial,
    Reference,
    Unreadable,
    Vector,
    arithmetic,
    as_key,
    as_text,
    bounded,
    checked,
    compared,
    evenly_spaced,
    formatted,
    is_plain,
    item_of,
    readable,
    snapshot,
    truth,
    vector,
)
from simmer_tui.errors import ConfigurationError, NotUnderstoodError, RaisedError
from simmer_tui.sim.command import escape_word

MAX_STEPS = 100_000
"""Most expressions evaluated in one file, counting each turn of a loop: a short file can require any amount
of work."""
MAX_DEPTH = 60
"""Deepest nesting of expressions, statements and calls: each level takes several frames of Python's 1,000."""
NamedValues = dict[str, Located]

_UNARY: Mapping[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
# Statements after which the next statement of a body is not executed.
_JUMPS = (ast.Break, ast.Continue, ast.Return, ast.Raise)


class LoopEnd(Exception):  # noqa: N818 - a jump, no error
    """A `break` or `continue`."""

    def __init__(self, *, again: bool) -> None:
        self.again = again


class ReturnValue(Exception):  # noqa: N818 - a jump, no error
    """The `return` of a function, with its value."""

    def __init__(self, value: Any) -> None:
        self.value = value


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


class ExpressionReader(ast.NodeVisitor):
    """Reads expressions, each type by its method. A type without one is not understood."""

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
        self._depth = 0
        self._bodies = 0  # loops and functions around a statement
        self._tries = 0
        self._imports_all = False
        self._recorded: ast.Call | None = None  # the last call that was not made
        self._owner: list[tuple[Class | None, Any]] = []
        self._effects: dict[int, tuple[ast.AST, Effects]] = {}
        self._yielded: list[list[Any]] = []

    @abstractmethod
    def _run(self, body: Sequence[ast.stmt]) -> None:
        """Follow the statements of a function."""

    @abstractmethod
    def _forget(self, effects: "Effects", why: str, line: int, seen: frozenset[int] = frozenset()) -> None:
        """Make all unreadable that a statement may have changed."""

    def generic_visit(self, node: ast.AST) -> NoReturn:
        raise NotUnderstoodError(f"{type(node).__name__} is not understood")

    def _function(self, node: ast.FunctionDef | ast.Lambda) -> Function:
        arguments = node.args
        ordinary = [*arguments.posonlyargs, *arguments.args]
        given = ordinary[len(ordinary) - len(arguments.defaults) :]
        pairs = [*zip(given, arguments.defaults, strict=True)]
        pairs += [
            (argument, default)
            for argument, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
            if default is not None
        ]
        defaults = {argument.arg: Located(self._try(each), each.lineno) for argument, each in pairs}
        return Function(node, defaults, self._scopes, self._file)

    def _last_name(self, node: ast.expr) -> str:
        match node:
            case ast.Name(id=name):
                found = self._scope_of(name).get(name)
                return found.value.name if found and isinstance(found.value, Reference) else name
            case ast.Attribute(attr=name):
                return name
        return ""

    def _effects_of(self, node: ast.AST) -> "Effects":
        # A loop may ask thousands of times.
        if id(node) not in self._effects:
            # With the node, so that no other one gets its number.
            self._effects[id(node)] = node, touched(node)
        return self._effects[id(node)][1]

    # -- names -------------------------------------------------------------------------------

    def _scope_of(self, name: str) -> NamedValues:
        """The scope that has a name; the innermost, if none has it."""
        if name in self._globals:
            return self._scopes[-1]
        return next((scope for scope in self._scopes if name in scope), self._scopes[0])

    def _bind(self, name: str, value: Any, line: int) -> None:
        scope = self._scopes[-1] if name in self._globals else self._scopes[0]
        scope[name] = Located(value, line)

    def _try(self, node: ast.expr) -> Any:
        try:
            return self.evaluate(node)
        except NotUnderstoodError as error:
            return self._unreadable(error)

    def _unreadable(self, error: NotUnderstoodError) -> Unreadable:
        if self._tries and isinstance(error, RaisedError):
            raise error
        return Unreadable(str(error))

    def _assign(self, target: ast.expr, value: Any, line: int) -> None:
        match target:
            case ast.Name(id=name):
                self._bind(name, value, line)
            case ast.Tuple(elts=elements) | ast.List(elts=elements):
                for element, part in zip(elements, _parts(value, elements), strict=True):
                    self._assign(element, part, line)
            case ast.Starred(value=inner):
                self._assign(inner, value, line)
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
        elif isinstance(of, Vector) and name in ("x", "y"):
            of["xy".index(name)] = readable(value)
        else:
            raise NotUnderstoodError("an assignment to part of a value is not followed")

    # -- expressions -------------------------------------------------------------------------

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
        if self._depth >= MAX_DEPTH:
            raise NotUnderstoodError("it is nested too deeply")
        self._depth += 1
        try:
            value = self.visit(node)
        finally:
            self._depth -= 1
        if isinstance(value, list | dict | str):
            # Otherwise lists of lists of lists would fill the memory.
            self._budget.charge(len(value) // 100)
        return value

    def visit_Constant(self, node: ast.Constant) -> Any:
        if not is_plain(node.value):
            raise NotUnderstoodError("Constant is not understood")
        return node.value

    def visit_List(self, node: ast.List | ast.Tuple) -> list[Any]:
        return list(self._elements(node.elts))

    visit_Tuple = visit_List  # noqa: N815 - as NodeVisitor calls them

    def visit_Set(self, node: ast.Set) -> list[Any]:
        return unique(self._elements(node.elts))

    def visit_UnaryOp(self, node: ast.UnaryOp) -> Any:
        value = self.evaluate(node.operand)
        if isinstance(node.op, ast.Not):
            return not truth(value)
        if isinstance(node.op, ast.USub) and isinstance(value, Vector):
            return arithmetic(ast.Mult(), -1, value)
        if type(node.op) not in _UNARY:
            raise NotUnderstoodError("UnaryOp is not understood")
        return checked(_UNARY[type(node.op)], value)

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

    def visit_Yield(self, node: ast.Yield) -> None:
        """Collect what a generator yields: its caller gets a list."""
        if not self._yielded:
            self.generic_visit(node)
        self._yielded[-1].append(None if node.value is None else self.evaluate(node.value))

    def visit_YieldFrom(self, node: ast.YieldFrom) -> None:
        """Collect all that a generator yields of another."""
        if not self._yielded:
            self.generic_visit(node)
        method_called(self._yielded[-1], "extend", (self.evaluate(node.value),), {})

    def visit_Lambda(self, node: ast.Lambda) -> Function:
        return self._function(node)

    def visit_Slice(self, node: ast.Slice) -> slice:
        parts = [
            None if each is None else self.evaluate(each) for each in (node.lower, node.upper, node.step)
        ]
        if not all(each is None or isinstance(each, int) for each in parts):
            raise NotUnderstoodError("a slice is understood of whole numbers only")
        return slice(*parts)

    def visit_Subscript(self, node: ast.Subscript) -> Any:
        container, index = self.evaluate(node.value), self.evaluate(node.slice)
        if isinstance(container, DefaultDict) and as_key(index) not in container:
            container[as_key(index)] = Located(container.empty(), node.lineno)
        return item_of(container, index)

    def visit_ListComp(self, node: ast.ListComp | ast.GeneratorExp) -> list[Any]:
        return [self.evaluate(node.elt) for _ in self._turns(node.generators)]

    visit_GeneratorExp = visit_ListComp  # noqa: N815

    def visit_SetComp(self, node: ast.SetComp) -> list[Any]:
        return unique([self.evaluate(node.elt) for _ in self._turns(node.generators)])

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
        if node.id in CALLS or node.id in _SPECIAL:
            return Reference(node.id)
        what = f"{escape_word(node.id)} has no value that is known here"
        # Any name may come from `import *`.
        raise NotUnderstoodError(what) if self._imports_all else RaisedError("NameError", what)

    def _of_module(self, dotted: str) -> Any:
        if dotted in MODULE_CONSTANTS:
            return MODULE_CONSTANTS[dotted]
        module, _, name = dotted.rpartition(".")
        if name in self._known_modules.get(module, ()):
            return readable(self._known_modules[module][name].value)
        return Reference(dotted)

    def _elements(self, elements: list[ast.expr]) -> Iterator[Any]:
        for element in elements:
            if isinstance(element, ast.Starred):
                values = self.evaluate(element.value)
                if not isinstance(values, list | dict | tuple):
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
                raise NotUnderstoodError(f"{escape_word(dotted)} is not a value that is known here")
            return value
        of = self.evaluate(node.value)
        if isinstance(of, Reference):
            # A real module is not looked into.
            return self._of_module(f"{of.dotted}.{node.attr}")
        return self._attribute(of, node.attr)

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

    def _attribute(self, of: Any, name: str) -> Any:
        if isinstance(of, Vector) and name in ("x", "y"):
            return of["xy".index(name)]
        if isinstance(of, Instance) and name == "__dict__":
            return of.names
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
            raise RaisedError("AttributeError", f".{escape_word(name)} is not a value that is known here")
        of_property = isinstance(found.value, Function) and isinstance(found.value.node, ast.FunctionDef)
        if of_property and "property" in decorators_of(found.value.node):
            return self._invoke(found.value, (of,), {})
        return readable(found.value)

    def _member(self, cls: Class | None, name: str) -> Located | None:
        """The value of a class's body, or of its bases."""
        return next((each.names[name] for each in self._line_of(cls) if name in each.names), None)

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

    def _class(self, name: str) -> Class | None:
        for scope in self._scopes:
            if name in scope and isinstance(scope[name].value, Class):
                cls: Class = scope[name].value
                return cls
        return self._classes.get(name)

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

    # -- calls -------------------------------------------------------------------------------

    def _callee(self, node: ast.expr) -> Any:
        """The value of an expression; a name without a value is a `Reference`."""
        dotted = self._dotted(node)
        return self._of_module(dotted) if dotted else self.evaluate(node)

    def visit_Call(self, node: ast.Call) -> Any:
        func = node.func
        if isinstance(func, ast.Attribute):
            if isinstance(func.value, ast.Call) and _is_super(func.value):
                return self._super_call(func.attr, node)
            of = self._callee(func.value)
            if not isinstance(of, Reference):
                return self._method(of, func, node)
            callee = self._of_module(f"{of.dotted}.{func.attr}")
        else:
            callee = self._callee(func)
        return self._called(callee, *self._arguments(node), node)

    def _arguments(self, node: ast.Call) -> tuple[tuple[Any, ...], dict[str, Located]]:
        keywords: dict[str, Located] = {}
        for each in node.keywords:
            if each.arg is not None:
                keywords[each.arg] = Located(self._try(each.value), each.value.lineno)
                continue
            more = self.evaluate(each.value)
            if not isinstance(more, dict) or not all(isinstance(key, str) for key in more):
                raise NotUnderstoodError("only a dict can be unpacked into arguments")
            keywords |= more
        return tuple(self._elements(node.args)), keywords

    def _called(
        self, callee: Any, arguments: tuple[Any, ...], keywords: dict[str, Located], node: ast.Call
    ) -> Any:
        if isinstance(callee, Function):
            return self._invoke(callee, arguments, keywords)
        if isinstance(callee, Class):
            call = self._record(callee.name, arguments, keywords, node)
            # A class with a base outside of the file is a device.
            plain = ("object", "Enum", "NamedTuple")
            known = all(self._class(name) is not None or name in plain for name in callee.bases)
            return self.instance(callee, call) if known else call
        if isinstance(callee, Partial):
            return self._called(
                callee.of, (*callee.arguments, *arguments), {**callee.keywords, **keywords}, node
            )
        if not isinstance(callee, Reference):
            raise NotUnderstoodError("a call of something that has no plain name")
        dotted, name = callee.dotted, callee.name
        if name == "Vector2":
            return vector(arguments)
        if dotted in SPACED:
            return evenly_spaced(dotted, arguments, keywords)
        if dotted in OF_SCREEN:
            return None
        if name == "__init__" and arguments and isinstance(arguments[0], Instance):
            self._describe(arguments[0], arguments[1:], keywords)
            return None
        if dotted in _SPECIAL:
            return _SPECIAL[dotted](self, arguments, keywords, node)
        if dotted in CALLS:
            return called(dotted, arguments, _plain(keywords))
        return self._record(name, arguments, keywords, node)

    def _record(
        self, name: str, arguments: tuple[Any, ...], keywords: Mapping[str, Located], node: ast.Call
    ) -> Call:
        self._recorded = node
        # As it was then: the file may use the same dict for the next device.
        charge = self._budget.charge
        kept: tuple[Any, ...] = tuple(snapshot(each, charge) for each in arguments)
        return Call(name, kept, snapshot(dict(keywords), charge), node.lineno)

    def _call_dict(self, arguments: tuple[Any, ...], keywords: dict[str, Located], node: ast.Call) -> Any:
        return _located(table(*arguments[:1], **keywords), node.lineno)

    def _call_deepcopy(self, arguments: tuple[Any, ...], _: dict[str, Located], __: ast.Call) -> Any:
        return snapshot(*_one(arguments), self._budget.charge)

    def _call_copy(self, arguments: tuple[Any, ...], _: dict[str, Located], __: ast.Call) -> Any:
        (value,) = _one(arguments)
        return type(value)(value) if isinstance(value, list | dict) else value

    def _call_namespace(self, _: tuple[Any, ...], keywords: dict[str, Located], __: ast.Call) -> Any:
        return Instance(dict(keywords))

    def _call_map(self, arguments: tuple[Any, ...], _: dict[str, Located], node: ast.Call) -> Any:
        function, *lists = arguments if arguments else (None,)
        rows = zip(*map(items_of, lists), strict=False)
        return [self._called(function, row, {}, node) for row in rows]

    def _call_filter(self, arguments: tuple[Any, ...], _: dict[str, Located], node: ast.Call) -> Any:
        function, values = arguments if len(arguments) == 2 else (None, [])
        return [
            each
            for each in items_of(values)
            if truth(each if function is None else self._called(function, (each,), {}, node))
        ]

    def _call_sorted(self, arguments: tuple[Any, ...], keywords: dict[str, Located], node: ast.Call) -> Any:
        given = _plain(keywords)
        values = items_of(*_one(arguments))
        by = given.get("key")
        keys = [each if by is None else self._called(by, (each,), {}, node) for each in values]
        numbers = all(isinstance(key, int | float) for key in keys)
        if not numbers and not all(isinstance(key, str) for key in keys):
            raise NotUnderstoodError("only numbers or texts are sorted")
        order = sorted(range(len(values)), key=keys.__getitem__, reverse=truth(given.get("reverse")))
        return [values[index] for index in order]

    def _call_namedtuple(self, arguments: tuple[Any, ...], _: dict[str, Located], __: ast.Call) -> Any:
        name, names = arguments if len(arguments) == 2 else ("", None)
        fields = names.replace(",", " ").split() if isinstance(names, str) else items_of(names)
        return Class(as_text(name), {}, (), tuple(map(as_text, fields)))

    def _call_defaultdict(self, arguments: tuple[Any, ...], _: dict[str, Located], __: ast.Call) -> Any:
        made = table(*arguments[1:2])
        factory = arguments[0] if arguments else None
        if isinstance(factory, Reference) and factory.dotted in _EMPTY:
            return DefaultDict(made, _EMPTY[factory.dotted])
        raise NotUnderstoodError("a defaultdict is understood of a list, a dict or a number only")

    def _call_asdict(self, arguments: tuple[Any, ...], _: dict[str, Located], __: ast.Call) -> Any:
        (value,) = _one(arguments)
        if not isinstance(value, Instance):
            raise NotUnderstoodError("only an object has a dict of its attributes")
        return snapshot(value.names, self._budget.charge)

    def _call_globals(self, _: tuple[Any, ...], __: dict[str, Located], ___: ast.Call) -> Any:
        return self._scopes[-1]

    def _call_locals(self, arguments: tuple[Any, ...], _: dict[str, Located], node: ast.Call) -> Any:
        return self._call_asdict(arguments, _, node) if arguments else self._scopes[0]

    def _call_eval(self, arguments: tuple[Any, ...], _: dict[str, Located], __: ast.Call) -> Any:
        """The value of a text: worked out as the rest of the file, and never executed either."""
        statements = self._text(*_one(arguments[:1])).body
        if len(statements) != 1 or not isinstance(statements[0], ast.Expr):
            raise NotUnderstoodError("a text is no expression")
        return self.evaluate(statements[0].value)

    def _call_exec(self, arguments: tuple[Any, ...], _: dict[str, Located], __: ast.Call) -> None:
        for statement in self._text(*_one(arguments[:1])).body:
            # Raises what it does not understand: the text may change any name.
            self._budget.charge()
            self.visit(statement)

    def _text(self, text: Any) -> ast.Module:
        self._budget.charge(len(text) // 10 if isinstance(text, str) else 0)
        try:
            tree = python_tree(as_text(text).strip(), "")
        except ConfigurationError:
            raise NotUnderstoodError("a text is not Python") from None
        self.source.used |= {each.id for each in ast.walk(tree) if isinstance(each, ast.Name)}
        return tree

    def _call_partial(self, arguments: tuple[Any, ...], keywords: dict[str, Located], node: ast.Call) -> Any:
        if not arguments:
            raise NotUnderstoodError("partial is not understood with these arguments")
        return Partial(arguments[0], arguments[1:], keywords)

    def _call_getattr(self, arguments: tuple[Any, ...], _: dict[str, Located], __: ast.Call) -> Any:
        if len(arguments) not in (2, 3) or not isinstance(arguments[1], str):
            raise NotUnderstoodError("getattr is not understood with these arguments")
        try:
            return self._attribute(arguments[0], arguments[1])
        except RaisedError:
            if len(arguments) == 2:
                raise
            return arguments[2]

    def _call_setattr(self, arguments: tuple[Any, ...], _: dict[str, Located], node: ast.Call) -> Any:
        if len(arguments) != 3 or not isinstance(arguments[1], str):
            raise NotUnderstoodError("setattr is not understood with these arguments")
        self._assign_attribute(*arguments, line=node.lineno)

    def _method(self, of: Any, func: ast.Attribute, node: ast.Call) -> Any:
        if isinstance(of, Instance) and func.attr == "_asdict":
            return snapshot(of.names, self._budget.charge)
        if isinstance(of, Instance | Class):
            found = self._member(of.owner if isinstance(of, Instance) else of, func.attr)
            if isinstance(of, Instance) and func.attr in of.names:
                return self._called(readable(of.names[func.attr].value), *self._arguments(node), node)
            if found is None or not isinstance(found.value, Function):
                raise NotUnderstoodError(f".{func.attr}() is not understood")
            function = found.value
            arguments, keywords = self._arguments(node)
            marks = decorators_of(function.node) if isinstance(function.node, ast.FunctionDef) else set()
            if "classmethod" in marks:
                cls = of.owner if isinstance(of, Instance) else of
                arguments = (cls, *arguments)
            elif isinstance(of, Instance) and "staticmethod" not in marks:
                arguments = (of, *arguments)
            return self._invoke(function, arguments, keywords)
        arguments, keywords = self._arguments(node)
        given = _plain(keywords) if isinstance(of, str) or func.attr not in ("update",) else keywords
        if isinstance(of, list) and func.attr == "sort":
            of[:] = self._call_sorted((list(of),), keywords, node)
            return None
        if isinstance(of, list | dict | str):
            result = method_called(of, func.attr, arguments, given)
            if isinstance(of, dict) and func.attr in ("setdefault", "update"):
                _located(of, node.lineno)
            return result
        raise NotUnderstoodError(f".{func.attr}() is not understood")

    def _super_call(self, name: str, node: ast.Call) -> Any:
        """A method of the bases of the class whose method runs; without a known one, nothing happens."""
        cls, of = self._owner[-1] if self._owner else (None, None)
        if cls is None or not isinstance(of, Instance):
            raise NotUnderstoodError("super() is not understood here")
        given, keywords = self._arguments(node)
        if name == "__init__":
            self._describe(of, given, keywords)
        line = self._line_of(of.owner)
        behind = line[line.index(cls) + 1 :] if cls in line else []
        found = next((each.names[name].value for each in behind if name in each.names), None)
        if not isinstance(found, Function):
            return None
        return self._invoke(found, (of, *given), keywords)

    def _describe(self, of: Instance, given: tuple[Any, ...], keywords: Mapping[str, Located]) -> None:
        """Keep the description that an object passes on to a base."""
        first = given[0] if given else keywords["info"].value if "info" in keywords else None
        if isinstance(first, dict):
            of.descriptions.append(snapshot(first, self._budget.charge))

    def instance(self, cls: Class, call: Call, *, strict: bool = True) -> Instance:
        """The object that a class makes of a call's arguments. Unless `strict`, `__init__` may be one that is
        understood only in part. Raises NotUnderstoodError."""
        made = Instance({}, cls, call)
        found = self._member(cls, "__init__")
        if found is None and cls.fields:
            self._fill(made, cls, call)
            found = self._member(cls, "__post_init__")
            call = Call(call.name, (), {}, call.line)
        if found is not None and isinstance(found.value, Function):
            try:
                # The description belongs to the caller, as far as the class may change it.
                arguments = tuple(snapshot(each, self._budget.charge) for each in call.arguments)
                self._invoke(found.value, (made, *arguments), dict(call.keywords))
            except NotUnderstoodError:
                if strict:
                    raise
        return made

    def _fill(self, made: Instance, cls: Class, call: Call) -> None:
        """Set the fields of a dataclass or named tuple."""
        given = dict(zip(cls.fields, (Located(each, call.line) for each in call.arguments), strict=False))
        given |= call.keywords
        for name in cls.fields:
            located = given.get(name) or cls.names.get(name)
            if located is None:
                raise NotUnderstoodError("a function gets too few arguments")
            default = located.value
            if isinstance(default, Call) and default.name == "field":
                factory = default.keywords.get("default_factory")
                located = default.keywords.get("default", Located(None, located.line))
                if factory is not None:
                    node = ast.Call(ast.Name("field", ast.Load()), [], [], lineno=call.line)
                    located = Located(self._called(factory.value, (), {}, node), call.line)
            made.names[name] = located

    def _invoke(self, function: Function, arguments: tuple[Any, ...], keywords: Mapping[str, Located]) -> Any:
        node = function.node
        scope = _bound(function, arguments, keywords)
        outside = self._scopes, self._globals, self._file, self._bodies, self._tries
        self._scopes, self._globals, self._file = (scope, *function.scopes), set(), function.file
        self._bodies += 1
        first = arguments[0] if arguments else None
        self._owner.append((function.owner, first))
        try:
            if isinstance(node, ast.Lambda):
                return self.evaluate(node.body)
            if not self._effects_of(node).is_generator:
                self._run(node.body)
                return None
            yielded: list[Any] = []
            self._yielded.append(yielded)
            try:
                self._run(node.body)
            finally:
                self._yielded.pop()
            return yielded
        except ReturnValue as result:
            return result.value
        except LoopEnd:
            raise NotUnderstoodError("a jump out of a loop is outside of one") from None
        except NotUnderstoodError:
            why, effects = "a function that changes it is not followed", self._effects_of(node)
            self._forget(Effects(frozenset(), effects.attributes), why, node.lineno)
            self._scopes = function.scopes
            self._forget(effects.outside(node), why, node.lineno)
            raise
        finally:
            self._owner.pop()
            self._scopes, self._globals, self._file, self._bodies, self._tries = outside


# The functions that have a method of the reader, by full name. The reader is defined above.
_SPECIAL: Mapping[str, Callable[..., Any]] = {
    "dict": ExpressionReader._call_dict,
    "copy.deepcopy": ExpressionReader._call_deepcopy,
    "copy.copy": ExpressionReader._call_copy,
    "types.SimpleNamespace": ExpressionReader._call_namespace,
    "map": ExpressionReader._call_map,
    "filter": ExpressionReader._call_filter,
    "sorted": ExpressionReader._call_sorted,
    "getattr": ExpressionReader._call_getattr,
    "collections.defaultdict": ExpressionReader._call_defaultdict,
    "collections.namedtuple": ExpressionReader._call_namedtuple,
    "functools.partial": ExpressionReader._call_partial,
    "dataclasses.asdict": ExpressionReader._call_asdict,
    "globals": ExpressionReader._call_globals,
    "locals": ExpressionReader._call_locals,
    "vars": ExpressionReader._call_locals,
    "eval": ExpressionReader._call_eval,
    "exec": ExpressionReader._call_exec,
    "setattr": ExpressionReader._call_setattr,
}


def _bound(function: Function, arguments: tuple[Any, ...], keywords: Mapping[str, Located]) -> NamedValues:
    """The arguments of a call by name. Raises NotUnderstoodError."""
    node, scope, left = function.node.args, dict(function.defaults), dict(keywords)
    names = [each.arg for each in (*node.posonlyargs, *node.args)]
    line = function.node.lineno
    scope |= {name: Located(value, line) for name, value in zip(names, arguments, strict=False)}
    more = list(arguments[len(names) :])
    if node.vararg is not None:
        scope[node.vararg.arg] = Located(more, line)
    elif more:
        raise NotUnderstoodError("a function gets too many arguments")
    for name in (*names, *(each.arg for each in node.kwonlyargs)):
        if name in left:
            scope[name] = left.pop(name)
        elif name not in scope:
            raise NotUnderstoodError("a function gets too few arguments")
    if node.kwarg is not None:
        scope[node.kwarg.arg] = Located(left, line)
    elif left:
        raise NotUnderstoodError("a function gets an argument that it does not have")
    return scope


def _plain(keywords: Mapping[str, Located]) -> dict[str, Any]:
    return {name: readable(each.value) for name, each in keywords.items()}


def _one(arguments: tuple[Any, ...]) -> tuple[Any]:
    if len(arguments) != 1:
        raise NotUnderstoodError("a function is understood with one argument only")
    return arguments


def _located(made: dict[Any, Located], line: int) -> dict[Any, Located]:
    """The dict itself, whose new values have a line now."""
    for key, each in made.items():
        if not each.line:
            made[key] = Located(each.value, line)
    return made


_EMPTY: Mapping[str, Callable[[], Any]] = {"dict": dict, "list": list, "int": int, "float": float}


class DefaultDict(dict[Any, Located]):
    """A dict whose missing items are made when they are asked for."""

    def __init__(self, items: Mapping[Any, Located], empty: Callable[[], Any]) -> None:
        super().__init__(items)
        self.empty = empty


def _parts(value: Any, elements: Sequence[ast.expr]) -> list[Any]:
    """The values of the elements of a target; unreadable ones if it cannot be taken apart."""
    if isinstance(value, Instance) and value.items is not None:
        value = value.items
    whole: list[Any] = list(value) if isinstance(value, list | tuple | dict | str) else []
    stars = [index for index, each in enumerate(elements) if isinstance(each, ast.Starred)]
    if stars and len(whole) >= len(elements) - 1:
        begin, behind = stars[0], len(elements) - stars[0] - 1
        end = len(whole) - behind
        return [*whole[:begin], whole[begin:end], *whole[end:]]
    if stars or len(whole) != len(elements):
        return [Unreadable("it is not taken apart")] * len(elements)
    return whole


def decorators_of(node: ast.FunctionDef | ast.ClassDef) -> set[str]:
    """The last names of its decorators."""
    found: set[str] = set()
    for each in node.decorator_list:
        inner = each.func if isinstance(each, ast.Call) else each
        found.add(inner.id if isinstance(inner, ast.Name) else getattr(inner, "attr", ""))
    return found


def _is_super(node: ast.Call) -> bool:
    return isinstance(node.func, ast.Name) and node.func.id == "super"


class Effects(Struct, frozen=True):
    """The possible effects of a statement: the names it may change (assigned ones, and those whose parts or
    methods it uses), attributes of objects by name, the functions it calls, and its jumps."""

    names: frozenset[str]
    attributes: frozenset[tuple[str, str]]
    calls: frozenset[str] = frozenset()
    jumps: bool = False
    is_generator: bool = False

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
    jumps = is_generator = False
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
            case ast.Yield() | ast.YieldFrom():
                is_generator = True
        jumps = jumps or isinstance(part, _JUMPS)
    return Effects(frozenset(names), frozenset(attributes), frozenset(calls), jumps, is_generator)
