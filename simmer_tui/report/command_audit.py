"""Commands of a run against themselves: corrections that grow, and movements that no longer come.

Both need no belief. A program that corrects what a movement left to do asks for less each time; if the robot
does `g` times what the program means, each correction is 1 - g times the one before. And programs go in
rhythms: what they read after a movement, they read when a movement should have been.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simmer_tui.report.disagreement import Disagreement
from simmer_tui.report.finding import FEWEST
from simmer_tui.report.robust_fit import Flags, binomial_tail
from simmer_tui.run.attempt import Attempt
from simmer_tui.sim.specs import DriveSpec

Codes = NDArray[np.int64]
_FEWEST = FEWEST["set"]
# Errors of drives and of what a program knows of them are a few percent of a correction.
_BAND = 0.08
"""Share by which a correction may differ from the multiple of the one before it."""
_FACTORS = tuple(sign * 1.5 * (1.0 + 2 * _BAND) ** step for step in range(9) for sign in (1.0, -1.0))
"""Factors that are looked for, each next to the other. Below 1.5 a program may well mean it: steps that grow.
Above 5, the second correction is longer than the maze."""
_ALIKE = 0.02
"""Corrections that differ by less, as a share, are of one size."""
# In runs without a fault fewer than one pair in twenty is within a band beyond 1.5.
_BY_CHANCE = 0.1
_LEAST = {"in": 0.5, "deg": 2.0}
"""Least correction, inches and degrees: what is left of noise and rounding is smaller."""
_MOST = {"in": math.inf, "deg": 60.0}
"""Largest one: three times as much is a half turn, and programs turn the short way."""
# Judged: a rhythm that was kept three times is one.
_RHYTHM = 3
_OUT_OF_RHYTHM = 0.05
"""Most times, as a share, that a program may have left a movement out before."""
_LEFT_OUT = 0.02
"""Least probability with which a program without a fault leaves one out."""


def growing_corrections(attempt: Attempt, row: DriveSpec) -> list[Disagreement]:
    """The explanation of a drive's commands that each are the same multiple of the one before; none where
    there is no such multiple."""
    number = _number_of(attempt.history.code_names, row.code)
    moves = attempt.within(attempt.history.movements)
    moves = moves[np.isfinite(moves["asked"]) & (moves["asked"] != 0.0)]
    if number is None or len(moves) < 2:
        return []
    asked = moves["asked"].astype(np.float64)
    mine = moves["code"] == number
    # A wall that stopped the movement leaves more to do than the drive did.
    first = mine[:-1] & mine[1:] & ~moves["held"][:-1]
    first &= (np.abs(asked[:-1]) >= _LEAST[row.kind.unit]) & (np.abs(asked[:-1]) <= _MOST[row.kind.unit])
    places = np.flatnonzero(first)
    if len(places) < _FEWEST:
        return []
    ratios = asked[places + 1] / asked[places]
    hits = {factor: np.abs(ratios / factor - 1.0) <= _BAND for factor in _FACTORS}
    factor = max(hits, key=lambda each: int(hits[each].sum()))
    found = ratios[hits[factor]]
    probability = min(binomial_tail(len(found), len(ratios), _BY_CHANCE) * len(_FACTORS), 1.0)
    # Steps that a program has in its text come in the same sizes again and again; corrections never do.
    sizes = np.round(np.log(np.abs(asked[places][hits[factor]])) / _ALIKE)
    if len(np.unique(sizes)) < _FEWEST:
        return []
    multiple = float(np.median(found))
    begun = moves[places[np.flatnonzero(hits[factor])[0]]]
    text = (
        f"{row.code} {_as_meant(row, 1.0 - multiple)}: {len(found)} corrections were each "
        f"{multiple:.1f} times the one before"
    )
    elapsed, line = float(begun["elapsed"]), int(begun["line"])
    return [Disagreement((row.code,), text, len(found), probability, 1.0, elapsed, line)]


def _as_meant(row: DriveSpec, share: float) -> str:
    verb = "turned" if row.kind.turns else "drove"
    if share <= 0.0:
        return f"{verb} the other way than the program meant"
    return f"{verb} {share:.1f} times what the program meant"


def vanished_movements(attempt: Attempt) -> list[Disagreement]:
    """The explanation of a program that goes on as after movements that are not in the log; none where it
    keeps its rhythm."""
    rows, names = attempt.within(attempt.history.commands), attempt.history.code_names
    rows = rows[~rows["refused"] & ~np.isin(rows["number"], _nothing_asked(attempt))]
    drives = [_number_of(names, each.code) for each in attempt.spec.drives]
    ends = {
        number: int(places[-1])
        for number in drives
        if number is not None and len(places := np.flatnonzero(rows["code"] == number))
    }
    rhythm = _Rhythm(rows["code"].astype(np.int64), np.isin(rows["code"], list(ends)))
    found: list[Disagreement] = []
    for end in ends.values():
        gaps, count, probability = rhythm.broken_after(end)
        if len(gaps) < _FEWEST:
            continue
        first = int(gaps[0])
        gone = [names[number] for number, place in ends.items() if place < first]
        # Others may be gone because the program had no need of them.
        of = tuple(gone) if len(gone) == 1 else ()
        text = (
            f"no {of[0] if of else 'movement'} reached the robot any more; {len(gaps)} of {count} times the "
            "program continued as after a movement that is not in the log"
        )
        # The end of each drive's commands was tried.
        probability = min(probability * len(ends), 1.0)
        elapsed, line = float(rows["elapsed"][first]), int(rows["line"][first])
        found.append(Disagreement(of, text, len(gaps), probability, 1.0, elapsed, line, swallowed=True))
    return sorted(found, key=lambda each: each.probability)[:1]


class _Rhythm:
    """Readings in threes, of which the first two follow on one another with or without a movement between."""

    def __init__(self, codes: Codes, moves: Flags) -> None:
        """`codes` are those of commands in order, `moves` tells which of them move the robot; (n,) each."""
        places, base = np.flatnonzero(~moves), int(codes.max(initial=0)) + 1
        first, second, third = (codes[places[begin : len(places) - 2 + begin]] for begin in range(3))
        self._threes = (first * base + second) * base + third
        self._moved = np.diff(places)[:-1] > 1
        self._places = places[1:-1]
        # One sensor read over and over says nothing of what came between.
        self._varied = (first != second) | (second != third)

    def broken_after(self, end: int) -> tuple[Codes, int, float]:
        """The places after `end` at which a movement was left out, of how many, and the probability of that.

        Counted are threes of readings in which there had nearly always been a movement before.
        """
        is_later = self._places > end
        kept = Counter(self._threes[~is_later & self._varied & self._moved].tolist())
        left_out = Counter(self._threes[~is_later & ~self._moved].tolist())
        rhythmic = [
            three
            for three, count in kept.items()
            if count >= _RHYTHM and left_out[three] <= _OUT_OF_RHYTHM * count
        ]
        missed, whole = sum(left_out[three] for three in rhythmic), sum(kept[three] for three in rhythmic)
        if whole < _FEWEST:
            return np.empty(0, np.int64), 0, 1.0
        counts = is_later & np.isin(self._threes, rhythmic)
        gaps = self._places[counts & ~self._moved]
        # Laplace's rule of succession, for what was never seen before.
        usual = max((missed + 1) / (whole + missed + 2), _LEFT_OUT)
        return gaps, int(counts.sum()), binomial_tail(len(gaps), int(counts.sum()), usual)


def _nothing_asked(attempt: Attempt) -> Codes:
    """The numbers of movements of 0: in packets, programs ask by them for the end of a movement."""
    moves = attempt.within(attempt.history.movements)
    return np.asarray(moves["number"][moves["asked"] == 0.0])


def _number_of(names: Sequence[str], code: str) -> int | None:
    return names.index(code) if code in names else None
