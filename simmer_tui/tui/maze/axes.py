"""How the maze, its axes and its frame divide the cells of a widget."""

from __future__ import annotations

from dataclasses import dataclass

from simmer_tui.sim.specs import CELL_SIZE, MazeSpec
from simmer_tui.tui.maze.glyphs import Cells
from simmer_tui.tui.maze.viewport import ZOOM_LEVELS, Viewport, maze_cells

BOTTOM_ROWS = 2
"""The axis line and the numbers under it."""
SMALLEST_COLUMNS, SMALLEST_ROWS = 8, 4
"""A window smaller than one cell of the maze shows nothing anyone can use."""


@dataclass(frozen=True, slots=True)
class AxisSigns:
    """The characters axes are drawn with."""

    horizontal: str
    vertical: str
    left_tick: str
    bottom_tick: str
    corner: str
    top_left: str
    top_right: str
    bottom_right: str


LINES = AxisSigns("─", "│", "┤", "┬", "┼", "┌", "┐", "┤")
PLAIN_LINES = AxisSigns("-", "|", "+", "+", "+", "+", "+", "+")


@dataclass(frozen=True, slots=True)
class Layout:
    """Where things are in a widget of `width` x `height` cells.

    The window onto the maze is `columns` x `rows` cells at (`x`, `y`); the whole maze would take
    `maze_columns` x `maze_rows`. `framed` tells whether there is room for a line on top of the
    maze and one to its right, `numbers` is the width of the numbers at the left axis.
    """

    zoom: int
    width: int
    height: int
    x: int
    y: int
    columns: int
    rows: int
    maze_columns: int
    maze_rows: int
    numbers: int
    framed: bool

    @property
    def fits(self) -> bool:
        """Whether all of the maze is in the window."""
        return (self.columns, self.rows) == (self.maze_columns, self.maze_rows)

    @property
    def usable(self) -> bool:
        return self.columns >= SMALLEST_COLUMNS and self.rows >= SMALLEST_ROWS

    @property
    def virtual_size(self) -> tuple[int, int]:
        """(columns, rows) that would show everything."""
        frame = int(self.framed)
        return self.numbers + 1 + self.maze_columns + frame, frame + self.maze_rows + BOTTOM_ROWS

    def viewport(self, maze: MazeSpec, left: int, top: int) -> Viewport:
        """The window that begins `left` columns and `top` rows into the maze, or as near as
        there is maze to show."""
        return Viewport(
            self.zoom,
            max(0, min(left, self.maze_columns - self.columns)),
            max(0, min(top, self.maze_rows - self.rows)),
            self.columns,
            self.rows,
            maze.height,
        )


def best_zoom(maze: MazeSpec, width: int, height: int) -> int:
    """The largest zoom at which a maze and its axes fit, or the smallest there is."""
    columns, rows = _room(maze, width, height)
    for zoom in reversed(ZOOM_LEVELS):
        maze_columns, maze_rows = maze_cells(maze, zoom)
        if maze_columns <= columns and maze_rows <= rows:
            return zoom
    return ZOOM_LEVELS[0]


def arrange(maze: MazeSpec, zoom: int, width: int, height: int) -> Layout:
    """Place the maze in the middle of a widget, with as much of it as there is room for."""
    maze_columns, maze_rows = maze_cells(maze, zoom)
    room_columns, room_rows = _room(maze, width, height)
    columns, rows = min(maze_columns, room_columns), min(maze_rows, room_rows)
    framed = room_columns > maze_columns and room_rows > maze_rows
    numbers = _numbers_width(maze)
    spare_columns = max(0, room_columns - columns - int(framed))
    spare_rows = max(0, room_rows - rows - int(framed))
    return Layout(
        zoom=zoom,
        width=width,
        height=height,
        x=numbers + 1 + spare_columns // 2,
        y=int(framed) + spare_rows // 2,
        columns=columns,
        rows=rows,
        maze_columns=maze_columns,
        maze_rows=maze_rows,
        numbers=numbers,
        framed=framed,
    )


def draw_axes(cells: Cells, layout: Layout, viewport: Viewport, signs: AxisSigns) -> None:
    """Draw the lines around the window and the inches along them."""
    left, right = layout.x - 1, layout.x + layout.columns
    bottom = layout.y + layout.rows
    line = signs.horizontal * layout.columns
    for row in range(layout.y, bottom):
        cells.write(row, left, signs.vertical)
        if layout.framed:
            cells.write(row, right, signs.vertical)
    cells.write(bottom, left, signs.corner + line + (signs.bottom_right if layout.framed else ""))
    if layout.framed:
        cells.write(layout.y - 1, left, signs.top_left + line + signs.top_right)
    _draw_left_ticks(cells, layout, viewport, signs)
    _draw_bottom_ticks(cells, layout, viewport, signs)


def _draw_left_ticks(cells: Cells, layout: Layout, viewport: Viewport, signs: AxisSigns) -> None:
    cell_rows = layout.zoom // 2
    maze_rows = layout.maze_rows // cell_rows
    for tick in range(maze_rows + 1):
        # The line between two rows of cells is the lower edge of the upper one.
        row = (maze_rows - tick) * cell_rows - viewport.top
        if not 0 <= row <= layout.rows:
            continue
        y = layout.y + row
        if row < layout.rows:
            # A tick belongs to the border above a row; half a row off is as near as it gets.
            cells.write(y, layout.x - 1, signs.left_tick)
        label = f"{tick * CELL_SIZE:g}".rjust(layout.numbers)
        cells.write(y, layout.x - 1 - layout.numbers, label)


def _draw_bottom_ticks(cells: Cells, layout: Layout, viewport: Viewport, signs: AxisSigns) -> None:
    bottom = layout.y + layout.rows
    for tick in range(layout.maze_columns // layout.zoom + 1):
        column = tick * layout.zoom - viewport.left
        if not 0 <= column <= layout.columns:
            continue
        # The corner is one column left of the maze; the ticks keep that distance, all but the
        # last if the frame's corner is there to take its place.
        x = layout.x + column - 1
        if layout.framed and column == layout.columns:
            x += 1
        elif column > 0:
            cells.write(bottom, x, signs.bottom_tick)
        label = f"{tick * CELL_SIZE:g}"
        start = min(x - len(label) // 2, layout.width - len(label))
        cells.write(bottom + 1, start, label)


def _room(maze: MazeSpec, width: int, height: int) -> tuple[int, int]:
    """(columns, rows) left for the maze beside its axes."""
    return max(0, width - _numbers_width(maze) - 1), max(0, height - BOTTOM_ROWS)


def _numbers_width(maze: MazeSpec) -> int:
    return len(f"{maze.height:g}")
