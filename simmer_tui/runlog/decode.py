"""The events of the records of a log, in order."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

from msgspec.structs import astuple, replace

from simmer_tui.errors import RunLogError
from simmer_tui.run.events import (
    LARGEST_NUMBER,
    Action,
    ActionDone,
    Belief,
    CommandResult,
    Event,
    Goal,
    LegBegun,
    LegEnded,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    ProgramEnded,
    TwinReading,
    VelocityEnded,
    WireMessage,
)
from simmer_tui.run.state import Checkpoint, MissionProgress, MissionSums, TimeSpent
from simmer_tui.runlog.log_records import (
    NO_REPLY,
    ActionRecord,
    AnswerRecord,
    AnyRecord,
    BeliefRecord,
    CheckpointRecord,
    ContactFields,
    EndRecord,
    GripFields,
    LegCutRecord,
    LegRecord,
    LoggedPose,
    MissionRecord,
    MovementRecord,
    MoveRecord,
    NoticeRecord,
    PlanRecord,
    ProgramRecord,
    ReadingRecord,
    TwinRecord,
    VelocityEndRecord,
    VelocityFields,
    WireRecord,
    shared_fields,
    unpacked_particles,
)
from simmer_tui.runlog.logged_scans import ScanDecoder
from simmer_tui.sim.arcs import LARGEST_TURN, Arc, Twist
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import Command, cut, parse_command, parse_value
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.gripper import missed_by
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.motion import profile_of, rebuilt, standing
from simmer_tui.sim.path import Contact, Path, PathPosition
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.recent_motion import Motion
from simmer_tui.sim.records import Grip, LidarScan, Reading, Status, VelocityChange
from simmer_tui.sim.specs import Axes, DriveSpec, SensorSpec, SimulationSpec
from simmer_tui.sim.trajectory import Trajectory, VelocityProfile

# A command is answered at most a few commands late: sessions and the link allow fewer than these.
_REMEMBERED = 16
"""Movements that are over but may still be answered."""
# Far more than rounding, and far less than a cell.
_SLACK = 1e-3
"""Tolerance, inches or degrees, by which a leg may lead out of the maze, or exceed the largest turn."""
# A program uses some hundred texts; one that never repeats itself must not fill the memory.
_CACHED = 4096
"""Texts of commands that are kept parsed."""


class LogDecoder:
    """Decodes a log record by record: values that a record leaves out follow from those before it."""

    def __init__(self, spec: SimulationSpec, pose: Pose) -> None:
        """`pose` is the robot's pose before the next record."""
        self.pose = pose
        self._spec = spec
        self._footprint = Footprint.of(spec.robot)
        self._sensors = {sensor.code: sensor for sensor in spec.sensors}
        self._drives = {row.code: row for row in spec.drive_rows}
        self._planned: MovementPlanned | None = None
        self._leg: LegBegun | None = None
        """The leg under way."""
        self._legs: deque[Leg] = deque(maxlen=_REMEMBERED)
        """The latest legs that are over."""
        self._ended: deque[tuple[MovementEnded, Pose]] = deque(maxlen=_REMEMBERED)
        """The latest movements that are over, and where each began."""
        self._begun = pose
        self._scans = ScanDecoder(spec.sensors)
        self._parsed = lru_cache(_CACHED)(parse_command)
        self._profile = lru_cache(_CACHED)(self._profile_of)
        self._decoders: Mapping[type, Callable[[Any], tuple[Event, ...]]] = {
            ReadingRecord: self._reading,
            AnswerRecord: self._answer,
            MoveRecord: self._movement,
            PlanRecord: self._plan,
            EndRecord: self._end,
            ActionRecord: self._action,
            BeliefRecord: _belief,
            NoticeRecord: lambda record: (Notice(record.about, record.text, record.subject, record.advice),),
            MissionRecord: _mission_event,
            TwinRecord: self._twin,
            ProgramRecord: lambda record: (ProgramEnded(record.t, **shared_fields(record, ProgramEnded)),),
            CheckpointRecord: lambda record: (),
            LegRecord: self._leg_begun,
            LegCutRecord: lambda record: (),  # `_leg_over` gives its event
            VelocityEndRecord: lambda record: (VelocityEnded(record.t, record.reason, record.source),),
            WireRecord: lambda record: (WireMessage(record.t, record.data, record.reply, record.meaning),),
        }

    def events(self, record: AnyRecord) -> tuple[Event, ...]:
        """The events of a record, in order; none for a checkpoint.

        Raises RunLogError for a record that does not fit the configuration or the records before it.
        """
        decode = self._decoders[type(record)]
        return decode(record) if self._leg is None else self._leg_over(self._leg, record) + decode(record)

    def resume(self, record: CheckpointRecord) -> Checkpoint:
        """Continue decoding from a checkpoint, and return it."""
        self.pose = Pose(*record.pose)
        self._planned = self._leg = None
        self._legs.clear()
        # A checkpoint is written only where nothing is under way or still to be answered.
        self._ended.clear()
        self._scans.forget(all_scans=True)
        mission = record.mission
        progress = None
        if mission is not None:
            # The record leaves out goals that have not been met.
            goals = {goal: mission.goals.get(goal) for goal in Goal}
            end = None
            if mission.end is not None:
                time, distance, commands, contacts, *times = astuple(mission.end)
                end = MissionSums(time, distance, commands, contacts, TimeSpent(*times))
            progress = MissionProgress(
                goals, end=end, **shared_fields(mission, MissionProgress, "goals", "end")
            )
        x, y, heading = record.block
        return Checkpoint(
            spec=self._spec,
            time=record.t,
            pose=self.pose,
            block=Block(x, y, self._spec.block_size, heading),
            commands=record.n,
            mission=progress,
            spent=TimeSpent(record.driving, record.link, record.reading),
            **shared_fields(record, Checkpoint, "pose", "block", "mission"),
        )

    def _pose_at(self, time: float, number: int) -> Pose:
        """The robot's pose when a command was taken up or answered. Answers may come after the end of
        movements that began before or since."""
        planned = self._planned
        if planned is not None and (planned.trajectory.start_time, planned.number) < (time, number):
            return planned.trajectory.pose_at(time)
        if self._leg is not None or self._legs:
            under_way = [] if self._leg is None else [self._leg.leg]
            for leg in (*under_way, *reversed(self._legs)):
                at_end = leg.end_time == time and leg.last_pose == self.pose
                if at_end or leg.start_time <= time < leg.end_time:
                    return leg.pose_at(time)
        pose = self.pose
        # From the latest back: an answer is at most a few movements late.
        for ended, before in reversed(self._ended):
            if time >= ended.time and ended.number < number:
                break
            if (ended.trajectory.start_time, ended.number) < (time, number):
                return ended.trajectory.pose_at(time)
            pose = before
        return pose

    def _start_of(self, number: int) -> Pose:
        """The pose at which a command's movement began, which may be over."""
        return next((begun for ended, begun in self._ended if ended.number == number), self._begun)

    def _command(self, text: str, source: str, stops: bool = False) -> Command:
        # A text that stops the robot is not in the grammar.
        return (
            Command(text, text.strip()[:2], source=source, stops=True)
            if stops
            else self._parsed(text, source)
        )

    def _reading(self, record: ReadingRecord) -> tuple[Event, ...]:
        command = self._parsed(record.command, record.source)
        sensor = self._sensors.get(command.code)
        if sensor is None:
            raise RunLogError(f"{command.shown} reads no sensor of the log's configuration")
        pose = self._pose_at(record.t, record.n)
        before = pose if record.taken is None else self._pose_at(record.taken, record.n)
        scan, value = None, float(record.reply)
        if record.reply is NO_REPLY:
            scan = self._scan(record, sensor, before)
            value = float(scan.ranges[0])
        true = value if record.true is None else float(record.true)
        reading = Reading(sensor, value, true, None, sensor.read_time, scan)
        n, t, taken, link = record.n, record.t, record.taken, record.link
        # Positional, since a log has millions of these: with keywords it takes twice as long.
        arguments = (n, t, command, Status.READING, value, before, pose, "", reading, None, None, taken, link)
        return (CommandResult(*arguments),)

    def _scan(self, record: ReadingRecord, sensor: SensorSpec, pose: Pose) -> LidarScan:
        under_way: Motion | None = None
        if self._planned is not None:
            under_way = self._planned.trajectory
        elif self._leg is not None:
            under_way = self._leg.leg
        return self._scans.scan(record, sensor, pose, under_way)

    def _answer(self, record: AnswerRecord) -> tuple[Event, ...]:
        command = self._command(record.command, record.source, record.stops)
        if record.status is Status.DONE and record.velocity is None:
            # The movement's own record has pose, contact and grip.
            for ended, started in self._ended:
                if ended.number == record.n:
                    return (replace(self._done(ended, started), time=record.t, link=record.link),)
        if record.status is Status.ACCEPTED:
            pose = before = self._start_of(record.n)
        else:
            pose = self._pose_at(record.t, record.n)
            before = pose if record.taken is None else self._pose_at(record.taken, record.n)
        result = CommandResult(
            *(record.n, record.t, command, record.status, float(record.reply), before, pose),
            reason=record.reason,
            taken=record.taken,
            link=record.link,
            velocity=None if record.velocity is None else _velocity(record.velocity),
            waits=record.waits,
        )
        return (result,)

    def _twin(self, record: TwinRecord) -> tuple[Event, ...]:
        command = self._command(record.command, record.source)
        return (TwinReading(record.t, command, record.code, float(record.robot), float(record.simulated)),)

    def _action(self, record: ActionRecord) -> tuple[Event, ...]:
        action = Action(record.action, record.arguments, record.source)
        done = ActionDone(record.t, action, record.text, Pose(*record.pose), record.refused)
        if not record.refused:
            # Poses of movements before it would be wrong for answers after it.
            if action.name.restarts or done.pose != self.pose:
                self._ended.clear()
                self._legs.clear()
            if action.name.restarts or action.name.places:
                self._scans.forget(all_scans=action.name.restarts)
            self.pose = done.pose
        return (done,)

    # -- continuous motion -----------------------------------------------------------------------

    def _leg_begun(self, record: LegRecord) -> tuple[Event, ...]:
        command = self._command(record.command, record.source)
        end, last = math.inf if record.end is None else record.end, Pose(*record.pose)
        seconds = end - record.t
        self._check_leg(record, seconds)
        arc = Arc(self.pose, record.velocity, record.rate, seconds, record.spin)
        contact = None if record.contact is None else _contact_at(last, record.contact)
        commanded = Twist(*record.commanded)
        leg = Leg(arc, record.t, end, last, commanded, pressed=record.pressed, contact=contact)
        self._leg = LegBegun(record.n, command, leg)
        return (self._leg,)

    def _check_leg(self, record: LegRecord, seconds: float) -> None:
        """Raises RunLogError for a leg that no robot drives in this maze: drawing it, and counting its time
        by cell, would take for ever."""
        maze, (x, y, _) = self._spec.maze, record.pose
        speed = math.dist((0.0, 0.0), record.velocity)
        far = speed > 0.0 and speed * seconds > math.hypot(maze.width, maze.height) + _SLACK
        turns = record.rate != 0.0 and abs(record.rate) * seconds > LARGEST_TURN + _SLACK
        inside = -_SLACK <= x <= maze.width + _SLACK and -_SLACK <= y <= maze.height + _SLACK
        if far or turns or not inside:
            raise RunLogError(f"the leg of {cut(record.command)!r} leads out of the maze")

    def _leg_over(self, begun: LegBegun, record: AnyRecord) -> tuple[Event, ...]:
        """The end of the leg under way, if it ends before a record."""
        leg = begun.leg
        if isinstance(record, LegCutRecord):
            if record.t < leg.start_time:
                raise RunLogError("the leg ends before it begins")
            leg = leg.cut(record.t)
        elif record.t < leg.end_time:
            # Another leg that begins at the same time replaces it.
            return ()
        self._leg = None
        self.pose = leg.last_pose
        self._legs.append(leg)
        self._scans.add_motion(leg)
        return (LegEnded(begun.number, begun.command, leg),)

    # -- movements -------------------------------------------------------------------------------

    def _movement(self, record: MoveRecord) -> tuple[Event, ...]:
        command = self._command(record.command, record.source)
        grip = None if record.grip is None else self._grip(record.t, record.grip, self.pose)
        trajectory = self._trajectory(command, record, self.pose, record.t, record.total, record.end)
        planned = MovementPlanned(record.n, record.t, command, trajectory, grip)
        before, self.pose, self._planned = self.pose, Pose(*record.pose), None
        ended = MovementEnded(
            record.n, record.end, command, trajectory, self.pose, record.stopped_by, record.answers, grip
        )
        self._ended.append((ended, before))
        self._scans.add_motion(trajectory)
        return (planned, ended, self._done(ended, before)) if record.answers else (planned, ended)

    def _plan(self, record: PlanRecord) -> tuple[Event, ...]:
        command = self._command(record.command, record.source)
        if not record.again or self._planned is None:
            self._begun = self.pose
            start = record.t
        else:
            start = self._planned.trajectory.start_time
        grip = None if record.grip is None else self._grip(record.t, record.grip, self._begun)
        trajectory = self._trajectory(command, record, self._begun, start, record.total, None)
        self._planned = MovementPlanned(record.n, record.t, command, trajectory, grip)
        return (self._planned,)

    def _end(self, record: EndRecord) -> tuple[Event, ...]:
        planned = self._planned
        if planned is None or planned.number != record.n:
            raise RunLogError(f"the end of command number {record.n} has no beginning before it")
        plan = planned.trajectory
        if record.t < plan.start_time:
            raise RunLogError("the movement ends before it begins")
        total = (plan.totals.x, plan.totals.y, plan.totals.r)
        trajectory = self._trajectory(
            planned.command, record, self._begun, plan.start_time, total, record.t, plan.duration
        )
        self._planned, self.pose = None, Pose(*record.pose)
        about = record.stopped_by, record.answers, planned.grip
        ended = MovementEnded(record.n, record.t, planned.command, trajectory, self.pose, *about)
        self._ended.append((ended, self._begun))
        self._scans.add_motion(trajectory)
        return (ended, self._done(ended, self._begun)) if record.answers else (ended,)

    def _done(self, ended: MovementEnded, before: Pose) -> CommandResult:
        number, time, command, trajectory = ended.number, ended.time, ended.command, ended.trajectory
        # Positional, as in `_reading`.
        arguments = (number, time, command, Status.DONE, math.inf, before, ended.pose, "", None, trajectory)
        return CommandResult(*arguments, ended.grip, trajectory.start_time)

    def _trajectory(
        self,
        command: Command,
        record: MovementRecord,
        start: Pose,
        begin: float,
        total: LoggedPose | None,
        end: float | None,
        duration: float | None = None,
    ) -> Trajectory:
        """The trajectory of a record."""
        drive = self._drives.get(command.code)
        if drive is None:
            raise RunLogError(f"{command.shown} moves nothing in the log's configuration")
        # A movement that nobody stopped ends as planned, and the plan gives the same float again.
        cut = end if record.stopped_by else None
        if type(drive) is not DriveSpec:
            # The speed of a gripper is in openings or closings a second.
            return standing(start, begin, 1.0 / drive.speed, cut=cut)
        if total is None:
            return standing(start, begin, 0.0, cut=cut)
        profile, whole = self._profile(command.text)
        # After a contact the errors are dropped, so the rest is one straight piece or one turn.
        if record.stop is not None and record.stop[0]:
            raise RunLogError("the rest of a movement has one segment")
        totals, segments = Axes(*total), self._spec.num_segments
        path = Path.lazy(start, *totals.share(segments), segments)
        return rebuilt(
            path,
            drive.kind,
            totals,
            begin,
            whole if duration is None else duration,
            None if record.contact is None else self._contact(record.contact, path),
            None if record.stop is None else PathPosition(*record.stop),
            cut,
            profile,
        )

    def _contact(self, fields: ContactFields, path: Path) -> Contact:
        """The contact of a movement on a path."""
        segment, turned, translated = fields.at
        # A log from elsewhere may hold anything: an index beyond the path must not raise another error.
        if segment >= path.segments:
            raise RunLogError(f"the movement has no segment {segment}")
        return _contact_at(path.pose(segment, turned, translated), fields)

    def _profile_of(self, text: str) -> tuple[VelocityProfile | None, float]:
        """The velocity profile of a drive's command, and its duration, seconds."""
        command = parse_command(text)
        drive, value = self._drives[command.code], parse_value(command.argument)
        assert isinstance(drive, DriveSpec), "a gripper has no profile"
        if isinstance(value, str):
            raise RunLogError(f"{command.shown} has no value: {value}")
        distance = abs(value * drive.gain)
        profile = profile_of(drive, distance)
        duration = distance / drive.speed if profile is None else profile.duration
        # Written so that NaN is refused too.
        if not duration <= LARGEST_NUMBER:
            raise RunLogError(f"{command.shown} takes too long")
        return profile, duration

    def _grip(self, time: float, fields: GripFields, pose: Pose) -> Grip:
        """The gripper's action at a pose. The distance by which it missed the block is computed from them."""
        spec, (x, y, heading) = self._spec, fields.block
        missed = None
        # Only jaws that closed on nothing have missed a block.
        if fields.closed and not fields.holding and spec.gripper is not None and spec.block_size:
            block = Block(x, y, spec.block_size, heading)
            missed = missed_by(spec.gripper, self._footprint, pose, block)
        return Grip(time, fields.closed, fields.holding, Pose(x, y, heading), missed)


def _contact_at(pose: Pose, fields: ContactFields) -> Contact:
    segment, turned, translated = fields.at
    same = shared_fields(fields, Contact)
    return Contact(pose, segment=segment, turned=turned, translated=translated, time=fields.t, **same)


def _velocity(fields: VelocityFields) -> VelocityChange:
    expires = math.inf if fields.expires is None else fields.expires
    same = shared_fields(fields, VelocityChange, "twist", "expires")
    return VelocityChange(Twist(*fields.twist), expires, **same)


def _belief(record: BeliefRecord) -> tuple[Event, ...]:
    believed, true = Pose(*record.believed), Pose(*record.pose)
    same = shared_fields(record, Belief, "pose", "particles")
    return (Belief(record.t, believed, true, particles=unpacked_particles(record), **same),)


def _mission_event(record: MissionRecord) -> tuple[Event, ...]:
    subject = record.goal or record.result
    assert subject is not None, "a record about a mission has a goal or a result"
    return (MissionEvent(record.t, subject, record.text, record.reason),)
