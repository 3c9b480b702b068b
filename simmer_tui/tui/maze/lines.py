"""Marks drawn in dots: trail, rays, floor spots, the outline of a belief."""

import math
from itertools import pairwise

import numpy as np

from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import FloorPatch
from simmer_tui.sim.sensors import View
from simmer_tui.sim.specs import RobotSpec
from simmer_tui.tui.maze import shapes
from simmer_tui.tui.maze.canvas import Canvas
from simmer_tui.tui.maze.glyphs import heading_arrow
from simmer_tui.tui.maze.palette import Role
from simmer_tui.tui.maze.scene import BeliefMark, Scene

# Less than a whole dot, so that none is left out on a slanting line.
_STEP_DOTS = 0.9
"""Distance of samples of a line, in dots."""
# Two movements: usually a turn and the drive after it.
_TRAIL_AGES = (2, 4)
"""Numbers of the last movements that are new, and that are at most older."""
_STANDSTILL = 0.05
"""Inches; a movement shorter than this leaves no trail."""
# The cones of the bundled sets, 5 degrees, are hardly wider than one ray on a screen.
_WIDE_FAN = 10.0
"""Degrees; a fan at least this wide is shown by its outer rays too."""
_TICK = 0.4
"""Length of the mark at the front of a belief, in robot radii."""
_ARROW_AHEAD = 0.6
"""Distance of the arrow on a body ahead of its middle, inches."""


def draw_trail(canvas: Canvas, scene: Scene) -> None:
    """Path of the last movements: the newer, the brighter."""
    legs = []
    step = _step(canvas)
    # A movement begins where the one before has ended.
    for before, after in pairwise((np.empty((0, 2)), *scene.trail)):
        leg = shapes.near_places(np.concatenate((before[-1:], after)))
        if len(leg) and np.ptp(leg, axis=0).max() >= _STANDSTILL:
            legs.append(shapes.sample_segments(leg[:-1], leg[1:], step))
    newest, older = _TRAIL_AGES
    for role, part in (
        (Role.TRAIL_OLD, legs[:-older]),
        (Role.TRAIL_OLDER, legs[-older:-newest]),
        (Role.TRAIL_NEW, legs[-newest:]),
    ):
        if part:
            canvas.line(role, np.concatenate(part), canvas.backdrop.keeps_wall)


def draw_rays(canvas: Canvas, scene: Scene) -> None:
    """Views of the sensors: faintly, and what was read last brightly."""
    spare = canvas.backdrop.keeps_wall
    longest = math.hypot(scene.maze.width, scene.maze.height)
    weak: list[FloatArray] = []
    strong: list[FloatArray] = []
    for each in scene.views:
        seen = _seen(each.view, canvas, longest)
        bright = scene.is_bright(each) and not _saw_nothing(each.view)
        (strong if bright else weak).extend(seen[:1])
        weak += seen[1:]
    if weak:
        canvas.line(Role.RAY_WEAK, np.concatenate(weak), spare | canvas.backdrop.named)
    if strong:
        canvas.line(Role.RAY_STRONG, np.concatenate(strong), spare)


def draw_particles(canvas: Canvas, belief: BeliefMark) -> None:
    """A dot for every place the program holds possible."""
    if belief.particles is not None and len(belief.particles):
        canvas.line(Role.BELIEF, np.asarray(belief.particles, dtype=np.float64), canvas.backdrop.keeps_wall)


def draw_belief(canvas: Canvas, scene: Scene, belief: BeliefMark) -> None:
    """Outline of the robot where the program believes it is, with an arrow and a tick ahead."""
    pose, robot = belief.pose, scene.robot
    if not shapes.is_near(pose.x, pose.y, pose.heading):
        return
    step = _step(canvas)
    radius = shapes.reach(robot) * canvas.viewport.scale
    parts = []
    if belief.spread is not None and 0 < belief.spread < math.inf:
        # Every third dot, so that the circle does not look like another robot.
        parts.append(shapes.outline_points(RobotSpec(radius=belief.spread), pose, 3 * step))
    if canvas.signs.dotted:
        rim = shapes.front(robot)
        tick = np.linspace(rim, rim + _TICK * shapes.reach(robot), 8)
        parts.append(shapes.outline_points(robot, pose, step))
        parts.append(shapes.to_global(np.stack((tick, np.zeros(8)), axis=-1), pose))
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
    """Left and right end of a body in every row of cells: in signs, a whole outline would leave
    no room for its content."""
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


def _saw_nothing(view: View) -> bool:
    return not isinstance(view, FloorPatch) and not any(map(math.isfinite, view.distances))


def _seen(view: View, canvas: Canvas, longest: float) -> list[FloatArray]:
    """Places to mark for one reading: the ray that was measured, and after it the outer rays of a
    wide fan; or a spot on the floor."""
    step = _step(canvas)
    if not shapes.is_near(*(view.centre if isinstance(view, FloorPatch) else view.origin)):
        return []
    if isinstance(view, FloorPatch):
        return [_spot(view, step)]
    if not view.distances:
        return []
    nearest = view.distances.index(min(view.distances))
    chosen = [nearest]
    if abs(view.bearings[-1] - view.bearings[0]) >= _WIDE_FAN:
        chosen += [ray for ray in (0, len(view.bearings) - 1) if ray != nearest]
    # A ray ends at a wall; its last dot must not lie in it.
    lengths = [min(max(view.distances[ray] - 0.5 * step, 0.0), longest) for ray in chosen]
    return [
        shapes.ray_points(view.origin, view.bearings[ray], length + step / 2, step)
        for ray, length in zip(chosen, lengths, strict=True)
    ]


def _spot(spot: FloorPatch, step: float) -> FloatArray:
    """A ring where the floor was white, a disc where it was black."""
    places = shapes.outline_points(RobotSpec(radius=spot.radius), Pose(*spot.centre, 0.0), step)
    if len(spot.black) and float(spot.black.mean()) >= 0.5:
        return np.concatenate((places, spot.points))
    return places
