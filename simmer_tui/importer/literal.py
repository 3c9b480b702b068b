"""Values of Python source, read without running it.

Understood are literals, names assigned before, arithmetic, `[...]`, `{...}` and their comprehensions,
subscripts, and `for` loops that fill a list. So is a short list of functions of Python, `math` and `numpy`.
Any other call (`Ultrasonic(u0_info)`) becomes a `Call` record. Other expressions become an `Unreadable` with
their line; so does every name that such a statement may have changed.
"""

import ast
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, NoReturn

from msgspec import Struct, field

from simmer_tui.config.device_outline import python_tree
from simmer_tui.errors import NotUnderstoodError
from simmer_tui.importer.python_values import (
    MAX_ITEMS,
    SPACED,
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
from simmer_tui.sim.command import escape_word

MAX_STEPS = 100_000
"""Most expressions evaluated in one file, counting each turn of a comprehension: a short file can require any
amount of work."""
MAX_DEPTH = 60
"""Deepest nesting of expressions: each level takes several frames of Python's 1,000."""

# Functions of `math` and `numpy`, of numbers only.
_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    **{name: getattr(math, name) for name in ("cos", "sin", "tan", "acos", "asin", "atan", "atan2", "sqrt")},
    **{name: getattr(math, name) for name in ("radians", "degrees", "hypot", "floor", "ceil")},
    "deg2rad": math.radians,
    "rad2deg": math.degrees,
    "arctan2": math.atan2,
}
# Functions of Python, of numbers and lists of numbers only.
_BUILTINS: Mapping[str, Callable[..., Any]] = {
    item.__name__: item for item in (abs, round, min, max, sum, float, int, bool, range)
}


def _numeric(function: Callable[..., Any], *arguments: Any) -> Any:
    return checked(function, *numbers_only(arguments))


def _rows(function: Callable[..., Any], *arguments: Any) -> list[list[Any]]:
    return [list(row) for row in checked(function, *arguments)]


# The functions that are called, by full name.
_CALLS: Mapping[str, Callable[..., Any]] = {
    **{f"math.{name}": partial(_numeric, function) for name, function in _FUNCTIONS.items()},
    **{f"numpy.{name}": partial(_numeric, function) for name, function in _FUNCTIONS.items()},
    **{name: partial(_numeric, function) for name, function in _BUILTINS.items()},
    **dict.fromkeys(("list", "tuple", "numpy.array", "numpy.asarray"), partial(checked, list)),
    "len": partial(checked, len),
    "enumerate": partial(_rows, enumerate),
    "zip": partial(_rows, zip),
    "str": as_text,
}
_OF_LISTS = ("enumerate", "zip")
"""Those that are called with lists only."""
_CONSTANTS = {"pi": math.pi, "tau": math.tau, "e": math.e, "inf": math.inf}
_UNARY: Mapping[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
}


# Statements with which not every turn of a loop executes all its statements.
_JUMPS = (ast.Break, ast.Continue)


class Source(Struct):
    """The values a file assigns at its top level.

    `used` has the names in expressions and the variables of loops. `skipped` has (line, reason) of the
    statements that were not understood, each once.
    """

    names: dict[str, Located] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    skipped: dict[tuple[int, str], None] = field(default_factory=dict)


def read_source(text: str, file: str) -> Source:
    """Read Python source. Raises ConfigurationError if it is not Python."""
    return read_module(python_tree(text, file))


def read_module(module: ast.Module) -> Source:
    """Read the tree of Python source."""
    # Statement by statement, never executed: the file may come from anywhere.
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


