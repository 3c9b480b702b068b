"""Entries of the tables of devices in a simmer-python `config.py`: of sensors, motors and drives."""

import re
import string
from collections.abc import Collection, Iterator
from typing import Any

from simmer_tui.config.importer.device_classes import DeviceClasses
from simmer_tui.config.importer.imported import Fields, Notes
from simmer_tui.config.importer.python_values import Call, Instance, Located, Unreadable
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.rules import CodeRule

USUAL_FIELDS = frozenset(
    {"id", "visible", "color", "outline", "outline_thickness", "position", "rotation", "error"}
)
"""Fields of any device there."""
OWN_DEVICE = "is a device of the team's own or belongs elsewhere"
"""End of a note on a device of a class that is not known."""
# Classes of a team's own whose devices are read as `Ultrasonic` ones: there is none for them there.
_TIME_OF_FLIGHT = re.compile(r"(?i)(.*_)?(tof|time_?of_?flight|vl53l\d\w*)(_?sensor)?")


def coded(table: dict[Any, Located], taken: Collection[str]) -> tuple[dict[Any, Located], dict[str, str]]:
    """The same table, with a free code for each device whose key is none, and these codes by the key's text.

    There a key may be any text. A code starts with the letter of the key, or of the device's class.
    """
    used, made = set(taken), {}
    renamed: dict[Any, Located] = {}
    for key, located in table.items():
        device = located.value.call if isinstance(located.value, Instance) else located.value
        if not is_code(key) and isinstance(device, Call):
            letters = [
                each[0] for each in (str(key), device.name) if each and each[0] in string.ascii_letters
            ]
            ends = string.digits + string.ascii_lowercase
            free = (letter.lower() + end for letter in (*letters, "s") for end in ends)
            code = next((each for each in free if each not in used), None)
            if code is not None:
                used.add(code)
                made[str(key)] = key = code
        renamed[key] = located
    return renamed, made


def is_code(key: Any) -> bool:
    """True if a key of a table can be the code of a command."""
    try:
        CodeRule().check(key)
    except ValueError:
        return False
    return True


def devices_of(
    table: dict[Any, Located],
    codes: set[str],
    notes: Notes,
    names: tuple[str, ...],
    classes: DeviceClasses,
    foreign: list[tuple[Call, Fields]] | None = None,
) -> Iterator[tuple[Call, Fields, str]]:
    """The devices of known classes with usable codes, each with the known class as which it is read; the
    others are noted.

    With `foreign`, a class of time-of-flight sensors counts as known, as an empty name. Readable devices of
    other classes are then added to that list instead of being noted.
    """
    for key, located in table.items():
        name = str(key)
        try:
            device = _device(key, located.value)
            given = fields_of(device)
            # A class may make the description itself, of other arguments.
            passed = classes.description(device)
            description = passed if passed is not None else given
            made = classes.made(device, given)
            read = classes.used_by(device.name)
            fields = Fields(name, located.line, description or {}, notes, made, read)
            known = classes.kind_of(device, names)
            if not known:
                is_ranging = _TIME_OF_FLIGHT.fullmatch(device.name)
                if foreign is not None and not is_ranging:
                    foreign.append((device, fields))
                    continue
                if foreign is None:
                    raise ValueError(f"{cut(device.name, WORD)} {OWN_DEVICE}")
            if key in codes:
                raise ValueError("the code is in use already")
            if description is None:
                raise ValueError("its description cannot be read")
        except ValueError as error:
            notes.add(located.line, name, f"{error}; left out")
            continue
        codes.add(name)
        yield device, fields, known


def _device(key: Any, device: Any) -> Call:
    """An entry of a table as a device. Raises ValueError with the reason why it is not one."""
    try:
        CodeRule().check(key)
    except ValueError as error:
        raise ValueError(f"the code {error}") from None
    if isinstance(device, Instance) and device.call is not None:
        return device.call
    if isinstance(device, Unreadable):
        raise ValueError(f"cannot be read: {device.why}")
    if not isinstance(device, Call):
        raise ValueError("is not a device")
    return device


def fields_of(device: Call) -> dict[Any, Located] | None:
    """The dict from which a device is made: its argument, or its keywords."""
    given = device.arguments[0] if device.arguments else None
    if given is None and "info" in device.keywords:
        given = device.keywords["info"].value
    elif given is None:
        given = dict(device.keywords)
    if not isinstance(given, dict):
        return None
    # Attributes that the file sets afterwards, of which one has another name than its key.
    changes = {"error" if key == "error_pct" else key: each for key, each in device.changes.items()}
    return given | changes


def turn_of(fields: Fields) -> float:
    """The rotation of a device, degrees counter-clockwise."""
    return 0.0 - fields.number("rotation", 0.0)
