"""Confidence intervals for a success rate, and for the difference between two."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from simmer_tui.report.robust_statistics import Z_95

# The usual level: it and an interval of 95 % in the same table say the same.
SIGNIFICANCE = 0.05
"""Below this p-value a difference is significant: the probability to name one where there is none."""
# From the tables of Abramowitz and Stegun, 26.10, where the expansion below has less than 5 digits.
_STUDENT = (4.30265, 3.18245, 2.77645, 2.57058, 2.44691, 2.36462, 2.30600, 2.26216, 2.22814)
"""97.5 % quantiles of Student's t distribution with 2 to 10 degrees of freedom."""
# Relative error of a mean of doubles: a spread below it comes from rounding.
_ROUNDING = 1e-12
# Efron and Tibshirani ask for 1000 at least; ten times as many take milliseconds.
RESAMPLES = 10_000
_MOST_BINS = 20
"""Judged: a bar of a picture of the page's width then has room for its count."""
_BOOTSTRAP_SEED = 0
"""Fixed, so that the same runs always give the same interval."""


@dataclass(frozen=True, slots=True)
class IntervalEstimate:
    """A value with its interval of 95 %."""

    value: float
    low: float
    high: float


def wilson(successes: int, runs: int) -> IntervalEstimate:
    """The success rate of at least one run with its 95 % score interval.

    E. B. Wilson, "Probable inference, the law of succession, and statistical inference", Journal of
    the American Statistical Association 22 (1927): 209-212.
    """
    rate, z2 = successes / runs, Z_95 * Z_95
    centre = (successes + z2 / 2) / (runs + z2)
    half = Z_95 / (runs + z2) * math.sqrt(runs * rate * (1 - rate) + z2 / 4)
    low = 0.0 if successes == 0 else max(centre - half, 0.0)
    high = 1.0 if successes == runs else min(centre + half, 1.0)
    return IntervalEstimate(rate, low, high)


@dataclass(frozen=True, slots=True)
class PairCounts:
    """Numbers of runs on the same seeds in which both programs succeed, only one, or neither."""

    both: int
    first_only: int
    second_only: int
    neither: int

    @classmethod
    def of(cls, outcomes: Sequence[tuple[bool, bool]]) -> PairCounts:
        """The numbers of some pairs, each the success of the first and of the second program."""
        return cls(*map(outcomes.count, ((True, True), (True, False), (False, True), (False, False))))

    @property
    def count(self) -> int:
        """Number of pairs."""
        return self.both + self.first_only + self.second_only + self.neither


def paired_difference(pairs: PairCounts) -> IntervalEstimate:
    """Success rate of the second one minus that of the first, with its 95 % interval; at least one pair.

    Method 10 of R. G. Newcombe, "Improved confidence intervals for the difference between binomial
    proportions based on paired data", Statistics in Medicine 17 (1998): 2635-2650: the Wilson limits
    of both rates, joined through the correlation phi, which is corrected for continuity.
    """
    a, b, c, d = pairs.both, pairs.second_only, pairs.first_only, pairs.neither
    second, first = wilson(a + b, pairs.count), wilson(a + c, pairs.count)
    product = (a + b) * (c + d) * (a + c) * (b + d)
    covariance = float(a * d - b * c)
    if covariance > 0:
        covariance = max(covariance - pairs.count / 2, 0.0)
    phi = covariance / math.sqrt(product) if product else 0.0
    difference = (b - c) / pairs.count
    below = _joined(second.value - second.low, first.high - first.value, phi)
    above = _joined(second.high - second.value, first.value - first.low, phi)
    return IntervalEstimate(difference, difference - below, difference + above)


def _joined(one: float, other: float, phi: float) -> float:
    return math.sqrt(max(one * one - 2 * phi * one * other + other * other, 0.0))


def mcnemar(pairs: PairCounts) -> float:
    """The p-value of the hypothesis that both programs are equally good, by the runs in which only one
    succeeds: the exact, two-sided test of Q. McNemar, "Note on the sampling error of the difference between
    correlated proportions or percentages", Psychometrika 12 (1947)."""
    discordant = pairs.first_only + pairs.second_only
    fewer = min(pairs.first_only, pairs.second_only)
    tail = sum(math.comb(discordant, k) for k in range(fewer + 1))
    return min(float(2 * tail / 2**discordant), 1.0)


