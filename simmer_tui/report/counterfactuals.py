"""Counterfactuals: the deciding movement of a run repeated, without its errors or from another place.

Runs repeat exactly, so the deciding movement, and those before it, can be repeated with one change.

Of a velocity the legs of its last inches are repeated, each at the commanded velocity of its wheels and for
as long. Only movements are repeated, never the program: its other decisions are in no log.
"""

import math
from collections.abc import Sequence
from enum import StrEnum

from msgspec import Struct
from msgspec.structs import astuple, replace

from simmer_tui.run.attempt import Collision
from simmer_tui.run.events import MovementEnded
from simmer_tui.sim.arc_contact import first_arc_contact
from simmer_tui.sim.arcs import LARGEST_TURN, Arc, Twist
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import parse_value
from simmer_tui.sim.distance_errors import DistanceErrors, TrueVelocity, components
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.motion import CollisionChecker, Planner, rebuilt
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.path import Path
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import Axes, DriveKind, SimulationSpec
from simmer_tui.sim.trajectory import Trajectory

NARROW = 0.5
"""Room to the walls, inches, that no program should count on being enough."""
_AROUND = tuple((math.cos(turn * math.pi / 4), math.sin(turn * math.pi / 4)) for turn in range(8))


class Change(StrEnum):
    """Changes of a movement, or of the last ones."""

    EXACT = "without noise and bias"
    UNSEEN = "without drive errors since the last reading"
    LAST = "without drive errors in the last movements"
    BELIEVED = "from where the program believed to be"
    NO_BLOCK = "without the block in the gripper"


class Counterfactual(Struct, frozen=True):
    """A change, and in `saved` True if the movement would then have touched nothing. It is None if that
    cannot be decided: the robot would have stood in a wall, or passed one by less than `NARROW`."""

    change: Change
    saved: bool | None


_Driven = tuple[Twist, float]
"""A velocity in the robot's frame, and its duration, seconds."""
_Motion = Axes | Sequence[_Driven]
"""A movement by its distance on each axis, or velocities one after the other."""


