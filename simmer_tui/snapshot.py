"""What a screen shows: one frozen picture of the robot, its sensors and what has happened."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from simmer_tui.actions import ActionName
from simmer_tui.engine import ActionDone, Belief, Engine, Event, Notice, NoticeKind, TwinReading
from simmer_tui.mission import MissionState, Referee
from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.records import Contact, FloorPatch, Outcome, Pose, Reading, Status
from simmer_tui.sim.trajectory import Trajectory

HISTORY = 60
"""Readings kept of each sensor."""
EVENTS = 2000
"""Events kept for the log panel."""
MOVEMENTS = 30
"""Movements whose trail is shown."""
_TRAIL_POINTS = 40
_NO_TRAIL: FloatArray = np.empty((0, 2))
_RESTARTS = (ActionName.RESET, ActionName.SEED, ActionName.TELEPORT)


@dataclass(frozen=True, slots=True)
class LogEntry:
    """An event with its running number and the time of day (seconds since the epoch), light enough
    to be kept by the thousand: without a belief's particles and a movement's path. `contact` is
    what ended a movement."""

    number: int
    wall: float
    event: Event
    contact: Contact | None = None


@dataclass(frozen=True, slots=True)
class SensorRow:
    """What is known of one sensor: its newest reading, those before it (oldest first), and the
    running number of the event it came with."""

    reading: Reading
    history: tuple[float, ...]
    number: int


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Snapshot:
    """The state at one moment. Nothing here changes any more; any thread may read it.

    `trail` holds the centres gone through, `leg_starts` the index of the first of every movement.
    `line_age` is how long ago a line sensor was read, seconds of real time.
    `moved` is the running number of the last event that moved the robot. `entries` are the events
    since the number the asker knew. `rate` is commands a second of late.
    `twins` holds, by code, what the real robot and the simulated one last read side by side.
    `true_values` holds, by code, what each sensor would say now without error, when asked for.
    """

    time: float
    pose: Pose
    moving: bool
    touching: bool
    contact: Contact | None
    block: Block
    seed: int
    noise: bool
    paused: bool
    waiting: bool
    time_scale: float
    commands: int
    contacts: int
    distance: float
    trail: FloatArray
    leg_starts: tuple[int, ...]
    line_age: float | None
    holding: bool
    moved: int
    sensors: dict[str, SensorRow]
    twins: dict[str, TwinReading]
    last: Outcome | None
    belief: Belief | None
    client: str
    rate: float
    entries: tuple[LogEntry, ...]
    true_values: dict[str, float]
    mission: MissionState | None = None


class Recorder:
    """A watcher that keeps what snapshots need. Lives in the robot's thread."""

    def __init__(self, engine: Engine, referee: Referee | None = None) -> None:
        self._engine = engine
        self._referee = referee
        self._events: deque[LogEntry] = deque(maxlen=EVENTS)
        self._number = 0
        self._sensors: dict[str, tuple[Reading, deque[float], int]] = {}
        self._movements: deque[Trajectory] = deque(maxlen=MOVEMENTS)
        self._twins: dict[str, TwinReading] = {}
        self._moved = 0
        self._last: Outcome | None = None
        self._belief: Belief | None = None
        self._contact: Contact | None = None
        self._client = ""
        self._line_read: float | None = None
        self._rate = 0.0
        self._rated = (time.monotonic(), 0)

    def watch(self, event: Event) -> None:
        """Take note of an event."""
        self._number += 1
        self._events.append(_entry(self._number, event))
        if isinstance(event, Outcome):
            self._last = event
            if event.reading is not None:
                self._note_reading(event.reading)
            if event.trajectory is not None:
                self._movements.append(event.trajectory)
                self._moved = self._number
            elif event.status is Status.STOPPED:
                self._note_cut()
        elif isinstance(event, TwinReading):
            self._twins[event.code] = event
        elif isinstance(event, Belief):
            self._belief = event
        elif isinstance(event, Notice):
            if event.kind is NoticeKind.CONNECTED:
                self._client = event.subject
            elif event.kind is NoticeKind.LEFT and event.subject == self._client:
                self._client = ""
        elif isinstance(event, ActionDone) and not event.refused:
            self._note_action(event)

    def _note_reading(self, reading: Reading) -> None:
        known = self._sensors.get(reading.sensor.code)
        history = deque[float](maxlen=HISTORY) if known is None else known[1]
        history.append(reading.value)
        self._sensors[reading.sensor.code] = (reading, history, self._number)
        if isinstance(reading.view, FloorPatch):
            self._line_read = time.monotonic()

    def _note_action(self, done: ActionDone) -> None:
        self._note_cut()
        if done.action.name in _RESTARTS:
            self._movements.clear()
            self._sensors.clear()
            self._belief = None
            self._moved = self._number

    def _note_cut(self) -> None:
        """The last movement may have been cut short."""
        last = self._engine.simulator.last_trajectory
        if last is not None and self._movements and self._movements[-1].path is last.path:
            self._movements[-1] = last

    @property
    def number(self) -> int:
        """The running number of the newest event. Any thread may read it."""
        return self._number

    def snapshot(self, since: int = 0, true_values: bool = False) -> Snapshot:
        """The state now, with the events after number `since`. Call in the robot's thread."""
        engine, simulator = self._engine, self._engine.simulator
        now = engine.now()
        pose = simulator.pose
        trail, leg_starts = self._trail(now)
        contact = self._movements[-1].contact if self._movements else None
        if contact is not None and contact.time > now:
            contact = None
        return Snapshot(
            time=now,
            pose=pose,
            moving=simulator.moving,
            touching=contact is not None and contact.pose == pose,
            contact=contact,
            block=simulator.block,
            seed=simulator.seed,
            noise=simulator.noise,
            paused=engine.paused,
            waiting=engine.has_waiting,
            time_scale=engine.time_scale,
            commands=simulator.commands,
            contacts=simulator.contacts,
            distance=simulator.distance_at(now),
            trail=trail,
            leg_starts=leg_starts,
            line_age=None if self._line_read is None else time.monotonic() - self._line_read,
            holding=simulator.holding,
            moved=self._moved,
            sensors={
                code: SensorRow(reading, tuple(history), number)
                for code, (reading, history, number) in self._sensors.items()
            },
            twins=dict(self._twins),
            last=self._last,
            belief=self._belief,
            client=self._client,
            rate=self._measured_rate(simulator.commands),
            entries=self._since(since),
            true_values=self._true_values() if true_values else {},
            mission=self._referee.state() if self._referee is not None else None,
        )

    def _trail(self, now: float) -> tuple[FloatArray, tuple[int, ...]]:
        """The centres gone through, and the index of each movement's first."""
        parts: list[FloatArray] = []
        starts: list[int] = []
        count = 0
        for movement in self._movements:
            points = movement.trail(now)
            stride = max(1, len(points) // _TRAIL_POINTS)
            starts.append(count)
            parts += [points[:-1:stride], points[-1:]]
            count += len(parts[-2]) + len(parts[-1])
        return (np.concatenate(parts) if parts else _NO_TRAIL), tuple(starts)

    def _since(self, number: int) -> tuple[LogEntry, ...]:
        fresh = min(self._number - number, len(self._events))
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

    def _true_values(self) -> dict[str, float]:
        simulator = self._engine.simulator
        return {
            sensor.code: simulator.true_value(sensor.code)
            for sensor in simulator.spec.sensors
            if sensor.enabled
        }


def _entry(number: int, event: Event) -> LogEntry:
    contact = None
    if isinstance(event, Outcome) and event.trajectory is not None:
        contact = event.contact
        event = replace(event, trajectory=None)
    elif isinstance(event, Belief) and event.particles:
        event = replace(event, particles=())
    return LogEntry(number, time.time(), event, contact)
