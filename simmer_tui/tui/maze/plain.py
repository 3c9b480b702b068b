"""The picture in plain characters, for terminals that can show nothing else.

`#` wall, `.` dark tile, `B` block, `O` robot with `>` `^` `<` `v` at its front, `*` trail,
`-` `|` `/` `\\` the measured ray, `'` other rays, `i` and `x` floor spots on white and black,
`?` belief, `,` particles, `X` contact now, `+` contact before.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from simmer_tui.tui.maze.glyphs import Cells, blank_cells, cell_layers
from simmer_tui.tui.maze.palette import Color, Layer, Palette, pack, reduce_colors
from simmer_tui.tui.maze.raster import (
    BLACK_TILE,
    WALL_SURFACE,
    block_coverage,
    robot_coverage,
    surfaces,
    trail_alpha,
)
from simmer_tui.tui.maze.scene import Scene
from simmer_tui.tui.maze.shapes import Patch, front, to_global
from simmer_tui.tui.maze.viewport import ZOOM_LEVELS, Viewport
from simmer_tui.tui.terminal import ColorDepth

_Put = Callable[[NDArray[np.bool_], str, Color | None], None]
_ENOUGH = 0.35
"""The fraction of a cell that a body must cover to be drawn in it."""
_ARROWS = ">^<v"
_LAYER_CHARACTERS = {
    Layer.PARTICLE: ",",
    Layer.BELIEF: "?",
    Layer.RAY: "'",
    Layer.FLOOR_SPOT: "i",
    Layer.BLACK_POINT: "x",
}


def plain_cells(
    scene: Scene, viewport: Viewport, dots: NDArray[np.uint8], palette: Palette, depth: ColorDepth
) -> Cells:
    """The picture in characters, coloured on the default background if there are colours."""
    result = blank_cells(viewport.rows, viewport.columns)

    def put(where: NDArray[np.bool_], character: str, color: Color | None = None) -> None:
        result.characters[where] = ord(character)
        if color is not None:
            result.foreground[where] = int(reduce_colors(pack(np.array(color, dtype=np.uint8)), depth))

    ground = surfaces(scene, viewport)[0::2]
    put(ground == BLACK_TILE, ".")
    if scene.show_trail and len(scene.trail):
        put(_rows_joined(trail_alpha(scene, viewport) > 0), "*", palette.trail)
    _put_layers(tuple(_LAYER_CHARACTERS), dots, palette, put)
    _put_measured_rays(dots, palette, put)
    # Bodies over lines, and floor spots over bodies only where there is room: in too few
    # characters a robot full of sensor marks could not be found.
    put(_covered_cells(block_coverage(scene, viewport), viewport), "B", palette.block)
    if scene.show_robot:
        put(_covered_cells(robot_coverage(scene, viewport), viewport), "O", palette.robot)
    if viewport.zoom > ZOOM_LEVELS[0]:
        _put_layers((Layer.FLOOR_SPOT, Layer.BLACK_POINT), dots, palette, put)
    put(ground == WALL_SURFACE, "#")
    if scene.show_robot:
        put(_nose_cell(scene, viewport), _ARROWS[round(scene.pose.heading / 90) % 4], palette.robot)
    if scene.contact is not None:
        now = scene.in_contact
        color = palette.contact if now else palette.past_contact
        put(_place_cell(scene.contact, viewport), "X" if now else "+", color)
    return result


def line_characters(dots: NDArray[np.uint8], layer: Layer) -> NDArray[np.uint32]:
    """The sign that looks most like one layer's dots in each cell (rows, columns); 0 where none."""
    shown = (dots == layer).reshape(len(dots) // 4, 4, -1, 2)
    counts = shown.sum(axis=1)
    heights = (shown * np.arange(4)[:, None, None]).sum(axis=1) / np.maximum(counts, 1)
    left, right = counts[..., 0] > 0, counts[..., 1] > 0
    drop = heights[..., 1] - heights[..., 0]
    return np.select(
        [left & right & (drop >= 1), left & right & (drop <= -1), left & right, left | right],
        [ord("\\"), ord("/"), ord("-"), ord("|")],
        0,
    ).astype(np.uint32)


def _put_layers(shown: tuple[Layer, ...], dots: NDArray[np.uint8], palette: Palette, put: _Put) -> None:
    layers = cell_layers(dots)
    for layer in shown:
        put(layers == layer, _LAYER_CHARACTERS[layer], palette.layers[layer])


def _put_measured_rays(dots: NDArray[np.uint8], palette: Palette, put: _Put) -> None:
    lines = line_characters(dots, Layer.SHORTEST_RAY)
    for sign in "\\/-|":
        put(lines == ord(sign), sign, palette.layers[Layer.SHORTEST_RAY])


def _rows_joined(pixels: NDArray[np.bool_]) -> NDArray[np.bool_]:
    joined: NDArray[np.bool_] = pixels[0::2] | pixels[1::2]
    return joined


def _covered_cells(
    covered: tuple[Patch, NDArray[np.float64]] | None, viewport: Viewport
) -> NDArray[np.bool_]:
    coverage = np.zeros((2 * viewport.rows, viewport.columns))
    if covered is not None:
        place, fraction = covered
        coverage[place.rows, place.columns] = fraction
    enough: NDArray[np.bool_] = (coverage[0::2] + coverage[1::2]) / 2 >= _ENOUGH
    return enough


def _nose_cell(scene: Scene, viewport: Viewport) -> NDArray[np.bool_]:
    if not math.isfinite(scene.pose.heading):
        return np.zeros((viewport.rows, viewport.columns), dtype=np.bool_)
    tip = to_global(np.array([0.7 * front(scene.robot), 0.0]), scene.pose)
    return _place_cell((float(tip[0]), float(tip[1])), viewport)


def _place_cell(point: tuple[float, float], viewport: Viewport) -> NDArray[np.bool_]:
    """The one cell a place lies in, as a mask (rows, columns); empty if it is out of the window."""
    mask = np.zeros((viewport.rows, viewport.columns), dtype=np.bool_)
    x, y = np.floor(viewport.to_pixels(np.array(point))).astype(np.intp)
    if 0 <= x < viewport.columns and 0 <= y < 2 * viewport.rows:
        mask[y // 2, x] = True
    return mask
