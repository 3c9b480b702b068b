"""Any line of a log of any length, at once: an index of 26 bytes a line, made in one pass."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from enum import IntFlag
from operator import itemgetter
from pathlib import Path
from types import TracebackType

import numpy as np

from simmer_tui.errors import RunLogError
from simmer_tui.runlog.log_records import (
    ActionRecord,
    AnswerRecord,
    AnyRecord,
    BeliefRecord,
    BrokenLine,
    CheckpointRecord,
    EndRecord,
    MissionRecord,
    MoveRecord,
    NoticeRecord,
    PlanRecord,
    ReadingRecord,
    TwinRecord,
    decode_line,
)
from simmer_tui.runlog.reader import MAX_LINE, RecordStream, open_log, too_long
from simmer_tui.sim.command import escape
from simmer_tui.sim.records import REFUSALS, Status

# Doubled while a search goes on, up to this: near entries are found at once, far ones in few steps.
_STRIDE = 65536


class EntryFlag(IntFlag):
    """Properties of an entry, which the index keeps."""

    COMMAND = 1
    """A command taken up: a reading, a movement that begins, or an answer to another command."""
    ACTION = 2
    BELIEF = 4
    OTHER = 8
    """Nothing about where the robot is."""
    BROKEN = 16
    CONTACT = 32
    REFUSED = 64
    RESTART = 128
    MISSION = 256
    CHECKPOINT = 512


_FLAGS: dict[type, EntryFlag] = {
    ReadingRecord: EntryFlag.COMMAND,
    MoveRecord: EntryFlag.COMMAND,
    PlanRecord: EntryFlag.COMMAND,
    AnswerRecord: EntryFlag.COMMAND,
    EndRecord: EntryFlag.OTHER,
    ActionRecord: EntryFlag.ACTION,
    BeliefRecord: EntryFlag.BELIEF,
    NoticeRecord: EntryFlag.OTHER,
    TwinRecord: EntryFlag.OTHER,
    MissionRecord: EntryFlag.MISSION,
    CheckpointRecord: EntryFlag.CHECKPOINT,
    BrokenLine: EntryFlag.BROKEN,
}


def _flags_of(record: AnyRecord | BrokenLine) -> EntryFlag:
    flags = _FLAGS[type(record)]
    match record:
        case MoveRecord() | EndRecord() if record.contact is not None:
            return flags | EntryFlag.CONTACT
        case AnswerRecord() if record.status in (Status.ACCEPTED, Status.DONE):
            return EntryFlag.OTHER  # its plan stands before it
        case AnswerRecord() if record.status in REFUSALS:
            return flags | EntryFlag.REFUSED
        case ActionRecord() if record.action.restarts and not record.refused:
            return flags | EntryFlag.RESTART
    return flags


class RunLogIndex:
    """A log to move about in. Entries count from 0; entry i is line i + 2 of the file.

        log = RunLogIndex(path)
        log.record(log.find_time(60.0))

    Only whole lines count: a last line without its end is left out, and `note` says so. For a log
    that is still being written call `refresh` from time to time.
    """

    def __init__(self, path: Path) -> None:
        """Open a log and look over all its lines. Raises RunLogError."""
        self.path = path
        self.shown = escape(str(path), 200)
        self._file, self.header = open_log(path, self.shown)
        self._stream = RecordStream(self._file)
        # One number an entry in each: 26 bytes, so that a log of a million lines takes 26 MB.
        self._offsets = array("q")
        self._elapsed = array("d")
        self._over = array("d")
        self._flags = array("H")
        self._zeros = [(0, -self.header.t)]
        self._begun = self._now = 0.0
        self.refresh()

    def refresh(self) -> int:
        """Take in what has been written since; returns the number of new entries.

        Raises RunLogError if the file has become shorter: it is another one now.
        """
        before, stream = self.count, self._stream
        try:
            if self._file.seek(0, 2) < stream.position:
                raise RunLogError(f"{self.shown} has become shorter: it has been replaced by another file")
            begin = stream.position
            for record in stream:
                self._offsets.append(begin)
                begin = stream.position
                self._append(record)
        except OSError as error:
            raise RunLogError(f"{self.shown} cannot be read: {error.strerror or error}") from None
        return self.count - before

    def _append(self, record: AnyRecord | BrokenLine) -> None:
        flags = _flags_of(record)
        if not isinstance(record, BrokenLine):
            if flags & EntryFlag.RESTART:
                self._begun = self._now
                self._zeros.append((len(self._elapsed), self._now - record.t))
            zero = self._zeros[-1][1]
            end = record.end if isinstance(record, MoveRecord) else record.t
            self._begun = max(self._begun, record.t + zero)
            self._now = max(self._now, end + zero)
        self._elapsed.append(self._begun)
        self._over.append(self._now)
        self._flags.append(flags)

    # -- what there is -----------------------------------------------------------------------

    @property
    def count(self) -> int:
        """How many entries there are."""
        return len(self._offsets)

    @property
    def note(self) -> str:
        """That the last line is cut off, or empty."""
        return self._stream.note

    @property
    def duration(self) -> float:
        """Simulated seconds from the log's beginning to its end, resets or not."""
        return self._now

    def time_of(self, i: int) -> float:
        """Simulated seconds from the log's beginning to an entry. They go on through resets."""
        return self._elapsed[i]

    def zero_of(self, i: int) -> float:
        """Where, on the scale of `time_of`, the `t` of an entry and those around it counts from."""
        stretch = max(bisect_right(self._zeros, i, key=itemgetter(0)) - 1, 0)
        return self._zeros[stretch][1]

    def flags_of(self, i: int) -> EntryFlag:
        """What an entry is, without reading it."""
        return EntryFlag(self._flags[i])

    def over_of(self, i: int) -> float:
        """By when, as `time_of` counts, all that entry i tells has happened: a movement's end."""
        return self._over[i]

    def record(self, i: int) -> AnyRecord | BrokenLine:
        """What an entry says. Raises IndexError if there is none."""
        if not 0 <= i < self.count:
            raise IndexError(f"the log has entries 0 to {self.count - 1}, not {i}")
        begin = self._offsets[i]
        end = self._offsets[i + 1] if i + 1 < self.count else self._stream.position
        if end - begin > MAX_LINE:
            return too_long(i + 2)
        try:
            self._file.seek(begin)
            return decode_line(self._file.read(end - begin), i + 2)
        except OSError as error:
            return BrokenLine(i + 2, f"it cannot be read: {error.strerror or error}")

    # -- going about -------------------------------------------------------------------------

    def find_time(self, elapsed: float) -> int:
        """The last entry not after a time (as `time_of` counts), or 0."""
        return max(bisect_right(self._elapsed, elapsed) - 1, 0)

    def find_next(self, i: int, flags: EntryFlag) -> int | None:
        """The first entry after i that has any of these flags."""
        values = np.frombuffer(self._flags, dtype=np.uint16)
        begin, stride = i + 1, 64
        while begin < self.count:
            found = np.flatnonzero(values[begin : begin + stride] & np.uint16(flags))
            if len(found):
                return begin + int(found[0])
            begin, stride = begin + stride, min(2 * stride, _STRIDE)
        return None

    def find_previous(self, i: int, flags: EntryFlag) -> int | None:
        """The last entry before i that has any of these flags."""
        values = np.frombuffer(self._flags, dtype=np.uint16)
        end, stride = min(i, self.count), 64
        while end > 0:
            begin = max(end - stride, 0)
            found = np.flatnonzero(values[begin:end] & np.uint16(flags))
            if len(found):
                return begin + int(found[-1])
            end, stride = begin, min(2 * stride, _STRIDE)
        return None

    def find_all(self, flags: EntryFlag) -> list[int]:
        """All entries that have any of these flags."""
        found: list[int] = np.flatnonzero(
            np.frombuffer(self._flags, dtype=np.uint16) & np.uint16(flags)
        ).tolist()
        return found

    def next_command(self, i: int) -> int | None:
        """The next command after entry i, or None; so for the others below."""
        return self.find_next(i, EntryFlag.COMMAND)

    def previous_command(self, i: int) -> int | None:
        return self.find_previous(i, EntryFlag.COMMAND)

    def next_contact(self, i: int) -> int | None:
        """The next movement that a wall ended."""
        return self.find_next(i, EntryFlag.CONTACT)

    def previous_contact(self, i: int) -> int | None:
        return self.find_previous(i, EntryFlag.CONTACT)

    def next_refused(self, i: int) -> int | None:
        """The next command that did nothing, or line that cannot be read."""
        return self.find_next(i, EntryFlag.REFUSED | EntryFlag.BROKEN)

    def previous_refused(self, i: int) -> int | None:
        return self.find_previous(i, EntryFlag.REFUSED | EntryFlag.BROKEN)

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> RunLogIndex:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
