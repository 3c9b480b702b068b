"""A team's device classes (`devices/*.py` of simmer-python, or classes of `config.py`), never executed.

`__init__` is worked out with the description of `config.py`, by the bounded reader of `literal.py`: the
attributes it sets are the numbers of the device. Numbers that it does not set are those of the class's body.

A slip is repaired: an attribute of one meaning that is read from the key of another, which its own attribute
reads too. In simmer-python 1.2.0 the maximum range of an ultrasonic sensor is read from `min_range`.
"""

import ast
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from msgspec import Struct, field

from simmer_tui.config.device_outline import python_tree
from simmer_tui.config.importer.literal import instance_of, read_module
from simmer_tui.config.importer.python_names import Budget
from simmer_tui.config.importer.python_values import Call, Class, Instance, Located
from simmer_tui.config.leftovers import is_leftover
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.rules import is_number

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
    """The device classes of a team by name.

    `numbers` are those of a device without a description. `slips` has the repaired lines of each class.
    `modules` has the values of `config.py` for classes that import it.
    """

    numbers: dict[str, ClassNumbers] = field(default_factory=dict)
    slips: dict[str, list[Problem]] = field(default_factory=dict)
    _classes: dict[str, Class] = field(default_factory=dict)
    _modules: Mapping[str, dict[str, Located]] = field(default_factory=dict)
    _budget: Budget = field(default_factory=Budget)

    def made(self, call: Call, description: Mapping[Any, Located] | None) -> ClassNumbers:
        """The numbers of the device that a call makes, by their names in `config.py`."""
        if description is not None and call.arguments:
            given = self._renamed(call.name, description)
            call = Call(call.name, (given, *call.arguments[1:]), call.keywords, call.line)
        found: dict[str, ClassNumber] = {}
        for cls in reversed(self._line(call.name)):
            places = {name: f"{cls.file}:{each.line}" for name, each in cls.names.items()}
            found |= _numbers(cls.names, places, is_made=False)
        instance = self._instance(call)
        return found | _limited(_numbers(instance.names, instance.places, is_made=True), instance)

    def _instance(self, call: Call) -> Instance:
        if call.name not in self._classes:
            return Instance({})
        return instance_of(self._classes[call.name], call, self._classes, self._modules, self._budget)

    def description(self, call: Call) -> dict[Any, Located] | None:
        """The dict that a call's class passes on to the class of its base; None if there is none."""
        passed = self._instance(call).descriptions
        return passed[0] if passed else None

    def kind_of(self, call: Call, known: Sequence[str]) -> str:
        """The known class whose devices a call's class makes: itself, one of its bases, or the one whose name
        the class gives to its devices. Empty if there is none."""
        found = next((name for name in self._names(call.name) if name in known), "")
        if found or call.name not in self._classes:
            return found
        told = self._instance(call).names.get("name")
        named = str(told.value).lower().replace("_", "") if told is not None else ""
        found = next((name for name in known if name.lower() == named), "")
        # A copy may keep the name and read something else.
        return found if found != "Ultrasonic" or _reads_nearest(self._classes[call.name].node) else ""

    def used_by(self, name: str) -> frozenset[str]:
        """The keys of which a class and its bases make numbers that are read here."""
        values = (
            value
            for cls in self._line(name)
            for each in ast.walk(cls.node)
            if isinstance(each, ast.stmt)
            for attribute, value in _assignments(each)
            if _meaning(attribute)
        )
        return frozenset(text for value in values for text in _texts(value))

    def slips_of(self, name: str) -> list[Problem]:
        """The repaired lines of a class and its bases."""
        return [slip for each in self._names(name) for slip in self.slips.get(each, [])]

    def _names(self, name: str) -> list[str]:
        """The names of a class and its bases, the nearest first."""
        found = [name]
        for each in found:
            bases = self._classes[each].bases if each in self._classes else ()
            found += [base for base in bases if base not in found]
        return found

    def _line(self, name: str) -> list[Class]:
        return [self._classes[each] for each in self._names(name) if each in self._classes]

    def _renamed(self, name: str, description: Mapping[Any, Located]) -> dict[Any, Located]:
        """The description, with keys that the class does not read under the key of the same meaning that it
        reads."""
        given = dict(description)
        read = {text for cls in self._line(name) for text in _texts(cls.node)}
        for key, located in description.items():
            wanted = [other for other in _NAMES.get(_CANONICAL.get(str(key), ""), ()) if other in read]
            if wanted and key not in read and not any(other in given for other in wanted):
                given[wanted[0]] = located
        return given


def _numbers(
    names: Mapping[str, Located], places: Mapping[str, str], *, is_made: bool
) -> dict[str, ClassNumber]:
    """The numbers among the values of names, by their names in `config.py`."""
    found: dict[str, ClassNumber] = {}
    for attribute, located in names.items():
        name, value = _meaning(attribute), located.value
        is_known = is_number(value)
        if name == "position":
            is_known = isinstance(value, list) and all(isinstance(each, int | float) for each in value)
        # An attribute with the name itself wins over one with a similar name.
        if name and is_known and (name not in found or attribute == name):
            found[name] = ClassNumber(value, places.get(attribute, ""), is_made=is_made)
    return found


def _limited(found: dict[str, ClassNumber], instance: Instance) -> dict[str, ClassNumber]:
    """The numbers, with the limits of the reading that the device has."""
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


def read_device_classes(folder: Path | None, names: Mapping[str, Located] | None = None) -> DeviceClasses:
    """The classes of `devices/*.py` beside a `config.py`, and those among its values `names`. Files that are
    not Python are left out."""
    values = dict(names or {})
    # Older releases have it in a folder of its name.
    modules = {"config": values, "config.config": values}
    found = DeviceClasses(_modules=modules)
    classes = found._classes
    for path in _files(folder / _FOLDER) if folder is not None else []:
        name = f"{_FOLDER}/{path.name}"
        try:
            data = path.read_bytes()[:_MOST_BYTES]
            module = python_tree(data.decode("utf-8", "replace"), name)
        except (OSError, ConfigurationError):
            continue
        _repair(module, name, found.slips)
        classes |= _classes_in(read_module(module, name, modules, Budget()).names)
    classes |= _classes_in(values)
    found.numbers = {name: found.made(Call(name, ({},), {}, 0), None) for name in classes}
    return found


def _classes_in(names: Mapping[str, Located]) -> dict[str, Class]:
    classes = (each.value for each in names.values() if isinstance(each.value, Class))
    return {cls.name: cls for cls in classes}


def _reads_nearest(node: ast.ClassDef) -> bool:
    """True if a class's own measurement, if it has one, takes the least of several."""
    measures = [each for each in node.body if isinstance(each, ast.FunctionDef) and each.name == "simulate"]
    return not measures or any(
        isinstance(each, ast.Name) and each.id == "min" for each in ast.walk(measures[0])
    )


def _texts(node: ast.AST) -> set[str]:
    """The texts in a part of a class, among which are the keys that it reads."""
    values = (each.value for each in ast.walk(node) if isinstance(each, ast.Constant))
    return {value for value in values if isinstance(value, str)}


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
                    f"self.{cut(attribute, WORD)} is read from {cut(str(key.value), WORD)!r}, a slip; "
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
