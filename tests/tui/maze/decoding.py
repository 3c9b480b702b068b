"""Facts read off the cells of a picture: the robot's place, its arrow, its needle."""

from __future__ import annotations

import math
import re

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.specs import MazeSpec
from simmer_tui.tui.maze.glyphs import BRAILLE, DOT_BITS, Cells, Signs
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.palette import Attribute, Role
from simmer_tui.tui.maze.viewport import Viewport, arrange

Places = NDArray[np.float64]
_PLAIN_BODY = r"[(OX]({})[)OX]"


def whole_maze(maze: MazeSpec, zoom: float) -> Viewport:
    """The window that shows all of a maze."""
    return arrange(maze, zoom, 1000, 1000).viewport(maze, 0, 0)


def turned(one: float, other: float) -> float:
    """The angle between two headings, degrees."""
    return abs((one - other + 180) % 360 - 180)


def robot_cells(cells: Cells, painter: Painter) -> NDArray[np.bool_]:
    """The cells in which the robot's colour is seen; without colours those that are reversed, but
    for the mark of a contact."""
    if painter.palette.is_mono:
        reverse = cells.attributes & Attribute.REVERSE > 0
        return reverse & (cells.characters != ord("X"))
    color = painter.palette[Role.ROBOT]
    return (cells.background == color) | ((cells.foreground == color) & (cells.characters != ord(" ")))


def arrow_heading(cells: Cells, painter: Painter) -> float | None:
    """The heading that the arrow on the robot shows, degrees."""
    signs = painter.signs
    if not signs.has_blocks:
        return _plain_arrow(cells, signs)
    hand = hand_heading(cells, painter)
    if hand is not None:
        return hand
    if painter.palette.is_mono:
        there = cells.attributes & (Attribute.REVERSE | Attribute.BOLD) == Attribute.REVERSE | Attribute.BOLD
        there &= cells.characters != ord("X")
    else:
        there = cells.foreground == painter.palette[Role.HEADING]
        there &= cells.background == painter.palette[Role.ROBOT]
    rows, columns = np.nonzero(there & (cells.characters != ord(" ")))
    if not len(rows):
        return None
    text = "".join(chr(cells.characters[row, column]) for row, column in zip(rows, columns, strict=True))
    return 45.0 * signs.arrows.index(text)


def hand_heading(cells: Cells, painter: Painter) -> float | None:
    """The heading that the hand on the robot shows, degrees: where from the middle of the body what is not of
    its colour lies. None for a body too small for a hand."""
    found = _outline(cells, painter)
    if found is None or found[1] < 2.4:
        return None
    signs, body = painter.signs, _robot_pixels(cells, painter)
    middle, radius = found
    all_y, all_x = np.indices(body.shape)
    away_x = (all_x + 0.5) / signs.across - middle[0]
    away_y = 2 * (all_y + 0.5) / signs.down - middle[1]
    dark = ~body & (np.hypot(away_x, away_y) < 0.9 * radius)
    if not dark.any():
        return None
    return math.degrees(math.atan2(-away_y[dark].mean(), away_x[dark].mean()))


def robot_middle(cells: Cells, painter: Painter) -> tuple[float, float] | None:
    """The middle of the robot's body, units; None if there is none."""
    found = _outline(cells, painter)
    return None if found is None else found[0]


def _outline(cells: Cells, painter: Painter) -> tuple[tuple[float, float], float] | None:
    """Middle and radius of the robot's body, units."""
    signs = painter.signs
    rows, columns = np.nonzero(_robot_pixels(cells, painter))
    if not len(rows):
        return None
    x, y = (columns + 0.5) / signs.across, 2 * (rows + 0.5) / signs.down
    middle = (x.min() + x.max()) / 2, (y.min() + y.max()) / 2
    return middle, max(x.max() - x.min() + 1 / signs.across, y.max() - y.min() + 2 / signs.down) / 2


def _robot_pixels(cells: Cells, painter: Painter) -> NDArray[np.bool_]:
    """Pixels of the robot's colour, (rows * pixels down, columns * pixels across)."""
    signs, palette = painter.signs, painter.palette
    known = {code: pattern for pattern, code in enumerate(signs.blocks)}
    found = np.zeros((cells.shape[0], signs.down, cells.shape[1], signs.across), dtype=np.bool_)
    where = robot_cells(cells, painter)
    if palette.is_mono:
        # Cells of the rim are not reversed; the edges of walls are dim, and nothing else is made of pixels.
        where |= (cells.attributes == 0) & np.isin(cells.characters, signs.blocks[1:])
        # Beside the X of a contact.
        where &= (cells.characters != ord(" ")) | (cells.attributes & Attribute.BOLD == 0)
    for row, column in np.argwhere(where):
        pattern = known.get(int(cells.characters[row, column]))
        if pattern is None:
            continue
        bits = [bool(pattern >> bit & 1) for bit in range(signs.pixels)]
        if palette.is_mono:
            solid = bool(cells.attributes[row, column] & Attribute.REVERSE)
        else:
            solid = cells.background[row, column] == palette[Role.ROBOT]
        shape = np.array(bits).reshape(signs.down, signs.across)
        found[row, :, column, :] = ~shape if solid else shape
    return found.reshape(cells.shape[0] * signs.down, cells.shape[1] * signs.across)


def needle_heading(cells: Cells, painter: Painter) -> float | None:
    """The heading that the dots ahead of the robot show, degrees; None where there are none."""
    color = painter.palette[Role.ROBOT]
    dotted = (cells.foreground == color) & (cells.background != color)
    dotted &= (cells.characters > BRAILLE) & (cells.characters < BRAILLE + 256)
    if painter.palette.is_mono or not dotted.any():
        return None
    dots = _dots(cells, dotted)
    middle = _middle(cells, painter)
    ahead = dots.mean(axis=0) - middle
    return math.degrees(math.atan2(-ahead[1], ahead[0]))


def _middle(cells: Cells, painter: Painter) -> Places:
    """The middle of the robot's body, units."""
    color = painter.palette[Role.ROBOT]
    signs = painter.signs
    places = []
    whole = cells.background == color
    for row, column in np.argwhere(robot_cells(cells, painter)):
        character = int(cells.characters[row, column])
        pattern = 2**signs.pixels - 1 if whole[row, column] else 0
        if not pattern and character in signs.blocks:
            pattern = signs.blocks.index(character)
        for pixel in range(signs.pixels):
            if pattern >> pixel & 1:
                x = column + (pixel % signs.across + 0.5) / signs.across
                y = 2 * (row + (pixel // signs.across + 0.5) / signs.down)
                places.append((x, y))
    return np.array(places).mean(axis=0)


def _dots(cells: Cells, where: NDArray[np.bool_]) -> Places:
    """The places of braille dots, units."""
    places = []
    for row, column in np.argwhere(where):
        pattern = int(cells.characters[row, column]) - BRAILLE
        for y in range(4):
            for x in range(2):
                place = (column + (x + 0.5) / 2, 2 * row + (y + 0.5) / 2)
                places += [place] if pattern & int(DOT_BITS[y, x]) else []
    return np.array(places)


def _plain_arrow(cells: Cells, signs: Signs) -> float | None:
    arrows = "|".join(map(re.escape, signs.arrows))
    for row in range(cells.shape[0]):
        found = re.search(_PLAIN_BODY.format(arrows), cells.text(row))
        if found is not None:
            return 45.0 * signs.arrows.index(found.group(1))
    return None
