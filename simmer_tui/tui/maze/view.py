"""The widget that shows the maze: frame, zoom, panning, following the robot, an overview."""

from __future__ import annotations

import textwrap
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.events import Resize
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip
from textual.theme import Theme
from textual.widget import Widget

from simmer_tui.sim.command import escape
from simmer_tui.sim.specs import CELL_SIZE
from simmer_tui.tui.maze.glyphs import Cells, blank_cells
from simmer_tui.tui.maze.layout import FRAME, Layout, arrange, best_zoom, draw_frame, point_outside
from simmer_tui.tui.maze.legend import legend_cells
from simmer_tui.tui.maze.overview import Overview
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.palette import Look, Role
from simmer_tui.tui.maze.scene import FloorMode, Scene
from simmer_tui.tui.maze.viewport import Viewport, next_zoom
from simmer_tui.tui.strips import changed_spans, make_strip
from simmer_tui.tui.terminal import ColorDepth, GlyphMode
from simmer_tui.tui.textual_internals import spans_are_cropped

_JOIN = 6
"""Changed spans nearer than this are sent as one; moving the cursor takes about as many bytes."""


class MazeView(Widget, can_focus=True, inherit_bindings=False):
    """Shows a `Scene`, and sends the terminal only what differs from the last one.

    It has no key bindings of its own (arrows drive the robot) and takes no mouse events: the app
    calls `zoom_in`, `zoom_out`, `zoom_at`, `zoom_to_fit`, `pan`, `toggle_follow` and `cycle_floor`,
    and asks `to_inches` and `cell_at` what is under the pointer. A scene that cannot be drawn shows
    the reason in place of the maze. `look` None takes the colours that go with the app's theme.
    """

    ALLOW_SELECT = False
    COMPONENT_CLASSES: ClassVar[set[str]] = {"mazeview--frame"}
    DEFAULT_CSS = """
    MazeView {
        & > .mazeview--frame { color: $text-muted; }
    }
    """

    class Changed(Message):
        """The zoom, the follow mode or the floor mode is another."""

        def __init__(self, view: MazeView) -> None:
            super().__init__()
            self.view = view

        @property
        def control(self) -> MazeView:
            return self.view

    def __init__(
        self,
        glyphs: GlyphMode = GlyphMode.QUADRANT,
        depth: ColorDepth = ColorDepth.TRUECOLOR,
        *,
        look: Look | None = None,
        name: str | None = None,
        id: str | None = None,  # noqa: A002 - as every widget calls it
        classes: str | None = None,
    ) -> None:
        super().__init__(name=name, id=id, classes=classes)
        self.painter = Painter(glyphs, depth, look or Look.DARK)
        self.fault = ""
        """Why the last scene could not be drawn; empty if it could."""
        self._look = look
        self._overview = Overview(glyphs, depth)
        self._scene: Scene | None = None
        self._instead = ""
        self._zoom: float | None = None
        self._follow = True
        self._left, self._top = 0.0, 0.0
        self._viewport: Viewport | None = None
        self._cells: Cells | None = None
        self._strips: list[Strip] = []
        self._default_style = Style()

    # -- what is shown ---------------------------------------------------------------------------

    @property
    def scene(self) -> Scene | None:
        return self._scene

    @property
    def viewport(self) -> Viewport | None:
        """The part of the maze that was last drawn."""
        return self._viewport

    @property
    def follow(self) -> bool:
        """Whether the view keeps the robot in sight where the maze does not fit."""
        return self._follow

    @property
    def zoom(self) -> float:
        """Columns a maze cell is wide."""
        if self._zoom is not None or self._scene is None:
            return self._zoom or 8.0
        return best_zoom(self._scene.maze, self.size.width, self.size.height)

    @property
    def zoom_is_automatic(self) -> bool:
        return self._zoom is None

    @property
    def floor_mode(self) -> FloorMode:
        """When the floor's tiles are told apart."""
        return self.painter.floor

    @floor_mode.setter
    def floor_mode(self, mode: FloorMode) -> None:
        self.painter.floor = mode
        self._draw()
        self._tell()

    @property
    def look(self) -> Look:
        """The set of colours in use."""
        return self.painter.look

    @look.setter
    def look(self, look: Look | None) -> None:
        self._look = look
        self._wear(look or self._look_of_theme())
        self._draw()

    def show(self, scene: Scene) -> None:
        """Show a scene, in place of the last."""
        self._scene = scene
        self._instead = ""
        self._draw()

    def show_instead(self, text: str) -> None:
        """Show a text in place of the maze, until the next scene."""
        if text != self._instead:
            self._instead = text
            self._draw()

    def legend(self, width: int) -> Strip:
        """One line that says what is what in the picture."""
        style = self.get_component_rich_style("mazeview--frame")
        return make_strip(legend_cells(self._scene, self.painter, width), 0, style)

    # -- what people do --------------------------------------------------------------------------

    def zoom_in(self) -> None:
        self.zoom_at(1, self.size.width / 2, self.size.height / 2)

    def zoom_out(self) -> None:
        self.zoom_at(-1, self.size.width / 2, self.size.height / 2)

    def zoom_at(self, step: int, column: float, row: float) -> None:
        """Zoom in (1) or out (-1); what is at a place of the widget stays there, if the view need
        not follow the robot. Beyond the whole maze there is nothing to zoom out to."""
        before = self.zoom
        zoom = next_zoom(before, step)
        if self._scene is not None and step < 0:
            fit = best_zoom(self._scene.maze, self.size.width, self.size.height)
            zoom = max(zoom, min(before, fit))
        column, row = column - FRAME, row - FRAME
        self._left = (self._left + column) * zoom / before - column
        self._top = (self._top + row) * zoom / before - row
        self._zoom = zoom
        self._draw()
        self._tell()

    def zoom_to_fit(self) -> None:
        """Show the whole maze, as large as there is room for, now and whenever that changes."""
        self._zoom = None
        self._draw()
        self._tell()

    def toggle_follow(self) -> None:
        """Keep the robot in sight, or stop doing so."""
        self._follow = not self._follow
        self._draw()
        self._tell()

    def pan(self, columns: float, rows: float) -> None:
        """Move the window over the maze by so many cells; the view stops following the robot."""
        follow, self._follow = self._follow, False
        self._left += columns
        self._top += rows
        self._draw()
        if follow:
            self._tell()

    def cycle_floor(self) -> None:
        """Tell tiles apart when a line sensor is used, always, never."""
        modes = (FloorMode.AUTO, FloorMode.LOUD, FloorMode.QUIET)
        self.floor_mode = modes[(modes.index(self.floor_mode) + 1) % len(modes)]

    # -- what is where ---------------------------------------------------------------------------

    def to_inches(self, column: float, row: float) -> tuple[float, float] | None:
        """The place in the maze (x, y) at a place of the widget; None beside the maze."""
        viewport = self._viewport
        column, row = column - FRAME, row - FRAME
        if viewport is None or not (0 <= column < viewport.columns and 0 <= row < viewport.rows):
            return None
        return viewport.to_inches(column, row)

    def cell_at(self, column: float, row: float) -> tuple[int, int] | None:
        """The maze's cell at a place of the widget, (row, column) counted from the maze's top left;
        None beside the maze."""
        place = self.to_inches(column, row)
        if place is None or self._scene is None:
            return None
        maze = self._scene.maze
        found = int((maze.height - place[1]) // CELL_SIZE), int(place[0] // CELL_SIZE)
        return found if 0 <= found[0] < maze.rows and 0 <= found[1] < maze.columns else None

    # -- drawing ---------------------------------------------------------------------------------

    def render_line(self, y: int) -> Strip:
        if y < len(self._strips):
            return self._strips[y]
        return Strip([Segment(" " * self.size.width, self.rich_style)], self.size.width)

    def on_mount(self) -> None:
        self.app.theme_changed_signal.subscribe(self, self._theme_changed)
        self._wear(self._look or self._look_of_theme())

    def on_resize(self, _event: Resize) -> None:
        self._draw()

    def _theme_changed(self, _theme: Theme) -> None:
        self._wear(self._look or self._look_of_theme())
        self._cells = None
        self.call_after_refresh(self._draw)

    def _look_of_theme(self) -> Look:
        theme = self.app.current_theme
        if "contrast" in theme.name:
            return Look.CONTRAST
        return Look.DARK if theme.dark else Look.LIGHT

    def _wear(self, look: Look) -> None:
        self.painter.look = look
        self._overview.painter.look = look

    def _tell(self) -> None:
        self.post_message(self.Changed(self))

    def _window(self, scene: Scene, layout: Layout) -> Viewport:
        """The part of the maze to be drawn: the robot in it, if it is followed."""
        window = layout.viewport(scene.maze, self._left, self._top)
        if self._follow and not layout.fits:
            x, y = window.place(scene.pose.x, scene.pose.y)
            column, row = x, y / 2
            margin_x = min(layout.zoom, layout.columns / 3)
            margin_y = min(layout.zoom / 2, layout.rows / 3)
            left, top = float(window.left), float(window.top)
            # Moving the window resends everything: go far when it has to be, so that it is rarely.
            if not margin_x <= column <= layout.columns - margin_x:
                left += column - layout.columns / 2
            if not margin_y <= row <= layout.rows - margin_y:
                top += row - layout.rows / 2
            window = layout.viewport(scene.maze, left, top)
        if (round(self._left), round(self._top)) != (window.left, window.top):
            self._left, self._top = float(window.left), float(window.top)
        return window

    def _draw(self) -> None:
        """Bring the cells up to date and mark the changed ones for sending."""
        scene = self._scene
        if not self.is_mounted or not self.size:
            return
        if self._instead:
            self._show_text(self._instead)
            return
        if scene is None:
            return
        try:
            layout = arrange(scene.maze, self.zoom, self.size.width, self.size.height)
            if not layout.usable:
                self._show_text("Too small for the maze.")
                return
            self._update(self._picture(scene, layout))
            self.fault = ""
        except Exception as error:  # noqa: BLE001 - a scene that cannot be drawn must not end the run
            self.fault = f"{type(error).__name__}: {error}"
            self._show_text(f"The maze cannot be drawn. {escape(self.fault, 800)}")

    def _picture(self, scene: Scene, layout: Layout) -> Cells:
        window = self._viewport = self._window(scene, layout)
        painter = self.painter
        cells = blank_cells(layout.height, layout.width)
        cells.paste(painter.cells(scene, window), FRAME, FRAME)
        draw_frame(cells, layout, window, painter.glyphs, painter.palette)
        if not layout.fits:
            self._overview.paste(cells, scene, layout, window)
        marks = [(scene.pose, Role.ROBOT)] if scene.show_robot else []
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
        self._update(cells)

    def _update(self, cells: Cells) -> None:
        style = self.get_component_rich_style("mazeview--frame")
        old = self._cells
        self._cells = cells
        if old is None or old.shape != cells.shape or style != self._default_style:
            self._default_style = style
            self._strips = [make_strip(cells, row, style) for row in range(cells.shape[0])]
            self.refresh()
            return
        spans = changed_spans(old, cells, _JOIN if spans_are_cropped() else None)
        for row in {span.row for span in spans}:
            self._strips[row] = make_strip(cells, row, style)
        if spans:
            self.refresh(*(Region(span.start, span.row, span.stop - span.start, 1) for span in spans))
