"""A team's device classes (`devices/*.py` of simmer-python), read for their numbers and never executed.

A description in `config.py` has the values that differ from the class. The other numbers of a sensor are in
the class. They are written as `info.get("num_rays", 13)`, as `self.min_range = 1.1`, or as a default of an
argument. They may also be constants of the class or the file, or be in a dict that `__init__` uses.
"""

import ast
import contextlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from msgspec import Struct

from simmer_tui.config.device_outline import python_tree
from simmer_tui.config.leftovers import is_leftover
from simmer_tui.errors import ConfigurationError
from simmer_tui.importer.literal import read_module
from simmer_tui.importer.python_values import Located
from simmer_tui.sim.command import escape

_FOLDER = "devices"
# A robot has a dozen devices; a folder with thousands of files is something else.
_MOST_FILES, _MOST_BYTES = 100, 200_000
# Names of one number, the one of `config.py` first.
_NAMES = {
    "num_rays": ("num_rays", "rays", "n_rays", "ray_count", "number_of_rays"),
    "beamwidth": ("beamwidth", "beam_width", "beam_angle", "fov", "field_of_view", "fov_deg"),
    "min_range": ("min_range", "min_distance", "min_dist", "min_reading", "range_min", "floor"),
    "max_range": ("max_range", "max_distance", "max_dist", "max_reading", "range_max"),
    "height": ("height",),
    "error": ("error", "err"),
    "threshold": ("threshold",),
    "bias": ("bias",),
}
_CANONICAL = {alias: name for name, aliases in _NAMES.items() for alias in aliases}


class ClassNumber(Struct, frozen=True):
    """A number of a device class, with its place."""

    value: float
    where: str


ClassNumbers = Mapping[str, ClassNumber]
"""Numbers of a class by their names in `config.py`."""


def class_number(numbers: ClassNumbers, name: str) -> ClassNumber | None:
    """The number that a class has under a name of `config.py`, or under one that means the same."""
    return numbers.get(_CANONICAL.get(name, name))


def read_device_classes(folder: Path) -> Mapping[str, ClassNumbers]:
    """The classes of `devices/*.py` beside a `config.py`. Files that are not Python are left out, and classes
    that are nested too deeply."""
    classes: dict[str, _DeviceClass] = {}
    for path in _files(folder / _FOLDER):
        name = f"{_FOLDER}/{escape(path.name)}"
        try:
            data = path.read_bytes()[:_MOST_BYTES]
            module = python_tree(data.decode("utf-8", "replace"), name)
        except (OSError, ConfigurationError):
            continue
        constants, tables = read_module(module).names, _tables(module.body)
        for node in ast.walk(module):
            if isinstance(node, ast.ClassDef):
                # A file may have a thousand nested branches or signs.
                with contextlib.suppress(RecursionError):
                    classes[node.name] = _DeviceClass(node, name, constants, tables)
    return {name: _with_bases(name, classes) for name in classes}


def _files(folder: Path) -> list[Path]:
    try:
        found = (each for each in folder.glob("*.py") if each.is_file() and not is_leftover(each.name))
        return sorted(found)[:_MOST_FILES]
    except OSError:
        return []


def _with_bases(name: str, classes: "Mapping[str, _DeviceClass]") -> dict[str, ClassNumber]:
    """Numbers of a class, including those of its bases."""
    found: dict[str, ClassNumber] = {}
    seen: set[str] = set()
    waiting = [name]
    while waiting:
        name = waiting.pop(0)
        if name in seen or name not in classes:
            continue
        seen.add(name)
        # The class itself is read first, so that its bases only add numbers.
        found = classes[name].numbers | found
        waiting.extend(classes[name].bases)
    return found


