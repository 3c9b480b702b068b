"""The folder of a submission that has its program: its own, or one inside that a packer put everything into.

Finder and Explorer pack a folder with its name: unpacked, `ada` has one folder `ada`, which has main.py.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath

from simmer_tui.config.set_sketches import SKETCH_ENDINGS
from simmer_tui.errors import ProgramError
from simmer_tui.grade.archives import is_archive
from simmer_tui.grade.submission_copy import ENVIRONMENT
from simmer_tui.program.program_command import words_of

_BETWEEN_NAMES = re.compile(r"[\s'\"();,=]+")
"""Characters between the names in a command, also in one that a shell or MATLAB gets as one word."""

_LONGEST_NAME = 255
"""Bytes of a name on the usual file systems; a longer one is an error to look up."""


def folder_of_program(
    files: Path, command: str, others: Sequence[str], left_out: Mapping[str, str]
) -> PurePosixPath:
    """The folder inside `files` to take as the submission, by relative path; `.` if that is `files` itself.

    It is taken only if nothing lies beside it, at each level. It stays a folder of the submission if the
    command names it, as in `python src/main.py`.

    Args:
        command: Command of the team. `others` are further paths that the grading looks for.
        left_out: By path, the reason why an entry was not copied.
    """
    names = (*_words(command), *others)
    taken = PurePosixPath()
    while True:
        inside = [*(files / taken).iterdir()]
        beside = (why for path, why in left_out.items() if PurePosixPath(path).parent == taken)
        if len(inside) != 1 or not inside[0].is_dir() or any(why != ENVIRONMENT for why in beside):
            return taken
        is_new = (not (files / taken / name).exists() for name in names if (inside[0] / name).is_file())
        if not any(is_new) and _is_named(inside[0].name, (command, *others)):
            return taken
        taken /= inside[0].name


def take_folder(files: Path, taken: PurePosixPath) -> None:
    """Put the folder inside `files` in place of `files`. Raises OSError."""
    if taken.parts:
        moved = files.with_name(f"{files.name}-inside")
        (files / taken).rename(moved)
        shutil.rmtree(files)
        moved.rename(files)


def unpacking_advice(files: Path, command: str) -> str:
    """The reason why a program cannot be found as it was submitted, with the next step; else empty: the files
    are in an archive, in a folder beside other files, or have another case, as Windows and macOS allow."""
    inside = sorted(files.iterdir())
    if inside and all(is_archive(path.name) for path in inside):
        return f"{inside[0].name} is an archive, which is not unpacked: submit what is in it"
    words = _words(command)
    if any(_has(files, word) for word in words):
        return ""
    for word in words:
        for path in inside:
            if path.name.lower() == word.removeprefix("./").lower():
                there = f"{word} is not there, but {path.name} is"
                return f"{there}: write its name in the same letters"
    found = [(path.name, word) for path in inside for word in words if (path / word).is_file()]
    if len(found) != 1:
        return ""
    folder, word = found[0]
    return f"{word} is not there, but {f'{folder}/{word}'} is: submit what is in the folder {folder}"


def has_program(files: Path, command: str) -> bool:
    """True if a command names something in the folder, or something that is in another place than it says."""
    return any(_has(files, word) for word in _words(command)) or bool(unpacking_advice(files, command))


def has_sketches(files: Path) -> bool:
    """True if a team's files have a sketch."""
    return any(each.suffix.lower() in SKETCH_ENDINGS for each in files.rglob("*"))


def _words(command: str) -> list[str]:
    """The words of a command that may name a file of the submission."""
    words: list[str] = []
    with suppress(ProgramError):  # its runs say so
        words = words_of(command)
    # A submission learns nothing of files outside it.
    inside = (word for word in words if not word.startswith("/") and ".." not in PurePosixPath(word).parts)
    return [word for word in inside if len(word.encode()) <= _LONGEST_NAME]


def _has(files: Path, word: str) -> bool:
    """True if a word of a command names something in the folder: a path, or a module (`-m robot.main`)."""
    module = files / word.replace(".", "/")
    return any(path.exists() for path in (files / word, module, module.with_suffix(".py")))


def _is_named(folder: str, texts: Iterable[str]) -> bool:
    """True if a text has a path or a module in the folder, or a pattern such as `*/main.py`."""
    words = (word.removeprefix("./") for text in texts for word in _BETWEEN_NAMES.split(text))
    return any(fnmatchcase(folder, re.split(r"[/\\.]", word)[0]) for word in words)
