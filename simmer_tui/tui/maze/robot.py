"""The robot on the picture: its body, its heading, and a block that it holds."""

import math

import numpy as np

from simmer_tui.sim.arrays import FloatArray
from simmer_tui.tui.maze.bodies import LARGE, CellRange, cell_range, local_places, patch_of, square_of
from simmer_tui.tui.maze.canvas import Canvas, Patch
from simmer_tui.tui.maze.glyphs import Mask, by_cell, heading_arrow
from simmer_tui.tui.maze.palette import Role
from simmer_tui.tui.maze.scene import Scene
from simmer_tui.tui.maze.shapes import covers, front
from simmer_tui.tui.terminal import ColorDepth

# Off the middle, so that of two cells in a row the arrow takes the one in front.
_AHEAD = 0.2
"""Distance of the arrow ahead of the robot's centre, robot radii."""
# The block in the bundled sets is 3 in wide: its middle, and a visible gap to the rim.
_HELD_BEYOND = 1.9
"""Distance of a held block's middle beyond the robot's rim, inches."""
# Longer than the radius, so that it is visible beside the rim; shorter than a maze cell.
_NEEDLE = 1.25
"""Length of the needle in robot radii."""
_LEAST_NEEDLE = 1.5
"""Least part of it beyond the cells of the body, units: three dots."""
_THICK = 1.75
"""Units of radius from which the needle is two dots wide."""
# The hand is a slot in the body. Of all tried shapes it was the most legible with so few pixels: arrow, dart,
# kite and triangle became a blot or a bar.
_HAND_BEHIND = 0.3
"""Beginning of the hand, robot radii behind the centre; it ends at the rim."""
_HAND_WIDE, _HAND_NARROW = 0.22, 0.18
"""Half of the hand's width in robot radii, and that of a robot with more pixels."""
_NARROW_FROM = 4.0
"""Radius of such a robot, units."""
# 4 x 4 samples give the hand's part of a pixel to 6 %, enough for "at least half".
_SAMPLES = 4


