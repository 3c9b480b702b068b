"""The radar: surroundings of the robot, its front up, with rings of distance and what sensors saw."""

import math

import numpy as np
from textual.strip import Strip

from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import RangeScan
from simmer_tui.sim.specs import CELL_SIZE
from simmer_tui.tui.line_panel import RoleWidget, heading
from simmer_tui.tui.maze.glyphs import BRAILLE, Cells, Signs, blank_cells, dot_patterns, signs_for
from simmer_tui.tui.maze.palette import Attribute, Look, Palette, Role, palette_for
from simmer_tui.tui.maze.scene import Scene
from simmer_tui.tui.maze.shapes import ray_points, reach, to_local
from simmer_tui.tui.strips import CellsWidget
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

# A foot each: three maze cells, further than a robot that looks for walls needs to see.
RINGS = (12.0, 24.0, 36.0)
"""Radii of the rings around the robot's centre, inches."""
_LABEL_ROOM = 2.0
"""Units beyond the last ring, for the code of a sensor whose ray ends there."""
_RING_GAP = 3.0
"""Units between two dots of a ring: fewer than those of a wall, which has one every half unit."""
_LABEL_AT = 1.06
"""Place of a label along its ray, as a multiple of its length: just beyond the end."""


def radar_cells(scene: Scene, maze: Maze, rows: int, columns: int, signs: Signs, palette: Palette) -> Cells:
    """The picture, (rows, columns)."""
    cells = blank_cells(rows, columns)
    scale = (min(columns / 2, float(rows)) - _LABEL_ROOM) / RINGS[-1]
    if scale > 0:
        _Radar(cells, scene, signs, palette, scale).draw(maze)
    return cells


class _Radar:
    """A picture in the making. Its units are those of the maze's picture; `scale` is units an inch."""

    def __init__(self, cells: Cells, scene: Scene, signs: Signs, palette: Palette, scale: float) -> None:
        self.cells, self.scene, self.signs, self.palette, self.scale = cells, scene, signs, palette, scale
        rows, columns = cells.shape
        # A row is two units high.
        self.middle = columns / 2, float(rows)

    def draw(self, maze: Maze) -> None:
        """Rings, walls, rays, their labels, and the robot over all of it."""
        scene, step = self.scene, 1 / (2 * self.scale)
        for radius in RINGS:
            angles = np.arange(0.0, 2 * math.pi, _RING_GAP / (radius * self.scale))
            self._put_dots(Role.GRID, radius * np.stack((np.cos(angles), np.sin(angles)), axis=-1))
        walls = to_local(_wall_faces(maze, scene.pose, step), scene.pose)
        self._put_dots(Role.EDGE, walls[np.hypot(walls[:, 0], walls[:, 1]) <= RINGS[-1]])
        labels = []
        for each in scene.views if scene.show_rays else ():
            if not isinstance(each.view, RangeScan) or not each.view.distances:
                continue
            bright = scene.is_bright(each)
            ray = to_local(_nearest_ray(each.view, step), scene.pose)
            self._put_dots(Role.RAY_STRONG if bright else Role.RAY_WEAK, ray)
            labels.append((ray[-1], each.sensor, Role.RAY_STRONG if bright else Role.TEXT))
        for place, code, role in labels:
            self._put_label(place, code, role)
        self._put_robot()

    def _units(self, places: FloatArray) -> FloatArray:
        """The robot's frame in units of the panel: x right, y down, the front up."""
        x, y = self.middle
        return np.stack((x - places[:, 1] * self.scale, y - places[:, 0] * self.scale), axis=-1)

    def _put_dots(self, role: Role, places: FloatArray) -> None:
        """Dots at places in the robot's frame."""
        cells, signs, palette = self.cells, self.signs, self.palette
        patterns = dot_patterns(2 * self._units(places), *cells.shape)
        there = np.flatnonzero(patterns)
        if signs.dotted:
            cells.characters.reshape(-1)[there] = BRAILLE + patterns[there]
        else:
            wall = role is Role.EDGE and not signs.has_blocks
            cells.characters.reshape(-1)[there] = ord("#") if wall else signs.line(role)
        cells.foreground.reshape(-1)[there] = palette[role]
        dim = Attribute.DIM if palette.is_mono and role is Role.GRID and signs.has_blocks else Attribute.NONE
        cells.attributes.reshape(-1)[there] = dim

    def _put_label(self, end: FloatArray, code: str, role: Role) -> None:
        """Write the code of a sensor beyond the end of its ray."""
        rows, columns = self.cells.shape
        x, y = self._units(end[None] * _LABEL_AT)[0]
        row, column = math.floor(y / 2), math.floor(x - len(code) / 2 + 0.5)
        if 0 <= row < rows and 0 <= column <= columns - len(code):
            self.cells.write(row, column, code, self.palette[role], Attribute.BOLD)

    def _put_robot(self) -> None:
        """The robot's body, cell by cell, and its front."""
        cells, signs, palette = self.cells, self.signs, self.palette
        radius = reach(self.scene.robot) * self.scale
        wide, high = max(1, round(radius)), max(0, round((radius - 1) / 2))
        row, column = math.floor(self.middle[1] / 2), math.floor(self.middle[0])
        body = " " if signs.has_blocks else "O"
        mono = Attribute.REVERSE if palette.is_mono and signs.has_blocks else Attribute.NONE
        for offset in range(-high, high + 1):
            if 0 <= row + offset < cells.shape[0]:
                inset = 1 if abs(offset) == high and high else 0
                left = max(column - wide + inset, 0)
                text = body * (2 * wide + 1 - 2 * inset)
                cells.write(row + offset, left, text, palette[Role.HEADING], mono)
                cells.background[row + offset, left : left + len(text)] = palette[Role.ROBOT]
        cells.write(row, column, signs.arrows[2][0], palette[Role.HEADING], Attribute.BOLD | mono)