def student_quantile(degrees: int) -> float:
    """The 97.5 % quantile of Student's t distribution with at least 2 degrees of freedom.

    To 5 digits: tabled where there are few, else the expansion 26.7.5 of M. Abramowitz and
    I. A. Stegun, "Handbook of Mathematical Functions" (1964).
    """
    if degrees - 2 < len(_STUDENT):
        return _STUDENT[degrees - 2]
    z, n = Z_95, degrees
    return (
        z
        + (z**3 + z) / (4 * n)
        + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * n**2)
        + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / (384 * n**3)
        + (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / (92160 * n**4)
    )


def mean_difference(differences: Sequence[float], resamples: int = RESAMPLES) -> IntervalEstimate | None:
    """The mean of paired differences with its 95 % interval; None for fewer than three.

    Each limit is the further one of two: of Student's t, which is right for normal differences, and of the
    bootstrap-t with a fixed seed, for skewed ones (B. Efron and R. Tibshirani, "An Introduction to the
    Bootstrap", 1993, chapter 12). From five exponential values t alone holds the mean in 89 %, the percentile
    bootstrap in 79 %, both together in 94 %, as of 4000 samples each.
    """
    count = len(differences)
    if count < 3:
        return None
    values = np.array(differences, dtype=np.float64)
    mean = float(values.mean())
    values -= mean
    error = float(values.std(ddof=1)) / math.sqrt(count)
    if error <= _ROUNDING * abs(mean):  # all of them equal
        return IntervalEstimate(mean, mean, mean)
    low, high = np.quantile(_studentised(values / error, resamples), (0.025, 0.975)).tolist()
    student = student_quantile(count - 1)
    return IntervalEstimate(mean, mean - max(student, high) * error, mean + max(student, -low) * error)


def _studentised(values: np.ndarray, resamples: int) -> np.ndarray:
    """The t statistics of resamples of values around 0, without those that have only one distinct value."""
    count = len(values)
    random = np.random.default_rng(_BOOTSTRAP_SEED)
    chunk = max(1, 1_000_000 // count)
    parts = []
    for begin in range(0, resamples, chunk):
        drawn = random.choice(values, (min(chunk, resamples - begin), count))
        errors = drawn.std(axis=1, ddof=1) / math.sqrt(count)
        varied = errors > _ROUNDING
        parts.append(drawn.mean(axis=1)[varied] / errors[varied])
    return np.concatenate(parts)


class Distribution(NamedTuple):
    """Quantiles of some values, by linear interpolation."""

    least: float
    quarter: float
    median: float
    three_quarters: float
    most: float


def distribution(values: Sequence[float]) -> Distribution:
    """The distribution of at least one value."""
    return Distribution(*np.quantile(np.array(values), (0, 0.25, 0.5, 0.75, 1)).tolist())


def median(values: Sequence[float]) -> float | None:
    """The median of some values; None without any."""
    return distribution(values).median if values else None


def histogram(values: Sequence[float]) -> tuple[list[float], int]:
    """Edges of at most about `_MOST_BINS` bins of a round width over some values, and the decimals
    that the edges need. There is at least one bin."""
    low, high = min(values), max(values)
    span = high - low or max(abs(high), 1.0) / 10
    width = 10.0 ** math.floor(math.log10(span / _MOST_BINS))
    width *= next(factor for factor in (1, 2, 5, 10) if span / (width * factor) <= _MOST_BINS)
    begin, end = math.floor(low / width), math.floor(high / width) + 1
    decimals = max(0, -math.floor(math.log10(width) + 1e-9))
    return [round(k * width, decimals) for k in range(begin, end + 1)], decimals


def bin_counts(values: Sequence[float], edges: Sequence[float]) -> list[int]:
    """Number of values in each bin; one that rounding puts outside is in the next."""
    counts: list[int] = np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0].tolist()
    return counts
