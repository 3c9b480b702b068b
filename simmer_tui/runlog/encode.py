"""The records of the events of a run, in order.

A record holds what happened and nothing that follows from it and from those before it: rays, test
points and poses on the way are worked out again by `decode.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from simmer_tui.events import (
    ActionDone,
    Belief,
    CommandResult,
    Event,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    ProgramEnded,
    Result,
    TwinReading,
)
from simmer_tui.run.state import Checkpoint
from simmer_tui.runlog.log_records import (
    NO_DELAY,
    SHARED_WITH_CHECKPOINT,
    SHARED_WITH_CONTACT,
    SHARED_WITH_PROGRAM,
    ActionRecord,
    AnswerRecord,
    BeliefRecord,
    CheckpointRecord,
    ContactFields,
    EndRecord,
    GripFields,
    LoggedPose,
    LogRecord,
    MissionFields,
    MissionRecord,
    MoveRecord,
    NoticeRecord,
    OutputFields,
    PlanRecord,
    ProgramRecord,
    ReadingRecord,
    TwinRecord,
    logged_number,
    packed_particles,
)
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import Status
from simmer_tui.sim.trajectory import Trajectory


class LogEncoder:
    """Makes the records of events. A movement that nothing interrupts has one record, other movements
    have one for their plan and one for their end."""

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
        # A plan waits for one event at most: if that is not its end, something came between the two.
        planned, self._planned = self._planned, None
        match event:
            case CommandResult():
                yield from self._rest(planned, real_time)
                if event.reading is not None and event.status is Status.READING:
                    yield _reading_record(event, real_time)
                # The end of a movement may have been its answer: then that has said all.
                elif event.status is not Status.DONE or event.number != self._answered:
                    yield _answer_record(event, real_time)
                # Numbers begin anew after a reset: an earlier movement must not answer for a later one.
                self._answered = None
            case MovementEnded():
                self._under_way, self._answered = 0, event.number if event.answers else None
                yield (
                    _end_record(event, real_time)
                    if planned is None
                    else _move_record(planned, event, real_time)
                )
            case MovementPlanned():
                yield from self._rest(planned, real_time)
                # A block moved on the way changes the plan of the same command.
                again = event.number == self._under_way
                if self._timed or again:
                    self._under_way = event.number
                    yield _plan_record(event, again, real_time)
                else:
                    self._planned = event
            case _:
                yield from self._rest(planned, real_time)
                yield _other_record(event, self._present(), real_time)

    def rest(self, real_time: float) -> Iterator[LogRecord]:
        """The record of a plan that still has none."""
        planned, self._planned = self._planned, None
        return self._rest(planned, round(real_time, 3))

    def _rest(self, planned: MovementPlanned | None, real_time: float) -> Iterator[LogRecord]:
        if planned is not None:
            yield _plan_record(planned, False, real_time)


def _reading_record(result: CommandResult, real_time: float) -> ReadingRecord:
    # Fields one by one: a log has millions of readings, and a dict for each takes time.
    reading = result.reading
    assert reading is not None, "only a reading has a record of this kind"
    return ReadingRecord(
        result.time,
        real_time,
        n=result.number,
        command=result.command.text,
        source=result.command.source,
        reply=logged_number(result.reply),
        # What merely repeats another field is left out: it is most of the bytes of a log.
        taken=None if result.taken == result.time else result.taken,
        link=result.link or NO_DELAY,
        true=None if reading.true == result.reply else logged_number(reading.true),
    )


def _answer_record(result: CommandResult, real_time: float) -> AnswerRecord:
    taken = result.taken
    return AnswerRecord(
        result.time,
        real_time,
        n=result.number,
        command=result.command.text,
        source=result.command.source,
        reply=logged_number(result.reply),
        # The reader takes it from the movement's plan.
        taken=None if taken == result.time or result.status is Status.DONE else taken,
        link=result.link or NO_DELAY,
        status=result.status,
        reason=result.reason,
        stops=result.command.stops,
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
        fields = {"grip": GripFields(grip.closed, grip.holding, _pose_fields(grip.block))}
    command = planned.command
    fields |= {"n": planned.number, "command": command.text, "source": command.source}
    return fields | _path_fields(trajectory)


def _end_fields(ended: MovementEnded) -> dict[str, Any]:
    """The fields that a `MoveRecord` and an `EndRecord` share."""
    return {"stopped_by": ended.stopped_by, "pose": _pose_fields(ended.pose), "answers": ended.answers}


def _path_fields(trajectory: Trajectory) -> dict[str, Any]:
    """The fields that say what kept a movement from its whole path."""
    contact, stop = trajectory.contact, trajectory.rest_stop
    fields: dict[str, Any] = {}
    if contact is not None:
        at = (contact.segment, contact.turned, contact.translated)
        same = {name: getattr(contact, name) for name in SHARED_WITH_CONTACT}
        fields["contact"] = ContactFields(t=contact.time, at=at, **same)
    if stop is not None:
        fields["stop"] = (stop.segment, stop.turned, stop.translated)
    return fields


def _other_record(
    event: ActionDone | Belief | TwinReading | Notice | MissionEvent | ProgramEnded,
    present: tuple[int, float],
    real_time: float,
) -> LogRecord:
    match event:
        case ActionDone():
            return ActionRecord(
                event.time,
                real_time,
                n=present[0],
                action=event.action.name,
                source=event.action.source,
                arguments=event.action.arguments,
                text=event.text,
                pose=_pose_fields(event.pose),
                refused=event.refused,
            )
        case Belief():
            # The particles are offsets from this pose, which keeps their numbers short.
            believed = _pose_fields(event.pose)
            return BeliefRecord(
                event.time,
                real_time,
                believed=believed,
                pose=_pose_fields(event.true),
                spread=event.spread,
                note=event.note,
                particles=packed_particles(event.particles, believed),
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
        case Notice():  # without a simulated time of its own
            return NoticeRecord(
                present[1], real_time, about=event.kind, text=event.text, subject=event.subject
            )
        case MissionEvent():
            return MissionRecord(
                event.time,
                real_time,
                goal=None if isinstance(event.subject, Result) else event.subject,
                result=event.subject if isinstance(event.subject, Result) else None,
                text=event.text,
                reason=event.reason,
            )
        case ProgramEnded():
            stderr, stdout = (
                tuple(OutputFields(line.time, line.text) for line in lines)
                for lines in (event.stderr, event.stdout)
            )
            same = {name: getattr(event, name) for name in SHARED_WITH_PROGRAM}
            return ProgramRecord(event.time, real_time, stderr=stderr, stdout=stdout, **same)


def checkpoint_record(checkpoint: Checkpoint, real_time: float) -> CheckpointRecord:
    """The record of a checkpoint."""
    mission, block, spent = checkpoint.mission, checkpoint.block, checkpoint.spent
    progress = None
    if mission is not None:
        # A goal not met yet is left out; the reader puts it back as None.
        goals = {goal: time for goal, time in mission.goals.items() if time is not None}
        progress = MissionFields(
            goals=goals, result=mission.result, reason=mission.reason, helped=mission.helped
        )
    return CheckpointRecord(
        checkpoint.time,
        round(real_time, 3),
        n=checkpoint.commands,
        pose=_pose_fields(checkpoint.pose),
        block=(block.x, block.y, block.heading),
        mission=progress,
        driving=spent.driving,
        link=spent.link,
        # A copy: the reducer goes on counting in its own.
        reading=dict(spent.by_sensor),
        **{name: getattr(checkpoint, name) for name in SHARED_WITH_CHECKPOINT},
    )


def _pose_fields(pose: Pose) -> LoggedPose:
    return pose.x, pose.y, pose.heading
