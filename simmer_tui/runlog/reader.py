"""Reads a run log from beginning to end as events, one line in memory at a time."""

from __future__ import annotations

import codecs
import tempfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from typing import IO, cast, final

from msgspec import Struct

from simmer_tui.config.loader import Configuration
from simmer_tui.errors import RunLogError, reason_of
from simmer_tui.run.events import CommandResult, Event
from simmer_tui.run.reducer import Reducer
from simmer_tui.runlog.closing import Closing
from simmer_tui.runlog.decode import LogDecoder
from simmer_tui.runlog.header import Header, parse_header, rebuild
from simmer_tui.runlog.log_records import AnyRecord, BrokenLine, ReadingRecord, decode_line, decode_lines
from simmer_tui.runlog.writer import LOG
from simmer_tui.sim.command import typed_path

# A belief of 5,000 particles takes 100 KB and a header some 20 KB: a longer line is in no log.
MAX_LINE = 16 * 1024 * 1024
"""Longest line that is read, bytes."""
# A disk that fails, or a person who edits a log, breaks a few. Blank lines are a byte each: without a limit a
# small file, and above all a compressed one, would take minutes.
MOST_BROKEN = 10_000
"""Most lines without a record, blank ones included."""
# The first two bytes of every gzip file (RFC 1952); the name may be wrong.
_GZIP = b"\x1f\x8b"
# Logs pack to a tenth; a million commands are 140 MB.
MOST_PACKED, MOST_UNPACKED = 50, 1_000_000_000
"""Ratio of unpacked to packed size, and unpacked bytes: a file beyond both is no log and would fill the
disk."""
_PIECE = 1 << 20  # bytes unpacked at once: 256 KiB of zeros, packed, would be 264 MB
_PIECE_OF_LINES = 1 << 14
"""Bytes of lines that are decoded together."""
_BLOCK, _BLOCK_BYTES = 64, 1 << 18
"""Events, and bytes of a log, that are read before any event is applied. One at a time takes a tenth longer:
reading and applying evict each other's code from the processor's cache."""
READS_LARGE: ContextVar[bool] = ContextVar("READS_LARGE", default=False)
"""True if the user has asked for compressed logs of any size (`--large`)."""
# The encoder writes the tag first. A first line cut off within this is still a log's.
_HEADER_START = b'{"kind":"header",'


class Logged(Struct, frozen=True):
    """An event of a log, with the number of its line and its real time, seconds since 1970."""

    line: int
    real_time: float
    event: Event


@final
class LoggedReadings(Struct, frozen=True):
    """Readings of a log that follow each other, whole scans apart: their results, the numbers of their lines,
    and their real times, seconds since 1970."""

    lines: list[int]
    real_times: list[float]
    results: list[CommandResult]


class RecordStream:
    """The records of the whole lines of an open log, one line in memory at a time. Iterating again gives
    those written since."""

    def __init__(self, file: IO[bytes], shown: str) -> None:
        """`file` stands after the header; messages name it as `shown`."""
        self._file = file
        self._shown = shown
        self.position = file.tell()
        """Bytes up to the last whole line."""
        self.line = 1
        """Number of the last whole line."""
        self._torn = False
        self._broken = 0

    @property
    def note(self) -> str:
        """Message that the last line is cut off, or empty."""
        return f"line {self.line + 1}, the last, is cut off and was skipped" if self._torn else ""

    def __iter__(self) -> Iterator[AnyRecord | BrokenLine]:
        # A partial last line is read again: by now it may be whole.
        self._file.seek(self.position)
        self._torn = False
        readline = partial(self._file.readline, MAX_LINE)
        for data in iter(readline, b""):
            self.line += 1
            if data.endswith(b"\n"):
                self.position += len(data)
                record = decode_line(data, self.line)
                if type(record) is BrokenLine:
                    self.count_broken()
                yield record
                continue
            # Longer than MAX_LINE: read on to its end, without keeping it in memory.
            length, rest = len(data), data if len(data) == MAX_LINE else b""
            while rest and not rest.endswith(b"\n"):
                rest = readline()
                length += len(rest)
            if not rest:
                self.line -= 1
                self._torn = True
                return
            self.position += length
            self.count_broken()
            yield too_long(self.line)

    def pieces(self) -> Iterator[tuple[int, Sequence[AnyRecord | BrokenLine]]]:
        """The same records, those of some lines at a time, with the number of the first line. Reading and
        decoding lines together takes half the time."""
        self._file.seek(self.position)
        self._torn = False
        while not self._torn and (data := self._file.read(_PIECE_OF_LINES)):
            if not data.endswith(b"\n"):
                data += self._file.readline(MAX_LINE - len(data))
            first, end = self.line + 1, self.position + len(data)
            whole = decode_lines(data)
            if whole is not None:
                self.line, self.position = self.line + len(whole), end
                yield first, whole
                continue
            # One of them is broken, cut off or too long.
            records = []
            for record in self:
                records.append(record)
                if self.position >= end:
                    break
            yield first, records

    def count_broken(self) -> None:
        """Count a broken line. Raises RunLogError if there are too many."""
        self._broken += 1
        if self._broken > MOST_BROKEN:
            raise RunLogError(
                f"{self._shown} is no run log: {self._broken} of its first {self.line} lines have no record"
            )


