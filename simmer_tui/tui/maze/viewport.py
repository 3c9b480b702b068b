"""Viewport: the part of the maze that is drawn, its scale, and the frame around it.

Lengths on the screen are in units. A unit is the width of a terminal column and half the height of a row,
which is square in nearly every font. A maze cell is `zoom` units wide and high.
"""

import math

import numpy as np
from msgspec import Struct

from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.specs import CELL_SIZE, MazeSpec
from simmer_tui.tui.maze.glyphs import Cells, Signs, side_arrow
from simmer_tui.tui.maze.palette import Attribute, Palette, Role
from simmer_tui.tui.maze.shapes import FAR, near_places

# A cell of 64 columns fills most terminals: a larger one would show nothing more.
LARGEST_ZOOM = 64.0
# Ten maze cells a column: even mazes far larger than any course's have a picture.
SMALLEST_ZOOM = 0.1
# Cells of four and five columns by turns look uneven; smaller ones need the halves in between.
_WHOLE = 4.0
"""From this zoom on zooms are whole numbers of columns."""
# A quarter more: three steps double the size.
_STEP = 1.25
# The edge of the outer wall, drawn around the window.
FRAME_CELLS = 1
"""Cells the frame is wide on every side."""
LEAST_COLUMNS, LEAST_ROWS = 8, 3
"""A smaller window shows nothing useful."""


class Viewport(Struct, frozen=True):
    """Window onto the maze: `columns` x `rows` terminal cells, the first of which is cell
    (`left`, `top`) counted from the maze's top-left corner. `maze_height` is in inches."""

    zoom: float
    left: int
    top: int
    columns: int
    rows: int
    maze_height: float

    @property
    def scale(self) -> float:
        """Units an inch."""
        return self.zoom / CELL_SIZE

    def to_units(self, points: FloatArray) -> FloatArray:
        """Global places (..., 2) in units of this window (..., 2), x right, y down."""
        units = np.empty(points.shape)
        units[..., 0] = points[..., 0] * self.scale - self.left
        units[..., 1] = (self.maze_height - points[..., 1]) * self.scale - 2 * self.top
        return near_places(units)

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Unit coordinates of one global place."""
        # As `to_units`, without the arrays: a frame asks for a dozen places.
        units = x * self.scale - self.left, (self.maze_height - y) * self.scale - 2 * self.top
        across, down = (min(max(unit, -FAR), FAR) if unit == unit else FAR for unit in units)
        return across, down

    def to_inches(self, column: float, row: float) -> tuple[float, float]:
        """Global place (x, y) at a place of this window in terminal columns and rows."""
        return (column + self.left) / self.scale, self.maze_height - 2 * (row + self.top) / self.scale


class Layout(Struct, frozen=True):
    """Division of a widget of `width` x `height` cells.

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
        """True if the whole maze is in the window."""
        return (self.columns, self.rows) == (self.maze_columns, self.maze_rows)

    @property
    def usable(self) -> bool:
        """True if there is room for a picture."""
        return self.width >= LEAST_COLUMNS + 2 * FRAME_CELLS and self.height >= LEAST_ROWS + 2 * FRAME_CELLS

    @property
    def virtual_size(self) -> tuple[int, int]:
        """(columns, rows) that would show everything."""
        return self.maze_columns + 2 * FRAME_CELLS, self.maze_rows + 2 * FRAME_CELLS

    def viewport(self, maze: MazeSpec, left: float, top: float) -> Viewport:
        """Window that begins `left` columns and `top` rows into the maze, or as near as the maze allows."""
        first_column = max(0, min(round(left), self.maze_columns - self.columns))
        first_row = max(0, min(round(top), self.maze_rows - self.rows))
        return Viewport(self.zoom, first_column, first_row, self.columns, self.rows, maze.height)


def arrange(maze: MazeSpec, zoom: float, width: int, height: int) -> Layout:
    """Layout with as much of the maze as fits into a widget at a zoom."""
    # A sum that only rounding makes larger than a whole number needs no further cell.
    maze_columns, maze_rows = math.ceil(maze.columns * zoom - 1e-6), math.ceil(maze.rows * zoom / 2 - 1e-6)
    columns = max(0, min(maze_columns, width - 2 * FRAME_CELLS))
    rows = max(0, min(maze_rows, height - 2 * FRAME_CELLS))
    return Layout(zoom, width, height, columns, rows, maze_columns, maze_rows)


