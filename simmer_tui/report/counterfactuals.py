"""Counterfactuals: the deciding movement of a run repeated, without its errors or from another place.

Runs repeat exactly, so the movement with a contact, and those before it since the last reading, can be
repeated with one change. Only movements are repeated, never the program: its other decisions are in no log.
A velocity is not repeated: it has no end that was asked for. Only walls count: a block that was touched lies
elsewhere by then.
"""

import math
from collections.abc import Sequence
from enum import StrEnum

from msgspec import Struct
from msgspec.structs import astuple

from simmer_tui.run.attempt import Collision
from simmer_tui.run.events import MovementEnded
from simmer_tui.sim.command import parse_value
from simmer_tui.sim.footprint import Footprint
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

    EXACT = "without drive errors since the last reading"
    BELIEVED = "from where the program believed to be"


class Counterfactual(Struct, frozen=True):
    """A change, and in `saved` True if the movement would then have touched nothing. It is None if that
    cannot be decided: the robot would have stood in a wall, or passed one by less than `NARROW`."""

    change: Change
    saved: bool | None


class CounterfactualWorld:
    """The walls in which a movement with a contact is planned again, with a change."""

    def __init__(self, spec: SimulationSpec, met: Collision) -> None:
        self._spec, self._met = spec, met
        self._maze = Maze(spec.maze)
        body = Footprint.of(spec.robot)
        self._body = body if met.held is None else body.with_block(met.held.corners())
        self._walls = Obstacles.of_maze(self._maze.walls)
        self._drives = {drive.code: drive for drive in spec.drives}

    def asked(self, ended: MovementEnded) -> Axes | None:
        """Distance of a movement on each axis without its errors; None if its command's value is not
        known."""
        drive = self._drives.get(ended.command.code)
        value = parse_value(ended.command.argument)
        if drive is None or ended.trajectory.kind is None or isinstance(value, str):
            return None
        return Axes(*(value * drive.gain * each for each in astuple(drive.kind.direction)))

    def exact(self, before: Sequence[MovementEnded]) -> Counterfactual | None:
        """The movement after the ones before it, all as they were asked for; None for a velocity."""
        pose = before[0].before if before else self._met.ended.before
        for ended in before:
            planned = self._planned(pose, ended.trajectory.kind, self.asked(ended))
            if planned is None or planned.contact is not None:
                return Counterfactual(Change.EXACT, None if planned is None else False)
            pose = planned.pose_at(planned.end_time)
        asked = self.asked(self._met.ended)
        return None if asked is None else Counterfactual(Change.EXACT, self._clears(pose, asked))

    def believed(self, start: Pose) -> Counterfactual | None:
        """The movement from where the program believed to be at its beginning; None for a velocity."""
        if self.asked(self._met.ended) is None:
            return None
        return Counterfactual(Change.BELIEVED, self._clears(start, self._met.ended.trajectory.totals))

    def _clears(self, start: Pose, totals: Axes) -> bool | None:
        """True if the movement would pass everything with a margin of `NARROW`, None with a smaller one."""
        kind = self._met.ended.trajectory.kind
        planned = self._planned(start, kind, totals)
        if planned is None or planned.contact is not None:
            return None if planned is None else False
        # A start closer to a wall than that is too narrow as well.
        for x, y in _AROUND:
            shifted = Pose(start.x + NARROW * x, start.y + NARROW * y, start.heading)
            planned = self._planned(shifted, kind, totals)
            if planned is None or planned.contact is not None:
                return None
        return True

    def _planned(self, start: Pose, kind: DriveKind | None, totals: Axes | None) -> Trajectory | None:
        """A movement from a pose, until its contact; None if the robot would stand in a wall."""
        if kind is None or totals is None or self._walls.overlap(self._body, start):
            return None
        segments = self._spec.num_segments
        planner = Planner(segments, self._spec.contact, {})
        planned = rebuilt(Path.lazy(start, *totals.share(segments), segments), kind, totals, 0.0, 1.0)
        return planner.checked(planned, CollisionChecker(self._body, self._walls, self._maze))
