"""Legs of a continuous motion: each a part of it at one true velocity."""

import math
from collections.abc import Mapping

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.sim.arcs import Arc, Twist
from simmer_tui.sim.path import Contact, Path
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import Axes, DriveKind
from simmer_tui.sim.trajectory import Trajectory

# A quarter turn is then 15 pieces, within 1 % of the radius of the arc.
_DRAWN = 6.0
"""Degrees of an arc that are drawn as one straight piece."""


class Leg(Struct, frozen=True):
    """A part of a continuous motion at one true velocity, from `start_time` to `end_time` (simulated seconds,
    infinite for a robot that stands until something changes)."""

    arc: Arc
    start_time: float
    end_time: float
    last_pose: Pose
    """The pose at its end."""
    commanded: Twist
    """The velocity that was commanded."""
    counts: Mapping[str, float] = {}
    """Rates of odometers (in/s) and gyros (deg/s), by sensor ID; empty where they are not known."""
    pressed: bool = False
    """True if an obstacle keeps the robot from moving as its wheels turn."""
    contact: Contact | None = None
    """The contact at its end."""

    @property
    def before(self) -> Pose:
        """The pose at its beginning."""
        return self.arc.start

    @property
    def duration(self) -> float:
        """Seconds that it lasts."""
        return self.end_time - self.start_time

    def pose_at(self, time: float) -> Pose:
        """The robot's pose at a simulated time."""
        if time >= self.end_time:
            return self.last_pose
        return self.arc.pose_after(max(time - self.start_time, 0.0))

    def travelled(self, time: float) -> float:
        """Inches that the robot's centre has travelled by a simulated time."""
        x, y = self.arc.velocity
        speed = math.sqrt(x * x + y * y)
        return speed * max(min(time, self.end_time) - self.start_time, 0.0) if speed else 0.0

    def arrival(self, time: float) -> tuple[Pose, float]:
        """The pose at a simulated time, and the distance travelled until then, inches."""
        return self.pose_at(time), self.travelled(time)

    def centres(self, time: float) -> list[tuple[float, float]]:
        """The robot's centres from the start to where it is at a simulated time."""
        until = max(min(time, self.end_time) - self.start_time, 0.0)
        last = self.pose_at(time)
        first = (self.arc.start.x, self.arc.start.y)
        if until == math.inf:
            return [first, first]
        pieces = max(math.ceil(abs(self.arc.rate) * until / _DRAWN), 1)
        between = [self.arc.place_at(self.arc.half_tangent(until * k / pieces)) for k in range(1, pieces)]
        return [first, *between, (last.x, last.y)]

    def moved(self, time: float) -> tuple[float, float, float]:
        """Real motion by a simulated time: degrees turned, inches ahead and to the left."""
        seconds = max(min(time, self.end_time) - self.start_time, 0.0)
        if seconds == math.inf:
            return 0.0, 0.0, 0.0
        ahead, aside = self.arc.own_velocity
        return (self.arc.rate + self.arc.spin) * seconds, ahead * seconds, aside * seconds

    def as_movement(self) -> Trajectory:
        """The leg as a movement of one segment, for code that needs a movement: it turns, then goes straight
        to where the leg ends."""
        asked, pose = self.commanded, self.last_pose
        turned, ahead, aside = self.moved(self.end_time)
        if abs(asked.x) >= abs(asked.y) and asked.x:
            kind = DriveKind.RIGHT if asked.x > 0.0 else DriveKind.LEFT
        elif asked.y:
            kind = DriveKind.UP if asked.y > 0.0 else DriveKind.DOWN
        else:
            kind = DriveKind.ROT
        places = ((self.before.x, self.before.y), (pose.x, pose.y))
        path = Path(self.before.heading, pose.heading - self.before.heading, places)
        totals = Axes(ahead, aside, turned)
        return Trajectory(path, kind, totals, self.start_time, self.duration, self.contact)

    def cut(self, time: float) -> "Leg":
        """The same leg, cut short at a simulated time; before its own end it has no contact."""
        if time >= self.end_time:
            return self
        return replace(self, end_time=time, last_pose=self.pose_at(time), contact=None)
