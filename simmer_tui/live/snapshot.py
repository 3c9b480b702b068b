"""Samples for the screen: the state of a run at one moment, and the events that led to it."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.live.route import Route, RouteKeeper
from simmer_tui.report.live_verdict import LiveVerdict
from simmer_tui.report.verdict import Verdict
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import (
    ActionDone,
    Belief,
    CommandResult,
    DisplayChanged,
    Event,
    EventHandler,
    LegBegun,
    LegEnded,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    ProgramEnded,
    TwinReading,
    WireMessage,
)
from simmer_tui.run.facts import BESIDE, degrees_beside
from simmer_tui.run.mission import MissionState, Referee, mission_state
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import State
from simmer_tui.sim.path import Contact
from simmer_tui.sim.records import LidarScan, Reading, Status, VelocityChange
from simmer_tui.sim.scan_rays import extremes
from simmer_tui.sketch.board_view import BoardView

# Judged: nobody scrolls further back in a live list, and the log has all of them.
EVENTS = 2000
"""Entries kept in the list of events."""
# A turn and the drive after it.
ENDS = 2
"""Ends of movements in a snapshot."""
KEPT_READINGS = 40
"""Readings of one folded entry that are kept to be unfolded: the latest."""
# Judged: time to look up and read two lines.
ADVICE = 15.0
"""Seconds (real) for which advice on a program's connection is shown although the program continues."""
# Judged: a program that changes it more often is steering, and a single change says little.
_STEERING = 1.0
"""Simulated seconds within which changes of the velocity are folded into one entry."""
_BY_HAND = ("console",)
"""Sources whose commands have an entry each: a person who types a command waits for it."""
_NOTHING = np.empty(0)
"""The true ranges of a scan in an entry: none are kept."""


# Without garbage collection (gc=False): entries hold no cycles, and thousands are kept.
class LogEntry(Struct, frozen=True, gc=False):
    """An event of the list, or the readings between two such events.

    `number` is the running number of the (latest) event, `real_time` the time of day (seconds since the
    epoch), `time` simulated time. Events are kept without large parts: a belief's particles and cells, a
    result's path. Where readings are folded, `first` is the number of the first. `readings`, `beliefs`,
    `velocities` and `prints` (of boards) count all of them; `kept` holds the latest and `missing` counts the
    others. `nearest` is the latest reading of the sensor that points at a contact, since the movement before.
    `wedged` is true if the robot keeps touching something in one place.
    """

    number: int
    real_time: float
    event: Event
    time: float = 0.0
    first: int = 0
    readings: int = 0
    beliefs: int = 0
    velocities: int = 0
    kept: tuple[LogEntry, ...] = ()
    nearest: Reading | None = None
    missing: int = 0
    wedged: bool = False
    prints: int = 0

    @property
    def folds(self) -> bool:
        """True if the entry represents several events."""
        return self.readings + self.beliefs + self.velocities + self.prints > 0


_FoldedEvent = CommandResult | Belief | TwinReading | WireMessage


class _Folded:
    """Readings since the last event with an entry of its own. All are counted, the latest kept.

    It keeps them as they came, and is an entry only when one is asked for: most have given way by then.
    """

    def __init__(self, first: int) -> None:
        self.first = self.number = first
        self.readings = self.beliefs = self.velocities = self.prints = 0
        self.kept: deque[tuple[int, float, _FoldedEvent, bool]] = deque(maxlen=KEPT_READINGS)
        """The latest: running number, real time, and True if it is among those counted."""

    def entry(self) -> LogEntry:
        kept = tuple(
            LogEntry(number, real_time, light := _light_event(event), light.time)
            for number, real_time, event, _ in self.kept
        )
        last, all_of_them = kept[-1], self.readings + self.beliefs + self.velocities + self.prints
        return LogEntry(
            self.number, last.real_time, last.event, last.time, self.first, self.readings, self.beliefs,
            self.velocities, kept, missing=all_of_them - sum(counted for *_, counted in self.kept),
            prints=self.prints,
        )  # fmt: skip


