"""The text on a board's display, by what the board tells of its controller's memory.

A line of the memory has 40 characters, of which 16 or 20 are seen. The third row of a display goes on where
the first one ends in the memory, the fourth where the second does.
"""

from __future__ import annotations

from enum import IntEnum

MOST_DISPLAYS = 8
"""Displays of a board that are told apart."""
DISPLAY_COLUMNS, DISPLAY_ROWS = 40, 4
"""The largest display of its controller."""
_ROM = {0x5C: "Y", 0x7E: ">", 0x7F: "<", 0xDF: "\u00b0"}
"""Characters of its ROM that are others than those of ASCII, as near as a terminal has them: yen, arrows,
degree."""
GLYPH = "#"
"""A character that the sketch has drawn itself, or that no terminal has."""


class DisplayChange(IntEnum):
    """Operations on a display (`arduino/board/display.h`)."""

    CELL = 0
    SIZE = 1
    CLEAR = 2
    SHIFT = 3
    ON = 4


class TextDisplay:
    """A display's memory, and the part that is seen."""

    def __init__(self) -> None:
        self._cells = [[" "] * DISPLAY_COLUMNS for _ in range(2)]
        # Without begin() the controller has one row.
        self._columns, self._rows, self._shift = 16, 1, 0
        self._is_on = True

    def change(self, value: int) -> None:
        """Carry out an operation: its kind in the upper byte, its numbers in the others."""
        kind, first, second, third = value >> 24, value >> 16 & 0xFF, value >> 8 & 0xFF, value & 0xFF
        if kind == DisplayChange.CELL:
            self._cells[first % 2][second % DISPLAY_COLUMNS] = _character(third)
        elif kind == DisplayChange.SIZE:
            self._columns, self._rows = min(max(second, 1), DISPLAY_COLUMNS), min(max(third, 1), DISPLAY_ROWS)
        elif kind == DisplayChange.CLEAR:
            self._cells = [[" "] * DISPLAY_COLUMNS for _ in range(2)]
            self._shift = 0
        elif kind == DisplayChange.SHIFT:
            self._shift = third % DISPLAY_COLUMNS
        else:
            self._is_on = bool(third)

    @property
    def rows(self) -> tuple[str, ...]:
        """Its rows as they are seen; blank while it is off."""
        if not self._is_on:
            return (" " * self._columns,) * self._rows
        return tuple(
            "".join(
                self._cells[row % 2][(column + self._shift + row // 2 * self._columns) % DISPLAY_COLUMNS]
                for column in range(self._columns)
            )
            for row in range(self._rows)
        )


def _character(value: int) -> str:
    if value in _ROM:
        return _ROM[value]
    return chr(value) if 0x20 <= value < 0x7E else GLYPH