def too_long(line: int) -> BrokenLine:
    """A line that is too long to be read."""
    return BrokenLine(line, f"it is longer than {MAX_LINE} bytes")


class OpenLog(Closing):
    """An open log, plain or compressed: its header, and its file."""

    def __init__(self, path: Path) -> None:
        """Raises RunLogError."""
        self.path = path
        self.shown = str(path)
        self._file, self.header = open_log(path, self.shown)
        self._stream = RecordStream(self._file, self.shown)

    @property
    def note(self) -> str:
        """Message that the last line is cut off, or empty."""
        return self._stream.note

    def close(self) -> None:
        self._file.close()


class LogReader(OpenLog):
    """The header and then the events of a log.

    A broken line comes as a `BrokenLine`. A last line that a crash has cut off is left out, and `note` says
    so afterwards.
    """

    def __init__(self, path: Path, configuration: Configuration | None = None) -> None:
        """Open a log, plain or compressed, and read its header. `configuration` is taken in place of
        the log's own, for one with sensors that this program does not know.

        Raises RunLogError, and ConfigurationError for mistakes in the log's configuration.
        """
        super().__init__(path)
        try:
            self.configuration = configuration or rebuild(self.header)
            # After the header: size is for progress only, and the file may still grow.
            self.size = self._file.seek(0, 2)
        # The caller never gets the object, so nobody else could close the file.
        except BaseException:
            self._file.close()
            raise
        self._decoder = LogDecoder(self.configuration.simulation, self.header.pose)

    @property
    def position(self) -> int:
        """Bytes read so far."""
        return self._stream.position

    def reducer(self) -> Reducer:
        """A reducer with the state in which the log begins."""
        return Reducer(self.header.checkpoint(self.configuration))

    def lines(self) -> Iterator[tuple[int, AnyRecord | BrokenLine]]:
        """The records in the order of the log, with the numbers of their lines."""
        with reading_log(self.shown):
            for record in self._stream:
                yield self._stream.line, record

    def __iter__(self) -> Iterator[Logged | BrokenLine]:
        # Line by line: reading can continue after any line, and nothing is read ahead and lost.
        for number, record in self.lines():
            yield from self._events(number, record)

    def blocks(self, events: int = _BLOCK) -> Iterator[list[Logged | LoggedReadings | BrokenLine]]:
        """The events of some lines at a time, about so many. Lines are read ahead: read to the end."""
        with reading_log(self.shown):
            yield from self._blocks(events)

    def _blocks(self, events: int) -> Iterator[list[Logged | LoggedReadings | BrokenLine]]:
        stream, start, decode = self._stream, self.header.real_time, self._decoder.reading
        block: list[Logged | LoggedReadings | BrokenLine] = []
        count, begin = 0, stream.position
        readings: LoggedReadings | None = None
        for first, records in stream.pieces():
            # For speed a loop of its own, and types compared: most of the millions of lines are readings.
            for number, record in enumerate(records, first):
                if type(record) is ReadingRecord and record.revolution is None:
                    try:
                        result = decode(record)
                    except RunLogError as error:
                        block.append(self._broken(number, error))
                        continue
                    if readings is None:
                        readings = LoggedReadings([], [], [])
                        block.append(readings)
                    readings.lines.append(number)
                    readings.real_times.append(start + record.real_time)
                    readings.results.append(result)
                    count += 1
                else:
                    readings = None
                    found = self._events(number, record)
                    block += found
                    count += len(found)
                if count >= events:
                    yield block
                    block, count, begin, readings = [], 0, stream.position, None
            if stream.position - begin > _BLOCK_BYTES:
                yield block
                block, count, begin, readings = [], 0, stream.position, None
        yield block

    def _events(self, number: int, record: AnyRecord | BrokenLine) -> list[Logged | BrokenLine]:
        """The events of a line."""
        if type(record) is BrokenLine:
            return [record]
        real_time = self.header.real_time + record.real_time
        try:
            return [Logged(number, real_time, event) for event in self._decoder.events(record)]
        except RunLogError as error:
            return [self._broken(number, error)]

    def _broken(self, number: int, error: RunLogError) -> BrokenLine:
        self._stream.count_broken()
        return BrokenLine(number, str(error))