def _wall_faces(maze: Maze, pose: Pose, step: float) -> FloatArray:
    """Samples of the faces of walls near a pose, (n, 2), global."""
    reached = RINGS[-1] // CELL_SIZE + 1
    cell = np.array((pose.y, pose.x)) // CELL_SIZE + 1
    along = np.arange(0.0, CELL_SIZE, step)[:, None]
    parts = [np.empty((0, 2))]
    for axis, direction in enumerate(np.eye(2)):
        # A face lies between a wall and a free cell, one row apart or one column.
        faces = np.argwhere(np.diff(maze.walls, axis=axis))
        faces = faces[(np.abs(faces - cell) <= reached).all(axis=1)]
        begins = CELL_SIZE * (faces[:, ::-1] - direction)
        parts.append((begins[:, None] + along * direction).reshape(-1, 2))
    return np.concatenate(parts)


def _nearest_ray(view: RangeScan, step: float) -> FloatArray:
    """Samples of the shortest ray of a fan."""
    nearest = view.distances.index(min(view.distances))
    length = min(view.distances[nearest], RINGS[-1])
    return ray_points(view.origin, view.bearings[nearest], length + step, step)


class RadarPanel(RoleWidget, CellsWidget):
    """Shows the radar below a heading."""

    CELLS_TOP = 1

    def __init__(self, maze: Maze, glyphs: GlyphMode, depth: ColorDepth, *, id: str | None = None) -> None:  # noqa: A002 - as in Textual
        super().__init__(id=id)
        self._maze = maze
        self._glyphs, self._depth = glyphs, depth
        self._shown: tuple[Scene, Look] | None = None

    def show(self, scene: Scene, look: Look) -> None:
        """Show the surroundings of a scene's robot."""
        self._shown = scene, look
        rows, columns = self.size.height - 1, self.size.width
        if columns and rows > 0:
            signs, palette = signs_for(self._glyphs, self._depth), palette_for(self._depth, look)
            cells = radar_cells(scene, self._maze, rows, columns, signs, palette)
            self.show_cells(cells, self.rich_style)

    def on_resize(self) -> None:
        if self._shown is not None:
            self.show(*self._shown)

    def notify_style_update(self) -> None:
        self.forget_cells()
        super().notify_style_update()

    def render_line(self, y: int) -> Strip:
        if y:
            return super().render_line(y)
        note = f"front is up, rings {' '.join(f'{ring:g}' for ring in RINGS)} in"
        title = heading("radar", note, self.size.width, plain=self._glyphs is GlyphMode.ASCII)
        return self.strip(title, self.size.width)
