"""The copy of a submission: made once, and read from then on in place of it.

A grader may read more than a team, and the team may change its folder while it is copied. So folders and
files are opened by descriptors, each relative to the folder above it (openat) and never through a link
(O_NOFOLLOW). Their type is that of the opened descriptor (fstat), not of a name that may have changed by
then.
"""

from __future__ import annotations

import os
import stat
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from simmer_tui.config.leftovers import is_environment, is_leftover, is_leftover_folder
from simmer_tui.errors import GradeError, reason_of
from simmer_tui.grade.limits import Limits

# Programs have dozens of files; an environment that was submitted by mistake has ten thousands.
MOST_FILES = 2000
"""Most files of a submission."""
LARGEST_SUBMISSION = Limits().disk_bytes
"""Largest submission, bytes; a larger one would not fit into its sandbox either."""
_MOST_ENTRIES = 20_000
"""Most entries (files, folders, links, pipes) examined. Judged: ten times `MOST_FILES`, which takes a
moment."""
_DEEPEST = 40
"""Folders within each other: each takes an open descriptor, of 256 on some systems."""
ENVIRONMENT = "is a virtual environment"
"""The reason why a folder of installed packages is not copied."""
_AT_ONCE = 1 << 20
"""Bytes read at once: the time of a call is then small beside that of the disk."""
_BY_DESCRIPTOR = os.open in os.supports_dir_fd and os.scandir in os.supports_fd
"""False on Windows, where making a link is a privilege: paths are opened there."""
# A pipe that replaces a file must not block the grading (NONBLOCK). Windows lacks the other flags.
_READ = (
    os.O_RDONLY
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_NOCTTY", 0)
    | getattr(os, "O_CLOEXEC", 0)
    | getattr(os, "O_BINARY", 0)
)
_FOLDER = getattr(os, "O_DIRECTORY", 0)
_WRITE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)


def copy_submission(source: Path, goal: Path, most_bytes: int) -> dict[str, str]:
    """Copy the plain files of a folder to a new one. Links, pipes and devices stay, and so do leftovers and
    environments (`config/leftovers.py`).

    Returns:
        By path, the reason why an entry was not copied: `is a pipe`.

    Raises:
        GradeError: There is too much, or something cannot be read, or changed meanwhile.
    """
    try:
        with _opened_folder(source, None) as folder:
            copy = _Copy(folder.owner, most_bytes)
            copy.take(folder, goal, PurePosixPath())
    except OSError as error:
        raise GradeError(f"its folder: {reason_of(error)}") from None
    return copy.left_out


@dataclass(frozen=True, slots=True)
class _Folder:
    """An open folder: the `descriptor`, or on Windows the path alone."""

    path: Path
    descriptor: int | None
    owner: int


@contextmanager
def _opened_folder(path: Path, parent: int | None) -> Iterator[_Folder]:
    """Open a folder, in its parent where descriptors can be used. Raises OSError."""
    if not _BY_DESCRIPTOR:
        yield _Folder(path, None, path.stat().st_uid)
        return
    descriptor = os.open(path if parent is None else path.name, _READ | _FOLDER, dir_fd=parent)
    try:
        yield _Folder(path, descriptor, os.fstat(descriptor).st_uid)
    finally:
        os.close(descriptor)


