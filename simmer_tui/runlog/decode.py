"""The events of the records of a log, in order."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from msgspec.structs import replace

from simmer_tui.errors import RunLogError
from simmer_tui.run.events import (
    LARGEST_NUMBER,
    Action,
    ActionDone,
    Belief,
    CommandResult,
    Event,
    LegBegun,
    LegEnded,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
)
from simmer_tui.run.state import Checkpoint, TimeSpent
from simmer_tui.runlog.line_form import Makers, Values, line_form
from simmer_tui.runlog.log_records import (
    CONTACT_FORM,
    RECORDS,
    VELOCITY_FORM,
    AnswerRecord,
    AnyRecord,
    BeliefRecord,
    CheckpointRecord,
    EndRecord,
    GripFields,
    MovementRecord,
    PlanRecord,
    ReadingRecord,
    unpacked_particles,
)
from simmer_tui.runlog.logged_scans import ScanDecoder
from simmer_tui.sim.arcs import LARGEST_TURN, Arc
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import Command, cut, parse_command, parse_value
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.gripper import missed_by
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.motion import profile_of, rebuilt, standing
from simmer_tui.sim.path import Contact, Path, PathPosition
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.recent_motion import Motion
from simmer_tui.sim.records import Grip, Reading, Status
from simmer_tui.sim.specs import Axes, DriveSpec, GripperSpec, SimulationSpec
from simmer_tui.sim.trajectory import Trajectory, VelocityProfile

# Far more than rounding, and far less than a cell.
_SLACK = 1e-3
"""Tolerance, inches or degrees, by which a leg may lead out of the maze, or exceed the largest turn."""
# A program uses some hundred texts; one that never repeats itself must not fill the memory.
_CACHED = 4096
"""Texts of commands that are kept parsed."""
_EVENTS: dict[type, Callable[..., Event]] = {
    record: record.event for record in RECORDS if record.event is not None
}
"""The kind of event of each kind of record."""


class LogDecoder:
    """Decodes a log record by record. It knows the pose of a robot that stands, and the motion and the scans
    that later scans refer to, by the records before."""

    def __init__(self, spec: SimulationSpec, pose: Pose) -> None:
        """`pose` is the robot's pose before the next record."""
        self.pose = pose
        """The pose of the last record that has one, beliefs apart."""
        self._spec = spec
        self._footprint = Footprint.of(spec.robot)
        self._sensors = {sensor.code: sensor for sensor in spec.sensors}
        self._drives = {row.code: row for row in spec.drive_rows}
        self._under_way: Motion | None = None
        """The movement or leg under way."""
        self._made: tuple[tuple[object, ...], Trajectory] | None = None
        """The last trajectory, and all that it was made of: the end of most movements repeats their plan."""
        self._scans = ScanDecoder(spec.sensors)
        self._parsed = lru_cache(_CACHED)(parse_command)
        self._profile = lru_cache(_CACHED)(self._profile_of)
        # In this order: later ones use the command.
        self._makers: Makers = {
            "command": self._command,
            "action": lambda event, values: Action(**values),
            "leg": self._leg,
        }

    def events(self, record: AnyRecord) -> tuple[Event, ...]:
        """The events of a record, in order; none for a checkpoint.

        Raises RunLogError for a record that does not fit the configuration or the records before it.
        """
        # By hand, not by `line_form`: these are nearly all the lines of a log, which has millions.
        match record:
            case ReadingRecord():
                return (self.reading(record),)
            case BeliefRecord():
                return (self._belief(record),)
            case PlanRecord():
                return (self._planned(record),)
            case EndRecord():
                ended = self._ended(record)
                return (ended, _done(ended)) if ended.answers else (ended,)
            case AnswerRecord():
                return (self._answer(record),)
            case CheckpointRecord():
                return ()
        kind = type(record)
        event = _EVENTS[kind](**line_form(kind).values(record, self._makers))
        match event:
            case ActionDone():
                self.pose = event.pose
                if event.places:
                    self._under_way = None
                    self._scans.forget(all_scans=event.restarts)
            case LegBegun():
                self._under_way = event.leg
            case LegEnded():
                self._moved(event.leg, event.leg.last_pose)
            case Notice(kind=NoticeKind.BOARD | NoticeKind.FAULT):
                return (replace(event, moment=record.t),)
        return (event,)

    def resume(self, record: CheckpointRecord) -> Checkpoint:
        """Continue decoding from a checkpoint, and return it."""
        self.pose = Pose(*record.pose)
        self._under_way = None
        self._scans.forget(all_scans=True)
        makers: Makers = {
            "block": lambda event, at: Block(at.x, at.y, self._spec.block_size, at.heading),
            "spent": lambda event, values: TimeSpent(**values),
        }
        return Checkpoint(spec=self._spec, **line_form(CheckpointRecord).values(record, makers))

    def _moved(self, motion: Motion, pose: Pose) -> None:
        """A movement or a leg has ended."""
        self.pose = pose
        self._under_way = None
        self._scans.add_motion(motion)

    # -- events --------------------------------------------------------------------------------------

    def reading(self, record: ReadingRecord) -> CommandResult:
        """The event of a reading. Raises RunLogError, as `events` does."""
        command = self._parsed(record.command, record.source)
        sensor = self._sensors.get(command.code)
        if sensor is None:
            raise RunLogError(f"{command.shown} reads no sensor of the log's configuration")
        if record.pose is not None:
            self.pose = Pose(*record.pose)
        pose = self.pose
        before = pose if record.before is None else Pose(*record.before)
        scan = None
        if record.revolution is not None:
            scan = self._scans.scan(record, sensor, before, self._under_way)
            value = float(scan.ranges[0])
        elif record.reply is None:
            raise RunLogError("it has neither a reply nor a scan")
        else:
            value = float(record.reply)
        true = value if record.true is None else float(record.true)
        return CommandResult(
            number=record.n,
            time=record.t,
            command=command,
            status=Status.READING,
            reply=value,
            before=before,
            pose=pose,
            reading=Reading(sensor, value=value, true=true, took=sensor.read_time, scan=scan),
            taken=record.taken,
            link=record.link,
        )

    def _answer(self, record: AnswerRecord) -> CommandResult:
        # A text that stops the robot is not in the grammar.
        if record.stops:
            command = Command(record.command, record.command.strip()[:2], source=record.source, stops=True)
        else:
            command = self._parsed(record.command, record.source)
        if record.pose is not None:
            self.pose = Pose(*record.pose)
        before = self.pose if record.before is None else Pose(*record.before)
        began = record.t if record.taken is None else record.taken
        return CommandResult(
            number=record.n,
            time=record.t,
            command=command,
            status=record.status,
            reply=float(record.reply),
            before=before,
            pose=self.pose,
            reason=record.reason,
            grip=None if record.grip is None else self._grip(record.grip, began, before),
            taken=record.taken,
            link=record.link,
            velocity=None if record.velocity is None else VELOCITY_FORM.read(record.velocity),
            waits=record.waits,
        )

    def _belief(self, record: BeliefRecord) -> Belief:
        return Belief(
            time=record.t,
            pose=Pose(*record.believed),
            true=self.pose if record.pose is None else Pose(*record.pose),
            spread=record.spread,
            particles=unpacked_particles(record) if record.particles else (),
            note=record.note,
            grid=record.grid,
            again=record.again,
        )

    def _planned(self, record: PlanRecord) -> MovementPlanned:
        command = self._parsed(record.command, record.source)
        trajectory = self._under_way = self._trajectory(record, command)
        return MovementPlanned(
            number=record.n,
            time=record.t,
            command=command,
            trajectory=trajectory,
            grip=self._grip_of(record, trajectory),
        )

    def _ended(self, record: EndRecord) -> MovementEnded:
        command = self._parsed(record.command, record.source)
        # A movement that nobody stopped ends as planned, and the plan gives the same float again.
        trajectory = self._trajectory(record, command, cut=record.t if record.stopped_by else None)
        pose = Pose(*record.pose)
        self._moved(trajectory, pose)
        return MovementEnded(
            number=record.n,
            time=record.t,
            command=command,
            trajectory=trajectory,
            pose=pose,
            stopped_by=record.stopped_by,
            answers=record.answers,
            grip=self._grip_of(record, trajectory),
        )

    # -- the parts of events ---------------------------------------------------------------------

    def _command(self, event: Values, values: Values) -> Command:
        return self._parsed(values["text"], values["source"])

    def _leg(self, event: Values, values: Values) -> Leg:
        arc = values["arc"]
        time: float = event.pop("time")
        begin: float = values.get("start_time", time)
        end: float = values.get("end_time", time)
        start, last, contact = values["before"], values["last_pose"], values["contact"]
        self._check_leg(event["command"], arc["velocity"], arc["rate"], end - begin, last)
        return Leg(
            Arc(start, duration=end - begin, **arc),
            begin,
            end,
            last,
            values["commanded"],
            pressed=values["pressed"],
            contact=None if contact is None else _contact(last, **contact),
        )

    def _check_leg(
        self, command: Command, velocity: tuple[float, float], rate: float, seconds: float, last: Pose
    ) -> None:
        """Raises RunLogError for a leg that no robot drives in this maze: drawing it, and counting its time
        by cell, would take for ever."""
        maze, x, y = self._spec.maze, last.x, last.y
        speed = math.dist((0.0, 0.0), velocity)
        far = speed > 0.0 and speed * seconds > math.hypot(maze.width, maze.height) + _SLACK
        turns = rate != 0.0 and abs(rate) * seconds > LARGEST_TURN + _SLACK
        inside = -_SLACK <= x <= maze.width + _SLACK and -_SLACK <= y <= maze.height + _SLACK
        if far or turns or not inside:
            raise RunLogError(f"the leg of {cut(command.text)!r} leads out of the maze")

    def _trajectory(self, record: MovementRecord, command: Command, cut: float | None = None) -> Trajectory:
        drive = self._drives.get(command.code)
        if drive is None:
            raise RunLogError(f"{command.shown} moves nothing in the log's configuration")
        begin = record.t if record.begin is None else record.begin
        made_of = (command.text, begin, record.origin, record.total, record.contact, record.stop, cut)
        if self._made is None or self._made[0] != made_of:
            self._made = made_of, self._trajectory_of(record, command, drive, begin, cut)
        return self._made[1]

    def _trajectory_of(
        self,
        record: MovementRecord,
        command: Command,
        drive: DriveSpec | GripperSpec,
        begin: float,
        cut: float | None,
    ) -> Trajectory:
        start = Pose(*record.origin)
        if type(drive) is not DriveSpec:
            # The speed of a gripper is in openings or closings a second.
            return standing(start, begin, 1.0 / drive.speed, cut=cut)
        profile, whole = self._profile(command.text)
        totals, stop = Axes(*record.total), None
        # After a contact the errors are dropped, so the rest is one straight piece or one turn.
        if record.stop is not None:
            stop = PathPosition(*record.stop)
            if stop.segment:
                raise RunLogError("the rest of a movement has one segment")
        segments = self._spec.num_segments
        path = Path.lazy(start, *totals.share(segments), segments)
        contact = None
        if record.contact is not None:
            values = CONTACT_FORM.read(record.contact)
            place: PathPosition = values["place"]
            # A log from elsewhere may hold anything: an index beyond the path must not raise another error.
            if place.segment >= path.segments:
                raise RunLogError(f"the movement has no segment {place.segment}")
            pose = path.pose(place.segment, place.turned, place.translated)
            contact = _contact(pose, **values)
        return rebuilt(path, drive.kind, totals, begin, whole, contact, stop, cut, profile)

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

    def _grip_of(self, record: MovementRecord, trajectory: Trajectory) -> Grip | None:
        # The jaws act at once, so the time is that of the movement's beginning.
        fields, time = record.grip, trajectory.start_time
        return None if fields is None else self._grip(fields, time, trajectory.before)

    def _grip(self, fields: GripFields, time: float, pose: Pose) -> Grip:
        """The gripper's action, of a robot at a pose. The distance by which it missed the block follows from
        that."""
        closed, holding, lies = fields.closed, fields.holding, Pose(*fields.block)
        spec, missed = self._spec, None
        # Only jaws that closed on nothing have missed a block.
        if closed and not holding and spec.gripper is not None and spec.block_size:
            block = Block(lies.x, lies.y, spec.block_size, lies.heading)
            missed = missed_by(spec.gripper, self._footprint, pose, block)
        return Grip(time, closed, holding, lies, missed)


def _contact(pose: Pose, place: PathPosition, **values: Any) -> Contact:
    return Contact(pose, segment=place.segment, turned=place.turned, translated=place.translated, **values)


def _done(ended: MovementEnded) -> CommandResult:
    """The answer that is also the end of a movement."""
    path = ended.trajectory
    return CommandResult(
        number=ended.number,
        time=ended.time,
        command=ended.command,
        status=Status.DONE,
        reply=math.inf,
        before=path.before,
        pose=ended.pose,
        trajectory=path,
        grip=ended.grip,
        taken=path.start_time,
    )
