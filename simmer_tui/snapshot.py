"""Samples for the screen: the state of a run at one moment, and the events that led to it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

from msgspec.structs import replace

from simmer_tui.engine import Engine
from simmer_tui.events import (
    ActionDone,
    Belief,
    CommandResult,
    Event,
    EventHandler,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    ProgramEnded,
    TwinReading,
)
from simmer_tui.mission import MissionState, Referee, mission_state
from simmer_tui.report.live_verdict import LiveVerdict
from simmer_tui.report.verdict import Verdict
from simmer_tui.run.facts import degrees_beside
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import State
from simmer_tui.sim.path import Contact
from simmer_tui.sim.records import Reading, Status

# Judged: nobody scrolls further back in a live list, and the log has all of them.
EVENTS = 2000
"""Entries kept for the list of events."""
KEPT_READINGS = 40
"""Of readings folded into one entry, how many are kept to be unfolded."""
# A sensor that looks further past a contact than this, degrees, says nothing of it.
_FAR_ASIDE = 90.0


@dataclass(frozen=True, slots=True)
class LogEntry:
    """An event worth a line, or the readings between two such.

    `number` is the running number of the (latest) event, `real_time` the time of day (seconds since the
    epoch), `time` simulated time. Events are light enough to be kept by the thousand: without a
    belief's particles and an outcome's path. Where readings are folded, `first` is the number of
    the first, `readings` and `beliefs` count all of them, `kept` holds the latest and `missing` counts those
    that are not kept. `nearest` is
    what the sensor that looks at a contact has read since the movement before, if any has; `wedged` tells
    of a robot that keeps meeting something in one place.
    """

    number: int
    real_time: float
    event: Event
    time: float = 0.0
    first: int = 0
    readings: int = 0
    beliefs: int = 0
    kept: tuple[LogEntry, ...] = ()
    nearest: Reading | None = None
    missing: int = 0
    wedged: bool = False

    @property
    def folds(self) -> bool:
        """True if it stands for several events."""
        return self.readings + self.beliefs > 0


class _Folded:
    """Readings since the last event worth a line of its own; all are counted, the latest kept."""

    def __init__(self, first: int) -> None:
        self.first = self.number = first
        self.readings = self.beliefs = 0
        self.kept: deque[tuple[LogEntry, bool]] = deque(maxlen=KEPT_READINGS)
        """The latest, each with True if it is among those counted."""

    def entry(self) -> LogEntry:
        kept = tuple(entry for entry, _ in self.kept)
        last, missing = kept[-1], self.readings + self.beliefs - sum(counted for _, counted in self.kept)
        return LogEntry(
            self.number, last.real_time, last.event, last.time, self.first, self.readings, self.beliefs, kept,
            missing=missing,
        )  # fmt: skip


class EventFeed(EventHandler[None]):
    """Events as people read them: a line for what matters, readings in between folded into one.

    Of a movement only the end has a line. Nothing is lost by coming too fast: what is folded is counted where
    it happens.
    """

    def __init__(self) -> None:
        self._entries: deque[LogEntry | _Folded] = deque(maxlen=EVENTS)
        self._number = 0
        self._real_time = 0.0
        self.is_judged = False
        """True from the line of a verdict until a program connects or the run begins anew."""
        self.total = 0
        """Entries so far, those that have given way included."""

    def take(self, reducer: Reducer, real_time: float, event: Event, number: int | None = None) -> None:
        """Take note of an event that the reducer has taken; its `number` is the reducer's by default."""
        self._reducer, self._real_time = reducer, real_time
        self._number = reducer.number if number is None else number
        self.handle(event)

    def since(self, number: int) -> tuple[LogEntry, ...]:
        """The entries with events after number `number`, the first perhaps one that has grown since."""
        found = []
        for entry in reversed(self._entries):
            if entry.number <= number:
                break
            found.append(entry.entry() if isinstance(entry, _Folded) else entry)
        return tuple(reversed(found))

    # -- events ----------------------------------------------------------------------------------

    def on_result(self, event: CommandResult) -> None:
        reading = event.reading
        if reading is not None and reading.view is not None:
            event = replace(event, reading=replace(reading, view=None))
        if event.status in (Status.DONE, Status.ACCEPTED):
            return
        # Who types a command waits for its answer, so it has a line of its own.
        if event.status is Status.READING and event.command.source != "console":
            self._fold(event).readings += 1
        else:
            self.other(event)

    def on_planned(self, event: MovementPlanned) -> None:
        """No line: the movement's end has one."""

    def on_ended(self, event: MovementEnded) -> None:
        # No line shows wheels and turns, and entries are kept by the thousand.
        light = replace(event, trajectory=replace(event.trajectory, wheels={}, turns={}))
        nearest = None if event.contact is None else self._nearest(event.contact)
        self.other(light, nearest, wedged=self._reducer.wedged)

    def on_program_ended(self, event: ProgramEnded) -> None:
        """No line: the verdict has one."""

    def on_notice(self, event: Notice) -> None:
        self.other(event)
        if event.kind in (NoticeKind.VERDICT, NoticeKind.CONNECTED):
            self.is_judged = event.kind is NoticeKind.VERDICT

    def on_action(self, event: ActionDone) -> None:
        self.other(event)
        self.is_judged = self.is_judged and not event.restarts

    def on_belief(self, event: Belief) -> None:
        light = replace(event, particles=())
        if event.note:
            self.other(light)
        else:
            self._fold(light).beliefs += 1

    def on_twin(self, event: TwinReading) -> None:
        self._fold(event, counted=False)

    def other(self, event: Event, nearest: Reading | None = None, *, wedged: bool = False) -> None:
        """A line of its own."""
        self._entries.append(self._entry(event, self._number, nearest, wedged=wedged))
        self.total += 1

    # -- within ----------------------------------------------------------------------------------

    def _entry(
        self, event: Event, first: int = 0, nearest: Reading | None = None, *, wedged: bool = False
    ) -> LogEntry:
        # Notices have no simulated time of their own.
        moment = getattr(event, "time", self._reducer.time)
        return LogEntry(self._number, self._real_time, event, moment, first, nearest=nearest, wedged=wedged)

    def _fold(self, event: Event, *, counted: bool = True) -> _Folded:
        last = self._entries[-1] if self._entries else None
        if not isinstance(last, _Folded):
            last = _Folded(self._number)
            self._entries.append(last)
            self.total += 1
        last.number = self._number
        last.kept.append((self._entry(event), counted))
        return last

    def _nearest(self, contact: Contact) -> Reading | None:
        """The last reading of the range sensor that looks at a contact, since the movement before."""
        best, least = None, _FAR_ASIDE
        for result in self._reducer.seen.values():
            reading = result.reading
            if reading is None or not reading.sensor.kind.is_range:
                continue
            aside = degrees_beside(contact, reading.sensor)
            if aside < least:
                best, least = replace(reading, view=None), aside
        return best


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Snapshot:
    """A run at one moment. Nothing here changes any more; any thread may read it.

    `number` is that of the newest event. `entries` are the events since the number the asker knew,
    or, if `anew`, all that are to be shown; `told` is how many there were so far. `rate` is commands
    a second of late, `waiting` tells that a command waits for a pause to end. `true_values` holds,
    by code, what each sensor would say now without error, when asked for. `pace` is at how many
    simulated seconds a second movements are shown, 0 as fast as possible.
    """

    state: State
    number: int = 0
    entries: tuple[LogEntry, ...] = ()
    anew: bool = False
    told: int = 0
    rate: float = 0.0
    waiting: bool = False
    true_values: Mapping[str, float] = field(default_factory=dict)
    mission: MissionState | None = None
    pace: float = 0.0
    verdict: Verdict | None = None
    """Outcome of the run, and its cause; None while it goes on."""


