"""Motion that a program believed, against the truth: which device explains the difference.

A program knows its motion from the replies of counters, or from its own commands. Where its believed pose
moves otherwise than the robot, a factor on a counter's replies or a drive's commands may explain it. Those
with the smallest residuals are named.
"""

from __future__ import annotations

from collections.abc import Iterator
from operator import itemgetter

import numpy as np
from msgspec import Struct
from msgspec.structs import astuple

from simmer_tui.report.robust_statistics import mad_scale, median_interval
from simmer_tui.report.run_readings import by_sensor
from simmer_tui.run.attempt import Attempt
from simmer_tui.run.episodes import SAME_POSE
from simmer_tui.run.facts import DEFAULT_ALLOWED_TURN
from simmer_tui.run.table import Columns
from simmer_tui.sim.angles import cos_sin_array, half_turn
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.sensors import CountingSensor, modelled_sensor

SURE = 1.5
"""Largest spread, inches, at which a mean pose still predicts single readings: half of a robot's width;
judged."""
LEAST_MOVEMENTS = 11
"""Movements that a factor must explain: with fewer, all might be nearer to it by chance, in one of 2,000."""
_LEAST_SHARE = 0.05
"""Least difference of a factor from 1. Judged: a filter corrects its belief by a few percent of the path."""
_EXPLAINED = 0.7
"""Least share of movements that a factor must explain; the others are corrections. Judged."""
_TURN, _DISTANCE = (5.0, 2.0), (1.0, 0.5)
"""Shortest turn that counts and usual size of corrections, degrees; the same of distances, inches."""
_AS_GOOD = 1.4
"""Scatter over that of the best device with which another one explains as much. The standard error of a
scatter of 30 movements is a fifth of it."""
_LONGEST_TURN = 150.0
"""Turns above this, degrees, may have been believed to go in the other direction."""


class ErrorPattern(Struct, frozen=True):
    """One error that most beliefs have, in words; `of` are the codes of the sensors and drives that it may be
    from."""

    text: str
    of: tuple[str, ...] = ()


def step_patterns(attempt: Attempt) -> Iterator[list[ErrorPattern]]:
    """For turns and for distances, the counters and drives that explain the believed motion, the best first;
    none where it is right."""
    beliefs = attempt.within(attempt.history.beliefs, attempt.placed)
    if len(beliefs) < LEAST_MOVEMENTS:
        return
    true = _motion(beliefs, ("true_x", "true_y", "true_heading"), np.diff(beliefs["true_heading"]))
    believed = _motion(beliefs, ("x", "y", "heading"), half_turn(np.diff(beliefs["heading"])))
    sources = list(_sources(attempt, beliefs, true[2]))
    sure = beliefs["allowed_turn"] <= DEFAULT_ALLOWED_TURN
    near = np.nan_to_num(beliefs["spread"]) <= SURE
    # The same pose sent again does not depend on readings or commands.
    is_new = (np.abs(believed) >= SAME_POSE).any(axis=0)
    turns = is_new & sure[1:] & sure[:-1] & (np.abs(true[2]) <= _LONGEST_TURN)
    distances = turns & near[1:] & near[:-1]
    for is_turn, usable, least, correction in ((True, turns, *_TURN), (False, distances, *_DISTANCE)):
        found: list[tuple[float, ErrorPattern]] = []
        for code, noun, axis, values in sources:
            if bool(axis[2]) is is_turn:
                went = axis @ true
                chosen = usable & np.isfinite(values) & (np.abs(went) >= least)
                motion = went[chosen], (axis @ believed)[chosen], values[chosen]
                found += _explaining(code, noun, *motion, correction)
        found.sort(key=itemgetter(0))
        # A little more scatter than that of the best may be by chance.
        yield [each for scatter, each in found if scatter <= _AS_GOOD * found[0][0]]


def _explaining(
    code: str, noun: str, true: FloatArray, believed: FloatArray, values: FloatArray, correction: float
) -> Iterator[tuple[float, ErrorPattern]]:
    """The scatter that a source leaves and its factor in words, if its `values` explain the believed motion,
    (n,) each; `correction` is the usual size of corrections of a belief."""
    spread = correction / 2 + 0.02 * np.abs(true)
    is_used = values != 0.0
    if is_used.sum() < LEAST_MOVEMENTS:
        return
    factor, interval = median_interval(believed[is_used] / values[is_used], 1.0)
    off = np.abs(believed - factor * values)
    apart = np.abs(factor * values - true) > correction
    hits = apart & (off <= 4 * spread) & (off < np.abs(believed - true))
    is_explained = hits.sum() >= max(LEAST_MOVEMENTS, _EXPLAINED * apart.sum())
    if interval is None or not is_explained or abs(factor - 1.0) < _LEAST_SHARE:
        return
    figures = f"{interval[0]:.2f} to {interval[1]:.2f}, {len(values)} movements"
    # Smaller differences cannot be distinguished: poses are sent in hundredths.
    scatter = max(mad_scale(off), correction / 20)
    yield scatter, ErrorPattern(f"{factor:.2f} times {code}'s {noun} ({figures})", (code,))


def _sources(
    attempt: Attempt, beliefs: Columns, turned: FloatArray
) -> Iterator[tuple[str, str, FloatArray, FloatArray]]:
    """The counters and the drives that a program may know its motion from.

    Yields the code, `replies` or `commands`, the value for an inch ahead, an inch to the left and a degree
    turned, (3,), and the values between beliefs, (n,), inches or degrees, NaN where there are none. What
    wheels count for the true turns is left out.
    """
    history = attempt.history
    # The first belief depends on events before it.
    moves = attempt.within(history.movements, attempt.placed)
    at = np.searchsorted(moves["order"], beliefs["order"])
    for spec, rows in by_sensor(history, attempt.within(history.readings, attempt.placed)):
        sensor = modelled_sensor(spec)
        if isinstance(sensor, CountingSensor) and spec.gain and not spec.wrap:
            place = np.searchsorted(rows["order"], beliefs["order"]) - 1
            last = rows[np.maximum(place, 0)]
            # Read after the last movement before the belief.
            fresh = (place >= 0) & (np.searchsorted(moves["order"], last["order"]) == at)
            values, axis = np.diff(np.where(fresh, last["value"], np.nan)) / spec.gain, sensor.lever
            if axis[:2].any():
                values, axis = values - axis[2] * turned, axis * (1.0, 1.0, 0.0)
            size = np.abs(axis).sum()
            yield spec.code, "replies", axis / size, values / size
    for row in attempt.spec.drives:
        if row.code in history.code_names:
            mine = moves["code"] == history.code_names.index(row.code)
            sums = np.cumsum(np.where(mine, moves["asked"] * row.gain, 0.0))
            asked = np.diff(np.concatenate(((0.0,), sums))[at])
            axis = np.array(astuple(row.kind.direction))
            yield row.code, "commands", axis, np.where(asked == 0.0, np.nan, asked)


def _motion(beliefs: Columns, names: tuple[str, str, str], turns: FloatArray) -> FloatArray:
    """The motion from pose to pose in the robot's frame halfway: inches ahead and to the left, and the
    turns, (3, n)."""
    x, y, heading = (beliefs[name] for name in names)
    cos, sin = cos_sin_array(heading[:-1] + turns / 2)
    ahead, aside = np.diff(x), np.diff(y)
    return np.array((cos * ahead + sin * aside, cos * aside - sin * ahead, turns))
