"""Scans of lidars that were bent, since the robot moved while they were taken.

A program that treats a scan as taken at one moment has the error of its rays. A ray's error is the true
distance from the robot's place at its moment, less that at the end of the scan.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct, field

from simmer_tui.document.formats import COUNT, SHARE, number
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.recent_motion import BlockPlace
from simmer_tui.sim.records import LidarScan
from simmer_tui.sim.sensors import Lidar, sensor_of
from simmer_tui.sim.specs import SensorSpec

# Programs of the course want a belief to within an inch from a scan.
_OFF = 1.0
"""Inches from which a ray counts as off."""
# A scan takes 2 x 0.5 ms: without the limit the report of an hour's run would take ten seconds for them.
MOST_MEASURED = 2000
"""Scans of a run that are measured: the first ones in which the robot moved."""

SCANS = data_table(
    "scans",
    "Scans taken in motion",
    DataColumn("sensor"),
    DataColumn("scans", COUNT),
    DataColumn("moved", COUNT, "in motion"),
    DataColumn("rays_off", SHARE, "rays off by over 1 in"),
    DataColumn("rms_in", number(".2f"), "rms"),
    DataColumn("worst_in", number(".1f"), "worst"),
)


class _Bends(Struct):
    """Scans of one lidar: how many, how many in motion, and the errors of the rays of each that was measured,
    inches."""

    title: str
    scans: int = 0
    moved: int = 0
    errors: list[FloatArray] = field(default_factory=list)
    last: LidarScan | None = None


class BentScans:
    """Measures the errors of a run's bent scans, in the order in which they were read."""

    def __init__(self, maze: Maze) -> None:
        self._maze = maze
        self.found: dict[str, _Bends] = {}
        """The scans by sensor ID."""

    def add(self, spec: SensorSpec, scan: LidarScan, block: BlockPlace) -> None:
        """Add a scan of a lidar, with the block's place then."""
        bends = self.found.setdefault(spec.id, _Bends(f"{spec.code} {spec.id}"))
        # The same revolution may be read many times.
        if bends.last is scan:
            return
        bends.last = scan
        bends.scans += 1
        poses = scan.poses
        if (poses == poses[-1:]).all():
            return
        bends.moved += 1
        lidar = sensor_of(spec)
        if len(bends.errors) >= MOST_MEASURED or not isinstance(lidar, Lidar):
            return
        at_end = np.tile(poses[-1], (len(poses), 1))
        here = [(slice(None), block)]
        off = lidar.distances(self._maze, poses, here) - lidar.distances(self._maze, at_end, here)
        # Where one of the two meets nothing, there is no difference of distances.
        bends.errors.append(np.abs(off[np.isfinite(off)]))


def scans_table(bent: BentScans) -> DataTable:
    """The scans of each lidar, and the errors of those in which the robot moved."""
    rows: list[tuple[object, ...]] = []
    for _, each in sorted(bent.found.items()):
        off: tuple[float | None, ...] = (None, None, None)
        errors = np.concatenate(each.errors or [np.empty(0)])
        if len(errors):
            off = float((errors > _OFF).mean()), math.sqrt(np.square(errors).mean()), float(errors.max())
        rows.append((each.title, each.scans, each.moved, *off))
    note = (
        "Off: the true distance of a ray at its own moment, less that from where the robot was at the end of "
        "the scan. A program that knows its motion can correct it."
    )
    if any(each.moved > len(each.errors) for each in bent.found.values()):
        note += f" The first {MOST_MEASURED:,} scans in motion of a lidar are measured."
    return SCANS.filled(rows, note)
