"""Files that are written whole: each appears complete or not at all. All of the package writes them here.

Logs and records that grow line by line are complete at every moment in another way, and are written where
they grow.
"""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

PARTIAL = ".part"
"""The end of the name of a file that is being written."""
NOT_OVERWRITTEN = "it exists already and is not overwritten"
"""The reason why a file that a person names in a run is not written."""


@contextmanager
def whole_file(path: Path, mode: int = 0o666) -> Generator[BinaryIO, None, None]:
    """Open a file to be written whole. It gets its name when the block ends; if the block raises, everything
    is as before. It is opened at once, so a path that cannot be written is reported before the work.

    A link, a pipe or a device (`/dev/stdout`) is written as it is.

    Args:
        path: The file; an existing one keeps its permissions.
        mode: The permissions of a new one, less those of the umask.

    Raises:
        OSError: It cannot be written; its `filename` is never that of a neighbour.
    """
    with _replaced(path, mode) if _is_replaced(path) else path.open("wb") as file:
        yield file


def write_whole(path: Path, content: str | bytes, mode: int = 0o666) -> None:
    """Write a file, whole or not at all; a text as UTF-8, with its line ends. Raises as `whole_file`."""
    # Before the file is opened: a text that is not UTF-8 leaves a device unwritten.
    data = content.encode() if isinstance(content, str) else content
    with whole_file(path, mode) as file:
        file.write(data)


def _is_replaced(path: Path) -> bool:
    """True if a new file takes the place of a path. Raises OSError if an existing file may not be written."""
    try:
        found = os.lstat(path)
    except FileNotFoundError:
        return True
    if not stat.S_ISREG(found.st_mode):
        return False
    os.close(os.open(path, os.O_WRONLY))  # a file without write permission is not replaced either
    # An existing file may be writable in a folder that is not.
    return os.access(path.parent, os.W_OK)


@contextmanager
def _replaced(path: Path, mode: int) -> Generator[BinaryIO, None, None]:
    """A new file that takes the place of a path when the block ends. Raises OSError."""
    # In the same folder, so that it can be renamed; short, since a name may have the greatest length.
    # Not by `secrets`: its hashes take 10 ms of every start.
    partial = path.with_name(f".{os.urandom(8).hex()}{PARTIAL}")
    kept = stat.S_IMODE(path.lstat().st_mode) if path.exists() else None
    try:
        with open(
            partial, "xb", opener=lambda name, flags: os.open(name, flags, mode if kept is None else kept)
        ) as file:
            if kept is not None:
                partial.chmod(kept)  # whatever the umask is
            yield file
        partial.replace(path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            partial.unlink()
        if isinstance(error, OSError) and error.filename == os.fspath(partial):
            error.filename = os.fspath(path)
        raise
