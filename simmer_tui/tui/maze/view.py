"""The widget that shows the maze: frame, zoom, panning, following the robot, an overview; and its legend."""

import textwrap
from functools import lru_cache
from typing import ClassVar

from rich.style import Style
from textual.events import MouseDown, MouseMove, MouseScrollDown, MouseScrollUp, MouseUp, Resize
from textual.geometry import Offset
from textual.strip import Strip
from textual.theme import Theme

from simmer_tui.sim.command import cut
from simmer_tui.sim.specs import BLOCK, CELL_SIZE, START, WALL
from simmer_tui.tui.maze.glyphs import Cells, blank_cells
from simmer_tui.tui.maze.painter import Painter, legend_cells, paste_overview
from simmer_tui.tui.maze.palette import Look, Role
from simmer_tui.tui.maze.scene import FloorMode, Scene
from simmer_tui.tui.maze.viewport import (
    FRAME_CELLS,
    Layout,
    Viewport,
    arrange,
    best_zoom,
    draw_frame,
    next_zoom,
    point_outside,
)
from simmer_tui.tui.strips import CellsWidget, DirectLines, make_strips
from simmer_tui.tui.terminal import ColorDepth, GlyphMode
from simmer_tui.tui.terminal_app import TerminalApp

_FLOORS = {
    FloorMode.AUTO: "black tiles are shown while line sensors are read",
    FloorMode.LOUD: "black tiles are always shown",
    FloorMode.QUIET: "black tiles are never shown",
}
"""Ways to show the floor, in the order of the key that changes them, with their sentence."""
_CELLS = {WALL: "a wall", START: "a start cell", BLOCK: "loading zone"}
# A small maze cell; half as many rows are as far.
_PAN = 8
"""Columns by which a key moves the picture."""
# Only until there is a scene, whose maze decides.
_FIRST_ZOOM = 8.0


