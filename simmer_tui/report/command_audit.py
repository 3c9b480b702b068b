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
from simmer_tui.report.sensor_sample import by_sensor
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.table import Columns
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.specs import DriveSpec, SensorSpec

_FEWEST = FEWEST["set"]
# Errors of drives and of a program's model of them are a few percent of a correction.
_BAND = 0.08
"""Share by which a correction may differ from the multiple of the one before it."""
_FACTORS = tuple(sign * 1.5 * (1.0 + 2 * _BAND) ** step for step in range(9) for sign in (1.0, -1.0))
"""Factors that are tried, their bands side by side. Below 1.5 growing steps may be intended. Above 5, the
second correction is longer than the maze."""
_UNDOING = -1.05
"""The factor of corrections that each take back the one before, with `_BAND_UNDOING` from -0.74 to -1.37. A
movement that goes twice as far makes it -1, and so does a longer one where the program has a longest step."""
_BAND_UNDOING = 0.3
_HARDLY = (0.99 - _BAND,)
"""The factor of turns that hardly reduce the rest, such as turns sent in radians: with its band, up to 0.99.
Movements ahead may shrink like this: a wall comes nearer."""
_THE_SAME = 0.001
"""Largest relative difference of two commands that ask for the same: their text in the program is the
same."""
_ALIKE = 0.02
"""Corrections that differ by less, as a share, are of one size."""
# In runs without a fault fewer than one pair in twenty is within a band beyond 1.5, or undoes the other.
_BY_CHANCE = 0.1
# A program that tries for the block repeatedly drives up and back: up to six pairs in ten.
_BY_CHANCE_UP_AND_BACK = 0.6
_SAME_WAY = 30.0
"""Most degrees of turns between two movements along a line."""
# Of turns fewer than one pair in eight is within the band below 1.
_BY_CHANCE_HARDLY = 0.2
_LEAST = {"in": 0.5, "deg": 2.0}
"""Least correction, inches and degrees: residuals of noise and rounding are smaller."""
_LEAST_HARDLY = 0.1
"""The same of turns that hardly turn, degrees: a compass has less noise than the rest."""
_MOST = {"in": math.inf, "deg": 60.0}
"""Largest one: three times as much is a half turn, and programs turn the short way."""
_MOST_UNDOING = {"in": math.inf, "deg": 150.0}
"""The same of turns that are taken back: as much the other way is less than a half turn."""
# By chance, or at a program's longest step, up to one in six; on purpose at least every second one.
_ON_PURPOSE = 0.3
"""Share of exact opposites from which going back is meant."""
_BETWEEN = 0.5
"""Share of corrections with a reading of the guiding sensor between them. Judged."""


class _Pairs(NamedTuple):
    """Commands of a drive that follow one another: the first of each pair as rows of movements, its value and
    its ratio to the second, (n,)."""

    rows: Columns
    first: FloatArray
    ratios: FloatArray
    opposite: int
    """Pairs beside these in which the second is the first with the other sign."""

    def within(self, least: float, most: float) -> _Pairs:
        """The pairs whose first value is within a size, whatever its sign."""
        fits = (np.abs(self.first) >= least) & (np.abs(self.first) <= most)
        return _Pairs(self.rows[fits], self.first[fits], self.ratios[fits], self.opposite)


class _Found(NamedTuple):
    """Pairs with about the same ratio: the multiple, the probability of as many by chance, and the first of
    each as rows of movements, (n,)."""

    multiple: float
    probability: float
    rows: Columns


def multiplied_corrections(attempt: Attempt, row: DriveSpec) -> Iterator[list[Disagreement]]:
    """The explanations of a drive's commands that are each the same multiple of the one before. They grow,
    take each other back, or hardly shrink."""
    pairs, unit, turns = _pairs_of(attempt, row), row.kind.unit, row.kind.turns
    growing = pairs.within(_LEAST[unit], _MOST[unit])
    if (found := _most_alike(growing, _FACTORS, _BY_CHANCE)) is not None:
        yield [_multiplied(row, found)]
    undoing, by_chance = pairs, _BY_CHANCE
    if not turns:
        undoing, by_chance = _pairs_of(attempt, row, along=True), _BY_CHANCE_UP_AND_BACK
    undoing = undoing.within(_LEAST[unit], _MOST_UNDOING[unit])
    found = _most_alike(undoing, (_UNDOING,), by_chance, _BAND_UNDOING)
    # A program that goes to and fro on purpose goes back by exactly the same.
    if found is not None and undoing.opposite <= _ON_PURPOSE * len(found.rows):
        yield [_undone(row, found), *_as_measured(attempt, row, found)]
    if turns:
        hardly = pairs.within(_LEAST_HARDLY, _MOST[unit])
        if (found := _most_alike(hardly, _HARDLY, _BY_CHANCE_HARDLY)) is not None:
            yield [_multiplied(row, found)]


