"""How the maze and its frame divide the cells of a widget."""

from __future__ import annotations

import math
from dataclasses import dataclass

from simmer_tui.sim.specs import MazeSpec
from simmer_tui.tui.maze.glyphs import Cells, Signs, side_arrow
from simmer_tui.tui.maze.palette import Attribute, Palette, Role
from simmer_tui.tui.maze.viewport import Viewport, maze_cells, zoom_to_fit
from simmer_tui.tui.terminal import GlyphMode

FRAME = 1
"""Cells the frame is wide on every side."""
SMALLEST_COLUMNS, SMALLEST_ROWS = 8, 3
"""A smaller window shows nothing anyone can use."""


@dataclass(frozen=True, slots=True)
class FrameSigns:
    """The characters of the outer wall's edge (clockwise from the left), of its corners (from the
    top left), and of a side behind which the maze goes on."""

    sides: tuple[str, str, str, str]
    corners: tuple[str, str, str, str]
    open_sides: tuple[str, str]


_BLOCKS = FrameSigns(("▐", "▄", "▌", "▀"), ("▗", "▖", "▘", "▝"), ("│", "─"))
_HALVES = FrameSigns(("▐", "▄", "▌", "▀"), ("▄", "▄", "▀", "▀"), ("│", "─"))
_PLAIN = FrameSigns(("#", "#", "#", "#"), ("#", "#", "#", "#"), ("|", "-"))


@dataclass(frozen=True, slots=True)
class Layout:
    """Where things are in a widget of `width` x `height` cells.

    The window onto the maze is `columns` x `rows` cells, one cell in from the top left; the whole
    maze would take `maze_columns` x `maze_rows`.
    """

    zoom: float
    width: int
    height: int
    columns: int
    rows: int
    maze_columns: int
    maze_rows: int

    @property
    def fits(self) -> bool:
        """Whether all of the maze is in the window."""
        return (self.columns, self.rows) == (self.maze_columns, self.maze_rows)

    @property
    def usable(self) -> bool:
        return self.width >= SMALLEST_COLUMNS + 2 * FRAME and self.height >= SMALLEST_ROWS + 2 * FRAME

    @property
    def virtual_size(self) -> tuple[int, int]:
        """(columns, rows) that would show everything."""
        return self.maze_columns + 2 * FRAME, self.maze_rows + 2 * FRAME

    def viewport(self, maze: MazeSpec, left: float, top: float) -> Viewport:
        """The window that begins `left` columns and `top` rows into the maze, or as near as
        there is maze to show."""
        return Viewport(
            self.zoom,
            max(0, min(round(left), self.maze_columns - self.columns)),
            max(0, min(round(top), self.maze_rows - self.rows)),
            self.columns,
            self.rows,
            maze.height,
        )


def best_zoom(maze: MazeSpec, width: int, height: int) -> float:
    """The largest zoom at which a maze and its frame fit into a widget."""
    return zoom_to_fit(maze, max(1, width - 2 * FRAME), max(1, height - 2 * FRAME))


def arrange(maze: MazeSpec, zoom: float, width: int, height: int) -> Layout:
    """As much of the maze as a widget has room for at a zoom."""
    maze_columns, maze_rows = maze_cells(maze, zoom)
    columns = max(0, min(maze_columns, width - 2 * FRAME))
    rows = max(0, min(maze_rows, height - 2 * FRAME))
    return Layout(zoom, width, height, columns, rows, maze_columns, maze_rows)


def draw_frame(cells: Cells, layout: Layout, viewport: Viewport, glyphs: GlyphMode, palette: Palette) -> None:
    """Draw the outer wall's edge around the window; a plain line where the maze goes on."""
    signs = {GlyphMode.ASCII: _PLAIN, GlyphMode.HALF: _HALVES}.get(glyphs, _BLOCKS)
    right, bottom = layout.columns + 1, layout.rows + 1
    left_ends, top_ends = viewport.left == 0, viewport.top == 0
    right_ends = viewport.left + viewport.columns >= layout.maze_columns
    bottom_ends = viewport.top + viewport.rows >= layout.maze_rows
    upright, flat = signs.open_sides
    edge, line = palette[Role.EDGE], palette[Role.GRID]
    dim = Attribute.DIM if palette.is_mono and glyphs is not GlyphMode.ASCII else Attribute.NONE
    for column, ends, sign in ((0, left_ends, signs.sides[0]), (right, right_ends, signs.sides[2])):
        for row in range(1, bottom):
            cells.write(row, column, sign if ends else upright, edge if ends else line, dim)
    for row, ends, sign in ((0, top_ends, signs.sides[1]), (bottom, bottom_ends, signs.sides[3])):
        cells.write(row, 1, (sign if ends else flat) * layout.columns, edge if ends else line, dim)
    corners = ((0, 0), (0, right), (bottom, right), (bottom, 0))
    closed = (
        left_ends and top_ends,
        right_ends and top_ends,
        right_ends and bottom_ends,
        left_ends and bottom_ends,
    )
    for (row, column), sign, whole in zip(corners, signs.corners, closed, strict=True):
        cells.write(row, column, sign if whole else " ", edge, dim)


def point_outside(
    cells: Cells, layout: Layout, viewport: Viewport, place: tuple[float, float], signs: Signs, color: int
) -> None:
    """Put an arrow on the frame for a place outside the window; nothing for one inside."""
    x, y = viewport.place(*place)
    column, row = math.floor(x), math.floor(y / 2)
    inner_column = min(max(column, 0), layout.columns - 1)
    inner_row = min(max(row, 0), layout.rows - 1)
    beyond_x, beyond_y = column - inner_column, row - inner_row
    if not beyond_x and not beyond_y:
        return
    # One arrow can name one side: the one it is further away from, as it looks on the screen.
    at_column, at_row = inner_column + 1, inner_row + 1
    if abs(beyond_x) >= 2 * abs(beyond_y):
        beyond_y, at_column = 0, at_column + (1 if beyond_x > 0 else -1)
    else:
        beyond_x, at_row = 0, at_row + (1 if beyond_y > 0 else -1)
    cells.write(at_row, at_column, side_arrow(signs, beyond_x, beyond_y), color, Attribute.BOLD)
