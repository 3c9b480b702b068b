"""Backdrop: everything that does not move, floor, walls with their edge, zones. Drawn once for every
window."""

import math
from collections.abc import Sequence
from copy import copy

import numpy as np

from simmer_tui.run.belief_grid import Levels
from simmer_tui.sim.arrays import FloatArray, NDArray
from simmer_tui.sim.specs import TILES_PER_CELL, WALL
from simmer_tui.tui.maze.glyphs import BLANK, BRAILLE, DOT_BITS, Cells, Mask, Signs, by_cell
from simmer_tui.tui.maze.heat import HeatNumber
from simmer_tui.tui.maze.palette import FLOORS, HEATS, ZONES, Attribute, Palette, Role
from simmer_tui.tui.maze.scene import Scene, Zones, zones_of
from simmer_tui.tui.maze.viewport import Viewport

Grounds = NDArray[np.uint8]

# Below it a pixel covers so much of the maze that one sample does not represent it.
_FINE = 4.0
"""Zoom below which a pixel takes several samples."""
# 4 x 4 samples give a wall's share of a pixel to 6 %, enough for "more than half".
_SAMPLES = 4
# One diagonal in 8 dots leaves the floor and marks on it visible.
_HATCH = 8
"""Dots from one diagonal of the drop zone's hatching to the next."""
# Without dots, a sign in every fourth cell gives the same slope.
_HATCH_CELLS = 4
_NAMES = {Role.LOADING_LINE: "loading", Role.DROP_LINE: "drop"}


