"""Frozen records of readings and results, shared by engine, log, screen and notebooks."""

from enum import StrEnum

import numpy as np
from msgspec import Struct

from simmer_tui.errors import printable
from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.arrays import BoolArray, FloatArray
from simmer_tui.sim.command import Command
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose as Pose
from simmer_tui.sim.specs import SensorSpec
from simmer_tui.sim.trajectory import Trajectory


class RangeScan(Struct, frozen=True):
    """The rays of one range reading.

    `origin` is the sensor's place (inches, global), `bearings` the directions of the rays (degrees, global)
    and `distances` their lengths (inches; infinite if a ray hit nothing).
    """

    origin: tuple[float, float]
    bearings: tuple[float, ...]
    distances: tuple[float, ...]


class FloorPatch(Struct, frozen=True):
    """The floor below a line sensor: a disc (global, inches), its (n, 2) test points, and True for those on
    black, (n,) bool."""

    centre: tuple[float, float]
    radius: float
    points: FloatArray
    black: BoolArray


class LidarScan(Struct, frozen=True):
    """One whole revolution of a lidar, ray by ray in the order of time, (n,) each.

    `revolution` counts from time 0, -1 is the one before it. `ranges` are the distances that the sensor
    reported (inches; infinite where it missed), `bearings` the directions of the rays in the robot's frame
    (degrees), and `true` the distances from where the robot was at the moment of each ray. `poses` are those
    poses, (n, 3): x and y in inches, heading in degrees. Unknown arrays are empty: `true` of a scan in a log,
    and both of a real robot whose rays differ from the set's.
    """

    revolution: int
    ranges: FloatArray
    bearings: FloatArray
    true: FloatArray
    poses: FloatArray


def ray_bearings(like: FloatArray, count: int) -> FloatArray:
    """The directions of `count` rays, degrees, evenly spaced in the same sense of rotation as `like`."""
    if len(like) == count:
        return like
    turn = -360.0 if len(like) < 2 or like[1] < like[0] else 360.0
    bearings: FloatArray = like[0] + turn * np.arange(count) / count
    return bearings


class Reading(Struct, frozen=True):
    """One reading of one sensor.

    `true` is the value of a perfect sensor (for ir the fraction of test points it reacts to), `value` the
    value that was read. `view` is the geometry of the reading, if there is any.
    """

    sensor: SensorSpec
    value: float
    true: float
    view: RangeScan | FloorPatch | None = None
    took: float = 0.0
    """Seconds of simulated time from the measurement to the answer: the sensor's Read Time."""
    scan: LidarScan | None = None
    """The rays, if the reading is a whole scan; `value` is then the one number that tables and panels
    show."""


class Grip(Struct, frozen=True):
    """An action of the gripper: its simulated time, `closed` (False if it opened), `holding` after it, and
    where the block then is: x, y (inches) and heading, global.

    `missed` is set if it closed without the block. It is the distance of the block's centre from the window,
    inches in the robot's frame: beyond it (negative: too near), and to the left (negative: to the right).
    Both are 0 for jaws that were closed already.
    """

    time: float
    closed: bool
    holding: bool
    block: Pose
    missed: tuple[float, float] | None = None


class VelocityChange(Struct, frozen=True):
    """A velocity that a command set, in/s and deg/s in the robot's frame, with the simulated time at which it
    ends by itself (infinite: never). `changed` is False if it was already in force. `slip` is the rim speed
    of each wheel that slips, in/s. `times_out` is True if it ends only because it is not sent again.
    `limited` is the share of the request that the robot can do."""

    twist: Twist
    expires: float
    changed: bool
    slip: tuple[float, ...] = ()
    times_out: bool = False
    limited: float = 1.0


class Status(StrEnum):
    """Outcome of a command, in a word."""

    READING = "reading"
    DONE = "done"
    ACCEPTED = "accepted"
    BUSY = "busy"
    STOPPED = "stopped"
    UNKNOWN = "unknown"
    """No such code, or a disabled one."""
    REFUSED = "refused"
    """Malformed: empty, cut short, or with a value that is not a finite number."""
    UNANSWERED = "unanswered"
    """A real robot did not answer, or a team's own device failed."""


REFUSALS = (Status.REFUSED, Status.UNKNOWN, Status.BUSY, Status.UNANSWERED)
"""Statuses of commands that do nothing, or that a real robot does not answer."""
TOO_MANY_WAIT = "too many commands of its sender wait already"
"""The reason of a command that was `BUSY` without being looked at, whatever the robot was doing."""


# Without garbage collection (gc=False): results hold no cycles, and many thousands may wait.
class CommandResult(Struct, frozen=True, gc=False):
    """The result of one command: everything needed to log it, draw it or answer it.

    `number` counts commands from 1, `time` is the simulated time of the reply, `reply` the number on the wire
    (infinity for a movement, NaN for a refusal, which `reason` explains). `before` and `pose` are the robot's
    pose before and after; of a movement that has only been accepted both are the pose it begins at.
    `trajectory` is the movement as it really went, once it is done.
    """

    number: int
    time: float
    command: Command
    status: Status
    reply: float
    before: Pose
    pose: Pose
    reason: str = ""
    reading: Reading | None = None
    trajectory: Trajectory | None = None
    grip: Grip | None = None
    """The gripper's action, if the command was for it; the robot stands still meanwhile."""
    taken: float | None = None
    """Simulated time at which the command began; None means `time`."""
    link: float = 0.0
    """Simulated seconds that command and reply spent on the link."""
    velocity: VelocityChange | None = None
    """The velocity that the command set, if it was for continuous motion."""
    waits: float = 0.0
    """Seconds of simulated time that the command itself waits, as planned."""

    @property
    def is_early(self) -> bool:
        """True if it was refused because the robot was still moving: in packets, programs ask until it has
        stopped."""
        return self.status is Status.BUSY and self.reason != TOO_MANY_WAIT

    @property
    def ranges(self) -> FloatArray | None:
        """The ranges of the reply, inches, if a whole scan was requested, else None. The reply to one ray, as
        in `sc-90`, is one number."""
        reading = self.reading
        return None if reading is None or reading.scan is None else reading.scan.ranges

    @property
    def duration(self) -> float:
        """Seconds of simulated time that the command takes, as planned: a reading its Read Time, a
        movement its whole length, a wait its own; 0 for what is answered at once."""
        if self.reading is not None:
            return self.reading.took
        return self.trajectory.duration if self.trajectory is not None else self.waits

    @property
    def contact(self) -> Contact | None:
        """The first contact of the movement, if there was one; `Contact.ended` is True if it ended the
        movement."""
        return self.trajectory.contact if self.trajectory is not None else None

    def __repr__(self) -> str:
        """One line, for notebooks: the fields have their own, longer ones."""
        where = f"({self.pose.x:.2f}, {self.pose.y:.2f}, {self.pose.heading:.1f} deg)"
        return (
            f"<CommandResult {self.number}: {printable(self.command.shown)[:40]} {self.status.value} "
            f"{self.reply:g} at {where}, {self.time:.2f} s>"
        )
