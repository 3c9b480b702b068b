"""The radar: what is around the robot, its front up, with rings of distance and what sensors saw."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from simmer_tui.sim.maze import Maze
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import RangeScan
from simmer_tui.sim.specs import CELL_SIZE
from simmer_tui.tui.line_panel import ROLE_CLASSES, RoleStyles, heading
from simmer_tui.tui.maze.glyphs import BRAILLE, DOT_BITS, Cells, Signs, blank_cells, signs_for
from simmer_tui.tui.maze.palette import Attribute, Look, Palette, Role, palette_for
from simmer_tui.tui.maze.scene import Scene
from simmer_tui.tui.strips import changed_spans, make_strip
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

RINGS = (12.0, 24.0, 36.0)
"""Inches around the robot's centre."""
_LABEL_ROOM = 2.0
"""Units beyond the last ring."""
_RING_GAP = 3.0
"""Units between two dots of a ring."""

Places = NDArray[np.float64]


def radar_cells(scene: Scene, maze: Maze, rows: int, columns: int, signs: Signs, palette: Palette) -> Cells:
    """The picture, (rows, columns)."""
    cells = blank_cells(rows, columns)
    scale = (min(columns / 2, float(rows)) - _LABEL_ROOM) / RINGS[-1]
    if scale <= 0:
        return cells
    middle = columns / 2, float(rows)

    def put(role: Role, places: Places) -> None:
        """Dots at places in the robot's frame."""
        _put_dots(cells, signs, palette, role, _units(places, middle, scale))

    for radius in RINGS:
        angles = np.arange(0.0, 2 * math.pi, _RING_GAP / (radius * scale))
        put(Role.GRID, radius * np.stack((np.cos(angles), np.sin(angles)), axis=-1))
    walls = _local(_wall_faces(maze, scene.pose, 1 / (2 * scale)), scene.pose)
    put(Role.EDGE, walls[np.hypot(walls[:, 0], walls[:, 1]) <= RINGS[-1]])
    labels = []
    for view in scene.views if scene.show_rays else ():
        if not isinstance(view.view, RangeScan) or not view.view.distances:
            continue
        last = view is scene.views[-1] or view.sensor == scene.chosen != ""
        ray = _local(_nearest_ray(view.view, 1 / (2 * scale)), scene.pose)
        put(Role.RAY_STRONG if last else Role.RAY_WEAK, ray)
        labels.append((ray[-1], view.sensor, Role.RAY_STRONG if last else Role.TEXT))
    for place, code, role in labels:
        x, y = _units(place[None] * 1.06, middle, scale)[0]
        row, column = math.floor(y / 2), math.floor(x - len(code) / 2 + 0.5)
        if 0 <= row < rows and 0 <= column <= columns - len(code):
            cells.write(row, column, code, palette[role], Attribute.BOLD)
    _put_robot(cells, scene, signs, palette, middle, scale)
    return cells


def _local(places: Places, pose: Pose) -> Places:
    """Global places in the robot's frame, x ahead and y left."""
    heading = math.radians(pose.heading)
    x, y = places[:, 0] - pose.x, places[:, 1] - pose.y
    cos, sin = math.cos(heading), math.sin(heading)
    return np.stack((cos * x + sin * y, cos * y - sin * x), axis=-1)


def _units(places: Places, middle: tuple[float, float], scale: float) -> Places:
    """The robot's frame in units of the panel: x right, y down, the front up."""
    return np.stack((middle[0] - places[:, 1] * scale, middle[1] - places[:, 0] * scale), axis=-1)


