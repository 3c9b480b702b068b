"""Paths as people write them in files and options, on this system or on another."""

from __future__ import annotations

import os
import re
from pathlib import Path, PureWindowsPath
from typing import BinaryIO

from simmer_tui.sim.command import WORD, cut

_USUAL = ("maze.csv", "robot.csv", "sensors.csv", "drive.csv", "floor.csv")


def given_path(text: str, home: Path | None = None) -> Path:
    """A path relative to `home`, or to the working directory. On systems where / separates folders, a path
    with backslashes that does not exist as written is read as one from Windows."""
    home = home or Path()
    path = home / text
    if os.sep == "\\" or "\\" not in text or path.exists():
        return path
    return home / PureWindowsPath(text).as_posix()


def opened_at_once(path: Path) -> BinaryIO:
    """A file to be read, opened without waiting: a named pipe would block every command."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    return open(os.open(path, flags), "rb")  # noqa: PTH123 - a descriptor, which the caller closes


def drive_hint(text: str) -> str:
    """The reason why a path with a drive letter does not exist; empty on Windows and for other paths."""
    drive = PureWindowsPath(text).drive
    if not drive or os.sep == "\\":
        return ""
    return f"; {cut(drive, WORD)} is a drive of Windows: name the folder as it is here"


def other_case(path: Path) -> str:
    """The name of the file that differs from a path only in upper and lower case; empty if there is none."""
    try:
        names = sorted(each.name for each in path.parent.iterdir())
    except OSError:
        return ""
    return next((name for name in names if name != path.name and name.lower() == path.name.lower()), "")


def similar_name(path: Path) -> str:
    """The name of the file that most likely is the missing `path` under another name: with a further ending,
    as a copy, in another format, or with a slip; empty if there is none."""
    from difflib import get_close_matches  # slow to import, needed for mistakes only

    try:
        names = sorted(each.name for each in path.parent.iterdir() if each.is_file())
    except OSError:
        return ""
    stem = path.stem.lower()
    same = [name for name in names if re.match(rf"{re.escape(stem)}(?![a-z])", name.lower())]
    # Not another file of the set: robot.csv is none for drive.csv.
    own = [name for name in names if name.lower() not in _USUAL]
    return next(iter(same or get_close_matches(path.name, own, n=1, cutoff=0.8)), "")
