"""Static analysis of a device file: its syntax, its kinds, its unfinished methods.

It is parsed, never executed, so this works for files that are not trusted yet.
"""

from __future__ import annotations

import ast
import warnings
from collections.abc import Iterator

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.config.device_file import DeviceFile
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.sensors.recorded_kinds import RecordedKind, is_kind_name, is_label, recorded_class
from simmer_tui.sim.specs import SensorKind


class DeviceOutline(Struct, frozen=True):
    """The kinds that a file seems to define, and the places of unfinished methods."""

    kinds: tuple[type[SensorKind], ...]
    unfinished: tuple[str, ...]


def python_tree(text: str, path: str) -> ast.Module:
    """The syntax tree of Python source. Raises ConfigurationError with its line and what is wrong."""
    try:
        with warnings.catch_warnings():
            # For a string such as "\d", which is not a problem of the set.
            warnings.simplefilter("ignore")
            return ast.parse(text.removeprefix("\ufeff"), path)
    except SyntaxError as error:
        where = f"{path}:{error.lineno}" if error.lineno else path
        raise ConfigurationError([Problem(where, f"is not Python: {error.msg}")]) from None
    except (ValueError, RecursionError, MemoryError) as error:
        what = str(error) or type(error).__name__
        what = f"is not Python that can be read: {what}"
        raise ConfigurationError([Problem(path, what)]) from None


def outline_of(file: DeviceFile, problems: list[Problem]) -> DeviceOutline:
    """The outline of a file; a file that is not Python is a problem, and its outline is empty."""
    try:
        module = python_tree(file.text, file.path)
    except ConfigurationError as error:
        problems += error.problems
        return DeviceOutline((), ())
    classes = [node for node in module.body if isinstance(node, ast.ClassDef)]
    kinds = tuple(kind for node in classes if (kind := _kind(node)) is not None)
    return DeviceOutline(kinds, tuple(_unfinished(file, classes)))


def _kind(node: ast.ClassDef) -> type[SensorKind] | None:
    """The kind of a class with a name for sensors.csv, from the literals in it; its columns are not known."""
    told = {name: value for statement in node.body for name, value in _literals(statement)}
    name = told.get("name")
    if not isinstance(name, str) or not is_kind_name(name) or not is_label(node.name):
        return None
    kind = RecordedKind(name=name, title=node.name, any_columns=True)
    wanted = {"meaning": str, "unit": str, "is_yes_or_no": bool, "is_range": bool}
    literals = {key: told[key] for key, sort in wanted.items() if isinstance(told.get(key), sort)}
    # Control characters are a fault of the class, reported when it runs.
    literals = {key: value for key, value in literals.items() if value in (True, False) or is_label(value)}
    return recorded_class(replace(kind, **literals))


def _literals(statement: ast.stmt) -> Iterator[tuple[str, object]]:
    """The names that a statement of a class gives a constant, and the constants."""
    match statement:
        case ast.Assign(targets=[ast.Name(id=name)], value=ast.Constant(value=value)):
            yield name, value
        case ast.AnnAssign(target=ast.Name(id=name), value=ast.Constant(value=value)):
            yield name, value


def _unfinished(file: DeviceFile, classes: list[ast.ClassDef]) -> Iterator[str]:
    """The methods that only raise NotImplementedError."""
    for node in classes:
        for method in node.body:
            if isinstance(method, ast.FunctionDef) and any(map(_is_open, method.body)):
                yield f"{file.path}:{method.lineno}: {node.name}.{method.name}"


def _is_open(statement: ast.stmt) -> bool:
    if not isinstance(statement, ast.Raise):
        return False
    raised = statement.exc.func if isinstance(statement.exc, ast.Call) else statement.exc
    return isinstance(raised, ast.Name) and raised.id == "NotImplementedError"
