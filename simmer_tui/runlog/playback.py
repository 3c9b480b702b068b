"""The state of a run at any moment of its log, by the same reducer as of a live run."""

from __future__ import annotations

from msgspec.structs import replace

from simmer_tui.config.loader import Configuration
from simmer_tui.errors import RunLogError
from simmer_tui.run.events import Event
from simmer_tui.run.reducer import CONTACT_POINTS, Reducer
from simmer_tui.run.state import Checkpoint, State
from simmer_tui.runlog.decode import LogDecoder
from simmer_tui.runlog.header import rebuild
from simmer_tui.runlog.index import EntryFlag, RunLogIndex
from simmer_tui.runlog.log_records import (
    ActionRecord,
    AnyRecord,
    BeliefRecord,
    BrokenLine,
    CheckpointRecord,
    EndRecord,
    LegEndRecord,
)
from simmer_tui.runlog.reader import Logged

# A program reads some ten sensors between two movements.
LOOK_BACK = 400
"""Least number of entries reduced before a moment, so that its sensors and its latest movements are known."""
# To seek means to reduce LOOK_BACK to LOOK_BACK + 500 entries, and to look for contacts and belief.
SKIP = 1500
"""Largest distance of a later entry that is reached without a seek, entries."""
# Two large grids with their cells are half a second apart, and no filter takes a step in 1 ms.
_MOST_WITHOUT_CELLS = 500
"""Beliefs gone back to find one with the cells of its grid."""


class Playback:
    """Gives the state of a run at any moment of its log.

    A small step forward is fast. Any other moment takes the time to reduce some hundred entries from a
    checkpoint in the log.
    """

    def __init__(self, index: RunLogIndex) -> None:
        """Raises ConfigurationError for mistakes in the log's configuration."""
        self.index = index
        self.configuration: Configuration = rebuild(index.header)
        self._spec = self.configuration.simulation
        self._has_scans = any(sensor.kind.is_scan for sensor in self._spec.sensors)
        self._restart(-1)

    def state_at(self, entry: int, elapsed: float | None = None) -> State:
        """The state right after an entry began (-1: before the first), or at an elapsed time
        (`RunLogIndex.time_of`) between then and the next entry."""
        if elapsed is None:
            return self.state_when(entry)
        # Sums of times are rounded: an entry must still be found at its own time.
        is_later = entry < 0 or elapsed > self.index.time_of(entry)
        return self.state_when(entry, elapsed - self.index.zero_of(max(entry, 0)) if is_later else None)

    def state_when(self, entry: int, time: float | None = None) -> State:
        """The same by simulated time, as the lines count it."""
        # The reducer only goes forward. Farther on, a checkpoint is nearer than all entries between.
        if not self._entry <= entry <= self._entry + SKIP:
            self._restart(entry)
        while self._entry < entry:
            self._take_next()
        return self._reducer.at(time)

    def events(self, begin: int, end: int) -> list[Logged | BrokenLine]:
        """The events of the entries from `begin` to before `end`."""
        begin = max(begin, 0)
        # The poses that a lidar's rays were sent from follow from the movements before.
        decoder, _, at = self._decoder_before(begin - LOOK_BACK if self._has_scans else begin)
        found: list[Logged | BrokenLine] = []
        for entry in range(at, min(end, self.index.count)):
            line = self.index.record(entry)
            real_time = self.index.header.real_time
            if not isinstance(line, BrokenLine):
                real_time += line.real_time
            events = _decoded(decoder, line, entry)
            if entry >= begin:
                found += [
                    each if isinstance(each, BrokenLine) else Logged(entry + 2, real_time, each)
                    for each in events
                ]
        return found

    # -- internal --------------------------------------------------------------------------------

    def _take_next(self) -> None:
        self._entry += 1
        for event in _decoded(self._decoder, self.index.record(self._entry), self._entry):
            if not isinstance(event, BrokenLine):
                self._reducer.apply(event)

    def _restart(self, entry: int) -> None:
        """Begin to reduce at least `LOOK_BACK` entries before an entry."""
        self._decoder, checkpoint, at = self._decoder_before(entry - LOOK_BACK)
        # A checkpoint counts contacts but does not hold their points.
        checkpoint = replace(checkpoint, contact_points=self._touched_before(at))
        self._reducer = Reducer(checkpoint)
        self._entry = at - 1
        self._recall_belief(at)

    def _touched_before(self, at: int) -> tuple[tuple[float, float], ...]:
        """The points touched since the last reset."""
        index = self.index
        restart = index.find_previous(at, EntryFlag.RESTART)
        points: list[tuple[float, float]] = []
        touched = list(index.find_all(EntryFlag.CONTACT, 0 if restart is None else restart, at))
        for entry in touched[-CONTACT_POINTS:]:
            record = index.record(entry)
            if isinstance(record, EndRecord | LegEndRecord) and record.contact is not None:
                points.append(record.contact.point)
        return tuple(points)

    def _recall_belief(self, at: int) -> None:
        """Apply the latest belief before an entry, which may be long before it, unless the robot was
        moved by a person since."""
        index = self.index
        found = index.find_previous(at, EntryFlag.BELIEF)
        if found is None:
            return
        # A robot put elsewhere is where its program does not expect it: its belief is not shown any more.
        done = index.find_previous(at, EntryFlag.ACTION)
        while done is not None and done > found:
            line = index.record(done)
            if isinstance(line, ActionRecord) and line.action.places and not line.refused:
                return
            done = index.find_previous(done, EntryFlag.ACTION)
        for entry in self._shown_with(found):
            for event in _decoded(self._decoder, index.record(entry), entry):
                if not isinstance(event, BrokenLine):
                    self._reducer.apply(event)

    def _shown_with(self, found: int) -> list[int]:
        """The entry of a belief. If the log has left out the cells of its grid, the entry that has them comes
        first."""
        at: int | None = found
        for _ in range(_MOST_WITHOUT_CELLS):
            line = None if at is None else self.index.record(at)
            if at is None or not isinstance(line, BeliefRecord) or line.grid is None:
                break
            if line.grid.cells:
                return [at, found] if at != found else [found]
            at = self.index.find_previous(at, EntryFlag.BELIEF)
        return [found]

    def _decoder_before(self, entry: int) -> tuple[LogDecoder, Checkpoint, int]:
        """A decoder at the last checkpoint before an entry, that checkpoint, and the entry to decode next."""
        index = self.index
        checkpoint = index.find_previous(entry, EntryFlag.CHECKPOINT)
        decoder = LogDecoder(self._spec, index.header.pose)
        while checkpoint is not None:
            line = index.record(checkpoint)
            if isinstance(line, CheckpointRecord):
                return decoder, decoder.resume(line), checkpoint + 1
            checkpoint = index.find_previous(checkpoint, EntryFlag.CHECKPOINT)  # that one is broken
        return decoder, index.header.checkpoint(self.configuration), 0


def _decoded(decoder: LogDecoder, line: AnyRecord | BrokenLine, entry: int) -> tuple[Event | BrokenLine, ...]:
    if isinstance(line, BrokenLine):
        return (line,)
    try:
        return decoder.events(line)
    except RunLogError as error:
        return (BrokenLine(entry + 2, str(error)),)
