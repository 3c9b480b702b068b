"""Curves of a sweep: the success rate at each value of a name, and the values at which it is kept."""

from __future__ import annotations

import math
from dataclasses import dataclass

from simmer_tui.trials.failures import grouped, success_rate
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.intervals import IntervalEstimate
from simmer_tui.trials.trial import TrialResult


@dataclass(frozen=True, slots=True)
class SweepValue:
    """A value of a sweep, and its runs; there is at least one."""

    value: str
    results: tuple[TrialResult, ...]

    @property
    def rate(self) -> IntervalEstimate:
        """Share of runs that succeeded, with its interval."""
        return success_rate(self.results)

    @property
    def number(self) -> float:
        """The value as a number; NaN if it is none. Places and other lists of numbers have no order."""
        try:
            return float(self.value)
        except ValueError:
            return math.nan


@dataclass(frozen=True, slots=True)
class Curve:
    """Name that is varied, and its values that have runs: numbers in ascending order, others as given."""

    name: str
    values: tuple[SweepValue, ...]

    @property
    def is_of_numbers(self) -> bool:
        """True if every value is a number, so that there is a curve to draw."""
        return all(math.isfinite(place.number) for place in self.values)

    def kept(self, wanted: float) -> list[SweepValue]:
        """The values at which the success rate is as `wanted`; of numbers, those before the first at
        which it is not."""
        kept = []
        for place in self.values:
            if place.rate.value >= wanted:
                kept.append(place)
            elif self.is_of_numbers:
                break
        return kept


def curves(folder: TrialFolder) -> list[Curve]:
    """A curve for all that is varied and has runs."""
    plan = folder.plan
    groups = grouped(folder.done, lambda result: plan.point(result.number))
    found = []
    for name in dict.fromkeys(name for point in plan.points for name in point):
        numbered = [(number, point[name]) for number, point in enumerate(plan.points) if name in point]
        places = [SweepValue(value, tuple(groups[n])) for n, value in numbered if n in groups]
        curve = Curve(name, tuple(places))
        if curve.is_of_numbers:
            curve = Curve(name, tuple(sorted(places, key=lambda place: place.number)))
        if places:
            found.append(curve)
    return found
