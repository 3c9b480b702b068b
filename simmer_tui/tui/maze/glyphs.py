"""Terminal cells, and the characters of each glyph mode for areas, lines and directions."""

import itertools
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from simmer_tui.errors import printable
from simmer_tui.sim.angles import ARROWS, eighth_of_turn
from simmer_tui.sim.arrays import BoolArray, FloatArray, NDArray
from simmer_tui.tui.maze.palette import DEFAULT, Role
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

Mask = BoolArray
BLANK = ord(" ")
# The first of the 256 braille patterns of Unicode, the one without a dot.
BRAILLE = 0x2800
# Unicode numbered the fourth row's dots after the older six.
DOT_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.uint32)
"""Bit of each dot of a braille pattern, [row, column]."""


def dot_patterns(dots: FloatArray, rows: int, columns: int) -> NDArray[np.uint32]:
    """Braille pattern of every cell, (rows * columns,), without the offset `BRAILLE`.

    Args:
        dots: places (n, 2), x right and y down, counted in dots, of which a cell has 2 x 4. Those
            outside are left out.
    """
    x, y = np.floor(dots).astype(np.intp).T
    inside = (x >= 0) & (x < 2 * columns) & (y >= 0) & (y < 4 * rows)
    x, y = x[inside], y[inside]
    patterns = np.zeros(rows * columns, dtype=np.uint32)
    np.bitwise_or.at(patterns, (y >> 2) * columns + (x >> 1), DOT_BITS[y & 3, x & 1])
    return patterns


def by_cell(pixels: NDArray[Any], across: int, down: int) -> NDArray[Any]:
    """Pixels (rows * down, columns * across) sorted into cells of `across` x `down`, (rows, columns,
    pixels)."""
    rows, columns = pixels.shape[0] // down, pixels.shape[1] // across
    cells = pixels.reshape(rows, down, columns, across).transpose(0, 2, 1, 3)
    return cells.reshape(rows, columns, -1)


class Cells(Struct, frozen=True, eq=False):
    """A rectangle of terminal cells: code points, packed colours or `DEFAULT`, and `Attribute`
    bits, each (rows, columns)."""

    characters: NDArray[np.uint32]
    foreground: NDArray[np.int32]
    background: NDArray[np.int32]
    attributes: NDArray[np.uint8]

    @property
    def _layers(self) -> tuple[NDArray[Any], ...]:
        return self.characters, self.foreground, self.background, self.attributes

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.characters.shape
        return rows, columns

    def text(self, row: int) -> str:
        """Characters of a row."""
        encoded: bytes = self.characters[row].astype("<u4").tobytes()
        return encoded.decode("utf-32-le")

    def copy(self) -> "Cells":
        return Cells(*(layer.copy() for layer in self._layers))

    def part(self, rows: slice, columns: slice) -> "Cells":
        """A rectangle of it. Its arrays are views."""
        return Cells(*(layer[rows, columns] for layer in self._layers))

    def paste(self, other: "Cells", row: int, column: int) -> None:
        """Copy another rectangle, which must fit, to a place in this one."""
        rows, columns = other.shape
        place = (slice(row, row + rows), slice(column, column + columns))
        for mine, theirs in zip(self._layers, other._layers, strict=True):
            mine[place] = theirs

    def take(self, other: "Cells", where: Mask) -> None:
        """Copy some cells, (rows, columns), of a picture of the same shape."""
        for mine, theirs in zip(self._layers, other._layers, strict=True):
            mine[where] = theirs[where]

    def differs(self, other: "Cells") -> Mask:
        """True where a picture of the same shape has another cell, (rows, columns)."""
        layers = zip(self._layers, other._layers, strict=True)
        changed: Mask = np.any([mine != theirs for mine, theirs in layers], axis=0)
        return changed

    def write(self, row: int, column: int, text: str, color: int = DEFAULT, attribute: int = 0) -> None:
        """Write text on the present background; text beyond the row is cut off."""
        codes = np.array([ord(character) for character in printable(text)], dtype=np.uint32)
        room = self.characters[row, column : column + len(codes)]
        room[:] = codes[: len(room)]
        self.foreground[row, column : column + len(codes)] = color
        self.attributes[row, column : column + len(codes)] = attribute


def blank_cells(rows: int, columns: int) -> Cells:
    """Spaces in the terminal's or theme's own colours."""
    shape = rows, columns
    characters = np.full(shape, BLANK, dtype=np.uint32)
    colors = np.full(shape, DEFAULT, dtype=np.int32)
    return Cells(characters, colors, colors.copy(), np.zeros(shape, dtype=np.uint8))