def _wall_faces(maze: Maze, pose: Pose, step: float) -> Places:
    """Samples of the faces of walls near a pose, (n, 2), global."""
    reach = int(RINGS[-1] // CELL_SIZE) + 1
    column, row = int(pose.x // CELL_SIZE) + 1, int(pose.y // CELL_SIZE) + 1
    walls = maze.walls
    along = np.arange(0.0, CELL_SIZE, step)
    parts = [np.empty((0, 2))]
    for i in range(max(row - reach, 0), min(row + reach + 1, walls.shape[0])):
        for j in range(max(column - reach, 0), min(column + reach + 1, walls.shape[1])):
            x, y = (j - 1) * CELL_SIZE, (i - 1) * CELL_SIZE
            if j + 1 < walls.shape[1] and walls[i, j] != walls[i, j + 1]:
                parts.append(np.stack((np.full(len(along), x + CELL_SIZE), y + along), axis=-1))
            if i + 1 < walls.shape[0] and walls[i, j] != walls[i + 1, j]:
                parts.append(np.stack((x + along, np.full(len(along), y + CELL_SIZE)), axis=-1))
    return np.concatenate(parts)


def _nearest_ray(view: RangeScan, step: float) -> Places:
    """Samples of the shortest ray of a fan."""
    nearest = view.distances.index(min(view.distances))
    length = min(view.distances[nearest], RINGS[-1])
    along = np.arange(0.0, length + step, step)[:, None]
    bearing = math.radians(view.bearings[nearest])
    ray: Places = np.array(view.origin) + along * np.array((math.cos(bearing), math.sin(bearing)))
    return ray


def _put_dots(cells: Cells, signs: Signs, palette: Palette, role: Role, units: Places) -> None:
    rows, columns = cells.shape
    x, y = np.floor(2 * units).astype(np.intp).T
    seen = (x >= 0) & (x < 2 * columns) & (y >= 0) & (y < 4 * rows)
    x, y = x[seen], y[seen]
    patterns = np.zeros(rows * columns, dtype=np.uint32)
    np.bitwise_or.at(patterns, (y >> 2) * columns + (x >> 1), DOT_BITS[y & 3, x & 1])
    there = np.flatnonzero(patterns)
    sign = "#" if role is Role.EDGE and not signs.has_blocks else chr(signs.line(role)) if signs.lines else ""
    cells.characters.reshape(-1)[there] = BRAILLE + patterns[there] if signs.dotted else ord(sign)
    cells.foreground.reshape(-1)[there] = palette[role]
    dim = Attribute.DIM if palette.is_mono and role is Role.GRID and signs.has_blocks else Attribute.NONE
    cells.attributes.reshape(-1)[there] = dim


def _put_robot(
    cells: Cells,
    scene: Scene,
    signs: Signs,
    palette: Palette,
    middle: tuple[float, float],
    scale: float,
) -> None:
    """The robot's body, cell by cell, and its front."""
    radius = scene.robot.radius or max(math.hypot(x, y) for x, y in scene.robot.vertices)
    wide = max(1, round(radius * scale))
    high = max(0, round((radius * scale - 1) / 2))
    row, column = math.floor(middle[1] / 2), math.floor(middle[0])
    body = " " if signs.has_blocks else "O"
    mono = Attribute.REVERSE if palette.is_mono and signs.has_blocks else Attribute.NONE
    for offset in range(-high, high + 1):
        if 0 <= row + offset < cells.shape[0]:
            inset = 1 if abs(offset) == high and high else 0
            left = max(column - wide + inset, 0)
            text = body * (2 * wide + 1 - 2 * inset)
            cells.write(row + offset, left, text, palette[Role.HEADING], mono)
            cells.background[row + offset, left : left + len(text)] = palette[Role.ROBOT]
    arrow = signs.arrows[2][0]
    cells.write(row, column, arrow, palette[Role.HEADING], Attribute.BOLD | mono)


class RadarPanel(Widget):
    """Shows the radar below a heading, and sends only what has changed."""

    COMPONENT_CLASSES: ClassVar[set[str]] = ROLE_CLASSES
    ALLOW_SELECT = False

    def __init__(self, maze: Maze, glyphs: GlyphMode, depth: ColorDepth, *, id: str | None = None) -> None:  # noqa: A002 - as in Textual
        self._role_styles = RoleStyles(self)
        super().__init__(id=id)
        self._maze = maze
        self._glyphs, self._depth = glyphs, depth
        self._cells: Cells | None = None
        self._strips: list[Strip] = []
        self._shown: tuple[Scene, Look] | None = None

    def show(self, scene: Scene, look: Look) -> None:
        """Show what is around the robot of a scene."""
        self._shown = scene, look
        if self.size.width and self.size.height > 1:
            signs, palette = signs_for(self._glyphs, self._depth), palette_for(self._depth, look)
            size = self.size.height - 1, self.size.width
            self._update(radar_cells(scene, self._maze, *size, signs, palette))

    def _update(self, cells: Cells) -> None:
        before, self._cells = self._cells, cells
        style = self.rich_style
        if before is None or before.shape != cells.shape:
            self._strips = [make_strip(cells, row, style) for row in range(cells.shape[0])]
            self.refresh()
            return
        for row in {span.row for span in changed_spans(before, cells, None)}:
            self._strips[row] = make_strip(cells, row, style)
            self.refresh(Region(0, row + 1, self.size.width, 1))

    def on_resize(self) -> None:
        self._cells = None
        if self._shown is not None:
            self.show(*self._shown)

    def notify_style_update(self) -> None:
        self._role_styles.forget()
        self._cells = None
        super().notify_style_update()

    def render_line(self, y: int) -> Strip:
        width = self.size.width
        if y == 0:
            rings = " ".join(f"{ring:g}" for ring in RINGS)
            note = f"front is up, rings {rings} in"
            return self._role_styles.strip(
                heading("radar", note, width, plain=self._glyphs is GlyphMode.ASCII), width
            )
        if y - 1 < len(self._strips):
            return self._strips[y - 1]
        return Strip.blank(width, self.rich_style)