class EventFeed(EventHandler[None]):
    """Events as people read them: an entry for each important one, readings in between folded into one.

    A movement has an entry only at its end. None is lost by coming too fast: folded events are counted.
    """

    def __init__(self) -> None:
        self._entries: deque[LogEntry | _Folded] = deque(maxlen=EVENTS)
        self._number = 0
        self._real_time = 0.0
        self._advice = ""
        self._advised = self._answered = 0.0
        self._steered = -math.inf
        """Simulated time at which the velocity changed last."""
        self.is_judged = False
        """True from the line of a verdict until a program connects or the run restarts."""
        self.total = 0
        """Entries so far, those that have given way included."""
        self._route = RouteKeeper()
        self.ends: deque[MovementEnded] = deque(maxlen=ENDS)
        """Ends of the latest movements, the newest first."""

    def take(self, reducer: Reducer, real_time: float, event: Event, number: int | None = None) -> None:
        """Add an event that the reducer has applied. `number` is by default the reducer's."""
        self._reducer, self._real_time = reducer, real_time
        self._number = reducer.number if number is None else number
        self.handle(event)

    def take_readings(
        self, reducer: Reducer, real_times: Sequence[float], results: Sequence[CommandResult]
    ) -> None:
        """Add readings that follow each other, all of which the reducer has applied."""
        self._reducer, self._number = reducer, reducer.number - len(results)
        for self._real_time, result in zip(real_times, results, strict=True):
            self._number += 1
            self.on_result(result)

    def begin_route(self, events: Iterable[Event]) -> None:
        """Take the route of events before the first of the list."""
        for event in events:
            match event:
                case LegEnded() | MovementEnded():
                    self._lengthen(event)
                case ActionDone() if event.restarts:
                    self._route.clear()

    @property
    def route(self) -> Route:
        """Route of the movements that are over."""
        return self._route.route

    def since(self, number: int) -> tuple[LogEntry, ...]:
        """The entries with events after number `number`. The first may be an older entry that has grown
        since."""
        found = []
        for entry in reversed(self._entries):
            if entry.number <= number:
                break
            found.append(entry.entry() if isinstance(entry, _Folded) else entry)
        return tuple(reversed(found))

    def advice_at(self, real_time: float) -> str:
        """Advice on the connection of the program that drives now. Empty after its time, if commands are
        answered."""
        is_shown = real_time - self._advised < ADVICE or self._answered <= self._advised
        return self._advice if is_shown else ""

    # -- events ----------------------------------------------------------------------------------

    def on_result(self, event: CommandResult) -> None:
        self._answered = self._real_time
        if event.velocity is not None:
            self._take_velocity(event, event.velocity)
            return
        if event.status in (Status.DONE, Status.ACCEPTED):
            return
        # A person who types a command waits for its answer, so the command has an entry of its own.
        if event.status is Status.READING and event.command.source not in _BY_HAND:
            self._fold(event).readings += 1
        else:
            self.other(_light_event(event))

    def _take_velocity(self, event: CommandResult, velocity: VelocityChange) -> None:
        """Add an entry for a velocity that changes.

        Changes by a program that steers are folded, since they come by the hundred. A repeated velocity has
        no entry.
        """
        if not velocity.changed:
            return
        since, self._steered = event.time - self._steered, event.time
        if 0.0 <= since < _STEERING and event.command.source not in _BY_HAND:
            self._fold(event).velocities += 1
        else:
            self.other(event)

    def on_leg_begun(self, event: LegBegun) -> None:
        """No entry: the command that set its velocity has one."""

    def on_leg_ended(self, event: LegEnded) -> None:
        self._lengthen(event)
        if event.contact is not None:
            self.ends.appendleft(event.as_movement())
            self.other(event.as_movement(), self._nearest(event.contact), wedged=self._reducer.wedged)

    def on_planned(self, event: MovementPlanned) -> None:
        """No entry: the movement's end has one."""

    def on_ended(self, event: MovementEnded) -> None:
        # No entry shows wheels and turns, and entries are kept by the thousand.
        light = replace(event, trajectory=replace(event.trajectory, wheels={}, turns={}))
        self._lengthen(event)
        nearest = None if event.contact is None else self._nearest(event.contact)
        self.ends.appendleft(light)
        self.other(light, nearest, wedged=self._reducer.wedged)

    def on_program_ended(self, event: ProgramEnded) -> None:
        """No entry: the verdict has one."""

    def on_notice(self, event: Notice) -> None:
        self.other(event)
        if event.kind in (NoticeKind.VERDICT, NoticeKind.CONNECTED):
            self.is_judged = event.kind is NoticeKind.VERDICT
        if event.advice:
            self._advice, self._advised = event.text, self._real_time

    def on_action(self, event: ActionDone) -> None:
        self.other(event)
        self.is_judged = self.is_judged and not event.restarts
        if event.restarts:
            self.ends.clear()
            self._route.clear()
        self._advice = "" if event.restarts else self._advice

    def on_belief(self, event: Belief) -> None:
        if event.again:
            return
        if event.note:
            self.other(_light_event(event))
        else:
            self._fold(event).beliefs += 1

    def on_wire(self, event: WireMessage) -> None:
        if event.port:
            # A sketch may print in each pass of its loop.
            self._fold(event).prints += 1
        else:
            self.other(event)

    def on_display(self, event: DisplayChanged) -> None:
        """No entry: the boards' panel shows it."""

    def on_twin(self, event: TwinReading) -> None:
        self._fold(event, counted=False)

    def other(self, event: Event, nearest: Reading | None = None, *, wedged: bool = False) -> None:
        """Add an entry of its own for an event."""
        if self._entries and isinstance(last := self._entries[-1], _Folded):
            self._entries[-1] = last.entry()
        # Notices have no simulated time of their own.
        moment, number = getattr(event, "time", self._reducer.time), self._number
        self._entries.append(
            LogEntry(number, self._real_time, event, moment, number, nearest=nearest, wedged=wedged)
        )
        self.total += 1

    # -- within ----------------------------------------------------------------------------------

    def _lengthen(self, event: LegEnded | MovementEnded) -> None:
        path = event.leg if isinstance(event, LegEnded) else event.trajectory
        end = path.end_time if isinstance(event, LegEnded) else event.time
        self._route.add(path.centres(end), path.start_time, end)

    def _fold(self, event: _FoldedEvent, *, counted: bool = True) -> _Folded:
        last = self._entries[-1] if self._entries else None
        if not isinstance(last, _Folded):
            last = _Folded(self._number)
            self._entries.append(last)
            self.total += 1
        last.number = self._number
        last.kept.append((self._number, self._real_time, event, counted))
        return last

    def _nearest(self, contact: Contact) -> Reading | None:
        """The last reading of the range sensor that points at a contact, since the movement before."""
        best, least = None, BESIDE
        for result in self._reducer.seen.values():
            reading = result.reading
            if reading is None or not reading.sensor.kind.is_range:
                continue
            aside = degrees_beside(contact, reading.sensor)
            if aside <= least:
                best, least = _light(reading), aside
        return best


