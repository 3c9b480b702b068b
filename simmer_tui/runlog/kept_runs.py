"""The runs of the app that are kept without being asked for: the present one and those before it.

A kept run is a run log like any other, in the user's data folder, readable for nobody else. A thread
of its own writes it, so that a slow or full disk is never in the robot's way.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections import deque
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import platformdirs

from simmer_tui.config.loader import Configuration
from simmer_tui.errors import RunLogError
from simmer_tui.events import ActionDone, CommandResult, Event, MovementPlanned
from simmer_tui.runlog.writer import Past, RunLog
from simmer_tui.sim.command import escape
from simmer_tui.sim.simulator import Simulator

BEFORE = 10
"""Runs kept beside the present one."""
MEGABYTE = 1024 * 1024
LARGEST = 64 * MEGABYTE
"""Bytes of one run; what comes after is not kept."""
ALL_TOGETHER = 256 * MEGABYTE
"""Bytes of all runs together."""
UNWRITTEN = 8 * MEGABYTE
"""Bytes that may wait for a slow disk."""
GATHER = 0.25
"""Seconds in which what is to be written is gathered; a crash takes that much away."""
_CLOSING = 0.3
"""Seconds the disk has for the rest when a run ends."""
_FLUSHING = 1.0


def kept_folder() -> Path:
    """Where runs are kept, in the user's data folder."""
    return platformdirs.user_data_path("simmer-tui", appauthor=False) / "runs"


def last_run(folder: Path | None = None) -> Path:
    """The run that was written last. Raises RunLogError if there is none."""
    folder = folder or kept_folder()
    runs = _runs(folder)
    if not runs:
        raise RunLogError(
            f"no run is kept in {escape(str(folder), 200)} yet: the app keeps its runs there, "
            "runs without a screen only with --log; name a file written with --log"
        )
    return runs[-1]


def make_room(folder: Path) -> None:
    """Delete the oldest runs beyond those that are kept, and leave room for one more. Raises OSError
    if the folder cannot be made."""
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    total = LARGEST
    for number, path in enumerate(reversed(_runs(folder)), 1):
        with contextlib.suppress(OSError):  # another app has deleted it, or writes to it (Windows)
            total += path.stat().st_size
            if number > BEFORE or total > ALL_TOGETHER:
                path.unlink()


def _runs(folder: Path) -> list[Path]:
    """The kept runs, the one written last at the end."""
    found = []
    for path in folder.glob("*.jsonl"):
        with contextlib.suppress(OSError):  # deleted meanwhile
            found.append((path.stat().st_mtime_ns, path))
    return [path for _, path in sorted(found)]


class KeptRun:
    """A watcher that keeps the present run. To be made and called in the robot's thread, or before it
    starts."""

    def __init__(
        self,
        configuration: Configuration,
        simulator: Simulator,
        *,
        mission: bool = False,
        folder: Path | None = None,
        on_stop: Callable[[str], None] = lambda why: None,
        past: Past | None = None,
    ) -> None:
        """Make room for it and begin, with a `past` where there is one. `on_stop` is told once, in words,
        if it cannot go on. Raises RunLogError."""
        folder = folder or kept_folder()
        self._used = False
        try:
            make_room(folder)
        except OSError as error:
            shown = escape(str(folder), 200)
            raise RunLogError(f"runs cannot be kept in {shown}: {error.strerror or error}") from None
        self._file: KeptFile | None = None
        self._log = RunLog(
            _free_path(folder),
            configuration,
            simulator,
            mission=mission,
            on_stop=on_stop,
            file=self._open,
            past=past,
        )

    def _open(self, path: Path) -> KeptFile:
        self._file = KeptFile(path)
        return self._file

    @property
    def path(self) -> Path:
        """The file it is kept in."""
        return self._log.path

    def __call__(self, event: Event) -> None:
        """Keep one event."""
        self._used = self._used or isinstance(event, CommandResult | ActionDone | MovementPlanned)
        self._log(event)

    def flush(self) -> None:
        """Wait until what has been told so far is in the file, for a second at most. Any thread."""
        if self._file is not None:
            self._file.flush()

    def close(self) -> None:
        """Keep no more. A run in which nothing was done is not kept at all."""
        self._log.close()
        if self._file is not None:
            self._file.wait()
        if not self._used:
            with contextlib.suppress(OSError):
                self.path.unlink()


def _free_path(folder: Path) -> Path:
    """A file of this second, or beside it that of another app."""
    name = f"{datetime.now():%Y-%m-%d_%H-%M-%S}"
    return folder / (
        f"{name}.jsonl" if not (folder / f"{name}.jsonl").exists() else f"{name}_{os.getpid()}.jsonl"
    )


class KeptFile:
    """A file of bounded size that a thread writes; whoever gives it bytes never waits for the disk."""

    def __init__(self, path: Path) -> None:
        """A new file. Raises OSError."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_EXCL | getattr(os, "O_BINARY", 0)
        self._descriptor = os.open(path, flags, 0o600)
        self._given = 0
        self._written = 0
        self._pieces: deque[bytes] = deque()
        self._error: OSError | None = None
        self._closing = False
        self._come = threading.Event()
        self._hurry = threading.Event()
        self._settled = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="kept run", daemon=True)
        self._thread.start()

    def write(self, data: bytes) -> None:
        """Have bytes written soon. Raises OSError if the disk did not take some before, or if it is
        enough."""
        if self._error is not None:
            raise self._error
        if self._given + len(data) > LARGEST:
            raise OSError(f"it has reached {LARGEST // MEGABYTE} MB, the most that is kept of a run")
        if self._given - self._written > UNWRITTEN:
            raise OSError("the disk is too slow")
        self._given += len(data)
        self._pieces.append(data)
        if not self._come.is_set():
            self._come.set()

    def look(self) -> None:
        """It may be deleted: others make room too."""

    def flush(self) -> None:
        """Wait until all that was given is written, for a second at most."""
        self._hurry.set()
        self._come.set()
        with self._settled:
            given = self._given
            self._settled.wait_for(lambda: self._written >= given or self._error is not None, _FLUSHING)

    def close(self) -> None:
        """Have the rest written; `wait` waits for it."""
        self._closing = True
        self._hurry.set()
        self._come.set()

    def wait(self) -> None:
        """Wait until the rest is written; a disk that hangs keeps nobody for long."""
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
            with contextlib.suppress(OSError):  # what failed has been told
                os.close(self._descriptor)
            with self._settled:
                self._settled.notify_all()

    def _write_all(self) -> None:
        while self._pieces:
            count = len(self._pieces)
            data = memoryview(b"".join(self._pieces.popleft() for _ in range(count)))
            while data:
                written = os.write(self._descriptor, data)
                data = data[written:]
                self._written += written
        with self._settled:
            self._settled.notify_all()
