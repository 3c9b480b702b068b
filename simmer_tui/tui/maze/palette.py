"""The colours of the picture in every look and colour depth.

Colours are kept as the entries that a terminal has: a rounded shade could become equal to its neighbour.
Luminance is a chain: floor, block and robot have a contrast of 3:1 each to the next.
"""

from enum import IntEnum, IntFlag, StrEnum
from functools import cache
from typing import Self

import numpy as np
from msgspec import Struct

from simmer_tui.sim.arrays import NDArray
from simmer_tui.tui.terminal import ColorDepth

DEFAULT = -1
"""Stands for the terminal's or the theme's own colour, in place of a packed one."""


class Look(StrEnum):
    """Sets of colours."""

    DARK = "dark"
    LIGHT = "light"
    CONTRAST = "contrast"


# For each look: 24-bit colour, entry of the 256, entry of the 16.
_Entry = tuple[str, int, int]


class Role(IntEnum):
    """Purpose of a colour, with its colours in the looks dark, light and contrast.

    They are chosen by measured contrast and CIEDE2000, also for colour blindness:
    tests/tui/maze/test_palette.py.
    """

    entries: tuple[_Entry, ...]

    def __new__(cls, *entries: _Entry) -> Self:
        """A member numbered from 0 on."""
        role = int.__new__(cls, len(cls.__members__))
        role._value_, role.entries = int(role), entries
        return role

    BACKGROUND = ("0b0e13", 233, 0), ("ffffff", 231, 15), ("000000", 16, 0)
    BARS = ("10141a", 233, 0), ("f6f7f9", 231, 15), ("000000", 16, 0)
    BLACK_TILE = ("11151b", 233, 0), ("eceff2", 254, 15), ("000000", 16, 0)
    WHITE_TILE = ("191e25", 234, 0), ("f9fafb", 255, 15), ("101010", 232, 0)
    LOUD_BLACK = ("080a0d", 232, 0), ("d3d9e0", 252, 15), ("000000", 16, 0)
    LOUD_WHITE = ("2a313b", 236, 0), ("ffffff", 231, 15), ("303030", 236, 0)
    WALL = ("353d49", 237, 8), ("d0d6de", 251, 7), ("303030", 236, 8)
    EDGE = ("8f99a7", 246, 7), ("69737f", 241, 8), ("b8c0c8", 250, 7)
    GRID = ("3a4450", 238, 8), ("c3cad3", 251, 7), ("707070", 242, 8)
    LOADING_GROUND = ("161d2b", 234, 0), ("e8effb", 189, 15), ("000000", 16, 0)
    LOADING_LINE = ("7f93b8", 104, 6), ("5470a5", 61, 4), ("9dbcf5", 111, 6)
    DROP_GROUND = ("15221f", 234, 0), ("e6f3ee", 194, 15), ("000000", 16, 0)
    DROP_LINE = ("5d8f80", 72, 2), ("3f7a68", 29, 2), ("7fcbb0", 79, 2)
    # The last seconds of the trail, and all of it before.
    TRAIL_NEW = ("afafff", 147, 12), ("153f9f", 19, 6), ("b4c9ff", 147, 12)
    TRAIL = ("5f87ff", 69, 12), ("3066e4", 26, 6), ("5c8bfc", 69, 12)
    RAY_WEAK = ("87875f", 101, 8), ("837838", 94, 8), ("98945c", 101, 8)
    RAY_STRONG = ("ffd75f", 221, 15), ("554100", 22, 8), ("ffe45e", 221, 15)
    BLOCK = ("b2780b", 136, 3), ("aa6619", 130, 5), ("b2780b", 136, 3)
    ROBOT = ("afffd7", 158, 14), ("112729", 234, 0), ("d8ffe8", 158, 14)
    HEADING = ("04150b", 233, 0), ("ffffff", 231, 15), ("000000", 16, 0)
    BELIEF = ("ffafff", 219, 11), ("4c0083", 53, 4), ("f2a4f4", 219, 11)
    CONTACT = ("d75f87", 168, 9), ("ab4366", 125, 1), ("e86b8f", 168, 9)
    TEXT = ("e2e7ee", 254, 15), ("161b22", 234, 0), ("ffffff", 231, 15)
    DIM_TEXT = ("a3adba", 249, 7), ("46515e", 239, 8), ("d0d6de", 252, 7)
    ACCENT = ("5fd7ff", 81, 10), ("0a5785", 24, 4), ("7fdcff", 117, 14)
    # The state of a run, as ground of row 0, with its text; and the maze's frame at a verdict.
    WAITING = ("2f5d8f", 24, 4), ("2f5d8f", 24, 4), ("1f4d7f", 24, 4)
    PAUSED = ("ffcf5c", 221, 3), ("ffd98a", 222, 3), ("ffcf5c", 221, 3)
    SUCCESS = ("7be3a4", 115, 2), ("bfe8cf", 151, 2), ("7be3a4", 115, 2)
    FAILURE = ("c4302b", 160, 1), ("b3201c", 124, 1), ("b3201c", 124, 1)
    LIGHT_TEXT = ("ffffff", 231, 15), ("ffffff", 231, 15), ("ffffff", 231, 15)
    DARK_TEXT = ("0b0e13", 16, 0), ("0b0e13", 16, 0), ("000000", 16, 0)
    FRAME_SUCCESS = ("7be3a4", 115, 10), ("0f6b3f", 22, 2), ("7be3a4", 115, 10)
    FRAME_FAILURE = ("ff7f76", 210, 9), ("b3201c", 124, 1), ("ff9f98", 210, 9)
    # Words of success, of nearness and of failure: legible as text.
    GOOD = ("7be3a4", 115, 10), ("0b5f3a", 22, 2), ("7be3a4", 115, 10)
    WARNING = ("ffcf5c", 221, 11), ("6f4400", 94, 3), ("ffcf5c", 221, 11)
    DANGER = ("ff7f76", 210, 9), ("a31a17", 124, 1), ("ff9f98", 210, 9)
    # Rings of the radar, at least 3:1 on the background.
    RING = ("5d6876", 242, 8), ("8b95a1", 245, 8), ("9a9a9a", 247, 7)
    # Shares of the time spent, side by side in one bar.
    DRIVING_TIME = ("3f8cff", 69, 12), ("1a5fd8", 26, 4), ("7fb2ff", 111, 12)
    SENSING_TIME = ("ffd76a", 221, 11), ("a06a00", 94, 5), ("ffd76a", 221, 11)
    # A grid's belief on black and white tiles: possible, likely, most likely. With 256 colours the first has
    # no tint, with 16 none has: the numbers show it.
    HEAT_1_BLACK = ("281937", 233, 0), ("eae2f5", 254, 15), ("281937", 16, 0)
    HEAT_1_WHITE = ("301e41", 234, 0), ("f0eaf8", 255, 15), ("301e41", 232, 0)
    HEAT_2_BLACK = ("371849", 53, 0), ("e8d7f7", 189, 15), ("371849", 53, 0)
    HEAT_2_WHITE = ("421d57", 53, 0), ("eee2f9", 189, 15), ("421d57", 53, 0)
    HEAT_3_BLACK = ("48185c", 54, 0), ("e6cafa", 225, 15), ("48185c", 54, 0)
    HEAT_3_WHITE = ("561d6e", 54, 0), ("edd9fb", 225, 15), ("561d6e", 54, 0)
    # Its dots, sparse to dense by level: they are seen where the tints, which leave marks their contrast, are
    # not.
    HEAT_DOTS = ("9a66c0", 97, 5), ("8f52bd", 97, 5), ("a878c8", 134, 5)
    LINK_TIME = ("c4ccd6", 252, 7), ("2b3440", 237, 0), ("e2e7ee", 254, 7)


