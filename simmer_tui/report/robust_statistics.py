"""Robust statistics, which a few outliers do not change."""

from __future__ import annotations

import math

import numpy as np

from simmer_tui.sim.arrays import FloatArray

Z_95 = 1.959963984540054
"""97.5 % quantile of the standard normal distribution, for intervals of 95 %."""
# 1 over the 75 % quantile of the standard normal distribution.
_MAD_TO_SIGMA = 1.4826


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


def median_interval(
    values: FloatArray, known: FloatArray | float
) -> tuple[float, tuple[float, float] | None]:
    """The median of some values, and its 95 % interval by order statistics, which assumes no distribution. Of
    few values it is the median of those that are known without random errors."""
    count, ordered = len(values), np.sort(values)
    # The median is between the extremes of five with less than 95 %.
    if count <= 5:
        return median_of(np.atleast_1d(known)), None
    rank = round((count - Z_95 * math.sqrt(count)) / 2) - 1
    return median_of(values), (float(ordered[rank]), float(ordered[-1 - rank]))
