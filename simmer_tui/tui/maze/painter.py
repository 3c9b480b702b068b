"""The interface of the drawing: a scene and a window in, terminal cells out.

It also makes the parts beside a picture: the legend under it and the small overview in its corner.
"""

import math
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from operator import is_not

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.sim.specs import TILE_SIZE
from simmer_tui.tui.maze import bodies, lines
from simmer_tui.tui.maze.backdrop import Backdrop
from simmer_tui.tui.maze.canvas import Canvas
from simmer_tui.tui.maze.glyphs import Cells, blank_cells, signs_for
from simmer_tui.tui.maze.heat import HeatMap, HeatMark, heat_numbers, peak_of, stands_out
from simmer_tui.tui.maze.palette import DEFAULT, HEATS, Attribute, Look, Palette, Role, palette_for
from simmer_tui.tui.maze.robot import DrawnRobot
from simmer_tui.tui.maze.scene import FloorMode, Scene, zones_of
from simmer_tui.tui.maze.shapes import is_near
from simmer_tui.tui.maze.viewport import (
    FRAME_CELLS,
    LEAST_COLUMNS,
    LEAST_ROWS,
    Layout,
    Viewport,
    arrange,
    best_zoom,
    draw_frame,
)
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

# The tiles that the sensors at the robot's rim may see next.
_LOUD_BEYOND = TILE_SIZE
"""Inches beyond the robot within which tiles differ clearly while a line sensor is in use."""


