"""Execution of a device file: its module, from the bytes that were hashed, and its kinds of sensor."""

from __future__ import annotations

import contextlib
import inspect
import sys
import warnings
from collections.abc import Iterable, Iterator
from types import ModuleType
from typing import Any

from msgspec.structs import fields

from simmer_tui.config.device_file import DeviceFile
from simmer_tui.config.device_outline import python_tree
from simmer_tui.errors import ConfigurationError, DeviceError, Problem
from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.command import cut
from simmer_tui.sim.device_faults import located
from simmer_tui.sim.rules import Rule
from simmer_tui.sim.sensors import Sensor
from simmer_tui.sim.sensors.recorded_kinds import (
    LONGEST_KIND,
    is_kind_name,
    is_label,
    recorded_class,
    recorded_kind,
)
from simmer_tui.sim.specs import SensorSpec


def kinds_of(file: DeviceFile) -> tuple[type[Sensor], ...]:
    """The kinds of a file, which is run unless it has already run in this process. Raises
    ConfigurationError."""
    module = run_device(file)
    try:
        return _checked_kinds(file, module)
    except (ConfigurationError, KeyboardInterrupt):
        raise
    except BaseException as error:  # noqa: BLE001 - its classes may have code of their own, as a metaclass has
        raise ConfigurationError([_problem(located(file.path, "a class of it", error))]) from None


def _checked_kinds(file: DeviceFile, module: ModuleType) -> tuple[type[Sensor], ...]:
    """The kinds among the classes of a module, checked. Raises ConfigurationError."""
    classes = [each for each in vars(module).values() if isinstance(each, type)]
    # Only the sensors are hashed: a class beside them may have a metaclass without a hash.
    own = dict.fromkeys(
        each for each in classes if each.__module__ == file.module and issubclass(each, Sensor)
    )
    # A class without a `name` that others of the file derive from is only their base.
    kinds = [each for each in own if isinstance(getattr(each, "name", None), str)]
    problems: list[Problem] = []
    if not kinds:
        what = "has no class of a sensor with a name, such as class Thermal(ObservingSensor) with name = "
        problems.append(Problem(file.path, f'{what}"temp"; docs/devices.md shows one'))
    for kind in kinds:
        faults = list(_faults(kind)) or list(_elsewhere(kind, module))
        problems += [Problem(_place(file, kind), what) for what in faults]
    if problems:
        raise ConfigurationError(problems)
    for kind in kinds:
        kind.is_opaque = True
    return tuple(kinds)


def run_device(file: DeviceFile) -> ModuleType:
    """The module of a file. Raises ConfigurationError with file and line if it cannot be run."""
    known = sys.modules.get(file.module)
    if known is not None:
        return known
    tree = python_tree(file.text, file.path)
    module = ModuleType(file.module)
    module.__file__ = file.path
    module.__dict__["print"] = _print_aside
    # Dataclasses, structs and pickle look their classes' module up there.
    sys.modules[file.module] = module
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            code = compile(tree, file.path, "exec", dont_inherit=True)
        # Standard output is for the command's answer, which scripts read.
        with contextlib.redirect_stdout(sys.stderr):
            exec(code, module.__dict__)
    except BaseException as error:
        sys.modules.pop(file.module, None)
        if isinstance(error, KeyboardInterrupt):  # Ctrl-C in a file that never ends
            raise
        raise ConfigurationError([_problem(located(file.path, "the file", error))]) from None
    return module


def _problem(error: Exception) -> Problem:
    """The problem of a set, from an exception whose message has place and text."""
    where, _, what = str(error).partition(": ")
    return Problem(where, what)


def _print_aside(*values: Any, **named: Any) -> None:
    """The `print` of device files: to standard error, unless they name a file."""
    print(*values, **{"file": sys.stderr, **named})  # noqa: T201 - on behalf of the file


def run_devices(files: Iterable[DeviceFile]) -> None:
    """Run files that another process trusted and ran, so that objects of their classes can be unpickled."""
    for file in files:
        kinds_of(file)


@contextlib.contextmanager
def device_faults(files: Iterable[DeviceFile], problems: list[Problem]) -> Iterator[None]:
    """Context in which faults of device files become problems."""
    try:
        yield
    except DeviceError as error:
        problems.append(_problem(error))
    except Exception as error:
        # A rule or a class variable of the team's own.
        for file in files:
            found = _problem(located(file.path, "", error))
            if found.where != file.path:
                problems.append(found)
                return
        raise


def _place(file: DeviceFile, kind: type) -> str:
    """The line of a class."""
    for node in python_tree(file.text, file.path).body:
        if getattr(node, "name", None) == kind.__name__:
            return f"{file.path}:{node.lineno}"
    return file.path


def _faults(kind: type[Sensor]) -> Iterator[str]:
    """The reasons why a class cannot be a kind of sensor."""
    missing = sorted(getattr(kind, "__abstractmethods__", ()))
    if missing:
        yield f"{kind.__name__} lacks {', '.join(missing)}"
    if kind.is_scan:
        yield f"{kind.__name__} scans as a lidar does; a reading of a device is one number"
    if not is_kind_name(kind.name):
        yield f"the name of {kind.__name__} must be 1 to {LONGEST_KIND} letters a to z"
    for name in ("meaning", "unit", "short_name"):
        if not is_label(getattr(kind, name, None)):
            yield f"{kind.__name__} needs {name} = a line of text"
    for name in ("is_range", "is_yes_or_no", "counts"):
        if not isinstance(getattr(kind, name), bool):
            yield f"{name} of {kind.__name__} must be True or False"
    yield from _column_faults(kind)
    for name in ("observe", "combined", "reading", "counted", "increments"):
        if hasattr(kind, name) and not inspect.isfunction(inspect.getattr_static(kind, name)):
            yield f"{name} of {kind.__name__} must be a method: def {name}(self, ...)"


def _column_faults(kind: type[Sensor]) -> Iterator[str]:
    row = kind.spec_type
    # A class between may be one of the file's own, with the same mistake.
    above = (each.spec_type for each in kind.__mro__[1:] if issubclass(each, Sensor))
    base = next(each for each in above if isinstance(each, type) and issubclass(each, SensorSpec))
    if not isinstance(row, type) or not issubclass(row, base):
        yield f"spec_type of {kind.__name__} must be a class derived from {base.__name__}"
        return
    columns = getattr(kind, "columns", None)
    if not isinstance(columns, tuple) or not all(isinstance(each, CsvColumn) for each in columns):
        yield f"{kind.__name__} needs columns = a tuple of columns, () for none"
        return
    known = {each.name: each for each in fields(row)}
    for column in columns:
        texts = (column.name, column.unit, column.label)
        if not all(map(is_label, texts)) or not column.name.strip() or not isinstance(column.rule, Rule):
            yield f"a column of {kind.__name__} needs a name of letters and a rule such as NumberRule()"
            return
        if not isinstance(column.field, str) or column.field not in known:
            yield f"the column {column.name!r} of {kind.__name__} fills {column.field!r}, no field of its row"
            return
    try:
        row(kind=kind, number=1, code="?")
    except TypeError:
        yield f"the fields that {row.__name__} adds to {base.__name__} need defaults"


def _elsewhere(kind: type[Sensor], module: ModuleType) -> Iterator[str]:
    """The reasons why a valid class cannot be written to a log, or passed to another process."""
    shown = repr(cut(kind.__name__))
    if vars(module).get(kind.__name__) is not kind:
        yield f"the class {shown} must stand in the file under that name"
        return
    try:
        recorded_class(recorded_kind(kind))
    except ValueError as error:
        yield f"a log cannot describe {shown}: {error}"
