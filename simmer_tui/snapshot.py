"""What the screen samples: the state of a run at one moment, and the events that led to it."""

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
    MovementEnded,
    MovementPlanned,
    Notice,
    TwinReading,
)
from simmer_tui.mission import MissionState, Referee, mission_state
from simmer_tui.run.facts import degrees_beside
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import State
from simmer_tui.sim.path import Contact
from simmer_tui.sim.records import Reading, Status

EVENTS = 2000
"""Entries kept for the list of events."""
KEPT_READINGS = 40
"""Of readings folded into one entry, how many are kept to be unfolded."""
_FAR_ASIDE = 90.0
"""A sensor that looks further past a contact than this, degrees, says nothing of it."""


@dataclass(frozen=True, slots=True)
class LogEntry:
    """An event worth a line, or the readings between two such.

    `number` is the running number of the (latest) event, `wall` the time of day (seconds since the
    epoch), `time` simulated time. Events are light enough to be kept by the thousand: without a
    belief's particles and an outcome's path. Where readings are folded, `first` is the number of
    the first, `readings` and `beliefs` count all of them, and `kept` holds the latest. `nearest` is
    what the sensor that looks at a contact has read since the movement before, if any has.
    """

    number: int
    wall: float
    event: Event
    time: float = 0.0
    first: int = 0
    readings: int = 0
    beliefs: int = 0
    kept: tuple[LogEntry, ...] = ()
    nearest: Reading | None = None

    @property
    def folds(self) -> bool:
        """Whether it stands for several events."""
        return self.readings + self.beliefs > 0


class _Folded:
    """Readings since the last event worth a line of its own; all are counted, the latest kept."""

    def __init__(self, first: int) -> None:
        self.first = first
        self.number = first
        self.readings = 0
        self.beliefs = 0
        self._kept: deque[tuple[int, float, Event, float]] = deque(maxlen=KEPT_READINGS)

    def add(self, number: int, wall: float, event: Event, time: float) -> None:
        self.number = number
        if isinstance(event, CommandResult):
            self.readings += 1
        elif isinstance(event, Belief):
            self.beliefs += 1
        self._kept.append((number, wall, event, time))

    def entry(self) -> LogEntry:
        kept = tuple(LogEntry(n, wall, lightened(event), time) for n, wall, event, time in self._kept)
        last = kept[-1]
        return LogEntry(
            self.number, last.wall, last.event, last.time, self.first, self.readings, self.beliefs, kept
        )


class EventFeed:
    """Events as people read them: a line for what matters, readings in between folded into one.

    Nothing is lost by coming too fast: what is folded is counted where it happens.
    """

    def __init__(self) -> None:
        self._entries: deque[LogEntry | _Folded] = deque(maxlen=EVENTS)
        self._time = 0.0
        self._last: dict[str, Reading] = {}
        self.total = 0
        """Entries so far, those that have given way included."""

    def take(self, number: int, wall: float, event: Event) -> None:
        """Take note of an event with its running number."""
        if not isinstance(event, Notice):
            self._time = event.time
        if isinstance(event, CommandResult) and event.reading is not None:
            self._last[event.reading.sensor.code] = event.reading
        if not is_told(event):
            return
        if is_folded(event):
            last = self._entries[-1] if self._entries else None
            if not isinstance(last, _Folded):
                last = _Folded(number)
                self._append(last)
            last.add(number, wall, event, self._time)
            return
        nearest = None
        if isinstance(event, MovementEnded) and event.contact is not None:
            nearest = self._nearest(event.contact)
        if _moves(event):
            self._last = {}  # they were taken from where the robot no longer is
        self._append(LogEntry(number, wall, lightened(event), self._time, number, nearest=nearest))

    def since(self, number: int) -> tuple[LogEntry, ...]:
        """The entries with events after number `number`, the first perhaps one that has grown since."""
        found = []
        for entry in reversed(self._entries):
            if entry.number <= number:
                break
            found.append(entry.entry() if isinstance(entry, _Folded) else entry)
        return tuple(reversed(found))

    def _append(self, entry: LogEntry | _Folded) -> None:
        self._entries.append(entry)
        self.total += 1

    def _nearest(self, contact: Contact) -> Reading | None:
        """What the range sensor that looks at a contact has read since the movement before."""
        best, least = None, _FAR_ASIDE
        for reading in self._last.values():
            aside = degrees_beside(contact, reading.sensor)
            if reading.sensor.kind.is_range and aside < least:
                best, least = reading, aside
        return best


def _moves(event: Event) -> bool:
    """Whether the robot stands elsewhere after an event."""
    match event:
        case MovementEnded(grip=None):
            return True
        case ActionDone(action=action, refused=False):
            return action.name.places
    return False


def is_told(event: Event) -> bool:
    """Whether an event is in the list of events: of a movement only the end is."""
    match event:
        case MovementPlanned():
            return False
        case CommandResult(status=Status.DONE | Status.ACCEPTED):
            return False
    return True


def is_folded(event: Event) -> bool:
    """Whether an event has no line of its own: a reading that nobody has typed, a bare belief."""
    match event:
        case CommandResult(status=Status.READING, command=command):
            return command.source != "console"
        case Belief(note=note):
            return not note
        case TwinReading():
            return True
    return False


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


class Recorder:
    """A watcher that keeps the latest events and makes snapshots. Lives in the robot's thread."""

    def __init__(self, engine: Engine, fold: Reducer, referee: Referee | None = None) -> None:
        """`fold` must have been told of each event before this is."""
        self._engine = engine
        self._fold = fold
        self._referee = referee
        self._feed = EventFeed()
        self._rate = 0.0
        self._rated = (time.monotonic(), 0)

    def watch(self, event: Event) -> None:
        """Take note of an event."""
        self._feed.take(self._fold.number, time.time(), event)

    @property
    def number(self) -> int:
        """The running number of the newest event. Any thread may read it."""
        return self._fold.number

    def snapshot(self, since: int = 0, true_values: bool = False) -> Snapshot:
        """The state as it is to be shown now, with the events after number `since`. Call in the
        robot's thread."""
        engine = self._engine
        state = self._fold.at(engine.shown_time())
        pacer = engine.pacer
        return Snapshot(
            state=state,
            number=self._fold.number,
            entries=self._feed.since(since),
            told=self._feed.total,
            rate=self._measured_rate(state.commands),
            waiting=engine.has_waiting,
            true_values=engine.simulator.true_values() if true_values else {},
            mission=self._mission_at(state),
            pace=pacer.pace if pacer is not None else 0.0,
        )

    def _mission_at(self, state: State) -> MissionState | None:
        if self._referee is None:
            return None
        pacer = self._engine.pacer
        if pacer is not None and pacer.busy:  # the referee knows already how the movement ends
            return mission_state(self._referee.plan, state)
        return self._referee.state(state.time)

    def _measured_rate(self, commands: int) -> float:
        moment, before = self._rated
        elapsed = time.monotonic() - moment
        if elapsed >= 1.0:
            self._rate = max(commands - before, 0) / elapsed
            self._rated = (time.monotonic(), commands)
        return self._rate


def lightened(event: Event) -> Event:
    """An event without what is large: it is kept to be read, not to be drawn."""
    match event:
        case CommandResult() if event.trajectory is not None:
            return replace(event, trajectory=None)
        case CommandResult() if event.reading is not None and event.reading.view is not None:
            return replace(event, reading=replace(event.reading, view=None))
        case MovementPlanned() | MovementEnded():
            return replace(event, trajectory=replace(event.trajectory, wheels={}, turns={}))
        case Belief() if event.particles:
            return replace(event, particles=())
    return event
