"""The figures of a run, gathered event by event in bounded memory."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from simmer_tui.config.loader import Configuration
from simmer_tui.events import (
    ActionDone,
    ActionName,
    Belief,
    CommandResult,
    Event,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
)
from simmer_tui.report.causes import Cause, cause_of
from simmer_tui.report.evidence import Evidence
from simmer_tui.report.happenings import (
    BeliefPoint,
    Bump,
    CodeRecord,
    Jump,
    Piece,
    Point,
    Refusal,
    Remark,
    SensorRecord,
    Touch,
    TracePoint,
)
from simmer_tui.report.recording import Recording
from simmer_tui.report.truth import Truth
from simmer_tui.run.bounded import Errors, First, Thinned
from simmer_tui.run.facts import deviation
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import MissionProgress
from simmer_tui.runlog.header import Header
from simmer_tui.runlog.log_records import BrokenLine
from simmer_tui.runlog.reader import ElapsedTime, Logged
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import REFUSALS, Reading
from simmer_tui.sim.specs import CELL_SIZE
from simmer_tui.sim.trajectory import Trajectory

PIECES = 8000
"""Most movements drawn."""
TRACE_POINTS = 800
"""Most points of one sensor's trace."""
LISTED = 200
"""Most contacts, refused commands and jumps listed."""
OTHER_CODES = "other"
STOPS = "stop"
"""The row of commands that stop the robot, whatever their dialect calls them."""
SAME_PLACE = 0.1
"""Poses this close, inches, are one place: the robot did not get away from the wall."""


