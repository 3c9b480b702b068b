"""Formatting of rates, intervals and fractions, the same in every table, page and line."""

from __future__ import annotations

from collections.abc import Sequence

from simmer_tui.trials.intervals import IntervalEstimate, wilson
from simmer_tui.trials.record import TrialResult


def rate(results: Sequence[TrialResult]) -> IntervalEstimate:
    """The success rate of at least one run."""
    return wilson(sum(result.success for result in results), len(results))


def shown_estimate(estimate: IntervalEstimate, form: str = ".3f") -> str:
    """0.940 (0.838 to 0.979)."""
    return f"{estimate.value:{form}} ({estimate.low:{form}} to {estimate.high:{form}})"


def shown_fraction(part: int, whole: int) -> str:
    """34%."""
    return f"{part / whole:.0%}"


def shown_length(value: float) -> str:
    """Simulated seconds or inches, to a tenth."""
    return f"{value:.1f}"
