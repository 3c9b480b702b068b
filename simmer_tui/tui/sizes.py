"""How the panes divide a terminal of a given size."""

from __future__ import annotations

from dataclasses import dataclass

from simmer_tui.sim.specs import MazeSpec
from simmer_tui.tui.maze.layout import arrange, best_zoom

SIDE_COLUMNS = 50
"""Width of the panels beside the maze."""
PAGES = ("maze", "sensors", "robot", "log")
"""What a small screen shows, one at a time."""
SMALLEST_COLUMNS, SMALLEST_ROWS = 40, 12
_BELOW = 3
"""Rows of console and footer."""
_LOG_ROWS = 6
_ROOM_FOR_BOTH = (110, 30)


@dataclass(frozen=True, slots=True)
class Arrangement:
    """Whether panels stand beside the maze, and how many rows the maze then takes."""

    side_by_side: bool
    maze_rows: int
    too_small: bool


def arrangement(maze: MazeSpec, width: int, height: int) -> Arrangement:
    """The panes of a terminal of `width` columns and `height` rows."""
    side_by_side = width >= _ROOM_FOR_BOTH[0] and height >= _ROOM_FOR_BOTH[1]
    columns = width - SIDE_COLUMNS if side_by_side else width
    rows = height - _BELOW - (_LOG_ROWS if side_by_side else 0)
    zoom = best_zoom(maze, columns, rows)
    wanted = arrange(maze, zoom, columns, rows).virtual_size[1]
    too_small = width < SMALLEST_COLUMNS or height < SMALLEST_ROWS
    return Arrangement(side_by_side, max(min(wanted, rows), 1), too_small)
