"""The records of the events of a run, in order.

A record holds only what does not follow from it and from those before it: `decode.py` computes rays, test
points and poses on the way again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from msgspec.structs import astuple, replace

from simmer_tui.run.events import (
    ActionDone,
    Belief,
    CommandResult,
    Event,
    LegBegun,
    LegEnded,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    ProgramEnded,
    Result,
    TwinReading,
    VelocityEnded,
    WireMessage,
)
from simmer_tui.run.state import Checkpoint
from simmer_tui.runlog.log_records import (
    NO_DELAY,
    NO_REPLY,
    ActionRecord,
    AnswerRecord,
    BeliefRecord,
    CheckpointRecord,
    ContactFields,
    EndRecord,
    GripFields,
    LegCutRecord,
    LegRecord,
    LogRecord,
    MissionFields,
    MissionRecord,
    MissionSumsFields,
    MoveRecord,
    NoticeRecord,
    PlanRecord,
    ProgramRecord,
    ReadingRecord,
    TwinRecord,
    VelocityEndRecord,
    VelocityFields,
    WireRecord,
    logged_number,
    logged_pose,
    packed_particles,
    shared_fields,
)
from simmer_tui.runlog.logged_scans import packed_ranges
from simmer_tui.sim.path import Contact
from simmer_tui.sim.records import LidarScan, Reading, Status, VelocityChange
from simmer_tui.sim.trajectory import Trajectory

LARGE_GRID = 2000
"""States of a grid beyond which a log has only some of its cells: at 10 Hz they would be 100 MB an hour."""
# Just below half a second: five times a tenth may round to less.
GRID_EVERY = 0.499
"""Simulated seconds between two large grids with their cells."""


class LogEncoder:
    """Makes the records of events. A movement that nothing interrupts has one record; others have one for
    their plan and one for their end.

    Every record of a large grid has its numbers, two a second have its cells. Before a movement, a contact
    and the end, the last belief has one more record, with its cells.
    """

    def __init__(self, timed: bool, present: Callable[[], tuple[int, float]]) -> None:
        """Args:
        timed: True if movements take real time, so that something may come between plan and end.
        present: Gives the number of commands begun so far, and simulated time.
        """
        self._timed = timed
        self._present = present
        self._planned: MovementPlanned | None = None
        """A plan without a record yet: its movement may be over at once."""
        self._under_way = 0
        """The number of the movement whose plan has a record but not its end, or 0."""
        self._answered: int | None = None
        """The number of the movement whose end was its answer too."""
        self._leg_end = math.inf
        """End of the leg under way as its record has it."""
        self._stood_since: float | None = -math.inf
        """Simulated time of the end of the last leg; None while one is under way."""
        self._grid_kept = -math.inf
        """Simulated time of the last large grid with its cells."""
        self._without_cells: Belief | None = None
        """The newest belief, if its record has no cells."""
        self._scans: dict[str, LidarScan] = {}
        """The newest scan of each lidar that a record has since reading can begin."""

    @property
    def complete(self) -> bool:
        """True if every event so far has its record."""
        return self._planned is None

    def records(self, event: Event, real_time: float) -> Iterator[LogRecord]:
        """The records to write at an event, which may include one of the event before.

        Args:
            real_time: Seconds since the log began.
        """
        real_time = round(real_time, 3)  # whole milliseconds: no timer of a run is finer
        shows_belief = self._without_cells is not None and self._shows_belief(event)
        # A plan waits for one event at most: if that is not its end, something came between the two.
        planned, self._planned = self._planned, None
        if planned is not None and (shows_belief or not isinstance(event, MovementEnded)):
            yield _plan_record(planned, False, real_time)
            planned = None
        if shows_belief:
            yield from self._cells_of_belief(real_time)
        match event:
            case CommandResult():
                if event.reading is not None and event.status is Status.READING:
                    yield self._reading_record(event, event.reading, real_time)
                # The end of a movement may have been its answer: then no record is needed.
                elif event.number != self._answered:
                    yield _answer_record(event, real_time)
                # Numbers restart after a reset: an earlier movement must not answer for a later one.
                self._answered = None
            case MovementEnded():
                self._under_way, self._answered = 0, event.number if event.answers else None
                yield (
                    _end_record(event, real_time)
                    if planned is None
                    else _move_record(planned, event, real_time)
                )
            case MovementPlanned():
                # A block moved on the way changes the plan of the same command.
                again = event.number == self._under_way
                if self._timed or again:
                    self._under_way = event.number
                    yield _plan_record(event, again, real_time)
                else:
                    self._planned = event
            case LegBegun() | LegEnded():
                yield from self._leg_records(event, real_time)
            case Belief():
                yield _other_record(self._thinned(event), self._present(), real_time)
            case _:
                yield _other_record(event, self._present(), real_time)

    def _leg_records(self, event: LegBegun | LegEnded, real_time: float) -> Iterator[LogRecord]:
        self._stood_since = event.time if isinstance(event, LegEnded) else None
        if isinstance(event, LegBegun):
            self._leg_end = event.leg.end_time
            yield _leg_record(event, real_time)
        # A leg that ends as its record says needs no other.
        elif event.time != self._leg_end:
            yield LegCutRecord(event.time, real_time)

    def _shows_belief(self, event: Event) -> bool:
        """True for events that a belief led to, or is compared with: a movement, a contact, the end."""
        match event:
            case MovementPlanned():
                return True
            case LegBegun():
                # A leg that follows another at once continues its movement.
                return self._stood_since not in (None, event.time)
            case MovementEnded() | LegEnded():
                return event.contact is not None
            case MissionEvent():
                return event.over
        return isinstance(event, ProgramEnded)

    def _thinned(self, belief: Belief) -> Belief:
        """A belief as its record has it."""
        grid, self._without_cells = belief.grid, None
        if grid is None or not grid.cells or belief.again or grid.states <= LARGE_GRID:
            return belief
        # Time restarts after a reset.
        if 0.0 <= belief.time - self._grid_kept < GRID_EVERY:
            self._without_cells = belief
            return replace(belief, grid=replace(grid, cells=b""))
        self._grid_kept = belief.time
        return belief

    def _cells_of_belief(self, real_time: float) -> Iterator[LogRecord]:
        belief, self._without_cells = self._without_cells, None
        if belief is not None:
            self._grid_kept = belief.time
            # Its note and its particles are in an earlier record.
            repeated = replace(belief, particles=(), again=True)
            yield _other_record(repeated, self._present(), real_time)

    def begin_block(self) -> None:
        """Reading can begin here: later records refer to none before."""
        self._scans.clear()

    def _reading_record(self, result: CommandResult, reading: Reading, real_time: float) -> ReadingRecord:
        # Fields one by one: a log has millions of readings, and a dict for each takes time.
        record = ReadingRecord(
            result.time,
            real_time,
            n=result.number,
            command=result.command.text,
            source=result.command.source,
            reply=logged_number(result.reply),
            # A value that repeats another field is left out: these would be most of the bytes of a log.
            taken=None if result.taken == result.time else result.taken,
            link=result.link or NO_DELAY,
            true=None if reading.true == result.reply else logged_number(reading.true),
        )
        scan = reading.scan
        if scan is None:
            return record
        code = reading.sensor.code
        # A program may ask ten times for the same revolution.
        if self._scans.get(code) is scan:
            return replace(record, reply=NO_REPLY, revolution=scan.revolution)
        self._scans[code] = scan
        text, floats = packed_ranges(scan.ranges, reading.sensor.resolution)
        revolution = scan.revolution
        return replace(record, reply=NO_REPLY, revolution=revolution, scan=text, floats=floats)

    def rest(self, real_time: float) -> Iterator[LogRecord]:
        """The records that are still missing: of a plan, and of the cells of the newest belief."""
        real_time = round(real_time, 3)
        planned, self._planned = self._planned, None
        if planned is not None:
            yield _plan_record(planned, False, real_time)
        yield from self._cells_of_belief(real_time)


def _answer_record(result: CommandResult, real_time: float) -> AnswerRecord:
    taken = result.taken
    moved = result.status is Status.DONE and result.velocity is None and not result.waits
    return AnswerRecord(
        result.time,
        real_time,
        n=result.number,
        command=result.command.text,
        source=result.command.source,
        reply=logged_number(result.reply),
        # Of a movement the reader gets it from the plan.
        taken=None if taken == result.time or moved else taken,
        link=result.link or NO_DELAY,
        status=result.status,
        reason=result.reason,
        stops=result.command.stops,
        velocity=None if result.velocity is None else _velocity_fields(result.velocity),
        waits=result.waits or NO_DELAY,
    )


def _velocity_fields(velocity: VelocityChange) -> VelocityFields:
    twist, expires = velocity.twist, velocity.expires
    same = shared_fields(velocity, VelocityFields, "twist", "expires")
    return VelocityFields((twist.x, twist.y, twist.r), None if expires == math.inf else expires, **same)


def _leg_record(begun: LegBegun, real_time: float) -> LegRecord:
    leg, arc = begun.leg, begun.leg.arc
    commanded = leg.commanded
    return LegRecord(
        leg.start_time,
        real_time,
        n=begun.number,
        command=begun.command.text,
        source=begun.command.source,
        end=None if leg.end_time == math.inf else leg.end_time,
        velocity=arc.velocity,
        rate=arc.rate,
        spin=arc.spin or NO_DELAY,
        commanded=(commanded.x, commanded.y, commanded.r),
        pose=logged_pose(leg.last_pose),
        pressed=leg.pressed,
        contact=None if leg.contact is None else _contact_fields(leg.contact),
    )


def _move_record(planned: MovementPlanned, ended: MovementEnded, real_time: float) -> MoveRecord:
    fields = _plan_fields(planned, ended.trajectory) | _end_fields(ended)
    return MoveRecord(planned.time, real_time, end=ended.time, **fields)


def _plan_record(planned: MovementPlanned, again: bool, real_time: float) -> PlanRecord:
    fields = _plan_fields(planned, planned.trajectory)
    return PlanRecord(planned.time, real_time, again=again, **fields)


def _end_record(ended: MovementEnded, real_time: float) -> EndRecord:
    fields = _path_fields(ended.trajectory) | _end_fields(ended)
    return EndRecord(ended.time, real_time, n=ended.number, **fields)


def _plan_fields(planned: MovementPlanned, trajectory: Trajectory) -> dict[str, Any]:
    """The fields of a `PlannedRecord`."""
    grip, total = planned.grip, trajectory.totals
    fields: dict[str, Any] = {"total": (total.x, total.y, total.r)}
    if grip is not None:
        # The jaws move nothing, so a grip has no displacement.
        fields = {"grip": GripFields(grip.closed, grip.holding, logged_pose(grip.block))}
    command = planned.command
    fields |= {"n": planned.number, "command": command.text, "source": command.source}
    return fields | _path_fields(trajectory)


def _end_fields(ended: MovementEnded) -> dict[str, Any]:
    """The fields that a `MoveRecord` and an `EndRecord` share."""
    return {"stopped_by": ended.stopped_by, "pose": logged_pose(ended.pose), "answers": ended.answers}


def _path_fields(trajectory: Trajectory) -> dict[str, Any]:
    """The fields of a movement that did not follow its whole path."""
    contact, stop = trajectory.contact, trajectory.rest_stop
    fields: dict[str, Any] = {}
    if contact is not None:
        fields["contact"] = _contact_fields(contact)
    if stop is not None:
        fields["stop"] = (stop.segment, stop.turned, stop.translated)
    return fields


def _contact_fields(contact: Contact) -> ContactFields:
    at = (contact.segment, contact.turned, contact.translated)
    return ContactFields(t=contact.time, at=at, **shared_fields(contact, ContactFields))


def _other_record(
    event: VelocityEnded
    | ActionDone
    | Belief
    | TwinReading
    | Notice
    | MissionEvent
    | ProgramEnded
    | WireMessage,
    present: tuple[int, float],
    real_time: float,
) -> LogRecord:
    match event:
        case VelocityEnded():
            return VelocityEndRecord(event.time, real_time, **shared_fields(event, VelocityEndRecord))
        case ActionDone():
            same = shared_fields(event, ActionRecord, "action", "pose")
            same |= shared_fields(event.action, ActionRecord)
            pose, name = logged_pose(event.pose), event.action.name
            return ActionRecord(event.time, real_time, n=present[0], action=name, pose=pose, **same)
        case Belief():
            # The particles are offsets from this pose, which keeps their numbers short.
            believed = logged_pose(event.pose)
            return BeliefRecord(
                event.time,
                real_time,
                believed=believed,
                pose=logged_pose(event.true),
                particles=packed_particles(event.particles, believed),
                **shared_fields(event, BeliefRecord, "pose", "particles"),
            )
        case TwinReading():
            return TwinRecord(
                event.time,
                real_time,
                command=event.command.text,
                source=event.command.source,
                code=event.code,
                robot=logged_number(event.robot),
                simulated=logged_number(event.simulated),
            )
        case WireMessage():
            return WireRecord(event.time, real_time, **shared_fields(event, WireRecord))
        case Notice():  # without a simulated time of its own
            same = shared_fields(event, NoticeRecord)
            return NoticeRecord(present[1], real_time, about=event.kind, **same)
        case MissionEvent():
            subject = "result" if isinstance(event.subject, Result) else "goal"
            same = {subject: event.subject, **shared_fields(event, MissionRecord)}
            return MissionRecord(event.time, real_time, **same)
        case ProgramEnded():
            return ProgramRecord(event.time, real_time, **shared_fields(event, ProgramRecord))


def checkpoint_record(checkpoint: Checkpoint, real_time: float) -> CheckpointRecord:
    """The record of a checkpoint."""
    mission, spent = checkpoint.mission, checkpoint.spent
    progress = None
    if mission is not None:
        # A goal not met yet is left out; the reader puts it back as None.
        goals = {goal: time for goal, time in mission.goals.items() if time is not None}
        end = None
        if mission.end is not None:
            time, distance, commands, contacts, used = astuple(mission.end)
            times = used.driving, used.link, dict(used.by_sensor)
            end = MissionSumsFields(time, distance, commands, contacts, *times)
        progress = MissionFields(
            goals=goals, end=end, **shared_fields(mission, MissionFields, "goals", "end")
        )
    return CheckpointRecord(
        checkpoint.time,
        round(real_time, 3),
        n=checkpoint.commands,
        pose=logged_pose(checkpoint.pose),
        block=logged_pose(checkpoint.block),
        mission=progress,
        driving=spent.driving,
        link=spent.link,
        # A copy: the reducer continues to count in its own.
        reading=dict(spent.by_sensor),
        **shared_fields(checkpoint, CheckpointRecord, "pose", "block", "mission"),
    )
