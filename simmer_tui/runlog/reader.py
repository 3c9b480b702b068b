"""Reads a run log from beginning to end, one line in memory at a time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import IO

from simmer_tui.errors import RunLogError
from simmer_tui.runlog.entries import ActionEntry, BrokenEntry, Entry, parse_entry
from simmer_tui.runlog.header import Header, parse_header
from simmer_tui.sim.command import escape

MAX_LINE = 16 * 1024 * 1024
"""Longest line that is taken for one, bytes."""


class LogReader:
    """The header and then the lines of a log, each a typed entry.

    A broken line comes as a `BrokenEntry`. A last line without its end, as a crash leaves it, is
    left out, and `note` says so afterwards.
    """

    def __init__(self, path: Path) -> None:
        """Open a log and read its header. Raises RunLogError."""
        self.path = path
        self.shown = escape(str(path), 200)
        self.note = ""
        self.position = 0
        """Bytes read so far."""
        self._line = 1
        self._file = open_log(path, self.shown)
        try:
            self.size = path.stat().st_size
            self.header = read_header(self._file, self.shown)
        except OSError as error:
            self._file.close()
            raise RunLogError(f"{self.shown} cannot be read: {error.strerror or error}") from None
        except RunLogError:
            self._file.close()
            raise
        self.position = self._file.tell()

    def __iter__(self) -> Iterator[Entry]:
        return self

    def __next__(self) -> Entry:
        data = self._file.readline(MAX_LINE)
        if not data:
            raise StopIteration
        self._line += 1
        if not data.endswith(b"\n"):
            if len(data) == MAX_LINE:
                self._skip_line()
                return BrokenEntry(self._line, f"it is longer than {MAX_LINE} bytes")
            self.note = torn_note(self._line)
            raise StopIteration
        self.position += len(data)
        return parse_entry(data, self._line)

    def _skip_line(self) -> None:
        data = b" "
        while data and not data.endswith(b"\n"):
            data = self._file.readline(MAX_LINE)
        self.position = self._file.tell()

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> LogReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_log(path: Path, shown: str) -> IO[bytes]:
    """The file of a log, for reading. Raises RunLogError."""
    try:
        return path.open("rb")
    except FileNotFoundError:
        raise RunLogError(f"{shown}: there is no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise RunLogError(f"{shown} cannot be read: {reason}") from None


def read_header(file: IO[bytes], shown: str) -> Header:
    """Read the first line. Raises RunLogError."""
    line = file.readline(MAX_LINE)
    if not line:
        raise RunLogError(f"{shown} is empty, not a run log")
    if not line.endswith(b"\n") and len(line) < MAX_LINE and line.startswith(b'{"t":'):
        raise RunLogError(f"{shown} is cut off within its first line; nothing can be made of it")
    return parse_header(line, shown)


def torn_note(line: int) -> str:
    """What to say of a last line without its end."""
    return f"line {line}, the last, is cut off and was skipped"


class ElapsedTime:
    """Simulated time since a log's beginning that goes on through resets and never back."""

    def __init__(self, begin: float) -> None:
        self.before = -begin
        """What to add to the `t` of the present stretch, between two resets."""
        self.now = 0.0

    def advance(self, entry: Entry) -> float:
        """The elapsed time of the next entry."""
        if isinstance(entry, BrokenEntry):
            return self.now
        if isinstance(entry, ActionEntry) and entry.restarts:
            self.before = self.now - entry.t
        self.now = max(self.now, self.before + entry.t)
        return self.now
