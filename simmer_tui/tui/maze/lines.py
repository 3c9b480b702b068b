"""Marks drawn in dots: trail, rays and the codes of their sensors, scans, floor spots, beliefs."""

import math
from collections.abc import Sequence
from operator import is_

import numpy as np
from msgspec import Struct

from simmer_tui.sim.arrays import FloatArray, NDArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import FloorPatch
from simmer_tui.sim.scan_rays import ScanRays
from simmer_tui.sim.specs import RobotSpec
from simmer_tui.tui.maze import shapes
from simmer_tui.tui.maze.canvas import Canvas
from simmer_tui.tui.maze.glyphs import Mask, dot_patterns, heading_arrow
from simmer_tui.tui.maze.heat import HeatPeak
from simmer_tui.tui.maze.palette import Role
from simmer_tui.tui.maze.scene import BeliefMark, Scene, SensorView

# Less than a whole dot, so that a slanting line has no gaps.
_STEP_DOTS = 0.9
"""Distance of a line's samples, in dots."""
_STANDSTILL = 0.05
"""Inches of the shortest line."""
# The cones of the bundled sets, 5 degrees, are hardly wider than one ray on a screen.
_WIDE_FAN = 10.0
"""Degrees; a fan at least this wide is shown by its outer rays too."""
# From 6 in on they are clear of the robot, whose rim is 3 in from its centre in the bundled sets.
_NO_ECHO = (6.0, 8.0, 10.0)
"""Places of the dots for a reading without an echo, inches along its direction."""
# At the end of the ray, or, if that is covered, further and further in.
_CODE_AT = (0.97, 0.8, 0.6, 0.45)
"""Places of a sensor's code along its ray, as parts of its length."""
# In a smaller maze cell the codes of all rays would hide the rays.
_CODES_FROM = 12.0
"""Columns a maze cell from which all rays have their code; below only the ray read last."""
_LONGEST_RAY = 1000.0
"""Inches drawn of a ray at most; no maze of ours is longer across."""
# A ray that ends on the border of a cell must have no dot in the next one.
_JUST = 1e-6
"""Inches by which the last dot of a ray is before its end."""
# A dot: a longer step would leave gaps between dots and wall.
_BACK = 0.5
"""Units by which a dot in a wall is moved along its beam at a time."""
# A robot is up to six rows high at 200 x 60, and a cell is twice as high as wide.
_BESIDE = sorted(
    ((down, right) for down in range(-5, 6) for right in range(-12, 13)),
    key=lambda place: (4 * place[0] ** 2 + place[1] ** 2, place),
)
"""Places of a number around its cell, rows and columns, the nearest first."""
# Each of them is sent anew with every belief. So many still show a circle as large as the maze.
_RING_DOTS = 40
"""Most dots of the circle around a belief."""
_TICK = 0.4
"""Length of the mark at the front of a belief, in robot radii."""
_ARROW_AHEAD = 0.6
"""Distance of the arrow on a body ahead of its middle, inches."""


class DrawnRay(Struct, frozen=True, eq=False):
    """A ray on the picture: code of its sensor, direction, and the places of its dots from the sensor on."""

    sensor: str
    is_bright: bool
    places: FloatArray


class TrailDots:
    """Dots of the pieces of a trail that do not change any more, kept from picture to picture."""

    def __init__(self) -> None:
        self._key: object = None
        self._drawn: tuple[FloatArray, ...] = ()
        self._patterns: NDArray[np.uint32] = np.zeros(0, dtype=np.uint32)

    def patterns(self, canvas: Canvas, pieces: tuple[FloatArray, ...]) -> NDArray[np.uint32]:
        """Braille pattern of every cell of the window, (rows * columns,)."""
        key, drawn = canvas.viewport, self._drawn
        grows = len(pieces) >= len(drawn) and all(map(is_, pieces, drawn))
        if key != self._key or not grows:
            self._key, drawn = key, ()
            self._patterns = np.zeros(canvas.rows * canvas.columns, dtype=np.uint32)
        if len(drawn) < len(pieces):
            self._patterns = self._patterns | _line_dots(canvas, pieces[len(drawn) :])
        self._drawn = pieces
        return self._patterns


