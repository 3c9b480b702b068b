"""What is drawn in dots: trail, rays, floor spots, the outline of a belief."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import FloorPatch, RangeScan
from simmer_tui.sim.specs import RobotSpec
from simmer_tui.tui.maze.canvas import Canvas
from simmer_tui.tui.maze.glyphs import heading_arrow
from simmer_tui.tui.maze.palette import Role
from simmer_tui.tui.maze.scene import Belief, Scene
from simmer_tui.tui.maze.shapes import (
    Places,
    front,
    is_near,
    near_places,
    outline_points,
    reach,
    sample_segments,
    to_global,
)

_STEP_DOTS = 0.9
"""How far apart samples of a line are, in dots: near enough that no dot is left out."""
_TRAIL_AGES = (2, 4)
"""How many of the last movements are new, and how many no older than older."""
_STANDSTILL = 0.05
"""Inches; a movement shorter than this leaves no trail."""
_WIDE_FAN = 10.0
"""Degrees; a fan at least this wide is shown by its outer rays too."""
_TICK = 0.4
"""Length of the mark at the front of a belief, in robot radii."""
_ARROW_AHEAD = 0.6
"""Where an arrow on a body stands, inches ahead of its middle."""


def draw_trail(canvas: Canvas, scene: Scene) -> None:
    """Where the robot has been: the newer the movement, the brighter."""
    if not len(scene.trail):
        return
    spare = canvas.backdrop.keeps_wall
    places = near_places(scene.trail)
    bounds = [start for start in scene.leg_starts if 0 < start < len(places)]
    legs = []
    step = _step(canvas)
    for start, stop in zip([0, *bounds], [*bounds, len(places)], strict=True):
        # A movement begins where the one before has ended.
        leg = places[max(start - 1, 0) : stop]
        if np.ptp(leg, axis=0).max() >= _STANDSTILL:
            legs.append(sample_segments(leg[:-1], leg[1:], step)[0])
    newest, older = _TRAIL_AGES
    for role, part in (
        (Role.TRAIL_OLD, legs[:-older]),
        (Role.TRAIL_OLDER, legs[-older:-newest]),
        (Role.TRAIL_NEW, legs[-newest:]),
    ):
        if part:
            canvas.line(role, np.concatenate(part), spare)


def draw_rays(canvas: Canvas, scene: Scene) -> None:
    """What the sensors looked at: faintly, and what was read last brightly."""
    if not scene.views:
        return
    spare = canvas.backdrop.keeps_wall
    longest = math.hypot(scene.maze.width, scene.maze.height)
    weak: list[Places] = []
    strong: list[Places] = []
    for sensor in scene.views:
        seen = _seen(sensor.view, canvas, longest)
        bright = sensor is scene.views[-1] or (bool(scene.chosen) and sensor.sensor == scene.chosen)
        (strong if bright and not _saw_nothing(sensor.view) else weak).extend(seen[:1])
        weak += seen[1:]
    if weak:
        canvas.line(Role.RAY_WEAK, np.concatenate(weak), spare | canvas.backdrop.named)
    if strong:
        canvas.line(Role.RAY_STRONG, np.concatenate(strong), spare)


def draw_particles(canvas: Canvas, belief: Belief) -> None:
    """A dot for every place the program holds possible."""
    if belief.particles is not None and len(belief.particles):
        canvas.line(Role.BELIEF, np.asarray(belief.particles, dtype=np.float64), canvas.backdrop.keeps_wall)


def draw_belief(canvas: Canvas, scene: Scene, belief: Belief) -> None:
    """The outline of the robot where the program believes it is, with an arrow and a tick ahead."""
    pose, robot = belief.pose, scene.robot
    if not is_near(pose.x, pose.y, pose.heading):
        return
    step = _step(canvas)
    radius = reach(robot) * canvas.viewport.scale
    parts = []
    if belief.spread is not None and 0 < belief.spread < math.inf:
        # Every third dot, so that the circle does not look like another robot.
        parts.append(outline_points(RobotSpec(radius=belief.spread), pose, 3 * step))
    if canvas.signs.dotted:
        rim = front(robot)
        tick = np.linspace(rim, rim + _TICK * reach(robot), 8)
        parts.append(outline_points(robot, pose, step))
        parts.append(to_global(np.stack((tick, np.zeros(8)), axis=-1), pose))
    elif radius >= 2:
        _draw_sides(canvas, robot, pose)
    if parts:
        canvas.line(Role.BELIEF, np.concatenate(parts))
    ahead = min(_ARROW_AHEAD * canvas.viewport.scale, radius / 2)
    x, y = canvas.viewport.place(pose.x, pose.y)
    heading = math.radians(pose.heading)
    x, y = x + ahead * math.cos(heading), y - ahead * math.sin(heading)
    arrow = heading_arrow(canvas.signs, pose.heading)
    row, column = math.floor(y / 2), math.floor(x - (len(arrow) - 1) / 2)
    canvas.text(row, column, arrow, Role.BELIEF)


def _draw_sides(canvas: Canvas, robot: RobotSpec, pose: Pose) -> None:
    """The left and right end of a body in every row of cells: in signs, a whole outline would leave
    no room for what it surrounds."""
    x, y = canvas.viewport.to_units(outline_points(robot, pose, _step(canvas))).T
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


def _saw_nothing(view: RangeScan | FloorPatch) -> bool:
    return isinstance(view, RangeScan) and not any(map(math.isfinite, view.distances))


def _seen(view: RangeScan | FloorPatch, canvas: Canvas, longest: float) -> list[Places]:
    """Places to mark for one reading: the ray that was measured, and after it the outer rays of a
    wide fan; or a spot on the floor."""
    step = _step(canvas)
    if not is_near(*(view.centre if isinstance(view, FloorPatch) else view.origin)):
        return []
    if isinstance(view, FloorPatch):
        return [_spot(view, step)]
    if not view.distances:
        return []
    nearest = view.distances.index(min(view.distances))
    chosen = [nearest]
    if abs(view.bearings[-1] - view.bearings[0]) >= _WIDE_FAN:
        chosen += [ray for ray in (0, len(view.bearings) - 1) if ray != nearest]
    return [_ray(view, ray, longest, step) for ray in chosen]


def _ray(view: RangeScan, ray: int, longest: float, step: float) -> Places:
    # A ray ends at a wall; its last dot must not lie in it.
    length = min(max(view.distances[ray] - 0.5 * step, 0.0), longest)
    along = np.arange(0.0, length + step / 2, step)[:, None]
    bearing = math.radians(view.bearings[ray])
    places: Places = np.array(view.origin) + along * np.array([math.cos(bearing), math.sin(bearing)])
    return places


def _spot(spot: FloorPatch, step: float) -> Places:
    """A ring where the floor was white, a disc where it was black."""
    places: NDArray[np.float64] = outline_points(RobotSpec(radius=spot.radius), Pose(*spot.centre, 0.0), step)
    if len(spot.black) and float(spot.black.mean()) >= 0.5:
        return np.concatenate((places, spot.points))
    return places
