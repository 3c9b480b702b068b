"""The picture as pixels: floor, walls, trail, block, robot and contact.

Two pixels make a terminal cell, one above the other. Everything is painted as
`new = old * (1 - alpha * coverage) + colour * alpha * coverage`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import TILES_PER_CELL, WALL, RobotSpec
from simmer_tui.tui.maze.palette import Color, Palette
from simmer_tui.tui.maze.scene import Scene
from simmer_tui.tui.maze.shapes import Patch, distance_to_outline, nose, patch, reach, sample_segments, square
from simmer_tui.tui.maze.viewport import Viewport

_EXACT_COVERAGE = 0.4
"""The fraction of a pixel that must be covered to fill it, where colours cannot be mixed."""
_EDGE_INCHES = 0.35
_EDGE_PIXELS = 0.6
_MARK_BOOST = 1.8
_CONTACT_INCHES = 1.3
_TRAIL_OLDEST, _TRAIL_NEWEST = 0.35, 0.9


BLACK_TILE, WHITE_TILE, WALL_SURFACE = range(3)


def surfaces(scene: Scene, viewport: Viewport) -> NDArray[np.uint8]:
    """What the ground is in each pixel (2 * rows, columns): `BLACK_TILE`, `WHITE_TILE` or
    `WALL_SURFACE`. What lies outside the maze is wall."""
    maze, zoom = scene.maze, viewport.zoom
    x = np.arange(viewport.columns) + viewport.left
    y = np.arange(2 * viewport.rows) + 2 * viewport.top
    cell_x, cell_y = x // zoom, y // zoom
    inside = ((cell_y >= 0) & (cell_y < maze.rows))[:, None] & ((cell_x >= 0) & (cell_x < maze.columns))
    cells = np.array(maze.cells)[np.ix_(cell_y.clip(0, maze.rows - 1), cell_x.clip(0, maze.columns - 1))]
    tile_x = (x * TILES_PER_CELL // zoom).clip(0, maze.columns * TILES_PER_CELL - 1)
    tile_y = (y * TILES_PER_CELL // zoom).clip(0, maze.rows * TILES_PER_CELL - 1)
    tiles = scene.floor[np.ix_(tile_y, tile_x)]
    surface = np.where(tiles != 0, WHITE_TILE, BLACK_TILE).astype(np.uint8)
    surface[~inside | (cells == WALL)] = WALL_SURFACE
    return surface


def paint_background(scene: Scene, viewport: Viewport, palette: Palette) -> NDArray[np.uint8]:
    """Floor and walls, (2 * rows, columns, 3)."""
    colors = np.array((palette.black_tile, palette.white_tile, palette.wall), dtype=np.uint8)
    return colors[surfaces(scene, viewport)]


def paint(
    scene: Scene, viewport: Viewport, palette: Palette, background: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """The whole picture but the overlay, (2 * rows, columns, 3)."""
    pixels = background.astype(np.float32)
    if scene.show_trail and len(scene.trail):
        alpha = trail_alpha(scene, viewport)
        _blend(pixels, palette.trail, np.ceil(alpha) if palette.exact else alpha, palette.exact)
    if scene.block_centre is not None:
        _paint_block(pixels, scene, viewport, palette)
    if scene.show_robot:
        _paint_robot(pixels, scene, viewport, palette)
    if scene.contact is not None:
        color = palette.contact if scene.in_contact else palette.past_contact
        pixels[contact_mask(scene.contact, viewport)] = color
    return (pixels + 0.5).astype(np.uint8)


def trail_alpha(scene: Scene, viewport: Viewport) -> NDArray[np.float64]:
    """How strongly the trail shows in each pixel (2 * rows, columns): more the newer it is."""
    alpha = np.zeros((2 * viewport.rows, viewport.columns))
    places = viewport.to_pixels(scene.trail)
    if len(places) == 1:
        places = np.repeat(places, 2, axis=0)
    samples, owners = sample_segments(places[:-1], places[1:], 0.5)
    x, y = np.floor(samples).astype(np.intp).T
    seen = (x >= 0) & (x < viewport.columns) & (y >= 0) & (y < 2 * viewport.rows)
    age = (owners[seen] + 1) / (len(places) - 1)
    # Assigned in the order of the trail, so that the newest passage wins.
    alpha[y[seen], x[seen]] = _TRAIL_OLDEST + (_TRAIL_NEWEST - _TRAIL_OLDEST) * age
    return alpha


def contact_mask(point: tuple[float, float], viewport: Viewport) -> NDArray[np.bool_]:
    """The pixels (2 * rows, columns) of the cross that marks a place of contact."""
    mask = np.zeros((2 * viewport.rows, viewport.columns), dtype=np.bool_)
    x, y = np.floor(viewport.to_pixels(np.array(point))).astype(np.intp)
    arm = max(1, round(_CONTACT_INCHES * viewport.scale))
    steps = np.arange(-arm, arm + 1)
    columns, rows = np.concatenate((x + steps, x + steps)), np.concatenate((y + steps, y - steps))
    seen = (columns >= 0) & (columns < viewport.columns) & (rows >= 0) & (rows < 2 * viewport.rows)
    mask[rows[seen], columns[seen]] = True
    return mask


def robot_coverage(scene: Scene, viewport: Viewport) -> tuple[Patch, NDArray[np.float64]] | None:
    """Where the robot's body is: pixels, and the covered fraction of each."""
    return _covered(scene.robot, scene.pose, viewport)