def open_log(path: Path, shown: str) -> tuple[IO[bytes], Header]:
    """Open a log for reading, and read its header. Raises RunLogError, which names the log as `shown`.

    A compressed log is unpacked to a temporary file, for random access.
    """
    with reading_log(shown):
        try:
            file: IO[bytes] = path.open("rb")
        except FileNotFoundError:
            raise RunLogError(f"{shown}: there is no such file{_newest_in(path.parent)}") from None
        except (IsADirectoryError, PermissionError):
            if not path.is_dir():  # Windows may not open a folder either
                raise
            raise RunLogError(f"{shown} cannot be read: it is a folder{_newest_in(path)}") from None
        except ValueError as error:  # a NUL in the name
            raise OSError(str(error)) from None
    try:
        with reading_log(shown):
            is_packed = file.read(2) == _GZIP
            file.seek(0)
            if is_packed:
                with file:
                    file = _unpacked(file, shown)
                file.seek(0)
            return file, _read_header(file, shown)
    except BaseException:
        file.close()
        raise


def _newest_in(folder: Path) -> str:
    """The newest log of a folder, for a message; without one, the way to a log."""
    found = [path for path in folder.glob(f"*{LOG}*") if path.is_file()]
    if not found:
        return "; --log FILE writes one, and without a name the app's last run is taken"
    return f"; the newest log there is {typed_path(max(found, key=lambda path: path.stat().st_mtime))}"


def _unpacked(file: IO[bytes], shown: str) -> IO[bytes]:
    plain = cast("IO[bytes]", tempfile.TemporaryFile())  # noqa: SIM115 - it is what is returned
    try:
        for piece in _pieces(file):
            plain.write(piece)
            unpacked = plain.tell()
            is_large = unpacked > MOST_UNPACKED and unpacked > MOST_PACKED * file.tell()
            if is_large and not READS_LARGE.get():
                raise RunLogError(
                    f"{shown} unpacks to more than {MOST_PACKED} times its size and "
                    f"{MOST_UNPACKED / 1e9:g} GB, as no run log does; --large reads it anyway"
                )
    except BaseException:
        plain.close()
        raise
    return plain


def _pieces(file: IO[bytes]) -> Iterator[bytes]:
    """The bytes of a gzip file, up to its end or to where it is cut off."""
    packer = zlib.decompressobj(16 + zlib.MAX_WBITS)
    while chunk := file.read(1 << 18):  # gzip.GzipFile would give nothing of a run that was cut off
        while chunk:
            yield packer.decompress(chunk, _PIECE)
            chunk = packer.unconsumed_tail
            # A gzip file may have several members (RFC 1952): logs that were concatenated.
            if packer.eof:
                chunk, packer = packer.unused_data, zlib.decompressobj(16 + zlib.MAX_WBITS)


@contextmanager
def reading_log(shown: str) -> Iterator[None]:
    """Inside the `with` block a log is read: raises RunLogError, which names it as `shown`, if it fails."""
    try:
        yield
    except (OSError, EOFError, zlib.error) as error:
        raise RunLogError(f"{shown} cannot be read: {reason_of(error)}") from None


def _read_header(file: IO[bytes], shown: str) -> Header:
    line = file.readline(MAX_LINE).removeprefix(codecs.BOM_UTF8)  # editors on Windows write one
    if not line:
        raise RunLogError(f"{shown} is empty, not a run log")
    if not line.endswith(b"\n") and len(line) < MAX_LINE and line.startswith(_HEADER_START[: len(line)]):
        raise RunLogError(f"{shown} is cut off within its first line: it cannot be read")
    return parse_header(line, shown)
