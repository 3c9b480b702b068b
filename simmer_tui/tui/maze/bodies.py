"""Marks drawn in areas: block, robot with its heading, and the mark of a contact."""

import math

import numpy as np

from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import RobotSpec
from simmer_tui.tui.maze.canvas import Canvas, Patch
from simmer_tui.tui.maze.glyphs import Mask, heading_arrow
from simmer_tui.tui.maze.palette import Role
from simmer_tui.tui.maze.scene import MazePoint, Scene
from simmer_tui.tui.maze.shapes import covers, front, is_near, reach, to_local
from simmer_tui.tui.terminal import ColorDepth

# Off the middle, so that of two cells in a row the arrow takes the one in front.
_AHEAD = 0.2
"""Distance of the arrow ahead of the robot's centre, robot radii."""
# The block in the bundled sets is 3 in wide: its middle, and a gap to the rim that can be seen.
_HELD_BEYOND = 1.9
"""Distance of a held block's middle beyond the robot's rim, inches."""
# Longer than the radius, to be told from the rim; shorter than a maze cell.
_NEEDLE = 1.25
"""Length of the needle in robot radii."""
_LEAST_NEEDLE = 1.5
"""Least part of it beyond the cells of the body, units: three dots."""
# The body then has 12 dots across, enough for the shape of an arrow.
_LARGE = 3.0
"""Radius from which the heading is an arrow of dots, and a contact three cells wide, units."""
_THICK = 1.75
"""Units of radius from which the needle is two dots wide."""
# A contact with the outer wall may be computed a rounding error outside the maze.
_ROUNDING = 0.01
"""Cells by which a place may lie outside the window and still belong to it."""
# Below, a turned square of so few pixels has ragged sides that say nothing of its heading (judged).
_ROTATED = 12.0
"""Size of a block from which its own heading is drawn, units."""
_DOT_ARROW = RobotSpec.polygon(
    ((0.84, 0.0), (0.12, 0.62), (0.12, 0.22), (-0.72, 0.22), (-0.72, -0.22), (0.12, -0.22), (0.12, -0.62))
)
"""The arrow in robot radii, front to the right."""

CellRange = tuple[slice, slice]


# -- block and contact -----------------------------------------------------------------------------


def draw_block(canvas: Canvas, scene: Scene) -> None:
    """The block where it lies."""
    if scene.block_centre is None or not is_near(*scene.block_centre):
        return
    x, y = canvas.viewport.place(*scene.block_centre)
    size = scene.block_size * canvas.viewport.scale
    turned = size >= _ROTATED and scene.block_heading % 90 > 1
    patch = _turned_square(canvas, x, y, size, scene.block_heading) if turned else _square(canvas, x, y, size)
    if patch is not None:
        canvas.area(Role.BLOCK, patch)


