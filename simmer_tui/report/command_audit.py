"""Corrections of movements that do not shrink: they name the drive, without any belief.

A program that corrects the rest of a movement asks for less each time. If the robot does `g` times what the
program means, each correction is 1 - g times the one before.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from simmer_tui.report.finding import FEWEST
from simmer_tui.report.robust_statistics import median_of
from simmer_tui.run.attempt import Attempt
from simmer_tui.sim.specs import DriveSpec

# Errors of drives and of a program's model of them are a few percent of a correction.
_BAND = 0.08
"""Share by which a correction may differ from the multiple of the one before it."""
_GROWING, _TO_AND_FRO = 1.5, -0.9
"""Least multiple of corrections that grow: steps that grow by less may be intended. And the multiple of those
that go to and fro, and hardly shrink."""
_HARDLY = (0.8, 0.99)
"""Multiples of turns that hardly reduce the rest, such as turns sent in radians. Movements ahead may shrink
like this: a wall comes nearer."""
_LEAST = {"in": 0.5, "deg": 0.1}
"""Least correction that counts: residuals of noise and rounding are smaller. A compass has less noise."""
_MOST = 120.0
"""Largest one, inches or degrees: of more a program turns the short way."""
_THE_SAME = 0.001
"""Largest relative difference of two commands that ask for the same: their text in the program is the
same."""
_ALIKE = 0.02
"""Corrections that differ by less, as a share, are of one size."""


class Corrections(Struct, frozen=True):
    """Corrections by the drive `of` that do not shrink: `text` says it of `count` movements, the first at
    `elapsed` (seconds), its line of the log `line`. `advice` is one line to follow."""

    of: tuple[str, ...]
    text: str
    count: int
    elapsed: float
    line: int
    advice: str


def multiplied_corrections(attempt: Attempt, row: DriveSpec) -> Corrections | None:
    """The commands of a drive that are each the same multiple of the one before, and grow or hardly shrink;
    None if most are not."""
    names, moves = attempt.history.code_names, attempt.within(attempt.history.movements)
    moves = moves[np.isfinite(moves["asked"]) & (moves["asked"] != 0.0)]
    asked = moves["asked"].astype(np.float64)
    mine = np.isin(moves["code"], [number for number, code in enumerate(names) if code == row.code])
    sizes, ratios = np.abs(asked[:-1]), asked[1:] / asked[:-1]
    # Nothing came between. A movement that a wall stopped leaves a rest that is not the drive's fault.
    pairs = mine[:-1] & mine[1:] & ~moves["held"][:-1] & (np.abs(np.abs(ratios) - 1.0) > _THE_SAME)
    pairs &= (sizes >= _LEAST[row.kind.unit]) & (sizes <= _MOST)
    if pairs.sum() < FEWEST["set"]:
        return None
    multiple = median_of(ratios[pairs])
    found = np.flatnonzero(pairs & (np.abs(ratios / multiple - 1.0) <= _BAND))
    hardly = row.kind.turns and _HARDLY[0] <= multiple <= _HARDLY[1]
    # Steps that are constants of a program repeat the same sizes; corrections never do.
    different = len(set(np.round(np.log(sizes[found]) / _ALIKE).tolist()))
    # Judged: where a unit or a sign was wrong, it was at least 0.69 of the pairs, elsewhere at most 0.08.
    is_rule = different >= FEWEST["set"] and 2 * len(found) >= pairs.sum()
    if not (is_rule and (hardly or multiple >= _GROWING or multiple <= _TO_AND_FRO)):
        return None
    times = f"{abs(multiple):.1f}" if abs(multiple) > 1.0 else f"{abs(multiple):.2f}"
    text = f"{len(found)} of its movements by {row.code} were each {times} times the one before"
    unit = {"in": "inches", "deg": "degrees"}[row.kind.unit]
    advice = f"Check the unit of {row.code}'s value in your program ({unit})."
    if multiple > 1.0:
        advice = f"Check the sign of {row.code}'s value in your program: each correction makes it worse."
    elif multiple < 0.0:
        text += ", to the other side"
    first = moves[found[0]]
    return Corrections((row.code,), text, len(found), float(first["elapsed"]), int(first["line"]), advice)
