"""A planned movement and its speed, as functions of the time since it began."""

import math
from collections.abc import Mapping

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.path import Contact, Path, PathPosition
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import Axes, DriveKind


class VelocityProfile(Struct, frozen=True):
    """Trapezoidal speed over time: 0 for `lag` seconds, then a ramp up to `speed`, and a ramp down to the
    end, both at `acceleration` (0: at once). `distance` (0 or more) is the commanded length or angle,
    inches or degrees. A short one never reaches full speed; one of 0 takes no time."""

    distance: float
    speed: float
    lag: float = 0.0
    acceleration: float = 0.0

    @property
    def _top(self) -> float:
        """The greatest speed that is reached."""
        if not self.acceleration:
            return self.speed
        # A distance shorter than both ramps gives a triangle: v^2 = 2 a (distance / 2) at its top.
        return min(self.speed, math.sqrt(self.distance * self.acceleration))

    @property
    def _ramp(self) -> float:
        """Seconds of each ramp, up and down."""
        return self._top / self.acceleration if self.acceleration else 0.0

    @property
    def duration(self) -> float:
        """Seconds from the command to standstill: lag + distance / top + top / acceleration."""
        return self.lag + self.distance / self._top + self._ramp if self.distance else 0.0

    def fraction_at(self, elapsed: float) -> float:
        """The fraction of the distance that is done so many seconds after the command."""
        gone, left = elapsed - self.lag, self.duration - elapsed
        if gone <= 0.0:
            return 0.0
        if left <= 0.0:
            return 1.0
        ramp, top = self._ramp, self._top
        if gone < ramp:
            # s = a t^2 / 2 from the start, and the same backwards from the end.
            return self.acceleration * gone * gone / 2.0 / self.distance
        if left < ramp:
            return 1.0 - self.acceleration * left * left / 2.0 / self.distance
        return top * (gone - ramp / 2.0) / self.distance

    def time_at(self, fraction: float) -> float:
        """Seconds after the command at which a fraction (0 to 1) of the distance is done."""
        if not self.distance:
            return 0.0
        ramp, top = self._ramp, self._top
        gone, left = fraction * self.distance, (1.0 - fraction) * self.distance
        if gone < top * ramp / 2.0:
            return self.lag + math.sqrt(2.0 * gone / self.acceleration)
        if left < top * ramp / 2.0:
            return self.duration - math.sqrt(2.0 * left / self.acceleration)
        return self.lag + gone / top + ramp / 2.0


