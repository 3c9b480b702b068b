"""What is drawn in fine dots over the picture: rays, floor spots, belief, particles.

A dot is half a pixel each way; two by four dots fill a terminal cell, as braille does.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import FloorPatch, RangeScan
from simmer_tui.sim.specs import RobotSpec
from simmer_tui.tui.maze.palette import Layer
from simmer_tui.tui.maze.scene import Belief, Scene
from simmer_tui.tui.maze.shapes import (
    distance_to_outline,
    front,
    nose,
    outline_points,
    sample_segments,
    to_global,
    to_local,
)
from simmer_tui.tui.maze.viewport import Viewport

_STEP_DOTS = 0.9
"""How far apart samples of a line are, in dots: near enough that no dot is left out."""
_SMALL_SPOT = 3.0
"""Radius in dots below which a floor spot's test points cannot be told apart."""
Places = NDArray[np.float64]


def draw_dots(scene: Scene, viewport: Viewport) -> NDArray[np.uint8]:
    """The `Layer` of every dot, (4 * rows, 2 * columns)."""
    dots = np.zeros((4 * viewport.rows, 2 * viewport.columns), dtype=np.uint8)
    layers: dict[Layer, list[Places]] = {layer: [] for layer in Layer}
    step = _STEP_DOTS * 0.5 / viewport.scale
    if scene.belief is not None:
        _place_belief(layers, scene.belief, scene.robot, step)
    if scene.show_rays:
        _place_rays(layers, scene, step)
        for sensor in scene.views:
            if isinstance(sensor.view, FloorPatch):
                _place_spot(layers, scene, sensor.view, step)
    for layer in sorted(layers):
        if layers[layer]:
            places = 2 * viewport.to_pixels(np.concatenate(layers[layer]))
            x, y = np.floor(places).astype(np.intp).T
            seen = (x >= 0) & (x < dots.shape[1]) & (y >= 0) & (y < dots.shape[0])
            dots[y[seen], x[seen]] = layer
    return dots


def _place_belief(layers: dict[Layer, list[Places]], belief: Belief, robot: RobotSpec, step: float) -> None:
    layers[Layer.BELIEF].append(outline_points(robot, belief.pose, step))
    (start, end) = to_global(np.array([[0.0, 0.0], [front(robot), 0.0]]), belief.pose)
    layers[Layer.BELIEF].append(sample_segments(start[None], end[None], step)[0])
    if belief.spread is not None and 0 < belief.spread < math.inf:
        # Every third dot, so that the circle does not look like another robot.
        circle = outline_points(RobotSpec(radius=belief.spread), belief.pose, 3 * step)
        layers[Layer.BELIEF].append(circle)
    if belief.particles is not None and len(belief.particles):
        layers[Layer.PARTICLE].append(belief.particles)


def _place_rays(layers: dict[Layer, list[Places]], scene: Scene, step: float) -> None:
    longest = math.hypot(scene.maze.width, scene.maze.height)
    starts: list[Places] = []
    ends: list[Places] = []
    shortest: list[bool] = []
    for sensor in scene.views:
        if isinstance(sensor.view, RangeScan) and sensor.view.distances:
            # A ray ends at a wall; its last dot must not lie in it.
            origin, ray_ends = _ray_ends(sensor.view, longest, 0.5 * step)
            starts.append(np.broadcast_to(origin, ray_ends.shape))
            ends.append(ray_ends)
            nearest = min(sensor.view.distances)
            shortest.extend(distance == nearest < math.inf for distance in sensor.view.distances)
    if not starts:
        return
    places, owners = sample_segments(np.concatenate(starts), np.concatenate(ends), step)
    bright = np.array(shortest)[owners]
    if scene.show_robot:
        # Rays start at the robot's outline, which must stay readable.
        outside = distance_to_outline(to_local(places, scene.pose), scene.robot) > 0
        places, bright = places[outside], bright[outside]
    layers[Layer.RAY].append(places[~bright])
    layers[Layer.SHORTEST_RAY].append(places[bright])


def _ray_ends(fan: RangeScan, longest: float, short_by: float) -> tuple[Places, Places]:
    origin = np.array(fan.origin)
    bearings = np.radians(np.array(fan.bearings))
    distances = np.clip(np.array(fan.distances) - short_by, 0.0, longest)
    directions = np.stack((np.cos(bearings), np.sin(bearings)), axis=-1)
    return origin, origin + distances[:, None] * directions


def _place_spot(layers: dict[Layer, list[Places]], scene: Scene, spot: FloorPatch, step: float) -> None:
    dot = step / _STEP_DOTS
    centre = Pose(*spot.centre, 0.0)
    if spot.radius >= _SMALL_SPOT * dot:
        layers[Layer.FLOOR_SPOT].append(outline_points(RobotSpec(radius=spot.radius), centre, step))
        shown = _spread_out(spot, 2 * dot)
        layers[Layer.FLOOR_SPOT].append(spot.points[shown & ~spot.black])
        layers[Layer.BLACK_POINT].append(spot.points[shown & spot.black])
        return
    mostly_black = len(spot.black) > 0 and float(spot.black.mean()) >= 0.5
    layer = Layer.BLACK_POINT if mostly_black else Layer.FLOOR_SPOT
    place = np.array([spot.centre])
    if 2 * spot.radius < dot and scene.show_robot and _on_nose(place, scene):
        return  # the robot is only a few pixels large: which way it looks matters more
    layers[layer].append(place)
    if spot.radius >= dot:
        layers[layer].append(outline_points(RobotSpec(radius=spot.radius), centre, step))


def _spread_out(spot: FloorPatch, spacing: float) -> NDArray[np.bool_]:
    """Which test points to show so that they lie at least `spacing` apart: all of them, or every
    second, third or sixth of their rows and columns, a sixth of the radius apart."""
    grid = spot.radius / 6
    every = next((step for step in (1, 2, 3) if step * grid >= spacing), 6)
    places = np.rint((spot.points - np.array(spot.centre)) / grid).astype(np.intp)
    shown: NDArray[np.bool_] = (places % every == 0).all(axis=1)
    return shown


def _on_nose(place: Places, scene: Scene) -> bool:
    return bool(distance_to_outline(to_local(place, scene.pose), nose(scene.robot))[0] < 0)
