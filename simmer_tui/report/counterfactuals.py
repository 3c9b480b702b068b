"""Counterfactuals: a movement again, without its errors or from another place.

Runs repeat exactly, so that the one movement that went wrong can be laid out anew, with all else as it
was. With P the errors, B the bias, d the distance asked for on all axes together and e the draws, a
movement leads on axis a by a + d B + d (1 + B) P e (`sim.motion.Planner.plan`). Total, a, d and B are
known, so that the part of the noise is too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
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

# A step to the side that a careful program could have kept: judged.
INCH = 1.0
NARROW = 0.5
"""Room to the walls, inches, that no program should count on being enough."""
_AROUND = tuple((math.cos(turn * math.pi / 4), math.sin(turn * math.pi / 4)) for turn in range(8))


class Change(StrEnum):
    """Changes of a movement."""

    NO_NOISE = "without noise"
    NO_BIAS = "without bias"
    EXACT = "without noise and bias"
    BELIEVED = "from where the program believed to be"
    ASIDE = "an inch to the side"


@dataclass(frozen=True, slots=True)
class Counterfactual:
    """A change and whether the movement would then have met nothing; None if it could not have been
    made, since the robot would have stood in a wall."""

    change: Change
    saved: bool | None


class Ground:
    """The walls that movements are laid out in anew. Make one a run."""

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
        if change not in (Change.NO_NOISE, Change.NO_BIAS, Change.EXACT):
            return trajectory.totals
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

    def meets(
        self, start: Pose, kind: DriveKind, totals: Axes, held: Block | None, lying: Block
    ) -> bool | None:
        """True if a movement from a pose would touch anything, with the block that is `held` (in the
        robot's frame) or lies somewhere; None if the robot would stand in a wall there."""
        body = self._footprint
        if held is not None:
            body = Footprint(body.radius, (*body.polygons, held.corners()), True)
        if self._walls.overlap(body, start):
            return None
        obstacles = self._walls
        if self._spec.block_solid and held is None and lying.size:
            solid = self._walls.with_block(lying)
            # A block that overlaps the robot already would make a contact of every movement.
            obstacles = obstacles if solid.overlap(body, start) else solid
        planner = Planner(self._spec.num_segments, self._spec.contact, {})
        laid = rebuilt(start, kind, totals, self._spec.num_segments, 0.0, 1.0)
        return planner.checked(laid, CollisionChecker(body, obstacles, self._maze)).contact is not None

    def tried(
        self,
        ended: MovementEnded,
        bias: Mapping[DriveKind, Axes],
        held: Block | None,
        lying: Block,
        believed: Pose | None,
    ) -> list[Counterfactual]:
        """All changes that make sense of a movement that met something: `believed` is where the program
        took itself to be at its beginning, if it said so."""
        kind, start = ended.trajectory.kind, ended.before
        if kind is None:
            return []
        made = []
        for change in Change:
            totals = self.asked(ended, bias, change)
            starts = [start]
            if change is Change.BELIEVED:
                starts = [] if believed is None else [believed]
            elif change is Change.ASIDE:
                starts = self._aside(ended)
            if totals is None or not starts or (totals == ended.trajectory.totals and starts == [start]):
                continue
            met = [self.meets(each, kind, totals, held, lying) for each in starts]
            possible = [each for each in met if each is not None]
            made.append(Counterfactual(change, not all(possible) if possible else None))
        return made

    def is_narrow(
        self, ended: MovementEnded, bias: Mapping[DriveKind, Axes], held: Block | None, lying: Block
    ) -> bool:
        """True if a movement without errors would have touched something, or passed it by a hair."""
        kind, start = ended.trajectory.kind, ended.before
        totals = self.asked(ended, bias, Change.EXACT)
        if kind is None or totals is None:
            return False
        places = [(0.0, 0.0), *((NARROW * x, NARROW * y) for x, y in _AROUND)]
        shifted = [Pose(start.x + x, start.y + y, start.heading) for x, y in places]
        # Standing closer to a wall than that is too narrow as well.
        return any(self.meets(each, kind, totals, held, lying) is not False for each in shifted)

    def _aside(self, ended: MovementEnded) -> list[Pose]:
        """The movement's beginning an inch to either side of its way; of a turn, away from what it met."""
        start, contact = ended.before, ended.contact
        trajectory = ended.trajectory
        if trajectory.turning and contact is not None:
            away = math.atan2(contact.pose.y - contact.point[1], contact.pose.x - contact.point[0])
            directions = [away]
        else:
            x, y = trajectory.move
            course = math.radians(start.heading) + math.atan2(y, x)
            directions = [course + math.pi / 2, course - math.pi / 2]
        return [
            Pose(start.x + INCH * math.cos(each), start.y + INCH * math.sin(each), start.heading)
            for each in directions
        ]