class MazeView(CellsWidget, can_focus=True, inherit_bindings=False):
    """Shows a `Scene`, and sends the terminal only the cells that have changed.

    It has no key bindings of its own (arrows drive the robot); its actions may be bound to keys. The wheel
    zooms, dragging moves the picture, a click says what is there. A scene that cannot be drawn shows
    the reason in place of the maze. The colours are those of the app's theme.
    """

    ALLOW_SELECT = False
    COMPONENT_CLASSES: ClassVar[set[str]] = {"mazeview--frame"}
    DEFAULT_CSS = """
    MazeView {
        & > .mazeview--frame { color: $text-muted; }
    }
    """

    def __init__(
        self, glyphs: GlyphMode = GlyphMode.QUADRANT, depth: ColorDepth = ColorDepth.TRUECOLOR
    ) -> None:
        super().__init__(id="maze")
        self.painter = Painter(glyphs, depth)
        self._overview = Painter(glyphs, depth)
        self._overview.floor = FloorMode.QUIET
        self.fault = ""
        """Reason why the last scene could not be drawn; empty if it could."""
        self.follow = True
        """True if the view keeps the robot in sight where the maze does not fit."""
        self.frame_role = Role.EDGE
        """Colour of the frame: at a verdict it is the verdict's."""
        self.scene: Scene | None = None
        self.viewport: Viewport | None = None
        """Part of the maze that was last drawn."""
        self._instead = ""
        self._frame_style: Style | None = None
        """Kept, since each picture needs it twice, and looking it up takes longer than making a line."""
        self._zoom: float | None = None
        self._left, self._top = 0.0, 0.0
        self._held: Offset | None = None
        """Last place of the pointer while a button is held down on the maze."""
        self._dragged = False

    # -- what is shown ---------------------------------------------------------------------------

    @property
    def zoom(self) -> float:
        """Columns a maze cell is wide."""
        if self._zoom is not None or self.scene is None:
            return self._zoom or _FIRST_ZOOM
        width, height = self.size
        return best_zoom(self.scene.maze, width, height)

    @property
    def zoom_is_automatic(self) -> bool:
        """True while the whole maze is shown, as large as there is room for."""
        return self._zoom is None

    def show(self, scene: Scene) -> None:
        """Show a scene, in place of the last."""
        self.scene = scene
        self._instead = ""
        self._draw()

    def show_instead(self, text: str) -> None:
        """Show a text in place of the maze, until the next scene."""
        if text != self._instead:
            self._instead = text
            self._draw()

    def legend(self, width: int) -> Strip:
        """One line that explains the signs of the picture; empty without a picture."""
        if self._instead:
            return Strip([])
        return _legend_strip(legend_cells(self.scene, self.painter, width), self._style)

    # -- what people do --------------------------------------------------------------------------

    def action_zoom(self, step: int) -> None:
        """Zoom in (1) or out (-1) at the middle."""
        self.zoom_at(step, self.size.width / 2, self.size.height / 2)

    def zoom_at(self, step: int, column: float, row: float) -> None:
        """Zoom in (1) or out (-1).

        The maze stays at its place in the widget at `column`, `row`, unless the view follows the robot.
        Zooming out ends at the whole maze.
        """
        before = self.zoom
        zoom = next_zoom(before, step)
        if self.scene is not None and step < 0:
            fit = best_zoom(self.scene.maze, self.size.width, self.size.height)
            zoom = max(zoom, min(before, fit))
        column, row = column - FRAME_CELLS, row - FRAME_CELLS
        self._left = (self._left + column) * zoom / before - column
        self._top = (self._top + row) * zoom / before - row
        self._zoom = zoom
        self._draw()

    def action_fit(self) -> None:
        """Show the whole maze, as large as there is room for, now and after each change of size."""
        self._zoom = None
        self._draw()

    def action_follow(self) -> None:
        """Follow the robot, or stop following it."""
        self.follow = not self.follow
        self._draw()
        self._tell(f"follow the robot: {'on' if self.follow else 'off'}")

    def action_pan(self, columns: int, rows: int) -> None:
        """Move the view in a direction."""
        self.pan(columns * _PAN, rows * _PAN / 2)

    def pan(self, columns: float, rows: float) -> None:
        """Move the window over the maze by so many cells; the view then does not follow the robot."""
        self.follow = False
        self._left += columns
        self._top += rows
        self._draw()

    def action_floor(self) -> None:
        """Show the floor in the next way."""
        modes = list(_FLOORS)
        self.painter.floor = modes[(modes.index(self.painter.floor) + 1) % len(modes)]
        self._draw()
        self._tell(f"floor: {_FLOORS[self.painter.floor]}")

    def action_heat(self) -> None:
        """Show a grid's belief as a map, or stop showing it."""
        self.painter.heat = not self.painter.heat
        self._draw()
        self._tell(f"map of the belief: {'on' if self.painter.heat else 'off'}")

    def on_mouse_scroll_up(self, event: MouseScrollUp) -> None:
        event.stop()
        self.zoom_at(1, event.x, event.y)

    def on_mouse_scroll_down(self, event: MouseScrollDown) -> None:
        event.stop()
        self.zoom_at(-1, event.x, event.y)

    def on_mouse_down(self, event: MouseDown) -> None:
        if event.button == 1:
            self._held, self._dragged = event.screen_offset, False
            self.capture_mouse()

    def on_mouse_move(self, event: MouseMove) -> None:
        if self._held is None or event.screen_offset == self._held:
            return
        moved, self._held = event.screen_offset - self._held, event.screen_offset
        self._dragged = True
        if not self.zoom_is_automatic:  # else the whole maze is in sight
            self.pan(-moved.x, -moved.y)

    def on_mouse_up(self, event: MouseUp) -> None:
        if self._held is None:
            return
        self._held = None
        self.release_mouse()
        if not self._dragged:
            self._tell(self._text_at(event.x, event.y))

    def _tell(self, text: str) -> None:
        if isinstance(self.app, TerminalApp):
            self.app.tell(text)

    # -- what is where ---------------------------------------------------------------------------

    def to_inches(self, column: float, row: float) -> tuple[float, float] | None:
        """Place in the maze (x, y) at a place of the widget; None outside the maze."""
        viewport = self.viewport
        column, row = column - FRAME_CELLS, row - FRAME_CELLS
        if viewport is None or not (0 <= column < viewport.columns and 0 <= row < viewport.rows):
            return None
        return viewport.to_inches(column, row)

    def cell_at(self, column: float, row: float) -> tuple[int, int] | None:
        """Cell of the maze at a place of the widget, (row, column) counted from the maze's top left; None
        outside the maze."""
        place = self.to_inches(column, row)
        if place is None or self.scene is None:
            return None
        maze = self.scene.maze
        found = int((maze.height - place[1]) // CELL_SIZE), int(place[0] // CELL_SIZE)
        return found if 0 <= found[0] < maze.rows and 0 <= found[1] < maze.columns else None

    def _text_at(self, column: int, row: int) -> str:
        """Place and cell at a place of the widget, in words; empty outside the maze."""
        middle = column + 0.5, row + 0.5
        place, cell = self.to_inches(*middle), self.cell_at(*middle)
        if place is None or cell is None or self.scene is None:
            return ""
        text = f"x {place[0]:.1f}, y {place[1]:.1f} in; cell: row {cell[0] + 1}, column {cell[1] + 1}"
        what = _CELLS.get(self.scene.maze.cells[cell[0]][cell[1]])
        return f"{text} from the top left{f' ({what})' if what else ''}"

    # -- drawing ---------------------------------------------------------------------------------

    @property
    def _style(self) -> Style:
        if self._frame_style is None:
            self._frame_style = self.get_component_rich_style("mazeview--frame")
        return self._frame_style

    def notify_style_update(self) -> None:
        self._frame_style = None
        super().notify_style_update()

    def on_mount(self) -> None:
        self.app.theme_changed_signal.subscribe(self, self._theme_changed)
        self._wear_theme()

    def on_resize(self, _event: Resize) -> None:
        self._draw()

    def _theme_changed(self, _theme: Theme) -> None:
        self._wear_theme()
        self.forget_cells()
        self.call_after_refresh(self._draw)

    def _wear_theme(self) -> None:
        theme = self.app.current_theme
        look = Look.DARK if theme.dark else Look.LIGHT
        look = Look.CONTRAST if "contrast" in theme.name else look
        self.painter.look = self._overview.look = look

    def _window(self, scene: Scene, layout: Layout) -> Viewport:
        """Part of the maze to be drawn: the robot in it, if it is followed."""
        window = layout.viewport(scene.maze, self._left, self._top)
        if self.follow and not layout.fits:
            x, y = window.place(scene.pose.x, scene.pose.y)
            column, row = x, y / 2
            margin_x = min(layout.zoom, layout.columns / 3)
            margin_y = min(layout.zoom / 2, layout.rows / 3)
            left, top = float(window.left), float(window.top)
            # Moving the window sends everything again: it moves far, so that it moves rarely.
            if not margin_x <= column <= layout.columns - margin_x:
                left += column - layout.columns / 2
            if not margin_y <= row <= layout.rows - margin_y:
                top += row - layout.rows / 2
            window = layout.viewport(scene.maze, left, top)
        if (round(self._left), round(self._top)) != (window.left, window.top):
            self._left, self._top = float(window.left), float(window.top)
        return window

    def _draw(self) -> None:
        """Update the cells and mark the changed ones for sending."""
        scene = self.scene
        size = self.size
        if not self.is_mounted or not size:
            return
        if self._instead:
            self._show_text(self._instead)
            return
        if scene is None:
            return
        try:
            layout = arrange(scene.maze, self.zoom, *size)
            if not layout.usable:
                self._show_text("Too small for the maze.")
                return
            self.show_cells(self._picture(scene, layout), self._style)
            self.fault = ""
        except Exception as error:  # noqa: BLE001 - a scene that cannot be drawn must not end the run
            self.fault = f"{type(error).__name__}: {error}"
            self._show_text(f"The maze cannot be drawn. {cut(self.fault, 800)}")

    def _picture(self, scene: Scene, layout: Layout) -> Cells:
        window = self.viewport = self._window(scene, layout)
        painter = self.painter
        cells = blank_cells(layout.height, layout.width)
        cells.paste(painter.cells(scene, window), FRAME_CELLS, FRAME_CELLS)
        draw_frame(cells, layout, window, painter.signs, painter.palette, self.frame_role)
        if not layout.fits:
            paste_overview(self._overview, cells, scene, layout, window)
        marks = [(scene.pose, Role.ROBOT)]
        if scene.belief is not None:
            marks.append((scene.belief.pose, Role.BELIEF))
        for pose, role in marks:
            color = painter.palette[role]
            point_outside(cells, layout, window, (pose.x, pose.y), painter.signs, color)
        return cells

    def _show_text(self, text: str) -> None:
        size = self.size
        cells = blank_cells(size.height, size.width)
        for row, line in enumerate(textwrap.wrap(text, size.width)[: size.height]):
            cells.write(row, 0, line)
        self.show_cells(cells, self._style)


# Legends with the same entries are the same cells; two widths are in use while a screen changes its size.
@lru_cache(maxsize=4)
def _legend_strip(cells: Cells, style: Style) -> Strip:
    return make_strips(cells, [0], style)[0]


class Legend(DirectLines):
    """Legend below the maze."""

    ALLOW_SELECT = False

    def __init__(self, maze: MazeView) -> None:
        super().__init__(id="legend")
        self._maze = maze
        self._strip = Strip([])

    def update_content(self) -> None:
        width = self.size.width
        strip = self._maze.legend(max(width - 1, 1)) if width else Strip([])
        if strip != self._strip:
            self._strip = strip
            self.refresh()

    def on_resize(self) -> None:
        self.update_content()

    def render_line(self, y: int) -> Strip:
        line = Strip.join((Strip.blank(1, self.rich_style), self._strip))
        return line.adjust_cell_length(self.size.width, self.rich_style)
