"""The features of this system that not every system has, and the user's data folder: all of the package asks
here.

Windows has none of the calls of POSIX: `fork` and process groups, locks of `fcntl`, pseudo-terminals, users
and groups with numbers, resource limits. They come together, so one constant represents them. What needs
Linux alone (/proc, netlink) asks for `LINUX`. Type checkers know only `sys.platform`: beside a call of POSIX
it is asked for as well.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import stat
import sys
from collections.abc import Sequence
from pathlib import Path

try:
    import fcntl
except ImportError:
    POSIX = False
else:
    POSIX = hasattr(os, "fork")
"""True if the calls of POSIX are there; False on Windows."""
LINUX = POSIX and sys.platform == "linux"
"""True if there are /proc and netlink, though a container may hide either."""


def shell_line(words: Sequence[str]) -> str:
    """The line to type in this system's shell for a command of these words."""
    # Imported here because few commands print one.
    if POSIX:
        import shlex

        return shlex.join(words)
    import subprocess

    return subprocess.list2cmdline(words)


def lock_alone(descriptor: int) -> None:
    """Lock a file for this process alone, until it is closed. Without locks, nothing happens. Raises
    BlockingIOError if another process has it."""
    if sys.platform == "win32" or not POSIX:
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # some network file systems have no locks
        pass


def data_folder() -> Path:
    """The user's data folder on this platform, which may not exist yet. A user without a home directory has
    one in the system's temporary folder."""
    return _user_data_folder() or _temporary_data_folder()


def home_notice() -> str:
    """A sentence if this user has no home directory, as in a container that runs by a user's number; else
    empty."""
    if _user_data_folder() is not None:
        return ""
    who = user_name(user_id() or 0)
    return f"user {who} has no home directory: runs are saved in {data_folder()}; HOME=FOLDER sets another"


def expanded(name: str | Path) -> Path:
    """A file's path with the home directory in place of `~`, if that is known."""
    try:
        return Path(name).expanduser()
    except RuntimeError:
        return Path(name)


def _user_data_folder() -> Path | None:
    import platformdirs  # few runs need it, and a start should not wait for it

    try:
        folder = platformdirs.user_data_path("simmer-tui", appauthor=False)
    except RuntimeError:
        return None
    # Older versions return a path with `~`, or one below an empty HOME.
    return folder if folder.is_absolute() else None


def _temporary_data_folder() -> Path:
    import tempfile

    try:
        place = Path(tempfile.gettempdir())
    except OSError:  # none can be written; who writes there says so
        place = Path("/tmp")
    own = user_id()
    for number in itertools.count(1):
        folder = place / (f"simmer-tui-{own}" if number == 1 else f"simmer-tui-{own}-{number}")
        try:
            status = folder.lstat()
        except OSError:
            break
        # Anyone may make a folder of that name there, and write its files.
        if stat.S_ISDIR(status.st_mode) and own in (None, status.st_uid):
            break
    return folder


def window_size(descriptor: int) -> tuple[int, int] | None:
    """Columns and rows of the terminal at a descriptor. None if there is no terminal, or if its size is not
    known, as on a serial line."""
    try:
        columns, rows = os.get_terminal_size(descriptor)
    except (OSError, ValueError):
        return None
    return (columns, rows) if columns > 0 and rows > 0 else None


def user_id() -> int | None:
    """The number of the user that this process runs as; None on Windows, where users have none."""
    return os.geteuid() if hasattr(os, "geteuid") else None


def user_name(uid: int) -> str:
    """Name of a user on this machine; the number where it has none."""
    if sys.platform != "win32" and POSIX:
        import pwd

        with contextlib.suppress(KeyError):
            return pwd.getpwuid(uid).pw_name
    return str(uid)


def group_name(gid: int) -> str:
    """Name of a group on this machine; empty where it has none."""
    if sys.platform != "win32" and POSIX:
        import grp

        with contextlib.suppress(KeyError):
            return grp.getgrgid(gid).gr_name
    return ""


def leave_process_group() -> None:
    """Begin a group of this process alone, which Ctrl-C in a terminal does not reach."""
    if sys.platform != "win32" and POSIX:
        os.setpgid(0, 0)
