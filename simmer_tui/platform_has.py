"""The features of this system that not every system has, and the user's data folder: all of the package asks
here.

Windows has none of the calls of POSIX: `fork` and process groups, locks of `fcntl`, pseudo-terminals, users
and groups with numbers, resource limits. They come together, so one constant represents them. What needs
Linux alone (/proc, netlink) asks for `LINUX`. Type checkers know only `sys.platform`: beside a call of POSIX
it is asked for as well.
"""

from __future__ import annotations

import contextlib
import os
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
    """The user's data folder on this platform, which may not exist yet."""
    import platformdirs  # few runs need it, and a start should not wait for it

    return platformdirs.user_data_path("simmer-tui", appauthor=False)


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
