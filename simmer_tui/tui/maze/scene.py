"""Scene: all data of a frame of the maze view, as frozen values, and its making from a snapshot.

Units are inches and degrees, the global frame (origin at the maze's bottom-left corner, +Y up) unless a
docstring says otherwise.
"""

import math
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from simmer_tui.live.operating.switches import SHOWN
from simmer_tui.live.route import TOLERANCE, Route, simplified
from simmer_tui.live.snapshot import Snapshot
from simmer_tui.run.state import SensorRow, State
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.arrays import FloatArray, NDArray
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.scan_rays import ScanRays, rays_of
from simmer_tui.sim.sensors import ObservingSensor, View, World, modelled_sensor
from simmer_tui.sim.specs import BLOCK, CELL_SIZE, TILES_PER_CELL, MazeSpec, RobotSpec, SimulationSpec
from simmer_tui.tui.maze.glyphs import Mask
from simmer_tui.tui.maze.heat import HeatMark

MazePoint = tuple[float, float]
# A program that follows a line reads its sensors far more often; one that reads rarely causes no flicker.
LOUD_SECONDS = 10.0
"""Time after a line sensor's reading during which the floor keeps its contrast, seconds."""
# The time in which people remember what they saw; about five movements.
RECENT = 10.0
"""Simulated seconds of the trail that are brighter."""
# More would hide the floor; the report has all of them.
MOST_CONTACTS = 50
"""Earlier contacts that are marked."""


class FloorMode(StrEnum):
    """Ways to show the floor: tiles differ always, never, or when a line sensor is used."""

    AUTO = "auto"
    QUIET = "quiet"
    LOUD = "loud"


class SensorView(Struct, frozen=True, eq=False):
    """Geometry of one sensor's latest reading; `sensor` is its code, `reading` the range that it gave,
    inches, infinite without an echo, None for what its view says."""

    view: View
    sensor: str = ""
    reading: float | None = None


# A program reads again after each of its movements; below these a reading still holds (the errors of ranges
# are about as large).
_MOVED, _TURNED = 1.0, 5.0
"""Inches and degrees from the pose of a reading beyond which it is old."""


class BeliefMark(Struct, frozen=True, eq=False):
    """Pose at which a program believes the robot is.

    `spread` is a radius of uncertainty (inches), `particles` an (n, 2) array of places. `headed` is false for
    a grid without headings.
    """

    pose: Pose
    spread: float | None = None
    particles: FloatArray | None = None
    headed: bool = True


class Scene(Struct, frozen=True, kw_only=True, eq=False):
    """Content of one frame.

    Arrays are not copied: whoever makes a scene must not change them afterwards. A maze and floor
    that are the same objects from scene to scene are drawn once and reused.

    Attributes:
        floor: tiles, (4 * maze rows, 4 * maze columns) uint8, the first row on top, 0 black, 1 white.
        trail: centres of the robot since the start of the run in pieces, (n, 2 or more) each, oldest first;
            all but the last two never change.
        recent: the same of the last seconds; its pieces may be parts of others.
        views: in the order in which they were read. The last is drawn brightly, and so is the one
            of the sensor with the code `chosen`.
        views_are_old: true if the robot has left their pose; then the last is as faint as the others.
        scans: newest scan of each lidar. `scan_is_newest` is true if one was read after all views.
        contact: last place where the robot touched something.
        past_contacts: places where it touched something before that, oldest first.
        heat: grid that the program believes with.
        has_readings: true if a sensor has been read; a movement makes their views old.
        line_age: seconds since a line sensor was read, None for never.
        loading_zone: middles of its cells, None for those that the maze marks.
        drop_zone: middle of its cell.
        shown: names of the switches that are on.
    """

    maze: MazeSpec
    floor: NDArray[np.uint8]
    robot: RobotSpec
    pose: Pose
    block_centre: MazePoint | None = None
    block_size: float = 3.0
    block_heading: float = 0.0
    block_held: bool = False
    trail: tuple[FloatArray, ...] = ()
    recent: tuple[FloatArray, ...] = ()
    views: tuple[SensorView, ...] = ()
    views_are_old: bool = False
    scans: tuple[ScanRays, ...] = ()
    scan_is_newest: bool = False
    chosen: str = ""
    contact: MazePoint | None = None
    past_contacts: tuple[MazePoint, ...] = ()
    belief: BeliefMark | None = None
    heat: HeatMark | None = None
    line_age: float | None = None
    has_readings: bool = False
    loading_zone: tuple[MazePoint, ...] | None = None
    drop_zone: MazePoint | None = None
    shown: frozenset[str] = SHOWN

    def __post_init__(self) -> None:
        expected = (self.maze.rows * TILES_PER_CELL, self.maze.columns * TILES_PER_CELL)
        if self.floor.shape != expected:
            raise ValueError(f"the floor has shape {self.floor.shape}, this maze needs {expected}")

    def is_loud(self, mode: FloorMode) -> bool:
        """True if black and white tiles are to differ clearly."""
        if mode is FloorMode.AUTO:
            return self.line_age is not None and self.line_age <= LOUD_SECONDS
        return mode is FloorMode.LOUD

    def is_bright(self, view: SensorView) -> bool:
        """True for the view that was read last, while it holds, and for that of the chosen sensor."""
        is_newest = view is self.views[-1] and not (self.scan_is_newest or self.views_are_old)
        return is_newest or view.sensor == self.chosen != ""


