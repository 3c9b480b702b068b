"""All that happened in a run: tables of rows, the newest kept, and sums over the whole of it.

The reducer fills it, event by event. All questions about a run are queries on it: of the report and its
causes, the player, the referee's record, trials, calibration and the screen. At 200,000 commands it takes
less than 30 MB; `benchmarks/bench_history.py` measures it.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from simmer_tui.config.nominal import Nominal
from simmer_tui.dialect.fault_notices import UNKNOWN_MESSAGE
from simmer_tui.run.episodes import BeliefEpisodes
from simmer_tui.run.events import (
    ActionDone,
    Belief,
    CommandResult,
    DisplayChanged,
    LegBegun,
    LegEnded,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
    ProgramEnded,
    WireMessage,
)
from simmer_tui.run.facts import PRESSED, PRESSED_DISTANCE, Stuck, deviation, is_same_place
from simmer_tui.run.history_rows import (
    ActionRow,
    BeliefRow,
    BiasRow,
    BlockPose,
    CommandRow,
    ContactRow,
    DisplayRow,
    GripRow,
    MissionRow,
    MovementRow,
    NoticeRow,
    ProgramRow,
    ReadingRow,
    RefusalRow,
    RepeatedContact,
    SeenReading,
)
from simmer_tui.run.message_trail import MessageTrail
from simmer_tui.run.paths import PathRecord, Truth
from simmer_tui.run.phrases import obstacles_text
from simmer_tui.run.state import Checkpoint
from simmer_tui.run.table import Columns, Errors, Newest, RowTable, Thinned
from simmer_tui.sim.arrays import BoolArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import parse_value
from simmer_tui.sim.command_codes import code_meanings
from simmer_tui.sim.gripper import in_robot_frame
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import REFUSALS
from simmer_tui.sim.specs import Axes, DriveKind
from simmer_tui.sim.trajectory import Trajectory

_KEPT = 200_000
"""Most rows of commands that are kept. A minute of the fastest program has 150,000."""
KEPT_BELIEFS = 15_000
"""Beliefs kept. Programs send one a movement, and a tenth of commands are movements."""
KEPT_OBJECTS = 500
"""Contacts, grips, actions and the like that are kept: as many as a player marks."""
# A dialect has some twenty commands; a program that speaks another language sends anything.
KEPT_MESSAGES = 60
"""Messages of a dialect that are counted separately; all others are counted together."""
KEPT_DISPLAYS = 4000
"""Changes of what boards show: a mission of 300 s has 3,000 of one that counts."""
KEPT_BLOCKS = 6000
"""Poses of the block: two for each movement that a player shows."""
TRACE_POINTS = 800
"""Most points of one sensor's trace: the strip of a report is 800 points wide."""
CHAIN = 21
"""Newest movements kept whole: the deciding one, and the 20 before it that counterfactuals may repeat."""
STUCK = 3
"""Movements in a row that a contact ended and that count as being stuck: two happen to good programs."""
OTHER_CODES = "other"
STOPS = "stop"
"""Name under which commands that stop the robot are counted, whichever their names in a dialect."""
# The largest number of a command that a row holds: a damaged log may have any.
_LARGEST = 2**31 - 1
# A program uses some hundred values; one that never repeats itself must not fill the memory.
_value = lru_cache(maxsize=4096)(parse_value)
_NOTHING_ASKED = (math.nan, Axes(math.nan, math.nan, math.nan))
# Sources that are counted separately: addresses come from outside, and there may be any number.
_SOURCES = 20


class ElapsedTime:
    """Simulated time since a log's beginning; it continues through resets and never goes back."""

    def __init__(self, begin: float) -> None:
        self.before = -begin
        """Seconds to add to simulated time in the present stretch, between two resets."""
        self.now = 0.0

    def skip(self, elapsed: float) -> None:
        """Skip to an elapsed time: nothing before it counts."""
        self.now = max(self.now, elapsed)

    def restart(self, time: float) -> None:
        """Restart the run, with this simulated time."""
        self.before = self.now - time

    def advance(self, time: float) -> float:
        """Advance to the next simulated time. Returns its elapsed time."""
        # A damaged or edited log may go back in time; a clock that went back would break every search.
        elapsed = self.before + time
        if elapsed > self.now:
            self.now = elapsed
        return self.now


class TracePoint(NamedTuple):
    """A reading in a trace. `order` counts the sensor's readings from 0."""

    elapsed: float
    order: int
    value: float
    true: float


