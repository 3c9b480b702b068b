"""Marks drawn as areas: the block and contacts; and the pixels of bodies."""

import math

import numpy as np

from simmer_tui.sim.arrays import FloatArray, NDArray
from simmer_tui.sim.pose import Pose
from simmer_tui.tui.maze.canvas import Canvas, Patch
from simmer_tui.tui.maze.glyphs import Mask
from simmer_tui.tui.maze.palette import Role
from simmer_tui.tui.maze.scene import MazePoint, Scene
from simmer_tui.tui.maze.shapes import FAR, is_near, turned_into

# A little less than that of the course's robot at ten columns a maze cell: enough for the shape of a hand.
LARGE = 2.49
"""Radius from which the heading is a hand, and a contact three cells wide, units."""
# Less than the thickness of any wall at any zoom, and more than a contact's rounding error.
_PROBE = 0.1
"""Units to each side of a contact at which a wall is searched for."""
# A contact with the outer wall may be computed a rounding error outside the maze.
_ROUNDING = 0.01
"""Cells by which a place may be outside the window and still belong to it."""
# Judged: a smaller turned square has ragged sides that do not show its heading.
_ROTATED = 12.0
"""Size of a block from which its own heading is drawn, units."""
CellRange = tuple[slice, slice]


# -- block and contact -----------------------------------------------------------------------------


def draw_block(canvas: Canvas, scene: Scene) -> None:
    """Draw the block at its place."""
    if scene.block_centre is None or not is_near(*scene.block_centre):
        return
    x, y = canvas.viewport.place(*scene.block_centre)
    size = scene.block_size * canvas.viewport.scale
    turned = size >= _ROTATED and scene.block_heading % 90 > 1
    patch = (
        _turned_square(canvas, x, y, size, scene.block_heading) if turned else square_of(canvas, x, y, size)
    )
    if patch is not None:
        canvas.area(Role.BLOCK, patch)


def draw_past_contacts(canvas: Canvas, scene: Scene) -> None:
    """Small crosses where the robot touched something earlier, one a cell."""
    if not scene.past_contacts:
        return
    # All at once: a program that drives against walls has the most that are marked, in every picture.
    points = np.array(scene.past_contacts)
    places = canvas.viewport.to_units(points[(np.abs(points) < FAR).all(axis=1)])
    # On the ground in front of the wall, since a unit is a column wide and half a row high.
    inside = (places - (0.5, 1.0) * _walls_beside(canvas, places)) / (1, 2)
    size = np.array((canvas.columns, canvas.rows))
    inside = inside[((inside >= -_ROUNDING) & (inside <= size + _ROUNDING)).all(axis=1)]
    columns, rows = np.floor(inside).astype(np.intp).clip(0, size - 1).T
    marked = np.zeros(canvas.contacts.shape, dtype=np.bool_)
    marked[rows, columns] = True
    canvas.sign("×" if canvas.signs.has_blocks else "x", marked, Role.CONTACT)
    canvas.contacts |= marked