def _light_event(event: _FoldedEvent) -> _FoldedEvent:
    """An event without its large parts, since entries are kept by the thousand."""
    if isinstance(event, Belief):
        grid = None if event.grid is None else replace(event.grid, cells=b"")
        return replace(event, particles=(), grid=grid)
    if isinstance(event, TwinReading | WireMessage):
        return event
    reading = event.reading
    has_parts = reading is not None and (reading.view is not None or reading.scan is not None)
    return replace(event, reading=_light(reading)) if reading is not None and has_parts else event


def _light(reading: Reading) -> Reading:
    """A reading without its geometry, since entries are kept by the thousand.

    A scan has some kilobytes. Only its number of rays and its nearest echo are kept: every ray of the result
    has that range.
    """
    scan = reading.scan
    if scan is not None:
        near, at = extremes(scan).nearest or (math.inf, 0.0)
        rays = len(scan.ranges)
        scan = LidarScan(
            scan.revolution, np.broadcast_to(near, rays), np.broadcast_to(at, rays), _NOTHING, _NOTHING
        )
    return replace(reading, view=None, scan=scan)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Snapshot:
    """A run at one moment. It never changes; any thread may read it.

    One frame of the screen shows one snapshot: each current value on it is a function of this alone. Lists,
    sparklines and the radar are history; they may lag, and have times of their own.

    `number` is that of the newest event. `entries` are the events since the number that was asked for, or, if
    `is_full`, all entries to show. `total` counts all entries so far. `rate` is recent commands a second.
    `waiting` is true if a command waits for a pause to end. `true_values` holds, by code, each sensor's value
    without error, if asked for. `pace` is that of the movements shown, simulated seconds a second, 0 as fast
    as possible; `pace_text` is the same in a word or two.
    """

    state: State
    number: int = 0
    entries: tuple[LogEntry, ...] = ()
    is_full: bool = False
    total: int = 0
    rate: float = 0.0
    waiting: bool = False
    true_values: Mapping[str, float] = field(default_factory=dict)
    ends: tuple[MovementEnded, ...] = ()
    """Ends of the latest movements, the newest first."""
    route: Route = field(default_factory=Route)
    """Route of the movements that are over, since the start of the run."""
    mission: MissionState | None = None
    pace: float = 0.0
    pace_text: str = ""
    verdict: Verdict | None = None
    """Outcome of the run, and its cause; None while it continues."""
    boards: tuple[BoardView, ...] = ()
    """The team's boards, if they drive the robot."""
    advice: str = ""
    """Advice on a mistake of a new program's connection, or empty."""


