"""Skeletons of a team's own device classes: files with their literal numbers, to be finished.

The class was written for another simulator and is never executed. So only its numbers, and the places of its
devices on the robot, are imported. Its team has to write its measurement.
"""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Iterable, Sequence

from msgspec.structs import replace

from simmer_tui.config.device_file import DEVICE_FOLDER, LARGEST_DEVICE_FILE
from simmer_tui.config.importer.imported import Imported, OwnDevice, free_number
from simmer_tui.config.set_devices import SETTING
from simmer_tui.errors import Problem
from simmer_tui.sim.columns import ERROR, ROTATION, X, Y
from simmer_tui.sim.sensors import KINDS
from simmer_tui.sim.sensors.recorded_kinds import LONGEST_KIND, RecordedColumn, RecordedKind, recorded_class
from simmer_tui.sim.specs import SensorKind

_COLUMNS = (X, Y, ROTATION, ERROR)
_TEXT = '''"""{title}, a device of the team's own from simmer-python. It is unfinished: write `observe`.

Its numbers are from {source}. docs/devices.md explains the rest.
"""

from simmer_tui.sim import ObservingSensor, Pose, World, columns


class {title}(ObservingSensor):
    name = "{kind}"
    meaning = "{title}, unfinished"
    unit = ""
    columns = (columns.X, columns.Y, columns.ROTATION, columns.ERROR)
{numbers}
    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        # Return what a perfect sensor reads with the robot at `pose`, and None for nothing to draw.
        raise NotImplementedError("write what {title} reads, in {path}")
'''


def with_skeletons(imported: Imported) -> tuple[Imported, dict[str, bytes]]:
    """The import with the team's own devices as sensors, and their files by path. Devices whose class or code
    cannot be used stay left out."""
    codes = {each.code for each in imported.sensors}.union(each.code for each in imported.drives)
    files: dict[str, bytes] = {}
    sensors, notes = imported.sensors, list(imported.left_out)
    kinds: dict[str, type[SensorKind]] = {}
    for title in dict.fromkeys(each.title for each in imported.devices):
        devices = [own for own in imported.devices if own.title == title and own.code not in codes]
        name = _kind_name(title, [*KINDS, *(kind.name for kind in kinds.values())])
        path = f"{DEVICE_FOLDER}/{title.lower()}.py"
        text = _text(title, name, path, devices) if name and devices and path not in files else ""
        if not 0 < len(text) <= LARGEST_DEVICE_FILE:
            continue
        files[path] = text.encode()
        kinds[title] = _kind(title, name)
        for each in devices:
            codes.add(each.code)
            number = free_number(kinds[title], each.code, sensors)
            sensors += (replace(each.row, kind=kinds[title], number=number),)
            what = f"{path} has its numbers; write observe in it (row {sensors[-1].id})"
            note = Problem(each.note.where, f"{title} of the team's own: {what}")
            notes[notes.index(each.note)] = note  # in place of the note that it was left out
    if not files:
        return imported, {}
    settings = {**imported.settings, SETTING: tuple(files)}
    return replace(imported, sensors=sensors, settings=settings, left_out=tuple(notes)), files


def _kind_name(title: str, taken: Sequence[str]) -> str:
    """The kind in sensors.csv for a class; empty if its name cannot be used in a file."""
    if not title.isascii() or not title.isidentifier() or keyword.iskeyword(title) or len(title) > 60:
        return ""
    letters = re.sub("[^a-z]", "", title.lower())[: LONGEST_KIND - 3]
    name = letters if letters and letters not in taken else f"own{letters}"
    return name if name not in taken else ""


def _kind(title: str, name: str) -> type[SensorKind]:
    columns = tuple(RecordedColumn(each.name, each.field, default=0.0) for each in _COLUMNS)
    return recorded_class(RecordedKind(name=name, title=title, columns=columns))


def _text(title: str, kind: str, path: str, devices: Iterable[OwnDevice]) -> str:
    """The file of a class. It contains only checked numbers, names and places."""
    lines = [""]
    source = "its class in devices/*.py and from config.py"
    for device in devices:
        for name, number in device.class_numbers.items():
            line = f"    {name.upper()} = {number.value!r}  # {number.where}"
            if isinstance(number.value, int | float) and math.isfinite(number.value) and line not in lines:
                lines.append(line)
    for device in devices:
        given = [f"{name} {value!r}" for name, value in device.numbers.items() if math.isfinite(value)]
        if given:
            lines.append(f"    # {device.row.code} in {device.note.where}: {', '.join(given)}")
    numbers = "\n".join([*lines, ""]) if len(lines) > 1 else ""
    return _TEXT.format(title=title, kind=kind, path=path, source=source, numbers=numbers)