class RunStatistics:
    """Feed it what a log tells, in order, call `finish`, and read the figures."""

    def __init__(self, header: Header, configuration: Configuration, *, recorded: bool = True) -> None:
        """With `recorded` it keeps what a player shows, too."""
        self.header = header
        self.configuration = configuration
        spec = configuration.simulation
        beginning = header.beginning(configuration)
        self.fold = Reducer(beginning)
        # Only of a mission is it known what was to be done; not every log says in its header that one is
        # under way.
        self._evidence = None
        if configuration.mission is not None:
            under_way = replace(beginning, mission=beginning.mission or MissionProgress())
            self._evidence = Evidence(configuration, under_way, header.bias)
        self._recording = (
            Recording(spec, header.pose, beginning.block, holding=header.holding) if recorded else None
        )
        self.commands = 0
        self.codes: dict[str, CodeRecord] = {}
        self.sources: Counter[str] = Counter()
        self.distance = 0.0
        """Inches driven."""
        self.turned = 0.0
        """Degrees turned, either way."""
        self.movements = 0
        self.contacts = 0
        self.contacts_that_ended = 0
        """How many of them ended their movements; from the others the robot went on."""
        self.bumps: First[Bump] = First(LISTED)
        self.last_bump: Bump | None = None
        self.last_contact: Touch | None = None
        self.contacts_in_a_row = 0
        """How many of the latest movements, without a gap, met a wall."""
        self.in_a_row_since = 0.0
        self.refusals: First[Refusal] = First(LISTED)
        self.jumps: First[Jump] = First(LISTED)
        self.actions: Counter[str] = Counter()
        self.broken: First[BrokenLine] = First(20)
        self.faults: First[Remark] = First(20)
        self.mission: First[Remark] = First(20)
        """What the referee said, and when."""
        self.sensors: dict[str, SensorRecord] = {}
        self.beliefs = Errors()
        self.belief_turns = Errors()
        self.belief_trace: Thinned[BeliefPoint] = Thinned(TRACE_POINTS)
        self.lost: BeliefPoint | None = None
        """The first belief off by more than half a cell, and by more than the program allowed for."""
        self.cause: Cause | None = None
        """Why the run failed, if it did; after `finish`."""
        self.last_belief: BeliefPoint | None = None
        self.last_command_line = 0
        self.cells: Counter[tuple[int, int]] = Counter()
        """Simulated seconds by cell: row from the top and column from the left, from 1."""
        self.pieces: Thinned[Piece] = Thinned(PIECES)
        self.notes: list[str] = []
        self.wall_seconds = 0.0
        self._clock = ElapsedTime(header.t)
        self.driving = self.on_link = 0.0
        """Simulated seconds of movements, and on the link."""
        self.reading: dict[str, float] = {}
        """Simulated seconds of reading, by sensor ID; those that take none are left out."""
        self._truth = Truth(spec.sensors, header.number == 0)
        self._under_way: Trajectory | None = None
        self._names = {each.code: each.id for each in spec.sensors}
        self._columns, self._rows = spec.maze.columns, spec.maze.rows
        self._stood_since = 0.0
        self._standing = header.pose
        self._seen: dict[str, CommandResult] = {}
        self._known_codes = {each.code for each in spec.sensors} | {each.code for each in spec.drives}
        if spec.gripper is not None:
            self._known_codes.add(spec.gripper.code)

    @property
    def duration(self) -> float:
        """Simulated seconds from the beginning to the end."""
        return self._clock.now

    @property
    def pose(self) -> Pose:
        """Where the robot is."""
        return self.fold.pose_at(self.fold.time)

    @property
    def recording(self) -> Recording:
        """What a player shows."""
        assert self._recording is not None, "nothing was recorded"
        return self._recording

    def add(self, logged: Logged | BrokenLine) -> None:
        """Take in what is told next."""
        if isinstance(logged, BrokenLine):
            self.broken.add(logged)
            return
        event, line = logged.event, logged.line
        wall_seconds = logged.real_time - self.header.real_time
        if wall_seconds > self.wall_seconds:
            self.wall_seconds = wall_seconds
        before = None
        if isinstance(event, CommandResult):  # a million answers move nothing: the fold can do without them
            self._add_outcome(event, line, self._clock.advance(event.time))
        else:
            before = self.pose if isinstance(event, ActionDone) else None
            self._add_event(event, line, before)
        if self._recording is not None:
            self._recording.add(event, self.duration, self._clock.before, before, self.fold)
        if self._evidence is not None:
            self._evidence.add(event, self.duration, line, logged.real_time)

    def _add_event(self, event: Event, line: int, before: Pose | None) -> None:
        if isinstance(event, ActionDone) and event.restarts:
            self._clock.restart(event.time)
        driven = self.fold.distance
        self.fold.apply(event)
        match event:
            case MovementPlanned():
                self._under_way = event.trajectory
                self._clock.advance(event.time)
            case MovementEnded():
                self._clock.advance(event.time)
                self.driving += event.time - event.trajectory.start_time
                self._add_movement(event, line, self.fold.distance - driven)
            case ActionDone():
                assert before is not None
                self._add_action(event, line, self._clock.advance(event.time), before)
            case Belief():
                self._add_belief(event, line, self._clock.advance(event.time))
            case Notice():
                if event.kind is NoticeKind.FAULT:
                    self.faults.add(Remark(self.duration, line, event.text))
            case MissionEvent():
                self.mission.add(Remark(self._clock.advance(event.time), line, event.text))

    def finish(self, note: str = "") -> None:
        """No more comes; `note` is what the reader has to say."""
        self._stand(self.duration)
        if self._evidence is not None:
            self.cause = cause_of(self._evidence)
        if note:
            self.notes.append(note)
        if not self.fold.still:
            self.notes.append("the log ends while a movement is under way; how it ended is not known")
        for broken in self.broken.items:
            self.notes.append(f"{broken}, and was skipped")
        if self.broken.more:
            self.notes.append(f"{self.broken.more} more broken lines were skipped")

    # -- commands --------------------------------------------------------------------------------

    def _add_outcome(self, outcome: CommandResult, line: int, elapsed: float) -> None:
        self.commands += 1
        self.last_command_line = line
        self.on_link += outcome.link
        command = outcome.command
        source = command.source
        if source not in self.sources and len(self.sources) >= 20:
            source = OTHER_CODES
        self.sources[source] += 1
        record = self._record(outcome)
        record.count += 1
        if outcome.reading is not None:
            self._add_reading(outcome, outcome.reading, elapsed)
        elif outcome.status in REFUSALS:
            record.refused += 1
            self.refusals.add(Refusal(elapsed, line, outcome))

    def _record(self, told: CommandResult | MovementEnded) -> CodeRecord:
        command = told.command
        known = command.code if command.code in self._known_codes else OTHER_CODES
        code = STOPS if command.stops else known
        record = self.codes.get(code)
        if record is None:
            record = self.codes[code] = CodeRecord()
        return record

    def _add_reading(self, outcome: CommandResult, reading: Reading, elapsed: float) -> None:
        name = self._names[reading.sensor.code]
        if reading.took:
            self.reading[name] = self.reading.get(name, 0.0) + reading.took
        record = self.sensors.get(name)
        if record is None:
            record = self.sensors[name] = SensorRecord(Thinned(TRACE_POINTS))
        if record.trace.count():
            record.trace.keep(TracePoint(elapsed, record.readings, reading.value, reading.true))
        record.readings += 1
        self._seen[name] = outcome
        error = self._truth.error(reading, self._under_way, outcome.time)
        if error is None:
            return
        if math.isfinite(error):
            record.errors.add(error)
        else:
            record.missed += 1

    def _add_movement(self, ended: MovementEnded, line: int, went: float) -> None:
        zero = self._clock.before
        trajectory, until = ended.trajectory, ended.time
        begin, contact = trajectory.start_time, ended.contact
        before, pose = ended.before, self.pose
        arrival = until if contact is None or not contact.ended else min(contact.time, until)
        turned = pose.heading - before.heading
        self.movements += ended.grip is None
        self.distance += went
        self.turned += abs(turned)
        self._stand(zero + begin)
        self._truth.move(trajectory, until)
        self._under_way = None
        here, there = self._cell(before.x, before.y), self._cell(pose.x, pose.y)
        drawn = self.pieces.count()
        if drawn or here != there:
            points = trajectory.centres(until)
        if here == there:
            self.cells[here] += max(arrival - begin, 0.0)  # type: ignore[assignment]
        else:
            self._pass_time(points, max(arrival - begin, 0.0))
        if drawn:
            self.pieces.keep(Piece(zero + begin, zero + until, _simplified(points)))
        self._standing = pose
        self._stood_since = zero + max(arrival, begin)
        if contact is not None:
            self._record(ended).contacts += 1
            self.last_contact = Touch(
                zero + contact.time,
                line,
                ended.command.shown,
                pose,
                contact,
                went,
                turned,
                self._seen,
            )
            self._bump(self.last_contact)
        if contact is None or not contact.ended:
            self.contacts_in_a_row = 0
        self._seen = {}

    def _bump(self, touch: Touch) -> None:
        last = self.last_bump
        again = (
            self.contacts_in_a_row > 0
            and last is not None
            and last.touch.shown == touch.shown
            and math.hypot(last.touch.pose.x - touch.pose.x, last.touch.pose.y - touch.pose.y) < SAME_PLACE
        )
        if again and last is not None:
            last.count += 1
            last.until = touch.elapsed
        else:
            self.last_bump = Bump(touch, touch.elapsed)
            self.bumps.add(self.last_bump)
        if not self.contacts_in_a_row:
            self.in_a_row_since = touch.elapsed
        self.contacts += 1
        self.contacts_that_ended += touch.ended
        self.contacts_in_a_row += 1

    # -- time by cell ------------------------------------------------------------------------------

    def _stand(self, until: float) -> None:
        """The robot stood where it was till then."""
        if until > self._stood_since:
            self.cells[self._cell(self._standing.x, self._standing.y)] += until - self._stood_since  # type: ignore[assignment]
            self._stood_since = until

    def _pass_time(self, points: Sequence[Point], seconds: float) -> None:
        """Share out a movement's time among the cells it went through."""
        cells, cell_at = self.cells, self._cell
        lengths = list(map(math.dist, points, points[1:]))
        total = math.fsum(lengths)
        if total == 0.0:
            self.cells[self._cell(*points[0])] += seconds  # type: ignore[assignment]
            return
        for (a, b), length in zip(pairwise(points), lengths, strict=True):
            steps = max(math.ceil(length), 1)
            share = seconds * length / total / steps
            for step in range(steps):
                fraction = (step + 0.5) / steps
                at = cell_at(a[0] + fraction * (b[0] - a[0]), a[1] + fraction * (b[1] - a[1]))
                cells[at] += share  # type: ignore[assignment]

    def _cell(self, x: float, y: float) -> tuple[int, int]:
        column, row = int(x // CELL_SIZE), int(y // CELL_SIZE)
        if not (0 <= column < self._columns and 0 <= row < self._rows):
            column, row = min(max(column, 0), self._columns - 1), min(max(row, 0), self._rows - 1)
        return self._rows - row, column + 1

    # -- actions and beliefs -------------------------------------------------------------------------

    def _add_action(self, done: ActionDone, line: int, elapsed: float, before: Pose) -> None:
        name = done.action.name
        self.actions[name if not done.refused else f"{name} (refused)"] += 1
        if done.refused:
            return
        if name.restarts:
            self._truth.restart()
        elif name is not ActionName.TELEPORT:
            return
        self._stand(elapsed)
        self.jumps.add(Jump(elapsed, name.value, line, before, done.pose))
        self._standing = done.pose
        self._seen = {}

    def _add_belief(self, belief: Belief, line: int, elapsed: float) -> None:
        believed, pose = belief.pose, belief.true
        distance = math.hypot(believed.x - pose.x, believed.y - pose.y)
        turn = (believed.heading - pose.heading + 180.0) % 360.0 - 180.0
        point = BeliefPoint(elapsed, line, believed, distance, turn)
        self.last_belief = point
        if not (math.isfinite(distance) and math.isfinite(turn)):
            return
        self.beliefs.add(distance)
        self.belief_turns.add(turn)
        self.belief_trace.add(point)
        if self.lost is None and distance > CELL_SIZE / 2 and deviation(belief).off_place:
            self.lost = point


def _simplified(points: Sequence[Point]) -> Sequence[Point]:
    """A path without the points that do not show: all within 0.02 in of the straight line."""
    if len(points) < 3:
        return points
    (x, y), (end_x, end_y) = points[0], points[-1]
    length = math.hypot(end_x - x, end_y - y)
    if length == 0.0:
        far = max(math.dist(points[0], point) for point in points)
    else:
        far = max(abs((px - x) * (end_y - y) - (py - y) * (end_x - x)) / length for px, py in points)
    return points if far > 0.02 else (points[0], points[-1])
