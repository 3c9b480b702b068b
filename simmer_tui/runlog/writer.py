"""Writes a run log during the run."""

from __future__ import annotations

import contextlib
import math
import os
import stat
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import chain, count
from pathlib import Path
from typing import Protocol

from msgspec import Struct

from simmer_tui import platform_has
from simmer_tui.config.loader import Configuration
from simmer_tui.errors import RunLogError, reason_of
from simmer_tui.run.events import CommandResult, Event, Notice, NoticeKind
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.runlog.closing import Closing
from simmer_tui.runlog.encode import LogEncoder
from simmer_tui.runlog.header import TakenOver, header_of
from simmer_tui.runlog.line_form import logged_pose
from simmer_tui.runlog.log_records import encode_line
from simmer_tui.runlog.run_command import RunCommand
from simmer_tui.sim.command import typed_path
from simmer_tui.sim.simulator import Simulator
from simmer_tui.whole_file import NOT_OVERWRITTEN

# A log has a program's output and, in a mission, the data for grades: other users never write it.
MODE = 0o644
"""Permissions of a new log, which the umask narrows further."""
AUTO = "auto"
"""Stands for a file named by date in the user's data folder."""
LOG, PACKED = ".jsonl", ".gz"
"""Endings of the name of a log, and of a compressed one behind it."""
# Each check is a system call, as the write of a line is.
LOOK_EVERY = 100
"""Lines after which the file is checked: it may have been deleted or cut."""
# Each flush adds bytes and restarts the compression's statistics.
FLUSH_EVERY = 64
"""Lines of a compressed log that a crash may lose."""
# A seek in a replay reads back to one of these: 500 lines take about 5 ms.
CHECKPOINT_EVERY = 500
"""Lines after which a checkpoint is written: reading can begin there."""


def auto_path(now: datetime | None = None) -> Path:
    """Make an empty file, named by date, in the user's data folder.

    It exists at once, so that runs that start in the same second get one each. Raises RunLogError.
    """
    # Not in the working directory, which may be temporary.
    folder = platform_has.data_folder() / "logs"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return new_file(folder, now)
    except OSError as error:
        shown = str(error.filename or folder)
        raise RunLogError(f"{shown} cannot be made: {reason_of(error)}") from None


def moment_name(now: datetime | None = None) -> str:
    """A name by date and time that sorts by them."""
    return f"{now or datetime.now():%Y-%m-%d_%H-%M-%S}"


def new_folder(place: Path, prefix: str, now: datetime | None = None) -> Path:
    """A folder in a place that is not there yet, named by date, with a number if that is taken."""
    name = f"{prefix}{moment_name(now)}"
    names = (name if copy == 1 else f"{name}_{copy}" for copy in count(1))
    return next(path for path in (place / each for each in names) if not path.exists())


def new_file(folder: Path, now: datetime | None = None, mode: int = MODE) -> Path:
    """Make an empty log in a folder, named by date, with a number if there is one already. Raises OSError."""
    name = moment_name(now)
    for copy in count(1):
        path = folder / (f"{name}{LOG}" if copy == 1 else f"{name}_{copy}{LOG}")
        with contextlib.suppress(FileExistsError):
            path.touch(mode, exist_ok=False)
            break
    return path


class LineFile(Protocol):
    """The file of a log, written line by line. Every method may raise OSError."""

    def write(self, data: bytes) -> None: ...

    def look(self) -> None:
        """Check that the file still has all written data."""

    def close(self) -> None: ...


@dataclass(slots=True)
class ReplayedPrefix:
    """The part of another run that a log begins with, and how far its replay is: `real_time` (seconds since
    that log began), simulated `time`, and the number of `commands` begun by then. Once the replay is `over`,
    real time continues from there.

    The code that replays the prefix updates this.
    """

    origin: TakenOver
    begun: float
    """Beginning of the other run, seconds since 1970."""
    real_time: float = 0.0
    time: float = 0.0
    commands: int = 0
    over_since: float | None = None

    def __str__(self) -> str:
        return f"taken over {self.origin}: what comes now is new"

    @property
    def over(self) -> bool:
        return self.over_since is not None

    def clock(self) -> float:
        """Seconds since 1970, as if the prefix had just happened."""
        # While the prefix is replayed its own times count, not those of the replay.
        since = 0.0 if self.over_since is None else time.monotonic() - self.over_since
        return self.begun + self.real_time + since

    def end(self) -> None:
        """All events from here on are new."""
        self.over_since = time.monotonic()


def steady_clock() -> Callable[[], float]:
    """A clock that gives seconds since 1970 and runs evenly: the system's clock may be set back."""
    offset = time.time() - time.monotonic()
    return lambda: offset + time.monotonic()


