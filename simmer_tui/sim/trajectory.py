"""A planned movement: everything about it is a function of the time since it began."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.contact import Path, Stop
from simmer_tui.sim.records import Contact, Pose


@dataclass(frozen=True, slots=True, order=True)
class Progress:
    """How far along a path: segments done, and the fractions of the current one's turn and
    translation. Ordered along the path."""

    segment: int
    turned: float
    translated: float


@dataclass(frozen=True, slots=True)
class Trajectory:
    """One movement, planned once, noise and contact included.

    `path` is where the robot would go if nothing were in the way; `contact` is where it does stop.
    `move` is each segment's translation in the robot's frame. The wheels turn for the whole
    `duration` (seconds of simulated time from `start_time`) unless the movement was `cut` short
    at that simulated time. `turning` tells which part of a segment takes the time: the turn, or
    else the translation.
    """

    path: Path
    move: tuple[float, float]
    start_time: float
    duration: float
    turning: bool
    contact: Contact | None = None
    cut: float | None = None
    wheels: dict[str, FloatArray] = field(default_factory=dict)
    """Odometers: by sensor ID the (n, 2) increments of each segment's turn and translation."""
    turns: dict[str, FloatArray] = field(default_factory=dict)
    """Gyros: by sensor ID the (n,) increments of each segment's turn."""

    @property
    def end_time(self) -> float:
        """Simulated time at which the command is over."""
        return self.start_time + self.duration if self.cut is None else self.cut

    def progress(self, time: float) -> Progress:
        """How far the wheels have turned at a simulated time."""
        last = self.path.segments - 1
        elapsed = (time if self.cut is None else min(time, self.cut)) - self.start_time
        if elapsed >= self.duration:
            return Progress(last, 1.0, 1.0)
        scaled = max(elapsed, 0.0) / self.duration * self.path.segments
        segment = min(int(scaled), last)
        fraction = min(scaled - segment, 1.0)
        return Progress(segment, fraction, 0.0) if self.turning else Progress(segment, 1.0, fraction)

    def reached(self, time: float) -> Progress:
        """How far the robot itself has come at a simulated time: an obstacle holds it."""
        progress = self.progress(time)
        contact = self.contact
        if contact is None:
            return progress
        return min(progress, Progress(contact.segment, contact.turned, contact.translated))

    def pose_at(self, time: float) -> Pose:
        """The robot's pose at a simulated time."""
        reached = self.reached(time)
        return self.path.pose(reached.segment, reached.turned, reached.translated)

    def time_of(self, stop: Stop) -> float:
        """Simulated time at which the robot gets to a place on the path."""
        fraction = stop.turned if self.turning else stop.translated
        return self.start_time + self.duration * (stop.segment + fraction) / self.path.segments

    def rolled(self, sensor: str, time: float) -> float:
        """What an odometer counted since the start, inches."""
        at = self.progress(time)
        parts = self.wheels[sensor]
        turned, translated = parts[at.segment]
        return float(parts[: at.segment].sum() + at.turned * turned + at.translated * translated)

    def turned(self, sensor: str, time: float) -> float:
        """What a gyro counted since the start, degrees."""
        at = self.reached(time)
        parts = self.turns[sensor]
        return float(parts[: at.segment].sum() + at.turned * parts[at.segment])

    def travelled(self, time: float) -> float:
        """Length of the way the robot's centre has gone, inches."""
        at = self.reached(time)
        lengths = np.hypot(*np.diff(self.path.points[: at.segment + 2], axis=0).T)
        return float(lengths[:-1].sum() + at.translated * lengths[-1])

    def trail(self, time: float) -> FloatArray:
        """The robot's centres from the start to where it is at a simulated time, (k, 2)."""
        at = self.reached(time)
        pose = self.pose_at(time)
        return np.concatenate((self.path.points[: at.segment + 1], [(pose.x, pose.y)]))

    def stopped(self, time: float) -> Trajectory:
        """The same movement, cut short at a simulated time."""
        if time >= self.end_time:
            return self
        contact = self.contact if self.contact is not None and self.contact.time <= time else None
        return replace(self, cut=max(time, self.start_time), contact=contact)