class Signs(Struct, frozen=True):
    """Characters of a glyph mode.

    A cell has `across` x `down` pixels. `blocks` holds the character of every pattern of them; bit `across *
    y + x` is the pixel in row y. If `dotted`, lines are braille dots, otherwise the sign in `lines` of their
    role. `fills` are the signs of a cell that is all of one role, and the role that colours the sign.
    `arrows` point to 0, 45 ... 315 degrees. `frame` draws the edge of the outer wall: its left, top, right
    and bottom side, and its corners clockwise from the top left. Its last two are an upright and a flat line
    where the maze continues beyond the window. `heats` are the levels of a grid's belief, from possible to
    most likely, and `peak` marks its best cell.
    """

    across: int
    down: int
    blocks: tuple[int, ...]
    dotted: bool
    arrows: tuple[str, ...]
    lines: Mapping[Role, str] = field(default_factory=dict)
    fills: Mapping[Role, tuple[str, Role]] = field(default_factory=dict)
    frame: str = "▐▄▌▀▗▖▘▝│─"
    heats: str = "⡈⢕⣿"
    peak: str = "◆"

    @property
    def pixels(self) -> int:
        """Pixels of a cell."""
        return self.across * self.down

    def by_cell(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Pixels of a picture sorted into its cells: see `by_cell`."""
        return by_cell(pixels, self.across, self.down)

    def patterns(self, shown: Mask) -> NDArray[np.intp]:
        """Patterns of cells that show some of their pixels, (..., pixels): their places in `blocks`."""
        patterns: NDArray[np.intp] = (shown << np.arange(self.pixels)).sum(axis=-1)
        return patterns

    @property
    def has_blocks(self) -> bool:
        """True if areas have a shape within a cell."""
        return self.pixels > 1

    def line(self, role: Role) -> int:
        """Sign of a line, where lines are not dotted."""
        return ord(self.lines[role])


def heading_arrow(signs: Signs, heading: float) -> str:
    """Arrow nearest to a heading (degrees, counter-clockwise from the right)."""
    return signs.arrows[eighth_of_turn(heading)]


def side_arrow(signs: Signs, column: int, row: int) -> str:
    """Single character that points left (column < 0), right, or else up (row < 0) or down."""
    if column:
        return signs.arrows[0][-1] if column > 0 else signs.arrows[4][0]
    return signs.arrows[2 if row < 0 else 6][0]


_PAIRS = ("→", "↑→", "↑", "←↑", "←", "←↓", "↓", "↓→")
_PLAIN_ARROWS = ("->", "^>", "^^", "<^", "<-", "<v", "vv", "v>")
# In signs the ray read last must differ from all other lines, and a belief from everything.
_HALF_LINES = dict.fromkeys(Role, "·") | dict(
    zip((Role.RAY_STRONG, Role.ROBOT, Role.BELIEF, Role.DROP_LINE), "••?/", strict=True)
)
_PLAIN_LINES = dict.fromkeys(Role, ".") | dict(
    zip((Role.RAY_WEAK, Role.RAY_STRONG, Role.ROBOT, Role.BELIEF, Role.DROP_LINE), "'*o?/", strict=True)
)
_PLAIN_FILLS = {
    Role.EDGE: ("#", Role.WALL),
    Role.WALL: (":", Role.GRID),
    Role.LOUD_BLACK: (":", Role.GRID),
    Role.BLOCK: ("B", Role.HEADING),
    Role.ROBOT: ("O", Role.HEADING),
}
_MONO_FILLS = {
    Role.EDGE: ("█", Role.EDGE),
    Role.WALL: ("░", Role.WALL),
    Role.LOUD_BLACK: ("·", Role.GRID),
    Role.BLOCK: ("■", Role.BLOCK),
}
# With 16 colours both tiles have one.
_SIXTEEN_FILLS = {Role.LOUD_BLACK: ("·", Role.GRID)}


# Bits: upper, lower.
_HALVES = tuple(map(ord, " ▀▄█"))
# Bits: upper left, upper right, lower left, lower right.
_QUADRANTS = tuple(map(ord, " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"))


def _sextants() -> tuple[int, ...]:
    """U+1FB00 on, in the order of their patterns, without the four that are older in Unicode."""
    older = {0: " ", 0b010101: "▌", 0b101010: "▐", 0b111111: "█"}
    return _numbered(64, 0x1FB00, {pattern: ord(sign) for pattern, sign in older.items()})


def _octants() -> tuple[int, ...]:
    """U+1CD00 on, in the order of their patterns, without the 26 that are older in Unicode: those
    of quadrants, of whole rows, and of single quarters of a column."""
    older = {0x03: 0x1FB82, 0x3F: 0x1FB85, 0xC0: 0x2582, 0xFC: 0x2586, 0x01: 0x1CEA8}
    older |= {0x02: 0x1CEAB, 0x40: 0x1CEA3, 0x80: 0x1CEA0, 0x14: 0x1FBE6, 0x28: 0x1FBE7}
    for number, code in enumerate(_QUADRANTS):
        corners = (0x05, 0x0A, 0x50, 0xA0)
        older[sum(mask for bit, mask in enumerate(corners) if number >> bit & 1)] = code
    return _numbered(256, 0x1CD00, older)


def _numbered(count: int, first: int, older: Mapping[int, int]) -> tuple[int, ...]:
    """Code points of all patterns: those in `older`, the others in sequence from `first` on."""
    rest = itertools.count(first)
    return tuple(older[pattern] if pattern in older else next(rest) for pattern in range(count))


@cache
def signs_for(glyphs: GlyphMode, depth: ColorDepth) -> Signs:
    """Characters for a terminal's pictures."""
    return replace(_SIGNS[glyphs], fills=_SIGNS[glyphs].fills or _FILLS.get(depth, {}))


_FILLS = {ColorDepth.NONE: _MONO_FILLS, ColorDepth.COLORS_16: _SIXTEEN_FILLS}
_SIGNS = {
    GlyphMode.OCTANT: Signs(2, 4, _octants(), True, ARROWS),
    GlyphMode.SEXTANT: Signs(2, 3, _sextants(), True, ARROWS),
    GlyphMode.QUADRANT: Signs(2, 2, _QUADRANTS, True, ARROWS),
    # WGL4 has no single quadrants for the corners.
    GlyphMode.HALF: Signs(
        1, 2, _HALVES, False, _PAIRS, _HALF_LINES, frame="▐▄▌▀▄▄▀▀│─", heats="░▒▓", peak="♦"
    ),
    # Its fills are the same at every depth: without blocks only they distinguish areas.
    GlyphMode.ASCII: Signs(
        1, 1, (BLANK, ord("#")), False, _PLAIN_ARROWS, _PLAIN_LINES, _PLAIN_FILLS, "########|-", ",%@", "!"
    ),
}
