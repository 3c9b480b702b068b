"""Programs sandboxed by bubblewrap (Linux), in namespaces of their own.

A program sees the system's programs and libraries, Python and this package, all read-only. It has a copy of
its own files in memory, of limited size. Its network has a loopback interface and nothing else; the
simulator's ports listen there (`launcher.py`), so every program has a port 9000 of its own. When its first
process ends, the kernel kills all that it started.

A filter refuses system calls with which a program could leave the sandbox, or observe other ones
(`call_filter.py`).
"""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path

from simmer_tui import platform_has
from simmer_tui.errors import GradeError, PortError, ProgramError, reason_of
from simmer_tui.grade import launcher
from simmer_tui.grade.board_sandbox import BoardSandboxes
from simmer_tui.grade.call_filter import call_filter
from simmer_tui.grade.cgroup import made_group
from simmer_tui.grade.limits import Limits
from simmer_tui.grade.sandbox import (
    ANSWER_TIMEOUT,
    SANDBOXED_FILES,
    SANDBOXED_PACKAGE,
    SCRATCH,
    WRITABLE,
    LaunchedSandbox,
    package_folders,
)
from simmer_tui.grade.usage import tells_descendants
from simmer_tui.links.ports import PortRequest
from simmer_tui.program import ProgramOutput

COMMAND = "bwrap"
# Above all users of a usual system and below 2^31, with room for every thread.
_FIRST_UID = 1_000_000_000
"""First of the user IDs that nobody has; a run's ID is this plus the number of its thread."""
_OWN_PROCESSES = 2
"""Bubblewrap outside, and the launcher inside."""
_ETC = ("ld.so.cache", "ld.so.conf", "ld.so.conf.d", "alternatives", "localtime", "fonts")


class Bubblewrap(LaunchedSandbox):
    """A sandbox of namespaces for one run."""

    _python = sys.executable
    _meters = True

    def __init__(self, files: Path, limits: Limits, extra: Sequence[str] = ()) -> None:
        super().__init__(files, limits, extra)
        self.boards = BoardSandboxes(lambda folder: Bubblewrap(folder, limits))
        """The boards of the run, beside its program."""
        self.board = self.boards.board

    def close(self) -> None:
        self.boards.close()
        super().close()

    @property
    def _uid(self) -> int | None:
        return _FIRST_UID + threading.get_native_id() if platform_has.user_id() == 0 else None

    def _launch(self) -> tuple[subprocess.Popen[bytes], socket.socket]:
        if sys.platform != "linux":
            raise NotImplementedError  # there are no sandboxes here
        group = made_group()
        if group is not None:
            self._group = group
            memory = self._limits.memory_bytes + self._limits.disk_bytes + 2 * SCRATCH
            group.limit(memory, self._limits.processes + _OWN_PROCESSES)
        link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs, tempfile.TemporaryFile() as rules, tempfile.TemporaryFile() as options:
            rules.write(call_filter())
            rules.seek(0)
            words = _words(self._files, self._limits, self._extra, rules.fileno())
            options.write(b"".join(os.fsencode(word) + b"\0" for word in words))
            options.seek(0)
            inside = (sys.executable, "-I", "-S", f"{SANDBOXED_PACKAGE}/launcher.py", str(theirs.fileno()))
            try:
                process = subprocess.Popen(
                    # The program can read this command line and environment in /proc, so neither has anything
                    # secret.
                    [
                        *([] if group is None else group.entry),
                        *(COMMAND, "--args", str(options.fileno()), "--", *inside),
                    ],
                    env={"PATH": os.defpath},
                    cwd="/",
                    stdin=self._stdin,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    pass_fds=(theirs.fileno(), rules.fileno(), options.fileno()),
                    start_new_session=True,
                )
            except OSError:
                link.close()
                raise
        return process, link


def seen_folders(extra: Sequence[str] = ()) -> list[Path]:
    """Folders of this machine that a program can read, besides a few files of /etc."""
    roots = ("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", sys.prefix, sys.base_prefix, *extra)
    return [path for path in map(Path, dict.fromkeys(roots)) if path.exists()]


