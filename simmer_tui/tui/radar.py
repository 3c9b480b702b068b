"""The radar: surroundings of the robot, its front up, with rings of distance and the sensors' readings."""

import math

import numpy as np
from textual.strip import Strip

from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.records import RangeScan
from simmer_tui.sim.specs import CELL_SIZE
from simmer_tui.tui.line_panel import RoleWidget, heading
from simmer_tui.tui.maze.glyphs import BRAILLE, Cells, Mask, Signs, blank_cells, dot_patterns, signs_for
from simmer_tui.tui.maze.palette import DEFAULT, Attribute, Look, Palette, Role, palette_for
from simmer_tui.tui.maze.robot import on_hand
from simmer_tui.tui.maze.scene import Scene, SensorView
from simmer_tui.tui.maze.shapes import covers, ray_points, to_local
from simmer_tui.tui.strips import CellsWidget
from simmer_tui.tui.terminal import ColorDepth, GlyphMode

_SCALES = (2 * CELL_SIZE, 3 * CELL_SIZE, 4 * CELL_SIZE)
"""Distances that the outer ring may have, inches."""
_RING_EVERY = CELL_SIZE
"""Inches from one ring to the next."""
_MOST = 0.75
"""Share of the last readings that the scale must hold."""
_LABEL_ROOM = 2.0
"""Units beyond the last ring, for the code of a sensor whose ray ends there."""
# A wall has two a unit. With fewer than these a ring does not look like a circle.
_RING_GAP = 1.2
"""Units between two dots of a ring."""
_RING_NUMBERS = math.radians(-90.0 - 28.0)
"""Direction of the rings' numbers from the front: on the lower right, where bundled sets have no sensor."""
# Twice as many as the panel has dots across, so that a wall has no gaps.
_LOOKS = 720
"""Directions in which walls are searched for around the robot."""
_LEAST_ROBOT = 2.4
"""Least radius of the robot, units: a smaller one shows no hand."""
_NO_ECHO = 9.0
"""Length of the stub of a ray without an echo, inches."""
_BEAM = 10.0
"""Degrees from which a beam has two sides, and an arc at its end."""
_SPARSE = 1.5
"""Units between two dots of the sides of a beam."""
_GIVES_WAY = (1.06, 1.18, 0.9, 0.75)
"""Places of a label along its ray, as multiples of its length: beyond the end, then further out, then in."""


def radar_scale(scene: Scene) -> float:
    """Distance of the outer ring, inches: the least that holds three quarters of the last readings."""
    read = [each.reading for each in scene.views if isinstance(each.view, RangeScan)]
    finite = [value for value in read if value is not None and math.isfinite(value)]
    for scan in scene.scans:
        finite += scan.ranges.tolist()
    finite.sort()
    if not finite:
        return _SCALES[0]
    wanted = finite[math.ceil(_MOST * len(finite)) - 1]
    return next((scale for scale in _SCALES if scale >= wanted), _SCALES[-1])


def radar_cells(scene: Scene, maze: Maze, rows: int, columns: int, signs: Signs, palette: Palette) -> Cells:
    """The picture, (rows, columns)."""
    radar = _Radar(scene, rows, columns, signs, palette)
    if radar.scale > 0:
        radar.draw(maze)
    return radar.cells


