"""The colours of the picture, and fewer of them for terminals that have fewer."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cache

import numpy as np
from numpy.typing import NDArray

from simmer_tui.tui.terminal import ColorDepth

Color = tuple[int, int, int]

DEFAULT = -1
"""In place of a packed colour: whatever the terminal or the theme uses."""


class Layer(IntEnum):
    """What a dot laid over the picture belongs to. Where two meet, the higher one shows."""

    NOTHING = 0
    PARTICLE = 1
    BELIEF = 2
    RAY = 3
    FLOOR_SPOT = 4
    BLACK_POINT = 5
    SHORTEST_RAY = 6


@dataclass(frozen=True, slots=True)
class Palette:
    """The colours of everything drawn. `layers` are those of `Layer`, in its order.

    `exact` colours are never mixed: what covers half a pixel fills it, and nothing shines through.
    """

    white_tile: Color
    black_tile: Color
    wall: Color
    block: Color
    block_edge: Color
    block_alpha: float
    robot: Color
    robot_edge: Color
    robot_alpha: float
    mark: Color
    trail: Color
    contact: Color
    past_contact: Color
    layers: tuple[Color, ...]
    exact: bool = False


MIXED = Palette(
    white_tile=(255, 255, 255),
    black_tile=(211, 211, 211),
    wall=(0, 0, 0),
    block=(255, 210, 0),
    block_edge=(168, 120, 0),
    block_alpha=0.6,
    robot=(0, 200, 70),
    robot_edge=(0, 95, 35),
    robot_alpha=0.5,
    mark=(0, 30, 10),
    trail=(230, 40, 40),
    contact=(255, 95, 0),
    past_contact=(215, 140, 90),
    layers=(
        (0, 0, 0),
        (230, 90, 230),
        (200, 0, 200),
        (255, 145, 135),
        (60, 130, 255),
        (20, 0, 150),
        (225, 0, 0),
    ),
)
"""For 256 colours and more: translucent, with soft edges."""

EXACT = Palette(
    white_tile=(255, 255, 255),
    black_tile=(170, 170, 170),
    wall=(0, 0, 0),
    block=(255, 255, 85),
    block_edge=(255, 255, 85),
    block_alpha=1.0,
    robot=(85, 255, 85),
    robot_edge=(0, 170, 0),
    robot_alpha=1.0,
    mark=(0, 0, 0),
    trail=(255, 85, 85),
    contact=(255, 85, 255),
    past_contact=(170, 85, 0),
    layers=(
        (0, 0, 0),
        (255, 85, 255),
        (170, 0, 170),
        (255, 85, 85),
        (85, 85, 255),
        (0, 0, 0),
        (170, 0, 0),
    ),
    exact=True,
)
"""For 16 colours: the very colours of the usual palette, since a colour in between would be
rounded, white and light grey tiles to the same."""


def palette_for(depth: ColorDepth) -> Palette:
    return EXACT if depth is ColorDepth.COLORS_16 else MIXED


def pack(pixels: NDArray[np.uint8]) -> NDArray[np.int32]:
    """(..., 3) bytes of red, green and blue as (...) integers 0xRRGGBB."""
    wide = pixels.astype(np.int32)
    packed: NDArray[np.int32] = (wide[..., 0] << 16) | (wide[..., 1] << 8) | wide[..., 2]
    return packed


def unpack(packed: NDArray[np.int32]) -> NDArray[np.int32]:
    """The reverse of `pack`, as integers (..., 3)."""
    return np.stack(((packed >> 16) & 255, (packed >> 8) & 255, packed & 255), axis=-1)


def reduce_colors(packed: NDArray[np.int32], depth: ColorDepth) -> NDArray[np.int32]:
    """Packed colours (or `DEFAULT`) replaced by the nearest ones that a depth has."""
    if depth is ColorDepth.TRUECOLOR:
        return packed
    if depth is ColorDepth.NONE:
        return np.full_like(packed, DEFAULT)
    colors, inverse = np.unique(packed, return_inverse=True)
    nearest = _nearest_256(colors) if depth is ColorDepth.COLORS_256 else _nearest_16(colors)
    reduced: NDArray[np.int32] = np.where(colors == DEFAULT, DEFAULT, nearest).astype(np.int32)
    return reduced[inverse.reshape(packed.shape)]


_HUELESS = 24
_CUBE_LEVELS = (0, 95, 135, 175, 215, 255)
_STANDARD_16 = (
    0x000000, 0xAA0000, 0x00AA00, 0xAA5500, 0x0000AA, 0xAA00AA, 0x00AAAA, 0xAAAAAA,
    0x555555, 0xFF5555, 0x55FF55, 0xFFFF55, 0x5555FF, 0xFF55FF, 0x55FFFF, 0xFFFFFF,
)  # fmt: skip


@cache
def _cube_table() -> NDArray[np.int32]:
    """For each byte, the nearest level of the 6 x 6 x 6 colour cube."""
    levels = np.array(_CUBE_LEVELS)
    nearest: NDArray[np.int32] = levels[np.abs(np.arange(256)[:, None] - levels).argmin(axis=1)]
    return nearest.astype(np.int32)


@cache
def _grey_table() -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """For each byte: the nearest shade of the terminal's 24 greys, black and white, and the shade
    that Rich sends as that entry (it counts entry 231 + g as lightness g / 25, not as 10 g - 2)."""
    steps = np.arange(26)
    shown = np.where(steps == 0, 0, np.where(steps == 25, 255, 10 * steps - 2))
    named = np.round(steps * 255 / 25)
    index = np.abs(np.arange(256)[:, None] - shown).argmin(axis=1)
    return shown[index].astype(np.int32), named[index].astype(np.int32)


def _nearest_256(colors: NDArray[np.int32]) -> NDArray[np.int32]:
    channels = unpack(np.maximum(colors, 0))
    cube = _cube_table()[channels]
    shown, named = _grey_table()
    mean = np.round(channels.mean(axis=-1)).astype(np.int32)
    cube_error = ((channels - cube) ** 2).sum(axis=-1)
    grey_error = ((channels - shown[mean][:, None]) ** 2).sum(axis=-1)
    # The greys lie so close together that they would win over the right hue too often.
    hueless = np.ptp(channels, axis=-1) <= _HUELESS
    # Rich sends every grey as one of the 24 shades, the cube's own greys too.
    grey = (hueless & (grey_error <= cube_error)) | (cube == cube[:, :1]).all(axis=-1)
    chosen = np.where(grey[:, None], named[mean][:, None], cube)
    return pack(chosen.astype(np.uint8))


def _nearest_16(colors: NDArray[np.int32]) -> NDArray[np.int32]:
    standard = np.array(_STANDARD_16, dtype=np.int32)
    difference = unpack(np.maximum(colors, 0))[:, None, :] - unpack(standard)[None, :, :]
    nearest: NDArray[np.int32] = standard[(difference**2).sum(axis=-1).argmin(axis=1)]
    return nearest