def best_zoom(maze: MazeSpec, width: int, height: int) -> float:
    """Largest zoom at which a maze and its frame fit into a widget."""
    columns, rows = max(1, width - 2 * FRAME_CELLS), max(1, height - 2 * FRAME_CELLS)
    most = max(SMALLEST_ZOOM, min(columns / maze.columns, 2 * rows / maze.rows))
    if most >= _WHOLE:
        return float(math.floor(most))
    return math.floor(2 * most) / 2 if most >= 1 else most


def next_zoom(zoom: float, step: int) -> float:
    """Zoom a step further in (1) or out (-1): a quarter more or less, in whole columns a cell,
    or halves of one for small cells."""
    wanted = zoom * _STEP**step
    if wanted >= 1:
        grain = 1.0 if wanted >= _WHOLE else 0.5
        near = round(wanted / grain) * grain
        beyond = math.floor(zoom / grain) + 1 if step > 0 else math.ceil(zoom / grain) - 1
        wanted = max(near, beyond * grain) if step > 0 else min(near, beyond * grain)
    return min(max(wanted, SMALLEST_ZOOM), LARGEST_ZOOM)


# -- the frame -------------------------------------------------------------------------------------


def draw_frame(
    cells: Cells, layout: Layout, viewport: Viewport, signs: Signs, palette: Palette, role: Role = Role.EDGE
) -> None:
    """Draw the outer wall's edge around the window in the colour of `role`, with a plain line where the maze
    continues."""
    right, bottom = layout.columns + 1, layout.rows + 1
    # Left, top, right, bottom.
    ends = (
        viewport.left == 0,
        viewport.top == 0,
        viewport.left + viewport.columns >= layout.maze_columns,
        viewport.top + viewport.rows >= layout.maze_rows,
    )
    sides, corners, open_sides = signs.frame[:4], signs.frame[4:8], signs.frame[8:]
    edge, line = palette[role], palette[Role.GRID]
    dim = Attribute.DIM if palette.is_mono and signs.has_blocks else Attribute.NONE
    upright, flat = slice(1, bottom), slice(1, right)
    first, last_row, last_column = slice(0, 1), slice(bottom, bottom + 1), slice(right, right + 1)
    places = ((upright, first), (first, flat), (upright, last_column), (last_row, flat))
    for side, place in enumerate(places):
        cells.characters[place] = ord(sides[side] if ends[side] else open_sides[side % 2])
        cells.foreground[place] = edge if ends[side] else line
        cells.attributes[place] = dim
    for corner, (row, column) in enumerate(((0, 0), (0, right), (bottom, right), (bottom, 0))):
        whole = ends[corner] and ends[(corner + 1) % 4]
        cells.write(row, column, corners[corner] if whole else " ", edge, dim)


def point_outside(
    cells: Cells, layout: Layout, viewport: Viewport, place: tuple[float, float], signs: Signs, color: int
) -> None:
    """Put an arrow on the frame for a place outside the window; none for one inside."""
    x, y = viewport.place(*place)
    column, row = math.floor(x), math.floor(y / 2)
    inner_column = min(max(column, 0), layout.columns - 1)
    inner_row = min(max(row, 0), layout.rows - 1)
    beyond_x, beyond_y = column - inner_column, row - inner_row
    if not beyond_x and not beyond_y:
        return
    # One arrow can point over one side only: the one that the place is further away from on the screen.
    at_column, at_row = inner_column + 1, inner_row + 1
    if abs(beyond_x) >= 2 * abs(beyond_y):
        beyond_y, at_column = 0, at_column + (1 if beyond_x > 0 else -1)
    else:
        beyond_x, at_row = 0, at_row + (1 if beyond_y > 0 else -1)
    cells.write(at_row, at_column, side_arrow(signs, beyond_x, beyond_y), color, Attribute.BOLD)