class _DeviceClass:
    """The numbers of one class definition."""

    def __init__(
        self,
        node: ast.ClassDef,
        file: str,
        constants: Mapping[str, Located],
        tables: Mapping[str, ast.Dict],
    ) -> None:
        """`tables` are the dicts of its file, by name."""
        self.bases = [base.id for base in node.bases if isinstance(base, ast.Name)]
        self.numbers: dict[str, ClassNumber] = {}
        self._file = file
        self._constants = {name: each.value for name, each in constants.items()}
        self._tables = {**tables, **_tables(node.body)}
        for statement in node.body:
            for name, value in _assignments(statement):
                self._constants[name] = self._literal(value)
                self._add(name, value)
        for statement in node.body:
            if isinstance(statement, ast.FunctionDef) and statement.name == "__init__":
                self._read_defaults(statement.args)
                self._read_body(statement.body)
                self._read_tables(statement)

    def _read_defaults(self, arguments: ast.arguments) -> None:
        given = arguments.args[len(arguments.args) - len(arguments.defaults) :]
        for argument, default in (
            *zip(given, arguments.defaults, strict=True),
            *zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True),
        ):
            if default is not None:
                self._add(argument.arg, default)

    def _read_body(self, body: Iterable[ast.stmt]) -> None:
        """Read the assignments of a body, including those below an `if` or `try`."""
        for statement in body:
            if isinstance(statement, ast.If):
                self._read_body((*statement.body, *statement.orelse))
            elif isinstance(statement, ast.Try):
                handlers = (inner for handler in statement.handlers for inner in handler.body)
                self._read_body((*statement.body, *handlers))
            elif isinstance(statement, ast.Expr):  # info.setdefault(...)
                self._read_value("", statement.value)
            for name, value in _assignments(statement):
                self._read_value(name, value)

    def _read_tables(self, function: ast.FunctionDef) -> None:
        """Read the dicts that a function uses (`{**DEFAULTS, **info}`); known numbers stay."""
        before = dict(self.numbers)
        for node in ast.walk(function):
            match node:
                case ast.Name(id=name) | ast.Attribute(attr=name) if name in self._tables:
                    table = self._tables[name]
                    for key, value in zip(table.keys, table.values, strict=True):
                        if isinstance(key, ast.Constant) and isinstance(key.value, str):
                            self._add(key.value, value)
        self.numbers.update(before)

    def _read_value(self, name: str, value: ast.expr) -> None:
        match value:
            # float(info.get(...))
            case ast.Call(func=ast.Name(id="float" | "int"), args=[inner], keywords=[]):
                self._read_value(name, inner)
            case ast.Call(
                func=ast.Attribute(attr="get" | "setdefault" | "pop"),
                args=[ast.Constant(value=str(key)), default],
            ):
                self._add(key, default)
            case ast.IfExp(body=ast.Subscript(slice=ast.Constant(value=str(key))), orelse=default):
                self._add(key, default)
            case ast.BoolOp(op=ast.Or(), values=[*_, default]):
                self._add(name, default)
            case _:
                self._add(name, value)

    def _add(self, name: str, value: ast.expr) -> None:
        known = _CANONICAL.get(name.lower().strip("_"))
        number = self._literal(value)
        if known is not None and number is not None:
            self.numbers[known] = ClassNumber(number, f"{self._file}:{value.lineno}")

    def _literal(self, value: ast.expr) -> float | None:
        match value:
            case ast.Constant(value=bool()):
                return None
            case ast.Constant(value=int() | float() as number):
                return number
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                inner = self._literal(operand)
                return None if inner is None else -inner
            # MIN_RANGE, self.MIN_RANGE and ToF.MIN_RANGE
            case ast.Name(id=name) | ast.Attribute(attr=name):
                constant = self._constants.get(name)
                is_number = isinstance(constant, int | float) and not isinstance(constant, bool)
                return constant if is_number else None
        return None


def _tables(body: Iterable[ast.stmt]) -> dict[str, ast.Dict]:
    """The dicts that statements assign, by name."""
    assigned = (each for statement in body for each in _assignments(statement))
    return {name: value for name, value in assigned if isinstance(value, ast.Dict)}


def _assignments(statement: ast.stmt) -> Iterator[tuple[str, ast.expr]]:
    """Names or attributes of `self` that a statement assigns to, and their values."""
    if isinstance(statement, ast.Assign):
        targets, value = statement.targets, statement.value
    elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
        targets, value = [statement.target], statement.value
    else:
        return
    for target in targets:
        match target, value:
            case ast.Tuple(elts=names), ast.Tuple(elts=values) if len(names) == len(values):
                pairs = list(zip(names, values, strict=True))
            case _:
                pairs = [(target, value)]
        for place, each in pairs:
            match place:
                case ast.Name(id=name) | ast.Attribute(value=ast.Name(id="self"), attr=name):
                    yield name, each
