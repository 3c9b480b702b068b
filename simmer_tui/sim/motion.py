"""From a drive command to a trajectory: errors drawn, path laid out, contact found."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from simmer_tui.sim.angles import FloatArray, cos_sin_array
from simmer_tui.sim.contact import Path, Stop, first_contact
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.noise import DRIVE_STREAM
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.records import Contact, Pose
from simmer_tui.sim.sensors import CountingSensor
from simmer_tui.sim.specs import Axes, DriveSpec
from simmer_tui.sim.trajectory import Trajectory


class Planner:
    """Plans movements of `segments` equal parts, drawing errors from the random streams."""

    def __init__(self, segments: int, streams: Mapping[str, np.random.Generator]) -> None:
        self.segments = segments
        self._streams = streams

    def plan(
        self, drive: DriveSpec, bias: Axes, value: float, start: Pose, time: float, noise: bool
    ) -> Trajectory:
        """The movement by `value` (inches or degrees, Gain included) from `start`, in free space.

        Per axis a: total = a + d B + d (1 + B) P e, with d the sum over the axes, B the bias, P the
        error and e one normal draw.
        """
        draws = self._streams[DRIVE_STREAM].standard_normal(3) if noise else np.zeros(3)
        direction = drive.kind.direction
        asked = value * np.array((direction.x, direction.y, direction.r))
        biases = np.array((bias.x, bias.y, bias.r))
        errors = np.array((drive.error.x, drive.error.y, drive.error.r))
        total = asked.sum()
        x, y, r = (asked + total * biases + total * (1.0 + biases) * errors * draws) / self.segments
        return Trajectory(
            path=_path(start, float(x), float(y), float(r), self.segments),
            move=(float(x), float(y)),
            start_time=time,
            duration=abs(value) / drive.speed,
            turning=drive.kind.turns,
        )

    def counted(
        self,
        trajectory: Trajectory,
        sensors: Iterable[CountingSensor],
        noise: bool,
    ) -> Trajectory:
        """The same with what odometers and gyros will count, their errors drawn here."""
        wheels: dict[str, FloatArray] = {}
        turns: dict[str, FloatArray] = {}
        path = trajectory.path
        count = path.segments
        for sensor in sensors:
            name, shape = sensor.spec.id, (count, 2) if sensor.slips else (count,)
            draws = self._streams[name].standard_normal(shape) if noise else np.zeros(shape)
            (wheels if sensor.slips else turns)[name] = sensor.increments(path.turn, trajectory.move, draws)
        return replace(trajectory, wheels=wheels, turns=turns)

    def standing(
        self, pose: Pose, time: float, duration: float, sensors: Iterable[CountingSensor]
    ) -> Trajectory:
        """No movement, for as long as something else takes (seconds). Nothing is drawn."""
        wheels = {each.spec.id: np.zeros((1, 2)) for each in sensors if each.slips}
        turns = {each.spec.id: np.zeros(1) for each in sensors if not each.slips}
        path = _path(pose, 0.0, 0.0, 0.0, 1)
        return Trajectory(path, (0.0, 0.0), time, duration, turning=False, wheels=wheels, turns=turns)

    def checked(
        self, trajectory: Trajectory, footprint: Footprint, obstacles: Obstacles, maze: Maze
    ) -> Trajectory:
        """The same with the contact that ends it, if the path runs into something."""
        size = math.hypot(maze.width, maze.height)
        stop = first_contact(footprint, obstacles, trajectory.path, size)
        return replace(trajectory, contact=_contact(trajectory, stop, footprint, obstacles))

    def checked_again(
        self, trajectory: Trajectory, time: float, footprint: Footprint, obstacles: Obstacles, maze: Maze
    ) -> Trajectory:
        """The same after an obstacle has appeared or gone at a simulated time: the rest of the
        path is checked anew. A robot that a wall holds already stays held."""
        at = trajectory.reached(time)
        if trajectory.contact is not None and trajectory.contact.time <= time:
            return trajectory
        size = math.hypot(maze.width, maze.height)
        stop = first_contact(
            footprint, obstacles, trajectory.path, size, Stop(at.segment, at.turned, at.translated)
        )
        return replace(trajectory, contact=_contact(trajectory, stop, footprint, obstacles))


def _path(start: Pose, x: float, y: float, turn: float, segments: int) -> Path:
    """Segments that each turn by `turn` degrees and then go (x, y) in the robot's frame."""
    cos, sin = cos_sin_array(start.heading + turn * np.arange(1.0, segments + 1.0))
    points: FloatArray = np.empty((segments + 1, 2))
    points[0] = start.x, start.y
    points[1:, 0] = start.x + np.cumsum(cos * x - sin * y)
    points[1:, 1] = start.y + np.cumsum(sin * x + cos * y)
    return Path(start.heading, turn, points)


def _contact(
    trajectory: Trajectory, stop: Stop | None, footprint: Footprint, obstacles: Obstacles
) -> Contact | None:
    if stop is None:
        return None
    pose = trajectory.path.pose(stop.segment, stop.turned, stop.translated)
    point = obstacles.nearest_point(footprint, pose)
    return Contact(pose, point, stop.segment, stop.turned, stop.translated, trajectory.time_of(stop))