def draw_trail(canvas: Canvas, scene: Scene, kept: TrailDots) -> None:
    """Draw the whole route as a line, its last seconds brighter."""
    if not scene.trail:
        return
    # The movement under way, and the piece that it will belong to, still grow.
    old = kept.patterns(canvas, scene.trail[:-2]) | _line_dots(canvas, scene.trail[-2:])
    canvas.patterns(Role.TRAIL, old, canvas.backdrop.keeps_wall)
    new = _line_dots(canvas, scene.recent)
    # A cell has one colour; the older dots in it stay.
    canvas.patterns(Role.TRAIL_NEW, np.where(new > 0, new | old, 0), canvas.backdrop.keeps_wall)


def _line_dots(canvas: Canvas, lines: Sequence[FloatArray]) -> NDArray[np.uint32]:
    """Braille patterns, (rows * columns,), of lines, each through points (n, 2 or more)."""
    step = _step(canvas)
    places = np.concatenate([np.empty((0, 2)), *(_line_places(each[:, :2], step) for each in lines)])
    return dot_patterns(2 * canvas.viewport.to_units(places), canvas.rows, canvas.columns)


def _line_places(line: FloatArray, step: float) -> FloatArray:
    """Places (m, 2) at most `step` apart along a line through points (n, 2)."""
    points = shapes.near_places(line)
    moves = points[1:] - points[:-1]
    along = np.zeros(len(points))
    np.cumsum(np.hypot(moves[:, 0], moves[:, 1]), out=along[1:])
    whole = float(along[-1])
    steps = min(math.ceil(whole / min(step, max(whole, _STANDSTILL))), shapes.MOST_SAMPLES)
    at = np.arange(steps + 1) * (whole / max(steps, 1))
    at[-1] = whole
    places = np.empty((steps + 1, 2))
    for axis in (0, 1):
        places[:, axis] = np.interp(at, along, points[:, axis])
    return places


def draw_rays(canvas: Canvas, scene: Scene) -> list[DrawnRay]:
    """Draw the views of the sensors: faintly, and the last one brightly. Returns the rays, for their
    codes."""
    spare = canvas.backdrop.keeps_wall
    weak: list[FloatArray] = []
    strong: list[FloatArray] = []
    rays = []
    for each in scene.views:
        seen = _seen(each, canvas)
        if not seen:
            continue
        bright = scene.is_bright(each)
        (strong if bright else weak).append(seen[0])
        weak += seen[1:]
        if not isinstance(each.view, FloorPatch):
            rays.append(DrawnRay(each.sensor, bright, seen[0]))
    if weak:
        canvas.line(Role.RAY_WEAK, np.concatenate(weak), spare | canvas.backdrop.named)
    if strong:
        canvas.line(Role.RAY_STRONG, np.concatenate(strong), spare)
    return rays


def draw_codes(canvas: Canvas, rays: Sequence[DrawnRay]) -> None:
    """Draw the code of a sensor at the end of its ray, where it covers no body, wall or word."""
    taken = canvas.bodies | canvas.contacts | canvas.backdrop.named | canvas.backdrop.has_wall
    # The last reading comes first: people look for it.
    for ray in sorted(rays, key=lambda ray: not ray.is_bright):
        if not len(ray.places) or not (ray.is_bright or canvas.viewport.zoom >= _CODES_FROM):
            continue
        x, y = canvas.viewport.to_units(ray.places).T
        for share in _CODE_AT:
            at = min(int(share * len(x)), len(x) - 1)
            row, column = math.floor(y[at] / 2), math.floor(x[at] - len(ray.sensor) / 2 + 0.5)
            cells = (row, slice(column, column + len(ray.sensor)))
            inside = canvas.holds(row, column) and canvas.holds(row, column + len(ray.sensor) - 1)
            if inside and not taken[cells].any():
                role = Role.RAY_STRONG if ray.is_bright else Role.RAY_WEAK
                canvas.text(row, column, ray.sensor, role)
                taken[row, max(column - 1, 0) : column + len(ray.sensor) + 1] = True
                break


