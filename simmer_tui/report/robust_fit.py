"""Robust fits, which a few outliers do not change, and their probabilities."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

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
# Most iterations of a fit.
_ROUNDS = 20


class RobustFit(Struct, frozen=True):
    """Coefficients of a linear fit with their standard errors, (k,), of `count` values."""

    values: FloatArray
    errors: FloatArray
    count: int

    def interval(self, place: int) -> tuple[float, float]:
        """The 95 % interval of a coefficient."""
        half = Z_95 * float(self.errors[place])
        return float(self.values[place]) - half, float(self.values[place]) + half


def robust_fit(design: FloatArray, target: FloatArray, spread: FloatArray) -> RobustFit:
    """Fit by Huber's weights, iterated (P. J. Huber, "Robust estimation of a location parameter", Annals of
    Mathematical Statistics 35 (1964): 73-101).

    Args:
        design: (n, k).
        target: (n,).
        spread: Declared standard deviations of the target, (n,), above 0. A fit never assumes smaller ones.
    """
    rows, aim = design / spread[:, None], target / spread
    weights: FloatArray = np.ones(len(aim))
    values: FloatArray = np.zeros(design.shape[1])
    scale = 1.0
    for _ in range(_ROUNDS):
        weighted = rows * weights[:, None]
        normal, right = _product("ni,nj->ij", weighted, rows), _product("ni,n->i", weighted, aim)
        fresh = np.linalg.lstsq(normal, right, rcond=None)[0].astype(np.float64)
        residuals = aim - _product("ni,i->n", rows, fresh)
        scale = max(mad_scale(residuals), 1.0)
        away = np.abs(residuals) / scale
        weights = np.where(away <= _HUBER, 1.0, _HUBER / np.maximum(away, _HUBER))
        moved = np.abs(fresh - values).max()
        values = fresh
        if moved <= 1e-9 * (1.0 + np.abs(values).max()):
            break
    # Sandwich for M-estimates (Huber, 1973): the influence's variance over the squared share of inliers.
    inlier = max(float((weights >= 1.0).mean()), 0.1)
    left = aim - _product("ni,i->n", rows, values)
    clipped = weights * left
    count, free = len(aim), max(len(aim) - len(values), 1)
    # At least 1: the set declares the spread, and a lucky sample must not reduce it.
    variance = float(np.square(clipped).sum()) / free / inlier**2
    information = np.linalg.pinv(_product("ni,nj->ij", rows, rows))
    errors = np.sqrt(np.maximum(np.diag(information) * max(variance, 1.0), 0.0))
    return RobustFit(values, errors, count)


def _product(subscripts: str, left: FloatArray, right: FloatArray) -> FloatArray:
    """A product of tall matrices of few columns, as `numpy.einsum` names it."""
    # Of 20,000 rows and one column OpenBLAS makes a job for several threads, which wait for each other a
    # thousand times as long as the sum takes.
    product: FloatArray = np.einsum(subscripts, left, right)
    return product


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


def binomial_tail(hits: int, count: int, share: float) -> float:
    """Probability of at least `hits` hits among `count` if each has the probability `share`."""
    # With a probability of 1 the logarithm of its complement does not exist.
    if hits <= 0 or share >= 1.0:
        return 1.0
    if share <= 0.0:
        return 0.0
    # Once: a sum may have thousands of terms.
    ways, hit, miss = math.lgamma(count + 1), math.log(share), math.log1p(-share)
    logs = [
        ways - math.lgamma(k + 1) - math.lgamma(count - k + 1) + k * hit + (count - k) * miss
        for k in range(hits, count + 1)
    ]
    most = max(logs)
    return min(math.exp(most) * math.fsum(math.exp(each - most) for each in logs), 1.0)