class SensorTotals(Struct):
    """Sums over the readings of one sensor."""

    trace: Thinned[TracePoint] = field(default_factory=lambda: Thinned(TRACE_POINTS))
    readings: int = 0
    errors: Errors = field(default_factory=Errors)
    missed: int = 0
    """Readings that saw something where nothing was in range, or the reverse."""
    seconds: float = 0.0
    """Simulated seconds spent reading it."""


class CodeTotals(Struct):
    """Commands with one code: all, those that did nothing, and their contacts."""

    count: int = 0
    refused: int = 0
    contacts: int = 0


class _Names(dict[str, int]):
    """Indices of names, in the order in which they came. Text from outside must not fill the list: names that
    are not `known`, and those beyond `most`, share `OTHER_CODES`."""

    def __init__(self, known: Container[str] | None = None, most: int = 1 << 16) -> None:
        super().__init__()
        self.names: list[str] = []
        self._known = known
        # 16-bit indices have no room for more names.
        self._most = most

    def __missing__(self, name: str) -> int:
        if len(self.names) >= self._most or not (self._known is None or name in self._known):
            name = OTHER_CODES
        index = self.setdefault(name, len(self.names))
        if index == len(self.names):
            self.names.append(name)
        return index


class Totals:
    """Sums over a whole run, those of rows that are no longer kept included."""

    def __init__(self) -> None:
        self.commands = 0
        self.codes: dict[str, CodeTotals] = {}
        self.sources: Counter[str] = Counter()
        self.messages: Counter[tuple[str, str]] = Counter()
        """Messages of a dialect by the pattern that they match, or, without one, by their text and the
        reason."""
        self.wires = 0
        """Messages and replies of a dialect."""
        self.link_seconds = 0.0
        """Simulated seconds on the link."""
        self.last_command_line = 0
        self.sensors: dict[str, SensorTotals] = {}
        """By the sensor's ID."""
        self.movements = 0
        self.legs = 0
        """Legs of continuous motion, which do not count as movements: one velocity may lead to hundreds."""
        self.distance = 0.0
        """Inches driven."""
        self.turned = 0.0
        """Degrees turned, either way."""
        self.driving_seconds = 0.0
        self.contacts = 0
        self.contacts_that_ended = 0
        """Contacts that ended their movements; after the others the robot continued."""
        self.actions: Counter[str] = Counter()
        self.beliefs = Errors()
        self.belief_turns = Errors()
        self.entropies = Errors()
        """Entropies of grids, bits."""
        self.missed_shares = Errors()
        """Probability that each grid gave to states other than the true one."""
        self.belief_trace: Thinned[BeliefRow] = Thinned(TRACE_POINTS)


