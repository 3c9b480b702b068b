"""Corrections of movements that do not shrink: they name the drive, without any belief.

A program that corrects the rest of a movement asks for less each time. If the robot does `g` times what the
program means, each correction is 1 - g times the one before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from simmer_tui.report.finding import FEWEST, Disagreement, moment
from simmer_tui.report.robust_fit import binomial_tail, median_of
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.table import Columns
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.specs import DriveSpec

_FEWEST = FEWEST["set"]
# Errors of drives and of a program's model of them are a few percent of a correction.
_BAND = 0.08
"""Share by which a correction may differ from the multiple of the one before it."""
_FACTORS = tuple(sign * 1.5 * (1.0 + 2 * _BAND) ** step for step in range(9) for sign in (1.0, -1.0))
"""Factors that are tried, their bands side by side. Below 1.5 growing steps may be intended. Above 5, the
second correction is longer than the maze."""
_HARDLY = (0.99 - _BAND,)
"""The factor of turns that hardly reduce the rest, such as turns sent in radians: with its band, up to 0.99.
Movements ahead may shrink like this: a wall comes nearer."""
_THE_SAME = 0.001
"""Largest relative difference of two commands that ask for the same: their text in the program is the
same."""
_ALIKE = 0.02
"""Corrections that differ by less, as a share, are of one size."""
# In runs without a fault fewer than one pair in twenty is within a band beyond 1.5.
_BY_CHANCE = 0.1
# Of turns fewer than one pair in eight is within the band below 1.
_BY_CHANCE_HARDLY = 0.2
_LEAST = {"in": 0.5, "deg": 2.0}
"""Least correction, inches and degrees: residuals of noise and rounding are smaller."""
_LEAST_HARDLY = 0.1
"""The same of turns that hardly turn, degrees: a compass has less noise than the rest."""
_MOST = {"in": math.inf, "deg": 60.0}
"""Largest one: three times as much is a half turn, and programs turn the short way."""


class _Pairs(NamedTuple):
    """Commands of a drive that follow one another: the first of each pair as rows of movements, its value and
    its ratio to the second, (n,)."""

    rows: Columns
    first: FloatArray
    ratios: FloatArray

    def within(self, least: float, most: float) -> _Pairs:
        """The pairs whose first value is within a size, whatever its sign."""
        fits = (np.abs(self.first) >= least) & (np.abs(self.first) <= most)
        return _Pairs(self.rows[fits], self.first[fits], self.ratios[fits])


class _Found(NamedTuple):
    """Pairs with about the same ratio: the multiple, the probability of as many by chance, and the first of
    each as rows of movements, (n,)."""

    multiple: float
    probability: float
    rows: Columns


def multiplied_corrections(attempt: Attempt, row: DriveSpec) -> Iterator[list[Disagreement]]:
    """The explanations of a drive's commands that are each the same multiple of the one before. They grow,
    or hardly shrink."""
    pairs, unit, turns = _pairs_of(attempt, row), row.kind.unit, row.kind.turns
    growing = pairs.within(_LEAST[unit], _MOST[unit])
    if (found := _most_alike(growing, _FACTORS, _BY_CHANCE)) is not None:
        yield [_multiplied(row, found)]
    if turns:
        hardly = pairs.within(_LEAST_HARDLY, _MOST[unit])
        if (found := _most_alike(hardly, _HARDLY, _BY_CHANCE_HARDLY)) is not None:
            yield [_multiplied(row, found)]


def _pairs_of(attempt: Attempt, row: DriveSpec) -> _Pairs:
    """The commands of a drive that follow on another of it and differ."""
    numbers = {code: number for number, code in enumerate(attempt.history.code_names)}
    moves = attempt.within(attempt.history.movements)
    moves = moves[np.isfinite(moves["asked"]) & (moves["asked"] != 0.0)]
    asked = moves["asked"].astype(np.float64)
    mine = np.flatnonzero(moves["code"] == numbers.get(row.code, -1))
    first, second = mine[:-1], mine[1:]
    near = second - first == 1
    ratios = asked[second] / asked[first]
    # A movement that a wall stopped leaves a rest that is not the drive's fault.
    near &= ~moves["held"][first]
    near &= np.abs(np.abs(ratios) - 1.0) > _THE_SAME
    return _Pairs(moves[first[near]], asked[first[near]], ratios[near])


def _most_alike(pairs: _Pairs, factors: Sequence[float], by_chance: float) -> _Found | None:
    """The pairs with about the same ratio, near one of the factors; None where there are too few."""
    hits = {factor: np.abs(pairs.ratios / factor - 1.0) <= _BAND for factor in factors}
    factor = max(hits, key=lambda each: int(hits[each].sum()))
    found = hits[factor]
    # Steps that are constants of a program repeat the same sizes; corrections never do.
    sizes = np.round(np.log(np.abs(pairs.first[found])) / _ALIKE)
    if len(set(sizes.tolist())) < _FEWEST:
        return None
    probability = min(binomial_tail(int(found.sum()), len(found), by_chance) * len(factors), 1.0)
    return _Found(median_of(pairs.ratios[found]), probability, pairs.rows[found])


def _multiplied(row: DriveSpec, found: _Found) -> Disagreement:
    multiple = f"{found.multiple:.2f}" if 0.0 < found.multiple < 1.0 else f"{abs(found.multiple):.1f}"
    text = f"{len(found.rows)} of its movements by {row.code} were each {multiple} times the one before"
    if found.multiple < 0.0:
        text += ", to the other side"
    unit = {"in": "inches", "deg": "degrees"}[row.kind.unit]
    advice = f"Check the unit of {row.code}'s value in your program ({unit}): each correction goes too far."
    if found.multiple > 1.0:
        advice = f"Check the sign of {row.code}'s value in your program: each correction makes it worse."
    elif found.multiple > 0.0:
        advice = f"Check the unit of {row.code}'s value in your program ({unit}): corrections do little."
    count, begin = len(found.rows), moment(found.rows[0])
    return Disagreement((row.code,), text, count, found.probability, 1.0, *begin, advice)
