"""Random access to the lines of a log of any length: an index of 18 bytes a line, made in one pass."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from enum import IntFlag
from operator import itemgetter
from pathlib import Path
from typing import get_args

import numpy as np

from simmer_tui.errors import RunLogError, reason_of
from simmer_tui.runlog.log_records import (
    ActionRecord,
    AnswerRecord,
    AnyRecord,
    BeliefRecord,
    BrokenLine,
    CheckpointRecord,
    EndRecord,
    LegEndRecord,
    MissionRecord,
    ReadingRecord,
    decode_line,
)
from simmer_tui.runlog.reader import MAX_LINE, OpenLog, reading_log, too_long
from simmer_tui.sim.arrays import BoolArray
from simmer_tui.sim.records import REFUSALS, Status


class EntryFlag(IntFlag):
    """Properties of an entry, which the index keeps."""

    COMMAND = 1
    """A command with its outcome: a reading, a movement that ends, or an answer to another command."""
    ACTION = 2
    BELIEF = 4
    OTHER = 8
    """A record without the robot's pose."""
    BROKEN = 16
    CONTACT = 32
    REFUSED = 64
    RESTART = 128
    MISSION = 256
    CHECKPOINT = 512
    FAULTY = REFUSED | BROKEN
    """A command that did nothing, or a line that cannot be read."""


# Joined here once: joining flags takes 1 us, and there may be a million lines.
_OTHER = EntryFlag.OTHER
_FLAGS: dict[type, tuple[EntryFlag, EntryFlag]] = dict.fromkeys(get_args(AnyRecord), (_OTHER, _OTHER)) | {
    ReadingRecord: (EntryFlag.COMMAND, EntryFlag.COMMAND),
    AnswerRecord: (EntryFlag.COMMAND, EntryFlag.COMMAND | EntryFlag.REFUSED),
    EndRecord: (EntryFlag.COMMAND, EntryFlag.COMMAND | EntryFlag.CONTACT),
    LegEndRecord: (_OTHER, _OTHER | EntryFlag.CONTACT),
    ActionRecord: (EntryFlag.ACTION, EntryFlag.ACTION | EntryFlag.RESTART),
    BeliefRecord: (EntryFlag.BELIEF, EntryFlag.BELIEF),
    MissionRecord: (EntryFlag.MISSION, EntryFlag.MISSION),
    CheckpointRecord: (EntryFlag.CHECKPOINT, EntryFlag.CHECKPOINT),
}
"""The flags of each kind of record: usually, and if it has a contact, a refusal or a restart."""
_RESTART = _FLAGS[ActionRecord][1]


def _flags_of(record: AnyRecord) -> EntryFlag:
    usual, special = _FLAGS[type(record)]
    if usual is special:
        return usual
    match record:
        case EndRecord() | LegEndRecord():
            return usual if record.contact is None else special
        case AnswerRecord(status=Status.DONE) if record.velocity is not None or record.waits:
            return usual  # it moves the robot, or time, itself
        case AnswerRecord(status=Status.ACCEPTED | Status.DONE):
            return EntryFlag.OTHER  # the end before it is the command's entry
        # Answered with a refusal, or asked for something that moves nothing.
        case AnswerRecord():
            return special if record.status in REFUSALS else usual
        case ActionRecord():
            return special if record.action.restarts and not record.refused else usual
    return usual