class Painter:
    """Draws scenes for one kind of terminal, and keeps the last backdrops it drew, quiet and loud.

    `look` and `floor` may be changed between two scenes.
    """

    def __init__(self, glyphs: GlyphMode, depth: ColorDepth, look: Look = Look.DARK) -> None:
        self.glyphs = glyphs
        self.depth = depth
        self.floor = FloorMode.AUTO
        self.signs = signs_for(glyphs, depth)
        self.look = look
        self.heat = True
        """True if a grid's belief is drawn as a map."""
        self._heat_map = HeatMap()
        self._trail = lines.TrailDots()
        self._drawn: dict[str, tuple[tuple[object, ...], tuple[object, ...], Backdrop]] = {}
        """For each kind of backdrop the last: what it was drawn from, compared by identity and by value."""

    @property
    def palette(self) -> Palette:
        """Colours of the look in use."""
        return palette_for(self.depth, self.look)

    def cells(self, scene: Scene, viewport: Viewport) -> Cells:
        """The picture, (viewport.rows, viewport.columns)."""
        canvas = Canvas(self._ground(scene, viewport))
        belief = scene.belief
        pose = scene.pose
        robot = DrawnRobot(canvas, scene) if is_near(pose.x, pose.y, pose.heading) else None
        # From the least important to the robot, since each replaces earlier marks in its cells.
        if "trail" in scene.shown:
            lines.draw_trail(canvas, scene, self._trail)
        if belief is not None:
            lines.draw_particles(canvas, belief)
        if "plot_sense" in scene.shown:
            lines.draw_scans(canvas, scene)
        rays = lines.draw_rays(canvas, scene) if "plot_sense" in scene.shown else []
        # Under the block: the needle is long, the block may be right ahead.
        if robot is not None and not scene.block_held:
            robot.draw_needle()
        bodies.draw_past_contacts(canvas, scene)
        if not scene.block_held:
            bodies.draw_block(canvas, scene)
        if belief is not None:
            lines.draw_belief(canvas, scene, belief)
        if robot is not None:
            robot.draw_body()
            if scene.block_held:
                robot.draw_held(scene.block_size)
        if scene.contact is not None:
            bodies.draw_contact(canvas, scene, scene.contact)
        lines.draw_codes(canvas, rays)
        if self.heat and scene.heat is not None:
            peak = peak_of(scene.heat.grid, scene.maze, viewport)
            if peak is not None:
                lines.draw_peak(canvas, peak)
        return canvas.cells

    def _ground(self, scene: Scene, viewport: Viewport) -> Backdrop:
        """The backdrop of a scene. With loud tiles near the robot only, it is mixed from two. With heat on
        them tiles stay quiet."""
        if self.heat and scene.heat is not None:
            return self._heat_backdrop(scene, viewport, self._heat_map.shown(scene.heat))
        backdrop = self.backdrop(scene, viewport, loud=self.floor is FloorMode.LOUD)
        if self.floor is not FloorMode.AUTO or not scene.is_loud(self.floor):
            return backdrop
        x, y = viewport.place(scene.pose.x, scene.pose.y)
        radius = (scene.robot.reach + _LOUD_BEYOND) * viewport.scale
        near = backdrop.tiles_near(x, y, radius)
        return backdrop.with_loud(self.backdrop(scene, viewport, loud=True), near)

    def backdrop(self, scene: Scene, viewport: Viewport, *, loud: bool) -> Backdrop:
        """Floor, walls and zones of a window."""
        draw = partial(Backdrop, scene, viewport, self.signs, self.palette, loud=loud)
        return self._kept("loud" if loud else "quiet", scene, viewport, draw)

    def _kept(
        self, kind: str, scene: Scene, viewport: Viewport, draw: Callable[[], Backdrop], grid: object = None
    ) -> Backdrop:
        """The last backdrop of a kind; a new one if anything differs that it shows."""
        sources = grid, scene.maze, scene.floor
        key = viewport, scene.loading_zone, scene.drop_zone, self.palette
        drawn = self._drawn.get(kind)
        # By identity: comparing all cells of two mazes would cost more than it saves.
        if drawn is None or drawn[1] != key or any(map(is_not, drawn[0], sources)):
            drawn = self._drawn[kind] = (sources, key, draw())
        return drawn[2]

    @property
    def tints(self) -> bool:
        """True if this terminal has colours for levels of heat."""
        return self.signs.has_blocks and self.depth in (ColorDepth.TRUECOLOR, ColorDepth.COLORS_256)

    def _heat_backdrop(self, scene: Scene, viewport: Viewport, mark: HeatMark) -> Backdrop:
        """Backdrop with the map of a grid."""

        def draw() -> Backdrop:
            signs = self.signs
            levels = self._heat_map.levels(mark, scene.maze, viewport, signs.across, signs.down)
            made = Backdrop(scene, viewport, signs, self.palette, loud=False, heat=levels, tinted=self.tints)
            made.write_numbers(heat_numbers(mark.grid, viewport, tinted=self.tints))
            return made

        return self._kept("heat", scene, viewport, draw, mark.grid)


# -- the legend ------------------------------------------------------------------------------------

_DOTS = {
    Role.TRAIL: "⠒⠂",
    Role.RAY_STRONG: "⠒⠂",
    Role.RAY_WEAK: "⠒⠂",
    Role.LOADING_LINE: "⣏⣹",
    Role.DROP_LINE: "⡠⠊",
}
_HEAT_WORDS = ("possible", "likely", "most likely")
"""Words for the levels of heat."""
_PLAIN = {Role.LOADING_LINE: "+-+", Role.DROP_LINE: "//"}


class LegendEntry(Struct, frozen=True):
    """A sign of the picture and the word for it. `paper` is what the sign stands on, None for the
    background."""

    sign: str
    role: Role
    word: str
    paper: Role | None = None


def legend_cells(scene: Scene | None, painter: Painter, width: int) -> Cells:
    """The legend as one row of cells; entries that do not fit are left out. Equal entries give the same cells
    object, which must not be changed."""
    has_blocks = painter.signs.has_blocks
    return _legend_cells(tuple(_legend(scene, painter)), painter.palette, width, has_blocks=has_blocks)


