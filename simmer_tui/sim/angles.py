"""Angles in degrees: trigonometry, exact at multiples of 90, and the eight directions of a turn.

Tables of eight directions begin at 0 degrees and go counter-clockwise.
"""

import math
from typing import TypeVar

import numpy as np

from simmer_tui.sim.arrays import FloatArray

_Angle = TypeVar("_Angle", float, FloatArray)

ARROWS = ("→", "↗", "↑", "↖", "←", "↙", "↓", "↘")
"""Arrows to 0, 45 ... 315 degrees, counter-clockwise from the right."""
PLAIN_ARROWS = (">", "/", "^", "\\", "<", "/", "v", "\\")
"""The same in ASCII. Those of diagonals are lines, with one sign for both ends."""

MOST_HEADINGS = 360
"""Most headings of a grid of poses, and of a belief: one a degree."""
# For at most so many angles a loop is quicker than array operations.
_FEW = 32
# 360 is what a tiny negative angle becomes when a whole turn is added.
_QUADRANTS = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0), 360.0: (1.0, 0.0)}


def half_turn(degrees: _Angle) -> _Angle:
    """The same direction as an angle in (-180, 180], or an array of them; NaN for infinity."""
    # From 180 downwards: the remainder is from 0 to below 360.
    return 180.0 - (180.0 - degrees) % 360.0


def eighth_of_turn(degrees: float) -> int:
    """The eighth of a turn that an angle is nearest to, 0 to 7."""
    return round(degrees / 45.0) % 8


def side_name(bearing: float, ahead: str = "ahead", behind: str = "behind") -> str:
    """Side of the robot in a direction, degrees from its front: `ahead left`.

    Args:
        bearing: Degrees, counter-clockwise.
        ahead: Word for the robot's +X.
        behind: Word for its -X.
    """
    return (
        *(ahead, f"{ahead} left", "left", f"{behind} left"),
        *(behind, f"{behind} right", "right", f"{ahead} right"),
    )[eighth_of_turn(bearing)]


def cos_sin(degrees: float) -> tuple[float, float]:
    """Cosine and sine of an angle in degrees, exact at multiples of 90."""
    # fmod is exact, so that whole turns change no bit of the result.
    angle = math.fmod(degrees, 360.0)
    if angle < 0.0:
        angle += 360.0
    # The library's cosine of 90 degrees is 6e-17: a robot that drives along a wall would drift into it.
    if angle in _QUADRANTS:
        return _QUADRANTS[angle]
    radians = math.radians(angle)
    return math.cos(radians), math.sin(radians)


def cos_sin_array(degrees: FloatArray) -> tuple[FloatArray, FloatArray]:
    """`cos_sin` for an array of any shape; the same numbers, bit for bit.

    Not by numpy's own functions: their last bits differ from one kind of CPU to another.
    """
    if degrees.size <= _FEW:
        pairs = np.array([cos_sin(angle) for angle in degrees.ravel().tolist()]).reshape(degrees.size, 2)
        return pairs[:, 0].reshape(degrees.shape), pairs[:, 1].reshape(degrees.shape)
    angle = degrees
    if degrees.min() < 0.0 or degrees.max() >= 360.0:
        angle = np.fmod(degrees, 360.0)
        angle[angle < 0.0] += 360.0
    radians = np.radians(angle).ravel().tolist()
    count = len(radians)
    cos = np.fromiter(map(math.cos, radians), np.float64, count).reshape(angle.shape)
    sin = np.fromiter(map(math.sin, radians), np.float64, count).reshape(angle.shape)
    quarters = angle / 90.0
    # Rounding may include angles slightly beyond.
    near = quarters == np.rint(quarters)
    for index in zip(*np.nonzero(near), strict=True):
        cos[index], sin[index] = cos_sin(float(angle[index]))
    return cos, sin


def turned(points: FloatArray, cos: float | FloatArray, sin: float | FloatArray) -> FloatArray:
    """Points, (..., n, 2), turned counter-clockwise by the angle of this cosine and sine; by k angles, of
    shape (k, 1), they are (k, n, 2). Written out: products of matrices round differently from one processor
    to the next."""
    x, y = points[..., 0], points[..., 1]
    return np.stack((cos * x - sin * y, sin * x + cos * y), axis=-1)


def rotation(degrees: float) -> FloatArray:
    """The (2, 2) matrix that turns column vectors counter-clockwise."""
    cos, sin = cos_sin(degrees)
    return np.array(((cos, -sin), (sin, cos)))
