"""The result of an import, and common parts of both readers: notes, fields of devices, free places.

The other simulators let robot and block overlap a wall; here neither may start so.
"""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.config.drive_csv import DriveRows
from simmer_tui.config.importer.device_classes import ClassNumber, ClassNumbers, class_number
from simmer_tui.config.importer.python_values import Located, Unreadable
from simmer_tui.config.loader import simulation_of
from simmer_tui.config.mission_plan import cells_of
from simmer_tui.config.sets import unreadable
from simmer_tui.config.settings import settings_from
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.obstacles import placement_problems
from simmer_tui.sim.rules import NumberRule, Rule, describe, is_number
from simmer_tui.sim.specs import (
    BLOCK,
    EMPTY,
    START,
    DriveSpec,
    MazeSpec,
    RobotSpec,
    SensorKind,
    SensorSpec,
)

COURSE_MAZE = MazeSpec(
    ((3, 3, 1, 1, 0, 2, 0, 2), (3, 3, 0, 1, 1, 1, 1, 1), (1, 0, 2, 0, 0, 1, 0, 1), (1, 1, 1, 1, 1, 1, 0, 2))
)
"""The course's maze, for teams that never changed it."""

SettingValue = bool | int | float | str | tuple[float, float] | tuple[str, ...]


class OwnDevice(Struct, frozen=True):
    """A device of a class that the team wrote itself: the class's name, and its place as a row of another
    kind. With it are the numbers of class and description, and the note that it was left out."""

    title: str
    row: SensorSpec
    class_numbers: ClassNumbers
    numbers: Mapping[str, float]
    note: Problem

    @property
    def code(self) -> str:
        """Its code."""
        return self.row.code


class Imported(Struct, frozen=True):
    """A configuration set read from another program's files.

    `settings` has the values that differ from the defaults, by dotted name (`server.packet_port`). `left_out`
    lists, by file and line, parts without an equivalent here, and the resulting differences of the set.
    """

    maze: MazeSpec
    robot: RobotSpec
    sensors: tuple[SensorSpec, ...]
    drives: tuple[DriveSpec, ...]
    settings: Mapping[str, SettingValue]
    left_out: tuple[Problem, ...]
    devices: tuple[OwnDevice, ...] = ()
    """Devices of the team's own classes, which are not among the sensors."""


def free_number(kind: type[SensorKind], code: str, taken: Iterable[SensorSpec]) -> int:
    """The number for a sensor's ID: the digit its code ends with if it is free (`u0` is `ultra0`),
    else the lowest free one."""
    numbers = {sensor.number for sensor in taken if sensor.kind is kind}
    # Teams number their sensors in the codes, and expect `ultra0` under `u0`.
    if code[-1].isdigit() and int(code[-1]) not in numbers:
        return int(code[-1])
    return next(number for number in range(len(numbers) + 1) if number not in numbers)


NO_BLOCK = "so there is no block (blocksize = 0)"
"""End of the note on a block that is left out."""
MAX_TRIES = 200
"""Most cells tried for a place: each try builds a maze, and a course has 32 cells."""

_BLOCK, _START = "block_center", "bot_center"
POSITIONS = (_BLOCK, _START)
"""The settings that are places."""


def settled(imported: Imported, origins: Mapping[str, str]) -> Imported:
    """The import, without the block if it is outside or in a wall, and with the robot moved to the middle of
    a free cell if it overlapped a wall or the block.

    `origins` maps the settings `bot_center` and `block_center` to their place in the team's file. Without a
    free cell, the place stays.
    """
    problem = _problems(imported).get(_BLOCK, "")
    if problem:
        # Teams put the block outside, or into a wall, to be rid of it.
        note = Problem(origins.get(_BLOCK, _BLOCK), f"{problem.partition(', which')[0]}; {NO_BLOCK}")
        settings = {**imported.settings, "blocksize": 0.0}
        imported = replace(imported, settings=settings, left_out=(*imported.left_out, note))
    problem = _problems(imported).get(_START, "")
    if not problem:
        return imported
    free = (cell for kind in (START, EMPTY, BLOCK) for cell in cells_of(imported.maze, kind))
    for x, y in ((cell.x, cell.y) for cell in islice(free, MAX_TRIES)):
        moved = replace(imported, settings={**imported.settings, _START: (x, y)})
        if _START not in _problems(moved):
            what = f"{problem.partition(';')[0]}; moved to ({x:g}, {y:g})"
            return replace(moved, left_out=(*moved.left_out, Problem(origins.get(_START, _START), what)))
    return imported


def check_mission(imported: Imported) -> None:
    """Raise ConfigurationError if a set for a mission would have no block."""
    if imported.settings.get("blocksize") == 0.0:
        notes = [each for each in imported.left_out if each.what.endswith(NO_BLOCK)]
        where, why = (
            (notes[0].where, f"{notes[0].what}; ") if notes else ("--mission", "the file has no block; ")
        )
        what = f"{why}a mission needs one: put it into a free cell, or import without --mission"
        raise ConfigurationError([Problem(where, what)])


def _problems(imported: Imported) -> dict[str, str]:
    settings = settings_from(imported.settings)
    return dict(placement_problems(simulation_of(settings, imported.maze, imported.robot, (), DriveRows())))


N = TypeVar("N", int, float)
_ANY_NUMBER = NumberRule()