def draw_peak(canvas: Canvas, peak: HeatPeak) -> None:
    """Mark the most likely cell of a heat map, on all that covers it, with its percentage beside."""
    canvas.text(peak.row, peak.column, canvas.signs.peak, Role.BELIEF, Role.BACKGROUND)
    text = f" {peak.text} "
    taken = canvas.bodies | canvas.contacts | canvas.backdrop.named | canvas.backdrop.has_wall
    if canvas.holds(peak.row, peak.column):
        taken[peak.row, peak.column] = True
    for down, right in _BESIDE if peak.text else ():
        row, begin = peak.row + down, peak.column - len(text) // 2 + right
        inside = canvas.holds(row, begin) and canvas.holds(row, begin + len(text) - 1)
        if inside and not taken[row, begin : begin + len(text)].any():
            canvas.text(row, begin, text, Role.BELIEF)
            break


def draw_particles(canvas: Canvas, belief: BeliefMark) -> None:
    """Draw a dot for every particle of the program."""
    if belief.particles is not None and len(belief.particles):
        canvas.line(Role.BELIEF, np.asarray(belief.particles, dtype=np.float64), canvas.backdrop.keeps_wall)


def draw_belief(canvas: Canvas, scene: Scene, belief: BeliefMark) -> None:
    """Draw the outline of the robot at the program's belief, with an arrow and a tick ahead."""
    pose, robot = belief.pose, scene.robot
    if not shapes.is_near(pose.x, pose.y, pose.heading):
        return
    step = _step(canvas)
    radius = robot.reach * canvas.viewport.scale
    if belief.spread is not None and 0 < belief.spread < math.inf:
        # Every third dot at most, so that the circle looks neither like another robot nor like a trail.
        apart = max(3 * step, 2 * math.pi * belief.spread / _RING_DOTS)
        ring = shapes.outline_points(RobotSpec(radius=belief.spread), pose, apart)
        canvas.line(Role.BELIEF, ring, canvas.backdrop.keeps_wall)
    if canvas.signs.dotted:
        outline = shapes.outline_points(robot, pose, step)
        if belief.headed:
            rim = shapes.front(robot)
            tick = np.linspace((rim, 0.0), (rim + _TICK * robot.reach, 0.0), 8)
            outline = np.concatenate((outline, shapes.to_global(tick, pose)))
        canvas.line(Role.BELIEF, outline)
    elif radius >= 2:
        _draw_sides(canvas, robot, pose)
    ahead = min(_ARROW_AHEAD * canvas.viewport.scale, radius / 2)
    x, y = canvas.viewport.place(pose.x, pose.y)
    heading = math.radians(pose.heading)
    x, y = x + ahead * math.cos(heading), y - ahead * math.sin(heading)
    arrow = heading_arrow(canvas.signs, pose.heading) if belief.headed else "?"
    row, column = math.floor(y / 2), math.floor(x - (len(arrow) - 1) / 2)
    canvas.text(row, column, arrow, Role.BELIEF)


def _draw_sides(canvas: Canvas, robot: RobotSpec, pose: Pose) -> None:
    """Draw the left and right end of a body in every row of cells: in signs, a whole outline would leave no
    room for its content."""
    x, y = canvas.viewport.to_units(shapes.outline_points(robot, pose, _step(canvas))).T
    ends = []
    for row in range(math.ceil(y.min() / 2 - 0.25), math.floor(y.max() / 2 - 0.75) + 1):
        near = x[np.abs(y - 2 * row - 1) <= 1]
        if len(near):
            ends += [(math.floor(near.min() + 0.5), row), (math.ceil(near.max() - 0.5) - 1, row)]
    if ends:
        canvas.dots(Role.BELIEF, np.array(ends) * (2.0, 4.0))


def _step(canvas: Canvas) -> float:
    """Inches between two samples of a line."""
    return _STEP_DOTS * 0.5 / canvas.viewport.scale