def draw_contact(canvas: Canvas, scene: Scene, point: MazePoint) -> None:
    """A cross on what the robot touched last, beside robot and block."""
    centre = scene.pose.x, scene.pose.y
    if not is_near(*point, *centre):
        return
    x, y = canvas.viewport.place(*point)
    from_x, from_y = canvas.viewport.place(*centre)
    right, down = _walls_beside(canvas, np.array([(x, y)]))[0].tolist()
    if not right and not down:
        if abs(x - from_x) >= abs(y - from_y):
            right = 1 if x >= from_x else -1
        else:
            down = 1 if y >= from_y else -1
    column = _cell_inside(x, canvas.columns, 0.5 * right)
    row = _cell_inside(y / 2, canvas.rows, 0.5 * down)
    if column is None or row is None:
        return
    large = scene.robot.reach * canvas.viewport.scale >= LARGE
    text = " X " if large and canvas.signs.has_blocks else "X"
    found = _free_cell(canvas.bodies, (row, column), (down, right), len(text) // 2)
    if found is not None:
        left = found[1] - len(text) // 2
        canvas.text(found[0], left, text, Role.BACKGROUND, Role.CONTACT)
        canvas.contacts[found[0], max(left, 0) : left + len(text)] = True


def _walls_beside(canvas: Canvas, places: FloatArray) -> NDArray[np.intp]:
    """The directions, (n, 2) right and down, to walls that begin at places (n, 2) in units of the window;
    zeros without one."""
    directions = np.array(((1, 0), (-1, 0), (0, 1), (0, -1)))
    probes = places[:, None] + _PROBE * directions
    blocked = canvas.backdrop.in_wall(probes[..., 0], probes[..., 1])
    # In the middle of a wall or of the floor no side is the touched one.
    begins = blocked.any(axis=1, keepdims=True) & ~blocked.all(axis=1, keepdims=True)
    sides: NDArray[np.intp] = directions[blocked.argmax(axis=1)] * begins
    return sides


def _free_cell(
    taken: Mask, cell: tuple[int, int], step: tuple[int, int], aside: int
) -> tuple[int, int] | None:
    """A cell at which a mark `aside` cells wider to each side covers no taken cell.

    It is the first from `cell` on in steps outwards; if the window ends before, the nearest. None without
    any.
    """
    beside = taken.copy()
    for shift in range(1, aside + 1):
        beside[:, :-shift] |= taken[:, shift:]
        beside[:, shift:] |= taken[:, :-shift]
    rows, columns = taken.shape
    row, column = cell
    while 0 <= row < rows and 0 <= column < columns:
        if not beside[row, column]:
            return row, column
        row, column = row + step[0], column + step[1]
    free = np.argwhere(~beside)
    if not len(free):
        return None
    # A cell is two units high.
    away = 4 * (free[:, 0] - cell[0]) ** 2 + (free[:, 1] - cell[1]) ** 2
    row, column = free[int(away.argmin())].tolist()
    return row, column


def _cell_inside(place: float, count: int, beyond: float) -> int | None:
    """The cell so many cells `beyond` a place among `count`; None for a place outside them. A place on the
    window's border, within rounding, belongs to the cell inside."""
    if not -_ROUNDING <= place <= count + _ROUNDING:
        return None
    return min(max(math.floor(place + beyond), 0), count - 1)


# -- pixels ----------------------------------------------------------------------------------------


def cell_range(canvas: Canvas, x: float, y: float, extent: float) -> CellRange | None:
    """Cells of the window within `extent` units of a place."""
    top, bottom = math.floor((y - extent) / 2), math.ceil((y + extent) / 2)
    left, right = math.floor(x - extent), math.ceil(x + extent)
    rows = slice(max(top, 0), min(bottom, canvas.rows))
    columns = slice(max(left, 0), min(right, canvas.columns))
    return (rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None


def _pixel_places(cells: CellRange, across: int, down: int) -> tuple[FloatArray, FloatArray]:
    """Middles of the pixels of some cells in units: x (columns * across), y (rows * down)."""
    rows, columns = cells
    x = (np.arange(columns.start * across, columns.stop * across) + 0.5) / across
    y = 2 * (np.arange(rows.start * down, rows.stop * down) + 0.5) / down
    return x, y


def patch_of(canvas: Canvas, place: CellRange, mask: Mask) -> Patch:
    """Pixels (rows * down, columns * across) sorted into their cells."""
    rows, columns = place
    return Patch(rows.start, columns.start, canvas.signs.by_cell(mask))


def square_of(canvas: Canvas, x: float, y: float, size: float) -> Patch | None:
    """An upright square, at least a pixel large, with the same size wherever it is."""
    signs = canvas.signs
    # Signs fill cells; a part of one would not be recognised there.
    whole = not signs.has_blocks or canvas.palette.is_mono
    across, down = (1, 1) if whole else (signs.across, signs.down)
    wide, high = max(1, round(size * across)), max(1, round(size * down / 2))
    left, top = math.floor(x * across - wide / 2 + 0.5), math.floor(y * down / 2 - high / 2 + 0.5)
    cells = cell_range(canvas, x, y, size / 2 + 2)
    if cells is None:
        return None
    pixel_x, pixel_y = _pixel_places(cells, signs.across, signs.down)
    in_x = (pixel_x * across >= left) & (pixel_x * across < left + wide)
    in_y = (pixel_y * down / 2 >= top) & (pixel_y * down / 2 < top + high)
    return patch_of(canvas, cells, in_y[:, None] & in_x)


def _turned_square(canvas: Canvas, x: float, y: float, size: float, heading: float) -> Patch | None:
    """A square turned to its heading."""
    cells = cell_range(canvas, x, y, size)
    if cells is None:
        return None
    local = local_places(cells, x, y, heading, canvas.signs.across, canvas.signs.down)
    return patch_of(canvas, cells, np.abs(local).max(axis=-1) <= size / 2)


def local_places(cells: CellRange, x: float, y: float, heading: float, across: int, down: int) -> FloatArray:
    """Pixels of some cells in the frame of a body, in units, (height, width, 2)."""
    pixel_x, pixel_y = _pixel_places(cells, across, down)
    # A window's rows count down; a body's frame is turned counter-clockwise.
    return turned_into(Pose(x, -y, heading), pixel_x, -pixel_y[:, None])
