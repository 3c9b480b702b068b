"""One door to the drawing: a scene and a window in, terminal cells out; and what goes with a picture:
the legend under it and the small overview in its corner."""

import math
from collections.abc import Iterator

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from simmer_tui.sim.specs import MazeSpec
from simmer_tui.tui.maze.backdrop import Backdrop
from simmer_tui.tui.maze.bodies import draw_block, draw_contact, draw_robot
from simmer_tui.tui.maze.canvas import Canvas
from simmer_tui.tui.maze.glyphs import Cells, blank_cells, heading_arrow, signs_for
from simmer_tui.tui.maze.lines import draw_belief, draw_particles, draw_rays, draw_trail
from simmer_tui.tui.maze.palette import DEFAULT, Attribute, Look, Palette, Role, palette_for
from simmer_tui.tui.maze.scene import FloorMode, MazePoint, Scene, zones_of
from simmer_tui.tui.maze.viewport import FRAME, Layout, Viewport, arrange, best_zoom, draw_frame
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

_Key = tuple[Viewport, bool, tuple[MazePoint, ...] | None, MazePoint | None, Palette]


class Painter:
    """Draws scenes for one kind of terminal, and keeps the last backdrop it drew.

    `look` and `floor` may be changed between two scenes.
    """

    def __init__(self, glyphs: GlyphMode, depth: ColorDepth, look: Look = Look.DARK) -> None:
        self.glyphs = glyphs
        self.depth = depth
        self.floor = FloorMode.AUTO
        self.signs = signs_for(glyphs, depth)
        self.look = look
        self._drawn: tuple[MazeSpec, NDArray[np.uint8], _Key] | None = None
        self._backdrop: Backdrop | None = None

    @property
    def palette(self) -> Palette:
        """Colours of the look in use."""
        return palette_for(self.depth, self.look)

    def cells(self, scene: Scene, viewport: Viewport) -> Cells:
        """The picture, (viewport.rows, viewport.columns)."""
        canvas = Canvas(self.backdrop(scene, viewport))
        belief = scene.belief
        # From the least needed to the robot, since each replaces what stood in its cells.
        if scene.show_trail:
            draw_trail(canvas, scene)
        if belief is not None:
            draw_particles(canvas, belief)
        if scene.show_rays:
            draw_rays(canvas, scene)
        if not (scene.block_held and scene.show_robot):
            draw_block(canvas, scene)
        if belief is not None:
            draw_belief(canvas, scene, belief)
        if scene.contact is not None and not scene.in_contact:
            draw_contact(canvas, scene, scene.contact)  # the robot may since have come over it
        if scene.show_robot:
            draw_robot(canvas, scene)
        if scene.contact is not None and scene.in_contact:
            draw_contact(canvas, scene, scene.contact)
        return canvas.cells

    def backdrop(self, scene: Scene, viewport: Viewport) -> Backdrop:
        """Floor, walls and zones of a window, drawn anew only when one of them is another."""
        loud = scene.is_loud(self.floor)
        palette = self.palette
        key = (viewport, loud, scene.loading_zone, scene.drop_zone, palette)
        drawn, backdrop = self._drawn, self._backdrop
        # By identity: comparing all cells of two mazes would cost more than it saves.
        same = drawn is not None and drawn[0] is scene.maze and drawn[1] is scene.floor and drawn[2] == key
        if backdrop is None or not same:
            backdrop = Backdrop(scene, viewport, self.signs, palette, loud=loud)
            self._drawn = (scene.maze, scene.floor, key)
            self._backdrop = backdrop
        return backdrop


# -- the legend ------------------------------------------------------------------------------------

_DOTS = {
    Role.TRAIL_NEW: "⠒⠂",
    Role.RAY_STRONG: "⠒⠂",
    Role.RAY_WEAK: "⠒⠂",
    Role.LOADING_LINE: "⣏⣹",
    Role.DROP_LINE: "⡠⠊",
}
_PLAIN = {Role.LOADING_LINE: "+-+", Role.DROP_LINE: "//"}


class LegendEntry(Struct, frozen=True):
    """A sign of the picture and the word for it. `paper` is what the sign stands on, None for the
    background."""

    sign: str
    role: Role
    word: str
    paper: Role | None = None


def legend_cells(scene: Scene | None, painter: Painter, width: int) -> Cells:
    """The legend as one row of cells; entries that do not fit are left out."""
    cells = blank_cells(1, max(width, 1))
    palette = painter.palette
    column = 0
    entries = list(_legend(scene, painter))
    gap = 2 if sum(len(each.sign) + len(each.word) + 3 for each in entries) - 2 <= width else 1
    for each in entries:
        text = f" {each.word}"
        wide = len(each.sign)
        if column + wide + len(text) > width:
            break
        solid = palette.is_mono and painter.signs.has_blocks and each.paper is not None
        attribute = Attribute.REVERSE if solid else Attribute.NONE
        cells.write(0, column, each.sign, palette[each.role], attribute)
        if each.paper is not None:
            cells.background[0, column : column + wide] = palette[each.paper]
        cells.write(0, column + wide, text, palette[Role.DIM_TEXT])
        column += wide + len(text) + gap
    return cells


