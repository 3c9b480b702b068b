"""The widget that shows the maze: axes, zoom, scrolling, following the robot."""

from __future__ import annotations

import textwrap
from typing import ClassVar

import numpy as np
from rich.segment import Segment
from rich.style import Style
from textual.events import Resize
from textual.geometry import Region, Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip
from textual.theme import Theme

from simmer_tui.sim.command import escape
from simmer_tui.tui.dirty_spans import spans_are_cropped
from simmer_tui.tui.maze.axes import LINES, PLAIN_LINES, AxisSigns, Layout, arrange, best_zoom, draw_axes
from simmer_tui.tui.maze.glyphs import Cells, blank_cells
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.scene import Scene
from simmer_tui.tui.maze.viewport import ZOOM_LEVELS
from simmer_tui.tui.strips import changed_spans, make_strip
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

_JOIN = 6
"""Changed spans nearer than this are sent as one; moving the cursor takes about as many bytes."""


class MazeView(ScrollView, can_focus=True, inherit_bindings=False):
    """Shows a `Scene`, and sends the terminal only what differs from the last one.

    It has no key bindings of its own (arrows drive the robot): the app binds `zoom_in`,
    `zoom_out`, `zoom_to_fit`, `pan` and `toggle_follow`. A scene that cannot be drawn shows the
    reason in place of the maze.
    """

    ALLOW_SELECT = False
    COMPONENT_CLASSES: ClassVar[set[str]] = {"mazeview--axes"}
    DEFAULT_CSS = """
    MazeView {
        scrollbar-size: 1 1;
        & > .mazeview--axes { color: $text-muted; }
    }
    """

    class Changed(Message):
        """The zoom or the follow mode is another."""

        def __init__(self, view: MazeView) -> None:
            super().__init__()
            self.view = view

        @property
        def control(self) -> MazeView:
            return self.view

    def __init__(
        self,
        glyphs: GlyphMode = GlyphMode.HYBRID,
        depth: ColorDepth = ColorDepth.TRUECOLOR,
        *,
        name: str | None = None,
        id: str | None = None,  # noqa: A002 - as every widget calls it
        classes: str | None = None,
    ) -> None:
        super().__init__(name=name, id=id, classes=classes)
        self.painter = Painter(glyphs, depth)
        self.fault = ""
        """Why the last scene could not be drawn; empty if it could."""
        self._scene: Scene | None = None
        self._instead = ""
        self._zoom: int | None = None
        self._follow = True
        self._placing = False
        self._cells: Cells | None = None
        self._strips: list[Strip] = []
        self._default_style = Style()

    @property
    def scene(self) -> Scene | None:
        return self._scene

    @property
    def follow(self) -> bool:
        """Whether the view keeps the robot in sight where the maze does not fit."""
        return self._follow

    @property
    def zoom(self) -> int:
        """Columns a maze cell is wide."""
        if self._zoom is not None or self._scene is None:
            return self._zoom or ZOOM_LEVELS[0]
        # The size with scrollbars: they come and go with the zoom, so it must not depend on them.
        return best_zoom(self._scene.maze, self.size.width, self.size.height)

    @property
    def zoom_is_automatic(self) -> bool:
        return self._zoom is None

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

    def zoom_in(self) -> None:
        self._step_zoom(1)

    def zoom_out(self) -> None:
        self._step_zoom(-1)

    def zoom_to_fit(self) -> None:
        """Choose the zoom by the room there is, now and whenever it changes."""
        self._set_zoom(None)

    def toggle_follow(self) -> None:
        """Keep the robot in sight, or stop doing so."""
        self._set_follow(not self._follow)
        self._draw()

    def pan(self, columns: int, rows: int) -> None:
        """Scroll by so many cells; the view stops following the robot."""
        self.scroll_to(self.scroll_x + columns, self.scroll_y + rows, animate=False)

    def render_line(self, y: int) -> Strip:
        if y < len(self._strips):
            return self._strips[y]
        return Strip([Segment(" " * self.size.width, self.rich_style)], self.size.width)

    def on_mount(self) -> None:
        self.app.theme_changed_signal.subscribe(self, self._theme_changed)

    def on_resize(self, _event: Resize) -> None:
        self._draw()

    def watch_scroll_x(self, old_value: float, new_value: float) -> None:
        if self.show_horizontal_scrollbar:
            self.horizontal_scrollbar.position = new_value
        self._scrolled(old_value, new_value)

    def watch_scroll_y(self, old_value: float, new_value: float) -> None:
        if self.show_vertical_scrollbar:
            self.vertical_scrollbar.position = new_value
        self._scrolled(old_value, new_value)

    def watch_show_horizontal_scrollbar(self) -> None:
        self.call_later(self._draw)

    def watch_show_vertical_scrollbar(self) -> None:
        self.call_later(self._draw)

    def _scroll_update(self, virtual_size: Size) -> None:
        # Textual clamps the scroll position here; that is no wish of the user's.
        placing, self._placing = self._placing, True
        super()._scroll_update(virtual_size)
        self._placing = placing

    def _scrolled(self, old_value: float, new_value: float) -> None:
        if self._placing or round(old_value) == round(new_value):
            return
        self._set_follow(False)
        self._draw()

    def _theme_changed(self, _theme: Theme) -> None:
        self._cells = None
        self.call_after_refresh(self._draw)

    def _set_follow(self, follow: bool) -> None:
        if follow != self._follow:
            self._follow = follow
            self.post_message(self.Changed(self))

    def _step_zoom(self, step: int) -> None:
        index = ZOOM_LEVELS.index(self.zoom) + step
        self._set_zoom(ZOOM_LEVELS[max(0, min(index, len(ZOOM_LEVELS) - 1))])

    def _set_zoom(self, zoom: int | None) -> None:
        before = self.zoom
        centre_x = (self.scroll_x + self.size.width / 2) / before
        centre_y = (self.scroll_y + self.size.height / 2) / before
        self._zoom = zoom
        self.post_message(self.Changed(self))
        if self._scene is None:
            return
        self._resize_virtually(self._layout_of(self._scene))
        # What was in the middle stays there; following the robot may then move it.
        self._place(centre_x * self.zoom - self.size.width / 2, centre_y * self.zoom - self.size.height / 2)
        self._draw()

    def _place(self, x: float, y: float) -> None:
        """Scroll without its counting as the user's wish."""
        placing, self._placing = self._placing, True
        self.scroll_to(x, y, animate=False, force=True)
        self._placing = placing

    def _layout_of(self, scene: Scene) -> Layout:
        size = self.scrollable_content_region.size
        return arrange(scene.maze, self.zoom, size.width, size.height)

    def _resize_virtually(self, layout: Layout) -> None:
        size = Size(*layout.virtual_size)
        if size != self.virtual_size:
            placing, self._placing = self._placing, True
            self.virtual_size = size
            self._placing = placing

    def _keep_robot_in_sight(self, scene: Scene, layout: Layout) -> None:
        if layout.fits or not self._follow:
            return
        window = layout.viewport(scene.maze, self.scroll_offset.x, self.scroll_offset.y)
        x, y = window.to_pixels(np.array([scene.pose.x, scene.pose.y]))
        margin_x, margin_y = min(layout.zoom, layout.columns // 3), min(layout.zoom // 2, layout.rows // 3)
        column, row = float(x), float(y) / 2
        target_x, target_y = window.left, window.top
        # Scrolling resends everything: go far when it has to be, so that it is rarely.
        if not margin_x <= column <= layout.columns - margin_x:
            target_x = round(window.left + column - layout.columns / 2)
        if not margin_y <= row <= layout.rows - margin_y:
            target_y = round(window.top + row - layout.rows / 2)
        if (target_x, target_y) != (window.left, window.top):
            self._place(target_x, target_y)

    def _draw(self) -> None:
        """Bring the cells up to date and mark the changed ones for sending."""
        scene = self._scene
        if not self.is_mounted or not self.scrollable_content_region.size:
            return
        if self._instead:
            self._show_text(self._instead)
            return
        if scene is None:
            return
        try:
            layout = self._layout_of(scene)
            self._resize_virtually(layout)
            self._keep_robot_in_sight(scene, layout)
            self._update(self._picture(scene, layout))
            self.fault = ""
        except Exception as error:  # noqa: BLE001 - a scene that cannot be drawn must not end the run
            self.fault = f"{type(error).__name__}: {error}"
            self._show_text(f"The maze cannot be drawn. {escape(self.fault, 800)}")

    def _picture(self, scene: Scene, layout: Layout) -> Cells:
        cells = blank_cells(layout.height, layout.width)
        if not layout.usable:
            cells.write(0, 0, "Too small for the maze."[: layout.width])
            return cells
        viewport = layout.viewport(scene.maze, self.scroll_offset.x, self.scroll_offset.y)
        cells.paste(self.painter.cells(scene, viewport), layout.y, layout.x)
        draw_axes(cells, layout, viewport, self._signs)
        return cells

    @property
    def _signs(self) -> AxisSigns:
        lines = self.painter.glyphs in (GlyphMode.HYBRID, GlyphMode.HALF)
        return LINES if lines else PLAIN_LINES

    def _show_text(self, text: str) -> None:
        size = self.size
        cells = blank_cells(size.height, size.width)
        for row, line in enumerate(textwrap.wrap(text, size.width)[: size.height]):
            cells.write(row, 0, line)
        self._update(cells)

    def _update(self, cells: Cells) -> None:
        style = self.get_component_rich_style("mazeview--axes")
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