class RunLogIndex(OpenLog):
    """A log with random access. Entries count from 0; entry i is line i + 2 of the file.

        log = RunLogIndex(path)
        log.record(log.find_time(60.0))

    Only whole lines count: a last line without its end is left out, and `note` says so. For a log
    that is still being written call `refresh` from time to time.
    """

    def __init__(self, path: Path) -> None:
        """Open a log and index all its lines. Raises RunLogError."""
        super().__init__(path)
        # One number an entry in each: 18 bytes, so that a log of a million lines takes 18 MB.
        self._offsets = array("q", [self._stream.position])
        self._elapsed = array("d")
        self._flags = array("H")
        # Simulated time restarts with a reset, elapsed time does not: each stretch has its own zero.
        self._zeros = [(0, -self.header.t)]
        self._now = 0.0
        try:
            self.refresh()
        # The caller never gets the object, so nobody else could close the file.
        except BaseException:
            self._file.close()
            raise

    def refresh(self) -> int:
        """Read the lines written since. Returns the number of new entries.

        Raises RunLogError if the file has become shorter: it is another one now.
        """
        before, stream = self.count, self._stream
        with reading_log(self.shown):
            # A log only grows, so a shorter file is another run's.
            if self._file.seek(0, 2) < stream.position:
                raise RunLogError(f"{self.shown} has become shorter: it has been replaced by another file")
            for record in stream:
                flags = EntryFlag.BROKEN if isinstance(record, BrokenLine) else self._take(record)
                self._flags.append(flags)
                self._elapsed.append(self._now)
                self._offsets.append(stream.position)
        return self.count - before

    def _take(self, record: AnyRecord) -> EntryFlag:
        """Advance the times to a record; gives its flags."""
        flags = _flags_of(record)
        if flags is _RESTART:
            self._zeros.append((self.count, self._now - record.t))
        # Searches need times that never fall.
        self._now = max(self._now, record.t + self._zeros[-1][1])
        return flags

    # -- entries -----------------------------------------------------------------------------

    @property
    def count(self) -> int:
        """Number of entries."""
        return len(self._flags)

    @property
    def duration(self) -> float:
        """Simulated seconds from the log's beginning to its end, through resets."""
        return self._now

    def time_of(self, i: int) -> float:
        """Simulated seconds from the log's beginning to an entry, through resets."""
        return self._elapsed[i]

    def zero_of(self, i: int) -> float:
        """Origin of the `t` of an entry, on the scale of `time_of`: the last reset before it."""
        return self._zeros[bisect_right(self._zeros, i, key=itemgetter(0)) - 1][1]

    def flags_of(self, i: int) -> EntryFlag:
        """Properties of an entry, without reading it."""
        return EntryFlag(self._flags[i])

    def record(self, i: int) -> AnyRecord | BrokenLine:
        """The record of an entry. Raises IndexError if there is none."""
        if not 0 <= i < self.count:
            raise IndexError(f"the log has entries 0 to {self.count - 1}, not {i}")
        begin, end = self._offsets[i], self._offsets[i + 1]
        # Not read at all: it could fill the memory.
        if end - begin > MAX_LINE:
            return too_long(i + 2)
        try:
            self._file.seek(begin)
            return decode_line(self._file.read(end - begin), i + 2)
        except OSError as error:
            return BrokenLine(i + 2, f"it cannot be read: {reason_of(error)}")

    # -- searches ----------------------------------------------------------------------------

    def find_time(self, elapsed: float) -> int:
        """The last entry not after a time (as `time_of` counts); -1 if there is none yet."""
        return bisect_right(self._elapsed, elapsed) - 1

    def _hits(self, flags: EntryFlag, begin: int = 0, end: int | None = None) -> BoolArray:
        values = np.frombuffer(self._flags, dtype=np.uint16)[begin:end]
        hits: BoolArray = (values & np.uint16(flags)) != 0
        return hits

    def find_next(self, i: int, flags: EntryFlag) -> int | None:
        """The first entry after i with any of these flags."""
        hits = self._hits(flags, i + 1)
        return i + 1 + int(hits.argmax()) if hits.any() else None

    def find_previous(self, i: int, flags: EntryFlag) -> int | None:
        """The last entry before i with any of these flags."""
        hits = self._hits(flags, 0, max(i, 0))[::-1]
        return len(hits) - 1 - int(hits.argmax()) if hits.any() else None

    def find_all(self, flags: EntryFlag, begin: int = 0, end: int | None = None) -> list[int]:
        """All entries from `begin` to before `end` with any of these flags."""
        found: list[int] = (np.flatnonzero(self._hits(flags, begin, end)) + begin).tolist()
        return found
