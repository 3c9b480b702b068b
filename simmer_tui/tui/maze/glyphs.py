"""Terminal cells, and the characters that each glyph mode has for areas, lines and directions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from simmer_tui.tui.maze.palette import DEFAULT, Role
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

BLANK = ord(" ")
BRAILLE = 0x2800
DOT_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.uint32)
"""The bit of each dot of a braille pattern, [row, column]."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """A rectangle of terminal cells: code points, packed colours or `DEFAULT`, and `Attribute`
    bits, each (rows, columns)."""

    characters: NDArray[np.uint32]
    foreground: NDArray[np.int32]
    background: NDArray[np.int32]
    attributes: NDArray[np.uint8]

    @property
    def shape(self) -> tuple[int, int]:
        rows, columns = self.characters.shape
        return rows, columns

    def text(self, row: int) -> str:
        encoded: bytes = self.characters[row].astype("<u4").tobytes()
        return encoded.decode("utf-32-le")

    def copy(self) -> Cells:
        return Cells(
            self.characters.copy(), self.foreground.copy(), self.background.copy(), self.attributes.copy()
        )

    def paste(self, other: Cells, row: int, column: int) -> None:
        """Copy another rectangle, which must fit, to a place in this one."""
        rows, columns = other.shape
        place = (slice(row, row + rows), slice(column, column + columns))
        self.characters[place] = other.characters
        self.foreground[place] = other.foreground
        self.background[place] = other.background
        self.attributes[place] = other.attributes

    def write(self, row: int, column: int, text: str, color: int = DEFAULT, attribute: int = 0) -> None:
        """Write text on the background that is there; what does not fit is cut off."""
        codes = np.array([ord(character) for character in text], dtype=np.uint32)
        room = self.characters[row, column : column + len(codes)]
        room[:] = codes[: len(room)]
        self.foreground[row, column : column + len(codes)] = color
        self.attributes[row, column : column + len(codes)] = attribute


def blank_cells(rows: int, columns: int) -> Cells:
    return Cells(
        np.full((rows, columns), BLANK, dtype=np.uint32),
        np.full((rows, columns), DEFAULT, dtype=np.int32),
        np.full((rows, columns), DEFAULT, dtype=np.int32),
        np.zeros((rows, columns), dtype=np.uint8),
    )


@dataclass(frozen=True, slots=True)
class Signs:
    """What a glyph mode draws with.

    A cell has `across` x `down` pixels; `blocks` holds the character of every pattern of them, bit
    `across * y + x` standing for the pixel in row y. Where `dotted`, lines are braille dots, else
    the sign in `lines` of their role. `fills` are the signs of a cell that is all of one role, and
    the role that colours the sign. `arrows` point to 0, 45 ... 315 degrees.
    """

    across: int
    down: int
    blocks: tuple[int, ...]
    dotted: bool
    arrows: tuple[str, ...]
    lines: Mapping[Role, str] = field(default_factory=dict)
    fills: Mapping[Role, tuple[str, Role]] = field(default_factory=dict)

    @property
    def pixels(self) -> int:
        return self.across * self.down

    @property
    def bits(self) -> NDArray[np.uint32]:
        """The bit of each pixel, (pixels,)."""
        return np.left_shift(1, np.arange(self.pixels, dtype=np.uint32)).astype(np.uint32)

    @property
    def has_blocks(self) -> bool:
        """Whether areas have a shape within a cell."""
        return self.pixels > 1

    def line(self, role: Role) -> int:
        """The sign of a line, where lines are not dotted."""
        return ord(self.lines.get(role, self.lines[Role.TRAIL_NEW]))


def heading_arrow(signs: Signs, heading: float) -> str:
    """The arrow nearest to a heading (degrees, counter-clockwise from the right)."""
    return signs.arrows[round(heading / 45) % 8]


def side_arrow(signs: Signs, column: int, row: int) -> str:
    """The one character that points left (column < 0), right, or else up (row < 0) or down."""
    if column:
        return signs.arrows[0][-1] if column > 0 else signs.arrows[4][0]
    return signs.arrows[2 if row < 0 else 6][0]


_ARROWS = ("→", "↗", "↑", "↖", "←", "↙", "↓", "↘")
_PAIRS = ("→", "↑→", "↑", "←↑", "←", "←↓", "↓", "↓→")
_PLAIN_ARROWS = ("->", "^>", "^^", "<^", "<-", "<v", "vv", "v>")
_HALF_LINES = dict.fromkeys(Role, "·") | {
    Role.RAY_STRONG: "•",
    Role.ROBOT: "•",
    Role.BELIEF: "?",
    Role.DROP_LINE: "/",
}
_PLAIN_LINES = dict.fromkeys(Role, ".") | {
    Role.RAY_WEAK: "'",
    Role.RAY_STRONG: "*",
    Role.ROBOT: "o",
    Role.BELIEF: "?",
    Role.DROP_LINE: "/",
}
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


def _quadrants() -> tuple[int, ...]:
    # Bits: upper left, upper right, lower left, lower right.
    return tuple(map(ord, " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"))


def _sextants() -> tuple[int, ...]:
    """U+1FB00 on, in the order of their patterns, without the four that were there before."""
    older = {0: " ", 0b010101: "▌", 0b101010: "▐", 0b111111: "█"}
    return _numbered(64, 0x1FB00, {pattern: ord(sign) for pattern, sign in older.items()})


def _octants() -> tuple[int, ...]:
    """U+1CD00 on, in the order of their patterns, without the 26 that were there before: those
    of quadrants, of whole rows, and of single quarters of a column."""
    older = {
        0x03: 0x1FB82,
        0x3F: 0x1FB85,
        0xC0: 0x2582,
        0xFC: 0x2586,
        0x01: 0x1CEA8,
        0x02: 0x1CEAB,
        0x40: 0x1CEA3,
        0x80: 0x1CEA0,
        0x14: 0x1FBE6,
        0x28: 0x1FBE7,
    }
    for number, code in enumerate(_quadrants()):
        corners = (0x05, 0x0A, 0x50, 0xA0)
        older[sum(mask for bit, mask in enumerate(corners) if number >> bit & 1)] = code
    return _numbered(256, 0x1CD00, older)


def _numbered(count: int, first: int, older: Mapping[int, int]) -> tuple[int, ...]:
    codes = []
    for pattern in range(count):
        codes.append(older.get(pattern, first))
        first += pattern not in older
    return tuple(codes)


@cache
def signs_for(glyphs: GlyphMode, depth: ColorDepth) -> Signs:
    """What a terminal's pictures are made of."""
    fills: Mapping[Role, tuple[str, Role]] = {}
    if depth is ColorDepth.NONE:
        fills = _MONO_FILLS
    elif depth is ColorDepth.COLORS_16:
        # The tiles have one colour there.
        fills = {Role.LOUD_BLACK: ("·", Role.GRID)}
    match glyphs:
        case GlyphMode.OCTANT:
            return Signs(2, 4, _octants(), True, _ARROWS, fills=fills)
        case GlyphMode.SEXTANT:
            return Signs(2, 3, _sextants(), True, _ARROWS, fills=fills)
        case GlyphMode.QUADRANT:
            return Signs(2, 2, _quadrants(), True, _ARROWS, fills=fills)
        case GlyphMode.HALF:
            return Signs(1, 2, tuple(map(ord, " ▀▄█")), False, _PAIRS, _HALF_LINES, fills)
        case GlyphMode.ASCII:
            return Signs(1, 1, (BLANK, ord("#")), False, _PLAIN_ARROWS, _PLAIN_LINES, _PLAIN_FILLS)
