"""From pixels and dots to terminal cells: one character and two colours each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simmer_tui.tui.maze.palette import DEFAULT, Layer, Palette, pack, reduce_colors
from simmer_tui.tui.terminal import ColorDepth

UPPER_HALF, LOWER_HALF, FULL_BLOCK, BLANK = ord("▀"), ord("▄"), ord("█"), ord(" ")
BRAILLE = 0x2800
_BRAILLE_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.uint32)
_SAME = 24
"""Two halves whose channels differ by no more than this count as one colour under dots."""
_TINT_FIRST, _TINT_MORE = 0.5, 0.15
"""How strongly one dot colours a pixel that cannot hold dots, and every further one."""
_DOTTED = ord(".")
_PARTICLE = ord("*")
_TEXTURE_COLOR = 0x555555


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """A rectangle of terminal cells: code points, and packed colours or `DEFAULT`, (rows, columns)."""

    characters: NDArray[np.uint32]
    foreground: NDArray[np.int32]
    background: NDArray[np.int32]

    @property
    def shape(self) -> tuple[int, int]:
        rows, columns = self.characters.shape
        return rows, columns

    def text(self, row: int) -> str:
        encoded: bytes = self.characters[row].astype("<u4").tobytes()
        return encoded.decode("utf-32-le")

    def paste(self, other: Cells, row: int, column: int) -> None:
        """Copy another rectangle, which must fit, to a place in this one."""
        rows, columns = other.shape
        place = (slice(row, row + rows), slice(column, column + columns))
        self.characters[place] = other.characters
        self.foreground[place] = other.foreground
        self.background[place] = other.background

    def write(self, row: int, column: int, text: str) -> None:
        """Write text in the default colours; what does not fit is cut off."""
        codes = np.array([ord(character) for character in text], dtype=np.uint32)
        room = self.characters[row, column : column + len(codes)]
        room[:] = codes[: len(room)]


def blank_cells(rows: int, columns: int) -> Cells:
    return Cells(
        np.full((rows, columns), BLANK, dtype=np.uint32),
        np.full((rows, columns), DEFAULT, dtype=np.int32),
        np.full((rows, columns), DEFAULT, dtype=np.int32),
    )


def hybrid_cells(
    pixels: NDArray[np.uint8], dots: NDArray[np.uint8], palette: Palette, depth: ColorDepth
) -> Cells:
    """Half blocks, with braille where there are dots and the cell's two halves match.

    `pixels` is (2 * rows, columns, 3), `dots` (4 * rows, 2 * columns) of `Layer`.
    """
    halves = pixels.reshape(-1, 2, *pixels.shape[1:])
    difference = np.abs(halves[:, 0].astype(np.int16) - halves[:, 1])
    fits = (difference <= _SAME).all(axis=-1)
    cells, patterns = _cell_dots(dots)
    if depth is ColorDepth.NONE:
        return _inked(tint(pixels, dots, palette, ~fits), patterns)
    dotted = fits & (patterns > 0)
    result = half_cells(tint(pixels, dots, palette, ~fits), depth)
    # The upper half stands for both: they differ by less than can be seen.
    result.background[dotted] = reduce_colors(pack(halves[:, 0][dotted]), depth)
    layer_colors = reduce_colors(pack(np.array(palette.layers, dtype=np.uint8)), depth)
    result.foreground[dotted] = layer_colors[cells[dotted]]
    result.characters[dotted] = BRAILLE + patterns[dotted]
    return result


def half_cells(pixels: NDArray[np.uint8], depth: ColorDepth) -> Cells:
    """Half blocks from pixels (2 * rows, columns, 3); a cell of one colour is a blank."""
    if depth is ColorDepth.NONE:
        return _inked(pixels, np.zeros((len(pixels) // 2, pixels.shape[1]), dtype=np.uint32))
    colors = reduce_colors(pack(pixels), depth)
    upper, lower = colors[0::2], colors[1::2]
    same = upper == lower
    characters = np.where(same, BLANK, UPPER_HALF).astype(np.uint32)
    return Cells(characters, np.where(same, DEFAULT, upper).astype(np.int32), lower.copy())


def solid_cells(
    pixels: NDArray[np.uint8], background: NDArray[np.uint8], palette: Palette, depth: ColorDepth
) -> Cells:
    """Coloured blanks, one colour a cell: of its two pixels the one that is not background.

    With 16 colours a dark tile also carries a dot, since the Linux console has no bright
    backgrounds: white and light grey tiles look the same there.
    """
    colors = pack(pixels)
    upper, lower = colors[0::2], colors[1::2]
    chosen = reduce_colors(np.where(upper != pack(background)[0::2], upper, lower), depth)
    result = blank_cells(*chosen.shape)
    result.background[:] = chosen
    if depth is ColorDepth.COLORS_16:
        dark = chosen == int(pack(np.array(palette.black_tile, dtype=np.uint8)))
        result.characters[dark] = _DOTTED
        result.foreground[dark] = _TEXTURE_COLOR
    return result


def put_particles(cells: Cells, dots: NDArray[np.uint8], palette: Palette, depth: ColorDepth) -> None:
    """Mark the cells that hold particles and no other dots with a sign. As coloured blanks, some
    dozens of them would hide the maze."""
    there = cell_layers(dots) == Layer.PARTICLE
    color = pack(np.array(palette.layers[Layer.PARTICLE], dtype=np.uint8))
    cells.characters[there] = _PARTICLE
    cells.foreground[there] = int(reduce_colors(color, depth))


def tint(
    pixels: NDArray[np.uint8],
    dots: NDArray[np.uint8],
    palette: Palette,
    where: NDArray[np.bool_] | None = None,
) -> NDArray[np.uint8]:
    """Pixels with the dots mixed into them, in all cells or those of a mask (rows, columns)."""
    if not dots.any():
        return pixels
    height, width = pixels.shape[:2]
    blocks = dots.reshape(height, 2, width, 2)
    layer = blocks.max(axis=(1, 3))
    count = (blocks > 0).sum(axis=(1, 3))
    touched = count > 0
    if where is not None:
        touched &= np.repeat(where, 2, axis=0)
    alpha = np.ones(int(touched.sum())) if palette.exact else _TINT_FIRST + _TINT_MORE * (count[touched] - 1)
    colors = np.array(palette.layers, dtype=np.float64)[layer[touched]]
    result = pixels.copy()
    result[touched] = np.round(pixels[touched] * (1 - alpha[:, None]) + colors * alpha[:, None])
    return result


def cell_layers(dots: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The highest `Layer` in each cell, (rows, columns)."""
    layers: NDArray[np.uint8] = dots.reshape(len(dots) // 4, 4, -1, 2).max(axis=(1, 3))
    return layers


def _cell_dots(dots: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint32]]:
    """For each cell the highest layer in it, and the braille pattern of that layer's dots."""
    layers = cell_layers(dots)
    blocks = dots.reshape(len(dots) // 4, 4, -1, 2)
    shown = (blocks == layers[:, None, :, None]) & (blocks > 0)
    patterns = np.einsum("rycx,yx->rc", shown, _BRAILLE_BITS, dtype=np.uint32)
    return layers, patterns


def _inked(pixels: NDArray[np.uint8], patterns: NDArray[np.uint32]) -> Cells:
    """Without colours: dark pixels drawn, light ones left blank, dots where nothing is drawn."""
    dark = pixels @ np.array([0.299, 0.587, 0.114]) < 128
    upper, lower = dark[0::2], dark[1::2]
    result = blank_cells(*upper.shape)
    dotted = patterns > 0
    result.characters[dotted] = BRAILLE + patterns[dotted]
    result.characters[upper] = UPPER_HALF
    result.characters[lower] = LOWER_HALF
    result.characters[upper & lower] = FULL_BLOCK
    return result