class _Copy:
    """A copy under way, with the rest of its budget."""

    def __init__(self, owner: int, most_bytes: int) -> None:
        """`owner` is the user whose folder it is."""
        self._owner = owner
        self._most = self._left = most_bytes
        self._files = self._entries = 0
        self._in_folders: Counter[PurePosixPath] = Counter()
        self._bytes_in_folders: Counter[PurePosixPath] = Counter()
        """The files so far, and their bytes, by each folder that they are below."""
        self.left_out: dict[str, str] = {}

    def take(self, source: _Folder, goal: Path, shown: PurePosixPath) -> None:
        """Copy the contents of a folder to a new one. Raises GradeError."""
        if len(shown.parts) > _DEEPEST:
            raise GradeError(f"has folders more than {_DEEPEST} deep")
        goal.mkdir(parents=True)
        for entry in self._listed(source, shown):
            here = shown / entry.name
            try:
                if entry.is_dir(follow_symlinks=False):
                    if is_environment(source.path / entry.name):
                        self.left_out[str(here)] = ENVIRONMENT
                    elif not is_leftover_folder(entry.name):
                        with _opened_folder(source.path / entry.name, source.descriptor) as folder:
                            self.take(folder, goal / entry.name, here)
                elif is_leftover(entry.name):
                    continue
                elif reason := self._not_copied(source, entry, goal, shown):
                    self.left_out[str(here)] = reason
            except OSError as error:
                raise GradeError(f"{here}: {reason_of(error)}") from None
        goal.chmod(0o755)  # the program reads them with a user ID that nobody has

    def _listed(self, source: _Folder, shown: PurePosixPath) -> list[os.DirEntry[str]]:
        found = []
        try:
            with os.scandir(source.path if source.descriptor is None else source.descriptor) as entries:
                for entry in entries:
                    self._entries += 1
                    if self._entries > _MOST_ENTRIES:
                        raise GradeError(f"has more than {_MOST_ENTRIES} files, folders and links")
                    found.append(entry)
        except OSError as error:
            raise GradeError(f"{shown}: {reason_of(error)}") from None
        return sorted(found, key=lambda entry: entry.name)

    def _not_copied(self, source: _Folder, entry: os.DirEntry[str], goal: Path, shown: PurePosixPath) -> str:
        """Copy an entry that is a plain file; the reason if it is none. Raises GradeError, OSError."""
        if entry.is_symlink():
            return "is a symbolic link"
        if entry.is_file(follow_symlinks=False):
            mine = self._copy_file(source, entry.name, goal / entry.name, shown)
            return "" if mine else "is another user's file under a second name"
        is_pipe = stat.S_ISFIFO(entry.stat(follow_symlinks=False).st_mode)
        return "is a pipe" if is_pipe else "is no file"

    def _copy_file(self, source: _Folder, name: str, goal: Path, shown: PurePosixPath) -> bool:
        """Copy a plain file; False for a hard link to another user's. Raises GradeError, OSError."""
        given = name if source.descriptor is not None else source.path / name
        read = os.open(given, _READ, dir_fd=source.descriptor)
        try:
            found = os.fstat(read)
            if not stat.S_ISREG(found.st_mode):
                raise GradeError(f"{name}: changed while it was copied")
            if found.st_nlink > 1 and found.st_uid != self._owner:
                return False  # it is a link as well
            self._files += 1
            self._in_folders += Counter(dict.fromkeys((shown, *shown.parents), 1))
            self._bytes_in_folders += Counter(dict.fromkeys((shown, *shown.parents), found.st_size))
            self._check(found.st_size)
            mode = 0o755 if found.st_mode & 0o111 else 0o644
            written = os.open(goal, _WRITE, 0o600)
            try:
                while data := os.read(read, _AT_ONCE):
                    self._left -= len(data)
                    self._check(0)  # it may grow while it is read
                    _write_all(written, data)
            finally:
                os.close(written)
            goal.chmod(mode)
            return True
        finally:
            os.close(read)

    def _check(self, more: int) -> None:
        if more > self._left or self._left < 0 or self._files > MOST_FILES:
            inside = self._in_folders if self._files > MOST_FILES else self._bytes_in_folders
            raise GradeError(f"are more than {self._most / 1e6:g} MB or {MOST_FILES} files{_largest(inside)}")


def _largest(inside: Counter[PurePosixPath]) -> str:
    """The innermost folder with more than half of all, and the next step; empty if that is the whole."""
    whole = inside[PurePosixPath()]
    found = max(
        (path for path, count in inside.items() if 2 * count > whole), key=lambda path: len(path.parts)
    )
    return f", most of them in {found}: leave it out" if found.parts else ""


def _write_all(descriptor: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(descriptor, view) :]
