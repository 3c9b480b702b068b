"""From a drive command to a trajectory: drawn errors, path, contact."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
from msgspec import Struct
from msgspec.structs import astuple, replace

from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.contact import FirstContact, first_contact
from simmer_tui.sim.device_faults import faults_of
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.noise import DRIVE_STREAM
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.path import PATH_START, Contact, Path, PathPosition
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors import CountingSensor
from simmer_tui.sim.specs import Axes, ContactRule, DriveKind, DriveSpec
from simmer_tui.sim.trajectory import Trajectory, VelocityProfile

AT_ONCE = 1e-6
"""Length, inches, below which the rest of a command counts as 0."""
_AT_ITS_START = PathPosition(0, 1.0, 0.0)


class CollisionChecker(Struct, frozen=True):
    """Finds contacts of the robot's footprint, or of its body with a held block, with obstacles."""

    footprint: Footprint
    obstacles: Obstacles
    maze: Maze

    @property
    def size(self) -> float:
        """The maze's diagonal, inches: no free straight path is longer, so that nothing beyond is
        searched."""
        return math.hypot(self.maze.width, self.maze.height)

    def first(self, path: Path, after: PathPosition = PATH_START) -> FirstContact | None:
        """The first contact of a path after a place on it."""
        return first_contact(self.footprint, self.obstacles, path, self.size, after)

    def blocked_at_once(self, rest: Path) -> bool:
        """True if a straight rest of a movement is blocked from its start."""
        length = math.dist(*rest.places)
        fraction = min(AT_ONCE / length, 1.0) if length else 1.0
        return self.obstacles.overlap(self.footprint, rest.pose(0, 1.0, fraction))


class Planner:
    """Plans movements of `segments` equal parts, with errors from the random streams. `rule` decides which
    contacts end them. `clearance` is the distance before a contact at which the robot stops, inches."""

    def __init__(
        self,
        segments: int,
        rule: ContactRule,
        streams: Mapping[str, np.random.Generator],
        clearance: float = 0.0,
    ) -> None:
        self.segments = segments
        self.rule = rule
        self._streams = streams
        self._clearance = clearance

    def plan(
        self, drive: DriveSpec, bias: Axes, value: float, start: Pose, time: float, noise: bool
    ) -> Trajectory:
        """The movement by `value` (inches or degrees, Gain included) from `start`, in free space.

        Per axis a: total = a + d B + d (1 + B) P e, with d the sum over the axes, B the bias, P the
        error and e one normal draw.
        """
        # Always three draws, also for axes without error: a changed set keeps the draws of the others.
        draws = self._streams[DRIVE_STREAM].standard_normal(3) if noise else np.zeros(3)
        asked = value * np.array(astuple(drive.kind.direction))
        biases, errors = np.array(astuple(bias)), np.array(astuple(drive.error))
        total = asked.sum()
        x, y, r = (asked + total * biases + total * (1.0 + biases) * errors * draws).tolist()
        profile = profile_of(drive, abs(value))
        duration = abs(value) / drive.speed if profile is None else profile.duration
        free = _in_free_space(start, drive.kind, Axes(x, y, r), self.segments, time, duration)
        return replace(free, profile=profile)

    def counted(self, trajectory: Trajectory, sensors: Iterable[CountingSensor], noise: bool) -> Trajectory:
        """The same with the future counts of odometers and gyros, whose errors are drawn here."""
        wheels: dict[str, FloatArray] = {}
        turns: dict[str, FloatArray] = {}
        path = trajectory.path
        count = path.segments
        for sensor in sensors:
            name, shape = sensor.id, (count, 2) if sensor.slips else (count,)
            draws = self._streams[name].standard_normal(shape) if noise else np.zeros(shape)
            counts = (wheels if sensor.slips else turns)[name] = np.zeros(shape)
            with faults_of(sensor, kept=True):
                counts[...] = sensor.increments(path.turn, trajectory.move, draws)
        return replace(trajectory, wheels=wheels, turns=turns)

    def standing(
        self, pose: Pose, time: float, duration: float, sensors: Iterable[CountingSensor]
    ) -> Trajectory:
        """No movement for a duration (seconds), while the robot does something else. Nothing is drawn."""
        wheels = {each.id: np.zeros((1, 2)) for each in sensors if each.slips}
        turns = {each.id: np.zeros(1) for each in sensors if not each.slips}
        return replace(standing(pose, time, duration), wheels=wheels, turns=turns)

    def checked(self, trajectory: Trajectory, checker: CollisionChecker) -> Trajectory:
        """The same with the first contact on its path, if there is one, and its consequences."""
        return self._met(trajectory, checker.first(trajectory.path), checker)

    def checked_again(self, trajectory: Trajectory, time: float, checker: CollisionChecker) -> Trajectory:
        """The same after an obstacle has appeared or gone at a simulated time: the rest of the path is
        checked again, without new draws. A movement that has ended stays ended, and errors that were dropped
        stay dropped."""
        held_at, contact = trajectory.held_at, trajectory.contact
        if held_at is not None and held_at <= time:
            return trajectory
        path, at = trajectory.place(time)
        if contact is None or contact.time > time:
            return self._met(trajectory, checker.first(path, at), checker, at)
        if trajectory.rest is None:
            return trajectory
        met = checker.first(path, at)
        return replace(
            trajectory,
            contact=replace(contact, ended=met is not None),
            rest_stop=None if met is None else self._kept_clear(path, met.stop, checker, at),
        )

    def _kept_clear(
        self, path: Path, stop: PathPosition, checker: CollisionChecker, after: PathPosition = PATH_START
    ) -> PathPosition:
        """The place where a robot stops that would touch an obstacle at `stop`."""
        if not self._clearance:
            return stop
        return path.before(stop, self._clearance, checker.footprint.reach, after)

    def _met(
        self,
        trajectory: Trajectory,
        met: FirstContact | None,
        checker: CollisionChecker,
        after: PathPosition = PATH_START,
    ) -> Trajectory:
        """The movement, ended or changed by the first contact on its path if there is one. The path before
        `after` is not searched."""
        if met is None:
            return replace(trajectory, contact=None, rest=None, rest_stop=None)
        path, reached = trajectory.path, met.stop
        met_at = path.pose(reached.segment, reached.turned, reached.translated)
        touch = checker.obstacles.touch(checker.footprint, met_at, met.beyond)
        # The part of a segment that the command asked for: a rotation's turn, a translation's translation.
        commanded = (reached.turned < 1.0) == trajectory.turning
        # Tested at the place of contact: from further back the rest is never blocked at once.
        beyond = rest_of(trajectory, reached)
        at_once = beyond is None or (commanded and (trajectory.turning or checker.blocked_at_once(beyond)))
        stop = self._kept_clear(path, reached, checker, after)
        pose = path.pose(stop.segment, stop.turned, stop.translated)
        rest = rest_of(trajectory, stop)
        ends_here = self.rule is ContactRule.STOP or (trajectory.turning and commanded)
        rest_stop = None
        if not ends_here and rest is not None:
            blocked = None if at_once else checker.first(rest)
            if at_once:
                rest_stop = _AT_ITS_START
            elif blocked is not None:
                rest_stop = self._kept_clear(rest, blocked.stop, checker)
        contact = Contact(
            pose,
            touch.point,
            stop.segment,
            stop.turned,
            stop.translated,
            trajectory.time_of(stop),
            ended=ends_here or rest_stop is not None,
            drift=not (commanded and at_once),
            held_block=touch.held_block,
            cell=touch.cell,
        )
        return replace(trajectory, contact=contact, rest=None if ends_here else rest, rest_stop=rest_stop)