# Without garbage collection (gc=False): trajectories hold no cycles, and thousands are kept.
class Trajectory(Struct, frozen=True, gc=False):
    """One movement, planned once, with noise and contact.

    `path` is the robot's path without any obstacle, `contact` its first contact with one. There the movement
    ends, unless its errors were dropped. Then the robot continues along `rest`, a path of one segment, to its
    end or to `rest_stop`, where an obstacle stops it.

    `kind` is the drive's (None for a robot that stands still). `totals` are the motion of the whole command
    on each axis, with errors (inches and degrees, in the robot's frame); each segment does its share. The
    wheels turn for the whole `duration` (seconds of simulated time from `start_time`) unless the movement was
    `cut` short at that simulated time. Their speed is constant, or follows `profile`.
    """

    path: Path
    kind: DriveKind | None
    totals: Axes
    start_time: float
    duration: float
    contact: Contact | None = None
    rest: Path | None = None
    rest_stop: PathPosition | None = None
    cut: float | None = None
    wheels: Mapping[str, FloatArray] = {}
    """Odometers: by sensor ID the (n, 2) increments of each segment's turn and translation; empty where they
    are not known."""
    turns: Mapping[str, FloatArray] = {}
    """Gyros: by sensor ID the (n,) increments of each segment's turn."""
    profile: VelocityProfile | None = None

    @property
    def before(self) -> Pose:
        """The pose at its beginning."""
        x, y = self.path.places[0]
        return Pose(x, y, self.path.start)

    @property
    def turning(self) -> bool:
        """True if the turn of a segment takes the time, False if the translation does."""
        return self.kind is not None and self.kind.turns

    @property
    def move(self) -> tuple[float, float]:
        """Each segment's translation in the robot's frame, inches."""
        segments = self.path.segments
        return self.totals.x / segments, self.totals.y / segments

    @property
    def end_time(self) -> float:
        """Simulated time at which the command is over."""
        return self.start_time + self.duration if self.cut is None else self.cut

    @property
    def held_at(self) -> float | None:
        """Simulated time from which an obstacle blocks the robot for the rest of the command, or None."""
        contact = self.contact
        if contact is None or not contact.ended:
            return None
        if self.rest is None or self.rest_stop is None:
            return contact.time
        done = self.rest_stop.turned if self.turning else self.rest_stop.translated
        begun = self._parts_before(contact.place)
        return self._time_after(begun + done * (self.path.segments - begun))

    def progress(self, time: float) -> PathPosition:
        """Position that the wheels have reached at a simulated time."""
        parts, segments = self._parts(time), self.path.segments
        # The end is the end of the last segment, not the start of one more.
        if parts >= segments:
            return PathPosition(segments - 1, 1.0, 1.0)
        segment = int(parts)
        fraction = parts - segment
        return PathPosition(segment, fraction, 0.0) if self.turning else PathPosition(segment, 1.0, fraction)

    def place(self, time: float) -> tuple[Path, PathPosition]:
        """The path that the robot itself is on at a simulated time, and its position there."""
        contact = self.contact
        if contact is None:
            return self.path, self.progress(time)
        if (time if self.cut is None else min(time, self.cut)) < contact.time:
            return self.path, min(self.progress(time), contact.place)
        if self.rest is None:
            return self.path, contact.place
        begun = self._parts_before(contact.place)
        done = max(self._parts(time) - begun, 0.0) / (self.path.segments - begun)
        at = PathPosition(0, done, 0.0) if self.turning else PathPosition(0, 1.0, done)
        return self.rest, at if self.rest_stop is None else min(at, self.rest_stop)

    def pose_at(self, time: float) -> Pose:
        """The robot's pose at a simulated time."""
        path, at = self.place(time)
        return path.pose(at.segment, at.turned, at.translated)

    def poses_at(self, times: FloatArray) -> FloatArray:
        """`pose_at` for many times, (n,): poses (n, 3), the same numbers bit for bit."""
        if self.contact is not None or self.profile is not None or not self.duration:
            one_by_one = map(self.pose_at, times.tolist())
            return np.array([(pose.x, pose.y, pose.heading) for pose in one_by_one]).reshape(len(times), 3)
        # As `_parts`, `progress` and `Path.pose` do it.
        if self.cut is not None:
            times = np.minimum(times, self.cut)
        path, segments = self.path, self.path.segments
        parts = np.maximum((times - self.start_time) / self.duration, 0.0) * segments
        parts[times >= self.start_time + self.duration] = segments
        segment = np.minimum(parts.astype(np.intp), segments - 1)
        fraction = parts - segment
        whole = parts >= segments
        turned, translated = (fraction, np.where(whole, 1.0, 0.0)) if self.turning else (1.0, fraction)
        places = path.points
        poses = np.empty((3, len(times)))
        for row, along in zip(poses, places.T, strict=False):
            row[:] = along[segment] + translated * np.diff(along)[segment]
        poses[2] = path.start + path.turn * (segment + turned)
        return poses.T

    def time_of(self, stop: PathPosition) -> float:
        """Simulated time at which the robot reaches a place on its path."""
        return self._time_after(self._parts_before(stop))

    def rolled(self, sensor: str, time: float) -> float:
        """Count of an odometer since the start, inches."""
        at = self.progress(time)
        parts = self.wheels[sensor]
        turned, translated = parts[at.segment]
        return float(parts[: at.segment].sum() + at.turned * turned + at.translated * translated)

    def turned(self, sensor: str, time: float) -> float:
        """Count of a gyro since the start, degrees."""
        segment, fraction = self._turns_done(time)
        parts = self.turns[sensor]
        return float(parts[:segment].sum() + fraction * parts[segment])

    def travelled(self, time: float) -> float:
        """Distance travelled by the robot's centre, inches."""
        return self.travel(time)[0]

    def moved(self, time: float) -> tuple[float, float, float]:
        """Real motion by a simulated time, in the robot's frame: degrees turned, inches ahead and to the
        left. Each segment adds the same."""
        return self.travel(time)[1]

    def travel(self, time: float) -> tuple[float, tuple[float, float, float]]:
        """`travelled` and `moved` at once."""
        path, at = self.place(time)
        turned = path.start + path.turn * (at.segment + at.turned) - self.path.start
        # Without a drive nothing was commanded: the path's points are all there is.
        if self.kind is None:
            return path.length_to(at), (turned, *path.along(at))
        x, y = self.move
        length, contact = math.sqrt(x * x + y * y), self.contact
        # Wheels turn as commanded until a contact; after it only the distance that the robot slid counts.
        if path is self.path or contact is None:
            gone = at.segment + at.translated
            return gone * length, (turned, gone * x, gone * y)
        before = contact.segment + contact.translated
        ahead, aside = path.along(at)
        return before * length + path.length_to(at), (turned, before * x + ahead, before * y + aside)

    def trail(self, time: float) -> FloatArray:
        """The robot's centres from the start to where it is at a simulated time, (k, 2)."""
        return np.array(self.centres(time))

    def centres(self, time: float) -> list[tuple[float, float]]:
        """`trail` as plain numbers."""
        path, at = self.place(time)
        pose = path.pose(at.segment, at.turned, at.translated)
        there = (pose.x, pose.y)
        if path is not self.rest or self.contact is None:
            return [*path.places[: at.segment + 1], there]
        dropped = self.contact
        before = [*self.path.places[: dropped.segment + 1], (dropped.pose.x, dropped.pose.y)]
        # A turn stays on the spot.
        return before if self.turning else [*before, there]

    def stopped(self, time: float) -> "Trajectory":
        """The same movement, cut short at a simulated time."""
        if time >= self.end_time:
            return self
        cut = replace(self, cut=max(time, self.start_time))
        contact, held_at = self.contact, self.held_at
        # A movement that is stopped before its contact has none.
        if contact is None or contact.time > time:
            return replace(cut, contact=None, rest=None, rest_stop=None)
        # Stopped while it slid along the wall: the contact was there but did not end it.
        if held_at is not None and held_at > time:
            return replace(cut, contact=replace(contact, ended=False), rest_stop=None)
        return cut

    # -- segments done, as a number from 0 to n ------------------------------------------------

    def _parts(self, time: float) -> float:
        """Segments the wheels have done at a simulated time, all of them exactly at the end."""
        if self.cut is not None:
            time = min(time, self.cut)
        # Exactly all of them: start + duration and its parts round differently.
        if time >= self.start_time + self.duration:
            return float(self.path.segments)
        elapsed = time - self.start_time
        if elapsed <= 0.0:  # a movement of no length has no duration to divide by
            return 0.0
        done = elapsed / self.duration if self.profile is None else self.profile.fraction_at(elapsed)
        return done * self.path.segments

    def _parts_before(self, stop: PathPosition) -> float:
        return stop.segment + (stop.turned if self.turning else stop.translated)

    def _time_after(self, parts: float) -> float:
        done = parts / self.path.segments
        return self.start_time + (
            self.duration * done if self.profile is None else self.profile.time_at(done)
        )

    def _turns_done(self, time: float) -> tuple[int, float]:
        """Number of segments' turns that were really made, and the fraction of the next."""
        path, at = self.place(time)
        contact = self.contact
        if path is self.path or contact is None:
            return at.segment, at.turned
        # The rest of a translation after its contact does not turn the robot.
        if not self.turning:
            return contact.segment, contact.turned
        begun = self._parts_before(contact.place)
        parts = begun + at.turned * (self.path.segments - begun)
        segment = min(int(parts), self.path.segments - 1)
        return segment, parts - segment
