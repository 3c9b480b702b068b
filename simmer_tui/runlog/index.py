"""Any line of a log of any length, at once: an index of 26 bytes a line, made in one quick pass."""

from __future__ import annotations

from bisect import bisect_right
from itertools import pairwise
from operator import itemgetter
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from simmer_tui.errors import RunLogError
from simmer_tui.runlog.entries import BrokenLine, Known, parse_line
from simmer_tui.runlog.reader import MAX_LINE, open_log, read_header, torn_note, unreadable
from simmer_tui.runlog.scan import Mark, scan_lines
from simmer_tui.sim.command import escape

_CHUNK = 4 * 1024 * 1024
_STRIDE = 65536

Item = TypeVar("Item", bound=np.generic)


class _Column(Generic[Item]):
    """A one-dimensional array that grows."""

    def __init__(self, dtype: type[Item]) -> None:
        self._data: NDArray[Item] = np.empty(1024, dtype=dtype)
        self.count = 0

    def extend(self, values: NDArray[Any]) -> None:
        needed = self.count + len(values)
        if needed > len(self._data):
            self._data = np.resize(self._data, max(needed, len(self._data) * 3 // 2))
        self._data[self.count : needed] = values
        self.count = needed

    @property
    def values(self) -> NDArray[Item]:
        return self._data[: self.count]


class RunLogIndex:
    """A log to move about in. Entries count from 0; entry i is line i + 2 of the file.

        log = RunLogIndex(path)
        log.entry(log.find_time(60.0))

    Only whole lines count: a last line without its end is left out, and `note` says so. For a log
    that is still being written call `refresh` from time to time.
    """

    def __init__(self, path: Path) -> None:
        """Open a log and look over all its lines. Raises RunLogError."""
        self.path = path
        self.shown = escape(str(path), 200)
        self._file = open_log(path, self.shown)
        try:
            self.header = read_header(self._file, self.shown)
        except OSError as error:
            self._file.close()
            raise RunLogError(unreadable(self.shown, error)) from None
        except RunLogError:
            self._file.close()
            raise
        self._end = self._file.tell()
        self._torn = False
        self._offsets: _Column[np.int64] = _Column(np.int64)
        self._elapsed: _Column[np.float64] = _Column(np.float64)
        self._over: _Column[np.float64] = _Column(np.float64)
        self._marks: _Column[np.uint16] = _Column(np.uint16)
        self._zeros = [(0, -self.header.t)]
        self._begun = self._now = 0.0
        self.refresh()

    def refresh(self) -> int:
        """Take in what has been written since; returns the number of new entries.

        Raises RunLogError if the file has become shorter: it is another one now.
        """
        before = self.count
        try:
            self._refresh()
        except OSError as error:
            raise RunLogError(f"{self.shown} cannot be read: {error.strerror or error}") from None
        return self.count - before

    def _refresh(self) -> None:
        if self._file.seek(0, 2) < self._end:
            raise RunLogError(f"{self.shown} has become shorter: it has been replaced by another file")
        self._file.seek(self._end)
        rest = b""
        skipped = 0
        while chunk := self._file.read(_CHUNK):
            data = rest + chunk
            cut = data.rfind(b"\n") + 1
            block, rest = data[:cut], data[cut:]
            if skipped and block:  # the end of a line too long to be one
                length = block.find(b"\n") + 1
                none = np.full(1, np.nan)
                self._append(np.zeros(1), none, none, np.full(1, Mark.BROKEN), skipped + length)
                block, skipped = block[length:], 0
            if block:
                scan = scan_lines(block)
                self._append(scan.starts, scan.times, scan.ends, scan.marks, len(block))
            if len(rest) > MAX_LINE:
                skipped, rest = skipped + len(rest), b""
        self._torn = bool(rest) or skipped > 0

    def _append(
        self,
        starts: NDArray[Any],
        times: NDArray[np.float64],
        ends: NDArray[np.float64],
        marks: NDArray[Any],
        length: int,
    ) -> None:
        """Take in lines that begin `starts` bytes after what is known, `length` bytes in all."""
        self._offsets.extend(starts + self._end)
        self._marks.extend(marks)
        restarts = np.flatnonzero(marks.astype(np.uint16) & np.uint16(Mark.RESTART)).tolist()
        for begin, end in pairwise((0, *restarts, len(times))):
            if begin in restarts:
                self._zeros.append((self._elapsed.count, self._now - float(times[begin])))
            zero = self._zeros[-1][1]
            over = np.fmax.accumulate(np.concatenate(([self._now], ends[begin:end] + zero)))
            begun = np.fmax.accumulate(np.concatenate(([self._begun], times[begin:end] + zero)))
            self._elapsed.extend(begun[1:])
            self._over.extend(over[1:])
            self._begun, self._now = float(begun[-1]), float(over[-1])
            self._begun = self._now if end in restarts else self._begun
        self._end += length

    # -- what there is -----------------------------------------------------------------------

    @property
    def count(self) -> int:
        """How many entries there are."""
        return self._offsets.count

    @property
    def note(self) -> str:
        """That the last line is cut off, or empty."""
        return torn_note(self.count + 2) if self._torn else ""

    @property
    def duration(self) -> float:
        """Simulated seconds from the log's beginning to its end, resets or not."""
        return self._now

    def time_of(self, i: int) -> float:
        """Simulated seconds from the log's beginning to an entry. They go on through resets."""
        return float(self._elapsed.values[i])

    def zero_of(self, i: int) -> float:
        """Where, on the scale of `time_of`, the `t` of an entry and those around it counts from."""
        stretch = max(bisect_right(self._zeros, i, key=itemgetter(0)) - 1, 0)
        return self._zeros[stretch][1]

    def marks_of(self, i: int) -> Mark:
        """What an entry is, without reading it."""
        return Mark(int(self._marks.values[i]))

    def over_of(self, i: int) -> float:
        """By when, as `time_of` counts, all that entry i tells has happened: a movement's end."""
        return float(self._over.values[i])

    def line(self, i: int) -> Known | BrokenLine:
        """What an entry says. Raises IndexError if there is none."""
        if not 0 <= i < self.count:
            raise IndexError(f"the log has entries 0 to {self.count - 1}, not {i}")
        offsets = self._offsets.values
        begin = int(offsets[i])
        end = int(offsets[i + 1]) if i + 1 < self.count else self._end
        if end - begin > MAX_LINE:
            return BrokenLine(i + 2, f"it is longer than {MAX_LINE} bytes")
        try:
            self._file.seek(begin)
            return parse_line(self._file.read(end - begin), i + 2)
        except OSError as error:
            return BrokenLine(i + 2, f"it cannot be read: {error.strerror or error}")

    # -- going about -------------------------------------------------------------------------

    def find_time(self, elapsed: float) -> int:
        """The last entry not after a time (as `time_of` counts), or 0."""
        return max(int(np.searchsorted(self._elapsed.values, elapsed, side="right")) - 1, 0)

    def find_next(self, i: int, marks: Mark) -> int | None:
        """The first entry after i that has any of these marks."""
        values = self._marks.values
        begin, stride = i + 1, 64
        while begin < self.count:
            found = np.flatnonzero(values[begin : begin + stride] & np.uint16(marks))
            if len(found):
                return begin + int(found[0])
            begin, stride = begin + stride, min(2 * stride, _STRIDE)
        return None

    def find_previous(self, i: int, marks: Mark) -> int | None:
        """The last entry before i that has any of these marks."""
        values = self._marks.values
        end, stride = min(i, self.count), 64
        while end > 0:
            begin = max(end - stride, 0)
            found = np.flatnonzero(values[begin:end] & np.uint16(marks))
            if len(found):
                return begin + int(found[-1])
            end, stride = begin, min(2 * stride, _STRIDE)
        return None

    def find_all(self, marks: Mark) -> list[int]:
        """All entries that have any of these marks."""
        found: list[int] = np.flatnonzero(self._marks.values & np.uint16(marks)).tolist()
        return found

    def next_command(self, i: int) -> int | None:
        """The next command after entry i, or None; so for the others below."""
        return self.find_next(i, Mark.COMMAND)

    def previous_command(self, i: int) -> int | None:
        return self.find_previous(i, Mark.COMMAND)

    def next_contact(self, i: int) -> int | None:
        """The next movement that a wall ended."""
        return self.find_next(i, Mark.CONTACT)

    def previous_contact(self, i: int) -> int | None:
        return self.find_previous(i, Mark.CONTACT)

    def next_refused(self, i: int) -> int | None:
        """The next command that did nothing, or line that cannot be read."""
        return self.find_next(i, Mark.REFUSED | Mark.BROKEN)

    def previous_refused(self, i: int) -> int | None:
        return self.find_previous(i, Mark.REFUSED | Mark.BROKEN)

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> RunLogIndex:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