class Notes:
    """Collects notes on parts without an equivalent, by line."""

    def __init__(self, file: str) -> None:
        self._file = file
        self._found: list[tuple[int, Problem]] = []

    def add(self, line: int, name: str, what: str) -> Problem:
        """Note `what` about `name`; line 0 means the file as a whole. Returns the note."""
        note = Problem(self.where(line, name), what)
        self._found.append((line, note))
        return note

    def add_elsewhere(self, problem: Problem) -> None:
        """Note something about another file, each once."""
        if (0, problem) not in self._found:
            self._found.append((0, problem))

    def where(self, line: int, name: str) -> str:
        """`file:line:name`, without parts that are 0 or empty."""
        return ":".join(part for part in (self._file, str(line or ""), cut(name, WORD)) if part)

    def in_order(self) -> tuple[Problem, ...]:
        """All notes, by line."""
        return tuple(problem for _, problem in sorted(self._found, key=lambda found: found[0]))


@dataclass(eq=False)
class Fields:
    """The dict that describes one device, read field by field; unusable fields are noted."""

    code: str
    line: int
    fields: dict[Any, Located]
    notes: Notes
    class_numbers: ClassNumbers = field(default_factory=dict)
    """Numbers that its class makes of it, or has for what is not given."""
    read_by_class: frozenset[str] = frozenset()
    """Keys of which its class makes numbers."""
    of_class: dict[str, ClassNumber] = field(default_factory=dict)
    """Numbers from the device's class, in the order in which they were requested."""
    assumed: dict[str, float] = field(default_factory=dict)
    """Default numbers that neither the description nor the class has."""

    @property
    def numbers(self) -> dict[str, float]:
        """The fields that are plain numbers, by name."""
        found = {str(key): each.value for key, each in self.fields.items() if str(key).isidentifier()}
        return {key: value for key, value in found.items() if is_number(value) and key.isascii()}

    def silent(self) -> "Fields":
        """The same fields, without notes."""
        return Fields(self.code, self.line, self.fields, Notes(""), self.class_numbers)

    def note(self, key: str, what: str) -> Problem:
        """Note something about a field, at its line. Returns the note."""
        line = self.fields[key].line if key in self.fields else self.line
        return self.notes.add(line, f"{self.code}.{key}" if key else self.code, what)

    def value(self, key: str) -> Any:
        """The value of a field; None if it is absent or cannot be read."""
        located = self.fields.get(key)
        if located is None:
            return None
        if isinstance(located.value, Unreadable):
            self.note(key, f"cannot be read: {located.value.why}; left out")
            return None
        return located.value

    def number(self, key: str, default: float, rule: Rule[float] = _ANY_NUMBER) -> float:
        """A number, or the default if it is absent or not one the rule allows."""
        # Adding 0 turns -0.0, which nobody writes, into 0.0.
        return self.checked(key, default, rule) + 0.0

    def checked(self, key: str, default: N, rule: Rule[N]) -> N:
        """A value of the description, else of the device's class, else the default. If the rule does not
        allow it, the default."""
        value = self.value(key)
        own = class_number(self.class_numbers, key)
        # A class may scale a value of the description, or have one of its own instead of it.
        if own is not None and value is not None and (not own.is_made or own.value == value):
            own = None
        if value is None and own is None:
            self.assumed[key] = default
            return default
        try:
            found = rule.check(value if own is None else own.value)
        except ValueError as error:
            place = "" if own is None else f"{own.where}: "
            self.note(key, f"{place}{error}; {default:g} is taken")
            return default
        if own is not None and value is not None:
            self.note(key, f"is {describe(value)}, of which its class makes {found:g} ({own.where})")
        elif own is not None and found != default:
            self.of_class[key] = own
        return found

    def axes(self, key: str) -> dict[str, float]:
        """A dict of x, y and rotation, absent ones 0."""
        value = self.value(key)
        if value is not None and not isinstance(value, dict):
            self.note(key, "is not a dict of x, y and rotation; left out")
        inner = value if isinstance(value, dict) else {}
        fields = Fields(f"{self.code}.{key}", self.line, inner, self.notes)
        return {axis: fields.number(axis, 0.0) for axis in ("x", "y", "rotation")}

    def point(self, key: str) -> tuple[float, float]:
        """A place on the robot in its own frame; the centre if none is given."""
        value = self.value(key)
        point = pair(value)
        own = class_number(self.class_numbers, key)
        made = pair(own.value) if own is not None and own.is_made else None
        if own is not None and made is not None and made != point:
            self.note(key, f"is ({made[0]:g}, {made[1]:g}) by its class ({own.where})")
            return made
        if point is None and value is not None:
            self.note(key, "is not a point; the robot's centre is taken")
        return point or (0.0, 0.0)

    def list_others(self, known: Collection[str]) -> None:
        """Note the fields that are not among the known ones."""
        for key in self.fields:
            if key not in known:
                self.note(str(key), "has no equivalent; left out")


def text_of_file(path: Path) -> str:
    """The text of a team's file. Raises ConfigurationError if it cannot be read."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise unreadable(error, path) from None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Old editors; only comments and names can be affected.
        return data.decode("latin-1")


def pair(value: Any) -> tuple[float, float] | None:
    """Two finite numbers, or the first two of three; None for anything else."""
    if not isinstance(value, list | tuple) or len(value) not in (2, 3):
        return None
    try:
        x, y = float(value[0]), float(value[1])
    except (TypeError, ValueError, OverflowError):
        return None
    return (x, y) if math.isfinite(x) and math.isfinite(y) else None
