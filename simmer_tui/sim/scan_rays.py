"""The rays of a scan in the maze's frame, and the nearest and farthest echo of a scan."""

import numpy as np
from msgspec import Struct

from simmer_tui.sim.arrays import BoolArray, FloatArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import LidarScan
from simmer_tui.sim.specs import SensorSpec


class ScanRays(Struct, frozen=True, eq=False):
    """Rays of a scan that had an echo, in the maze's frame: their origins, (n, 2) inches, their directions as
    unit vectors, (n, 2), and the ranges that the sensor reported, (n,) inches."""

    origins: FloatArray
    directions: FloatArray
    ranges: FloatArray

    @property
    def ends(self) -> FloatArray:
        """Places at which the beams ended, (n, 2) inches."""
        return self.origins + self.ranges[:, None] * self.directions


class ScanExtremes(Struct, frozen=True):
    """Least and greatest range of a scan, inches, each with its direction in the robot's frame, degrees; None
    without any echo. `missed` counts the rays that had none."""

    nearest: tuple[float, float] | None
    farthest: tuple[float, float] | None
    missed: int


def rays_of(scan: LidarScan, sensor: SensorSpec, pose: Pose) -> ScanRays:
    """Rays of a scan that a sensor read. If their origins are not known, all are taken as sent from
    `pose`."""
    echo = has_echo(scan)
    from_here = np.array([(pose.x, pose.y, pose.heading)])
    poses = scan.poses[echo] if len(scan.poses) else np.repeat(from_here, int(echo.sum()), axis=0)
    # For pictures, many a second: the last bit of numpy's own functions does not show.
    headings = np.radians(poses[:, 2])
    cos, sin = np.cos(headings), np.sin(headings)
    x = poses[:, 0] + cos * sensor.x - sin * sensor.y
    y = poses[:, 1] + sin * sensor.x + cos * sensor.y
    angles = headings + np.radians(scan.bearings[echo])
    directions = np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    return ScanRays(np.stack((x, y), axis=-1), directions, scan.ranges[echo])


def has_echo(scan: LidarScan) -> BoolArray:
    """True for rays that met something, (n,)."""
    # Some lidars report 0 for a miss; none measures a range that short.
    return np.isfinite(scan.ranges) & (scan.ranges > 0.0)


def extremes(scan: LidarScan) -> ScanExtremes:
    """Nearest and farthest echo of a scan."""
    rays = np.flatnonzero(has_echo(scan))
    missed = len(scan.ranges) - len(rays)
    if not len(rays):
        return ScanExtremes(None, None, missed)
    near, far = rays[scan.ranges[rays].argmin()], rays[scan.ranges[rays].argmax()]
    return ScanExtremes(
        (float(scan.ranges[near]), float(scan.bearings[near])),
        (float(scan.ranges[far]), float(scan.bearings[far])),
        missed,
    )
