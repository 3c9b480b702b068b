"""Runs a logged run again and compares every reply: the proof that a run is reproducible."""

from __future__ import annotations

import heapq
import math
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.config.loader import Configuration
from simmer_tui.errors import RunLogError, SimmerError
from simmer_tui.robot import actions
from simmer_tui.run.events import Action, ActionName, VelocityEnd
from simmer_tui.runlog.closing import Closing
from simmer_tui.runlog.header import Header, rebuild_to_run
from simmer_tui.runlog.line_form import logged_pose
from simmer_tui.runlog.log_records import (
    ActionRecord,
    AnswerRecord,
    AnyRecord,
    BrokenLine,
    ContactFields,
    EndRecord,
    LegRecord,
    PlanRecord,
    ReadingRecord,
    VelocityEndRecord,
)
from simmer_tui.runlog.logged_scans import LoggedRanges
from simmer_tui.runlog.reader import LogReader
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.command import WORD, Command, counted, cut, parse_command
from simmer_tui.sim.fingerprint import math_fingerprint
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.path import Contact
from simmer_tui.sim.records import TOO_MANY_WAIT, CommandResult, Reading, Status
from simmer_tui.sim.simulator import Simulator
from simmer_tui.version import __version__

# Times are sums: an hour of them is rounded by some 1e-12 s, and every movement takes far longer than 1e-9.
SAME_TIME = 1e-9
"""Times this close count as equal, seconds."""
# Differences in the last bits of sines, 1e-16, grow during a run; a larger difference is a real one.
_SAME_NUMBER = 1e-9
"""Numbers this close, absolutely or relatively, count as equal on a machine with other mathematics."""
# Only the legs of one moment wait, far fewer than these.
_UNMATCHED = 100
"""Legs of the rerun that may be unmatched by the log."""
# Chosen: the event loop answers within milliseconds, unless the computer is overloaded.
_LATE = 1.0
"""Longest delay of an answer by a busy computer, seconds of real time."""


class Difference(Struct, frozen=True):
    """The first difference between a logged run and its rerun."""

    line: int
    what: str
    name: str
    logged: str
    now: str

    def __str__(self) -> str:
        return f"line {self.line}, {self.what}: {self.name} is {self.logged} in the log and {self.now} now"


class _DifferenceError(Exception):
    """Ends a rerun at its first difference."""

    def __init__(self, difference: Difference) -> None:
        self.difference = difference


class InOrder:
    """Sorts the records of a log by the order in which commands began.

    A log has events in the order in which they happened: an answer is where it was given. A wait is answered
    at its end; in timed motion a reading takes time and the link delays an answer. So an answer may come
    after commands that began later. A rerun needs commands in the order in which they began.
    """

    def __init__(self, configuration: Configuration) -> None:
        settings, sensors = configuration.settings, configuration.simulation.sensors
        link, motion = settings.link, settings.motion
        longest = max((sensor.read_time for sensor in sensors), default=0.0) + link.latency + link.jitter
        self._longest = longest if motion.motion == "timed" else 0.0
        """Longest time of an answer, except to a wait, simulated seconds."""
        self._scale = motion.time_scale
        self._held: list[tuple[float, int, int, AnyRecord]] = []
        self._begun = 0
        """Number of the latest command so far."""
        self._whole = 0
        """Number up to which there is a record of each command."""
        self._ahead: set[int] = set()
        """Larger numbers with a record."""

    def take(self, line: int, record: AnyRecord) -> Iterator[tuple[int, AnyRecord]]:
        """Take a record. Gives those that no later record can precede."""
        if isinstance(record, ActionRecord) and not record.refused:
            if record.action is ActionName.TIME_SCALE:
                self._scale = max(self._scale, *record.arguments)
            if record.action.restarts:
                yield from self.rest()  # the restart comes after all records of the run before
                self._begun = self._whole = 0
                self._ahead.clear()
                yield line, record
                return
        heapq.heappush(self._held, (*self._key(record), line, record))
        if self._whole < self._begun:
            return  # a wait is not answered yet
        # _LATE in simulated seconds at the run's speed: no later record can have begun before that.
        late = self._longest + _LATE * self._scale
        settled = record.t - late if self._longest else math.inf
        while self._held and self._held[0][0] < settled:
            yield self._held[0][2:]
            heapq.heappop(self._held)

    def rest(self) -> Iterator[tuple[int, AnyRecord]]:
        """The records still held back."""
        while self._held:
            yield heapq.heappop(self._held)[2:]

    def _key(self, record: AnyRecord) -> tuple[float, int]:
        """The sort key of a record: the time when its command began, then twice its command's number. So a
        late answer comes before later commands of the same moment, and a record without a command between
        two."""
        if isinstance(record, ReadingRecord | AnswerRecord | PlanRecord | ActionRecord):
            self._begun = max(self._begun, record.n)
            if not isinstance(record, ActionRecord):
                self._note(record.n)
        if isinstance(record, ReadingRecord | AnswerRecord) and record.taken is not None:
            return record.taken, 2 * record.n
        if isinstance(record, ReadingRecord | AnswerRecord | PlanRecord):
            return record.t, 2 * record.n
        return record.t, 2 * self._begun + 1

    def _note(self, number: int) -> None:
        """There is a record of a command."""
        if number > self._whole:
            self._ahead.add(number)
        while self._whole + 1 in self._ahead:
            self._whole += 1
            self._ahead.remove(self._whole)


