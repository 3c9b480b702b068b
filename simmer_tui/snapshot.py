"""What a screen samples: the state of a run at one moment, and the events that led there."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from simmer_tui.engine import Engine
from simmer_tui.events import Belief, Event, MovementEnded, MovementPlanned, Outcome
from simmer_tui.mission import MissionState, Referee, mission_state
from simmer_tui.state import State, StateFold

EVENTS = 2000
"""Events kept for the log panel."""


@dataclass(frozen=True, slots=True)
class LogEntry:
    """An event with its running number and the time of day (seconds since the epoch), light enough
    to be kept by the thousand: without a belief's particles and an outcome's path."""

    number: int
    wall: float
    event: Event


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Snapshot:
    """A run at one moment. Nothing here changes any more; any thread may read it.

    `entries` are the events since the number the asker knew. `rate` is commands a second of late,
    `waiting` tells that a command waits for a pause to end. `true_values` holds, by code, what each
    sensor would say now without error, when asked for. `pace` is at how many simulated seconds a
    second movements are shown, 0 as fast as possible.
    """

    state: State
    entries: tuple[LogEntry, ...] = ()
    rate: float = 0.0
    waiting: bool = False
    true_values: Mapping[str, float] = field(default_factory=dict)
    mission: MissionState | None = None
    pace: float = 0.0


class Recorder:
    """A watcher that keeps the latest events and makes snapshots. Lives in the robot's thread."""

    def __init__(self, engine: Engine, fold: StateFold, referee: Referee | None = None) -> None:
        """`fold` must have been told of each event before this is."""
        self._engine = engine
        self._fold = fold
        self._referee = referee
        self._events: deque[LogEntry] = deque(maxlen=EVENTS)
        self._rate = 0.0
        self._rated = (time.monotonic(), 0)

    def watch(self, event: Event) -> None:
        """Take note of an event."""
        self._events.append(LogEntry(self._fold.number, time.time(), lightened(event)))

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
            entries=self._since(since),
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

    def _since(self, number: int) -> tuple[LogEntry, ...]:
        fresh = min(self._fold.number - number, len(self._events))
        if fresh <= 0:
            return ()
        return tuple(self._events)[-fresh:]

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
        case Outcome() if event.trajectory is not None:
            return replace(event, trajectory=None)
        case Outcome() if event.reading is not None and event.reading.view is not None:
            return replace(event, reading=replace(event.reading, view=None))
        case MovementPlanned() | MovementEnded():
            return replace(event, trajectory=replace(event.trajectory, wheels={}, turns={}))
        case Belief() if event.particles:
            return replace(event, particles=())
    return event