def _words(files: Path, limits: Limits, extra: Sequence[str], rules: int) -> list[str]:
    words = ["--die-with-parent", "--new-session", "--as-pid-1", "--hostname", "robot", "--clearenv"]
    words += ["--unshare-ipc", "--unshare-pid", "--unshare-net", "--unshare-uts", "--unshare-cgroup-try"]
    if platform_has.user_id() == 0:  # to change the user; all other capabilities are dropped
        words += ["--cap-drop", "ALL", "--cap-add", "CAP_SETUID", "--cap-add", "CAP_SETGID"]
    else:
        words.append("--unshare-user")
    # Mounted before the visible folders: Python may be in one of these.
    words += ["--proc", "/proc", "--dev", "/dev"]
    for place, size in zip(WRITABLE, (SCRATCH, SCRATCH, limits.disk_bytes), strict=True):
        words += ["--perms", "1777", "--size", str(size), "--tmpfs", place]
    seen = seen_folders(extra)
    for path in seen:
        if path.is_symlink() or not any(other != path and path.is_relative_to(other) for other in seen):
            words += _shown(path)
    words += ["--perms", "0755", "--dir", "/etc", "--perms", "0755", "--dir", SANDBOXED_PACKAGE]
    for name in _ETC:
        words += ["--ro-bind-try", f"/etc/{name}", f"/etc/{name}"]
    own = {Path(launcher.__file__): f"{SANDBOXED_PACKAGE}/launcher.py", files: SANDBOXED_FILES}
    for path, place in (package_folders() | own).items():
        words += ["--ro-bind", str(path), place]
    words += ["--remount-ro", "/dev", "--remount-ro", "/"]  # both are in memory, without a limit
    words += ["--remount-ro", "/proc"]  # it contains kernel settings, some of the whole machine
    if call_filter():
        words += ["--seccomp", str(rules)]
    return words


def _shown(path: Path) -> list[str]:
    """Make a file or folder visible, read-only, and let every user traverse the folders above it."""
    if path.is_symlink():
        return ["--symlink", str(path.readlink()), str(path)]
    folders = [*reversed(path.parents[:-1])]  # bubblewrap would make them for root only
    inside = [path]
    if path.is_dir() and path.stat().st_mode & 0o005 != 0o005:
        # An environment may be in a private folder, as mktemp makes them; only its contents have usual
        # permissions.
        folders.append(path)
        inside = sorted(path.iterdir())
    words = []
    for folder in folders:
        words += ["--perms", "0755", "--dir", str(folder)]
    for each in inside:
        if each.is_symlink():
            words += ["--symlink", str(each.readlink()), str(each)]
        else:
            words += ["--ro-bind", str(each), str(each)]
    return words


def what_is_missing() -> str:
    """Reason why there can be no sandbox here, by a test of one; empty if there can."""
    if not platform_has.LINUX:
        return "bubblewrap is for Linux only"
    if shutil.which(COMMAND) is None:
        return "bubblewrap is not installed: apt-get install bubblewrap"
    try:
        tempfile.gettempdir()
    except OSError as error:
        return f"bubblewrap cannot make a sandbox here: {reason_of(error)}"
    with tempfile.TemporaryDirectory(prefix="simmer-grade-") as name:
        Path(name).chmod(0o755)
        ended = threading.Event()
        codes: list[int] = []

        def note(code: int) -> None:
            codes.append(code)
            ended.set()

        with contextlib.closing(Bubblewrap(Path(name), Limits())) as sandbox:
            try:
                sandbox.take("127.0.0.1", PortRequest(0, "a trial", "")).close()
                sandbox.start("python -S -c pass", {}, note, lambda line: None, output=ProgramOutput())
            except (GradeError, PortError, ProgramError) as error:
                return (
                    f"bubblewrap cannot make a sandbox here: {error}; as root it mostly can (sudo), and "
                    "in a container that may make namespaces"
                )
            ended.wait(ANSWER_TIMEOUT)
    if codes == [0]:
        return ""
    return f"a program in a sandbox of bubblewrap does not run here: can every user read {sys.prefix}?"


def limits_text() -> str:
    """Limits of a run's memory and processor time on this machine, in words."""
    group = made_group()
    if group is not None:
        group.remove()
        return "A control group (cgroup v2) limits memory, processes and processors of each run."
    if tells_descendants():
        return (
            "A supervisor limits memory and processor time of each run, and adds them up ten times a second."
        )
    return "Memory and processor time are limited for each process, not for a run as a whole."
