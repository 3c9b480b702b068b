"""A program packed for machines that share no folder with this one: its files and how to start it."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePath

from simmer_tui.errors import TrialsError
from simmer_tui.sim.command import escape

# Each worker gets all of it before its first run: programs have kilobytes, an environment hundreds of
# megabytes.
MOST_BYTES, MOST_FILES = 8_000_000, 2000
_ELSEWHERE = "elsewhere"
"""Folder of files from outside the working directory."""
_PYTHONS = ("python", "python3")
_CACHES = ("__pycache__", "node_modules", "site-packages")
_OWN_RESULTS = "trials.json"


@dataclass(frozen=True, slots=True)
class PackedFile:
    """Content of a file, and True if it can be started."""

    data: bytes
    executable: bool


@dataclass(frozen=True, slots=True)
class ProgramBundle:
    """The words of a command, and the files they speak of by path, relative and with slashes."""

    words: tuple[str, ...]
    files: dict[str, PackedFile]


def pack(command: str, folder: Path) -> ProgramBundle:
    """A command as it would be started in `folder`, with the files that it needs.

    The program is the first word that names a file, or a module after `-m`; the whole folder that it
    lies in (of a module, `folder`) goes along, but for hidden files, caches and results of trials. Of
    other words that name a file, the file does.
    An absolute first word is something installed, which other machines have themselves.
    Raises TrialsError if a file cannot be read or there is too much.
    """
    words = _split(command)
    if words and PurePath(words[0]).stem.lower() in _PYTHONS:
        words[0] = _PYTHONS[0]  # each machine its own
    files: dict[str, PackedFile] = {}
    packed = 0
    for index, word in enumerate(words):
        option, equals, value = word.partition("=") if word.startswith("-") else ("", "", word)
        if index > 0 and words[index - 1] == "-m" and not packed and _module(folder, value).is_file():
            _add_below(files, folder, "")
            packed += 1
        elif value and (folder / value).is_file() and not (index == 0 and PurePath(value).is_absolute()):
            path = folder / value
            home, goal = _places(path, folder, packed)
            name = f"{goal}{path.relative_to(home).as_posix()}"
            if packed:
                _add(files, name, path)
            else:
                _add_below(files, home, goal)
            words[index] = f"{option}{equals}{name}"
            packed += 1
    return ProgramBundle(tuple(words), files)


def unpack(bundle: ProgramBundle, folder: Path) -> str:
    """Lay the files out in `folder`; returns the command that is to be started there."""
    for name, file in bundle.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(file.data)
        if file.executable:
            path.chmod(0o755)
    words = list(bundle.words)
    if words and words[0] == _PYTHONS[0]:
        words[0] = sys.executable  # the one that has this package
    elif words and words[0] in bundle.files:
        words[0] = str(folder / words[0])
    return subprocess.list2cmdline(words) if sys.platform == "win32" else shlex.join(words)


def _split(command: str) -> list[str]:
    """Raises TrialsError."""
    try:
        words = shlex.split(command, posix=sys.platform != "win32")
    except ValueError as error:
        raise TrialsError(f"--run {command!r}: {error}") from None
    return [word.strip('"') for word in words] if sys.platform == "win32" else words


def _module(folder: Path, name: str) -> Path:
    """The file that `python -m name` starts in a folder."""
    path = folder.joinpath(*name.split("."))
    return path / "__main__.py" if path.is_dir() else path.with_suffix(".py")


def _places(path: Path, folder: Path, number: int) -> tuple[Path, str]:
    """The folder that goes along with a file, and what the names in it begin with over there."""
    home, root = path.resolve().parent, folder.resolve()
    if not home.is_relative_to(root):
        return path.parent, f"{_ELSEWHERE}/{number}/"
    inside = home.relative_to(root).as_posix()
    return path.parent, "" if inside == "." else f"{inside}/"


def _below(folder: Path) -> Iterator[Path]:
    for place, folders, names in os.walk(folder):
        folders[:] = [
            name
            for name in sorted(folders)
            if not name.startswith(".")
            and name not in _CACHES
            and not Path(place, name, _OWN_RESULTS).exists()
            and not Path(place, name, "pyvenv.cfg").exists()
        ]
        yield from (Path(place, name) for name in sorted(names) if not name.startswith("."))


def _add_below(files: dict[str, PackedFile], home: Path, goal: str) -> None:
    """All that goes along from a folder. Raises TrialsError."""
    for path in _below(home):
        _add(files, f"{goal}{path.relative_to(home).as_posix()}", path)


def _add(files: dict[str, PackedFile], name: str, path: Path) -> None:
    """Raises TrialsError."""
    shown = escape(str(path), 200)
    try:
        if not path.is_file():  # a socket, a pipe, a broken link
            return
        left = MOST_BYTES - sum(len(file.data) for file in files.values())
        if path.stat().st_size > left or len(files) >= MOST_FILES:
            raise TrialsError(
                f"--run: {shown} is one file too many: at most {MOST_FILES} files of together "
                f"{MOST_BYTES / 1e6:g} MB go to the cluster's workers; put the program in a folder of its own"
            )
        files[name] = PackedFile(path.read_bytes(), os.access(path, os.X_OK))
    except OSError as error:
        raise TrialsError(f"--run: {shown} cannot be read: {error.strerror or error}") from None
