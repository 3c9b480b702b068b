"""One door to the drawing: a scene and a window in, terminal cells out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.specs import MazeSpec
from simmer_tui.tui.maze.backdrop import Backdrop, draw_backdrop
from simmer_tui.tui.maze.bodies import draw_block, draw_contact, draw_robot
from simmer_tui.tui.maze.canvas import Canvas
from simmer_tui.tui.maze.glyphs import Cells, signs_for
from simmer_tui.tui.maze.lines import draw_belief, draw_particles, draw_rays, draw_trail
from simmer_tui.tui.maze.palette import Look, palette_for
from simmer_tui.tui.maze.scene import FloorMode, Place, Scene
from simmer_tui.tui.maze.shapes import reach
from simmer_tui.tui.maze.viewport import Viewport
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

_Key = tuple[Viewport, bool, tuple[Place, ...] | None, Place | None]


class Painter:
    """Draws scenes for one kind of terminal, and keeps the last backdrop it drew.

    `look` and `floor` may be changed between two scenes.
    """

    def __init__(self, glyphs: GlyphMode, depth: ColorDepth, look: Look = Look.DARK) -> None:
        self.glyphs = glyphs
        self.depth = depth
        self.floor = FloorMode.AUTO
        self.signs = signs_for(glyphs, depth)
        self._look = look
        self.palette = palette_for(depth, look)
        self._drawn: tuple[MazeSpec, NDArray[np.uint8], _Key] | None = None
        self._backdrop: Backdrop | None = None

    @property
    def look(self) -> Look:
        return self._look

    @look.setter
    def look(self, look: Look) -> None:
        if look is not self._look:
            self._look = look
            self.palette = palette_for(self.depth, look)
            self._backdrop = None

    def cells(self, scene: Scene, viewport: Viewport) -> Cells:
        """The picture, (viewport.rows, viewport.columns)."""
        canvas = Canvas(self.backdrop(scene, viewport), viewport, self.signs, self.palette)
        belief = scene.belief
        if scene.show_trail:
            draw_trail(canvas, scene)
        if belief is not None:
            draw_particles(canvas, belief)
        if scene.show_rays:
            draw_rays(canvas, scene)
        held = scene.block_held and scene.show_robot
        if not held:
            draw_block(canvas, scene)
        if belief is not None:
            draw_belief(canvas, scene, belief)
        if scene.contact is not None and not scene.in_contact:
            self._contact(canvas, scene, scene.contact)  # the robot may since have come over it
        if scene.show_robot:
            draw_robot(canvas, scene)
        if scene.contact is not None and scene.in_contact:
            self._contact(canvas, scene, scene.contact)
        return canvas.cells

    def _contact(self, canvas: Canvas, scene: Scene, point: Place) -> None:
        draw_contact(canvas, point, (scene.pose.x, scene.pose.y), radius=reach(scene.robot))

    def backdrop(self, scene: Scene, viewport: Viewport) -> Backdrop:
        """Floor, walls and zones of a window, drawn anew only when one of them is another."""
        loud = scene.is_loud(self.floor)
        key = (viewport, loud, scene.loading_zone, scene.drop_zone)
        drawn, backdrop = self._drawn, self._backdrop
        same = drawn is not None and drawn[0] is scene.maze and drawn[1] is scene.floor and drawn[2] == key
        if backdrop is None or not same:
            backdrop = draw_backdrop(scene, viewport, self.signs, self.palette, loud=loud)
            self._drawn = (scene.maze, scene.floor, key)
            self._backdrop = backdrop
        return backdrop
