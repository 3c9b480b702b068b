"""What stands still: floor, walls with their edge, zones. Drawn once for every window onto the maze."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.specs import TILES_PER_CELL, WALL
from simmer_tui.tui.maze.glyphs import BLANK, BRAILLE, DOT_BITS, Cells, Signs
from simmer_tui.tui.maze.palette import FLOORS, ZONES, Attribute, Palette, Role
from simmer_tui.tui.maze.scene import Scene, Zones, zones_of
from simmer_tui.tui.maze.viewport import Viewport

_FINE = 4.0
"""Below this zoom a pixel holds so much of the maze that one sample of it is a matter of luck."""
_SAMPLES = 4
_HATCH = 8
"""Every so many diagonals of dots the drop zone has one."""
_HATCH_CELLS = 4
_NAMES = {Role.LOADING_LINE: "loading", Role.DROP_LINE: "drop"}


@dataclass(frozen=True, slots=True, eq=False)
class Backdrop:
    """The picture without anything that moves.

    `pixels` (rows, columns, pixels a cell) holds the `Role` of the ground in every pixel, `under`
    (rows, columns) that on which a mark in a cell lies: never the wall's edge. `keeps_wall` tells
    which cells are mostly wall: lines leave those alone. `named` are the cells of a zone's name.
    `walls` is (maze rows, maze columns).
    """

    cells: Cells
    pixels: NDArray[np.uint8]
    under: NDArray[np.uint8]
    keeps_wall: NDArray[np.bool_]
    named: NDArray[np.bool_]
    walls: NDArray[np.bool_]


def draw_backdrop(
    scene: Scene, viewport: Viewport, signs: Signs, palette: Palette, *, loud: bool
) -> Backdrop:
    """Floor, walls and zones of a window. `loud` makes the tiles differ and the zones plain."""
    walls = np.array(scene.maze.cells) == WALL
    zones = zones_of(scene)
    pixels = _grounds(scene, viewport, signs, walls, zones, loud=loud)
    paper, ink = _two_grounds(pixels)
    has_edge = (pixels == Role.EDGE).any(axis=-1)
    walled = ((pixels == Role.EDGE) | (pixels == Role.WALL)).mean(axis=-1)
    under = np.where(paper == Role.EDGE, Role.WALL, paper).astype(np.uint8)
    if palette.is_mono:
        # The only ink there is belongs to the walls' edges.
        ink = np.where(ink == Role.EDGE, ink, paper)
    cells = _encode(pixels, paper, ink, signs, palette)
    named = np.zeros(under.shape, dtype=np.bool_)
    backdrop = Backdrop(cells, pixels, under, walled >= 0.5, named, walls)
    _draw_zones(backdrop, zones, viewport, signs, palette, ~has_edge & (walled == 0))
    return backdrop


def _grounds(
    scene: Scene,
    viewport: Viewport,
    signs: Signs,
    walls: NDArray[np.bool_],
    zones: Zones,
    *,
    loud: bool,
) -> NDArray[np.uint8]:
    """The role of every pixel's ground, (rows, columns, pixels)."""
    zoom, across, down = viewport.zoom, signs.across, signs.down
    # One pixel more on every side, since an edge is where a neighbour is no wall.
    x = (viewport.left + (np.arange(-1, viewport.columns * across + 1) + 0.5) / across) / zoom
    y = 2 * (viewport.top + (np.arange(-1, viewport.rows * down + 1) + 0.5) / down) / zoom
    wall = _walls_at(walls, x, y, 1 / (across * zoom), 2 / (down * zoom))
    open_near = np.zeros(wall[1:-1, 1:-1].shape, dtype=np.bool_)
    height, width = len(y) - 2, len(x) - 2
    for dy in range(3):
        for dx in range(3):
            open_near |= ~wall[dy : dy + height, dx : dx + width]
    wall, x, y = wall[1:-1, 1:-1], x[1:-1], y[1:-1]
    quiet_black, quiet_white, loud_black, loud_white = FLOORS
    black, white = (loud_black, loud_white) if loud else (quiet_black, quiet_white)
    rows, columns = walls.shape
    tile_x = np.floor(x * TILES_PER_CELL).astype(np.intp).clip(0, columns * TILES_PER_CELL - 1)
    tile_y = np.floor(y * TILES_PER_CELL).astype(np.intp).clip(0, rows * TILES_PER_CELL - 1)
    ground = np.where(scene.floor[np.ix_(tile_y, tile_x)] != 0, white, black).astype(np.uint8)
    if zoom < _FINE and not loud:
        ground[:] = black  # tiles smaller than pixels are but noise
    if not loud:
        tint = np.zeros(walls.shape, dtype=np.uint8)
        for role, cells in zip(ZONES, (zones.loading, zones.drop), strict=True):
            for row, column in cells:
                if 0 <= row < rows and 0 <= column < columns:
                    tint[row, column] = role
        tinted = tint[np.ix_((tile_y // TILES_PER_CELL), (tile_x // TILES_PER_CELL))]
        ground = np.where(tinted > 0, tinted, ground)
    ground[wall] = Role.WALL
    ground[wall & open_near] = Role.EDGE
    by_cell = ground.reshape(viewport.rows, down, viewport.columns, across).transpose(0, 2, 1, 3)
    pixels: NDArray[np.uint8] = by_cell.reshape(viewport.rows, viewport.columns, -1)
    return pixels


def _walls_at(
    walls: NDArray[np.bool_],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    width: float,
    height: float,
) -> NDArray[np.bool_]:
    """Whether each pixel is wall, by its middle in maze cells; by most of it where it holds much.
    What lies outside the maze is wall."""
    samples = _SAMPLES if width * 2 * _FINE > 1 else 1
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    rows, columns = walls.shape
    sample_x = np.floor((x[:, None] + offsets * width).ravel()).astype(np.intp)
    sample_y = np.floor((y[:, None] + offsets * height).ravel()).astype(np.intp)
    inside = ((sample_y >= 0) & (sample_y < rows))[:, None] & ((sample_x >= 0) & (sample_x < columns))
    found: NDArray[np.bool_] = (
        ~inside | walls[np.ix_(sample_y.clip(0, rows - 1), sample_x.clip(0, columns - 1))]
    )
    if samples == 1:
        return found
    filled: NDArray[np.bool_] = found.reshape(len(y), samples, len(x), samples).mean(axis=(1, 3)) >= 0.5
    return filled


def _two_grounds(pixels: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The two grounds a cell can show: the commonest but for edges, and the edge or else the next
    commonest. Both are the same where there is but one."""
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


def _encode(
    pixels: NDArray[np.uint8],
    paper: NDArray[np.uint8],
    ink: NDArray[np.uint8],
    signs: Signs,
    palette: Palette,
) -> Cells:
    """Cells from the two grounds each one shows."""
    colors = palette.array
    shown = (pixels == ink[..., None]) & (ink != paper)[..., None]
    patterns = (shown * signs.bits).sum(axis=-1)
    characters = np.array(signs.blocks, dtype=np.uint32)[patterns]
    foreground = np.where(patterns > 0, colors[ink], colors[paper]).astype(np.int32)
    for role, (sign, color) in signs.fills.items():
        plain = (patterns == 0) & (paper == role)
        characters[plain] = ord(sign)
        foreground[plain] = colors[color]
    attributes = np.zeros(paper.shape, dtype=np.uint8)
    if palette.is_mono and signs.has_blocks:
        # So that the walls do not outshine the robot.
        attributes[(paper == Role.WALL) | (ink == Role.EDGE)] = Attribute.DIM
    return Cells(characters, foreground, colors[paper], attributes)


def _draw_zones(
    backdrop: Backdrop,
    zones: Zones,
    viewport: Viewport,
    signs: Signs,
    palette: Palette,
    free: NDArray[np.bool_],
) -> None:
    """Outline, hatching and names, in cells that are `free` of walls."""
    if not zones.loading and not zones.drop:
        return
    x = (viewport.left + (np.arange(-1, 2 * viewport.columns + 1) + 0.5) / 2) / viewport.zoom
    y = 2 * (viewport.top + (np.arange(-1, 4 * viewport.rows + 1) + 0.5) / 4) / viewport.zoom
    loading = _members(zones.loading, backdrop.walls.shape, x, y)
    inner = loading[1:-1, 1:-1]
    inside = loading[:-2, 1:-1] & loading[2:, 1:-1] & loading[1:-1, :-2] & loading[1:-1, 2:]
    _put_dots(backdrop, inner & ~inside, Role.LOADING_LINE, signs, palette, free)
    drop = _members(zones.drop, backdrop.walls.shape, x, y)[1:-1, 1:-1]
    column = np.arange(drop.shape[1]) + 2 * viewport.left
    row = np.arange(drop.shape[0])[:, None] + 4 * viewport.top
    # Where lines are not dots, a sign a cell has to make the same slope.
    diagonal = (column + row) % _HATCH if signs.dotted else (column // 2 + row // 4) % _HATCH_CELLS
    _put_dots(backdrop, drop & (diagonal == 0), Role.DROP_LINE, signs, palette, free)
    for role, cells in ((Role.LOADING_LINE, zones.loading), (Role.DROP_LINE, zones.drop)):
        if cells:
            _put_name(backdrop, cells, role, viewport, palette)


def _members(
    cells: frozenset[tuple[int, int]],
    shape: tuple[int, ...],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Whether each place, in maze cells, lies in one of some cells."""
    member = np.zeros((shape[0] + 2, shape[1] + 2), dtype=np.bool_)
    for row, column in cells:
        if 0 <= row < shape[0] and 0 <= column < shape[1]:
            member[row + 1, column + 1] = True
    columns = np.floor(x).astype(np.intp).clip(-1, shape[1]) + 1
    rows = np.floor(y).astype(np.intp).clip(-1, shape[0]) + 1
    found: NDArray[np.bool_] = member[np.ix_(rows, columns)]
    return found


def _put_dots(
    backdrop: Backdrop,
    dots: NDArray[np.bool_],
    role: Role,
    signs: Signs,
    palette: Palette,
    free: NDArray[np.bool_],
) -> None:
    blocks = dots.reshape(len(dots) // 4, 4, -1, 2)
    patterns = np.einsum("rycx,yx->rc", blocks, DOT_BITS, dtype=np.uint32)
    there = (patterns > 0) & free
    cells = backdrop.cells
    if signs.dotted:
        cells.characters[there] = BRAILLE + patterns[there]
    elif role is Role.LOADING_LINE and not signs.has_blocks:
        cells.characters[there] = _plain_lines(patterns[there])
    else:
        cells.characters[there] = signs.line(role)
    cells.foreground[there] = palette[role]
    cells.background[there] = palette.array[backdrop.under[there]]


def _plain_lines(patterns: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Signs that look like the dots of an outline: `-`, `|`, and `+` for a corner."""
    left, right = (int(DOT_BITS[:, side].sum()) for side in (0, 1))
    upright = ((patterns & left) == left) | ((patterns & right) == right)
    both = (patterns & left > 0) & (patterns & right > 0)
    chosen = np.select([upright & both, upright], [ord("+"), ord("|")], ord("-"))
    return chosen.astype(np.uint32)


def _put_name(
    backdrop: Backdrop,
    cells: frozenset[tuple[int, int]],
    role: Role,
    viewport: Viewport,
    palette: Palette,
) -> None:
    """Write a zone's name into its first row, if there is room for it."""
    row, first = min(cells)
    last = first
    while (row, last + 1) in cells:
        last += 1
    text = f" {_NAMES[role]} "
    left = math.ceil(first * viewport.zoom - viewport.left)
    room = math.floor((last + 1) * viewport.zoom - viewport.left) - left
    at = left + 1 if role is Role.LOADING_LINE else left + (room - len(text) + 1) // 2
    line = math.ceil(row * viewport.zoom / 2 - viewport.top)
    rows, columns = backdrop.cells.shape
    if len(text) > room or not 0 <= line < rows or at < 0 or at + len(text) > columns:
        return
    place = (line, slice(at, at + len(text)))
    backdrop.cells.characters[place] = BLANK
    backdrop.cells.write(line, at, text, palette[role])
    backdrop.cells.background[place] = palette.array[backdrop.under[place]]
    backdrop.named[line, at + 1 : at + len(text) - 1] = True