def block_coverage(scene: Scene, viewport: Viewport) -> tuple[Patch, NDArray[np.float64]] | None:
    """Where the block is: pixels, and the covered fraction of each."""
    if scene.block_centre is None:
        return None
    return _covered(square(scene.block_size), Pose(*scene.block_centre, scene.block_heading), viewport)


def _covered(shape: RobotSpec, pose: Pose, viewport: Viewport) -> tuple[Patch, NDArray[np.float64]] | None:
    place = patch(viewport, pose, reach(shape))
    if place is None:
        return None
    return place, place.coverage(distance_to_outline(place.samples, shape) < 0)


def _paint_block(pixels: NDArray[np.float32], scene: Scene, viewport: Viewport, palette: Palette) -> None:
    covered = block_coverage(scene, viewport)
    if covered is None:
        return
    place, body = covered
    region = pixels[place.rows, place.columns]
    _blend(region, palette.block, palette.block_alpha * body, palette.exact)
    edge = _edge(place, square(scene.block_size), viewport)
    _blend(region, palette.block_edge, palette.block_alpha * edge, palette.exact)


def _paint_robot(pixels: NDArray[np.float32], scene: Scene, viewport: Viewport, palette: Palette) -> None:
    covered = robot_coverage(scene, viewport)
    if covered is None:
        return
    place, body = covered
    region = pixels[place.rows, place.columns]
    _blend(region, palette.robot, palette.robot_alpha * body, palette.exact)
    edge_color = palette.contact if scene.in_contact else palette.robot_edge
    _blend(region, edge_color, _edge(place, scene.robot, viewport), palette.exact)
    wedge = place.coverage(distance_to_outline(place.samples, nose(scene.robot)) < 0)
    # A soft edge would wash the mark out where it is but two pixels large.
    _blend(region, palette.mark, np.minimum(1.0, _MARK_BOOST * wedge), palette.exact)


def _edge(place: Patch, shape: RobotSpec, viewport: Viewport) -> NDArray[np.float64]:
    """Coverage of a shape's edge, drawn inside it so that the shape looks no larger than it is."""
    width = max(_EDGE_INCHES, _EDGE_PIXELS / viewport.scale)
    distance = distance_to_outline(place.samples, shape)
    return place.coverage((distance < 0) & (distance > -width))


def _blend(pixels: NDArray[np.float32], color: Color, alpha: NDArray[np.float64], exact: bool) -> None:
    """Lay a colour over pixels (h, w, 3), in place, with an alpha (h, w)."""
    if exact:
        pixels[alpha >= _EXACT_COVERAGE] = color
        return
    fraction = alpha[..., None].astype(np.float32)
    pixels += (np.array(color, dtype=np.float32) - pixels) * fraction
