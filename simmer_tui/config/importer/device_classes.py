"""A team's device classes (`devices/*.py` of simmer-python, or classes of `config.py`), never executed.

A description in `config.py` has the values that differ from the class. `__init__` is worked out with the
description, by the bounded reader of `literal.py`: the attributes it sets are the numbers of the device.
Numbers that it does not set are taken from defaults: `info.get("num_rays", 13)`, a default of an argument, a
constant of the class or the file, or a dict that `__init__` uses.

A slip is repaired: an attribute of one meaning that is read from the key of another, which its own attribute
reads too. In simmer-python 1.2.0 the maximum range of an ultrasonic sensor is read from `min_range`.
"""

import ast
import contextlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from msgspec import Struct, field

from simmer_tui.config.device_outline import python_tree
from simmer_tui.config.importer.literal import instance_of, read_module
from simmer_tui.config.importer.python_names import Budget
from simmer_tui.config.importer.python_values import Call, Class, Instance, Located
from simmer_tui.config.leftovers import is_leftover
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.command import escape, escape_word

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
    "error": ("error", "error_pct", "err", "percent_error"),
    "threshold": ("threshold",),
    "bias": ("bias",),
    "position": ("position",),
    "rotation": ("rotation",),
}
# The attribute with the least and the greatest reading; it limits the reading, whatever the others say.
_BOUNDS = "reading_bounds"
_CANONICAL = {alias: name for name, aliases in _NAMES.items() for alias in aliases}


class ClassNumber(Struct, frozen=True):
    """A number of a device class, or the point of its `position`, with its place. `is_made` is True if the
    class makes it of the description, so that it counts and not the description."""

    value: Any
    where: str
    is_made: bool = False


ClassNumbers = Mapping[str, ClassNumber]
"""Numbers of a class by their names in `config.py`."""


class DeviceClasses(Struct):
    """The device classes of a team by name, with their numbers, including those of their bases.

    `numbers` are their defaults. `slips` has the repaired lines of each class. `modules` has the values of
    `config.py` for classes that import it.
    """

    numbers: dict[str, dict[str, ClassNumber]] = field(default_factory=dict)
    slips: dict[str, list[Problem]] = field(default_factory=dict)
    _nodes: dict[str, "_DeviceClass"] = field(default_factory=dict)
    _values: dict[str, Class] = field(default_factory=dict)
    _modules: Mapping[str, dict[str, Located]] = field(default_factory=dict)
    _budget: Budget = field(default_factory=Budget)

    def made(self, call: Call, description: Mapping[Any, Located] | None) -> ClassNumbers:
        """The numbers of the device that a call makes, by their names in `config.py`."""
        name = call.name
        numbers = self.numbers.get(name, {})
        if name not in self._values:
            return numbers
        if description is not None and call.arguments:
            given = self._renamed(name, description)
            call = Call(name, (given, *call.arguments[1:]), call.keywords, call.line)
        instance = instance_of(self._values[name], call, self._values, self._modules, self._budget)
        return {**numbers, **_numbers_of(instance)}

    def description(self, call: Call) -> dict[Any, Located] | None:
        """The dict that a call's class passes on to the class of its base; None if there is none."""
        if call.name not in self._values:
            return None
        instance = instance_of(self._values[call.name], call, self._values, self._modules, self._budget)
        return instance.descriptions[0] if instance.descriptions else None

    def kind_of(self, call: Call, known: Sequence[str]) -> str:
        """The known class whose devices a call's class makes: itself, one of its bases, or the one whose name
        the class gives to its devices. Empty if there is none."""
        found = next((name for name in (call.name, *self._bases(call.name)) if name in known), "")
        if found or call.name not in self._values:
            return found
        instance = instance_of(self._values[call.name], call, self._values, self._modules, self._budget)
        told = instance.names.get("name")
        named = str(told.value).lower().replace("_", "") if told is not None else ""
        found = next((name for name in known if name.lower() == named), "")
        node = self._nodes.get(call.name)
        # A copy may keep the name and read something else.
        return found if found != "Ultrasonic" or (node is not None and node.reads_nearest) else ""

    def used_by(self, name: str) -> frozenset[str]:
        """The keys of which a class and its bases make numbers that are read here."""
        line = (name, *self._bases(name))
        return frozenset(key for each in line if each in self._nodes for key in self._nodes[each].used)

    def _keys_of(self, name: str) -> set[str]:
        """The texts in a class and its bases, among which are the keys that they read."""
        return {
            key
            for each in (name, *self._bases(name))
            if each in self._nodes
            for key in self._nodes[each].keys
        }

    def slips_of(self, name: str) -> list[Problem]:
        """The repaired lines of a class and its bases."""
        return [slip for each in (name, *self._bases(name)) for slip in self.slips.get(each, [])]

    def _bases(self, name: str) -> list[str]:
        found: list[str] = []
        waiting = list(self._nodes[name].bases) if name in self._nodes else []
        while waiting:
            base = waiting.pop(0)
            if base not in found:
                found.append(base)
                waiting += self._nodes[base].bases if base in self._nodes else []
        return found

    def _renamed(self, name: str, description: Mapping[Any, Located]) -> dict[Any, Located]:
        """The description, with keys that the class does not read under the key of the same meaning that it
        reads."""
        given = dict(description)
        read = self._keys_of(name)
        for key, located in description.items():
            meaning = _CANONICAL.get(str(key))
            wanted = [other for other in _NAMES.get(meaning or "", ()) if other in read]
            if wanted and key not in read and not any(other in given for other in wanted):
                given[wanted[0]] = located
        return given