class CounterfactualWorld:
    """The walls in which movements are planned again, with a change. One serves a whole run."""

    def __init__(self, spec: SimulationSpec) -> None:
        self._spec = spec
        self._maze = Maze(spec.maze)
        self._footprint = Footprint.of(spec.robot)
        self._walls = Obstacles.of_maze(self._maze.walls)
        self._drives = {drive.code: drive for drive in spec.drives}
        self._by_kind = {drive.kind: drive for drive in spec.drives if drive.enabled}

    def asked(self, ended: MovementEnded) -> Axes | None:
        """Distance of a movement on each axis without its errors; None if its command's value is not
        known."""
        trajectory = ended.trajectory
        drive = self._drives.get(ended.command.code)
        value = parse_value(ended.command.argument)
        if drive is None or trajectory.kind is None or isinstance(value, str):
            return None
        return Axes(*(value * drive.gain * each for each in astuple(drive.kind.direction)))

    def tried(self, met: Collision, believed: Pose | None) -> list[Counterfactual]:
        """All changes that apply to a movement with a contact.

        Args:
            believed: Believed pose, if the program sent one: at the movement's beginning, or of a velocity at
                that of the first of its legs.
        """
        if not met.legs and met.ended.command.code not in self._drives:
            return []
        made = (self._tried(met, believed, change) for change in Change)
        return [each for each in made if each is not None]

    def _tried(self, met: Collision, believed: Pose | None, change: Change) -> Counterfactual | None:
        """A change tried; None if it would change nothing, or cannot be decided for a velocity."""
        ended, legs = met.ended, met.legs
        start = legs[0].before if legs else ended.before
        went: _Motion = [_driven(leg) for leg in legs] if legs else ended.trajectory.totals
        unseen, known = met.unseen, len(met.before)
        if legs:
            unseen, known = met.unseen_legs, len(legs)
        match change:
            case Change.UNSEEN:
                return self._without_errors(met, change, unseen)
            case Change.LAST:
                # Otherwise it is the same as the change before.
                return self._without_errors(met, change, known) if known > unseen else None
            case Change.BELIEVED:
                return None if believed is None else self._cleared(met, change, believed, went)
            case Change.NO_BLOCK:
                if met.held is None:
                    return None
                nothing = Block(0.0, 0.0, 0.0)
                return self._cleared(replace(met, held=None, lying=nothing), change, start, went)
            case _ if isinstance(went, Axes):
                asked = self.asked(ended)
                unchanged = asked is None or asked == went
                return None if asked is None or unchanged else self._cleared(met, change, start, asked)
        # Each leg of a velocity has errors of its own: `UNSEEN` and `LAST` have them.
        return None

    def _without_errors(self, met: Collision, change: Change, count: int) -> Counterfactual | None:
        """The last `count` legs at their commanded velocities; or the movement after `count` others, all as
        they were asked for."""
        if met.legs:
            legs = met.legs[-count:]
            exact = [(self._exact(leg.commanded), leg.duration) for leg in legs]
            if exact == [_driven(leg) for leg in legs]:
                return None
            return self._cleared(met, change, legs[0].before, exact)
        before = met.before[len(met.before) - count :]
        asked = self.asked(met.ended)
        if not before or asked is None:
            return None
        pose = before[0].before
        for ended in before:
            kind, totals = ended.trajectory.kind, self.asked(ended)
            if kind is None or totals is None or self._walls.overlap(self._body(met), pose):
                return Counterfactual(change, None)
            planned = self._trajectory(met, pose, kind, totals)
            if planned.contact is not None:
                return Counterfactual(change, False)
            pose = planned.pose_at(planned.end_time)
        return self._cleared(met, change, pose, asked)

    def _exact(self, commanded: Twist) -> Twist:
        """The velocity of a robot without drive errors."""
        parts = components(commanded, self._by_kind)
        return TrueVelocity(commanded, parts, DistanceErrors(1, {}, ()), {}, noise=False).whole

    def _cleared(self, met: Collision, change: Change, start: Pose, moved: _Motion) -> Counterfactual:
        """The counterfactual of a motion from a pose: saved if it would pass everything with a margin of
        `NARROW`."""
        touches = self._meets(met, start, moved)
        if touches is not False:
            return Counterfactual(change, None if touches is None else False)
        shifted = (Pose(start.x + NARROW * x, start.y + NARROW * y, start.heading) for x, y in _AROUND)
        # A start closer to a wall than that is too narrow as well.
        passes = all(self._meets(met, each, moved) is False for each in shifted)
        return Counterfactual(change, True if passes else None)

    def _meets(self, met: Collision, start: Pose, moved: _Motion) -> bool | None:
        """True if a motion from a pose would touch anything; None if the robot would stand in a wall."""
        kind = met.ended.trajectory.kind
        if kind is None or self._walls.overlap(self._body(met), start):
            return None
        if isinstance(moved, Axes):
            return self._trajectory(met, start, kind, moved).contact is not None
        body, obstacles, pose = self._body(met), self._obstacles(met, start), start
        for twist, seconds in moved:
            parts = math.ceil(abs(twist.r) * seconds / LARGEST_TURN) or 1
            for _ in range(parts):
                arc = Arc.of(pose, twist, seconds / parts)
                if first_arc_contact(body, obstacles, arc) is not None:
                    return True
                pose = arc.end
        return False

    def _trajectory(self, met: Collision, start: Pose, kind: DriveKind, totals: Axes) -> Trajectory:
        body, obstacles = self._body(met), self._obstacles(met, start)
        planner = Planner(self._spec.num_segments, self._spec.contact, {})
        segments = self._spec.num_segments
        planned = rebuilt(Path.lazy(start, *totals.share(segments), segments), kind, totals, 0.0, 1.0)
        return planner.checked(planned, CollisionChecker(body, obstacles, self._maze))

    def _obstacles(self, met: Collision, start: Pose) -> Obstacles:
        """The walls, and the block if it is solid and not held."""
        lying = met.lying
        if not (self._spec.block_solid and met.held is None and lying.size):
            return self._walls
        solid = self._walls.with_block(lying)
        # A block that overlaps the robot already would make a contact of every movement.
        return self._walls if solid.overlap(self._body(met), start) else solid

    def _body(self, met: Collision) -> Footprint:
        body, held = self._footprint, met.held
        return body if held is None else body.with_block(held.corners())


def _driven(leg: Leg) -> _Driven:
    """The true velocity of a leg in the robot's frame, and its duration, seconds."""
    ahead, aside = leg.arc.own_velocity
    return Twist(ahead, aside, leg.arc.rate), leg.duration
