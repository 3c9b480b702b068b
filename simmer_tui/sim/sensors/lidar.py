"""The lidar: a range all around, ray by ray as its head turns.

It always turns, before time 0 too. Ray i of N of revolution m is sent at (m + i / N) / rate, from where the
robot is at that moment: a robot that turns meanwhile gets a bent picture. A reading is the last revolution
that is complete.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import ClassVar

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.sim import columns
from simmer_tui.sim.angles import cos_sin_array
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.command import counted, parse_value
from simmer_tui.sim.maze import Maze, Rays, chosen_rays
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.recent_motion import BlockPlace, Motion, RecentMotion
from simmer_tui.sim.records import LidarScan, RangeScan, Reading
from simmer_tui.sim.sensors.base import Prior, World
from simmer_tui.sim.sensors.range_sensors import RangeSensor, RangeSpec


class LidarSpec(RangeSpec, frozen=True, kw_only=True):
    """One row of sensors.csv for a lidar. The defaults are those of a RPLIDAR A1M8, with their sources in
    docs/lidar.md; `scan_rate` is in revolutions a second."""

    error: float = 0.01
    min_range: float = 5.9
    max_range: float = 472.4
    resolution: float = 0.01
    dropout: float = 0.01
    rays: int = 360
    scan_rate: float = 5.5
    clockwise: bool = True
    missed_as_zero: bool = False
    """True if a ray that met nothing reads 0 and not infinity, as in the RPLIDAR's own software."""

    @property
    def beam(self) -> None:
        """None: it looks all around."""
        return None

    @property
    def view_words(self) -> tuple[str, ...]:
        return (counted(self.rays, "ray"),)


