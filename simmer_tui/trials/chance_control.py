"""The control for chance: a change may save a failed run by itself, or by the other errors that it draws.

A change of the simulator changes all random errors that follow, so a run that failed by a narrow margin may
succeed with any change. So the same mission is run with other errors, changed and unchanged, with the same
seeds for both. The unchanged runs show the effect of chance alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from simmer_tui.document.formats import COUNT, Format, estimate
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.trials.intervals import SIGNIFICANCE, PairCounts, mcnemar, paired_difference

REPEATS = 10
"""Runs with other errors, changed and unchanged each. If the change alone saves six, p is 0.03."""


@dataclass(frozen=True, slots=True)
class ChanceControl:
    """A change of a failed run beside the unchanged run, as `pairs` with the same other errors: the first is
    unchanged, the second changed. `tested` is the number of changes that were tested."""

    change: str
    pairs: PairCounts
    tested: int

    @property
    def successes(self) -> int:
        """Runs that succeed with the change."""
        return self.pairs.both + self.pairs.second_only

    @property
    def unchanged(self) -> int:
        """Runs that succeed without it."""
        return self.pairs.both + self.pairs.first_only

    @property
    def p(self) -> float:
        """Probability of a difference as large where there is none: McNemar's exact test, times the number of
        tests (Bonferroni)."""
        return min(mcnemar(self.pairs) * self.tested, 1.0)

    @property
    def is_sure(self) -> bool:
        """True if the change makes more runs succeed than chance does."""
        return self.pairs.second_only > self.pairs.first_only and self.p < SIGNIFICANCE

    def is_decided(self, more: int) -> bool:
        """True if `more` pairs cannot change `is_sure`, whatever their results."""
        pairs = self.pairs
        best = replace(self, pairs=replace(pairs, second_only=pairs.second_only + more))
        worst = replace(self, pairs=replace(pairs, first_only=pairs.first_only + more))
        return best.is_sure == worst.is_sure

    @property
    def text(self) -> str:
        """Its figures: `with other random errors 9 of 10 runs succeed, unchanged 1 of 10 (p = 0.0078)`."""
        count = self.pairs.count
        changed, unchanged = f"{self.successes} of {count} runs", f"{self.unchanged} of {count}"
        return f"with other random errors {changed} succeed, unchanged {unchanged} (p = {self.p:.2g})"


def control_of(
    change: str, changed: Mapping[int, bool], unchanged: Mapping[int, bool], tested: int
) -> ChanceControl | None:
    """The control of a change; None if no run was repeated.

    Args:
        change: Name of the change.
        changed: Success of its runs, by the number of their errors.
        unchanged: Success of unchanged runs with the same errors.
        tested: Number of changes of this run that are tested.
    """
    pairs = [(unchanged[each], changed[each]) for each in changed.keys() & unchanged.keys()]
    return ChanceControl(change, PairCounts.of(pairs), tested) if pairs else None


CONTROL = data_table(
    "control",
    "Control for chance: the same missions with other random errors",
    DataColumn("run", COUNT),
    DataColumn("change", wraps=True),
    DataColumn("runs", COUNT),
    DataColumn("succeeded", COUNT, "succeeded with it"),
    DataColumn("unchanged", COUNT, "without"),
    DataColumn("difference", estimate("+.2f")),
    DataColumn("p", Format(lambda p: f"{p:.2g}")),
)


def control_table(controls: Sequence[tuple[int, ChanceControl]]) -> DataTable:
    """The controls of runs, each with its run's number."""
    rows = []
    for run, each in controls:
        counts = (each.pairs.count, each.successes, each.unchanged)
        rows.append((run, each.change, *counts, paired_difference(each.pairs), each.p))
    return CONTROL.filled(rows)