def draw_contact(canvas: Canvas, scene: Scene, point: MazePoint) -> None:
    """A cross where the robot touched something, beside the robot's arrow."""
    centre = scene.pose.x, scene.pose.y
    if not is_near(*point, *centre):
        return
    x, y = canvas.viewport.place(*point)
    from_x, from_y = canvas.viewport.place(*centre)
    large = reach(scene.robot) * canvas.viewport.scale >= _LARGE
    text = " X " if large and canvas.signs.has_blocks else "X"
    column, row = _cell_inside(x, canvas.columns), _cell_inside(y / 2, canvas.rows)
    if column is None or row is None:
        return
    across, down = (1 if x >= from_x else -1), (1 if y >= from_y else -1)
    step = (0, across) if abs(x - from_x) >= abs(y - from_y) else (down, 0)
    found = _free_cell(canvas.heading, (row, column), step, len(text) // 2)
    if found is not None:
        canvas.text(found[0], found[1] - len(text) // 2, text, Role.BACKGROUND, Role.CONTACT)


def _free_cell(
    taken: Mask, cell: tuple[int, int], step: tuple[int, int], aside: int
) -> tuple[int, int] | None:
    """Cell at which a mark `aside` cells wider to each side covers nothing that is taken: the first
    from `cell` on in steps outwards; where the window ends before, the nearest. None without any."""
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


def _cell_inside(place: float, count: int) -> int | None:
    """Cell of a place among `count`, None outside them; a place on the window's border, give or
    take rounding, belongs to the cell within it."""
    if not -_ROUNDING <= place <= count + _ROUNDING:
        return None
    return min(max(math.floor(place), 0), count - 1)


# -- pixels ----------------------------------------------------------------------------------------


def _cell_range(canvas: Canvas, x: float, y: float, extent: float) -> CellRange | None:
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


def _patch(canvas: Canvas, place: CellRange, mask: Mask) -> Patch:
    """Pixels (rows * down, columns * across) sorted into their cells."""
    signs, (rows, columns) = canvas.signs, place
    height, width = rows.stop - rows.start, columns.stop - columns.start
    cells = mask.reshape(height, signs.down, width, signs.across).transpose(0, 2, 1, 3)
    return Patch(rows.start, columns.start, cells.reshape(height, width, -1))


def _square(canvas: Canvas, x: float, y: float, size: float) -> Patch | None:
    """An upright square, at least a pixel large and the same wherever it stands."""
    signs = canvas.signs
    # Signs fill cells; a part of one cannot be told from anything else there.
    whole = not signs.has_blocks or canvas.palette.is_mono
    across, down = (1, 1) if whole else (signs.across, signs.down)
    wide, high = max(1, round(size * across)), max(1, round(size * down / 2))
    left, top = math.floor(x * across - wide / 2 + 0.5), math.floor(y * down / 2 - high / 2 + 0.5)
    cells = _cell_range(canvas, x, y, size / 2 + 2)
    if cells is None:
        return None
    pixel_x, pixel_y = _pixel_places(cells, signs.across, signs.down)
    in_x = (pixel_x * across >= left) & (pixel_x * across < left + wide)
    in_y = (pixel_y * down / 2 >= top) & (pixel_y * down / 2 < top + high)
    return _patch(canvas, cells, in_y[:, None] & in_x)


def _turned_square(canvas: Canvas, x: float, y: float, size: float, heading: float) -> Patch | None:
    """A square by its heading."""
    cells = _cell_range(canvas, x, y, size)
    if cells is None:
        return None
    local = _local(cells, x, y, heading, canvas.signs.across, canvas.signs.down)
    return _patch(canvas, cells, np.abs(local).max(axis=-1) <= size / 2)


def _local(cells: CellRange, x: float, y: float, heading: float, across: int, down: int) -> FloatArray:
    """Pixels of some cells in the frame of a body, in units, (height, width, 2)."""
    pixel_x, pixel_y = _pixel_places(cells, across, down)
    # A window's rows count down, a body's frame is turned counter-clockwise.
    return to_local(np.stack(np.meshgrid(pixel_x, -pixel_y), axis=-1), Pose(x, -y, heading))


# -- robot -----------------------------------------------------------------------------------------


def draw_robot(canvas: Canvas, scene: Scene) -> None:
    """The robot: body, which way it looks, and what it holds or a needle ahead."""
    pose = scene.pose
    if not is_near(pose.x, pose.y, pose.heading):
        return
    robot = _Robot(canvas, scene)
    if scene.block_held:
        robot.draw_body()
        robot.draw_held(scene.block_size)
    else:
        robot.draw_needle()
        robot.draw_body()


class _Robot:
    """Robot to be drawn. Its centre is moved to whole pixels, so that its outline is the same wherever it
    stands: `x`, `y` and `radius` are in units of the window, `heading` in degrees."""

    def __init__(self, canvas: Canvas, scene: Scene) -> None:
        self.canvas, self.shape = canvas, scene.robot
        self.scale = canvas.viewport.scale
        self.radius = reach(scene.robot) * self.scale
        self.heading = scene.pose.heading
        x, y = canvas.viewport.place(scene.pose.x, scene.pose.y)
        self.x = _to_pixel(x, self.radius, canvas.signs.across, 1.0)
        self.y = _to_pixel(y, self.radius, canvas.signs.down, 2.0)
        self.arrow = heading_arrow(canvas.signs, self.heading)
        self.body = self._body()

    @property
    def direction(self) -> tuple[float, float]:
        """One unit ahead, x right and y down."""
        heading = math.radians(self.heading)
        return math.cos(heading), -math.sin(heading)

    def ahead(self, units: float) -> tuple[float, float]:
        """Place so many units ahead of the centre."""
        across, down = self.direction
        return self.x + units * across, self.y + units * down

    def _local(self, cells: CellRange, across: int, down: int) -> FloatArray:
        return _local(cells, self.x, self.y, self.heading, across, down)

    def _body(self) -> Patch | None:
        """Pixels of the body; one cell, or as many as its arrow takes, where it is smaller."""
        canvas, signs = self.canvas, self.canvas.signs
        cells = _cell_range(canvas, self.x, self.y, self.radius + 1)
        if cells is None:
            return None
        mask = covers(self.shape, self._local(cells, signs.across, signs.down) / self.scale)
        if self.radius >= 1 and mask.any():
            return _patch(canvas, cells, mask)
        row, wide = math.floor(self.y / 2), len(self.arrow)
        column = math.floor(self.x) - (wide - 1) // 2
        if not canvas.holds(row, column) or not canvas.holds(row, column + wide - 1):
            return None
        return Patch(row, column, np.ones((1, wide, signs.pixels), dtype=np.bool_))

    def draw_body(self) -> None:
        """Body and heading."""
        canvas, patch = self.canvas, self.body
        if patch is None:
            return
        canvas.area(Role.ROBOT, patch)
        canvas.robot[patch.place] |= patch.covered.any(axis=-1)
        whole = np.zeros(canvas.robot.shape, dtype=np.bool_)
        whole[patch.place] = patch.covered.all(axis=-1)
        if not canvas.signs.has_blocks:
            self._draw_ends(whole)
        if canvas.signs.dotted and self.radius >= _LARGE:
            self._draw_dot_arrow(whole)
        else:
            self._draw_arrow(patch, whole)

    def _draw_ends(self, whole: Mask) -> None:
        """Brackets around the rows of a body of letters, where the arrow leaves room for them."""
        for row in np.flatnonzero(whole.any(axis=1)).tolist():
            columns = np.flatnonzero(whole[row])
            if len(columns) > 2:
                self.canvas.text(row, int(columns[0]), "(", Role.HEADING, Role.ROBOT)
                self.canvas.text(row, int(columns[-1]), ")", Role.HEADING, Role.ROBOT)

    def _draw_arrow(self, patch: Patch, whole: Mask) -> None:
        """One arrow in the wholly covered cell nearest to a place ahead of the centre."""
        canvas, arrow = self.canvas, self.arrow
        fits = whole.copy()
        for shift in range(1, len(arrow)):
            fits[:, :-shift] &= whole[:, shift:]
            fits[:, -shift:] = False
        if not fits.any():
            # No cell lies wholly in a small body; the one it covers most is filled up.
            counts = np.zeros(whole.shape)
            counts[patch.place] = patch.covered.sum(axis=-1)
            fits[np.unravel_index(counts.argmax(), counts.shape)] = True
        x, y = self.ahead(_AHEAD * self.radius)
        rows, columns = np.nonzero(fits)
        distance = (columns + len(arrow) / 2 - x) ** 2 + (2 * rows + 1 - y) ** 2
        # Of two as near, the one in which the needle begins.
        nearest = len(distance) - 1 - int(distance[::-1].argmin())
        row, column = int(rows[nearest]), int(columns[nearest])
        canvas.text(row, column, arrow, Role.HEADING, Role.ROBOT)
        canvas.robot[row, column : column + len(arrow)] = True
        canvas.heading[row, column : column + len(arrow)] = True

    def _draw_dot_arrow(self, whole: Mask) -> None:
        """A large arrow of dots on the cells that are all body."""
        canvas = self.canvas
        cells = _cell_range(canvas, self.x, self.y, self.radius)
        if cells is None:
            return
        inside = covers(_DOT_ARROW, self._local(cells, 2, 4) / self.radius)
        rows, columns = np.nonzero(inside)
        rows, columns = rows + 4 * cells[0].start, columns + 2 * cells[1].start
        canvas.heading[rows // 4, columns // 2] = True
        np.logical_and(canvas.heading, whole, out=canvas.heading)
        if (canvas.signs.across, canvas.signs.down) == (2, 4):
            canvas.area(Role.HEADING, _patch(canvas, cells, inside), ~whole, Role.ROBOT)
        else:
            canvas.dots(Role.HEADING, np.stack((columns, rows), axis=-1) + 0.5, ~whole, Role.ROBOT)

    def draw_needle(self) -> None:
        """Dots ahead of the robot, up to the next wall. The body comes over their beginning."""
        canvas = self.canvas
        spare = canvas.backdrop.keeps_wall.copy()
        if self.body is not None:
            spare[self.body.place] |= self.body.covered.any(axis=-1)
        rim = front(self.shape) * self.scale
        tip = rim + _NEEDLE * self.radius
        along = np.arange(rim, tip + 4, 0.2)
        across, down = self.direction
        x, y = self.x + along * across, self.y + along * down
        column, row = np.floor(x).astype(np.intp), np.floor(y / 2).astype(np.intp)
        inside = (column >= 0) & (column < canvas.columns) & (row >= 0) & (row < canvas.rows)
        on_body = inside & spare[row.clip(0, canvas.rows - 1), column.clip(0, canvas.columns - 1)]
        tip = max(tip, float(along[int(on_body.argmin())]) + _LEAST_NEEDLE)
        ends = _in_wall(canvas, x, y) | (along > tip)
        dots = 2 * np.stack((x, y), axis=-1)[: int(ends.argmax())]
        if self.radius >= _THICK and canvas.signs.dotted:
            aside = 0.5 * np.array([-down, across])
            dots = np.concatenate((dots - aside, dots + aside))
        canvas.dots(Role.ROBOT, dots, spare)

    def draw_held(self, size: float) -> None:
        """The block in the gripper, ahead of the robot. It takes the cells that are not mostly robot."""
        canvas = self.canvas
        x, y = self.ahead(front(self.shape) * self.scale + max(_HELD_BEYOND * self.scale, 0.75))
        if canvas.palette.depth is ColorDepth.COLORS_16 and canvas.signs.has_blocks:
            # Colours the user has chosen may be too near each other: brackets on the ground are not.
            canvas.text(math.floor(y / 2), round(x - 1), "[]", Role.BLOCK)
            return
        patch = _square(canvas, x, y, size * self.scale)
        if patch is None:
            return
        spare = canvas.heading.copy()
        if self.body is not None:
            spare[self.body.place] |= self.body.covered.mean(axis=-1) > 0.5
        canvas.area(Role.BLOCK, patch, spare)
        canvas.robot[patch.place] &= ~(patch.covered.any(axis=-1) & ~spare[patch.place])


def _to_pixel(place: float, radius: float, pixels: int, cell: float) -> float:
    """Place nearest to `place` at which a body covers whole pixels, of which a cell of so many
    units has `pixels`; and at least one whole cell."""
    pixel = cell / pixels
    count = max(1, round(2 * radius / pixel))
    # A body less than nearly two cells wide has to begin where a cell does.
    step = pixel if count >= 2 * pixels - 1 else cell
    return math.floor((place - count * pixel / 2) / step + 0.5) * step + count * pixel / 2


def _in_wall(canvas: Canvas, x: FloatArray, y: FloatArray) -> Mask:
    """True for places in units of the window that are in a wall or outside the maze."""
    walls, viewport = canvas.backdrop.walls, canvas.viewport
    column = np.floor((x + viewport.left) / viewport.zoom).astype(np.intp)
    row = np.floor((y + 2 * viewport.top) / viewport.zoom).astype(np.intp)
    rows, columns = walls.shape
    outside = (row < 0) | (row >= rows) | (column < 0) | (column >= columns)
    blocked: Mask = outside | walls[row.clip(0, rows - 1), column.clip(0, columns - 1)]
    return blocked
