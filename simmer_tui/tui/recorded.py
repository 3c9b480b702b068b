"""A logged run as a source of snapshots, for the replay."""

import asyncio
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.config.loader import Configuration
from simmer_tui.live.snapshot import EventFeed, Snapshot
from simmer_tui.report.run_statistics import report_of
from simmer_tui.report.verdict import Verdict
from simmer_tui.run.events import ActionName, Event, Notice, NoticeKind
from simmer_tui.run.mission import MissionPlan, mission_state, plan_run
from simmer_tui.run.reducer import Reducer
from simmer_tui.runlog.index import EntryFlag, RunLogIndex
from simmer_tui.runlog.log_records import ActionRecord, BrokenLine, MissionRecord
from simmer_tui.runlog.playback import LOOK_BACK, Playback
from simmer_tui.runlog.reader import LogReader
from simmer_tui.sketch.board_view import logged_views

# Doubled each time, as by `[` and `]` in a live run.
PLAYBACK_RATES = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Simulated seconds that are shown in a second."""
# A mission has some thousand; so many are read in a tenth of a second.
ROUTE_BACK = 20_000
"""Entries before the list of events whose route is shown too."""
# The size of the list of events: earlier ones would not be shown.
_NEAR = 2000
"""Entries up to which reading continues forwards. For a moment further on, reading starts again some way
before it."""


class TimelineMarkKind(StrEnum):
    """Kinds of marks on the timeline."""

    CONTACT = "contact"
    GOAL = "goal"
    PAUSE = "pause"


class TimelineMark(Struct, frozen=True):
    """Moment to jump to: its entry, and its time, simulated seconds from the log's beginning."""

    kind: TimelineMarkKind
    entry: int
    elapsed: float


class JudgedEnd(Struct, frozen=True):
    """The verdict on a log's last run, and the entry of that run's end."""

    verdict: Verdict
    entry: int


def judged_end(path: Path, configuration: Configuration) -> JudgedEnd:
    """The verdict on a log. Reads all of it, which takes seconds for a long one.

    Raises:
        RunLogError: if the log cannot be read.
    """
    with LogReader(path, configuration) as log:
        run = report_of(log, recorded=False)
    attempt, program = run.attempt, run.verdict.program
    # A run ends with its mission, or without one with its program.
    line = next((row.line for row in run.history.programs.items if row.event is program), attempt.line)
    entry = (line if attempt.over is None else attempt.line) - _FIRST_LINE
    return JudgedEnd(run.verdict, max(entry, -1))  # -1 for a log without entries


_FIRST_LINE = 2
"""Line of a log's first entry; the header has the one before."""


