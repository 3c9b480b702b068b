"""One line under the picture that says what is what in it."""

from __future__ import annotations

from dataclasses import dataclass

from simmer_tui.tui.maze.glyphs import Cells, blank_cells, heading_arrow
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.palette import Attribute, Role
from simmer_tui.tui.maze.scene import Scene, zones_of

_DOTS = {
    Role.TRAIL_NEW: "⠒⠂",
    Role.RAY_STRONG: "⠒⠂",
    Role.RAY_WEAK: "⠒⠂",
    Role.LOADING_LINE: "⣏⣹",
    Role.DROP_LINE: "⡠⠊",
}
_PLAIN = {Role.LOADING_LINE: "+-+", Role.DROP_LINE: "//"}


@dataclass(frozen=True, slots=True)
class Piece:
    """A sign of the picture and the word for it. `paper` is what the sign stands on, None for the
    background."""

    sign: str
    role: Role
    word: str
    paper: Role | None = None


def legend(scene: Scene | None, painter: Painter) -> tuple[Piece, ...]:
    """What there is to be explained in a scene, the most needed first."""
    signs = painter.signs
    arrow = heading_arrow(signs, scene.pose.heading if scene is not None else 0.0)
    blocks = signs.has_blocks
    robot = f" {arrow} " if blocks else f"({arrow})"
    pieces = [Piece(robot, Role.HEADING, "robot", Role.ROBOT)]
    if scene is None:
        return tuple(pieces)
    zones = zones_of(scene)
    lines = [(Role.TRAIL_NEW, "trail", scene.show_trail and len(scene.trail) > 0)]
    lines += [(Role.RAY_STRONG, "last ray", scene.show_rays and len(scene.views) > 0)]
    lines += [(Role.RAY_WEAK, "ray", scene.show_rays and len(scene.views) > 1)]
    if scene.belief is not None:
        pieces.append(Piece(arrow if blocks else f"?{arrow}?", Role.BELIEF, "belief"))
    if scene.block_centre is not None:
        pieces.append(Piece("■" if blocks else "BB", Role.BLOCK, "block"))
    if scene.contact is not None:
        pieces.append(Piece("X", Role.BACKGROUND, "contact", Role.CONTACT))
    for role, word, there in lines:
        if there:
            pieces.append(Piece(_line_sign(painter, role), role, word))
    for role, word, cells in (
        (Role.LOADING_LINE, "loading", zones.loading),
        (Role.DROP_LINE, "drop", zones.drop),
    ):
        if cells:
            pieces.append(Piece(_line_sign(painter, role), role, word))
    if scene.is_loud(painter.floor):
        # What matters now comes before what one knows by now.
        floor = (
            Piece(" ", Role.TEXT, "0 black", Role.LOUD_BLACK),
            Piece(" ", Role.TEXT, "1 white", Role.LOUD_WHITE),
        )
        if painter.signs.fills.get(Role.LOUD_BLACK):
            floor = (
                Piece(signs.fills[Role.LOUD_BLACK][0], Role.GRID, "0 black"),
                Piece("_", Role.GRID, "1 white"),
            )
        pieces[1:1] = floor
    return tuple(pieces)


def legend_cells(scene: Scene | None, painter: Painter, width: int) -> Cells:
    """The legend as one row of cells; pieces that do not fit are left out."""
    cells = blank_cells(1, max(width, 1))
    palette = painter.palette
    column = 0
    pieces = legend(scene, painter)
    wide = sum(len(piece.sign) + len(piece.word) + 3 for piece in pieces) - 2 <= width
    for piece in pieces:
        text = f" {piece.word}"
        if column + len(piece.sign) + len(text) > width:
            break
        attribute = Attribute.NONE
        if palette.is_mono and painter.signs.has_blocks and piece.paper is not None:
            attribute = Attribute.REVERSE
        cells.write(0, column, piece.sign, palette[piece.role], attribute)
        if piece.paper is not None:
            cells.background[0, column : column + len(piece.sign)] = palette[piece.paper]
        column += len(piece.sign)
        cells.write(0, column, text, palette[Role.DIM_TEXT])
        column += len(text) + (2 if wide else 1)
    return cells


def _line_sign(painter: Painter, role: Role) -> str:
    if painter.signs.dotted:
        return _DOTS[role]
    if not painter.signs.has_blocks and role in _PLAIN:
        return _PLAIN[role]
    return chr(painter.signs.line(role))