class RunLog(Closing):
    """A watcher that appends each event to a file, with one write a line and no buffer.

    Make it and call it in the robot's thread, since it reads the simulator's time. If a write fails the run
    continues without a log: `stopped` holds the reason, and `on_stop` is called with it once.
    """

    def __init__(
        self,
        path: Path,
        configuration: Configuration,
        simulator: Simulator,
        *,
        mission: bool = False,
        on_stop: Callable[[str], None] = lambda why: None,
        clock: Callable[[], float] | None = None,
        file: Callable[[Path], LineFile] | None = None,
        prefix: ReplayedPrefix | None = None,
        run: RunCommand | None = None,
        sketches: Mapping[str, str] | None = None,
    ) -> None:
        """Write the header. An existing file is never overwritten. `file` opens it, by default by the
        ending of its name. The events of a `prefix` come first. `run` is the command of the run's program,
        `sketches` are those of its boards. Raises RunLogError."""
        self.path = path
        self.stopped = ""
        """Reason why writing has stopped, or empty."""
        self.lines = 0
        """Lines written, the header included."""
        self._simulator = simulator
        # A failure of the header is raised, not reported by `on_stop`: it is set at the end.
        self._on_stop: Callable[[str], None] = lambda why: None
        self._prefix = prefix
        self._clock = clock = prefix.clock if prefix is not None else clock or steady_clock()
        shown = str(path)
        try:
            self._file: LineFile = (file or _opened)(path)
        except OSError as error:
            why = reason_of(error)
            if path.is_dir():
                why = f"it is a folder; name a file in it, --log {typed_path(path / f'run{LOG}')}"
            raise RunLogError(f"cannot log to {shown}: {why}") from None
        except ValueError as error:  # a NUL in the name
            raise RunLogError(f"cannot log to {shown}: {error}") from None
        self._encoder = LogEncoder(logged_pose(simulator.pose), lambda: self._present)
        self._reducer = Reducer(checkpoint_of(simulator, mission=mission))
        self._last_checkpoint = 0
        self._begun = clock()
        now = datetime.fromtimestamp(self._begun).astimezone()
        taken_over = None if prefix is None else prefix.origin
        self._write(header_of(configuration, simulator, now, mission, taken_over, run, sketches))
        if self.stopped:
            raise RunLogError(self.stopped)
        self._on_stop = on_stop

    def apply(self, event: Event, line: int = 0, real_time: float = math.nan) -> None:
        """Append one event; `real_time` is that of `time.monotonic`, if it came before."""
        if self.stopped or (isinstance(event, Notice) and event.kind is NoticeKind.HINT):
            return
        # Before the record: a checkpoint is to hold the state with this event.
        self._reducer.apply(event)
        now = self._clock() - self._begun
        if real_time == real_time and not self._is_replaying:
            now = max(now - (time.monotonic() - real_time), 0.0)
        self._write(*self._encoder.records(event, now))
        if self.lines - self._last_checkpoint >= CHECKPOINT_EVERY:
            self._write_checkpoint(now)

    __call__ = apply

    def apply_readings(
        self, results: Sequence[CommandResult], lines: Sequence[int], real_times: Sequence[float]
    ) -> None:
        """Append readings that follow each other, in one write."""
        if self.stopped:
            return
        self._reducer.apply_readings(results, lines, real_times)
        now, records = self._clock() - self._begun, self._encoder.records
        moments: Sequence[float] = [now] * len(results)
        if not self._is_replaying:
            # The log's time at the zero of `time.monotonic`.
            zero = now - time.monotonic()
            moments = [zero + moment for moment in real_times]
        each_of = (records(result, moment) for result, moment in zip(results, moments, strict=True))
        self._write(*chain.from_iterable(each_of))
        if self.lines - self._last_checkpoint >= CHECKPOINT_EVERY:
            self._write_checkpoint(moments[-1])

    @property
    def _is_replaying(self) -> bool:
        """True while the events are of a replayed part, whose clock stands still between them."""
        return self._prefix is not None and not self._prefix.over

    def _write_checkpoint(self, real_time: float) -> None:
        # Only where nothing is under way: a reader that begins there knows no movement before it.
        if self._reducer.still:
            self._last_checkpoint = self.lines
            self._write(self._encoder.checkpoint(self._reducer.checkpoint(), real_time))

    @property
    def _present(self) -> tuple[int, float]:
        """Commands begun so far, and simulated time."""
        prefix = self._prefix
        if prefix is not None and not prefix.over:
            return prefix.commands, prefix.time
        return self._simulator.commands, self._simulator.time

    def close(self) -> None:
        """Stop writing. May be called more than once."""
        self._write(*self._encoder.rest(self._clock() - self._begun))
        try:
            if not self.stopped:
                self._file.look()
        except OSError as error:
            self._stop(error)
        self.stopped = self.stopped or "the log is closed"
        try:
            self._file.close()
        except OSError as error:  # while writing the rest of a compressed log
            self._stop(error)

    def _write(self, *records: Struct) -> None:
        if self.stopped or not records:
            return
        try:
            self._file.write(b"".join(map(encode_line, records)))
            looked = self.lines // LOOK_EVERY
            self.lines += len(records)
            if self.lines // LOOK_EVERY > looked:
                self._file.look()
        except OSError as error:
            with contextlib.suppress(OSError):  # it is the file that has failed
                self._file.close()
            self._stop(error)

    def _stop(self, error: OSError) -> None:
        self.stopped = f"logging to {self.path} has stopped: {reason_of(error)}"
        self._on_stop(self.stopped)


