"""Reads a run log from beginning to end, one line in memory at a time, as the events it tells of."""

from __future__ import annotations

import tempfile
import zlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import IO, cast

from msgspec import Struct

from simmer_tui.config.loader import Configuration
from simmer_tui.errors import RunLogError
from simmer_tui.events import Event
from simmer_tui.run.reducer import Reducer
from simmer_tui.runlog.decode import Decoder
from simmer_tui.runlog.entries import BrokenLine, Known, parse_line
from simmer_tui.runlog.format1 import is_format_1, upgraded
from simmer_tui.runlog.header import Header, parse_header, rebuild
from simmer_tui.sim.command import escape

MAX_LINE = 16 * 1024 * 1024
"""Longest line that is taken for one, bytes."""
_GZIP = b"\x1f\x8b"
_UNREADABLE = (OSError, EOFError, zlib.error)


class Logged(Struct, frozen=True):
    """An event as a log tells it: the number of its line, and seconds since 1970."""

    line: int
    wall: float
    event: Event


class LogReader:
    """The header and then the events of a log.

    A broken line comes as a `BrokenLine`. A last line without its end, as a crash leaves it, is
    left out, and `note` says so afterwards.
    """

    def __init__(self, path: Path, configuration: Configuration | None = None) -> None:
        """Open a log, plain or compressed, and read its header. `configuration` is taken in place of
        the log's own, for one with sensors that this program does not know.

        Raises RunLogError, and ConfigurationError for mistakes in the log's configuration.
        """
        self.path = path
        self.shown = escape(str(path), 200)
        self.note = ""
        self._line = 1
        self._file = open_log(path, self.shown)
        try:
            self.size = self._file.seek(0, 2)
            self._file.seek(0)
            self.header = read_header(self._file, self.shown)
            self.configuration = configuration or rebuild(self.header)
        except _UNREADABLE as error:
            self._file.close()
            raise RunLogError(unreadable(self.shown, error)) from None
        except BaseException:
            self._file.close()
            raise
        self.position = self._file.tell()
        """Bytes read so far."""
        self._decoder = Decoder(self.configuration.simulation, self.header.pose)

    def fold(self) -> Reducer:
        """A fold that stands where the log begins."""
        return Reducer(self.header.beginning(self.configuration))

    def lines(self) -> Iterator[tuple[int, Known | BrokenLine]]:
        """The lines as they stand, with their numbers."""
        for data in iter(partial(self._file.readline, MAX_LINE), b""):
            self._line += 1
            if not data.endswith(b"\n"):
                if len(data) == MAX_LINE:
                    self._skip_line()
                    yield self._line, BrokenLine(self._line, f"it is longer than {MAX_LINE} bytes")
                    continue
                self.note = torn_note(self._line)
                return
            self.position += len(data)
            yield self._line, parse_line(data, self._line)

    def __iter__(self) -> Iterator[Logged | BrokenLine]:
        start, decode = self.header.wall, self._decoder.events
        for number, line in self.lines():
            if isinstance(line, BrokenLine):
                yield line
                continue
            try:
                events = decode(line)
            except RunLogError as error:
                yield BrokenLine(number, str(error))
                continue
            for event in events:
                yield Logged(number, start + line.wall, event)

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
    """The file of a log, for reading, as format 2 and not compressed. Raises RunLogError.

    A compressed log is laid out in a temporary file, since it is to be moved about in; so is one of
    format 1, whose events are worked out once.
    """
    try:
        file: IO[bytes] = path.open("rb")
    except FileNotFoundError:
        raise RunLogError(f"{shown}: there is no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise RunLogError(unreadable(shown, error)) from None
    try:
        if file.read(2) == _GZIP:
            file.seek(0)
            with file:
                file = _unpacked(file)
        file.seek(0)
        first = file.readline(MAX_LINE)
        file.seek(0)
        if is_format_1(first):
            with file:
                file = upgraded(file, shown)
    except _UNREADABLE as error:
        file.close()
        raise RunLogError(unreadable(shown, error)) from None
    return file


def _unpacked(file: IO[bytes]) -> IO[bytes]:
    plain = tempfile.TemporaryFile()  # noqa: SIM115 - it is what is returned
    packer = zlib.decompressobj(16 + zlib.MAX_WBITS)
    while chunk := file.read(1 << 18):  # gzip.GzipFile would give nothing of a run that was cut off
        plain.write(packer.decompress(chunk))
        while packer.eof and packer.unused_data:
            rest, packer = packer.unused_data, zlib.decompressobj(16 + zlib.MAX_WBITS)
            plain.write(packer.decompress(rest))
    return cast("IO[bytes]", plain)


def unreadable(shown: str, error: BaseException) -> str:
    """Why a log cannot be read."""
    reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return f"{shown} cannot be read: {reason}"


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
        """What to add to simulated time in the present stretch, between two resets."""
        self.now = 0.0

    def restart(self, time: float) -> None:
        """The run begins anew, with this simulated time."""
        self.before = self.now - time

    def advance(self, time: float) -> float:
        """The elapsed time at the next simulated time."""
        elapsed = self.before + time
        if elapsed > self.now:
            self.now = elapsed
        return self.now
