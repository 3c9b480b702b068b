"""What one can read off the cells of a picture: the robot's place, its arrow, its needle."""

from __future__ import annotations

import math
import re

import numpy as np
from numpy.typing import NDArray

from simmer_tui.tui.maze.glyphs import BRAILLE, DOT_BITS, Cells, Signs
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.palette import Attribute, Role

Places = NDArray[np.float64]
_PLAIN_BODY = r"[(OX]({})[)OX]"


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
    if painter.palette.is_mono:
        there = cells.attributes & (Attribute.REVERSE | Attribute.BOLD) == Attribute.REVERSE | Attribute.BOLD
        there &= cells.characters != ord("X")
    else:
        there = cells.foreground == painter.palette[Role.HEADING]
        there &= cells.background == painter.palette[Role.ROBOT]
        if signs.pixels == 8:
            there |= cells.background == painter.palette[Role.HEADING]
    dotted = there & (cells.characters > BRAILLE) & (cells.characters < BRAILLE + 256)
    if dotted.sum() >= 3:
        return _dots_heading(_dots(cells, dotted))
    pixels = there & np.isin(cells.characters, signs.blocks) if signs.pixels == 8 else there & False
    if pixels.sum() >= 3:
        return _dots_heading(_pixels(cells, pixels, signs))
    rows, columns = np.nonzero(there & (cells.characters != ord(" ")))
    if not len(rows):
        return None
    text = "".join(chr(cells.characters[row, column]) for row, column in zip(rows, columns, strict=True))
    return 45.0 * signs.arrows.index(text)


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


def _pixels(cells: Cells, where: NDArray[np.bool_], signs: Signs) -> Places:
    places = []
    for row, column in np.argwhere(where):
        pattern = signs.blocks.index(int(cells.characters[row, column]))
        for pixel in range(signs.pixels):
            if pattern >> pixel & 1 or pattern == 0:
                x = column + (pixel % signs.across + 0.5) / signs.across
                places.append((x, 2 * (row + (pixel // signs.across + 0.5) / signs.down)))
    return np.array(places)


def _dots_heading(dots: Places) -> float:
    """Where an arrow of dots points: along its axis, to the side on which it is broader."""
    middle = dots.mean(axis=0)
    away = dots - middle
    _, vectors = np.linalg.eigh(away.T @ away)
    best, most = 0.0, -math.inf
    # A stout arrow's longest axis may lie across; its broad end never does.
    for axis in (*vectors.T, *-vectors.T):
        along, across = away @ axis, np.abs(away @ np.array((-axis[1], axis[0])))
        ahead = across[along > 0].mean() if (along > 0).any() else 0.0
        behind = across[along < 0].mean() if (along < 0).any() else 0.0
        lopsided = abs(float((across * np.sign(away @ np.array((-axis[1], axis[0])))).sum()))
        score = float(ahead - behind) - 0.02 * lopsided
        if score > most:
            best, most = math.degrees(math.atan2(-axis[1], axis[0])), score
    return best


def _plain_arrow(cells: Cells, signs: Signs) -> float | None:
    arrows = "|".join(map(re.escape, signs.arrows))
    for row in range(cells.shape[0]):
        found = re.search(_PLAIN_BODY.format(arrows), cells.text(row))
        if found is not None:
            return 45.0 * signs.arrows.index(found.group(1))
    return None