class Zones(NamedTuple):
    """True for the maze's cells in each zone, (maze rows, maze columns), the first row on top."""

    loading: Mask
    drop: Mask


def zones_of(scene: Scene) -> Zones:
    """Cells of the maze that belong to a zone."""
    maze = scene.maze
    zones = Zones(np.array(maze.cells) == BLOCK, np.zeros((maze.rows, maze.columns), dtype=np.bool_))
    if scene.loading_zone is not None:
        zones.loading[:] = False
    drop = () if scene.drop_zone is None else (scene.drop_zone,)
    for cells, places in zip(zones, (scene.loading_zone or (), drop), strict=True):
        for x, y in places:
            row, column = maze.rows - 1 - int(y // CELL_SIZE), int(x // CELL_SIZE)
            if 0 <= row < maze.rows and 0 <= column < maze.columns:
                cells[row, column] = True
    return zones


def has_left(pose: Pose, now: Pose) -> bool:
    """True once the robot is so far from the pose of a reading that the reading is old."""
    turned = abs(half_turn(now.heading - pose.heading))
    return turned > _TURNED or math.hypot(now.x - pose.x, now.y - pose.y) > _MOVED


# -- from a snapshot -------------------------------------------------------------------------------


def scene_of(
    spec: SimulationSpec,
    maze: Maze,
    snapshot: Snapshot,
    *,
    shown: frozenset[str] = SHOWN,
    chosen: str = "",
) -> Scene:
    """The scene of a snapshot, with the views read since the robot moved; while it moves, those read before.

    The view of the `chosen` sensor stands out. Scans stay until the next one: their dots show the walls,
    wherever the robot is by now.
    """
    state = snapshot.state
    rows = sorted(state.sensors.values(), key=lambda row: row.number)
    fresh = (row for row in rows if row.reading.scan is None and _is_fresh(row, state))
    touched = _touched(state)
    route = snapshot.route
    if state.moving:
        route = Route((*route.pieces, simplified(state.path, TOLERANCE)))
    block, zones = state.block, snapshot.mission.plan if snapshot.mission is not None else None
    return Scene(
        maze=spec.maze,
        floor=maze.tiles,
        robot=spec.robot,
        pose=state.pose,
        block_centre=(block.x, block.y) if block.size else None,
        block_size=block.size,
        block_heading=block.heading,
        block_held=state.holding,
        trail=route.pieces,
        recent=tuple(route.since(state.time - RECENT)),
        views=tuple(filter(None, (_view(row, maze) for row in fresh))),
        views_are_old=bool(rows) and has_left(rows[-1].pose, state.pose),
        scans=tuple(filter(None, map(_scan_rays, rows))),
        scan_is_newest=bool(rows) and rows[-1].reading.scan is not None,
        contact=touched[-1] if touched else None,
        past_contacts=touched[-1 - MOST_CONTACTS : -1],
        belief=_belief_mark(state),
        heat=_heat_mark(state),
        line_age=_line_age(state),
        has_readings=bool(rows),
        loading_zone=tuple((cell.x, cell.y) for cell in zones.loading_zone) if zones is not None else None,
        drop_zone=(zones.drop_zone.x, zones.drop_zone.y) if zones is not None else None,
        shown=shown,
        chosen=chosen,
    )


def _scan_rays(row: SensorRow) -> ScanRays | None:
    scan = row.reading.scan
    return None if scan is None else rays_of(scan, row.reading.sensor, row.pose)


def _touched(state: State) -> tuple[MazePoint, ...]:
    """Places of contacts, oldest first, with that of a movement under way."""
    points, now = state.contact_points, state.contact
    if now is None or (points and points[-1] == now.point):
        return points
    return (*points, now.point)


def _belief_mark(state: State) -> BeliefMark | None:
    belief = state.belief
    if belief is None:
        return None
    # Particles may have headings, which are not drawn.
    particles = np.array([particle[:2] for particle in belief.particles]) if belief.particles else None
    if belief.grid is None:
        return BeliefMark(belief.pose, belief.spread, particles)
    # The map shows the place and its uncertainty; a circle would show it for one peak only.
    return BeliefMark(belief.pose, None, particles, belief.grid.has_headings)


def _heat_mark(state: State) -> HeatMark | None:
    belief = state.belief
    if belief is None or belief.grid is None or not belief.grid.cells:
        return None
    return HeatMark(belief.grid, belief.time, not state.moving)


def _is_fresh(row: SensorRow, state: State) -> bool:
    """True if a reading was taken at the robot's place or, while it moves, at the movement's start."""
    if row.number > state.moved:
        return True
    if not state.moving or not len(state.path):
        return False
    x, y = state.path[0, :2].tolist()
    return (row.pose.x, row.pose.y) == (x, y)


def _view(row: SensorRow, maze: Maze) -> SensorView | None:
    """The view of a reading. A log does not contain it, since it follows from the robot's pose."""
    reading, view = row.reading, row.reading.view
    if view is None:
        sensor = modelled_sensor(reading.sensor)
        if isinstance(sensor, ObservingSensor):
            view = sensor.observe(World(maze, row.block), row.pose)[1]
    if view is None:
        return None
    return SensorView(view, reading.sensor.code, reading.value if reading.sensor.kind.is_range else None)


def _line_age(state: State) -> float | None:
    """Simulated seconds since a line sensor was read; None for never."""
    read = [row.time for row in state.sensors.values() if row.reading.sensor.kind.detects_floor]
    return state.time - max(read) if read else None
