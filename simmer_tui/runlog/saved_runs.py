"""The runs that the app saves by itself: the present one and those before it.

A saved run is an ordinary run log in the user's data folder, which only the user can read. A thread
of its own writes it, so that a slow or full disk never delays the robot.
"""

from __future__ import annotations

import contextlib
import math
import os
import threading
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path

from simmer_tui import platform_has
from simmer_tui.errors import RunLogError, reason_of
from simmer_tui.run.events import ActionDone, CommandResult, Event, MovementPlanned
from simmer_tui.runlog.writer import LOG, LineFile, RunLog, new_file

BEFORE = 10
"""Runs saved beside the present one."""
MEGABYTE = 1024 * 1024
# At 165 bytes a command, 64 MB are 400,000 commands: nearly four hours at 30 commands a second.
LARGEST_RUN = 64 * MEGABYTE
"""Size limit of one run, bytes; later events are not saved."""
ALL_TOGETHER = 256 * MEGABYTE
"""Size limit of all runs together, bytes."""
UNWRITTEN = 8 * MEGABYTE
"""Size limit of data that waits for a slow disk, bytes."""
# A crash loses this much of a run; one write a line would cost a system call each.
GATHER = 0.25
"""Time over which lines are collected for one write, seconds."""
# The user waits for these: long enough for a disk that works, short for one that hangs.
_CLOSING = 0.3
"""Time limit for the rest of a run when it ends, seconds."""
_FLUSHING = 1.0
"""Time limit of `flush`, seconds."""


def saved_runs_folder() -> Path:
    """The folder of saved runs, in the user's data folder."""
    return platform_has.data_folder() / "runs"


def last_run(folder: Path | None = None) -> Path:
    """The saved run that was written last. Raises RunLogError if there is none."""
    folder = folder or saved_runs_folder()
    runs = saved_runs(folder)
    if not runs:
        raise RunLogError(
            f"no run is saved in {folder} yet. The app saves its runs there; "
            "a run without a screen is logged only with --log: name that file"
        )
    return runs[-1]


def make_room(folder: Path) -> None:
    """Delete the oldest runs beyond the limits, with room for one more. Raises OSError if the folder
    cannot be made."""
    # Only for the user: a run holds a program's output.
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    # The present run may grow to this.
    total = LARGEST_RUN
    for number, path in enumerate(reversed(saved_runs(folder)), 1):
        with contextlib.suppress(OSError):  # another app deleted it, or writes it (Windows)
            total += path.stat().st_size
            if number > BEFORE or total > ALL_TOGETHER:
                path.unlink()


def saved_runs(folder: Path) -> list[Path]:
    """The saved runs, in the order in which they were written."""
    found = []
    for path in folder.glob(f"*{LOG}"):
        with contextlib.suppress(OSError):  # deleted meanwhile
            # By time of writing, not by name: the clock may have been set back, and names are local time.
            found.append((path.stat().st_mtime_ns, path))
    return [path for _, path in sorted(found)]


class SavedRun:
    """Saves the present run. Make and call it in the robot's thread, or before that starts."""

    def __init__(
        self, log_to: Callable[[Path, Callable[[Path], LineFile]], RunLog], folder: Path | None = None
    ) -> None:
        """Make room, and begin the log that `log_to` makes, of a path and the function that opens it. Raises
        RunLogError."""
        folder = folder or saved_runs_folder()
        self._used = False
        try:
            make_room(folder)
            # For the user only, whatever the umask is.
            path = new_file(folder, mode=0o600)
        except OSError as error:
            shown = str(folder)
            raise RunLogError(f"runs cannot be saved in {shown}: {reason_of(error)}") from None
        self._file: _BackgroundFile | None = None
        self._log = log_to(path, self._open)

    def _open(self, path: Path) -> _BackgroundFile:
        self._file = _BackgroundFile(path)
        return self._file

    @property
    def path(self) -> Path:
        """The run's file."""
        return self._log.path

    def apply(self, event: Event, line: int = 0, real_time: float = math.nan) -> None:
        """Save one event."""
        # Notices alone (a client came and left) make no run worth keeping.
        self._used = self._used or isinstance(event, CommandResult | ActionDone | MovementPlanned)
        self._log.apply(event, line, real_time)

    def apply_readings(
        self, results: Sequence[CommandResult], lines: Sequence[int], real_times: Sequence[float]
    ) -> None:
        """Save readings that follow each other."""
        self._used = True
        self._log.apply_readings(results, lines, real_times)

    def flush(self) -> None:
        """Wait until all events so far are in the file, for a second at most. Any thread."""
        if self._file is not None:
            self._file.flush()

    def close(self) -> None:
        """Save no more. A run without commands and actions is deleted."""
        self._log.close()
        if self._file is not None:
            self._file.wait()
        if not self._used:
            with contextlib.suppress(OSError):
                self.path.unlink()


