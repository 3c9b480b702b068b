"""What a sweep has shown: success against each value, and up to which one a program keeps a rate."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass

from simmer_tui.report.command_table import harmless
from simmer_tui.report.content import Column, Table
from simmer_tui.sim.command import escape
from simmer_tui.trials.estimate_text import rate, shown_estimate, shown_length
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.intervals import IntervalEstimate, distribution
from simmer_tui.trials.record import TrialResult

WANTED_RATE = 0.9
"""The success rate that a program is to keep unless it is said."""
CURVES = "sweep.csv"
_HEADER = (
    "setting",
    "value",
    "runs",
    "successes",
    "success_rate",
    "low",
    "high",
    "median_time_s",
    "contacts",
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
    """What is varied, and its values that have runs: numbers in ascending order, others as given."""

    name: str
    values: tuple[SweepValue, ...]

    @property
    def is_of_numbers(self) -> bool:
        return all(math.isfinite(value.number) for value in self.values)

    def kept(self, wanted: float) -> list[SweepValue]:
        """The values at which the success rate is as `wanted`; of numbers, those before the first at
        which it is not."""
        kept = []
        for value in self.values:
            if value.rate.value >= wanted:
                kept.append(value)
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
        named = [point[name] for point in plan.points if name in point]
        values = [SweepValue(each, tuple(groups[name, each])) for each in named if (name, each) in groups]
        curve = Curve(name, tuple(values))
        if curve.is_of_numbers:
            curve = Curve(name, tuple(sorted(values, key=lambda value: value.number)))
        if values:
            found.append(curve)
    return found


def sweep_tables(folder: TrialFolder, wanted: float) -> list[Table]:
    """A table for all that is varied, with what it says below it."""
    columns = (
        Column("value"),
        Column("runs", True),
        Column("successes", True),
        Column("success rate", True),
        Column("median time s", True),
        Column("contacts", True),
    )
    return [
        Table(
            f"Success against {escape(curve.name, 60)}",
            columns,
            tuple(
                (
                    escape(value.value, 60),
                    str(len(value.results)),
                    str(value.successes),
                    shown_estimate(value.rate),
                    "" if value.median_time is None else shown_length(value.median_time),
                    str(value.contacts),
                )
                for value in curve.values
            ),
            answer(curve, wanted),
        )
        for curve in curves(folder)
    ]


def answer(curve: Curve, wanted: float) -> str:
    """Up to which value the program keeps a success rate, as a sentence."""
    name, values, kept = escape(curve.name, 60), curve.values, curve.kept(wanted)
    if not curve.is_of_numbers:
        good = ", ".join(escape(value.value, 60) for value in kept) or "none of the values"
        return f"The program keeps a success rate of {wanted:g} with {good} of {name}."
    if not kept:
        first = values[0]
        return (
            f"The program does not keep a success rate of {wanted:g} even with {name} at "
            f"{escape(first.value, 60)}, where it is {shown_estimate(first.rate)}."
        )
    last = kept[-1]
    said = (
        f"The program keeps a success rate of {wanted:g} with {name} up to {escape(last.value, 60)}, where "
        f"it is {shown_estimate(last.rate)}"
    )
    if len(kept) < len(values):
        beyond = values[len(kept)]
        said += f"; at {escape(beyond.value, 60)} it is {shown_estimate(beyond.rate)}."
    else:
        said += ", and no greater value was tried."
    if last.rate.low < wanted:
        said += f" {len(last.results)} runs of {escape(last.value, 60)} do not rule out less than {wanted:g}."
    return said


def curves_csv(folder: TrialFolder) -> str:
    """All curves, a row a value."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_HEADER)
    for curve in curves(folder):
        for value in curve.values:
            estimate, time = value.rate, value.median_time
            writer.writerow(
                (
                    harmless(curve.name), harmless(value.value), len(value.results), value.successes,
                    estimate.value, estimate.low, estimate.high, "" if time is None else time, value.contacts,
                )
            )  # fmt: skip
    return text.getvalue()