class RunHistory:
    """Tables and sums of all events that a reducer has applied. Query it at any time, in the reducer's
    thread."""

    # CPython keeps up to 30 attributes in an object, more in a dictionary: without slots a report takes 3 %
    # longer.
    __slots__ = (
        "__dict__",  # of cached properties
        *("_read_nominal", "is_twin", "spec", "paths", "_now", "clock", "begun", "start"),
        *("order", "line", "real_time", "_first", "_totals", "_trail", "_names", "_velocities"),
        *("_codes", "_sensors", "_sources", "code_names", "source_names", "sensor_codes"),
        *("readings", "movements", "beliefs", "commands", "contacts", "refusals", "actions", "grips"),
        *("notices", "faults", "missions", "displays", "programs", "blocks", "biases", "repeated", "newest"),
        *("is_over", "episodes", "wedged", "began", "placed"),
        *("_truth", "_gone", "_turned", "_holding", "_blocked"),
    )

    def __init__(
        self,
        checkpoint: Checkpoint,
        *,
        log_begins: float = 0.0,
        counters_known: bool = True,
        paths: PathRecord | None = None,
        now: Callable[[], float] | None = None,
        kept: int = _KEPT,
        nominal: Callable[[], Nominal | None] = lambda: None,
    ) -> None:
        """Make the history of a run from a checkpoint on.

        Args:
            checkpoint: State from which the history continues.
            log_begins: Simulated time from which elapsed time counts.
            counters_known: True if counting sensors begin at 0.
            paths: Record of the paths, if they are to be drawn.
            now: Clock of real time, for events that come without one.
            kept: Most rows of commands that are kept.
            nominal: Reads the set that the run's own is a variant of; called on first use, as it takes time.
        """
        self._read_nominal = nominal
        self.is_twin = False
        """True if the robot is a real one: true values are then those of its simulated twin."""
        self.spec = spec = checkpoint.spec
        self.paths = paths
        self._now = now
        self.clock = ElapsedTime(log_begins)
        self.begun = self.clock.advance(checkpoint.time)
        self.start = checkpoint.pose
        self.order = 0
        """The running number of the newest event."""
        self.line = 0
        self.real_time = math.nan
        self._first: float | None = None
        """Real time of the first event, seconds."""
        self._totals = Totals()
        self._trail = MessageTrail()
        self.unanswered: tuple[str, float] | None = None
        """The last message of a dialect or to a sketch, with its elapsed time, unless a reply came since."""
        self._names = {each.code: each.id for each in spec.sensors}
        self._velocities = frozenset(each.code for each in spec.velocities)
        self._codes, self._sensors = _Names(frozenset((*code_meanings(spec), STOPS))), _Names()
        self._sources = _Names(most=_SOURCES)
        self.code_names, self.source_names = self._codes.names, self._sources.names
        self.sensor_codes = self._sensors.names
        self.readings = RowTable(ReadingRow, kept, self._sum_readings)
        self.movements = RowTable(MovementRow, kept, self._sum_movements)
        self.beliefs = RowTable(BeliefRow, KEPT_BELIEFS, self._sum_beliefs)
        rows = (self.readings, self.movements, self.beliefs)
        # Commands are the most frequent rows: when theirs are dropped, the others of that time go with them.
        self.commands = RowTable(CommandRow, kept, self._sum_commands, rows)
        self.contacts: Newest[ContactRow] = Newest(KEPT_OBJECTS)
        self.refusals: Newest[RefusalRow] = Newest(KEPT_OBJECTS)
        self.actions: Newest[ActionRow] = Newest(KEPT_OBJECTS)
        self.grips: Newest[GripRow] = Newest(KEPT_OBJECTS)
        self.notices: Newest[NoticeRow] = Newest(KEPT_OBJECTS)
        self.faults: Newest[NoticeRow] = Newest(KEPT_OBJECTS)
        self.missions: Newest[MissionRow] = Newest(KEPT_OBJECTS)
        self.displays: Newest[DisplayRow] = Newest(KEPT_DISPLAYS)
        """LEDs and displays of boards, as they have changed."""
        self.programs: Newest[ProgramRow] = Newest(KEPT_OBJECTS)
        """Ends of the programs that the simulator started."""
        self.blocks: Newest[BlockPose] = Newest(KEPT_BLOCKS)
        self.biases: Newest[BiasRow] = Newest(KEPT_OBJECTS)
        self.repeated: Newest[RepeatedContact] = Newest(1)
        """Contacts, those in a row at one place as one."""
        self.newest: deque[tuple[int, MovementEnded]] = deque(maxlen=CHAIN)
        """The newest movements with their order, until a mission ends; none from before a placement."""
        self.is_over = False
        """True while a mission has ended and the run has not restarted."""
        self.episodes = BeliefEpisodes()
        self.wedged: Newest[ContactRow] = Newest(1)
        """Contacts of a wedged robot: several in a row in one place."""
        self.began = 0
        """The order of the action that restarted the run; 0 without one."""
        self.placed = 0
        """The order of the last action that put the robot elsewhere."""
        self._truth = Truth(spec.sensors, counters_known)
        self._gone = self._turned = 0.0
        self._holding = checkpoint.holding
        self._blocked = False
        """True if a contact ended the movement before."""
        block = checkpoint.block
        self.add_block(
            in_robot_frame(block, checkpoint.pose) if checkpoint.holding else block, checkpoint.holding
        )
        self.biases.add(BiasRow(0, 0.0, checkpoint.bias))

    @property
    def elapsed(self) -> float:
        """Simulated seconds from the beginning to the newest event."""
        return self.clock.now

    @cached_property
    def nominal(self) -> Nominal | None:
        """Set that the run's own is a variant of."""
        return self._read_nominal()

    @property
    def totals(self) -> Totals:
        """The sums up to now."""
        for table in (self.commands, self.readings, self.movements, self.beliefs):
            table.settle()
        return self._totals

    def blocked(self, after: int | None = None, until: int | None = None) -> tuple[int, float]:
        """Number of movements in a row that a contact ended, and the time of the first (elapsed seconds). The
        row ends at the event `until` (by default the newest) and begins after `after` (by default the last
        placement). Grips between them do not count."""
        after, until = self.placed if after is None else after, self.order if until is None else until
        count, since = 0, 0.0
        for place in range(self.movements.place_of(until + 1) - 1, -1, -1):
            row = self.movements[place]
            if row.order <= after or not (row.held or row.grips):
                break
            if row.held:
                count, since = count + 1, row.arrival
        return count, since

    def stuck(self, time_limit: float, after: int | None = None, until: int | None = None) -> Stuck | None:
        """Stretch at the end, after one event until another, in which a wall held the robot: the one
        definition of being stuck. None if it was not.

        Args:
            time_limit: Seconds that the run may last. A robot under a velocity is stuck if it was pressed
                against a wall for a quarter of them and moved less than 1 in.
            after: Event, as for `blocked`.
            until: The same.
        """
        after, until = self.placed if after is None else after, self.order if until is None else until
        count, since = self.blocked(after, until)
        if count >= STUCK:
            return Stuck(since, count, self._obstacle(until, count))
        table = self.movements
        rows = table.columns(table.place_of(after + 1), table.place_of(until + 1))
        # From the end back to where it had moved by an inch.
        away = np.flatnonzero(np.cumsum(rows["went"][::-1]) >= PRESSED_DISTANCE)
        rows = rows[len(rows) - int(away[0]) :] if len(away) else rows
        pressed = rows[rows["pressed"]]
        lasted = float((pressed["arrival"] - pressed["begin"]).sum())
        if not len(pressed) or lasted < PRESSED * time_limit:
            return None
        return Stuck(float(pressed["begin"][0]), 0, self._obstacle(until, 1), lasted)

    def _obstacle(self, until: int, count: int) -> str:
        """The obstacles of the last contacts until an event."""
        found = [row.contact for row in self.contacts.items if row.order <= until]
        return obstacles_text(found[-count:])

    def are_legs(self, rows: Columns) -> BoolArray:
        """True for the rows of movements that are legs of continuous motion, (n,)."""
        legs = [place for place, name in enumerate(self.code_names) if name in self._velocities]
        return np.isin(rows["code"], legs)

    # -- called by the reducer -------------------------------------------------------------------

    def begin(self, line: int, real_time: float) -> None:
        """Begin the next event."""
        self.order += 1
        # Events that share a line, or have none, keep the line before.
        self.line = line or self.line
        now = real_time if self._now is None else self._now()
        # Times are kept relative to the first: single precision has no room for seconds since 1970.
        if self._first is None:
            self._first = now
        self.real_time = now - self._first

    def add_result(self, result: CommandResult) -> None:
        """Add the result of a command that is no reading."""
        elapsed = self.clock.advance(result.time)
        if self._trail.text:
            self._trail.begun(result.number, result.time)
        command, number = result.command, result.number
        refused = result.status in REFUSALS
        self.commands.append(
            self.order, self.line, elapsed, self.real_time, number if number < _LARGEST else _LARGEST,
            self._codes[STOPS if command.stops else command.code], self._sources[command.source], refused,
            refused and result.is_early, result.link,
        )  # fmt: skip
        if refused:
            self.refusals.add(RefusalRow(self.order, self.line, elapsed, result))

    def add_readings(
        self,
        results: Sequence[CommandResult],
        lines: Sequence[int],
        real_times: Sequence[float],
        under_way: Trajectory | Leg | None,
    ) -> None:
        """Add readings that follow each other during one movement, or none, and begin their events."""
        clock, paths, gone, turned = self.clock, self.paths, self._gone, self._turned
        trail = self._trail if self._trail.text else None
        codes, sources, sensors = self._codes, self._sources, self._sensors
        truth, observed = self._truth, self._truth.observed
        commands: list[tuple[float, ...]] = []
        readings: list[tuple[float, ...]] = []
        for result, line, real_time in zip(results, lines, real_times, strict=True):
            self.begin(line, real_time)
            number, time, command, reading, pose = (
                result.number, result.time, result.command, result.reading, result.pose
            )  # fmt: skip
            elapsed = clock.advance(time)
            if trail is not None:
                trail.begun(number, time)
            assert reading is not None
            commands.append((
                self.order, self.line, elapsed, self.real_time, number if number < _LARGEST else _LARGEST,
                codes[command.code], sources[command.source], False, False, result.link,
            ))  # fmt: skip
            value, true, code = reading.value, reading.true, reading.sensor.code
            error_of = observed.get(code)
            error = error_of(true, value) if error_of else truth.count_error(reading, under_way, time)
            # A reading cannot have been taken after it was answered, whatever a damaged log says.
            taken = clock.before + (time if result.taken is None else result.taken)
            if taken > elapsed:
                taken = elapsed
            readings.append((
                self.order, self.line, elapsed, taken, sensors[code], value, true,
                math.nan if error is None else error, reading.took, gone, turned,
                pose.x, pose.y, pose.heading,
            ))  # fmt: skip
            if paths is not None and reading.scan is not None:
                paths.scan(clock.before, elapsed, taken, reading)
        self.commands.extend(commands)
        self.readings.extend(readings)

    def add_plan(self, planned: MovementPlanned) -> None:
        elapsed = self.clock.advance(planned.time)
        if self._trail.text:
            self._trail.begun(planned.number, planned.time)
        if planned.grip is not None:
            self.grips.add(GripRow(self.order, self.line, elapsed, planned.grip, self._holding))
        if self.paths is not None:
            self.paths.plan(self.clock.before, planned.command, planned.trajectory)

    def add_leg_plan(self, begun: LegBegun) -> None:
        """Add the plan of a leg of continuous motion."""
        self.clock.advance(begun.time)
        if self.paths is not None:
            self.paths.plan(self.clock.before, begun.command, begun.leg)

    def add_movement(
        self,
        ended: MovementEnded,
        went: float,
        motion: tuple[float, float, float],
        seen: Mapping[str, CommandResult],
    ) -> None:
        """Add a movement that has ended.

        Args:
            ended: The movement.
            went: Length of its path, inches.
            motion: Degrees turned, inches ahead and to the left.
            seen: Readings since the movement before, by sensor code.
        """
        trajectory, contact = ended.trajectory, ended.contact
        arrival = ended.time
        if contact is not None and contact.ended:
            arrival = max(min(contact.time, ended.time), trajectory.start_time)
        asked, totals = _NOTHING_ASKED
        if trajectory.kind is not None and trajectory.cut is None:
            value = _value(ended.command.argument)
            # In an edited log a command without a number may have moved the robot.
            if isinstance(value, float):
                asked, totals = value, trajectory.totals
        self._move(trajectory, ended, ended.pose, arrival, went, motion[0], motion, seen, asked, totals)

    def add_leg(self, ended: LegEnded, seen: Mapping[str, CommandResult]) -> None:
        """Add a leg of continuous motion that has ended; `seen` has the readings during it by sensor code."""
        leg = ended.leg
        pose, went = leg.arrival(leg.end_time)
        turned, motion = pose.heading - leg.before.heading, leg.moved(leg.end_time)
        self._move(leg, ended.as_movement(), pose, leg.end_time, went, turned, motion, seen, *_NOTHING_ASKED)

    def _move(
        self,
        path: Trajectory | Leg,
        ended: MovementEnded,
        pose: Pose,
        arrival: float,
        went: float,
        turned: float,
        motion: tuple[float, float, float],
        seen: Mapping[str, CommandResult],
        asked: float,
        totals: Axes,
    ) -> None:
        """The robot has moved to a pose, where it arrived at a simulated time; the others as in a
        `MovementRow`, and for `add_movement`."""
        elapsed, zero = self.clock.advance(ended.time), self.clock.before
        contact, number, grips = ended.contact, ended.number, ended.grip is not None
        held, pressed = contact is not None and contact.ended, type(path) is Leg and path.pressed
        if contact is not None:
            self._add_contact(ended, contact, pose, went, turned, seen)
        # Pressed from a contact on until it drives freely again: that time counts as stuck.
        self._blocked = held or ((grips or pressed) and self._blocked)
        self._gone += went
        self._turned += abs(turned)
        self._truth.move(*motion)
        if not self.is_over:
            self.newest.append((self.order, ended))
        self.movements.append(
            self.order, self.line, zero + path.start_time, zero + arrival, elapsed, self.real_time,
            number if number < _LARGEST else _LARGEST,
            self._codes[ended.command.code], grips, ended.answers, contact is not None, held, pressed, went,
            self._gone, self._turned, asked, totals.x, totals.y, totals.r, pose.x, pose.y, pose.heading,
        )  # fmt: skip
        if self.paths is not None:
            self.paths.move(zero, ended.command, path, ended.time, pose, arrival)

    def _add_contact(
        self,
        ended: MovementEnded,
        contact: Contact,
        pose: Pose,
        went: float,
        turned: float,
        results: Mapping[str, CommandResult],
    ) -> None:
        seen = {
            code: SeenReading(each.command.text, replace(each.reading, view=None, scan=None))
            for code, each in results.items()
            if each.reading is not None
        }
        row = ContactRow(
            self.order, self.line, self.clock.before + contact.time, ended, contact, pose, went, turned,
            self._gone, self._turned, seen, self._trail.shown(ended.number, ended.command),
        )  # fmt: skip
        self.contacts.add(row)
        self.episodes.touch(row)
        last = self.repeated.items[-1] if self.repeated.items else None
        if last is not None and self._blocked and _is_again(last.first, row):
            last.count += 1
            last.until = row.elapsed
        else:
            self.repeated.add(RepeatedContact(row, row.elapsed))

    def add_action(self, done: ActionDone, before: Pose) -> None:
        name = done.action.name
        # Simulated time goes back to 0; elapsed time does not.
        if done.restarts:
            self.clock.restart(done.time)
        elapsed = self.clock.advance(done.time)
        row = ActionRow(self.order, self.line, elapsed, done, before)
        self.actions.add(row)
        self.episodes.act(row)
        self._totals.actions[name if not done.refused else f"{name} (refused)"] += 1
        if not done.places:
            return
        if name.restarts:
            self.is_over = False
            self.began = self.order
            self._truth.restart()
        if not self.is_over:
            self.newest.clear()
        self.placed = self.order
        self._blocked = False
        if self.paths is not None:
            self.paths.jump(elapsed, done, before)

    def add_block(self, block: Block, held: bool) -> None:
        """Add the block's place from now on; in the robot's frame if it is held."""
        self.blocks.add(BlockPose(self.order, self.elapsed, held, block))
        self._holding = held

    def add_bias(self, bias: Mapping[DriveKind, Axes]) -> None:
        """Add the bias in force from now on."""
        self.biases.add(BiasRow(self.order, self.elapsed, bias))

    def add_belief(self, belief: Belief) -> None:
        if belief.again:
            if self.paths is not None:
                self.paths.believe_again(belief)
            return
        pose, true, off, grid = belief.pose, belief.true, deviation(belief), belief.grid
        entropy, at_truth = (math.nan, math.nan) if grid is None else (grid.entropy, grid.true_probability)
        elapsed = self.clock.advance(belief.time)
        row = BeliefRow(
            self.order, self.line, elapsed, pose.x, pose.y, pose.heading, true.x, true.y, true.heading,
            math.nan if belief.spread is None else belief.spread, off.distance, off.turn, off.allowed,
            off.allowed_turn, self._gone, entropy, at_truth, off.above,
        )  # fmt: skip
        self.beliefs.append(*row)
        self.episodes.believe(row, self._turned)
        if self.paths is not None:
            self.paths.believe(elapsed, belief)

    def add_notice(self, notice: Notice) -> None:
        if notice.moment is not None and not self.is_over:
            self.clock.advance(notice.moment)
        row = NoticeRow(self.order, self.line, self.elapsed, notice)
        (self.faults if notice.kind is NoticeKind.FAULT else self.notices).add(row)

    def add_wire(self, message: WireMessage) -> None:
        """Add a message of a dialect, or a reply."""
        self._totals.wires += 1
        self._trail.add_message(message)
        self.unanswered = None if message.reply else (message.data.strip(), self.clock.before + message.time)
        if message.reply:
            return
        is_unknown = message.meaning.startswith(UNKNOWN_MESSAGE)
        # A line to a board has no meaning that is known here.
        named = message.meaning or message.data.strip()
        key = (message.data.strip(), message.meaning) if is_unknown else (named, "")
        counts = self._totals.messages
        if key not in counts and len(counts) >= KEPT_MESSAGES:
            key = (OTHER_CODES, "")
        counts[key] += 1

    def add_display(self, event: DisplayChanged) -> None:
        elapsed = self.clock.before + event.time if self.is_over else self.clock.advance(event.time)
        self.displays.add(DisplayRow(self.order, self.line, max(elapsed, self.elapsed), event))

    def add_mission(self, event: MissionEvent) -> None:
        self.is_over |= event.over
        self.missions.add(MissionRow(self.order, self.line, self.clock.advance(event.time), event))

    def add_program_end(self, event: ProgramEnded) -> None:
        # A program that continues after its mission takes none of the time that the history is about.
        elapsed = self.clock.before + event.time if self.is_over else self.clock.advance(event.time)
        self.programs.add(ProgramRow(self.order, self.line, max(elapsed, self.elapsed), event))

    # -- sums ------------------------------------------------------------------------------------

    def _sum_commands(self, rows: Columns) -> None:
        totals = self._totals
        totals.commands += len(rows)
        totals.link_seconds += float(rows["link"].sum())
        totals.last_command_line = int(rows["line"][-1])
        for name, mine in rows_by_name(rows, "code", self.code_names):
            record = totals.codes.setdefault(name, CodeTotals())
            record.count += len(mine)
            record.refused += int(mine["refused"].sum())
        for name, mine in rows_by_name(rows, "source", self.source_names):
            totals.sources[name] += len(mine)

    def _sum_readings(self, rows: Columns) -> None:
        for code, mine in rows_by_name(rows, "sensor", self.sensor_codes):
            record = self._totals.sensors.setdefault(self._names[code], SensorTotals())
            wanted = record.trace.wanted(len(mine))
            if wanted:
                picked = mine[wanted.start :: wanted.step]
                columns = (picked[name].tolist() for name in ("elapsed", "value", "true"))
                record.trace.keep(
                    TracePoint(elapsed, record.readings + place, value, true)
                    for place, elapsed, value, true in zip(wanted, *columns, strict=True)
                )
            record.readings += len(mine)
            record.seconds += float(mine["took"].sum(dtype=np.float64))
            errors = mine["error"].astype(np.float64)
            record.errors.add(errors[np.isfinite(errors)])
            record.missed += int(np.isinf(errors).sum())

    def _sum_movements(self, rows: Columns) -> None:
        totals = self._totals
        totals.distance += float(rows["went"].sum())
        totals.turned = self._turned
        totals.driving_seconds += float((rows["elapsed"] - rows["begin"]).sum())
        totals.contacts += int(rows["contact"].sum())
        totals.contacts_that_ended += int(rows["held"].sum())
        for name, mine in rows_by_name(rows, "code", self.code_names):
            if name in self._velocities:
                totals.legs += len(mine)
            else:
                totals.movements += int((~mine["grips"]).sum())
            if contacts := int(mine["contact"].sum()):
                totals.codes.setdefault(name, CodeTotals()).contacts += contacts

    def _sum_beliefs(self, rows: Columns) -> None:
        totals = self._totals
        distance, turn = rows["distance"], rows["turn"]
        finite = np.isfinite(distance) & np.isfinite(turn)
        rows = rows[finite]
        totals.beliefs.add(distance[finite])
        grids = rows[~np.isnan(rows["above"])]
        totals.entropies.add(grids["entropy"].astype(np.float64))
        totals.missed_shares.add(1.0 - grids["true_probability"])
        made = [BeliefRow._make(each) for each in rows.tolist()]
        totals.belief_turns.add(np.array([each.turn for each in made if each.tells_heading]))
        # Beliefs without a place were dropped above, so that they have no share in the trace.
        wanted = totals.belief_trace.wanted(len(made))
        totals.belief_trace.keep(made[wanted.start :: wanted.step] if wanted else ())


def _is_again(before: ContactRow, row: ContactRow) -> bool:
    """True if a contact repeats the one before: a robot that keeps pushing is one contact, not hundreds."""
    return before.shown == row.shown and is_same_place(before.pose, row.pose)


def rows_by_name(rows: Columns, column: str, names: list[str]) -> Iterator[tuple[str, Columns]]:
    """The rows of each name in a column of indices, in the order in which the names came."""
    numbers = rows[column]
    # np.unique would sort; counting small indices takes a single pass.
    present = np.flatnonzero(np.bincount(numbers, minlength=len(names))).tolist()
    # Rows are picked as bytes: numpy copies rows of columns column by column, which takes four times as long.
    packed = rows.view(f"V{rows.itemsize}")
    # One at a time: together they would be a copy of all rows.
    for each in present:
        yield names[each], packed[numbers == each].view(rows.dtype)