# It hardly ever changes from one picture to the next.
@lru_cache(maxsize=64)
def _legend_cells(entries: Sequence[LegendEntry], palette: Palette, width: int, *, has_blocks: bool) -> Cells:
    cells = blank_cells(1, max(width, 1))
    column = 0
    gap = 2 if sum(len(each.sign) + len(each.word) + 3 for each in entries) - 2 <= width else 1
    for each in entries:
        text = f" {each.word}"
        wide = len(each.sign)
        if column + wide + len(text) > width:
            break
        solid = palette.is_mono and has_blocks and each.paper is not None
        attribute = Attribute.REVERSE if solid else Attribute.NONE
        cells.write(0, column, each.sign, palette[each.role], attribute)
        if each.paper is not None:
            cells.background[0, column : column + wide] = palette[each.paper]
        cells.write(0, column + wide, text, palette[Role.DIM_TEXT])
        column += wide + len(text) + gap
    return cells


def _legend(scene: Scene | None, painter: Painter) -> list[LegendEntry]:
    """Explanations of a scene's signs, the most important first."""
    blocks = painter.signs.has_blocks
    # A plain block of its colour: the pose line has its heading, and a heading here would be sent with every
    # turn.
    robot = LegendEntry("  " if blocks else "(O)", Role.HEADING, "robot", Role.ROBOT)
    if scene is None:
        return [robot]
    arrow = painter.signs.arrows[0]
    marks = (
        (scene.belief, LegendEntry(arrow if blocks else f"?{arrow}?", Role.BELIEF, "belief")),
        (scene.block_centre, LegendEntry("■" if blocks else "BB", Role.BLOCK, "block")),
        (scene.contact, LegendEntry(" X " if blocks else "X", Role.BACKGROUND, "contact", Role.CONTACT)),
        (scene.past_contacts or None, LegendEntry("×" if blocks else "x", Role.CONTACT, "earlier")),
    )
    shown = [entry for mark, entry in marks if mark is not None]
    if scene.belief is not None and scene.belief.spread:
        ring = "⠢⠔" if painter.signs.dotted else chr(painter.signs.line(Role.BELIEF))
        shown.insert(1, LegendEntry(ring, Role.BELIEF, "spread"))
    # The ground comes early: it has just changed, and the other signs are known already.
    return [robot, *_ground_entries(scene, painter), *shown, *_line_entries(scene, painter)]


def _ground_entries(scene: Scene, painter: Painter) -> list[LegendEntry]:
    """Colours of the floor: levels of heat, or tiles that differ clearly."""
    if painter.heat and scene.heat is not None:
        levels = zip(HEATS, painter.signs.heats, _HEAT_WORDS, strict=True)
        shown = [
            LegendEntry(2 * sign, Role.HEAT_DOTS, word, dark if painter.tints else None)
            for (dark, _), sign, word in reversed(list(levels))
        ]
        shown.append(LegendEntry("", Role.TEXT, "else ruled out"))
        if stands_out(scene.heat.grid, scene.maze):
            shown.append(LegendEntry(painter.signs.peak, Role.BELIEF, "best"))
        return shown
    if not scene.is_loud(painter.floor):
        return []
    black = painter.signs.fills.get(Role.LOUD_BLACK)
    if black:
        return [LegendEntry(black[0], Role.GRID, "black"), LegendEntry("_", Role.GRID, "white")]
    tiles = (("black", Role.LOUD_BLACK), ("white", Role.LOUD_WHITE))
    return [LegendEntry(" ", Role.TEXT, word, paper) for word, paper in tiles]