class Attribute(IntFlag):
    """Properties of a cell besides its colours, as bits."""

    NONE = 0
    BOLD = 1
    DIM = 2
    REVERSE = 4


FLOORS = (Role.BLACK_TILE, Role.WHITE_TILE, Role.LOUD_BLACK, Role.LOUD_WHITE)
ZONES = (Role.LOADING_GROUND, Role.DROP_GROUND)
HEATS = (
    (Role.HEAT_1_BLACK, Role.HEAT_1_WHITE),
    (Role.HEAT_2_BLACK, Role.HEAT_2_WHITE),
    (Role.HEAT_3_BLACK, Role.HEAT_3_WHITE),
)
"""Grounds of a grid's belief, by level and tile."""
GROUNDS = (*FLOORS, *ZONES, Role.WALL)
"""Grounds that a mark may lie on."""

STANDARD_16 = (
    0x000000, 0xAA0000, 0x00AA00, 0xAA5500, 0x0000AA, 0xAA00AA, 0x00AAAA, 0xAAAAAA,
    0x555555, 0xFF5555, 0x55FF55, 0xFFFF55, 0x5555FF, 0xFF55FF, 0x55FFFF, 0xFFFFFF,
)  # fmt: skip
"""The 16 colours as Rich counts them. Each is sent as its number, and the terminal shows the colour that its
user has chosen."""
# The table of 256 colours, as in xterm: 16 of the user's, a cube of 6 x 6 x 6, and 24 greys.
_CUBE_LEVELS = (0, 95, 135, 175, 215, 255)
_FIRST_GREY = 232
_CUBE = 16


class Palette(Struct, frozen=True):
    """Packed colours (0xRRGGBB, or `DEFAULT`) of one look at one depth, by `Role`."""

    look: Look
    depth: ColorDepth
    colors: tuple[int, ...]

    def __getitem__(self, role: Role) -> int:
        return self.colors[role]

    @property
    def array(self) -> NDArray[np.int32]:
        """Colours for looking up many at once, (roles,)."""
        return _array(self.colors)

    @property
    def is_mono(self) -> bool:
        return self.depth is ColorDepth.NONE


# Asked for with every frame.
@cache
def palette_for(depth: ColorDepth, look: Look = Look.DARK) -> Palette:
    """Colours of a look as a terminal of a colour depth can show them."""
    column = list(Look).index(look)
    rows = [role.entries[column] for role in Role]
    match depth:
        case ColorDepth.TRUECOLOR:
            colors = [int(exact, 16) for exact, _, _ in rows]
        case ColorDepth.COLORS_256:
            colors = [_sent_as(index) for _, index, _ in rows]
        case ColorDepth.COLORS_16:
            colors = [STANDARD_16[number] for _, _, number in rows]
        case ColorDepth.NONE:
            colors = [DEFAULT] * len(rows)
    return Palette(look, depth, tuple(colors))


def _sent_as(index: int) -> int:
    """The packed colour that Rich sends as entry `index` (16 to 255) of the 256.

    Rich counts entry 231 + g as lightness g / 25, and every grey as one of those. So the packed colour of a
    grey is not the one that the terminal shows.
    """
    if index >= _FIRST_GREY:
        level = round((index - _FIRST_GREY + 1) * 255 / 25)
        return level << 16 | level << 8 | level
    red, green, blue = (index - _CUBE) // 36, (index - _CUBE) // 6 % 6, (index - _CUBE) % 6
    return _CUBE_LEVELS[red] << 16 | _CUBE_LEVELS[green] << 8 | _CUBE_LEVELS[blue]


@cache
def _array(colors: tuple[int, ...]) -> NDArray[np.int32]:
    return np.array(colors, dtype=np.int32)
