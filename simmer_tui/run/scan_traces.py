"""Scans as a player keeps them: ranges in two characters each, and when the rays were sent.

A player knows the origin of each ray from the robot's path.
"""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.arrays import BoolArray, FloatArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import LidarScan, Reading
from simmer_tui.sim.scan_rays import has_echo
from simmer_tui.sim.sensors import LidarSpec
from simmer_tui.sim.specs import MazeSpec, SensorSpec

DIGITS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
"""Digits 0 to 63; a range has two."""
# Numbers of two digits: the largest is a ray without an echo, the next the longest range.
_NO_ECHO = 64 * 64 - 1
_LONGEST = _NO_ECHO - 1
# Half a dot of a page that shows a maze of 8 ft.
_FINEST = 0.05
"""Least step of the ranges, inches."""
# One each half degree: on a page more rays would cover one another.
_MOST_RAYS = 720
"""Rays kept of a scan."""
_CODES = np.frombuffer(DIGITS.encode("ascii"), np.uint8)


class ScanTrace(Struct, frozen=True):
    """A scan that was answered at a moment, elapsed seconds. It has the code of its sensor, the time of its
    first ray, and the duration of all rays. The direction of the first ray, in the robot's frame, and the
    step to the next are in degrees; the ranges are text. A trace without rays ends the one before."""

    elapsed: float
    code: str
    begin: float = 0.0
    span: float = 0.0
    first: float = 0.0
    turn: float = 0.0
    ranges: str = ""

    @property
    def rays(self) -> int:
        """Number of its rays."""
        return len(self.ranges) // 2


def range_step(maze: MazeSpec) -> float:
    """Step of the ranges, inches, chosen so that two digits hold the longest ray within the maze."""
    return max(_FINEST, math.hypot(maze.width, maze.height) / _LONGEST)


def scan_trace(
    zero: float, elapsed: float, taken: float, reading: Reading, scan: LidarScan, maze: MazeSpec
) -> ScanTrace:
    """The trace of a scan that was taken and answered at elapsed times; `zero` plus a simulated time is
    elapsed time."""
    stride = math.ceil(len(scan.ranges) / _MOST_RAYS)
    ranges = scan.ranges[::stride]
    begin, span = taken, 0.0
    if isinstance(reading.sensor, LidarSpec) and len(scan.poses):
        turn_time = 1.0 / reading.sensor.scan_rate
        begin = zero + scan.revolution * turn_time
        span = turn_time * len(ranges) * stride / len(scan.ranges)
    if begin < zero:
        # The lidar turned before the run began, while the robot stood.
        begin, span = zero, 0.0
    bearings = scan.bearings
    turn = half_turn(float(bearings[1] - bearings[0])) if len(bearings) > 1 else 0.0
    text = _packed(ranges, has_echo(scan)[::stride], range_step(maze))
    return ScanTrace(elapsed, reading.sensor.code, begin, span, float(bearings[0]), stride * turn, text)


def _packed(ranges: FloatArray, echo: BoolArray, step: float) -> str:
    steps = np.full(len(ranges), _NO_ECHO)
    steps[echo] = np.minimum(np.rint(ranges[echo] / step), _LONGEST)
    digits = _CODES[np.stack((steps // 64, steps % 64), axis=-1)]
    return str(digits.tobytes(), "ascii")


def ray_ends(
    trace: ScanTrace, sensor: SensorSpec, step: float, poses: Sequence[Pose]
) -> list[tuple[float, float]]:
    """Places at which the beams ended, from the poses that they were sent from."""
    ends = []
    for ray, pose in enumerate(poses):
        high, low = (DIGITS.index(each) for each in trace.ranges[2 * ray : 2 * ray + 2])
        steps = 64 * high + low
        if steps == _NO_ECHO:
            continue
        beam = Pose(*pose.place(sensor.x, sensor.y), pose.heading + trace.first + ray * trace.turn)
        ends.append(beam.place(step * steps, 0.0))
    return ends


def ray_times(trace: ScanTrace) -> list[float]:
    """Elapsed times at which its rays were sent."""
    return [trace.begin + trace.span * ray / trace.rays for ray in range(trace.rays)]