class Recorder:
    """Keeps the latest events and makes snapshots. Only for the robot's thread."""

    def __init__(
        self,
        engine: Engine,
        reducer: Reducer,
        referee: Referee | None = None,
        verdict: LiveVerdict | None = None,
    ) -> None:
        """`reducer` is given all events, and has the state that is shown."""
        self._verdict = verdict
        self._engine = engine
        self._reducer = reducer
        self._referee = referee
        self._feed = EventFeed()
        self._epoch = time.time() - time.monotonic()
        """Seconds since 1970 at the zero of `time.monotonic`."""
        self._rate = 0.0
        self._rated = (time.monotonic(), 0)
        self.boards: Callable[[], tuple[BoardView, ...]] = tuple
        """The boards of the run as they are now."""

    def apply(self, event: Event, line: int = 0, real_time: float = math.nan) -> None:
        """Add an event; `real_time` is that of `time.monotonic`, if it came before."""
        self._reducer.apply(event)
        now = time.monotonic() if real_time != real_time else real_time
        self._feed.take(self._reducer, self._epoch + now, event)

    def apply_readings(
        self, results: Sequence[CommandResult], lines: Sequence[int], real_times: Sequence[float]
    ) -> None:
        """Add readings that follow each other."""
        self._reducer.apply_readings(results, lines, real_times)
        self._feed.take_readings(self._reducer, [self._epoch + each for each in real_times], results)

    @property
    def number(self) -> int:
        """The running number of the newest event. Any thread may read it."""
        return self._reducer.number

    def snapshot(self, since: int = 0, true_values: bool = False) -> Snapshot:
        """The state that is to be shown now, with the entries after number `since`. Call it in the robot's
        thread."""
        engine = self._engine
        state = self._reducer.at(engine.shown_time())
        throttle = engine.throttle
        return Snapshot(
            state=state,
            number=self._reducer.number,
            entries=self._feed.since(since),
            total=self._feed.total,
            ends=tuple(self._feed.ends),
            route=self._feed.route,
            rate=self._measured_rate(state.commands),
            waiting=engine.has_waiting,
            # A movement that is shown at a pace is over already in the simulator.
            true_values=engine.simulator.true_values(state.pose) if true_values else {},
            mission=self._mission_at(state),
            pace=throttle.pace if throttle is not None else 0.0,
            boards=self.boards(),
            advice=self._feed.advice_at(self._epoch + time.monotonic()),
            verdict=self._verdict.verdict if self._verdict is not None and self._feed.is_judged else None,
        )

    def _mission_at(self, state: State) -> MissionState | None:
        if self._referee is None:
            return None
        throttle = self._engine.throttle
        # the referee already knows the end of the movement, which is not shown yet
        if throttle is not None and throttle.busy:
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
