"""One frame while it is drawn: marks over the backdrop, each on the ground only.

A cell shows its topmost mark and the ground under it. Marks are drawn from the lowest layer to the highest,
and each replaces earlier ones in its cells.
"""

import numpy as np
from msgspec import Struct

from simmer_tui.sim.arrays import FloatArray, NDArray
from simmer_tui.tui.maze.backdrop import Backdrop
from simmer_tui.tui.maze.glyphs import BLANK, BRAILLE, Cells, Mask, dot_patterns
from simmer_tui.tui.maze.palette import Attribute, Role
from simmer_tui.tui.terminal import ColorDepth

# Without colours the newest ray, a contact and the block have to stand out, and old paths must not.
_BOLD_MONO = (Role.RAY_STRONG, Role.CONTACT, Role.BLOCK, Role.HEADING)
_DIM_MONO = (Role.TRAIL,)
# Without colours only reversing distinguishes a solid body from the floor.
_SOLID = (Role.ROBOT, Role.CONTACT)


class Patch(Struct, frozen=True, eq=False):
    """Rectangle of cells from (`row`, `column`) on, and the pixels that a body covers in them, (rows,
    columns, pixels). It is within the window."""

    row: int
    column: int
    covered: Mask

    @property
    def place(self) -> tuple[slice, slice]:
        """The rectangle as an index into the window's cells."""
        rows, columns, _ = self.covered.shape
        return slice(self.row, self.row + rows), slice(self.column, self.column + columns)