class _Radar:
    """A picture while it is drawn. Its units are those of the maze's picture. `scale` is units an inch,
    `outer` the distance of the outer ring, inches."""

    def __init__(self, scene: Scene, rows: int, columns: int, signs: Signs, palette: Palette) -> None:
        self.cells, self.scene, self.signs, self.palette = blank_cells(rows, columns), scene, signs, palette
        self.outer = radar_scale(scene)
        self.scale = (min(columns / 2, float(rows)) - _LABEL_ROOM) / self.outer
        # A row is two units high.
        self.middle = columns / 2, float(rows)
        self._labels: list[tuple[int, int, int]] = []

    def draw(self, maze: Maze) -> None:
        """Rings, walls, rays, block and robot, and the labels over all of it."""
        scene = self.scene
        rings = np.arange(_RING_EVERY, self.outer + 1.0, _RING_EVERY).tolist()
        for radius in rings:
            angles = np.arange(0.0, 2 * math.pi, _RING_GAP / (radius * self.scale))
            self._put_dots(Role.RING, radius * _directions(angles))
        self._put_dots(Role.EDGE, self._walls(maze))
        # A dot at the end of each beam, over the walls there.
        for scan in scene.scans if "plot_sense" in scene.shown else ():
            places = to_local(scan.ends, scene.pose)
            self._put_dots(Role.RAY_STRONG, places[np.hypot(*places.T) <= self.outer])
        rays = [each for each in scene.views if isinstance(each.view, RangeScan) and each.view.distances]
        ends = [self._put_ray(each) for each in rays] if "plot_sense" in scene.shown else []
        self._put_block()
        self._put_robot()
        for radius in rings:
            text = f"{radius:g} in" if radius == rings[-1] else f"{radius:g}"
            self._put_text(radius * _directions(np.array([_RING_NUMBERS]))[0], text, Role.DIM_TEXT, (1.0,))
        # The newest has the best place.
        for end, text, role in reversed(ends):
            self._put_text(end, text, role, _GIVES_WAY)

    def _walls(self, maze: Maze) -> FloatArray:
        """Places of walls in sight of the robot, (n, 2), in its frame."""
        pose = self.scene.pose
        if maze.is_wall(pose.x, pose.y):
            return np.empty((0, 2))
        angles = np.linspace(0.0, 2 * math.pi, _LOOKS, endpoint=False)
        directions = _directions(angles)
        x, y = np.full(_LOOKS, pose.x), np.full(_LOOKS, pose.y)
        found = maze.cast_many(x, y, directions[:, 0], directions[:, 1])
        near = np.flatnonzero(found <= self.outer)
        places = np.array((pose.x, pose.y)) + found[near, None] * directions[near]
        return to_local(places, pose)

    def _put_ray(self, each: SensorView) -> tuple[FloatArray, str, Role]:
        """Draw the ray of a reading, as long as the range read. Returns its end, its label and the label's
        colour."""
        view, pose, scale = each.view, self.scene.pose, self.scale
        assert isinstance(view, RangeScan), "only those have rays"
        bright = self.scene.is_bright(each)
        role, ink = (Role.RAY_STRONG, Role.RAY_STRONG) if bright else (Role.RAY_WEAK, Role.TEXT)
        length = min(view.distances) if each.reading is None else each.reading
        echo = math.isfinite(length)
        shown = max(min(length, self.outer), 0.0) if echo else _NO_ECHO
        middle = view.bearings[len(view.bearings) // 2]
        step = 1 / (2 * scale)
        ray = to_local(ray_points(view.origin, middle, np.arange(0.0, shown + step, step)), pose)
        self._put_dots(role, ray)
        wide = max(view.bearings) - min(view.bearings)
        if echo and wide >= _BEAM:
            for bearing in (min(view.bearings), max(view.bearings)):
                side = ray_points(view.origin, bearing, np.arange(0.0, shown, _SPARSE / scale))
                self._put_dots(role, to_local(side, pose))
            # At two feet two degrees are 0.8 in: an arc as sparse as the sides.
            angles = np.radians(np.arange(min(view.bearings), max(view.bearings), 2.0))
            arc = np.array(view.origin) + shown * _directions(angles)
            self._put_dots(role, to_local(arc, pose))
        none = "-" if not self.signs.has_blocks else "–"
        return ray[-1], each.sensor if echo else f"{each.sensor} {none}", ink

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
        dim = Attribute.DIM if palette.is_mono and role is Role.RING and signs.has_blocks else Attribute.NONE
        cells.attributes.reshape(-1)[there] = dim

    def _put_text(self, end: FloatArray, text: str, role: Role, places: tuple[float, ...]) -> None:
        """Write a label along the ray to `end`, at the first free one of `places`."""
        rows, columns = self.cells.shape
        for place in places:
            x, y = self._units(end[None] * place)[0]
            row, column = math.floor(y / 2), math.floor(x - len(text) / 2 + 0.5)
            fits = 0 <= row < rows and 0 <= column <= columns - len(text)
            until = column + len(text)
            taken = any(row == at and column <= stop and start <= until for at, start, stop in self._labels)
            if fits and not taken:
                self._labels.append((row, column, until))
                bold = Attribute.NONE if role is Role.DIM_TEXT else Attribute.BOLD
                self.cells.write(row, column, text, self.palette[role], bold)
                return

    # -- block and robot -------------------------------------------------------------------------

    def _pixels(self, scale: float) -> FloatArray:
        """Middles of all pixels in the robot's frame, inches, (rows * down, columns * across, 2)."""
        rows, columns = self.cells.shape
        across, down = self.signs.across, self.signs.down
        x = (np.arange(columns * across) + 0.5) / across
        y = (np.arange(rows * down) + 0.5) * 2 / down
        left, ahead = (self.middle[0] - x) / scale, (self.middle[1] - y) / scale
        return np.stack(np.broadcast_arrays(ahead[:, None], left[None, :]), axis=-1)

    def _put_pixels(self, role: Role, mask: Mask, paper: Role | None = None) -> None:
        """Draw pixels over the picture, on the ground or on a `paper`."""
        cells, signs, palette = self.cells, self.signs, self.palette
        patterns = signs.patterns(signs.by_cell(mask))
        there = patterns > 0
        reverse = palette.is_mono and paper is not None
        cells.characters[there] = np.array(signs.blocks, dtype=np.uint32)[patterns[there]]
        cells.foreground[there] = palette[role]
        cells.background[there] = DEFAULT if paper is None else palette[paper]
        cells.attributes[there] = Attribute.REVERSE if reverse else Attribute.NONE

    def _put_block(self) -> None:
        scene = self.scene
        if scene.block_centre is None:
            return
        centre = to_local(np.array([scene.block_centre]), scene.pose)[0]
        if math.hypot(*centre) > self.outer:
            return
        if self.signs.has_blocks:
            away = np.abs(self._pixels(self.scale) - centre).max(axis=-1)
            mask = away <= max(scene.block_size / 2, 1 / self.scale)
            self._put_pixels(Role.BLOCK, mask)
        else:
            self._put_text(centre, "B", Role.BLOCK, (1.0,))

    def _put_robot(self) -> None:
        """Draw the robot's body, its front up, with the same hand as in the maze."""
        radius = self.scene.robot.reach
        scale = max(self.scale, _LEAST_ROBOT / radius)
        if not self.signs.has_blocks:
            self._put_letters(round(radius * scale))
            return
        places = self._pixels(scale)
        body: Mask = covers(self.scene.robot, places)
        hand = on_hand(places / radius)
        pixels = np.ones((self.signs.down, self.signs.across), dtype=np.bool_)
        whole = np.kron(self.signs.by_cell(body).all(axis=-1), pixels)
        # In cells of the rim the ground shows through the hand: the hand's own colour would be a third one
        # there.
        self._put_pixels(Role.ROBOT, body & ~(hand & ~whole))
        self._put_pixels(Role.HEADING, hand & whole, Role.ROBOT)

    def _put_letters(self, radius: int) -> None:
        """The robot in ASCII: a body of letters, and an arrow."""
        row, column = math.floor(self.middle[1] / 2), math.floor(self.middle[0])
        wide, high = max(1, radius), max(0, round((radius - 1) / 2))
        for offset in range(-high, high + 1):
            if 0 <= row + offset < self.cells.shape[0]:
                left = max(column - wide, 0)
                self.cells.write(row + offset, left, "O" * (2 * wide + 1), self.palette[Role.ROBOT])
        self.cells.write(row, column, self.signs.arrows[2][0], self.palette[Role.ROBOT], Attribute.BOLD)


def _directions(angles: FloatArray) -> FloatArray:
    """Unit vectors, (n, 2)."""
    return np.stack((np.cos(angles), np.sin(angles)), axis=-1)


class RadarPanel(RoleWidget, CellsWidget):
    """Shows the radar below a heading."""

    CELLS_TOP = 1

    def __init__(self, maze: Maze, glyphs: GlyphMode, depth: ColorDepth) -> None:
        super().__init__(id="radar")
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
        note = f"front is up, rings every {_RING_EVERY:g} in"
        title = heading("radar", note, self.size.width, plain=self._glyphs is GlyphMode.ASCII)
        return self.strip(title, self.size.width)