class RecordedRun:
    """Moves to any moment of a log, with a clock that can run, and gives a snapshot of each."""

    def __init__(self, index: RunLogIndex) -> None:
        """Raises:
        ConfigurationError: for mistakes in the log's configuration.
        """
        self.index = index
        self.playback = Playback(index)
        self.configuration: Configuration = self.playback.configuration
        self.name = self.configuration.name
        self.ports: Mapping[str, int] = {}
        header = index.header
        self._plan: MissionPlan | None = None
        if header.mission and self.playback.configuration.mission is not None:
            self._plan = plan_run(self.playback.configuration, header.seed)[1]
        self.entry = -1
        """Latest entry of the moment shown; -1 before the first."""
        self.elapsed = 0.0
        """Moment shown, simulated seconds from the log's beginning."""
        self.playing = False
        self.playback_rate = 1.0
        self._changed = True
        self._is_full = True
        self._begin_feed()
        self._fed = -1
        self._number = 0
        self._marked: tuple[int, tuple[TimelineMark, ...]] = (-1, ())
        self._end: JudgedEnd | None = None

    # -- as a source -----------------------------------------------------------------------------

    @property
    def _pace(self) -> str:
        return f"{self.playback_rate:g}x" if self.playing else "stopped"

    def has_news(self, known: int) -> bool:
        return self.playing or self._changed

    async def snapshot(self, since: int, true_values: bool) -> Snapshot:
        """The run at the moment shown. Its true values are those at each sensor's last reading."""
        self._changed = False
        state = self.playback.state_at(self.entry, self.elapsed)
        self._feed_shown()
        is_full, self._is_full = self._is_full, False
        readings = {code: row.reading.true for code, row in state.sensors.items()}
        return Snapshot(
            state=state,
            number=self._number,
            entries=self._feed.since(0 if is_full else since),
            is_full=is_full,
            total=self.entry + 1,
            ends=tuple(self._feed.ends),
            route=self._feed.route,
            true_values=readings if true_values else {},
            pace_text=self._pace,
            mission=None if self._plan is None else mission_state(self._plan, state),
            boards=logged_views(state, self.elapsed - self.index.zero_of(max(self.entry, 0))),
            verdict=self._end.verdict if self._end is not None and self.entry >= self._end.entry else None,
        )

    async def find_verdict(self) -> None:
        """Find the verdict on the log as it stands; the moments from its end on show it.

        Raises:
            RunLogError: if the log cannot be read.
        """
        self._end = await asyncio.to_thread(judged_end, self.index.path, self.configuration)
        self._changed = True

    def _feed_shown(self) -> None:
        """Update the list of events to the moment shown."""
        # Back, or far ahead: it is faster to start again a little before the moment.
        if not self._fed <= self.entry <= self._fed + _NEAR:
            self._begin_feed()
            self._fed = max(self.entry - LOOK_BACK, -1)
            before = self.playback.events(self._fed + 1 - ROUTE_BACK, self._fed + 1)
            self._feed.begin_route(each.event for each in before if not isinstance(each, BrokenLine))
        for logged in self.playback.events(self._fed + 1, self.entry + 1) if self._fed < self.entry else ():
            if isinstance(logged, BrokenLine):
                self._take(0.0, Notice(NoticeKind.FAULT, str(logged)))
            else:
                self._take(logged.real_time, logged.event)
        self._fed = self.entry

    def _begin_feed(self) -> None:
        """Restart the list of events, anywhere in the log."""
        # After a reset simulated time may be earlier than at the log's beginning.
        checkpoint = replace(self.index.header.checkpoint(self.configuration), time=0.0)
        self._feed, self._reducer, self._is_full = EventFeed(), Reducer(checkpoint), True

    def _take(self, real_time: float, event: Event) -> None:
        self._number += 1
        self._reducer.apply(event)
        self._feed.take(self._reducer, real_time, event, self._number)

    # -- the clock -------------------------------------------------------------------------------

    @property
    def duration(self) -> float:
        return self.index.duration

    def tick(self, seconds: float) -> bool:
        """Advance the clock by real seconds. Returns True once it has reached the end."""
        if not self.playing:
            return False
        self.move_to(self.elapsed + self.playback_rate * seconds)
        return self.elapsed >= self.duration

    def play(self, on: bool) -> None:
        """Start the clock, from the beginning if it is at the end; or stop it."""
        self.playing, self._changed = on, True
        if on and self.elapsed >= self.duration:
            self.move_to(0.0)

    def faster(self, steps: int) -> None:
        """Use another playback rate."""
        place = PLAYBACK_RATES.index(self.playback_rate) + steps
        self.playback_rate = PLAYBACK_RATES[min(max(place, 0), len(PLAYBACK_RATES) - 1)]
        self._changed = True

    def move_to(self, elapsed: float) -> None:
        """Show a moment."""
        elapsed = min(max(elapsed, 0.0), self.duration)
        self._show(self.index.find_time(elapsed), elapsed)

    def stand_at(self, entry: int) -> None:
        """Show the moment at which everything in an entry has happened."""
        self._show(entry, self.index.time_of(entry))

    def begin(self) -> None:
        """Show the moment before the first entry."""
        self.playing = False
        self._show(-1, 0.0)

    def stand_at_end(self) -> None:
        self.playing = False
        self._show(self.index.count - 1, self.duration if self.index.count else self.elapsed)

    def _show(self, entry: int, elapsed: float) -> None:
        self.entry, self.elapsed, self._changed = entry, elapsed, True

    def poll(self) -> bool:
        """Read what has been written since. Returns true if there was any. Who stood at the end stays there.

        Raises:
            RunLogError: if the log cannot be read any more.
        """
        at_end = self.entry >= self.index.count - 1
        fresh = self.index.refresh()
        if fresh and at_end and not self.playing:
            self.stand_at_end()
        self._changed |= bool(fresh)
        return bool(fresh)

    # -- marks -----------------------------------------------------------------------------------

    @property
    def marks(self) -> tuple[TimelineMark, ...]:
        """Contacts, goals and pauses, in order."""
        if self._marked[0] != self.index.count:
            self._marked = self.index.count, tuple(self._find_marks())
        return self._marked[1]

    def _find_marks(self) -> list[TimelineMark]:
        found = []
        index = self.index
        for entry in index.find_all(EntryFlag.CONTACT | EntryFlag.MISSION | EntryFlag.ACTION):
            marks = index.flags_of(entry)
            if EntryFlag.CONTACT in marks:
                found.append(TimelineMark(TimelineMarkKind.CONTACT, entry, index.time_of(entry)))
                continue
            line = index.record(entry)
            # A mission's beginning and its end are no goals.
            if isinstance(line, MissionRecord) and line.goal is not None:
                found.append(TimelineMark(TimelineMarkKind.GOAL, entry, index.time_of(entry)))
            elif isinstance(line, ActionRecord) and line.action is ActionName.PAUSE:
                found.append(TimelineMark(TimelineMarkKind.PAUSE, entry, index.time_of(entry)))
        return found

    def mark_from(self, kind: TimelineMarkKind, step: int) -> int | None:
        """Entry of the next (1) or previous (-1) mark of a kind, relative to the moment shown."""
        entries = [mark.entry for mark in self.marks if mark.kind is kind]
        if step > 0:
            return next((entry for entry in entries if entry > self.entry), None)
        return next((entry for entry in reversed(entries) if entry < self.entry), None)