class Rerun(Closing):
    """A rerun of a log, line by line, on a simulator of its own."""

    def __init__(self, path: Path, folder: Path | None = None) -> None:
        """Open a log and build its robot. Device files of its set are read from a `folder`, by default from
        the set's own. Raises RunLogError, ConfigurationError."""
        self._log = LogReader(path)
        header = self.header = self._log.header
        self.commands = 0
        self.actions = 0
        self.difference: Difference | None = None
        """The first difference, None until it is found."""
        self.notes: list[str] = []
        """Remarks for the user."""
        self._legs: deque[tuple[int, LegRecord]] = deque()
        """Legs of the log that the rerun has not reached yet."""
        self._made: deque[Leg] = deque()
        """Legs of the rerun that have not been found in the log yet."""
        self._ranges = LoggedRanges()
        self._scans: dict[int, FloatArray] = {}
        """Ranges of readings not compared yet, by their lines."""
        try:
            self.configuration = rebuild_to_run(header, folder)
            """The configuration of the log."""
            self.simulator = self._robot()
            """The robot."""
        # The caller never gets the object, so nobody else could close the log.
        except SimmerError:
            self.close()
            raise
        self._begun: CommandResult | None = None
        """The result of the movement under way, at its beginning."""
        # Earlier commands, which the log lacks, have advanced the random generator of errors.
        self._comparing = header.number == 0
        self._in_order = InOrder(self._log.configuration)
        self.same_machine = header.mathematics in ("", math_fingerprint())
        """True unless the log was written on a machine with other mathematics."""
        if not self.same_machine:
            self.notes.append(
                "the log was written on a machine with other mathematics "
                f"({cut(header.mathematics, WORD)}, "
                f"here {math_fingerprint()}): the last bits of its sines differ, so numbers count as equal "
                f"within {_SAME_NUMBER:g}"
            )
        if header.taken_over is not None:
            self.notes.append(f"the run took over {header.taken_over}; it is compared from its beginning")

    @property
    def size(self) -> int:
        """Bytes of the log."""
        return self._log.size

    def _robot(self) -> Simulator:
        header = self.header
        if not header.simulated:
            raise RunLogError(f"{self._log.shown} is the log of a real robot, which cannot be run again")
        simulator = Simulator(self.configuration.simulation, header.seed)
        simulator.noise = header.noise
        if header.number == 0:
            set_up_simulator(simulator, header)
        simulator.listener = self
        return simulator

    def steps(self) -> Iterator[int]:
        """Run it; yields the number of bytes read so far after each line.

        Ends at the first difference. Raises RunLogError for a broken line, for one that is missing,
        or if the log gives nothing to compare.
        """
        try:
            for line, said in self._lines():
                if not self._comparing:
                    self._wait_for_restart(line, said)
                if self._comparing:
                    self._take_all(self._in_order.take(line, said))
                yield self._log.position
            self._take_all(self._in_order.rest())
        except _DifferenceError as differs:
            self.difference = differs.difference
            return
        if not self._comparing:
            before = counted(self.header.number, "command")
            raise RunLogError(
                f"{self._log.shown} begins after {before} and holds no reset, so its beginning is not known; "
                "log from the start, with --log"
            )
        if self._log.note:
            self.notes.append(self._log.note)

    def until(self, last: int, time: float) -> Iterator[tuple[int, AnyRecord]]:
        """Run it up to a moment: the lines up to number `last`, and then until a simulated time; yields after
        each line. A movement that is under way at that time is still under way at the end.

        Raises RunLogError if the rerun differs from the log, or is impossible.
        """
        if not self._comparing:
            before = counted(self.header.number, "command")
            raise RunLogError(f"{self._log.shown} begins after {before}: what was before is not known")
        try:
            for line, said in self._lines(last):
                self._take_all(self._in_order.take(line, said))
                yield line, said
            self._take_all(self._in_order.rest())
        except _DifferenceError as differs:
            raise RunLogError(
                f"{self._log.shown} does not repeat exactly: {differs.difference} (written by "
                f"simmer-tui {cut(self.header.program, WORD)}, this is {__version__})"
            ) from None
        self._comparing = False  # the log may have legs of a command that it answers later
        self.simulator.advance(time)

    def _wait_for_restart(self, line: int, said: AnyRecord) -> None:
        """Skip the beginning of a log that began in the middle of a run: a reset restores a known state."""
        if not isinstance(said, ActionRecord) or said.refused:
            return
        if said.action is ActionName.NOISE:  # the one change that a reset keeps
            self.simulator.noise = bool(said.arguments[0])
        elif said.action.restarts:
            self._comparing = True
            before = counted(self.header.number, "command")
            self.notes.append(
                f"the log begins after {before}; compared from the {said.action} in line {line} on"
            )

    def _lines(self, last: float = math.inf) -> Iterator[tuple[int, AnyRecord]]:
        """The records of the log up to line `last`, with the numbers of their lines. Raises RunLogError for
        a broken one."""
        for line, said in self._log.lines():
            if line > last:
                return
            if isinstance(said, BrokenLine):
                raise RunLogError(f"{self._log.shown}: {said}")
            if isinstance(said, ReadingRecord) and said.revolution is not None:
                self._keep_scan(line, said)
            yield line, said

    def _keep_scan(self, line: int, said: ReadingRecord) -> None:
        """Keep the ranges of a reading until it is compared, which may be in another order than the log's."""
        try:
            sensor = self.simulator.sensor(parse_command(said.command).code)
            ranges = self._ranges.of(said, sensor)
        except SimmerError as error:
            raise RunLogError(f"{self._log.shown}: line {line}: {error}") from None
        if self._comparing:
            self._scans[line] = ranges

    def _take_all(self, records: Iterator[tuple[int, AnyRecord]]) -> None:
        for line, said in records:
            self._take(line, said)

    def _take(self, line: int, said: AnyRecord) -> None:
        match said:
            case ReadingRecord():
                self._read(line, said)
            case PlanRecord():
                if not said.again:
                    self._begin_movement(line, said)
            case EndRecord():
                self._end(line, said)
            case AnswerRecord():
                self._answer(line, said)
            case ActionRecord():
                self._act(line, said)
            case LegRecord():
                self._legs.append((line, said))
                self._compare_legs()
            # Ends that neither the log's commands nor the robot cause are repeated.
            case VelocityEndRecord(reason=VelocityEnd.LEFT):
                self.simulator.advance(said.t)
                self.simulator.release()

    # -- continuous motion -------------------------------------------------------------------------

    def leg_begun(self, leg: Leg) -> None:
        """A leg begins in the rerun (see `MotionListener`)."""
        if not self._comparing:
            return
        # A leg that another replaced has no end in the log: the log has both.
        self._made.append(leg)
        # A log has each leg before later records: a wrong time would make the robot drive for ever.
        if len(self._made) > _UNMATCHED:
            first = self._made[0]
            raise RunLogError(
                f"{self._log.shown}: a leg from {first.start_time:g} s on is missing: the log has a gap"
            )
        self._compare_legs()

    def leg_ended(self, leg: Leg) -> None:
        """A leg is over in the rerun: its record in the log is its beginning."""

    def velocity_expired(self, time: float) -> None:
        """A velocity has ended by its time limit: so it did in the log."""

    def _compare_legs(self) -> None:
        """Compare the legs of log and rerun, as far as there are both."""
        while self._legs and self._made:
            (line, said), leg = self._legs.popleft(), self._made.popleft()
            what = f"leg of {said.command!r}"
            self._compare(line, what, "t", said.t, leg.start_time)
            self._compare(line, what, "end", math.inf if said.end is None else said.end, leg.end_time)
            self._compare(line, what, "pose", said.last_pose, logged_pose(leg.last_pose))
            self._compare(line, what, "contact", _contact_values(said.contact), _contact_values(leg.contact))

    # -- actions ---------------------------------------------------------------------------------

    def _act(self, line: int, said: ActionRecord) -> None:
        simulator = self.simulator
        # A restart sets number and time to 0 by itself.
        if not (said.action.restarts and not said.refused):
            self._expect_number(line, said.n, simulator.commands)
            simulator.advance(said.t)
        refused = False
        try:
            actions.apply(simulator, Action(said.action, said.arguments))
        except SimmerError:
            refused = True
        what = f"action {said.action}"
        self._compare(line, what, "refused", said.refused, refused)
        self._compare(line, what, "pose", said.pose, logged_pose(simulator.pose))
        self.actions += 1

    # -- commands --------------------------------------------------------------------------------

    def _read(self, line: int, said: ReadingRecord) -> None:
        result, what = self._begin(line, said, parse_command(said.command, said.source))
        self._compare(line, what, "status", Status.READING.value, result.status.value)
        if said.reply is not None:
            self._compare(line, what, "reply", float(said.reply), result.reply)
        if result.reading is not None and said.true is not None:
            self._compare(line, what, "true", float(said.true), result.reading.true)
        self._compare_scan(line, what, said, result.reading)

    def _compare_scan(self, line: int, what: str, said: ReadingRecord, reading: Reading | None) -> None:
        scan = None if reading is None else reading.scan
        self._compare(line, what, "revolution", said.revolution, None if scan is None else scan.revolution)
        if scan is None:
            return
        ranges = self._scans.pop(line)
        self._compare(line, what, "rays", len(ranges), len(scan.ranges))
        # All rays at once: one after the other takes a millisecond, and an hour has 20,000 scans.
        for ray in np.flatnonzero(ranges.view(np.int64) != scan.ranges.view(np.int64)).tolist():
            self._compare(line, what, f"ray {ray}", float(ranges[ray]), float(scan.ranges[ray]))

    def _answer(self, line: int, said: AnswerRecord) -> None:
        command = parse_command(said.command, said.source)
        if said.status is Status.ACCEPTED or (
            said.status is Status.DONE and self.simulator.is_drive(command)
        ):
            return  # its plan or its end says more
        if said.stops:
            command = Command(said.command, command.code, source=said.source, stops=True)
        elif said.status in (Status.REFUSED, Status.UNKNOWN) or (
            said.status is Status.BUSY and said.reason == TOO_MANY_WAIT
        ):
            # Refused by rules of its dialect or its link, which a rerun does not know.
            command = replace(command, problem=said.reason)
        result, what = self._begin(line, said, command)
        # A dialect may refuse a command that is unknown to the grammar: the dialect decides.
        now = said.status if command.problem and result.status is Status.REFUSED else result.status
        self._compare(line, what, "status", said.status.value, now.value)
        self._compare(line, what, "reply", float(said.reply), result.reply)

    def _begin(
        self, line: int, said: ReadingRecord | AnswerRecord | PlanRecord, command: Command
    ) -> tuple[CommandResult, str]:
        """Begin a command at its time. Gives its result and its name for messages."""
        self._expect_number(line, said.n, self.simulator.commands + 1)
        taken = said.taken if isinstance(said, ReadingRecord | AnswerRecord) else None
        self.simulator.advance(said.t if taken is None else taken)
        self.commands += 1
        return self.simulator.begin(command), f"command {cut(said.command)!r}"

    def _expect_number(self, line: int, logged: int, due: int) -> None:
        if logged != due:
            what = (
                f"command number {due} is missing" if logged > due else f"command number {logged} came before"
            )
            raise RunLogError(
                f"{self._log.shown}: line {line}: {what}; the log has a gap, or its lines are mixed up"
            )

    def _begin_movement(self, line: int, said: PlanRecord) -> None:
        result, what = self._begin(line, said, parse_command(said.command, said.source))
        self._compare(line, what, "status", Status.ACCEPTED.value, result.status.value)
        trajectory = self.simulator.trajectory
        if trajectory is not None:
            totals = trajectory.totals
            self._compare(line, what, "total", said.total, (totals.x, totals.y, totals.r))
        if said.grip is not None and result.grip is not None:
            self._compare(line, what, "holding", said.grip.holding, result.grip.holding)
            self._compare(line, what, "block", said.grip.block, logged_pose(result.grip.block))
        self._begun = result

    def _end(self, line: int, said: EndRecord) -> None:
        """End the movement as in the log, and compare."""
        begun, self._begun = self._begun, None
        if begun is None or begun.number != said.n:
            raise RunLogError(f"{self._log.shown}: line {line}: command number {said.n} is not under way")
        # A person pressed stop: its time is not in configuration or seed.
        if said.stopped_by:
            self.simulator.advance(said.t)
            self.simulator.stop()
        result = self.simulator.finish(begun)
        what = f"command {begun.command.shown!r}"
        self._compare(line, what, "t", said.t, result.time)
        self._compare(line, what, "contact", _contact_values(said.contact), _contact_values(result.contact))
        self._compare(line, what, "pose", said.pose, logged_pose(result.pose))

    def _compare(self, line: int, what: str, name: str, logged: object, now: object) -> None:
        """Raises _DifferenceError unless two values are the same: to the last bit, unless the log was
        written on a machine with other mathematics."""
        before, after = _text(logged), _text(now)
        if before != after and (self.same_machine or not _same(logged, now)):
            raise _DifferenceError(Difference(line, what, name, before, after))

    def close(self) -> None:
        self._log.close()