def _pairs_of(attempt: Attempt, row: DriveSpec, *, along: bool = False) -> _Pairs:
    """The commands of a drive that follow on another of it and differ.

    Args:
        attempt: The run.
        row: The drive.
        along: True if others may be between them that hardly turn the robot.
    """
    numbers = {code: number for number, code in enumerate(attempt.history.code_names)}
    moves = attempt.within(attempt.history.movements)
    moves = moves[np.isfinite(moves["asked"]) & (moves["asked"] != 0.0)]
    asked = moves["asked"].astype(np.float64)
    mine = np.flatnonzero(moves["code"] == numbers.get(row.code, -1))
    first, second = mine[:-1], mine[1:]
    near = second - first == 1
    if along:
        turning = {each.code for each in attempt.spec.drives if each.kind.turns}
        turns = np.isin(moves["code"], [numbers[code] for code in turning & numbers.keys()])
        turned = np.cumsum(np.where(turns, np.abs(asked), 0.0))
        near = turned[second] - turned[first] <= _SAME_WAY
    ratios = asked[second] / asked[first]
    # A movement that a wall stopped leaves a rest that is not the drive's fault.
    near &= ~moves["held"][first]
    differ = near & (np.abs(np.abs(ratios) - 1.0) > _THE_SAME)
    opposite = int((near & ~differ & (ratios < 0.0)).sum())
    return _Pairs(moves[first[differ]], asked[first[differ]], ratios[differ], opposite)


def _most_alike(
    pairs: _Pairs, factors: Sequence[float], by_chance: float, band: float = _BAND
) -> _Found | None:
    """The pairs with about the same ratio, near one of the factors; None where there are too few."""
    hits = {factor: np.abs(pairs.ratios / factor - 1.0) <= band for factor in factors}
    factor = max(hits, key=lambda each: int(hits[each].sum()))
    found = hits[factor]
    # Steps that are constants of a program repeat the same sizes; corrections never do.
    # One that takes the one before back is about as long, until it is as long as the program's longest.
    alike = _ALIKE if factor != _UNDOING else _THE_SAME
    sizes = np.round(np.log(np.abs(pairs.first[found])) / alike)
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
    return _disagreement(row.code, text, found, advice)


def _undone(row: DriveSpec, found: _Found) -> Disagreement:
    text = f"{len(found.rows)} of its movements by {row.code} each took back the one before"
    return _disagreement(row.code, text, found)


def _as_measured(attempt: Attempt, row: DriveSpec, found: _Found) -> list[Disagreement]:
    """The explanations by the sensors with which a program may have measured its movements. Their readings,
    not the movement, may have been too long by that factor."""
    readings = attempt.within(attempt.history.readings)
    made = []
    for sensor, rows in by_sensor(attempt.history, readings):
        if not _measures(sensor, row):
            continue
        orders = rows["order"]
        places = np.searchsorted(orders, found.rows["order"])
        # Read after the movement and before the next command of all.
        after = np.append(orders, np.iinfo(np.int64).max)[places]
        nexts = np.append(attempt.within(attempt.history.movements)["order"], np.iinfo(np.int64).max)
        until = nexts[np.searchsorted(nexts, found.rows["order"], side="right")]
        if np.mean(after < until) >= _BETWEEN:
            text = f"{sensor.code} was read after each"
            made.append(_disagreement(sensor.code, text, found))
    return made


def _measures(sensor: SensorSpec, row: DriveSpec) -> bool:
    """True if a sensor measures the motion by a drive: the angle of a turn, else the path."""
    kind, drive = sensor.kind, row.kind
    if drive.turns or kind.is_range or kind.is_opaque:
        return drive.turns and kind.unit == "deg"
    return (
        kind.counts
        and kind.unit == "in"
        and abs(math.cos(math.radians(sensor.rotation - drive.bearing))) > 0.5
    )


def _disagreement(code: str, text: str, found: _Found, advice: str = "") -> Disagreement:
    count, begin = len(found.rows), moment(found.rows[0])
    return Disagreement((code,), text, count, found.probability, 1.0, *begin, advice)