def _legend(scene: Scene | None, painter: Painter) -> Iterator[LegendEntry]:
    """Explanations of a scene's signs, the most needed first."""
    signs = painter.signs
    blocks = signs.has_blocks
    arrow = heading_arrow(signs, scene.pose.heading if scene is not None else 0.0)
    yield LegendEntry(f" {arrow} " if blocks else f"({arrow})", Role.HEADING, "robot", Role.ROBOT)
    if scene is None:
        return
    if scene.is_loud(painter.floor):
        # What matters now comes before what one knows by now.
        yield from _floor_entries(painter)
    if scene.belief is not None:
        yield LegendEntry(arrow if blocks else f"?{arrow}?", Role.BELIEF, "belief")
    if scene.block_centre is not None:
        yield LegendEntry("■" if blocks else "BB", Role.BLOCK, "block")
    if scene.contact is not None:
        yield LegendEntry("X", Role.BACKGROUND, "contact", Role.CONTACT)
    zones = zones_of(scene)
    rays = len(scene.views) if scene.show_rays else 0
    for role, word, there in (
        (Role.TRAIL_NEW, "trail", scene.show_trail and len(scene.trail) > 0),
        (Role.RAY_STRONG, "last ray", rays > 0),
        (Role.RAY_WEAK, "ray", rays > 1),
        (Role.LOADING_LINE, "loading", bool(zones.loading)),
        (Role.DROP_LINE, "drop", bool(zones.drop)),
    ):
        if there:
            yield LegendEntry(_line_sign(painter, role), role, word)


def _floor_entries(painter: Painter) -> tuple[LegendEntry, LegendEntry]:
    black = painter.signs.fills.get(Role.LOUD_BLACK)
    if black:
        return LegendEntry(black[0], Role.GRID, "0 black"), LegendEntry("_", Role.GRID, "1 white")
    return (
        LegendEntry(" ", Role.TEXT, "0 black", Role.LOUD_BLACK),
        LegendEntry(" ", Role.TEXT, "1 white", Role.LOUD_WHITE),
    )


def _line_sign(painter: Painter, role: Role) -> str:
    if painter.signs.dotted:
        return _DOTS[role]
    if not painter.signs.has_blocks and role in _PLAIN:
        return _PLAIN[role]
    return chr(painter.signs.line(role))


# -- the overview ----------------------------------------------------------------------------------

# A larger one would cover more of the maze than it helps.
_SHARE = 3
"""Largest part of the view that it takes each way: one in so many."""
# A smaller one would show nothing; so it does in a view that is not three times as large.
_LEAST_COLUMNS, _LEAST_ROWS = 8, 3


def paste_overview(painter: Painter, cells: Cells, scene: Scene, layout: Layout, window: Viewport) -> None:
    """Put the whole maze, small, into the corner that is furthest from the robot, if there is room.

    It shows walls, robot, block and zones, and what part of them the view shows.
    """
    width, height = layout.columns // _SHARE, layout.rows // _SHARE
    inset = arrange(scene.maze, best_zoom(scene.maze, width, height), width, height)
    if inset.columns < _LEAST_COLUMNS or inset.rows < _LEAST_ROWS:
        return
    whole = inset.viewport(scene.maze, 0, 0)
    columns, rows = inset.virtual_size
    small = blank_cells(rows, columns)
    small.background[:] = painter.palette[Role.BACKGROUND]
    # All else would be noise in few cells.
    bare = replace(scene, trail=(), views=(), belief=None, contact=None)
    small.paste(painter.cells(bare, whole), FRAME, FRAME)
    draw_frame(small, inset, whole, painter.signs, painter.palette)
    _outline(painter, small, layout, window, inset)
    x, y = window.place(scene.pose.x, scene.pose.y)
    left = FRAME if x > layout.columns / 2 else FRAME + layout.columns - columns
    top = FRAME if y / 2 > layout.rows / 2 else FRAME + layout.rows - rows
    if not painter.signs.has_blocks:
        # A frame of letters needs a margin to be told from the maze under it.
        for row in range(max(top - 1, FRAME), min(top + rows + 1, FRAME + layout.rows)):
            cells.write(row, max(left - 1, FRAME), " " * min(columns + 2, layout.columns))
    cells.paste(small, top, left)


def _outline(painter: Painter, small: Cells, layout: Layout, window: Viewport, inset: Layout) -> None:
    """Corners around the part that the view shows."""
    scale = inset.zoom / layout.zoom
    left = FRAME + math.floor(window.left * scale)
    top = FRAME + math.floor(window.top * scale)
    right = FRAME + min(math.ceil((window.left + window.columns) * scale), inset.columns) - 1
    bottom = FRAME + min(math.ceil((window.top + window.rows) * scale), inset.rows) - 1
    color = painter.palette[Role.TEXT]
    corners = ((top, left), (top, right), (bottom, left), (bottom, right))
    for (row, column), sign in zip(corners, "┌┐└┘" if painter.signs.has_blocks else "++++", strict=True):
        if small.foreground[row, column] != painter.palette[Role.HEADING] or color == DEFAULT:
            small.write(row, column, sign, color)