def rebuilt(
    path: Path,
    kind: DriveKind | None,
    totals: Axes,
    start_time: float,
    duration: float,
    contact: Contact | None = None,
    stop: PathPosition | None = None,
    cut: float | None = None,
    profile: VelocityProfile | None = None,
) -> Trajectory:
    """A logged movement, rebuilt without any search or draw.

    `path` is the path without any obstacle, `totals` are the whole command's, errors included. `contact` is
    its first contact. `stop` is the place where an obstacle stopped it on the rest of the command, after its
    errors were dropped (`Trajectory.rest_stop`). `cut` is the simulated time at which it was cut short,
    `profile` its drive's. Counts of odometers and gyros are left out.
    """
    plan = Trajectory(path, kind, totals, start_time, duration, contact, cut=cut, profile=profile)
    if contact is None or (contact.ended and stop is None):
        return plan
    return replace(plan, rest=rest_of(plan, contact.place), rest_stop=stop)


def standing(pose: Pose, time: float, duration: float, cut: float | None = None) -> Trajectory:
    """No movement for `duration` seconds, perhaps `cut` short at a simulated time."""
    return replace(_in_free_space(pose, None, Axes(), 1, time, duration), cut=cut)


def rest_of(trajectory: Trajectory, stop: PathPosition) -> Path | None:
    """The rest of a command after a contact on its path, errors on other axes dropped, as a path
    of one segment; None if there is none.

    The commanded axis keeps its total, its own error included. A rotation turns on the spot by the
    turn that is left. A translation keeps the heading it has and goes straight, in the commanded
    direction as it was when the movement began.
    """
    path, totals = trajectory.path, trajectory.totals
    pose = path.pose(stop.segment, stop.turned, stop.translated)
    if trajectory.turning:
        left = path.segments - stop.segment - stop.turned
        if not left:
            return None
        return Path(pose.heading, path.turn * left, ((pose.x, pose.y), (pose.x, pose.y)))
    share = (path.segments - stop.segment - stop.translated) / path.segments
    sideways = trajectory.kind is not None and trajectory.kind.direction.y != 0.0
    x, y = (0.0, totals.y * share) if sideways else (totals.x * share, 0.0)
    end = Pose(pose.x, pose.y, path.start).place(x, y)
    return Path(pose.heading, 0.0, ((pose.x, pose.y), end))


def profile_of(drive: DriveSpec, distance: float) -> VelocityProfile | None:
    """Profile of a drive over a distance; None if its speed is the same from beginning to end."""
    if not (drive.start_lag or drive.acceleration):
        return None
    return VelocityProfile(distance, drive.speed, drive.start_lag, drive.acceleration)


def _in_free_space(
    start: Pose, kind: DriveKind | None, totals: Axes, segments: int, time: float, duration: float
) -> Trajectory:
    """A movement in free space."""
    path = Path.of_segments(start, *totals.share(segments), segments)
    return Trajectory(path, kind, totals, time, duration)
