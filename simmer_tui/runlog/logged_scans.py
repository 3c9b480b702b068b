"""The scans of lidars in a log: their ranges, as whole steps of the sensor's resolution, in base64.

A log has the ranges alone. The directions of the rays follow from the sensor, and their origins from the
movements before them.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable

import numpy as np

from simmer_tui.errors import RunLogError
from simmer_tui.links.protocol.replies import MOST_RANGES
from simmer_tui.runlog.log_records import ReadingRecord
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.recent_motion import Motion, RecentMotion
from simmer_tui.sim.records import LidarScan, ray_bearings
from simmer_tui.sim.sensors import Lidar, sensor_of
from simmer_tui.sim.specs import SensorSpec

# The largest number of two bytes: with steps of 0.01 in the others reach 655 in, beyond any lidar here.
MISSED_RANGE = 65535
"""Stands for a ray that met nothing."""
_ALL_AROUND = np.zeros(1)
"""Directions of a lidar of a team's own kind: from the front, all around."""


def packed_ranges(ranges: FloatArray, resolution: float) -> tuple[str, bool]:
    """Ranges, inches, as base64. The flag is False for whole steps of a resolution in two little-endian bytes
    each. It is True for floats of eight bytes, where some are no whole steps."""
    steps = _whole_steps(ranges, resolution) if resolution else None
    data = ranges.astype("<f8") if steps is None else steps.astype("<u2")
    return base64.b64encode(data.tobytes()).decode("ascii"), steps is None


def unpacked_ranges(text: str, resolution: float, *, floats: bool) -> FloatArray:
    """The ranges, bit for bit. Raises RunLogError for a text that holds none."""
    try:
        data = np.frombuffer(base64.b64decode(text, validate=True), "<f8" if floats else "<u2")
    except ValueError as error:
        raise RunLogError(f"its scan cannot be read: {error}") from None
    if not 1 <= len(data) <= MOST_RANGES:
        raise RunLogError(f"its scan has {len(data)} ranges: it must be 1 to {MOST_RANGES}")
    ranges = data.astype(np.float64) if floats else _ranges_of(data.astype(np.float64), resolution)
    ranges.flags.writeable = False
    return ranges


def _whole_steps(ranges: FloatArray, resolution: float) -> FloatArray | None:
    """The ranges in steps of a resolution; None if these would not give the same numbers again."""
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.rint(ranges / resolution)
    missed = ranges == math.inf
    steps[missed] = MISSED_RANGE
    if not ((steps >= 0) & ((steps < MISSED_RANGE) | missed)).all():
        return None
    # As bytes: -0.0 and 0.0 differ.
    return steps if _ranges_of(steps, resolution).tobytes() == ranges.tobytes() else None


def _ranges_of(steps: FloatArray, resolution: float) -> FloatArray:
    return np.where(steps == MISSED_RANGE, math.inf, steps * resolution)


class LoggedRanges:
    """The ranges of each reading of a lidar in a log, line by line: a scan that was read again is not written
    again."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[int, FloatArray]] = {}

    def forget(self) -> None:
        """Reading begins here: later lines refer to none before."""
        self._last.clear()

    def of(self, record: ReadingRecord, sensor: SensorSpec) -> FloatArray:
        """The ranges, inches, of a record without a reply. Raises RunLogError."""
        revolution = record.revolution
        if revolution is None:
            raise RunLogError("it has neither a reply nor a scan")
        if record.scan:
            ranges = unpacked_ranges(record.scan, sensor.resolution, floats=record.floats)
            self._last[sensor.code] = revolution, ranges
            return ranges
        known = self._last.get(sensor.code)
        if known is None or known[0] != revolution:
            raise RunLogError(f"the scan of revolution {revolution} is not before it")
        return known[1]


class ScanDecoder:
    """Makes the scans of a log's readings. It needs all motion before them; see `went`."""

    def __init__(self, sensors: Iterable[SensorSpec]) -> None:
        found = (sensor_of(each) for each in sensors if each.kind.is_scan)
        self._lidars = {each.spec.code: each for each in found if isinstance(each, Lidar)}
        self._recent = RecentMotion(max((each.looks_back for each in self._lidars.values()), default=0.0))
        self._ranges = LoggedRanges()
        self._last: dict[str, LidarScan] = {}
        """The newest scan of each lidar, by code; it is used again if it is read again."""

    def forget(self, *, all_scans: bool = False) -> None:
        """The robot has been put elsewhere, or the run restarts; with `all_scans` reading begins here."""
        self._recent.forget()
        if all_scans:
            self._ranges.forget()
            self._last.clear()

    def add_motion(self, piece: Motion) -> None:
        """A movement or a leg is over."""
        self._recent.add_motion(piece)

    def scan(
        self, record: ReadingRecord, sensor: SensorSpec, pose: Pose, under_way: Motion | None
    ) -> LidarScan:
        """The scan of a reading, with the robot now at a pose, perhaps in motion. It has no true
        distances. Raises RunLogError."""
        ranges, revolution = self._ranges.of(record, sensor), record.revolution
        assert revolution is not None, "a scan has a revolution"
        last = self._last.get(sensor.code)
        if last is not None and last.ranges is ranges:
            return last
        lidar, poses, bearings = self._lidars.get(sensor.code), np.empty((0, 3)), _ALL_AROUND
        if lidar is not None:
            bearings = lidar.turned_by
        # The times of a real lidar's rays, which may be other ones, are not known.
        if lidar is not None and len(ranges) == lidar.spec.rays:
            poses = self._recent.poses(lidar.moments(revolution), pose, under_way)
        scan = LidarScan(revolution, ranges, ray_bearings(bearings, len(ranges)), np.empty(0), poses)
        self._last[sensor.code] = scan
        return scan
