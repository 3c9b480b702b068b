"""One door to the drawing: a scene and a window in, terminal cells out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.specs import MazeSpec
from simmer_tui.tui.glyphs import Cells, half_cells, hybrid_cells, solid_cells, tint
from simmer_tui.tui.overlay import draw_dots
from simmer_tui.tui.palette import palette_for
from simmer_tui.tui.plain import plain_cells
from simmer_tui.tui.raster import paint, paint_background
from simmer_tui.tui.scene import Scene
from simmer_tui.tui.terminal import ColorDepth, GlyphMode
from simmer_tui.tui.viewport import Viewport


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
        background = self.background(scene, viewport)
        pixels = paint(scene, viewport, self.palette, background)
        if self.glyphs is GlyphMode.HYBRID:
            return hybrid_cells(pixels, dots, self.palette, self.depth)
        tinted = tint(pixels, dots, self.palette)
        if self.glyphs is GlyphMode.HALF:
            return half_cells(tinted, self.depth)
        return solid_cells(tinted, background, self.palette, self.depth)

    def background(self, scene: Scene, viewport: Viewport) -> NDArray[np.uint8]:
        """Floor and walls of a window, drawn anew only when one of them is another."""
        drawn = self._drawn
        if drawn is None or drawn[0] is not scene.maze or drawn[1] is not scene.floor or drawn[2] != viewport:
            self._background = paint_background(scene, viewport, self.palette)
            self._drawn = (scene.maze, scene.floor, viewport)
        return self._background
