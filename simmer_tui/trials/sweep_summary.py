"""Answer of a sweep: success against each value, and the largest with which a program keeps a rate."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from simmer_tui.document.as_csv import csv_text
from simmer_tui.document.formats import COUNT, ESTIMATE, LENGTH, short
from simmer_tui.document.model import DataColumn, DataTable
from simmer_tui.sim.command import escape
from simmer_tui.trials.failures import rate
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.intervals import IntervalEstimate, distribution
from simmer_tui.trials.record import TrialResult

WANTED_RATE = 0.9
"""The success rate that a program is to keep unless it is said."""
CURVES = "sweep.csv"
SWEEP = DataTable(
    "sweep",
    "Sweep",
    (
        DataColumn("setting", hidden=True),
        DataColumn("value", short(60)),
        DataColumn("runs", COUNT),
        DataColumn("successes", COUNT),
        DataColumn("success_rate", ESTIMATE),
        DataColumn("median_time_s", LENGTH),
        DataColumn("contacts", COUNT),
    ),
)


@dataclass(frozen=True, slots=True)
class SweepValue:
    """A value, and its runs; there is at least one."""

    value: str
    results: tuple[TrialResult, ...]

    @property
    def rate(self) -> IntervalEstimate:
        return rate(self.results)

    @property
    def successes(self) -> int:
        return sum(result.success for result in self.results)

    @property
    def number(self) -> float:
        """The value as a number, the first of several; NaN if it is none."""
        try:
            return float(self.value.partition(",")[0])
        except ValueError:
            return math.nan

    @property
    def median_time(self) -> float | None:
        """Of the successful runs, simulated seconds."""
        times = [result.time for result in self.results if result.success]
        return distribution(times).median if times else None

    @property
    def contacts(self) -> int:
        return sum(result.contacts for result in self.results)


@dataclass(frozen=True, slots=True)
class Curve:
    """Name that is varied, and its values that have runs: numbers in ascending order, others as given."""

    name: str
    values: tuple[SweepValue, ...]

    @property
    def is_of_numbers(self) -> bool:
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
    groups: dict[tuple[str, str], list[TrialResult]] = {}
    for result in folder.done:
        ((name, value),) = plan.points[plan.point(result.number)].items()
        groups.setdefault((name, value), []).append(result)
    found = []
    for name in dict.fromkeys(name for point in plan.points for name in point):
        values = [value for point in plan.points for key, value in point.items() if key == name]
        places = [
            SweepValue(value, tuple(groups[name, value])) for value in values if (name, value) in groups
        ]
        curve = Curve(name, tuple(places))
        if curve.is_of_numbers:
            curve = Curve(name, tuple(sorted(places, key=lambda place: place.number)))
        if places:
            found.append(curve)
    return found


def sweep_tables(folder: TrialFolder, wanted: float) -> list[DataTable]:
    """A table for all that is varied, with the answer below it."""
    return [
        replace(
            SWEEP.filled([_row(curve, each) for each in curve.values], answer(curve, wanted)),
            title=f"Success against {escape(curve.name, 60)}",
        )
        for curve in curves(folder)
    ]


def _row(curve: Curve, point: SweepValue) -> tuple[object, ...]:
    rated = (len(point.results), point.successes, point.rate)
    return curve.name, point.value, *rated, point.median_time, point.contacts


def answer(curve: Curve, wanted: float) -> str:
    """Up to which value the program keeps a success rate, as a sentence."""
    name, places, kept = escape(curve.name, 60), curve.values, curve.kept(wanted)
    if not curve.is_of_numbers:
        good = ", ".join(escape(place.value, 60) for place in kept) or "none of the values"
        return f"The program keeps a success rate of {wanted:g} with {good} of {name}."
    if not kept:
        first = places[0]
        return (
            f"The program does not keep a success rate of {wanted:g} even with {name} at "
            f"{escape(first.value, 60)}, where it is {ESTIMATE.text(first.rate)}."
        )
    last = kept[-1]
    said = (
        f"The program keeps a success rate of {wanted:g} with {name} up to {escape(last.value, 60)}, where "
        f"it is {ESTIMATE.text(last.rate)}"
    )
    if len(kept) < len(places):
        beyond = places[len(kept)]
        said += f"; at {escape(beyond.value, 60)} it is {ESTIMATE.text(beyond.rate)}."
    else:
        said += ", and no greater value was tried."
    if last.rate.low < wanted:
        said += f" {len(last.results)} runs of {escape(last.value, 60)} do not rule out less than {wanted:g}."
    return said


def curves_csv(folder: TrialFolder) -> str:
    """All curves, a row a value: sweep.csv."""
    rows = [_row(curve, each) for curve in curves(folder) for each in curve.values]
    return csv_text(SWEEP.filled(rows))
