"""A program that ends with all that it started, on Unix: a keeper (`keeper.py`) watches it.

On Linux this process can also adopt, and end, processes that the program left behind.
"""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from simmer_tui import platform_has
from simmer_tui.links.processes import StatField, children, stat_of
from simmer_tui.program import keeper
from simmer_tui.program.keeper import KEEPER, MARK
from simmer_tui.program.program_output import OutputRoute

_LAST_WAIT = 0.5
"""Seconds to wait for a killed program's end. Another user's program cannot be killed."""
_LOOKS = 20
"""Looks at an environment that is empty, a millisecond apart: an exec takes less, at load 12 too."""
# A look takes a tenth of a millisecond. A process left behind after the last look outlives the simulator if
# that is killed.
_REAP_INTERVAL = 0.25
"""Seconds between two looks for adopted processes."""
_SET_CHILD_SUBREAPER = 36
"""Option of prctl (linux/prctl.h)."""


class Keeper:
    """A process that ends this process's programs if this one is killed.

    It starts with the first program. Any thread may use it. Close it at the end, when no watched program
    runs.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()

    def watch(self, mark: str, pid: int = -1) -> None:
        """Watch a program with this mark; its process ID is -1 until it is known. Raises OSError."""
        self._tell(f"{mark} {pid}\n")

    def adopt(self, mark: str, pid: int, started: int) -> None:
        """Note an adopted process of a program, with its start time. Raises OSError."""
        self._tell(f"{mark} {pid} {started}\n")

    def forget(self, mark: str) -> None:
        """Stop watching: all processes of the program have ended."""
        if self._process is not None:
            self._tell(f"{mark}\n")

    def close(self) -> None:
        with self._lock:
            self._end()

    def _tell(self, line: str) -> None:
        with self._lock:
            try:
                self._write(line)
            except BrokenPipeError:  # it was killed
                self._end()
                self._write(line)

    def _write(self, line: str) -> None:
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", keeper.__file__],
                env={**os.environ, MARK: KEEPER},
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd="/",
                start_new_session=True,  # Ctrl-C in our terminal must not end it
            )
        assert self._process.stdin is not None, "it is a pipe"
        if sys.platform != "win32":  # no keeper is running
            os.set_blocking(self._process.stdin.fileno(), False)  # a stopped keeper reads no more
        self._process.stdin.write(line.encode())

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


class KeptProcess:
    """A child of this process that a keeper watches."""

    def __init__(
        self,
        words: Sequence[str],
        environment: Mapping[str, str],
        folder: Path | None,
        shared: Keeper | None,
        route: OutputRoute,
        *,
        has_input: bool,
        adopts: bool,
    ) -> None:
        """Start it in a folder, by default the working directory; call `end` when it is over. Raises OSError.

        Its output takes its `route`. Its input is ours if it `has_input`. Without a `shared` keeper it has
        one of its own. With `adopts` this process adopts the processes that it leaves behind.
        """
        # Not with the module secrets, whose import takes time.
        self._mark = os.urandom(8).hex()
        self._adoption = Adoption(self._mark) if adopts else None
        self._lock = threading.Lock()
        self._has_ended = False
        self._owns_keeper = shared is None
        self._keeper = shared or Keeper()
        self._keeper.watch(self._mark)  # before its start: we may be killed at any moment
        try:
            self._process = subprocess.Popen(
                words,
                env={**environment, MARK: self._mark},
                cwd=folder,
                stdin=None if has_input else subprocess.DEVNULL,
                stdout=route.stdout,
                stderr=route.stderr,
                start_new_session=True,  # Ctrl-C in our terminal is for us; we then end the program
            )
        except OSError:
            self._release()
            raise
        self._keeper.watch(self._mark, self._process.pid)
        if self._adoption is not None:
            self._adoption.begin(self._process.pid)

    @property
    def pid(self) -> int:
        """Its process ID."""
        return self._process.pid

    def wait(self) -> int:
        """Wait for the program's end. Returns its exit code, or the negative number of the signal that ended
        it."""
        if self._adoption is not None:
            self._adoption.reap_until_end(partial(self._keeper.adopt, self._mark))
        return self._process.wait()

    def end(self) -> None:
        """End the program and everything it started, first by SIGTERM. Any thread may call it, repeatedly."""
        with self._lock:
            if self._has_ended:
                return
            self._has_ended = True
            if self._adoption is None:
                keeper.end_all(self._mark, self._process.pid)
            elif not self._adoption.nothing_left():
                keeper.end_all(self._mark, self._process.pid, self._adoption.living)
            self._release()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_LAST_WAIT)

    def _release(self) -> None:
        if self._adoption is not None:
            self._adoption.end()
        self._keeper.forget(self._mark)
        if self._owns_keeper:
            self._keeper.close()


class Adoption:
    """Adopts processes that a program leaves behind without a mark, from before its start until `end`. Does
    nothing except on Linux.

    A process whose parent has ended goes to the nearest ancestor that asked for it (PR_SET_CHILD_SUBREAPER,
    prctl(2)), otherwise to the system's first process. Some processes clear their environment, begin a
    session of their own and lose their parent. They are still known: they are children of this process that
    it did not start. This works only in a process that runs one program at a time, and nothing else.
    """

    def __init__(self, mark: str) -> None:
        """`mark` is that of the program (`MARK`)."""
        self._mark = mark.encode()
        self._program = 0
        self._since = 0
        self._is_on = _adopt(is_on=True)

    def begin(self, program: int) -> None:
        """Note the program's process ID and start time."""
        with contextlib.suppress(OSError):  # no /proc: `living` will find nothing there either
            self._program, self._since = program, int(stat_of(program)[StatField.STARTED])

    def reap_until_end(self, note: Callable[[int, int], None]) -> None:
        """Reap adopted processes of the program's session until the program has ended. Otherwise those of a
        sound in each turn (`aplay a.wav &`) would fill the system's table of processes.

        `note` is called with process ID and start time of each one without a mark: if we are killed, nobody
        adopts them any more.
        """
        if sys.platform != "linux" or not self._is_on:
            return
        try:
            descriptor = os.pidfd_open(self._program)
        except OSError:  # it has been waited for already, or Linux is older than 5.3
            return
        noted: set[tuple[int, int]] = set()
        try:
            ending = select.poll()
            ending.register(descriptor, select.POLLIN)
            while not ending.poll(_REAP_INTERVAL * 1000):
                self._reap()
                living = set(self._adopted()[0].items())
                with contextlib.suppress(OSError):  # the keeper does not read: tried again
                    for pid, started in living - noted:
                        note(pid, started)
                    noted = living
        finally:
            os.close(descriptor)

    def _reap(self) -> None:
        for pid in children():
            with contextlib.suppress(OSError):  # it has been reaped meanwhile
                fields = stat_of(pid)
                is_own = pid == self._program or int(fields[StatField.SESSION]) != self._program
                if sys.platform != "win32" and fields[StatField.STATE] == b"Z" and not is_own:
                    os.waitpid(pid, os.WNOHANG)

    def nothing_left(self) -> bool:
        """True if the keeper is the only child of this process: all that the program started has ended.

        The check takes some microseconds; a search of all processes takes milliseconds.
        """
        try:
            return self._is_on and [_mark_of(pid) for pid in children()] == [KEEPER.encode()]
        except OSError:
            return False

    def living(self) -> set[int]:
        """Adopted processes that live. Ended ones are reaped."""
        if sys.platform == "win32":
            raise NotImplementedError  # there is no such thing on Windows
        found, ended = self._adopted()
        for pid in ended:
            with contextlib.suppress(ChildProcessError):
                os.waitpid(pid, os.WNOHANG)
        return set(found)

    def _adopted(self) -> tuple[dict[int, int], list[int]]:
        """Adopted processes that live, with their start times, and those that have ended."""
        if sys.platform == "win32":
            raise NotImplementedError  # there is no such thing on Windows
        found: dict[int, int] = {}
        others, ended = [], []
        for pid in children():
            try:
                fields = stat_of(pid)
                started = int(fields[StatField.STARTED])
                if pid == self._program or int(fields[StatField.SESSION]) == os.getsid(0):
                    continue
                if fields[StatField.STATE] == b"Z":
                    ended.append(pid)
                    continue
                mark = _mark_of(pid)
            except OSError:
                continue  # it has ended meanwhile, or is another user's
            if mark is None:
                found[pid] = started
            elif mark not in (self._mark, KEEPER.encode()):
                others.append(started)  # another program of ours: processes started after it may be its own
        first = min(others, default=sys.maxsize)
        own = {
            pid: started for pid, started in found.items() if self._program and self._since <= started < first
        }
        return own, [] if others else ended

    def end(self) -> None:
        """Stop adopting."""
        _adopt(is_on=False)


def _adopt(*, is_on: bool) -> bool:
    """Start or stop adopting; True if the system supports it."""
    if not platform_has.LINUX:
        return False
    import ctypes  # numpy has imported it already

    return bool(ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, int(is_on), 0, 0, 0) == 0)


def _mark_of(pid: int) -> bytes | None:
    """Mark of the program that started a process, if its environment has one. Raises OSError."""
    variable, path = f"{MARK}=".encode(), Path(f"/proc/{pid}/environ")
    variables = path.read_bytes().split(b"\0")
    # A process that has just been started has none for a moment, until Linux has set its stack up.
    looks = 0
    while variables == [b""] and looks < _LOOKS:
        time.sleep(0.001)
        variables, looks = path.read_bytes().split(b"\0"), looks + 1
    return next((each[len(variable) :] for each in variables if each.startswith(variable)), None)