class _Reader(ast.NodeVisitor):
    """Reads statements and expressions, each type by its method. A type without one is not understood, and a
    statement that is not understood is skipped."""

    def __init__(self) -> None:
        self.source = Source()
        self._modules: dict[str, str] = {}
        self._steps = 0
        self._depth = 0

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
            self.visit(statement)
        except NotUnderstoodError:
            self._skip(statement)

    def generic_visit(self, node: ast.AST) -> NoReturn:
        raise NotUnderstoodError(f"{type(node).__name__} is not understood")

    def visit_Import(self, statement: ast.Import) -> None:
        for name in statement.names:
            package = name.name.split(".")[0]
            self._modules[name.asname or package] = name.name if name.asname else package

    def visit_ImportFrom(self, statement: ast.ImportFrom) -> None:
        for name in statement.names:
            self._modules[name.asname or name.name] = f"{statement.module or ''}.{name.name}"

    def visit_Assign(self, statement: ast.Assign) -> None:
        for target in statement.targets:
            self._assign(target, self._try(statement.value), statement.lineno)

    def visit_AnnAssign(self, statement: ast.AnnAssign) -> None:
        if statement.value is None:
            self.generic_visit(statement)
        self._assign(statement.target, self._try(statement.value), statement.lineno)

    def visit_AugAssign(self, statement: ast.AugAssign) -> None:
        target = statement.target
        if not isinstance(target, ast.Name):
            self.generic_visit(statement)
        # `x += 1` is read as `x = x + 1`, at the same place for messages.
        old = ast.copy_location(ast.Name(target.id, ast.Load()), target)
        sum_ = ast.copy_location(ast.BinOp(old, statement.op, statement.value), statement)
        self._assign(target, self._try(sum_), statement.lineno)

    def visit_Pass(self, _: ast.Pass) -> None:
        """Nothing to do."""

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.ClassDef) -> None:
        self.source.names.pop(node.name, None)

    visit_ClassDef = visit_FunctionDef  # noqa: N815 - as NodeVisitor calls them

    def visit_Expr(self, statement: ast.Expr) -> None:
        match statement.value:
            case ast.Constant():
                pass
            case ast.Call(
                func=ast.Attribute(value=ast.Name(id=name), attr="append" | "extend" as method),
                args=[item],
                keywords=[],
            ) if isinstance(self._table(name), list):
                self._add(self._table(name), method, item)
            case _:
                self.generic_visit(statement)

    def visit_For(self, statement: ast.For) -> None:
        """Execute a loop turn by turn. If that fails, all names that it changes become unreadable."""
        if statement.orelse or any(isinstance(node, _JUMPS) for node in ast.walk(statement)):
            self.generic_visit(statement)
        self.source.used |= _touched(statement.target)
        for value in self._values(statement.iter):
            self._assign(statement.target, value, statement.lineno)
            for inner in statement.body:
                self._count_step()
                self._follow(inner)

    def _add(self, to: list[Any], method: str, item: ast.expr) -> None:
        """`list.append` and `list.extend`; the list object itself changes, for all its names."""
        value = self.evaluate(item)
        more = [value] if method == "append" else list(value) if isinstance(value, list | range) else None
        if more is None or len(to) + len(more) > MAX_ITEMS:
            raise NotUnderstoodError("what is added is no list, or too long")
        to.extend(more)

    def _skip(self, statement: ast.stmt) -> None:
        word = "a call" if isinstance(statement, ast.Expr) else type(statement).__name__.lower()
        why = f"{word} on line {statement.lineno} is not followed"
        self.source.skipped[statement.lineno, f"{word} is not followed"] = None
        # Old values of names that such a statement may have changed must not be used.
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
        # Before Python's own limit, whose error could occur anywhere.
        if self._depth >= MAX_DEPTH:
            raise NotUnderstoodError("it is nested too deeply")
        self._depth += 1
        try:
            value = self.visit(node)
        finally:
            self._depth -= 1
        if isinstance(value, list):
            # Otherwise lists of lists of lists would fill the memory.
            self._steps += len(value) // 100
        return value

    def _count_step(self) -> None:
        self._steps += 1
        if self._steps > MAX_STEPS:
            raise NotUnderstoodError("the file takes too long to work out")

    def visit_Constant(self, node: ast.Constant) -> Any:
        if node.value is not None and not isinstance(node.value, bool | int | float | str):
            raise NotUnderstoodError("Constant is not understood")
        return node.value

    def visit_List(self, node: ast.List | ast.Tuple | ast.Set) -> list[Any]:
        return list(self._elements(node.elts))

    visit_Tuple = visit_Set = visit_List  # noqa: N815 - as NodeVisitor calls them

    def visit_UnaryOp(self, node: ast.UnaryOp) -> Any:
        if type(node.op) not in _UNARY:
            raise NotUnderstoodError("UnaryOp is not understood")
        value = self.evaluate(node.operand)
        if isinstance(node.op, ast.USub) and isinstance(value, Vector):
            return arithmetic(ast.Mult(), -1, value)
        return checked(_UNARY[type(node.op)], value)

    def visit_BinOp(self, node: ast.BinOp) -> Any:
        return arithmetic(node.op, self.evaluate(node.left), self.evaluate(node.right))

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
        return "".join(self._formatted(part) for part in node.values)

    def visit_Name(self, node: ast.Name) -> Any:
        if node.id not in self.source.names:
            raise NotUnderstoodError(f"{escape_word(node.id)} has no value that is known here")
        return readable(self.source.names[node.id].value)

    def _elements(self, elements: list[ast.expr]) -> Iterator[Any]:
        for element in elements:
            if isinstance(element, ast.Starred):
                values = self.evaluate(element.value)
                if not isinstance(values, list | range):
                    raise NotUnderstoodError("only a list can be unpacked")
                yield from values
            else:
                yield self.evaluate(element)

    def visit_Dict(self, node: ast.Dict) -> dict[Any, Located]:
        table: dict[Any, Located] = {}
        for key, value in zip(node.keys, node.values, strict=True):
            if key is None:
                inner = self.evaluate(value)
                if not isinstance(inner, dict):
                    raise NotUnderstoodError("only a dict can be unpacked into a dict")
                table |= inner
            else:
                # One entry that cannot be read must not lose the others.
                table[as_key(self.evaluate(key))] = Located(self._try(value), key.lineno)
        return table

    def visit_Attribute(self, node: ast.Attribute) -> float:
        module, _, name = self._dotted(node).rpartition(".")
        if module not in ("math", "numpy") or name not in _CONSTANTS:
            raise NotUnderstoodError(f"{escape_word(ast.unparse(node))} is not a value that is known here")
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
        # Evaluated before the names are saved, because it is outside the comprehension.
        values = self._values(generators[0].iter)
        outside = dict(self.source.names)
        try:
            for value in values:
                self._assign(generators[0].target, value, generators[0].target.lineno)
                yield
        finally:
            self.source.names = outside

    def _values(self, node: ast.expr) -> list[Any]:
        """The values of a loop or comprehension, copied at its beginning."""
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

    def visit_Call(self, node: ast.Call) -> Any:
        match node:
            case ast.Call(func=ast.Attribute(value=value, attr="items" | "keys" | "values" as part)):
                return self._parts(value, part)
            case ast.Call(func=ast.Attribute(value=value, attr="rotate"), args=[angle]):
                return self._rotated(value, angle)
        dotted = self._dotted(node.func)
        name = dotted.rpartition(".")[2]
        arguments = tuple(self._elements(node.args))
        if name == "Vector2":
            return vector(arguments)
        if dotted in _CALLS and _takes(dotted, arguments):
            return _CALLS[dotted](*arguments)
        if any(keyword.arg is None for keyword in node.keywords):
            raise NotUnderstoodError("** in a call is not understood")
        given = ((str(item.arg), item.value) for item in node.keywords)
        keywords = {name: Located(self._try(value), value.lineno) for name, value in given}
        if dotted in SPACED:
            return evenly_spaced(dotted, arguments, keywords)
        if dotted == "dict" and not arguments:
            return keywords
        return Call(name, arguments, keywords, node.lineno)

    def _rotated(self, vector_node: ast.expr, angle: ast.expr) -> Any:
        turned, by = self.evaluate(vector_node), self.evaluate(angle)
        if not isinstance(turned, Vector):
            raise NotUnderstoodError("only a vector is rotated")
        return checked(turned.rotated, *numbers_only((by,)))


def _takes(dotted: str, arguments: tuple[Any, ...]) -> bool:
    """True if one of `_CALLS` is understood with these arguments."""
    if dotted in _OF_LISTS:
        return all(isinstance(argument, list | range) for argument in arguments)
    return dotted != "str" or len(arguments) == 1


def _touched(node: ast.AST) -> set[str]:
    """The names that a statement may change: assigned ones, and those whose parts or methods it uses."""
    names: set[str] = set()
    for part in ast.walk(node):
        match part:
            case (
                ast.Name(id=name, ctx=ast.Store() | ast.Del())
                | ast.Subscript(value=ast.Name(id=name), ctx=ast.Store() | ast.Del())
                | ast.Call(func=ast.Attribute(value=ast.Name(id=name)))
            ):
                names.add(name)
    return names