class Recorder:
    """A watcher that keeps the latest events and makes snapshots. Lives in the robot's thread."""

    def __init__(
        self,
        engine: Engine,
        reducer: Reducer,
        referee: Referee | None = None,
        verdict: LiveVerdict | None = None,
    ) -> None:
        """`reducer` must have taken each event before this is."""
        self._verdict = verdict
        self._engine = engine
        self._reducer = reducer
        self._referee = referee
        self._feed = EventFeed()
        self._rate = 0.0
        self._rated = (time.monotonic(), 0)

    def watch(self, event: Event) -> None:
        """Take note of an event."""
        self._feed.take(self._reducer, time.time(), event)

    @property
    def number(self) -> int:
        """The running number of the newest event. Any thread may read it."""
        return self._reducer.number

    def snapshot(self, since: int = 0, true_values: bool = False) -> Snapshot:
        """The state as it is to be shown now, with the events after number `since`. Call in the
        robot's thread."""
        engine = self._engine
        state = self._reducer.at(engine.shown_time())
        throttle = engine.throttle
        return Snapshot(
            state=state,
            number=self._reducer.number,
            entries=self._feed.since(since),
            told=self._feed.total,
            rate=self._measured_rate(state.commands),
            waiting=engine.has_waiting,
            true_values=engine.simulator.true_values() if true_values else {},
            mission=self._mission_at(state),
            pace=throttle.pace if throttle is not None else 0.0,
            verdict=self._verdict.verdict if self._verdict is not None and self._feed.is_judged else None,
        )

    def _mission_at(self, state: State) -> MissionState | None:
        if self._referee is None:
            return None
        throttle = self._engine.throttle
        if throttle is not None and throttle.busy:  # the referee knows already how the movement ends
            return mission_state(self._referee.plan, state)
        return self._referee.state(state.time)

    def _measured_rate(self, commands: int) -> float:
        moment, before = self._rated
        elapsed = time.monotonic() - moment
        # A shorter window would make the rate flicker.
        if elapsed >= 1.0:
            self._rate = max(commands - before, 0) / elapsed
            self._rated = (time.monotonic(), commands)
        return self._rate