class DrawnRobot:
    """The robot to be drawn. Its centre is moved to whole pixels, so that its outline is the same everywhere.
    `x`, `y` and `radius` are in units of the window, `heading` in degrees."""

    def __init__(self, canvas: Canvas, scene: Scene) -> None:
        self.canvas, self.shape = canvas, scene.robot
        self.scale = canvas.viewport.scale
        self.radius = scene.robot.reach * self.scale
        self.heading = scene.pose.heading
        x, y = canvas.viewport.place(scene.pose.x, scene.pose.y)
        self.x = _to_pixel(x, self.radius, canvas.signs.across, 1.0)
        self.y = _to_pixel(y, self.radius, canvas.signs.down, 2.0)
        self.arrow = heading_arrow(canvas.signs, self.heading)
        self.body = self._body()

    def ahead(self, units: float) -> tuple[float, float]:
        """Place so many units ahead of the centre."""
        across, down = self._direction
        return self.x + units * across, self.y + units * down

    @property
    def _direction(self) -> tuple[float, float]:
        """One unit ahead, x right and y down."""
        heading = math.radians(self.heading)
        return math.cos(heading), -math.sin(heading)

    def _local(self, cells: CellRange, across: int, down: int) -> FloatArray:
        return local_places(cells, self.x, self.y, self.heading, across, down)

    def _body(self) -> Patch | None:
        """Pixels of the body. A smaller one has one cell, or the cells of its arrow."""
        canvas, signs = self.canvas, self.canvas.signs
        cells = cell_range(canvas, self.x, self.y, self.radius + 1)
        if cells is None:
            return None
        mask = covers(self.shape, self._local(cells, signs.across, signs.down) / self.scale)
        if self.radius >= 1 and mask.any():
            return patch_of(canvas, cells, mask)
        row, wide = math.floor(self.y / 2), len(self.arrow)
        column = math.floor(self.x) - (wide - 1) // 2
        if not canvas.holds(row, column) or not canvas.holds(row, column + wide - 1):
            return None
        return Patch(row, column, np.ones((1, wide, signs.pixels), dtype=np.bool_))

    # -- body ------------------------------------------------------------------------------------

    def draw_body(self) -> None:
        """Body, and on it the heading."""
        canvas, patch = self.canvas, self.body
        if patch is None:
            return
        whole = np.zeros(canvas.bodies.shape, dtype=np.bool_)
        whole[patch.place] = patch.covered.all(axis=-1)
        hand = self._hand(patch)
        if hand is None or not (whole[patch.place] & hand.covered.any(axis=-1)).any():
            canvas.area(Role.ROBOT, patch)
            if not canvas.signs.has_blocks:
                self._draw_ends(whole)
            self._draw_arrow(patch, whole)
            return
        # In cells of the rim the ground shows through the hand: the hand's own colour would be a third one
        # there.
        rim = ~whole[patch.place][..., None]
        rest = Patch(patch.row, patch.column, patch.covered & ~(hand.covered & rim))
        emptied = np.zeros(whole.shape, dtype=np.bool_)
        emptied[patch.place] = patch.covered.any(axis=-1) & ~rest.covered.any(axis=-1)
        # A block there shows through as well.
        canvas.clear(emptied & ~canvas.bodies)
        canvas.area(Role.ROBOT, rest)
        canvas.area(Role.HEADING, hand, ~whole, Role.ROBOT)
        canvas.bodies |= emptied
        canvas.heading[patch.place] |= hand.covered.any(axis=-1) & whole[patch.place]

    def _hand(self, patch: Patch) -> Patch | None:
        """Pixels of which at least half belong to the hand; None for a body too small for one."""
        signs, place = self.canvas.signs, patch.place
        if not signs.has_blocks or self.radius < LARGE:
            return None
        local = self._local(place, signs.across * _SAMPLES, signs.down * _SAMPLES) / self.radius
        inside = on_hand(local, _HAND_NARROW if self.radius >= _NARROW_FROM else _HAND_WIDE)
        return patch_of(self.canvas, place, by_cell(inside, _SAMPLES, _SAMPLES).mean(axis=-1) >= 0.5)

    def _draw_ends(self, whole: Mask) -> None:
        """Brackets around the rows of a body of letters, where the arrow leaves room for them."""
        for row in np.flatnonzero(whole.any(axis=1)).tolist():
            columns = np.flatnonzero(whole[row])
            if len(columns) > 2:
                self.canvas.text(row, int(columns[0]), "(", Role.HEADING, Role.ROBOT)
                self.canvas.text(row, int(columns[-1]), ")", Role.HEADING, Role.ROBOT)

    def _draw_arrow(self, patch: Patch, whole: Mask) -> None:
        """One arrow in the wholly covered cell nearest to a place ahead of the centre."""
        canvas, arrow = self.canvas, self.arrow
        fits = whole.copy()
        for shift in range(1, len(arrow)):
            fits[:, :-shift] &= whole[:, shift:]
            fits[:, -shift:] = False
        if not fits.any():
            # No cell is wholly in a small body; the one that it covers most is filled up.
            counts = np.zeros(whole.shape)
            counts[patch.place] = patch.covered.sum(axis=-1)
            fits[np.unravel_index(counts.argmax(), counts.shape)] = True
        x, y = self.ahead(_AHEAD * self.radius)
        rows, columns = np.nonzero(fits)
        distance = (columns + len(arrow) / 2 - x) ** 2 + (2 * rows + 1 - y) ** 2
        # Of two equally near, the one in which the needle begins.
        nearest = len(distance) - 1 - int(distance[::-1].argmin())
        row, column = int(rows[nearest]), int(columns[nearest])
        canvas.text(row, column, arrow, Role.HEADING, Role.ROBOT)
        canvas.bodies[row, column : column + len(arrow)] = True
        canvas.heading[row, column : column + len(arrow)] = True

    # -- ahead of the body -----------------------------------------------------------------------

    def draw_needle(self) -> None:
        """Draw dots ahead of the robot, up to the next wall. The body covers their beginning."""
        canvas = self.canvas
        spare = canvas.backdrop.keeps_wall.copy()
        if self.body is not None:
            spare[self.body.place] |= self.body.covered.any(axis=-1)
        rim = front(self.shape) * self.scale
        tip = rim + _NEEDLE * self.radius
        # Less than half a dot apart, and beyond the tip by as much as the cells of the body may reach.
        along = np.arange(rim, tip + 4, 0.2)
        across, down = self._direction
        x, y = self.x + along * across, self.y + along * down
        on_body = canvas.are_in(spare, x, y)
        tip = max(tip, float(along[int(on_body.argmin())]) + _LEAST_NEEDLE)
        ends = canvas.backdrop.in_wall(x, y) | (along > tip)
        dots = 2 * np.stack((x, y), axis=-1)[: int(ends.argmax())]
        if self.radius >= _THICK and canvas.signs.dotted:
            aside = 0.5 * np.array([-down, across])
            dots = np.concatenate((dots - aside, dots + aside))
        canvas.dots(Role.ROBOT, dots, spare)

    def draw_held(self, size: float) -> None:
        """The block in the gripper, ahead of the robot. It takes the cells that are not mostly robot."""
        canvas = self.canvas
        x, y = self.ahead(front(self.shape) * self.scale + max(_HELD_BEYOND * self.scale, 0.75))
        if canvas.palette.depth is ColorDepth.COLORS_16 and canvas.signs.has_blocks:
            # Colours chosen by the user may be too near each other; brackets on the ground are not.
            canvas.text(math.floor(y / 2), round(x - 1), "[]", Role.BLOCK)
            return
        patch = square_of(canvas, x, y, size * self.scale)
        if patch is None:
            return
        spare = canvas.heading.copy()
        if self.body is not None:
            spare[self.body.place] |= self.body.covered.mean(axis=-1) > 0.5
        canvas.area(Role.BLOCK, patch, spare)


def on_hand(places: FloatArray, half: float = _HAND_WIDE) -> Mask:
    """True for places (..., 2) in the robot's frame that are on its hand, which is twice `half` wide; all in
    robot radii."""
    inside: Mask = (places[..., 0] >= -_HAND_BEHIND) & (np.abs(places[..., 1]) <= half)
    return inside


def _to_pixel(place: float, radius: float, pixels: int, cell: float) -> float:
    """The place nearest to `place` at which a body covers whole pixels, and at least one whole cell. A cell
    of `cell` units has `pixels` of them."""
    pixel = cell / pixels
    count = max(1, round(2 * radius / pixel))
    # A body less than nearly two cells wide has to begin at a cell's border.
    step = pixel if count >= 2 * pixels - 1 else cell
    return math.floor((place - count * pixel / 2) / step + 0.5) * step + count * pixel / 2
