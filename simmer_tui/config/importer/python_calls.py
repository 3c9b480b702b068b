"""Calls of functions and classes of a foreign file, without running it."""

import ast
import builtins
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from inspect import Parameter, Signature
from typing import Any

from simmer_tui.config.importer.python_builtins import CALLS, OF_SCREEN, called, method_called, table
from simmer_tui.config.importer.python_expressions import SPECIAL, ExpressionReader
from simmer_tui.config.importer.python_names import Effects, touched
from simmer_tui.config.importer.python_values import (
    Call,
    Class,
    Function,
    Instance,
    Located,
    NamedValues,
    Reference,
    items_of,
    readable,
    snapshot,
)
from simmer_tui.errors import NotUnderstoodError


class LoopEnd(Exception):  # noqa: N818 - a jump, no error
    """A `break` or `continue`."""

    def __init__(self, *, again: bool) -> None:
        self.again = again


class ReturnValue(Exception):  # noqa: N818 - a jump, no error
    """The `return` of a function, with its value."""

    def __init__(self, value: Any) -> None:
        self.value = value


class CallReader(ExpressionReader, ast.NodeVisitor):
    """Reads expressions with calls: of functions and classes of the file, and of `CALLS`."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._recorded: ast.Call | None = None  # the last call that was not made
        self._owner: list[tuple[Class | None, Any]] = []
        self._effects: dict[int, tuple[ast.AST, Effects]] = {}

    @abstractmethod
    def _run(self, body: Sequence[ast.stmt]) -> None:
        """Follow the statements of a function."""

    @abstractmethod
    def _forget(self, effects: Effects, why: str, line: int, seen: frozenset[int] = frozenset()) -> None:
        """Make unreadable whatever a statement may have changed."""

    def _effects_of(self, node: ast.AST) -> Effects:
        # A loop may ask thousands of times.
        if id(node) not in self._effects:
            # With the node, so that no other one gets its number.
            self._effects[id(node)] = node, touched(node)
        return self._effects[id(node)][1]

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

    def visit_Lambda(self, node: ast.Lambda) -> Function:
        return self._function(node)

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
            known = all(self._class(name) is not None or name == "object" for name in callee.bases)
            return self.instance(callee, call) if known else call
        if not isinstance(callee, Reference):
            raise NotUnderstoodError("a call of something that has no plain name")
        dotted, name = callee.dotted, callee.name
        if name == "__init__" and arguments and isinstance(arguments[0], Instance):
            self._describe(arguments[0], arguments[1:], keywords)
            return None
        if dotted in OF_SCREEN:
            return None
        if dotted in CALLS or name == "Vector2":
            return called(name if name == "Vector2" else dotted, arguments, _plain(keywords))
        if dotted in (*SPECIAL, "copy.deepcopy", "types.SimpleNamespace"):
            return self._special(dotted, arguments, keywords, node)
        if hasattr(builtins, dotted):
            raise NotUnderstoodError(f"{dotted}() is not understood")
        return self._record(name, arguments, keywords, node)

    def _special(
        self, dotted: str, arguments: tuple[Any, ...], keywords: dict[str, Located], node: ast.Call
    ) -> Any:
        match dotted, arguments:
            case "dict", _:
                return _located(table(*arguments[:1], **keywords), node.lineno)
            case "types.SimpleNamespace", ():
                return Instance(dict(keywords))
            case "copy.deepcopy", (value,):
                return snapshot(value, self._budget.charge)
            case "map", (function, values):
                return [self._called(function, (each,), {}, node) for each in items_of(values)]
        raise NotUnderstoodError(f"{dotted} is not understood with these arguments")

    def _record(
        self, name: str, arguments: tuple[Any, ...], keywords: Mapping[str, Located], node: ast.Call
    ) -> Call:
        self._recorded = node
        # As it was then: the file may use the same dict for the next device.
        charge = self._budget.charge
        kept: tuple[Any, ...] = tuple(snapshot(each, charge) for each in arguments)
        return Call(name, kept, snapshot(dict(keywords), charge), node.lineno)

    def _method(self, of: Any, func: ast.Attribute, node: ast.Call) -> Any:
        name = func.attr
        arguments, keywords = self._arguments(node)
        if isinstance(of, Instance) and name in of.names:
            return self._called(readable(of.names[name].value), arguments, keywords, node)
        if isinstance(of, Instance | Class):
            found = self._member(of.owner if isinstance(of, Instance) else of, name)
            if found is None or not isinstance(readable(found.value), Function):
                raise NotUnderstoodError(f".{name}() is not understood")
            own = (of, *arguments) if isinstance(of, Instance) else arguments
            return self._invoke(found.value, own, keywords)
        result = method_called(of, name, arguments, keywords if name == "update" else _plain(keywords))
        if isinstance(of, dict) and name in ("setdefault", "update"):
            _located(of, node.lineno)
        return result

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
        if found is not None and isinstance(found.value, Function):
            try:
                # The description belongs to the caller, as far as the class may change it.
                arguments = tuple(snapshot(each, self._budget.charge) for each in call.arguments)
                self._invoke(found.value, (made, *arguments), dict(call.keywords))
            except NotUnderstoodError:
                if strict:
                    raise
        return made

    def _invoke(self, function: Function, arguments: tuple[Any, ...], keywords: Mapping[str, Located]) -> Any:
        node = function.node
        scope = _bound(function, arguments, keywords)
        outside = self._scopes, self._globals, self._file, self._bodies, self._tries
        self._scopes, self._globals, self._file = (scope, *function.scopes), set(), function.file
        self._bodies += 1
        self._owner.append((function.owner, arguments[0] if arguments else None))
        try:
            if isinstance(node, ast.Lambda):
                return self.evaluate(node.body)
            self._run(node.body)
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
        return None


def _bound(function: Function, arguments: tuple[Any, ...], keywords: Mapping[str, Located]) -> NamedValues:
    """The arguments of a call by name. Raises NotUnderstoodError."""
    node, line = function.node.args, function.node.lineno
    kinds = (
        *((each, Parameter.POSITIONAL_ONLY) for each in node.posonlyargs),
        *((each, Parameter.POSITIONAL_OR_KEYWORD) for each in node.args),
        (node.vararg, Parameter.VAR_POSITIONAL),
        *((each, Parameter.KEYWORD_ONLY) for each in node.kwonlyargs),
        (node.kwarg, Parameter.VAR_KEYWORD),
    )
    parameters = [
        Parameter(each.arg, kind, default=function.defaults.get(each.arg, Parameter.empty))
        for each, kind in kinds
        if each is not None
    ]
    try:
        found = Signature(parameters).bind(*(Located(each, line) for each in arguments), **keywords)
    except (TypeError, ValueError):
        raise NotUnderstoodError("a function gets other arguments than it has") from None
    found.apply_defaults()
    scope: NamedValues = dict(found.arguments)
    if node.vararg is not None:
        more: Any = scope[node.vararg.arg]
        scope[node.vararg.arg] = Located([each.value for each in more], line)
    if node.kwarg is not None:
        scope[node.kwarg.arg] = Located(scope[node.kwarg.arg], line)
    return scope


def _plain(keywords: Mapping[str, Located]) -> dict[str, Any]:
    return {name: readable(each.value) for name, each in keywords.items()}


def _located(made: dict[Any, Located], line: int) -> dict[Any, Located]:
    """The dict itself, whose new values have a line now."""
    for key, each in made.items():
        if not each.line:
            made[key] = Located(each.value, line)
    return made


def _is_super(node: ast.Call) -> bool:
    return isinstance(node.func, ast.Name) and node.func.id == "super"
