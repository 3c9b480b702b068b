"""Counterfactuals: the movement that decided a run again, without its errors or from another place.

Runs repeat exactly, so the movement that went wrong can be laid out anew, and the movements before it, with
all else as it was. With P the errors, B the bias, d the distance asked for on all axes together and e the
draws, a movement leads on axis a by a + d B + d (1 + B) P e (`sim.motion.Planner.plan`). Total, a, d and B
are known, so that the part of the noise is too.

Only the movements are laid again, never the program: what it would have decided otherwise is in no log.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from simmer_tui.events import MovementEnded
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import parse_value
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.motion import CollisionChecker, Planner, rebuilt
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import Axes, DriveKind, SimulationSpec
from simmer_tui.sim.trajectory import Trajectory

INCH = 1.0
"""A step to the side that a careful program could have kept, inches: judged."""
FURTHER = 3.0
"""Room that a robot 6 in wide has on either side in the middle of a cell of 12 in: more could not be had."""
NARROW = 0.5
"""Room to the walls, inches, that no program should count on being enough."""
_AROUND = tuple((math.cos(turn * math.pi / 4), math.sin(turn * math.pi / 4)) for turn in range(8))


class Change(StrEnum):
    """Changes of a movement, or of the last ones."""

    NO_NOISE = "without noise"
    NO_BIAS = "without bias"
    EXACT = "without noise and bias"
    UNSEEN = "without drive errors since the last reading"
    LAST = "without drive errors in the last movements"
    BELIEVED = "from where the program believed to be"
    NO_BLOCK = "without the block in the gripper"
    ASIDE = "an inch to the side"
    FURTHER_OFF = "from 3 in further off"


@dataclass(frozen=True, slots=True)
class Counterfactual:
    """A change and whether the movement would then have met nothing; None if that cannot be told: the robot
    would have stood in a wall, or passed one by a hair."""

    change: Change
    saved: bool | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Deciding:
    """A movement that met something, and what is known of it: the movements before it, newest last, that
    followed on one another with nothing in between, `unseen` of them since a sensor was read; the bias, the
    block held (in the robot's frame) or lying, and where the program took itself to be, if it said so."""

    ended: MovementEnded
    before: Sequence[MovementEnded]
    unseen: int
    bias: Mapping[DriveKind, Axes]
    held: Block | None
    lying: Block
    believed: Pose | None


class CounterfactualWorld:
    """The walls in which movements are planned again, with a change. Make one a run."""

    def __init__(self, spec: SimulationSpec) -> None:
        self._spec = spec
        self._maze = Maze(spec.maze)
        self._footprint = Footprint.of(spec.robot)
        self._walls = Obstacles.of_maze(self._maze.walls)
        self._drives = {drive.code: drive for drive in spec.drives}

    def asked(self, ended: MovementEnded, bias: Mapping[DriveKind, Axes], change: Change) -> Axes | None:
        """Distance of a movement on each axis after a change of its errors; None if what was
        asked for is not known."""
        trajectory = ended.trajectory
        drive = self._drives.get(ended.command.code)
        value = parse_value(ended.command.argument)
        if drive is None or trajectory.kind is None or isinstance(value, str):
            return None
        # The formula of the module's docstring, solved for the noise.
        asked = value * drive.gain
        direction, biases = drive.kind.direction, bias.get(drive.kind, Axes())
        whole = asked * (direction.x + direction.y + direction.r)

        def part(commanded: float, bias: float, total: float) -> float:
            commanded *= asked
            noise = total - commanded - whole * bias
            if change is Change.NO_NOISE:
                return commanded + whole * bias
            if change is Change.NO_BIAS:
                # The noise was drawn on the biased distance: without the bias it is smaller by that factor.
                return commanded + (noise / (1.0 + bias) if bias != -1.0 else 0.0)
            return commanded

        totals = trajectory.totals
        return Axes(
            part(direction.x, biases.x, totals.x),
            part(direction.y, biases.y, totals.y),
            part(direction.r, biases.r, totals.r),
        )

    def tried(self, deciding: Deciding) -> list[Counterfactual]:
        """All changes that make sense of a movement that met something."""
        made = (self._tried(deciding, change) for change in Change)
        return [each for each in made if each is not None]

    def _tried(self, deciding: Deciding, change: Change) -> Counterfactual | None:
        """A change tried; None if it would change nothing."""
        ended = deciding.ended
        start, totals = ended.before, ended.trajectory.totals
        match change:
            case Change.UNSEEN:
                return self._without_errors(deciding, change, deciding.unseen)
            case Change.LAST:
                # Else it is the change before.
                further = len(deciding.before) > deciding.unseen
                return self._without_errors(deciding, change, len(deciding.before)) if further else None
            case Change.BELIEVED:
                believed = deciding.believed
                return None if believed is None else self._cleared(deciding, change, believed, totals)
            case Change.NO_BLOCK:
                if deciding.held is None:
                    return None
                nothing = Block(0.0, 0.0, 0.0)
                return self._cleared(replace(deciding, held=None, lying=nothing), change, start, totals)
            case Change.ASIDE:
                return self._from(deciding, change, _aside(ended, INCH))
            case Change.FURTHER_OFF:
                return self._from(deciding, change, [*_aside(ended, FURTHER), *_back(ended, FURTHER)])
            case _:
                asked = self.asked(ended, deciding.bias, change)
                if asked is None or asked == totals:
                    return None
                return self._cleared(deciding, change, start, asked)

    def _from(self, deciding: Deciding, change: Change, places: Sequence[Pose]) -> Counterfactual:
        """The movement from other places, of which one that is free suffices."""
        met = [self._meets(deciding, place, deciding.ended.trajectory.totals) for place in places]
        possible = [each for each in met if each is not None]
        return Counterfactual(change, not all(possible) if possible else None)

    def _without_errors(self, deciding: Deciding, change: Change, count: int) -> Counterfactual | None:
        """The movement after so many others, all as they were asked for."""
        before = deciding.before[len(deciding.before) - count :]
        asked = self.asked(deciding.ended, deciding.bias, Change.EXACT)
        if not before or asked is None:
            return None
        pose = before[0].before
        for ended in before:
            kind, totals = ended.trajectory.kind, self.asked(ended, deciding.bias, Change.EXACT)
            if kind is None or totals is None or self._walls.overlap(self._body(deciding), pose):
                return Counterfactual(change, None)
            laid = self._laid(deciding, pose, kind, totals)
            if laid.contact is not None:
                return Counterfactual(change, False)
            pose = laid.pose_at(laid.end_time)
        return self._cleared(deciding, change, pose, asked)

    def _cleared(self, deciding: Deciding, change: Change, start: Pose, totals: Axes) -> Counterfactual:
        """The movement from a pose: saved if it would pass everything by a fair margin."""
        met = self._meets(deciding, start, totals)
        if met is not False:
            return Counterfactual(change, None if met is None else False)
        shifted = (Pose(start.x + NARROW * x, start.y + NARROW * y, start.heading) for x, y in _AROUND)
        # Standing closer to a wall than that is too narrow as well.
        passes = all(self._meets(deciding, each, totals) is False for each in shifted)
        return Counterfactual(change, True if passes else None)

    def _meets(self, deciding: Deciding, start: Pose, totals: Axes) -> bool | None:
        """True if the movement from a pose would touch anything; None if the robot would stand in a wall."""
        kind = deciding.ended.trajectory.kind
        if kind is None or self._walls.overlap(self._body(deciding), start):
            return None
        return self._laid(deciding, start, kind, totals).contact is not None

    def _laid(self, deciding: Deciding, start: Pose, kind: DriveKind, totals: Axes) -> Trajectory:
        body, obstacles, lying = self._body(deciding), self._walls, deciding.lying
        if self._spec.block_solid and deciding.held is None and lying.size:
            solid = self._walls.with_block(lying)
            # A block that overlaps the robot already would make a contact of every movement.
            obstacles = obstacles if solid.overlap(body, start) else solid
        planner = Planner(self._spec.num_segments, self._spec.contact, {})
        laid = rebuilt(start, kind, totals, self._spec.num_segments, 0.0, 1.0)
        return planner.checked(laid, CollisionChecker(body, obstacles, self._maze))

    def _body(self, deciding: Deciding) -> Footprint:
        body, held = self._footprint, deciding.held
        return body if held is None else Footprint(body.radius, (*body.polygons, held.corners()), True)


def _aside(ended: MovementEnded, distance: float) -> list[Pose]:
    """The movement's beginning, moved to either side of its path; of a turn, away from what it met."""
    start, contact = ended.before, ended.contact
    if ended.trajectory.turning and contact is not None:
        away = math.atan2(contact.pose.y - contact.point[1], contact.pose.x - contact.point[0])
        return [_moved(start, away, distance)]
    course = _course(ended)
    return [_moved(start, course + math.pi / 2, distance), _moved(start, course - math.pi / 2, distance)]


def _back(ended: MovementEnded, distance: float) -> list[Pose]:
    """The beginning of a movement that goes somewhere, moved back along its path."""
    return [] if ended.trajectory.turning else [_moved(ended.before, _course(ended) + math.pi, distance)]


def _course(ended: MovementEnded) -> float:
    x, y = ended.trajectory.move
    return math.radians(ended.before.heading) + math.atan2(y, x)


def _moved(pose: Pose, course: float, distance: float) -> Pose:
    return Pose(pose.x + distance * math.cos(course), pose.y + distance * math.sin(course), pose.heading)