def _line_entries(scene: Scene, painter: Painter) -> list[LegendEntry]:
    """Lines and dots: scan, trail, rays and zones."""
    zones = zones_of(scene)
    rays = len(scene.views) if "plot_sense" in scene.shown else 0
    read_last = min(rays, 0 if scene.scan_is_newest else 1)
    # Rays come and go with each movement: a legend that followed them would be sent over and over.
    stays = "plot_sense" in scene.shown and scene.has_readings and not scene.scans
    marks = (
        (Role.TRAIL, "trail", "trail" in scene.shown and len(scene.trail)),
        (Role.LOADING_LINE, "loading", zones.loading.any()),
        (Role.DROP_LINE, "drop", zones.drop.any()),
        (Role.RAY_STRONG, "read last", read_last or stays),
        (Role.RAY_WEAK, "ray", rays > read_last or stays),
    )
    entries = [LegendEntry(_line_sign(painter, role), role, word) for role, word, there in marks if there]
    if "plot_sense" in scene.shown and scene.scans:
        sign = "⠢⠔" if painter.signs.dotted else 2 * chr(painter.signs.line(Role.RAY_STRONG))
        entries.insert(0, LegendEntry(sign, Role.RAY_STRONG, "scan"))
    return entries


def _line_sign(painter: Painter, role: Role) -> str:
    if painter.signs.dotted:
        return _DOTS[role]
    if not painter.signs.has_blocks and role in _PLAIN:
        return _PLAIN[role]
    return chr(painter.signs.line(role))


# -- the overview ----------------------------------------------------------------------------------

# A larger one would cover more of the maze than it helps.
_SHARE = 3
"""Largest part of the view that it takes in each direction: one in so many."""


def paste_overview(painter: Painter, cells: Cells, scene: Scene, layout: Layout, window: Viewport) -> None:
    """Put the whole maze, small, into the corner that is furthest from the robot, if there is room. It shows
    walls, robot, block and zones, and the part of the maze in the view."""
    width, height = layout.columns // _SHARE, layout.rows // _SHARE
    inset = arrange(scene.maze, best_zoom(scene.maze, width, height), width, height)
    # So would be any in a view that is not three times as large.
    if inset.columns < LEAST_COLUMNS or inset.rows < LEAST_ROWS:
        return
    whole = inset.viewport(scene.maze, 0, 0)
    columns, rows = inset.virtual_size
    small = blank_cells(rows, columns)
    small.background[:] = painter.palette[Role.BACKGROUND]
    # Everything else would be noise in few cells.
    bare = replace(
        scene, trail=(), recent=(), views=(), scans=(), belief=None, heat=None, contact=None, past_contacts=()
    )
    small.paste(painter.cells(bare, whole), FRAME_CELLS, FRAME_CELLS)
    draw_frame(small, inset, whole, painter.signs, painter.palette)
    _outline(painter, small, layout, window, inset)
    x, y = window.place(scene.pose.x, scene.pose.y)
    left = FRAME_CELLS if x > layout.columns / 2 else FRAME_CELLS + layout.columns - columns
    top = FRAME_CELLS if y / 2 > layout.rows / 2 else FRAME_CELLS + layout.rows - rows
    if not painter.signs.has_blocks:
        # A frame of letters needs a margin, otherwise it looks like a part of the maze under it.
        for row in range(max(top - 1, FRAME_CELLS), min(top + rows + 1, FRAME_CELLS + layout.rows)):
            cells.write(row, max(left - 1, FRAME_CELLS), " " * min(columns + 2, layout.columns))
    cells.paste(small, top, left)


def _outline(painter: Painter, small: Cells, layout: Layout, window: Viewport, inset: Layout) -> None:
    """Draw corners around the part in the view."""
    scale = inset.zoom / layout.zoom
    left = FRAME_CELLS + math.floor(window.left * scale)
    top = FRAME_CELLS + math.floor(window.top * scale)
    right = FRAME_CELLS + min(math.ceil((window.left + window.columns) * scale), inset.columns) - 1
    bottom = FRAME_CELLS + min(math.ceil((window.top + window.rows) * scale), inset.rows) - 1
    color = painter.palette[Role.TEXT]
    corners = ((top, left), (top, right), (bottom, left), (bottom, right))
    for (row, column), sign in zip(corners, "┌┐└┘" if painter.signs.has_blocks else "++++", strict=True):
        if small.foreground[row, column] != painter.palette[Role.HEADING] or color == DEFAULT:
            small.write(row, column, sign, color)
