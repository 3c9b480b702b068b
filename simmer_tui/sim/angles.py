"""Trigonometry in degrees, exact at multiples of 90."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_QUADRANTS = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}


def cos_sin(degrees: float) -> tuple[float, float]:
    """Cosine and sine of an angle in degrees; a robot facing a wall squarely has no rounding."""
    angle = math.fmod(degrees, 360.0)
    if angle < 0.0:
        angle += 360.0
    exact = _QUADRANTS.get(angle)
    if exact is not None:
        return exact
    radians = math.radians(angle)
    return math.cos(radians), math.sin(radians)


def cos_sin_array(degrees: FloatArray) -> tuple[FloatArray, FloatArray]:
    """`cos_sin` for an array of any shape; the same numbers, bit for bit.

    Not by numpy's own functions: their last bits differ from one kind of CPU to another.
    """
    angle = np.fmod(degrees, 360.0)
    angle = np.where(angle < 0.0, angle + 360.0, angle)
    radians = np.radians(angle).ravel().tolist()
    cos = np.array(list(map(math.cos, radians)), dtype=np.float64).reshape(angle.shape)
    sin = np.array(list(map(math.sin, radians)), dtype=np.float64).reshape(angle.shape)
    if (np.fmod(angle, 90.0) == 0.0).any():
        for quadrant, (exact_cos, exact_sin) in _QUADRANTS.items():
            here = angle == quadrant
            cos[here], sin[here] = exact_cos, exact_sin
    return cos, sin


def rotation(degrees: float) -> FloatArray:
    """The (2, 2) matrix that turns column vectors counter-clockwise."""
    cos, sin = cos_sin(degrees)
    return np.array(((cos, -sin), (sin, cos)))
