"""The drive law in closed form: the pose that a movement's totals lead to.

A movement of totals (x, y, r) is cut into n parts, each of which turns by r / n and then goes (x, y) / n
in its new frame (sim/motion.py). Rotations in a plane commute, so all parts together go c(r) (x, y), with
(x, y) as a complex number and c(r) = sum over k from 1 to n of exp(i k r / n) / n.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.angles import FloatArray

ComplexArray = NDArray[np.complex128]


def chord_factor(turn: FloatArray, segments: int) -> tuple[ComplexArray, ComplexArray]:
    """c(r) for (m,) turns in degrees, and its derivative by a degree.

    The geometric sum is sin(r / 2) / (n sin(r / 2n)) exp(i r (n + 1) / 2n).
    """
    half = np.radians(turn) / 2
    n = float(segments)
    below = n * np.sin(half / n)
    # Near a straight line by the first terms of the series: at 1e-4 the next one is 1e-16.
    straight = np.abs(below) < 1e-4
    safe = np.where(straight, 1.0, below)
    length = np.where(straight, 1.0 - half**2 * (1 - 1 / n**2) / 6, np.sin(half) / safe)
    slope = np.where(
        straight, -half * (1 - 1 / n**2) / 6, (np.cos(half) - length * np.cos(half / n)) / (2 * safe)
    )
    mean = (n + 1) / (2 * n)
    direction = np.exp(2j * half * mean)
    return length * direction, (slope + 1j * mean * length) * direction * (np.pi / 180.0)


def displacement(totals: FloatArray, segments: int) -> ComplexArray:
    """Displacements, (m,), in the frame of the start, by (m, 3) totals of x, y (inches) and r (degrees)."""
    return chord_factor(totals[:, 2], segments)[0] * (totals[:, 0] + 1j * totals[:, 1])


def moved(poses: FloatArray, totals: FloatArray, segments: int) -> FloatArray:
    """The poses, (m, 3), to which totals lead from (m, 3) poses in free space."""
    way = displacement(totals, segments) * np.exp(1j * np.radians(poses[:, 2]))
    return np.column_stack((poses[:, 0] + way.real, poses[:, 1] + way.imag, poses[:, 2] + totals[:, 2]))


def totals_between(before: FloatArray, after: FloatArray, segments: int) -> FloatArray:
    """The totals, (m, 3), that lead from poses to poses in free space: the inverse of `moved`."""
    turn = after[:, 2] - before[:, 2]
    way = (after[:, 0] - before[:, 0]) + 1j * (after[:, 1] - before[:, 1])
    local = way * np.exp(-1j * np.radians(before[:, 2])) / chord_factor(turn, segments)[0]
    return np.column_stack((local.real, local.imag, turn))
