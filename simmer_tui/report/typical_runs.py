"""Figures of a run beside those of runs that succeed, for a run whose cause is not known."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from simmer_tui.run.attempt import Attempt

# The 5 % and 95 % quantiles of 27 runs of solve.py, step 7 and a plain program that delivered the block.
_TYPICAL = {
    "readings a movement": (6.4, 8.2),
    "in driven": (150.0, 300.0),
    "deg turned": (740.0, 1570.0),
    "% of its commands refused": (0.0, 1.0),
    "in a movement": (1.0, 2.2),
    "s of simulated time": (49.0, 132.0),
    "in off, its belief on average": (0.37, 1.5),
}
_NAMED = 3


def most_different(seen: Attempt) -> str:
    """The three figures of a run that differ most from those of runs that succeed, in a sentence."""
    far = sorted(_beside(seen), reverse=True)
    told = [text for _, text in far[:_NAMED]]
    return f"It differs most from runs that succeed by {', '.join(told)}."


def _beside(seen: Attempt) -> Iterator[tuple[float, str]]:
    """Distance of each figure from the typical ones, as a logarithm, with its words."""
    for name, value in _figures(seen):
        low, high = _TYPICAL[name]
        below = math.log(low / max(value, low / 100.0)) if low else -math.inf
        far = max(below, math.log(max(value, high / 100.0) / high))
        yield far, f"{value:.3g} {name} (usually {low:.3g} to {high:.3g})"


def _figures(seen: Attempt) -> Iterator[tuple[str, float]]:
    history = seen.history
    moves, beliefs = seen.within(history.movements), seen.within(history.beliefs)
    count = max(len(moves), 1)
    driven = float(moves["went"].sum())
    yield "readings a movement", len(seen.within(history.readings)) / count
    yield "in driven", driven
    yield "deg turned", float(np.ptp(moves["turned"])) if len(moves) else 0.0
    yield "% of its commands refused", 100.0 * seen.refused / max(seen.commands, 1)
    yield "in a movement", driven / count
    yield "s of simulated time", seen.elapsed - seen.begun
    distance = beliefs["distance"][np.isfinite(beliefs["distance"])]
    if len(distance):
        yield "in off, its belief on average", float(distance.mean())
