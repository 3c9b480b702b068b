"""Lines of a run log turned back into the events they tell of, in order, as they were told."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

from msgspec.structs import replace

from simmer_tui.errors import RunLogError
from simmer_tui.events import (
    Action,
    ActionDone,
    Belief,
    CommandResult,
    Event,
    Goal,
    MissionEvent,
    MovementEnded,
    MovementPlanned,
    Notice,
    TwinReading,
)
from simmer_tui.run.state import Checkpoint, MissionProgress, TimeSpent, starts_of
from simmer_tui.runlog.entries import (
    LARGEST,
    SUBJECTS,
    ActionLine,
    AnswerLine,
    BeliefLine,
    EndLine,
    GripFields,
    Known,
    MissionLine,
    MoveLine,
    NoticeLine,
    Placed,
    PlanLine,
    ReadLine,
    StateLine,
    TwinLine,
    Way,
    number,
)
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import Command, parse_command, parse_value
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.gripper import missed_by
from simmer_tui.sim.motion import profile_of, rebuilt, standing
from simmer_tui.sim.path import Contact, Path, Stop
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import Grip, Reading, Status
from simmer_tui.sim.specs import Axes, DriveSpec, GripperSpec, SimulationSpec
from simmer_tui.sim.trajectory import Trajectory
from simmer_tui.sim.velocity_profile import VelocityProfile

_REMEMBERED = 16
"""Movements that are over of which an answer may still come."""
_COMMANDS = 4096
"""Texts of commands that are taken apart only once."""


class Decoder:
    """Follows a log line by line: what a line leaves out, the lines before it say."""

    def __init__(self, spec: SimulationSpec, pose: Pose) -> None:
        """`pose` is where the robot stands before the next line."""
        self.pose = pose
        self._spec = spec
        self._footprint = Footprint.of(spec.robot)
        self._sensors = {sensor.code: sensor for sensor in spec.sensors}
        self._drives: Mapping[str, DriveSpec | GripperSpec] = {
            each.code: each for each in (*spec.drives, *([spec.gripper] if spec.gripper else ()))
        }
        self._planned: MovementPlanned | None = None
        self._ended: deque[tuple[MovementEnded, Pose]] = deque(maxlen=_REMEMBERED)
        """The latest movements that are over, and where each began."""
        self._begun = pose
        self._commands: dict[tuple[str, str], Command] = {}
        self._profiles: dict[str, tuple[VelocityProfile | None, float]] = {}

    def events(self, line: Known) -> tuple[Event, ...]:
        """What a line tells of, in order; nothing for one that only sums up.

        Raises RunLogError for a line that does not fit the configuration or the lines before it.
        """
        match line:
            case ReadLine():
                return (self._reading(line),)
            case MoveLine():
                return self._movement(line)
            case AnswerLine():
                return (self._answer(line),)
            case PlanLine():
                return (self._plan(line),)
            case EndLine():
                return self._end(line)
            case ActionLine():
                return (self._action(line),)
            case BeliefLine():
                believed, true = Pose(*line.believed), Pose(*line.pose)
                return (Belief(line.t, believed, true, line.spread, line.particles, line.note),)
            case NoticeLine():
                return (Notice(line.about, line.text, line.subject),)
            case MissionLine():
                return (MissionEvent(line.t, SUBJECTS[line.subject], line.text, line.reason),)
            case TwinLine():
                command = self._command(line.command, line.source)
                return (TwinReading(line.t, command, line.code, number(line.robot), number(line.simulated)),)
            case StateLine():
                return ()

    def resume(self, line: StateLine) -> Checkpoint:
        """The run as a summing-up line has it; decoding goes on from there."""
        self.pose = Pose(*line.pose)
        self._planned = None
        self._ended.clear()
        start, start_block = starts_of(self._spec)
        mission = line.mission
        progress = None
        if mission is not None:
            goals = {goal: mission.goals.get(goal) for goal in Goal}
            progress = MissionProgress(goals, mission.result, mission.reason, mission.helped)
        x, y, heading = line.block
        return Checkpoint(
            start=start,
            start_block=start_block,
            time=line.t,
            pose=self.pose,
            block=Block(x, y, self._spec.block_size, heading),
            seed=line.seed,
            holding=line.holding,
            noise=line.noise,
            paused=line.paused,
            time_scale=line.time_scale,
            commands=line.n,
            contacts=line.contacts,
            distance=line.distance,
            client=line.client,
            mission=progress,
            spent=TimeSpent(line.driving, line.link, line.reading),
        )

    def _pose_at(self, time: float, number: int) -> Pose:
        """The robot's pose when a command was taken up, or answered, at a simulated time of late: answers
        may come after the end of movements that had begun before, or since."""
        planned = self._planned
        if planned is not None and (planned.trajectory.start_time, planned.number) < (time, number):
            return planned.trajectory.pose_at(time)
        pose = self.pose
        for ended, before in reversed(self._ended):
            if time >= ended.time and ended.number < number:
                break
            if (ended.trajectory.start_time, ended.number) < (time, number):
                return ended.trajectory.pose_at(time)
            pose = before
        return pose

    def _start_of(self, number: int) -> Pose:
        """Where the movement of a command began, which may be over."""
        return next((begun for ended, begun in self._ended if ended.number == number), self._begun)

    def _command(self, text: str, source: str, stops: bool = False) -> Command:
        known = self._commands.get((text, source))
        if known is not None and not stops:
            return known
        if stops:
            return Command(text, text.strip()[:2], source=source, stops=True)
        command = parse_command(text, source)
        if len(self._commands) < _COMMANDS:
            self._commands[text, source] = command
        return command

    def _reading(self, line: ReadLine) -> CommandResult:
        command = self._command(line.command, line.source)
        sensor = self._sensors.get(command.code)
        if sensor is None:
            raise RunLogError(f"{command.shown} reads no sensor of the log's configuration")
        value = number(line.reply)
        true = value if line.true is None else number(line.true)
        reading = Reading(sensor, value, true, None, sensor.read_time)
        pose = self._pose_at(line.t, line.n)
        before = pose if line.taken is None else self._pose_at(line.taken, line.n)
        return CommandResult(
            line.n,
            line.t,
            command,
            Status.READING,
            value,
            before,
            pose,
            "",
            reading,
            None,
            None,
            line.taken,
            line.link,
        )

    def _answer(self, line: AnswerLine) -> CommandResult:
        command = self._command(line.command, line.source, line.stops)
        if line.status is Status.DONE:
            for ended, started in self._ended:
                if ended.number == line.n:
                    return replace(self._done(ended, started), time=line.t, link=line.link)
        if line.status is Status.ACCEPTED:
            pose = before = self._start_of(line.n)
        else:
            pose = self._pose_at(line.t, line.n)
            before = pose if line.taken is None else self._pose_at(line.taken, line.n)
        return CommandResult(
            line.n,
            line.t,
            command,
            line.status,
            number(line.reply),
            before,
            pose,
            line.reason,
            taken=line.taken,
            link=line.link,
        )

    # -- movements -------------------------------------------------------------------------------

    def _movement(self, line: MoveLine) -> tuple[Event, ...]:
        command = self._command(line.command, line.source)
        grip = None if line.grip is None else self._grip(line.t, line.grip, self.pose)
        trajectory = self._trajectory(command, line, self.pose, line.t, line.total, line.end)
        planned = MovementPlanned(line.n, line.t, command, trajectory, grip)
        ended = MovementEnded(line.n, line.end, command, trajectory, line.stopped_by, line.answers, grip)
        before, self.pose, self._planned = self.pose, Pose(*line.pose), None
        self._ended.append((ended, before))
        if not line.answers:
            return planned, ended
        return planned, ended, self._done(ended, before)

    def _plan(self, line: PlanLine) -> MovementPlanned:
        command = self._command(line.command, line.source)
        if not line.again or self._planned is None:
            self._begun = self.pose
            start = line.t
        else:
            start = self._planned.trajectory.start_time
        grip = None if line.grip is None else self._grip(line.t, line.grip, self._begun)
        trajectory = self._trajectory(command, line, self._begun, start, line.total, None)
        self._planned = MovementPlanned(line.n, line.t, command, trajectory, grip)
        return self._planned

    def _end(self, line: EndLine) -> tuple[Event, ...]:
        planned = self._planned
        if planned is None or planned.number != line.n:
            raise RunLogError(f"the end of command number {line.n} has no beginning before it")
        plan = planned.trajectory
        if line.t < plan.start_time:
            raise RunLogError("the movement ends before it begins")
        total = (plan.totals.x, plan.totals.y, plan.totals.r)
        trajectory = self._trajectory(
            planned.command, line, self._begun, plan.start_time, total, line.t, plan.duration
        )
        ended = MovementEnded(
            line.n, line.t, planned.command, trajectory, line.stopped_by, line.answers, planned.grip
        )
        self._planned, self.pose = None, Pose(*line.pose)
        self._ended.append((ended, self._begun))
        return (ended, self._done(ended, self._begun)) if line.answers else (ended,)

    def _done(self, ended: MovementEnded, before: Pose) -> CommandResult:
        return CommandResult(
            ended.number,
            ended.time,
            ended.command,
            Status.DONE,
            math.inf,
            before,
            ended.pose if self._ended and self._ended[-1][0] is not ended else self.pose,
            "",
            None,
            ended.trajectory,
            ended.grip,
            ended.trajectory.start_time,
        )

    def _trajectory(
        self,
        command: Command,
        way: Way,
        start: Pose,
        begin: float,
        total: Placed | None,
        end: float | None,
        duration: float | None = None,
    ) -> Trajectory:
        """A movement's way from what its lines say."""
        drive = self._drives.get(command.code)
        if way.way and not isinstance(drive, GripperSpec):
            return _listed(way, start, begin)
        if drive is None:
            raise RunLogError(f"{command.shown} moves nothing in the log's configuration")
        if isinstance(drive, GripperSpec) or total is None:
            took = 1.0 / drive.speed if isinstance(drive, GripperSpec) else 0.0
            return standing(start, begin, took, cut=end if way.stopped_by else None)
        profile, whole = self._profile(command, drive)
        duration = whole if duration is None else duration
        if way.stop is not None and way.stop[0]:
            raise RunLogError("the rest of a movement has one segment")
        contact = None
        if way.contact is not None:
            fields = way.contact
            segment, turned, translated = fields.at
            count = self._spec.num_segments
            if segment >= count:
                raise RunLogError(f"the movement has no segment {segment}")
            x, y, turn = (each / count for each in total)
            met = Path.laid_one_by_one(start, x, y, turn, count).pose(segment, turned, translated)
            contact = Contact(
                met,
                fields.point,
                segment,
                turned,
                translated,
                fields.t,
                fields.ended,
                fields.drift,
                fields.held_block,
                fields.cell,
            )
        return rebuilt(
            start,
            drive.kind,
            Axes(*total),
            self._spec.num_segments,
            begin,
            duration,
            contact,
            None if way.stop is None else Stop(*way.stop),
            end if way.stopped_by else None,
            profile,
        )

    def _profile(self, command: Command, drive: DriveSpec) -> tuple[VelocityProfile | None, float]:
        """How a drive gets over the whole command, and how long it takes, seconds."""
        known = self._profiles.get(command.text)
        if known is None:
            value = parse_value(command.argument)
            if isinstance(value, str):
                raise RunLogError(f"{command.shown} has no value: {value}")
            way = abs(value * drive.gain)
            profile = profile_of(drive, way)
            known = profile, way / drive.speed if profile is None else profile.duration
            if not known[1] <= LARGEST:
                raise RunLogError(f"{command.shown} takes too long")
            if len(self._profiles) < _COMMANDS:
                self._profiles[command.text] = known
        return known

    def _grip(self, time: float, fields: GripFields, pose: Pose) -> Grip:
        """What the gripper did with the robot at a pose; by how much it missed the block follows from it."""
        spec, (x, y, heading) = self._spec, fields.block
        missed = None
        if fields.closed and not fields.holding and spec.gripper is not None and spec.block_size:
            block = Block(x, y, spec.block_size, heading)
            missed = missed_by(spec.gripper, self._footprint, pose, block)
        return Grip(time, fields.closed, fields.holding, Pose(x, y, heading), missed)

    def _action(self, line: ActionLine) -> ActionDone:
        action = Action(line.action, line.arguments, line.source)
        done = ActionDone(line.t, action, line.text, Pose(*line.pose), line.refused)
        if not line.refused:
            if action.name.restarts or done.pose != self.pose:
                self._ended.clear()
            self.pose = done.pose
        return done


def _listed(way: Way, start: Pose, begin: float) -> Trajectory:
    """The movement through the places that a log of format 1 lists, at even speed."""
    segments = max(len(way.way) - 1, 1)
    places = way.way if len(way.way) > 1 else (*way.way, *way.way)
    path = Path(start.heading, (way.heading - start.heading) / segments, places)
    contact = None
    if way.contact is not None:
        fields = way.contact
        pose = path.pose(segments - 1, 1.0, 1.0)
        contact = Contact(pose, fields.point, segments - 1, 1.0, 1.0, fields.t)
    total = Axes(r=way.heading - start.heading)
    return Trajectory(path, None, total, begin, max(way.arrival - begin, 0.0), contact)
