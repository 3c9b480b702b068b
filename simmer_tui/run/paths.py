"""Paths of a run's movements for reports and players, time by cell, and the true values of sensors on the
way.

Range, line and compass sensors have their true value in the log. Odometers and gyros do not: their
errors accumulate in it. Their true values are computed from the robot's true path, so wheels that slip
against a wall show as error.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import pairwise

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.run.belief_grid import SmallMap, small_map
from simmer_tui.run.events import ActionDone, Belief
from simmer_tui.run.scan_traces import ScanTrace, scan_trace
from simmer_tui.run.table import LISTED, First, Newest, Thinned
from simmer_tui.sim.command import Command
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import LidarScan, Reading
from simmer_tui.sim.sensors import CountingSensor, modelled_sensor
from simmer_tui.sim.specs import CELL_SIZE, MazeSpec, SensorSpec
from simmer_tui.sim.trajectory import Trajectory

SEGMENTS = 8000
"""Most movements drawn: a page with more than that takes seconds to show."""
MOVEMENTS = 3000
MOST_BELIEFS = 2000
"""Most of each that a player shows."""
# As many as a player has readings, since each scan is one.
MOST_SCANS = 15_000
"""Most scans, the newest."""
PARTICLES_SHOWN = 30_000
"""About the most particles of all beliefs together: each belief has fewer, so that none goes without."""
CLOUD = 250
"""Most particles of one belief."""
STRAIGHT = 0.02
"""Inches; a path within this of a straight line is drawn as one: a twentieth of a point."""
_PIECE = 1.0
"""About the length, inches, of the pieces of a path that each count for one cell: judged fine enough for
cells of 12 in."""
PathPoint = tuple[float, float]


class PathSegment(Struct, frozen=True):
    """One movement as drawn: its time (elapsed seconds), and the centres on its path."""

    begin: float
    end: float
    points: Sequence[PathPoint]


class MovementPath(Struct, frozen=True):
    """A movement till a simulated time; `zero` plus a simulated time is elapsed time."""

    zero: float
    text: str
    trajectory: Trajectory | Leg
    until: float

    @property
    def elapsed(self) -> float:
        return self.zero + self.trajectory.start_time

    @property
    def segment(self) -> PathSegment:
        """The movement as drawn."""
        return PathSegment(
            self.elapsed, self.zero + self.until, _simplified(self.trajectory.centres(self.until))
        )


class Jump(Struct, frozen=True):
    """A teleport or restart, between two poses."""

    elapsed: float
    name: str
    begin: Pose
    end: Pose


class BeliefCloud(Struct, frozen=True):
    """A belief and some of its particles, or a small map of its grid, None if the log has left its cells
    out."""

    elapsed: float
    belief: Belief
    particles: tuple[tuple[float, ...], ...]
    heat: SmallMap | None = None


class PathRecord:
    """Follows the robot. With `recorded` it keeps the newest movements and beliefs, for a player."""

    def __init__(self, maze: MazeSpec, pose: Pose, *, recorded: bool) -> None:
        self.cells: defaultdict[tuple[int, int], float] = defaultdict(float)
        """Simulated seconds by cell: row from the top and column from the left, from 1."""
        self._drawn: Thinned[MovementPath] = Thinned(SEGMENTS)
        self.jumps: First[Jump] = First(LISTED)
        self.start = pose
        self.moves: Newest[MovementPath | Jump] = Newest(MOVEMENTS)
        self.beliefs: Newest[BeliefCloud] = Newest(MOST_BELIEFS)
        self.scans: Newest[ScanTrace] = Newest(MOST_SCANS)
        self.one_particle_in = 1
        """So many; more than that find no room."""
        self.under_way: MovementPath | None = None
        self._recorded = recorded
        self._particles = 0
        self._scanned: dict[str, LidarScan] = {}
        """The newest scan of each lidar since the robot was put where it is."""
        self._maze = maze
        self._columns, self._rows = maze.columns, maze.rows
        self._stood_since = 0.0
        self._standing_in = self._cell(pose.x, pose.y)

    # -- events ----------------------------------------------------------------------------------

    def plan(self, zero: float, command: Command, trajectory: Trajectory | Leg) -> None:
        if self._recorded:
            self.under_way = MovementPath(zero, command.shown, trajectory, trajectory.end_time)

    def move(
        self,
        zero: float,
        command: Command,
        trajectory: Trajectory | Leg,
        until: float,
        pose: Pose,
        arrival: float,
    ) -> None:
        """Add a movement till a simulated time, to `pose`, where it arrived at another."""
        begin = trajectory.start_time
        self.under_way = None
        self.stand(zero + begin)
        here, there = self._standing_in, self._cell(pose.x, pose.y)
        # Centres of a path are the expensive part.
        if here == there:
            self.cells[here] += arrival - begin
        else:
            self._pass_time(trajectory.centres(until), arrival - begin)
        drawn = self._drawn.wanted()
        if drawn or self._recorded:
            path = MovementPath(zero, command.shown, trajectory, until)
            if drawn:
                self._drawn.keep((path,))
            if self._recorded:
                self.moves.add(path)
        self._standing_in = there
        self._stood_since = zero + arrival

    def jump(self, elapsed: float, done: ActionDone, before: Pose) -> None:
        self.stand(elapsed)
        jump = Jump(elapsed, done.action.name.value, before, done.pose)
        self.jumps.add(jump)
        if self._recorded:
            self.moves.add(jump)
            for code in self._scanned:
                self.scans.add(ScanTrace(elapsed, code))
            self._scanned.clear()
        self._standing_in = self._cell(done.pose.x, done.pose.y)

    def stand(self, until: float) -> None:
        """Add a stretch till then in which the robot stood still."""
        if until > self._stood_since:
            self.cells[self._standing_in] += until - self._stood_since
            self._stood_since = until

    def scan(self, zero: float, elapsed: float, taken: float, reading: Reading) -> None:
        """Add a whole scan of a lidar, taken and answered at elapsed times. `zero` plus a simulated time is
        elapsed time."""
        scan, code = reading.scan, reading.sensor.code
        # A program may ask ten times for the same revolution.
        if scan is None or not self._recorded or self._scanned.get(code) is scan:
            return
        self._scanned[code] = scan
        self.scans.add(scan_trace(zero, elapsed, taken, reading, scan, self._maze))

    def believe(self, elapsed: float, belief: Belief) -> None:
        pose = belief.pose
        if not (self._recorded and all(map(math.isfinite, (pose.x, pose.y, pose.heading)))):
            return
        belief, heat = self._mapped(belief)
        self.beliefs.add(BeliefCloud(elapsed, belief, cloud(belief)[:: self.one_particle_in], heat))
        self._particles += len(self.beliefs.items[-1].particles)
        # Half of every belief rather than the oldest beliefs whole: the player shows all moments alike.
        if self._particles > PARTICLES_SHOWN:
            self.one_particle_in *= 2
            items = self.beliefs.items
            for place, each in enumerate(items):
                items[place] = replace(each, particles=each.particles[::2])
            self._particles = sum(len(each.particles) for each in items)

    def believe_again(self, belief: Belief) -> None:
        """Give the newest belief the cells that the log had left out."""
        if self._recorded and self.beliefs.items:
            newest = self.beliefs.items[-1]
            self.beliefs.items[-1] = replace(newest, heat=self._mapped(belief)[1])

    def _mapped(self, belief: Belief) -> tuple[Belief, SmallMap | None]:
        """A belief without the cells of its grid, two thousand of which would be 130 MB, and their map."""
        grid = belief.grid
        if grid is None or not grid.cells:
            return belief, None
        return replace(belief, grid=replace(grid, cells=b"")), small_map(grid, self._maze)

    @property
    def segments(self) -> list[PathSegment]:
        """The movements as drawn, evenly chosen."""
        return [path.segment for path in self._drawn.items]

    # -- time by cell ----------------------------------------------------------------------------

    def _pass_time(self, points: Sequence[PathPoint], seconds: float) -> None:
        """Share out a movement's time among the cells it went through."""
        cells, cell_at = self.cells, self._cell
        # All segments but the last have one length, often a part of an inch.
        each = math.dist(points[0], points[1])
        if 0.0 < each < _PIECE:
            points = [*points[: -1 : int(_PIECE / each)], points[-1]]
        lengths = list(map(math.dist, points, points[1:]))
        total = math.fsum(lengths)
        if total == 0.0:
            cells[cell_at(*points[0])] += seconds
            return
        for (a, b), length in zip(pairwise(points), lengths, strict=True):
            steps = max(math.ceil(length / _PIECE), 1)
            share = seconds * length / total / steps
            for step in range(steps):
                fraction = (step + 0.5) / steps
                at = cell_at(a[0] + fraction * (b[0] - a[0]), a[1] + fraction * (b[1] - a[1]))
                cells[at] += share

    def _cell(self, x: float, y: float) -> tuple[int, int]:
        column, row = int(x // CELL_SIZE), int(y // CELL_SIZE)
        # A robot beside the maze counts for the nearest cell: the report lists cells of the maze only.
        if not (0 <= column < self._columns and 0 <= row < self._rows):
            column, row = min(max(column, 0), self._columns - 1), min(max(row, 0), self._rows - 1)
        return self._rows - row, column + 1


def cloud(belief: Belief) -> tuple[tuple[float, ...], ...]:
    """The particles of a belief, at most `CLOUD`, evenly chosen; those without a place are left out."""
    particles = belief.particles
    step = max(1, math.ceil(len(particles) / CLOUD))
    return tuple(each for each in particles[::step] if math.isfinite(each[0]) and math.isfinite(each[1]))


def _simplified(points: Sequence[PathPoint]) -> Sequence[PathPoint]:
    """A path without the points that do not show: all within `STRAIGHT` of the straight line."""
    if len(points) < 3:
        return points
    (x, y), (end_x, end_y) = points[0], points[-1]
    length = math.hypot(end_x - x, end_y - y)
    if length == 0.0:
        far = max(math.dist(points[0], point) for point in points)
    else:
        far = max(abs((px - x) * (end_y - y) - (py - y) * (end_x - x)) / length for px, py in points)
    return points if far > STRAIGHT else (points[0], points[-1])


class Truth:
    """Sums up a run's true path, and gives the errors of readings on it.

    `known` is false while the counters' initial values are not known: in a log that began mid-run.
    """

    def __init__(self, sensors: Iterable[SensorSpec], known: bool) -> None:
        self.known = known
        modelled = {sensor.code: modelled_sensor(sensor) for sensor in sensors}
        self._counters = {code: each for code, each in modelled.items() if isinstance(each, CountingSensor)}
        self.observed = {code: each.error for code, each in modelled.items() if code not in self._counters}
        """By code, the error of a sensor whose true value is in the log, of a true value and a reply."""
        self._moved = (0.0, 0.0, 0.0)
        """Sums of the robot's motions: degrees turned, inches ahead and to the left."""

    def restart(self) -> None:
        """Set all counters to 0."""
        self.known = True
        self._moved = (0.0, 0.0, 0.0)

    def move(self, turned: float, ahead: float, aside: float) -> None:
        """Add a motion: degrees turned, inches ahead and to the left in its own frame."""
        before = self._moved
        self._moved = (before[0] + turned, before[1] + ahead, before[2] + aside)

    def count_error(self, reading: Reading, under_way: Trajectory | Leg | None, time: float) -> float | None:
        """Error of a count at a simulated time, in the sensor's unit; None if it is not known, or of another
        sensor. `under_way` is the movement at that time."""
        counter = self._counters.get(reading.sensor.code)
        if counter is None or not self.known:
            return None
        # Counts are linear in the motion.
        true = counter.counted_on(*self._moved)
        if under_way is not None:
            true += counter.counted_on(*under_way.moved(time))
        return counter.error(true, reading.value)
