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
_GROWING = tuple(sign * 1.5 * (1.0 + 2 * _BAND) ** step for step in range(9) for sign in (1.0, -1.0))
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


class _Rule(NamedTuple):
    """A rule: the factors that are tried, the share of pairs within a band by chance, and the sizes of the
    first correction of a pair, inches or degrees, between which it counts."""

    factors: Sequence[float]
    by_chance: float
    least: float
    most: float


_RULES = {
    # Residuals of noise and rounding are smaller. In runs without a fault fewer than one pair in twenty is
    # within a band beyond 1.5.
    "in": (_Rule(_GROWING, 0.1, 0.5, math.inf),),
    "deg": (
        # Three times as much is a half turn, and programs turn the short way.
        _Rule(_GROWING, 0.1, 2.0, 60.0),
        # A compass has less noise than the rest. Fewer than one pair in eight is within the band below 1.
        _Rule(_HARDLY, 0.2, 0.1, 60.0),
    ),
}


def multiplied_corrections(attempt: Attempt, row: DriveSpec) -> Iterator[list[Disagreement]]:
    """The explanations of a drive's commands that are each the same multiple of the one before. They grow,
    or hardly shrink."""
    numbers = {code: number for number, code in enumerate(attempt.history.code_names)}
    moves = attempt.within(attempt.history.movements)
    moves = moves[np.isfinite(moves["asked"]) & (moves["asked"] != 0.0)]
    asked = moves["asked"].astype(np.float64)
    mine = np.flatnonzero(moves["code"] == numbers.get(row.code, -1))
    first, second = mine[:-1], mine[1:]
    ratios = asked[second] / asked[first]
    # A movement that a wall stopped leaves a rest that is not the drive's fault.
    kept = (second - first == 1) & ~moves["held"][first] & (np.abs(np.abs(ratios) - 1.0) > _THE_SAME)
    sizes = np.abs(asked[first])
    for rule in _RULES[row.kind.unit]:
        pairs = kept & (sizes >= rule.least) & (sizes <= rule.most)
        found = _explained(row, rule, moves[first[pairs]], sizes[pairs], ratios[pairs])
        if found is not None:
            yield [found]


def _explained(
    row: DriveSpec, rule: _Rule, rows: Columns, sizes: FloatArray, ratios: FloatArray
) -> Disagreement | None:
    """The pairs of corrections with about the same ratio, near one of the factors; None where they are few.

    Args:
        rows: First movement of each pair, (n,).
        sizes: Its value without its sign, (n,).
        ratios: Value of the second divided by that of the first, (n,).
    """
    hits = {factor: np.abs(ratios / factor - 1.0) <= _BAND for factor in rule.factors}
    found = max(hits.values(), key=lambda each: int(each.sum()))
    # Steps that are constants of a program repeat the same sizes; corrections never do.
    if len(set(np.round(np.log(sizes[found]) / _ALIKE).tolist())) < _FEWEST:
        return None
    count = int(found.sum())
    probability = min(binomial_tail(count, len(found), rule.by_chance) * len(rule.factors), 1.0)
    multiple = median_of(ratios[found])
    times = f"{abs(multiple):.1f}" if abs(multiple) > 1.0 else f"{multiple:.2f}"
    text = f"{count} of its movements by {row.code} were each {times} times the one before"
    if multiple < 0.0:
        text += ", to the other side"
    unit = {"in": "inches", "deg": "degrees"}[row.kind.unit]
    advice = f"Check the unit of {row.code}'s value in your program ({unit})."
    if multiple > 1.0:
        advice = f"Check the sign of {row.code}'s value in your program: each correction makes it worse."
    return Disagreement((row.code,), text, count, probability, 1.0, *moment(rows[found][0]), advice)
