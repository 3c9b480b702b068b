"""The whole maze, small, in a corner of a view that shows a part of it."""

from __future__ import annotations

import math

from simmer_tui.tui.maze.glyphs import Cells, blank_cells
from simmer_tui.tui.maze.layout import FRAME, Layout, arrange, best_zoom, draw_frame
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.palette import DEFAULT, Role
from simmer_tui.tui.maze.scene import FloorMode, Scene
from simmer_tui.tui.maze.viewport import Viewport
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

_SHARE = 3
"""It takes at most this part of the view each way."""
_LEAST_COLUMNS, _LEAST_ROWS = 8, 3
"""A smaller one would show nothing; so it does in a view that is not three times as large."""


class Overview:
    """Draws the small picture: walls, robot, block and zones, and what part of them the view shows."""

    def __init__(self, glyphs: GlyphMode, depth: ColorDepth) -> None:
        self.painter = Painter(glyphs, depth)
        self.painter.floor = FloorMode.QUIET

    def paste(self, cells: Cells, scene: Scene, layout: Layout, window: Viewport) -> None:
        """Put it into the corner that is furthest from the robot, if there is room."""
        width, height = layout.columns // _SHARE, layout.rows // _SHARE
        inset = arrange(scene.maze, best_zoom(scene.maze, width, height), width, height)
        if inset.columns < _LEAST_COLUMNS or inset.rows < _LEAST_ROWS:
            return
        whole = inset.viewport(scene.maze, 0, 0)
        columns, rows = inset.virtual_size
        small = blank_cells(rows, columns)
        small.background[:] = self.painter.palette[Role.BACKGROUND]
        small.paste(self.painter.cells(_bare(scene), whole), FRAME, FRAME)
        draw_frame(small, inset, whole, self.painter.glyphs, self.painter.palette)
        self._outline(small, layout, window, inset)
        x, y = window.place(scene.pose.x, scene.pose.y)
        left = FRAME if x > layout.columns / 2 else FRAME + layout.columns - columns
        top = FRAME if y / 2 > layout.rows / 2 else FRAME + layout.rows - rows
        if not self.painter.signs.has_blocks:
            # A frame of letters needs a margin to be told from the maze under it.
            for row in range(max(top - 1, FRAME), min(top + rows + 1, FRAME + layout.rows)):
                cells.write(row, max(left - 1, FRAME), " " * min(columns + 2, layout.columns))
        cells.paste(small, top, left)

    def _outline(self, small: Cells, layout: Layout, window: Viewport, inset: Layout) -> None:
        """Corners around what the view shows."""
        scale = inset.zoom / layout.zoom
        left = FRAME + math.floor(window.left * scale)
        top = FRAME + math.floor(window.top * scale)
        right = FRAME + min(math.ceil((window.left + window.columns) * scale), inset.columns) - 1
        bottom = FRAME + min(math.ceil((window.top + window.rows) * scale), inset.rows) - 1
        signs = "┌┐└┘" if self.painter.signs.has_blocks else "++++"
        color = self.painter.palette[Role.TEXT]
        for (row, column), sign in zip(
            ((top, left), (top, right), (bottom, left), (bottom, right)), signs, strict=True
        ):
            if small.foreground[row, column] != self.painter.palette[Role.HEADING] or color == DEFAULT:
                small.write(row, column, sign, color)


def _bare(scene: Scene) -> Scene:
    """A scene without what would be noise in few cells. The maze and floor stay the same objects."""
    return Scene(
        maze=scene.maze,
        floor=scene.floor,
        robot=scene.robot,
        pose=scene.pose,
        block_centre=scene.block_centre,
        block_size=scene.block_size,
        block_held=scene.block_held,
        loading_zone=scene.loading_zone,
        drop_zone=scene.drop_zone,
        show_robot=scene.show_robot,
    )