class Canvas:
    """Copy of the backdrop, and the marks drawn over it."""

    def __init__(self, backdrop: Backdrop) -> None:
        self.backdrop = backdrop
        self.viewport, self.signs, self.palette = backdrop.viewport, backdrop.signs, backdrop.palette
        self.cells: Cells = backdrop.cells.copy()
        self.rows, self.columns = self.cells.shape
        self.heading: Mask = np.zeros(self.cells.shape, dtype=np.bool_)
        """Cells that say which way it looks."""
        self.bodies: Mask = np.zeros(self.cells.shape, dtype=np.bool_)
        """Cells of robot and block."""
        self.contacts: Mask = np.zeros(self.cells.shape, dtype=np.bool_)
        """Cells of the marks of contacts."""

    def holds(self, row: int, column: int) -> bool:
        """True for a cell of the window."""
        return 0 <= row < self.rows and 0 <= column < self.columns

    def are_in(self, where: Mask, x: FloatArray, y: FloatArray) -> Mask:
        """True for places in units of the window that lie in some of its cells, (rows, columns)."""
        row, column = np.floor(y / 2).astype(np.intp), np.floor(x).astype(np.intp)
        inside = (row >= 0) & (row < self.rows) & (column >= 0) & (column < self.columns)
        found: Mask = inside & where[row.clip(0, self.rows - 1), column.clip(0, self.columns - 1)]
        return found

    def attribute(self, role: Role, paper: Role | None = None) -> int:
        """Attributes of a mark: they replace colours where there are none."""
        if not self.palette.is_mono:
            # Bold would turn the black of 16 colours into grey.
            bold = role is Role.HEADING or paper is Role.CONTACT
            return Attribute.BOLD if bold and self.palette.depth is not ColorDepth.COLORS_16 else 0
        if not self.signs.has_blocks:
            return Attribute.NONE  # characters differ enough
        attribute = Attribute.BOLD if role in _BOLD_MONO or paper is Role.CONTACT else 0
        attribute |= Attribute.DIM if role in _DIM_MONO else 0
        return attribute | (Attribute.REVERSE if paper in _SOLID else 0)

    def line(self, role: Role, places: FloatArray, spare: Mask | None = None) -> None:
        """Dots at global places (n, 2), in all cells except `spare` (rows, columns)."""
        self.dots(role, 2 * self.viewport.to_units(places), spare)

    def dots(self, role: Role, dots: FloatArray, spare: Mask | None = None) -> None:
        """Dots by their place in dots of the window (n, 2), half a unit apart."""
        if len(dots):
            self.patterns(role, dot_patterns(dots, self.rows, self.columns), spare)

    def patterns(self, role: Role, patterns: NDArray[np.uint32], spare: Mask | None = None) -> None:
        """Dots as the braille pattern of every cell, (rows * columns,)."""
        cells = np.flatnonzero(patterns)
        if spare is not None:
            cells = cells[~spare.reshape(-1)[cells]]
        signs = BRAILLE + patterns[cells] if self.signs.dotted else self.signs.line(role)
        self._put(cells, signs, role)

    def _put(
        self,
        cells: NDArray[np.intp],
        characters: NDArray[np.uint32] | int,
        role: Role,
        paper: Role | None = None,
    ) -> None:
        """Set cells by their number, on the ground or on a `paper` of another role."""
        ground = self.backdrop.under.reshape(-1)[cells] if paper is None else paper
        self.cells.characters.reshape(-1)[cells] = characters
        self.cells.foreground.reshape(-1)[cells] = self.palette[role]
        self.cells.background.reshape(-1)[cells] = self.palette.array[ground]
        self.cells.attributes.reshape(-1)[cells] = self.attribute(role, paper)

    def text(self, row: int, column: int, text: str, role: Role, paper: Role | None = None) -> None:
        """Write characters, on the ground or on a `paper`; those outside are left out."""
        for offset, character in enumerate(text):
            if self.holds(row, column + offset):
                cell = np.array([row * self.columns + column + offset])
                self._put(cell, ord(character), role, paper)

    def sign(self, sign: str, where: Mask, role: Role) -> None:
        """One character in some cells, (rows, columns), on the ground."""
        self._put(np.flatnonzero(where), ord(sign), role)

    def clear(self, where: Mask) -> None:
        """Show only the ground in some cells, (rows, columns)."""
        cells = np.flatnonzero(where)
        self._put(cells, BLANK, Role.TEXT)
        self.cells.attributes[where] = 0

    def area(self, role: Role, patch: Patch, spare: Mask | None = None, paper: Role | None = None) -> None:
        """A body's pixels; the rest of its cells is a `paper`, or the commonest ground there."""
        covered = patch.covered
        if spare is not None:
            covered = covered & ~spare[patch.place][..., None]
        patterns = self.signs.patterns(covered)
        there = patterns > 0
        full = patterns == (1 << self.signs.pixels) - 1
        ground = self.palette.array[self._ground_beside(patch, covered) if paper is None else paper]
        sign, ink = self.signs.fills.get(role, (" ", role))
        characters = np.array(self.signs.blocks, dtype=np.uint32)[patterns]
        characters[full] = ord(sign)
        foreground = np.where(full, self.palette[ink], self.palette[role])
        background = np.where(full, self.palette[role], ground)
        attributes = np.where(full, self.attribute(ink, role), self.attribute(role, paper))
        self.bodies[patch.place] |= there
        self.cells.characters[patch.place][there] = characters[there]
        self.cells.foreground[patch.place][there] = foreground[there]
        self.cells.background[patch.place][there] = background[there]
        self.cells.attributes[patch.place][there] = attributes[there]

    def _ground_beside(self, patch: Patch, covered: Mask) -> NDArray[np.uint8]:
        """Commonest ground among the pixels that a body leaves free in each cell; edges do not count."""
        pixels = self.backdrop.pixels[patch.place]
        free = ~covered & (pixels != Role.EDGE)
        best = self.backdrop.under[patch.place].copy()
        most = np.zeros(best.shape, dtype=np.intp)
        for role in np.flatnonzero(np.bincount(pixels[free])):
            count = ((pixels == role) & free).sum(axis=-1)
            best[count > most] = role
            np.maximum(most, count, out=most)
        return best
