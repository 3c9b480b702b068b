"""A team's own device files, `devices/*.py` in a set: found, refused if unsafe, and read once.

The bytes read here are hashed, parsed, trusted and run: no file is opened a second time.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath

from msgspec import Struct

from simmer_tui.config.given_path import opened_at_once
from simmer_tui.errors import Problem, reason_of
from simmer_tui.sim.rules import describe

DEVICE_FOLDER = "devices"
"""The folder of a set with its device files."""
# A class of a sensor has 60 lines, 3 kB; a table of numbers in it may have some thousand entries.
LARGEST_DEVICE_FILE = 200_000
"""Largest device file, bytes."""
# A robot has a dozen sensors.
_MOST = 20
"""Most device files of a set."""
_NAME = re.compile(r"[A-Za-z0-9_-]{1,60}\.py")
_MODULE = "simmer_device_"
"""The beginning of the module names of device files; no other module has it."""


class DeviceFile(Struct, frozen=True):
    """A device file as it was read: its path in the set, with a slash, and its bytes."""

    path: str
    data: bytes

    @property
    def sha256(self) -> str:
        """The hash by which the file is trusted, 64 hexadecimal digits."""
        # Some milliseconds, which a start without device files saves.
        import hashlib

        return hashlib.sha256(self.data).hexdigest()

    @property
    def text(self) -> str:
        """The text, byte-order mark included, so that it encodes to the same bytes."""
        return self.data.decode()

    @property
    def module(self) -> str:
        """The name of its module, from its content, so that two files with the same name do not collide."""
        return f"{_MODULE}{PurePosixPath(self.path).stem.replace('-', '_')}_{self.sha256[:16]}"


def read_devices(
    directory: Path, names: Sequence[str], place: str, problems: list[Problem]
) -> tuple[DeviceFile, ...]:
    """The device files that a set names.

    Args:
        directory: The folder of the set.
        names: Their paths in it, as the setting has them.
        place: The setting's place in messages.
        problems: Every file that is refused is added here.
    """
    if len(names) > _MOST:
        problems.append(Problem(place, f"names {len(names)} files; a set may have {_MOST}"))
        return ()
    found: list[DeviceFile] = []
    for name in names:
        try:
            found.append(DeviceFile(name, _read(directory, name)))
        except ValueError as error:
            problems.append(Problem(place, f"{describe(name)} {error}"))
    return tuple(found)


def is_device_name(name: str) -> bool:
    """True if a name is one that a set may have for a device file."""
    return not _unsafe(name)


def _unsafe(name: str) -> str:
    """The reason why a path is refused by its text; empty if it is not. The rules of all systems apply,
    because sets are copied between systems."""
    parts = {*PurePosixPath(name).parts, *PureWindowsPath(name).parts}
    if name.startswith(("/", "\\", "~")) or PureWindowsPath(name).drive:
        return "is an absolute path"
    if ".." in parts:
        return "leads out of the set"
    if not name.endswith(".py"):
        return "is no .py file"
    folder, _, file = name.partition("/")
    if folder != DEVICE_FOLDER or not _NAME.fullmatch(file):
        return f"is not {DEVICE_FOLDER}/NAME.py, with letters, digits, _ and - in NAME"
    return ""


def _read(directory: Path, name: str) -> bytes:
    """The bytes of a file. Raises ValueError if it cannot be used."""
    why = _unsafe(name)
    if why:
        raise ValueError(f"{why}; name a file in the set, such as {DEVICE_FOLDER}/thermal.py")
    path = directory / name
    try:
        if not path.resolve().is_relative_to(directory.resolve()):
            raise ValueError("is a link that leads out of the set; put a copy of the file in its place")
        with opened_at_once(path) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise ValueError("is no file")
            data = file.read(LARGEST_DEVICE_FILE + 1)
    except FileNotFoundError:
        raise ValueError(f"is not in the set {directory}") from None
    except (OSError, RuntimeError) as error:  # RuntimeError: links that lead to each other
        raise ValueError(f"cannot be read: {reason_of(error)}") from None
    if len(data) > LARGEST_DEVICE_FILE:
        raise ValueError(f"has more than {LARGEST_DEVICE_FILE:,} bytes")
    try:
        data.decode()
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        what = f"holds in line {line} the byte 0x{data[error.start]:02x}, which is not UTF-8"
        raise ValueError(what) from None
    return data