class Lidar(RangeSensor):
    """Distances all around, inches. Where a reading is one number, it is that of the first ray of the turn,
    which points along its Rotation."""

    name = "lidar"
    short_name = "lidar"
    is_scan = True
    meaning = "ranges all around"
    spec_type = LidarSpec
    dialect_functions = ("ray", "scan")
    columns: ClassVar[tuple[CsvColumn, ...]] = (
        *(columns.X, columns.Y, columns.Z, columns.ROTATION),
        replace(columns.ERROR, needed=False),
        *(columns.GAIN, columns.ABSOLUTE_ERROR, columns.BIAS, columns.DRIFT),
        *(columns.MIN_RANGE, columns.MAX_RANGE, columns.RESOLUTION, columns.TURN_RAYS),
        *(columns.VERTICAL_FOV, columns.READ_TIME, columns.DROPOUT, columns.INCIDENCE_LIMIT),
        *(columns.SCAN_RATE, columns.CLOCKWISE, columns.MISSED),
    )
    # Its rays are up to two turns old: calibration has a pose for each reading, not for each ray.
    parameters: ClassVar[tuple[Prior, ...]] = ()
    noise_scales: ClassVar[tuple[Prior, ...]] = ()
    spec: LidarSpec

    def __init__(self, spec: LidarSpec) -> None:
        super().__init__(spec)
        turn = -360.0 if spec.clockwise else 360.0
        self.turned_by: FloatArray = spec.rotation + np.arange(spec.rays) * turn / spec.rays
        """Directions of all rays of a revolution in the robot's frame, degrees, (rays,)."""
        self._parts: FloatArray = np.arange(spec.rays) / spec.rays
        """The part of a revolution that is over at each ray, (rays,)."""

    @property
    def looks_back(self) -> float:
        # The last complete revolution began at most two turns ago.
        return 2.0 / self.spec.scan_rate

    def fan(self) -> FloatArray:
        """Bearing of the first ray, which represents all."""
        return np.zeros(1)

    def combined(self, distances: Sequence[float]) -> float:
        """The one distance, inches."""
        (distance,) = distances
        return distance

    def combined_many(self, fans: FloatArray) -> FloatArray:
        return fans.ravel()

    # -- its turns -----------------------------------------------------------------------------------

    def revolution_at(self, time: float) -> int:
        """The last revolution that is complete at a simulated time; -1 is the one before time 0."""
        return math.floor(time * self.spec.scan_rate) - 1

    def complete_at(self, revolution: int) -> float:
        """The simulated time from which a revolution is complete."""
        time = (revolution + 1) / self.spec.scan_rate
        # The quotient may be rounded to slightly before it.
        while self.revolution_at(time) < revolution:
            time = math.nextafter(time, math.inf)
        return time

    def moments(self, revolution: int) -> FloatArray:
        """The simulated times of the rays of a revolution, (rays,)."""
        return (revolution + self._parts) / self.spec.scan_rate

    def nearest_ray(self, bearing: float) -> int:
        """The ray whose direction is nearest to a bearing, degrees from the robot's front."""
        # Within a turn first: no bearing is too great for what follows.
        turned = math.fmod(bearing, 360.0) - math.fmod(self.spec.rotation, 360.0)
        part = (-turned if self.spec.clockwise else turned) * self.spec.rays / 360.0
        return math.floor(part + 0.5) % self.spec.rays

    # -- its rays ------------------------------------------------------------------------------------

    def origins(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The sensor's places at (n, 3) poses, x and y in inches, (n,) each."""
        spec = self.spec
        if not (spec.x or spec.y):
            return poses[:, 0], poses[:, 1]
        # A robot that stands has one heading for all rays of a revolution.
        still = bool((poses[:, 2] == poses[0, 2]).all())
        cos, sin = cos_sin_array(poses[:1, 2] if still else poses[:, 2])
        return poses[:, 0] + cos * spec.x - sin * spec.y, poses[:, 1] + sin * spec.x + cos * spec.y

    def distances(
        self, maze: Maze, poses: FloatArray, blocks: Iterable[tuple[slice, BlockPlace]]
    ) -> FloatArray:
        """The true distances of the rays of a revolution, (rays,), inches: each from the robot's pose at its
        moment, (rays, 3), and with the block where it was then."""
        x, y = self.origins(poses)
        dx, dy = cos_sin_array(poses[:, 2] + self.turned_by)
        found = np.empty(len(poses))
        for part, place in blocks:
            rays = chosen_rays((x, y, dx, dy), part)
            for some, world in self._worlds(maze, poses[part], place):
                found[part][some] = self._cast(world, chosen_rays(rays, some))
        return found

    def _worlds(self, maze: Maze, poses: FloatArray, place: BlockPlace) -> Iterator[tuple[slice, World]]:
        """The worlds that rays from some poses are cast in, each with the slice of those rays."""
        seen = place.held and self.block_from(place.block.size) < math.inf
        if not seen or bool((poses == poses[0]).all()):
            yield slice(None), World(maze, place.at(Pose(*poses[0].tolist())), held=place.held)
            return
        # The block moves with the robot.
        for ray, pose in enumerate(poses.tolist()):
            yield slice(ray, ray + 1), World(maze, place.at(Pose(*pose)), held=True)

    def _cast(self, world: World, rays: Rays) -> FloatArray:
        """`World.fans` for origins that are near each other, without the echoes that a face does not send."""
        x, y, _, _ = rays
        block_from = self.block_from(world.block.size)
        low, high = (float(x.min()), float(y.min())), (float(x.max()), float(y.max()))
        if world.maze.has_walls(low, high):
            distances = world.fans(rays, block_from)
        else:
            distances = world.maze.cast_free(rays)
            if block_from < math.inf:
                _meet(world.block, rays, distances, block_from)
        return self.echoes(world, rays, distances, block_from) if self.loses_echoes else distances

    def ranges_said(
        self, true: FloatArray, moments: FloatArray, random: np.random.Generator | None
    ) -> FloatArray:
        """The ranges that it reports for true distances, (rays,), at their simulated times. All draws of one
        sort are made together: those of the Percent Error, of the Absolute Error, of the Dropout."""
        spec, rays = self.spec, len(true)
        # A gain may be any number, even one with which nothing is within range.
        with np.errstate(over="ignore", invalid="ignore"):
            said = true if random is None else true * (1.0 + spec.error * random.standard_normal(rays))
            said = said * spec.gain
            if random is not None and spec.absolute_error:
                said += spec.absolute_error * random.standard_normal(rays)
            if spec.bias or spec.drift:
                said += spec.bias + spec.drift * moments
            said = self.limited(said)
        if random is not None and spec.dropout:
            np.putmask(said, random.random(rays) < spec.dropout, math.inf)
        if self.loses_echoes:
            # Without an echo no error makes a range.
            said[np.isinf(true)] = math.inf
        if spec.missed_as_zero:
            said[np.isinf(said)] = 0.0
        return said

    def limited(self, values: FloatArray) -> FloatArray:
        """Ranges within the sensor's limits, rounded to whole steps of its resolution."""
        spec = self.spec
        values = np.maximum(values, spec.min_range)
        if spec.resolution:
            values = np.rint(values / spec.resolution) * spec.resolution
        # NaN is out of range too.
        np.putmask(values, ~(values <= spec.max_range), math.inf)
        return values

    def reported(self, value: float) -> float:
        return float(self.limited(np.array([value]))[0])

    def error(self, true: float, reply: float) -> float:
        missed = self.spec.missed_as_zero and reply == 0.0
        return super().error(true, math.inf if missed else reply)


def _meet(block: Block, rays: Rays, distances: FloatArray, block_from: float) -> None:
    """Shorten the distances of those rays that meet the block from some distance on."""
    x, y, dx, dy = rays
    to_x, to_y = block.x - x, block.y - y
    ahead, aside = to_x * dx + to_y * dy, to_y * dx - to_x * dy
    # Most rays miss it, or end before it: its corners are 0.7072 of a side from its centre.
    reach = 0.71 * block.size
    near = np.flatnonzero((np.abs(aside) <= reach) & (distances >= ahead - reach) & (ahead >= -reach))
    if not len(near):
        return
    to_block = block.cast_many(*chosen_rays(rays, near))
    nearer = (to_block >= block_from) & (to_block < distances[near])
    distances[near[nearer]] = to_block[nearer]


class Now(Struct, frozen=True):
    """The present of a robot: simulated time, its pose, and the piece of motion under way, if any."""

    time: float
    pose: Pose
    under_way: Motion | None


class Turning:
    """A lidar during one run: its last revolution, and the rays of it that have been read."""

    def __init__(self, lidar: Lidar, maze: Maze, recent: RecentMotion) -> None:
        self.lidar = lidar
        self._maze = maze
        self._recent = recent
        self._scan: LidarScan | None = None
        self._blocks: tuple[tuple[slice, BlockPlace], ...] = ()
        """Places of the block at the times of its rays."""
        self._read: set[int | None] = set()
        """The rays of that revolution that have been read one by one; None means the whole scan."""

    def forget(self) -> None:
        """Forget the last revolution, because the robot has been placed elsewhere."""
        self._scan = None
        self._read.clear()

    def waits_until(self, time: float, ray: int | None) -> float:
        """The simulated time of a revolution whose ray, or whole scan (None), has not been read yet: `time`
        itself, or the time when the next one is complete."""
        lidar, scan = self.lidar, self._scan
        if lidar.spec.read_time or scan is None or ray not in self._read:
            return time
        return max(time, lidar.complete_at(scan.revolution + 1))

    def ray(self, argument: str | None) -> int | str | None:
        """The ray that a command requests by a bearing, None for all of them, or the reason for refusal."""
        if argument is None:
            return None
        bearing = parse_value(argument, f"{self.lidar.spec.code}-90")
        if isinstance(bearing, str):
            return bearing
        if not math.isfinite(bearing):
            return f"a bearing of {bearing:g} is no direction"
        return self.lidar.nearest_ray(bearing)

    def reading(self, ray: int | None, now: Now, random: np.random.Generator | None) -> Reading:
        """A reading: of one ray, or of all of them with the scan."""
        scan = self.scan(now, random)
        self._read.add(ray)
        index = ray or 0
        spec = self.lidar.spec
        value, true = float(scan.ranges[index]), float(scan.true[index])
        whole = scan if ray is None else None
        return Reading(spec, value, true, self._view(scan, index), spec.read_time, whole)

    def scan(self, now: Now, random: np.random.Generator | None) -> LidarScan:
        """The last complete revolution. Further requests return the same object."""
        lidar, before = self.lidar, self._scan
        revolution = lidar.revolution_at(now.time)
        if before is not None and before.revolution == revolution:
            return before
        moments = lidar.moments(revolution)
        poses = self._recent.poses(moments, now.pose, now.under_way)
        blocks = tuple(self._recent.blocks(moments))
        if before is not None and blocks == self._blocks and np.array_equal(poses, before.poses):
            # A robot at rest sees the same again.
            true = before.true
        else:
            true = lidar.distances(self._maze, poses, blocks)
        ranges = lidar.ranges_said(true, moments, random)
        self._scan = LidarScan(revolution, ranges, lidar.turned_by, true, poses)
        self._blocks = blocks
        self._read.clear()
        return self._scan

    def _view(self, scan: LidarScan, ray: int) -> RangeScan:
        spec = self.lidar.spec
        pose = Pose(*scan.poses[ray].tolist())
        bearing, true = float(scan.bearings[ray]) + pose.heading, float(scan.true[ray])
        return RangeScan(pose.place(spec.x, spec.y), (bearing,), (true,))
