"""One door to the drawing: a scene and a window in, terminal cells out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.specs import MazeSpec
from simmer_tui.tui.maze.glyphs import Cells, half_cells, hybrid_cells, put_particles, solid_cells, tint
from simmer_tui.tui.maze.overlay import draw_dots
from simmer_tui.tui.maze.palette import Layer, palette_for
from simmer_tui.tui.maze.plain import plain_cells
from simmer_tui.tui.maze.raster import paint, paint_background, robot_coverage
from simmer_tui.tui.maze.scene import Scene
from simmer_tui.tui.maze.viewport import ZOOM_LEVELS, Viewport
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

_ENOUGH = 0.35
"""The fraction of a pixel that the robot must cover for it to be seen there."""


class Painter:
    """Draws scenes for one kind of terminal, and keeps the last floor and walls it drew."""

    def __init__(self, glyphs: GlyphMode, depth: ColorDepth) -> None:
        # Blanks without colours would show nothing at all.
        nothing_to_see = glyphs is GlyphMode.SOLID and depth is ColorDepth.NONE
        self.glyphs = GlyphMode.ASCII if nothing_to_see else glyphs
        self.depth = depth
        self.palette = palette_for(depth)
        self._drawn: tuple[MazeSpec, NDArray[np.uint8], Viewport] | None = None
        self._background = np.zeros((0, 0, 3), dtype=np.uint8)

    def cells(self, scene: Scene, viewport: Viewport) -> Cells:
        """The picture, (viewport.rows, viewport.columns)."""
        dots = draw_dots(scene, viewport)
        if self.glyphs is GlyphMode.ASCII:
            return plain_cells(scene, viewport, dots, self.palette, self.depth)
        if viewport.zoom == ZOOM_LEVELS[0] and (self.palette.exact or self.glyphs is GlyphMode.SOLID):
            dots = _off_the_robot(dots, scene, viewport)
        background = self.background(scene, viewport)
        pixels = paint(scene, viewport, self.palette, background)
        if self.glyphs is GlyphMode.HYBRID:
            return hybrid_cells(pixels, dots, self.palette, self.depth)
        if self.glyphs is GlyphMode.HALF:
            return half_cells(tint(pixels, dots, self.palette), self.depth)
        without = np.where(dots == Layer.PARTICLE, Layer.NOTHING, dots).astype(np.uint8)
        cells = solid_cells(tint(pixels, without, self.palette), background, self.palette, self.depth)
        put_particles(cells, dots, self.palette, self.depth)
        return cells

    def background(self, scene: Scene, viewport: Viewport) -> NDArray[np.uint8]:
        """Floor and walls of a window, drawn anew only when one of them is another."""
        drawn = self._drawn
        if drawn is None or drawn[0] is not scene.maze or drawn[1] is not scene.floor or drawn[2] != viewport:
            self._background = paint_background(scene, viewport, self.palette)
            self._drawn = (scene.maze, scene.floor, viewport)
        return self._background


def _off_the_robot(dots: NDArray[np.uint8], scene: Scene, viewport: Viewport) -> NDArray[np.uint8]:
    """The dots without those on the robot, but for the belief: where a robot is a few cells of one
    colour each, it could not be found under what its sensors see."""
    covered = robot_coverage(scene, viewport) if scene.show_robot else None
    if covered is None:
        return dots
    place, fraction = covered
    body = np.zeros((2 * viewport.rows, viewport.columns), dtype=np.bool_)
    body[place.rows, place.columns] = fraction >= _ENOUGH
    hidden = body.repeat(2, axis=0).repeat(2, axis=1) & (dots != Layer.BELIEF)
    return np.where(hidden, Layer.NOTHING, dots).astype(np.uint8)