def _contact_values(contact: ContactFields | Contact | None) -> object:
    """The values of a contact in a log, without its place on the path."""
    if contact is None:
        return None
    time = contact.t if isinstance(contact, ContactFields) else contact.time
    flags = (contact.ended, contact.drift, contact.held_block)
    return (contact.point, time, contact.cell, flags)


def set_up_simulator(simulator: Simulator, header: Header) -> None:
    """Repeat a person's changes between the start and the log's beginning."""
    simulator.advance(header.t)
    simulator.set_bias(header.bias)
    # Moving a block is an error where there is none, or while it is held.
    if (simulator.block.x, simulator.block.y) != (header.block.x, header.block.y):
        simulator.move_block(header.block.x, header.block.y)
    if simulator.pose != header.pose:
        simulator.teleport(header.pose)


def _same(logged: object, now: object) -> bool:
    """True if two values are the same within `_SAME_NUMBER`. Tuples have the same length: what is compared
    as one has a fixed number of parts."""
    match logged, now:
        case tuple(), tuple():
            return all(map(_same, logged, now))
        case float(), float():
            near = math.isclose(logged, now, rel_tol=_SAME_NUMBER, abs_tol=_SAME_NUMBER)
            return near or _text(logged) == _text(now)
    return _text(logged) == _text(now)


def _text(value: object) -> str:
    """A text for each value: -0.0 and 0.0 differ, NaN equals itself."""
    match value:
        case tuple():
            return f"({', '.join(_text(item) for item in value)})"
        case bool():
            return str(value).lower()
        case float():
            return repr(float(value))
    return str(value)