class _BackgroundFile:
    """A file of bounded size that a thread writes, so that `write` never waits for the disk."""

    def __init__(self, path: Path) -> None:
        """Write to a new, empty file. Raises OSError."""
        # Made by `new_file` a moment ago: a link in its place is somebody else's.
        flags = os.O_WRONLY | os.O_APPEND | getattr(os, "O_BINARY", 0) | getattr(os, "O_NOFOLLOW", 0)
        self._descriptor = os.open(path, flags)
        self._given = 0
        self._written = 0
        self._pieces: deque[bytes] = deque()
        self._error: OSError | None = None
        self._closing = False
        self._come = threading.Event()
        self._hurry = threading.Event()
        self._settled = threading.Condition()
        # A daemon: a disk that hangs must not keep the process from ending.
        self._thread = threading.Thread(target=self._run, name="saved run", daemon=True)
        self._thread.start()

    def write(self, data: bytes) -> None:
        """Queue bytes. Raises OSError if the disk failed before, or if a size limit is reached."""
        if self._error is not None:
            raise self._error
        if self._given + len(data) > LARGEST_RUN:
            raise OSError(f"it has reached {LARGEST_RUN // MEGABYTE} MB, the most that is saved of a run")
        # Memory must not grow with a disk that hangs.
        if self._given - self._written > UNWRITTEN:
            raise OSError("the disk is too slow")
        self._given += len(data)
        self._pieces.append(data)
        # A check is cheaper than setting, which takes a lock; most lines come while it is set.
        if not self._come.is_set():
            self._come.set()

    def look(self) -> None:
        """Accept a deleted file: other apps make room too."""

    def flush(self) -> None:
        """Wait until all bytes so far are written, for a second at most."""
        self._hurry.set()
        self._come.set()
        with self._settled:
            given = self._given
            self._settled.wait_for(lambda: self._written >= given or self._error is not None, _FLUSHING)

    def close(self) -> None:
        """Begin to write the rest; `wait` waits for it."""
        self._closing = True
        self._hurry.set()
        self._come.set()

    def wait(self) -> None:
        """Wait until the rest is written, briefly: the disk may hang."""
        self._thread.join(_CLOSING)

    def _run(self) -> None:
        try:
            while not self._closing or self._pieces:
                self._come.wait()
                self._hurry.wait(GATHER)
                self._hurry.clear()
                self._come.clear()
                self._write_all()
        except OSError as error:
            self._error = error
        finally:
            with contextlib.suppress(OSError):  # the failure has been reported
                os.close(self._descriptor)
            with self._settled:
                self._settled.notify_all()

    def _write_all(self) -> None:
        while self._pieces:
            # The robot's thread appends meanwhile: only those that are there now are taken.
            count = len(self._pieces)
            data = memoryview(b"".join(self._pieces.popleft() for _ in range(count)))
            while data:
                written = os.write(self._descriptor, data)
                data = data[written:]
                self._written += written
        with self._settled:
            self._settled.notify_all()
