"""Robust statistics, which a few outliers do not change."""

from __future__ import annotations

import math

import numpy as np

from simmer_tui.sim.arrays import FloatArray

Z_95 = 1.959963984540054
"""97.5 % quantile of the standard normal distribution, for intervals of 95 %."""
MAD_ERROR = 1.17
"""Standard error of a standard deviation by the median, of n normal numbers, times sqrt(n) and over it: its
efficiency is 37 % (P. J. Rousseeuw and C. Croux, 1993)."""
# 1 over the 75 % quantile of the standard normal distribution.
_MAD_TO_SIGMA = 1.4826
# Huber (1964): 95 % efficient where errors are normal.
_HUBER = 1.345
# Of two values no interval is known.
_FEWEST = 3
# The error shrinks to a third or less in each: then it is below a ten-thousandth.
_ROUNDS = 10


def measured(
    known: float, design: FloatArray, target: FloatArray, spread: FloatArray
) -> tuple[float, tuple[float, float] | None]:
    """A factor as it was measured, with its 95 % interval; of one or two values as it is known.

    It is fitted by Huber's weights, iterated (P. J. Huber, "Robust estimation of a location parameter",
    Annals of Mathematical Statistics 35 (1964): 73-101).

    Args:
        known: The factor without the random errors of the target.
        design: The quantity that it multiplies, (n,), not 0 everywhere.
        target: Measured products, (n,).
        spread: Declared standard deviations of these, (n,), above 0. A fit never assumes smaller ones.
    """
    count = len(target)
    if count < _FEWEST:
        return known, None
    rows, aim = design / spread, target / spread
    weights: FloatArray = np.ones(count)
    for _ in range(_ROUNDS):
        value = float((weights * rows * aim).sum() / (weights * rows * rows).sum())
        residuals = aim - value * rows
        away = np.abs(residuals) / max(mad_scale(residuals), 1.0)
        weights = _HUBER / np.maximum(away, _HUBER)
    # Sandwich for M-estimates (Huber, 1973): the influence's variance over the squared share of inliers.
    inlier = max(float((weights >= 1.0).mean()), 0.1)
    variance = float(np.square(weights * residuals).sum()) / (count - 1) / inlier**2
    # At least 1: the set declares the spread, and a lucky sample must not reduce it.
    half = Z_95 * math.sqrt(max(variance, 1.0) / float(np.square(rows).sum()))
    return value, (value - half, value + half)


# Not np.median and np.quantile: they make numpy import its masked arrays, which takes as long as a report of
# 500 commands.
def median_of(values: FloatArray) -> float:
    """Median of numbers, at least one; NaN if one of them is."""
    middle, last = len(values) // 2, len(values) - 1
    ordered = np.partition(values.astype(np.float64), (last - middle, middle, last))
    if np.isnan(ordered[last]):
        return math.nan
    return (float(ordered[last - middle]) + float(ordered[middle])) / 2


def mad_scale(values: FloatArray) -> float:
    """Standard deviation of numbers around 0 by their median absolute value; 0 of none."""
    return _MAD_TO_SIGMA * median_of(np.abs(values)) if len(values) else 0.0