def _opened(path: Path) -> LineFile:
    return _PackedFile(path) if path.suffix == PACKED else _LogFile(path)


class _LogFile:
    """A file that is only appended to."""

    def __init__(self, path: Path) -> None:
        """Open a new or empty file, or something else that can be written (a pipe). Raises OSError."""
        # Unbuffered, by descriptor: a line is in the file when the write returns, whatever ends the process.
        flags = os.O_WRONLY | os.O_APPEND | getattr(os, "O_BINARY", 0)
        try:
            self._descriptor = os.open(path, flags | os.O_CREAT | os.O_EXCL, MODE)
        except FileExistsError:
            # An empty file has been made by `auto_path`, or by mktemp: nothing is lost with it.
            if path.is_file() and path.stat().st_size > 0:
                raise FileExistsError(0, f"{NOT_OVERWRITTEN}; name another file, or auto") from None
            self._descriptor = _existing(path, flags)
        # A pipe or a device has neither a size nor a lock to look at.
        self._plain = stat.S_ISREG(os.fstat(self._descriptor).st_mode)
        # Two runs that append to one file would mix their lines.
        if self._plain and not _locked(self._descriptor):
            os.close(self._descriptor)
            raise FileExistsError(0, "another run is writing it; name another file, or auto")
        self._size = 0
        self._closed = False

    def write(self, data: bytes) -> None:
        """Append. Raises OSError."""
        written = os.write(self._descriptor, data)
        if written != len(data):  # the disk took a part: the next write gives the reason
            os.write(self._descriptor, data[written:])
            raise OSError("only a part of the last line could be written")
        self._size += len(data)

    def look(self) -> None:
        """Raise OSError if the file has lost written data."""
        if not self._plain:
            return
        found = os.fstat(self._descriptor)
        # Writes to a deleted file succeed: only this check shows it.
        if found.st_nlink == 0:
            raise OSError("the file has been deleted")
        if found.st_size < self._size:
            raise OSError(f"the file has been cut to {found.st_size} bytes; {self._size} were written")

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            os.close(self._descriptor)


def _existing(path: Path, flags: int) -> int:
    """Open an existing path, but no file through a link: in a folder of other users it may lead anywhere."""
    try:
        return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0))
    except OSError:
        if not path.is_symlink():
            raise
    descriptor = os.open(path, flags)
    # /dev/stdout is a link too, and leads to a terminal or a pipe.
    if stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise FileExistsError(0, "it is a link to a file, which is not written through; name the file itself")
    return descriptor


def _locked(descriptor: int) -> bool:
    """True if this run alone has the file, or if the system cannot tell."""
    try:
        platform_has.lock_alone(descriptor)
    except BlockingIOError:
        return False
    return True


class _PackedFile(_LogFile):
    """A compressed file. A line can be read back after at most `FLUSH_EVERY` more."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        # Level 6 is zlib's usual one; 16 asks for gzip's header, so that gunzip reads the file.
        self._packer = zlib.compressobj(6, zlib.DEFLATED, 16 + zlib.MAX_WBITS)
        self._unflushed = 0

    def write(self, data: bytes) -> None:
        packed = self._packer.compress(data)
        self._unflushed += 1
        if self._unflushed >= FLUSH_EVERY:
            self._unflushed = 0
            # A sync flush ends on a byte, so what is written can be unpacked without the rest.
            packed += self._packer.flush(zlib.Z_SYNC_FLUSH)
        # Most lines only fill the packer: an empty write would cost a system call.
        if packed:
            super().write(packed)

    def close(self) -> None:
        if not self._closed:
            try:
                super().write(self._packer.flush())
            finally:
                super().close()