def _numbers_of(instance: Instance) -> dict[str, ClassNumber]:
    """The numbers of an object, by their names in `config.py`."""
    found: dict[str, ClassNumber] = {}
    for attribute, located in instance.names.items():
        name, value = _CANONICAL.get(attribute.lower().strip("_")), located.value
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if name == "position":
            is_number = isinstance(value, list) and all(isinstance(each, int | float) for each in value)
        # An attribute with the name itself wins over one with a similar name.
        if name is not None and is_number and (name not in found or attribute == name):
            found[name] = ClassNumber(value, instance.places.get(attribute, ""), is_made=True)
    match instance.names.get(_BOUNDS):
        case Located(value=[int() | float() as least, int() | float() as greatest]):
            place = instance.places.get(_BOUNDS, "")
            # The reading cannot be beyond either limit.
            reach = found.get("max_range", ClassNumber(math.inf, ""))
            if "min_range" not in found or found["min_range"].value != least:
                found["min_range"] = ClassNumber(least, place, is_made=True)
            if greatest < reach.value:
                found["max_range"] = ClassNumber(greatest, place, is_made=True)
    return found


def class_number(numbers: ClassNumbers, name: str) -> ClassNumber | None:
    """The number that a class has under a name of `config.py`, or under one that means the same."""
    return numbers.get(_CANONICAL.get(name, name))


def read_device_classes(
    folder: Path | None,
    config: ast.Module | None = None,
    names: Mapping[str, Located] | None = None,
    file: str = "",
) -> DeviceClasses:
    """The classes of `devices/*.py` beside a `config.py`, and of its tree `config` in `file` with the values
    `names`. Files that are not Python are left out, and classes that are nested too deeply."""
    values = dict(names or {})
    # Older releases have it in a folder of its name.
    modules = {"config": values, "config.config": values}
    found = DeviceClasses(_modules=modules)
    for path in _files(folder / _FOLDER) if folder is not None else []:
        name = f"{_FOLDER}/{escape(path.name)}"
        try:
            data = path.read_bytes()[:_MOST_BYTES]
            module = python_tree(data.decode("utf-8", "replace"), name)
        except (OSError, ConfigurationError):
            continue
        _repair(module, name, found.slips)
        _add_classes(module, name, read_module(module, name, modules, Budget()).names, found)
    if config is not None:
        _add_classes(config, file, values, found)
    found.numbers = {name: _with_bases(name, found._nodes) for name in found._nodes}
    return found


def _add_classes(module: ast.Module, file: str, names: Mapping[str, Located], to: DeviceClasses) -> None:
    tables = _tables(module.body)
    for node in ast.walk(module):
        if isinstance(node, ast.ClassDef):
            # A file may have a thousand nested branches or signs.
            with contextlib.suppress(RecursionError):
                to._nodes[node.name] = _DeviceClass(node, file, names, tables)
    to._values |= {name: each.value for name, each in names.items() if isinstance(each.value, Class)}


def _repair(module: ast.Module, file: str, slips: dict[str, list[Problem]]) -> None:
    """Repair the slips of all classes of a file, in its tree."""
    for cls in ast.walk(module):
        if not isinstance(cls, ast.ClassDef):
            continue
        reads = [
            (attribute, key, statement.lineno)
            for statement in ast.walk(cls)
            if isinstance(statement, ast.Assign | ast.AnnAssign)
            for attribute, value in _assignments(statement)
            if (key := _key_read(value)) is not None
        ]
        usual = {(_meaning(attribute), key.value) for attribute, key, _ in reads}
        for attribute, key, line in reads:
            meant, read = _meaning(attribute), _meaning(str(key.value))
            if meant and read and meant != read and (read, key.value) in usual:
                what = (
                    f"self.{escape_word(attribute)} is read from {escape_word(str(key.value))!r}, a slip; "
                    f"it is taken from {meant!r}"
                )
                slips.setdefault(cls.name, []).append(Problem(f"{file}:{line}", what))
                key.value = meant


def _meaning(name: str) -> str:
    return _CANONICAL.get(name.lower().strip("_"), "")


def _key_read(value: ast.expr) -> ast.Constant | None:
    """The key in `info.get(key, ...)` or `info[key]`, also as a number."""
    match value:
        case ast.Call(func=ast.Name(id="float" | "int"), args=[inner]):
            return _key_read(inner)
        case ast.Call(
            func=ast.Attribute(attr="get" | "pop" | "setdefault"), args=[ast.Constant() as key, *_]
        ):
            return key
        case ast.Subscript(slice=ast.Constant() as key):
            return key
    return None


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
        self.bases = [
            base.id if isinstance(base, ast.Name) else base.attr
            for base in node.bases
            if isinstance(base, ast.Name | ast.Attribute)
        ]
        texts = (each.value for each in ast.walk(node) if isinstance(each, ast.Constant))
        self.keys = {text for text in texts if isinstance(text, str)}
        """All texts in it, among which are the keys that it reads."""
        self.used = {
            each.value
            for statement in ast.walk(node)
            if isinstance(statement, ast.stmt)
            for name, value in _assignments(statement)
            if _meaning(name)
            for each in ast.walk(value)
            if isinstance(each, ast.Constant) and isinstance(each.value, str)
        }
        """Those of which it makes numbers that are read here."""
        measures = [
            each for each in node.body if isinstance(each, ast.FunctionDef) and each.name == "simulate"
        ]
        self.reads_nearest = not measures or any(
            isinstance(each, ast.Name) and each.id == "min" for each in ast.walk(measures[0])
        )
        """True if its own measurement, if it has one, takes the least of several."""
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
                # The attribute tells what the number means, not the key.
                self._add(name if _meaning(name) else key, default)
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