class Backdrop:
    """Picture of everything that does not move, and the data that marks on it need.

    Attributes:
        cells: the picture.
        pixels: `Role` of the ground in every pixel, (rows, columns, pixels a cell).
        under: `Role` on which a mark in a cell lies, (rows, columns); never the wall's edge.
        keeps_wall: cells that are mostly wall; lines leave those alone.
        has_wall: cells that are wall at all.
        named: cells of a zone's name, or of a number of the heat map.
        walls: wall cells of the maze, (maze rows, maze columns), the first row on top.
    """

    def __init__(
        self,
        scene: Scene,
        viewport: Viewport,
        signs: Signs,
        palette: Palette,
        *,
        loud: bool,
        heat: Levels | None = None,
        tinted: bool = True,
    ) -> None:
        """Draw floor, walls and zones of a window. `loud` makes the tiles differ and the zones plain. `heat`
        takes the place of tiles and zones, at each pixel by its level, (pixel rows, pixel columns): as dots,
        and as a tint if `tinted`."""
        self.viewport, self.signs, self.palette = viewport, signs, palette
        self.walls: Mask = np.array(scene.maze.cells) == WALL
        zones = zones_of(scene)
        self.pixels = self._grounds(scene, zones, heat if tinted else None, loud=loud)
        paper, ink = _two_grounds(self.pixels)
        has_edge = (self.pixels == Role.EDGE).any(axis=-1)
        walled = ((self.pixels == Role.EDGE) | (self.pixels == Role.WALL)).mean(axis=-1)
        self.keeps_wall: Mask = walled >= 0.5
        self.has_wall: Mask = walled > 0
        self.under: Grounds = np.where(paper == Role.EDGE, Role.WALL, paper).astype(np.uint8)
        self.named: Mask = np.zeros(self.under.shape, dtype=np.bool_)
        if palette.is_mono:
            # The only ink is that of the walls' edges.
            ink = np.where(ink == Role.EDGE, ink, paper)
        self.cells = self._encoded(paper, ink)
        if heat is not None:
            self._draw_heat(signs.by_cell(heat).max(axis=-1))
        if zones.loading.any() or zones.drop.any():
            self._draw_zones(zones, ~has_edge & (walled == 0))

    def write_numbers(self, numbers: Sequence[HeatNumber]) -> None:
        """Write the numbers of a heat map on the ground, except on walls."""
        for each in numbers:
            place = each.row, slice(each.column - len(each.text) + 1, each.column + 1)
            if not (self.has_wall[place] | self.named[place]).any():
                self.cells.write(each.row, place[1].start, each.text, self.palette[Role.BELIEF])
                self.cells.background[place] = self.palette.array[self.under[place]]
                self.named[place] = True
                # Dots beside a number would be hard to tell from its digits.
                for column in (place[1].start - 1, place[1].stop):
                    if 0 <= column < self.named.shape[1] and not self.has_wall[each.row, column]:
                        self.cells.characters[each.row, column] = BLANK

    def in_wall(self, x: FloatArray, y: FloatArray) -> Mask:
        """True for places in units of the window that are in a wall or outside the maze."""
        view, (rows, columns) = self.viewport, self.walls.shape
        column = np.floor((x + view.left) / view.zoom).astype(np.intp)
        row = np.floor((y + 2 * view.top) / view.zoom).astype(np.intp)
        outside = (row < 0) | (row >= rows) | (column < 0) | (column >= columns)
        blocked: Mask = outside | self.walls[row.clip(0, rows - 1), column.clip(0, columns - 1)]
        return blocked

    def with_loud(self, loud: "Backdrop", where: Mask) -> "Backdrop":
        """The same with the floor of another backdrop in some cells, (rows, columns)."""
        mixed = copy(self)
        mixed.cells, mixed.pixels, mixed.under = self.cells.copy(), self.pixels.copy(), self.under.copy()
        mixed.cells.take(loud.cells, where)
        mixed.pixels[where] = loud.pixels[where]
        mixed.under[where] = loud.under[where]
        return mixed

    def tiles_near(self, x: float, y: float, radius: float) -> Mask:
        """Cells of the tiles whose middle is within `radius` of a place, all in units of the window."""
        view, (rows, columns) = self.viewport, self.under.shape
        tile = view.zoom / TILES_PER_CELL
        middle_x = (np.floor((np.arange(columns) + 0.5 + view.left) / tile) + 0.5) * tile - view.left
        middle_y = (np.floor((2 * np.arange(rows) + 1 + 2 * view.top) / tile) + 0.5) * tile - 2 * view.top
        near: Mask = np.hypot(middle_x - x, middle_y[:, None] - y) <= radius
        return near

    def _places(self, across: int, down: int) -> tuple[FloatArray, FloatArray]:
        """Middles of the window's pixels in maze cells, x and y, `across` x `down` of them a terminal cell.

        There is one more on every side, since an edge depends on its neighbours.
        """
        view = self.viewport
        x = view.left + (np.arange(-1, view.columns * across + 1) + 0.5) / across
        y = view.top + (np.arange(-1, view.rows * down + 1) + 0.5) / down
        return x / view.zoom, 2 * y / view.zoom

    def _grounds(self, scene: Scene, zones: Zones, heat: Levels | None, *, loud: bool) -> Grounds:
        """Role of every pixel's ground, (rows, columns, pixels)."""
        view, across, down = self.viewport, self.signs.across, self.signs.down
        x, y = self._places(across, down)
        wall = self._walls_at(x, y, 1 / (across * view.zoom), 2 / (down * view.zoom))
        # An edge is wall with an open pixel among its eight neighbours.
        around = np.lib.stride_tricks.sliding_window_view(wall, (3, 3))
        open_near = ~around.all(axis=(2, 3))
        wall, x, y = wall[1:-1, 1:-1], x[1:-1], y[1:-1]
        black, white = FLOORS[2:] if loud else FLOORS[:2]
        rows, columns = self.walls.shape
        tile_x = np.floor(x * TILES_PER_CELL).astype(np.intp).clip(0, columns * TILES_PER_CELL - 1)
        tile_y = np.floor(y * TILES_PER_CELL).astype(np.intp).clip(0, rows * TILES_PER_CELL - 1)
        is_white = scene.floor[np.ix_(tile_y, tile_x)] != 0
        ground = np.where(is_white, white, black).astype(np.uint8)
        if view.zoom < _FINE and not loud:
            ground[:] = black  # tiles smaller than pixels would look like noise
        if not loud and heat is None:
            for role, cells in zip(ZONES, (zones.loading, zones.drop), strict=True):
                ground[_cells_at(cells, x, y)] = role
        if heat is not None:
            for level, (dark, bright) in enumerate(HEATS, 1):
                tinted = heat == level
                ground[tinted] = np.where(is_white, bright, dark)[tinted]
        ground[wall] = Role.WALL
        ground[wall & open_near] = Role.EDGE
        return self.signs.by_cell(ground)

    def _walls_at(self, x: FloatArray, y: FloatArray, width: float, height: float) -> Mask:
        """True for each pixel that is wall, by its middle in maze cells, or by most of its area if it covers
        much of the maze. Everything outside the maze is wall."""
        samples = _SAMPLES if width * 2 * _FINE > 1 else 1
        offsets = (np.arange(samples) + 0.5) / samples - 0.5
        sample_x = (x[:, None] + offsets * width).ravel()
        sample_y = (y[:, None] + offsets * height).ravel()
        found = _cells_at(self.walls, sample_x, sample_y, outside=True)
        if samples == 1:
            return found
        filled: Mask = by_cell(found, samples, samples).mean(axis=-1) >= 0.5
        return filled

    def _encoded(self, paper: Grounds, ink: Grounds) -> Cells:
        """Cells from the two grounds that each one shows."""
        colors, signs = self.palette.array, self.signs
        shown = (self.pixels == ink[..., None]) & (ink != paper)[..., None]
        patterns = signs.patterns(shown)
        characters = np.array(signs.blocks, dtype=np.uint32)[patterns]
        foreground = np.where(patterns > 0, colors[ink], colors[paper]).astype(np.int32)
        for role, (sign, color) in signs.fills.items():
            plain = (patterns == 0) & (paper == role)
            characters[plain] = ord(sign)
            foreground[plain] = colors[color]
        attributes = np.zeros(paper.shape, dtype=np.uint8)
        if self.palette.is_mono and signs.has_blocks:
            # Walls must not be brighter than the robot.
            attributes[(paper == Role.WALL) | (ink == Role.EDGE)] = Attribute.DIM
        return Cells(characters, foreground, colors[paper], attributes)

    def _draw_heat(self, levels: Levels) -> None:
        """Draw the levels of a grid's belief as dots, (rows, columns), except on walls."""
        for level, sign in enumerate(self.signs.heats, 1):
            there = (levels == level) & ~self.has_wall
            self.cells.characters[there] = ord(sign)
            self.cells.foreground[there] = self.palette[Role.HEAT_DOTS]
            self.cells.background[there] = self.palette.array[self.under[there]]

    # -- zones -----------------------------------------------------------------------------------

    def _draw_zones(self, zones: Zones, free: Mask) -> None:
        """Outline, hatching and names, in cells that are `free` of walls."""
        x, y = self._places(2, 4)
        loading = _cells_at(zones.loading, x, y)
        inner = loading[1:-1, 1:-1]
        inside = loading[:-2, 1:-1] & loading[2:, 1:-1] & loading[1:-1, :-2] & loading[1:-1, 2:]
        self._put_dots(inner & ~inside, Role.LOADING_LINE, free)
        drop = _cells_at(zones.drop, x, y)[1:-1, 1:-1]
        column = np.arange(drop.shape[1]) + 2 * self.viewport.left
        row = np.arange(drop.shape[0])[:, None] + 4 * self.viewport.top
        slope = (column + row) % _HATCH if self.signs.dotted else (column // 2 + row // 4) % _HATCH_CELLS
        self._put_dots(drop & (slope == 0), Role.DROP_LINE, free)
        for role, cells in ((Role.LOADING_LINE, zones.loading), (Role.DROP_LINE, zones.drop)):
            if cells.any():
                self._put_name(cells, role)

    def _put_dots(self, dots: Mask, role: Role, free: Mask) -> None:
        """Draw dots, or signs in their place, in cells that are `free`."""
        patterns = (by_cell(dots, 2, 4) * DOT_BITS.ravel()).sum(axis=-1, dtype=np.uint32)
        there = (patterns > 0) & free
        cells = self.cells
        if self.signs.dotted:
            cells.characters[there] = BRAILLE + patterns[there]
        elif role is Role.LOADING_LINE and not self.signs.has_blocks:
            cells.characters[there] = _plain_lines(patterns[there])
        else:
            cells.characters[there] = self.signs.line(role)
        cells.foreground[there] = self.palette[role]
        cells.background[there] = self.palette.array[self.under[there]]

    def _put_name(self, cells: Mask, role: Role) -> None:
        """Write a zone's name into its first row, if there is room for it."""
        view = self.viewport
        row, first = np.argwhere(cells)[0].tolist()
        last = first
        while last + 1 < cells.shape[1] and cells[row, last + 1]:
            last += 1
        text = f" {_NAMES[role]} "
        left = math.ceil(first * view.zoom - view.left)
        room = math.floor((last + 1) * view.zoom - view.left) - left
        at = left + 1 if role is Role.LOADING_LINE else left + (room - len(text) + 1) // 2
        line = math.ceil(row * view.zoom / 2 - view.top)
        rows, columns = self.cells.shape
        if len(text) > room or not 0 <= line < rows or at < 0 or at + len(text) > columns:
            return
        place = (line, slice(at, at + len(text)))
        self.cells.characters[place] = BLANK
        self.cells.write(line, at, text, self.palette[role])
        self.cells.background[place] = self.palette.array[self.under[place]]
        self.named[line, at + 1 : at + len(text) - 1] = True


def _cells_at(cells: Mask, x: FloatArray, y: FloatArray, *, outside: bool = False) -> Mask:
    """Maze cells at places in units of a cell, (y, x); a place outside the maze has the value `outside`."""
    columns = np.floor(x).astype(np.intp).clip(-1, cells.shape[1]) + 1
    rows = np.floor(y).astype(np.intp).clip(-1, cells.shape[0]) + 1
    found: Mask = np.pad(cells, 1, constant_values=outside)[np.ix_(rows, columns)]
    return found


def _two_grounds(pixels: Grounds) -> tuple[Grounds, Grounds]:
    """The two grounds that a cell can show: the commonest except for edges, and the edge or else the next
    commonest. Both are the same if there is only one."""
    present = np.unique(pixels)
    counts = np.stack([(pixels == role).sum(axis=-1) for role in present])
    edges = present == Role.EDGE
    edge_count = counts[edges].sum(axis=0)
    counts[edges] = 0
    first = counts.argmax(axis=0)
    all_edge = edge_count == pixels.shape[-1]
    paper = np.where(all_edge, Role.EDGE, present[first]).astype(np.uint8)
    np.put_along_axis(counts, first[None], 0, axis=0)
    second = np.where(counts.max(axis=0) > 0, present[counts.argmax(axis=0)], paper)
    return paper, np.where(edge_count > 0, Role.EDGE, second).astype(np.uint8)


def _plain_lines(patterns: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Signs that resemble the dots of an outline: `-`, `|`, and `+` for a corner."""
    left, right = (int(DOT_BITS[:, side].sum()) for side in (0, 1))
    upright = ((patterns & left) == left) | ((patterns & right) == right)
    both = (patterns & left > 0) & (patterns & right > 0)
    chosen = np.select([upright & both, upright], [ord("+"), ord("|")], ord("-"))
    return chosen.astype(np.uint32)