def _seen(seen: SensorView, canvas: Canvas) -> list[FloatArray]:
    """Places to mark for one reading: the measured ray, and after it the sides of a wide beam. Without an
    echo they are dots; for a line sensor a spot on the floor."""
    view, step = seen.view, _step(canvas)
    if not shapes.is_near(*(view.centre if isinstance(view, FloorPatch) else view.origin)):
        return []
    if isinstance(view, FloorPatch):
        return [_spot(view, step)]
    if not view.distances:
        return []
    nearest = view.distances.index(min(view.distances))
    length = view.distances[nearest] if seen.reading is None else seen.reading
    if not math.isfinite(length):
        middle = (view.bearings[0] + view.bearings[-1]) / 2
        return [_dots_along(canvas, view.origin, middle, np.array(_NO_ECHO))]
    chosen = [nearest]
    if abs(view.bearings[-1] - view.bearings[0]) >= _WIDE_FAN:
        chosen += [ray for ray in (0, len(view.bearings) - 1) if ray != nearest]
    # The sides of a beam end at the first wall, but no further out than the reading.
    ends = [length, *(min(length, view.distances[ray]) for ray in chosen[1:])]
    alongs = [np.append(np.arange(0.0, min(end, _LONGEST_RAY), step), end - _JUST) for end in ends]
    pairs = zip(chosen, alongs, strict=True)
    return [_dots_along(canvas, view.origin, view.bearings[ray], along) for ray, along in pairs]


def _dots_along(canvas: Canvas, origin: tuple[float, float], bearing: float, along: FloatArray) -> FloatArray:
    """Places (n, 2) at distances from an origin, up to the first in a wall."""
    places = shapes.ray_points(origin, bearing, along)
    blocked = canvas.backdrop.in_wall(*canvas.viewport.to_units(places).T)
    # The sensor itself may be over a wall, as that of a robot that touches one.
    blocked[: int(blocked.argmin())] = False
    return places[: int(blocked.argmax())] if blocked.any() else places


def _spot(spot: FloorPatch, step: float) -> FloatArray:
    """A ring where the floor was white, a disc where it was black."""
    places = shapes.outline_points(RobotSpec(radius=spot.radius), Pose(*spot.centre, 0.0), step)
    if len(spot.black) and float(spot.black.mean()) >= 0.5:
        return np.concatenate((places, spot.points))
    return places


# -- scans of lidars ---------------------------------------------------------------------------------


def draw_scans(canvas: Canvas, scene: Scene) -> None:
    """Draw the dots of the newest scans.

    A dot that noise puts into a wall is drawn at the last free place of its beam, so that walls keep their
    edge. Zone names and percentages stay legible.
    """
    spare = canvas.backdrop.named | canvas.backdrop.has_wall
    for each in scene.scans:
        canvas.dots(Role.RAY_STRONG, 2 * dot_places(canvas, each), spare)


def dot_places(canvas: Canvas, rays: ScanRays) -> FloatArray:
    """Places of a scan's dots, units of the window, (n, 2); none for a beam without a free place."""
    viewport = canvas.viewport
    lengths = _within(canvas, rays)
    places = viewport.to_units(rays.origins + lengths[:, None] * rays.directions)
    back = _BACK * rays.directions * (1.0, -1.0)
    steps = lengths * viewport.scale / _BACK
    blocked = np.flatnonzero(_is_covered(canvas, places))
    shown = np.ones(len(places), dtype=np.bool_)
    while len(blocked):
        places[blocked] -= back[blocked]
        steps[blocked] -= 1.0
        shown[blocked[steps[blocked] < 0.0]] = False
        blocked = blocked[(steps[blocked] >= 0.0) & _is_covered(canvas, places[blocked])]
    free: FloatArray = places[shown]
    return free


def _within(canvas: Canvas, rays: ScanRays) -> FloatArray:
    """Lengths of the beams as far as they are in the maze, inches."""
    rows, columns = canvas.backdrop.walls.shape
    cell = canvas.viewport.maze_height / rows
    most = np.array((columns * cell, canvas.viewport.maze_height))
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (np.where(rays.directions > 0.0, most, 0.0) - rays.origins) / rays.directions
    # A beam along a side never reaches it.
    ends[rays.directions == 0.0] = np.inf
    lengths: FloatArray = np.clip(rays.ranges, 0.0, ends.min(axis=1, initial=np.inf).clip(0.0))
    return lengths


def _is_covered(canvas: Canvas, places: FloatArray) -> Mask:
    """True for places in units of the window that are in a wall, or in a terminal cell that shows one."""
    x, y = places.T
    return canvas.backdrop.in_wall(x, y) | canvas.are_in(canvas.backdrop.has_wall, x, y)
