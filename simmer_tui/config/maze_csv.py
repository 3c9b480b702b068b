"""maze.csv and the optional floor.csv."""

from pathlib import Path

from msgspec import Struct

from simmer_tui.config.csv_table import read_csv, read_grid
from simmer_tui.errors import Problem
from simmer_tui.sim.rules import IntegerRule, listed
from simmer_tui.sim.specs import BLOCK, CELL_SIZE, EMPTY, START, TILE_SIZE, TILES_PER_CELL, WALL, MazeSpec

FILE = "maze.csv"
FLOOR_FILE = "floor.csv"
# Judged: far beyond the course's 8 by 4 cells, and still drawn and searched without noticeable delay.
MAX_CELLS = 100
"""The most cells a side of the maze may have."""

Grid = tuple[tuple[int, ...], ...]


class CellKind(Struct, frozen=True):
    """A kind of cell. A `letter` marks it in the summary's picture, which explains it by the `label`."""

    name: str
    meaning: str
    letter: str = ""
    label: str = ""


CELLS = {
    WALL: CellKind("wall", "the robot cannot go there; outside of the maze is wall too"),
    EMPTY: CellKind("empty", "free floor"),
    START: CellKind(
        *("robot start", "free; a mission may start in its middle, and a drop zone is one of these"),
        *("s", "start cell"),
    ),
    BLOCK: CellKind("block", "free; the loading zone, where a mission puts the block", "b", "block cell"),
}
"""All kinds of cell, by their value."""

LAYOUT = (
    f"One value for each cell of {CELL_SIZE:g} x {CELL_SIZE:g} in, the top row first; "
    f"at most {MAX_CELLS} cells a side."
)
FLOOR_LAYOUT = (
    f"One value for each tile of {TILE_SIZE:g} x {TILE_SIZE:g} in, {TILES_PER_CELL} by {TILES_PER_CELL} "
    "to a cell: 0 black, 1 white."
)

_CELL = IntegerRule(min(CELLS), max(CELLS), listed(f"{value} ({kind.name})" for value, kind in CELLS.items()))
_TILE = IntegerRule(0, 1, "0 (black) or 1 (white)")


def load_maze(directory: Path, problems: list[Problem]) -> MazeSpec | None:
    """Read maze.csv, and floor.csv if there is one; None, and problems, if either has mistakes."""
    before = len(problems)
    cells = read_cells(directory / FILE, problems)
    floor = _read_floor(directory, cells, problems) if (directory / FLOOR_FILE).exists() else None
    return MazeSpec(cells, floor) if cells is not None and len(problems) == before else None


def read_cells(path: Path, problems: list[Problem]) -> Grid | None:
    """The cells in a file written as maze.csv is, the first row on top; None, and problems, if it has
    mistakes."""
    table = read_csv(path, problems)
    if table is None:
        return None
    rows, columns = len(table.rows), max(len(row.cells) for row in table.rows)
    if rows > MAX_CELLS or columns > MAX_CELLS:
        # One problem, not one for each cell: such a file is probably not a maze.
        what = f"has {rows} x {columns} cells; a maze has at most {MAX_CELLS} a side"
        problems.append(Problem(path.name, what))
        return None
    return read_grid(table, _CELL)


def _read_floor(directory: Path, cells: Grid | None, problems: list[Problem]) -> Grid | None:
    table = read_csv(directory / FLOOR_FILE, problems)
    if table is None:
        return None
    tiles = read_grid(table, _TILE)
    if tiles is not None and cells is not None:
        rows, columns = TILES_PER_CELL * len(cells), TILES_PER_CELL * len(cells[0])
        if (len(tiles), len(tiles[0])) != (rows, columns):
            what = (
                f"has {len(tiles)} x {len(tiles[0])} tiles; the maze needs {rows} x {columns}, "
                f"{TILES_PER_CELL} by {TILES_PER_CELL} to a cell"
            )
            problems.append(Problem(FLOOR_FILE, what))
    return tiles
