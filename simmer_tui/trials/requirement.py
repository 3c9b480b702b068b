"""Requirement on a set of trials: when enough runs are done, if the program passes, and how that is told.

Command line, page and `--json` ask here, so another way to end the trials is one more case in this module.
"""

from __future__ import annotations

from dataclasses import dataclass

from simmer_tui.document.formats import COUNT, ESTIMATE, SHARE
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.sim.command import counted
from simmer_tui.trials.curves import curves
from simmer_tui.trials.failures import success_rate
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.sequential import REQUIRED_RATE, Decision, SequentialTest, shown_test

DECISION = data_table(
    "decision",
    "Decision of the sequential test, with its own interval",
    DataColumn("passed"),
    *(DataColumn(key, COUNT) for key in ("runs", "successes")),
    DataColumn("success_rate", ESTIMATE),
    record=True,
    hidden=True,
)


@dataclass(frozen=True, slots=True)
class Requirement:
    """Success `rate` of --require, None without one, and the `test` of --sure, which ends the runs as soon as
    it has decided about that rate."""

    rate: float | None = None
    test: SequentialTest | None = None

    # -- what decides ------------------------------------------------------------------------------

    @property
    def sweep_rate(self) -> float:
        """The rate that a sweep is about, which has always one."""
        return REQUIRED_RATE if self.rate is None else self.rate

    def decision(self, folder: TrialFolder) -> Decision | None:
        """The decision of the test; None before it, or without a test."""
        return None if self.test is None else self.test.decision(folder.successes_in_order)

    def has_enough(self, folder: TrialFolder) -> bool:
        """True if no further run is needed, although more are planned."""
        return self.decision(folder) is not None

    def is_met(self, folder: TrialFolder) -> bool | None:
        """True if the program passes by the runs done, in a sweep with some value of each name; None while a
        test has not decided."""
        if self.test is not None:
            decision = self.decision(folder)
            return None if decision is None else decision.passed
        rate = self.rate
        if rate is None:
            return True
        if folder.plan.points:
            return all(curve.kept(rate) for curve in curves(folder))
        return success_rate(folder.done).value >= rate

    # -- what is told ------------------------------------------------------------------------------

    @property
    def announcement(self) -> str:
        """Sentence before the runs; empty if there is nothing to say."""
        return "" if self.test is None else shown_test(self.test)

    def to_do_text(self, folder: TrialFolder) -> str:
        """The number of runs that are to be done, in words."""
        most = "" if self.test is None else "at most "
        return f"{most}{counted(len(folder.to_do), 'run')}"

    def outcome(self, folder: TrialFolder) -> str:
        """Sentence after the runs; empty if there is nothing to say."""
        decision = self.decision(folder)
        if decision is None:
            return "" if self.is_met(folder) else f"the success rate is below the {self.rate:g} required"
        verdict = "passed" if decision.passed else "failed"
        return (
            f"{verdict} after {counted(decision.runs, 'run')}, {decision.successes} of them successes: "
            f"success rate {ESTIMATE.text(self._interval(decision))}, 95 % interval after a sequential test"
        )

    def tables(self, folder: TrialFolder) -> list[DataTable]:
        """The decision of the test, once there is one."""
        decision = self.decision(folder)
        if decision is None:
            return []
        row = (decision.passed, decision.runs, decision.successes, self._interval(decision))
        return [DECISION.filled([row])]

    def headline(self, folder: TrialFolder) -> str:
        """Words of the page about the runs done; empty without a requirement."""
        if self.rate is None:
            return ""
        return {True: "enough", False: "too few", None: "not decided yet"}[self.is_met(folder)]

    @property
    def share(self) -> str:
        """The required rate as a share; empty without one."""
        return "" if self.rate is None else f"{SHARE.text(self.rate)} required"

    @property
    def sentence(self) -> str:
        """The required rate, as part of a sentence; empty without one."""
        if self.rate is None:
            return ""
        return f"{self.rate:g} is required" + (", by a sequential test" if self.test is not None else "")

    def _interval(self, decision: Decision) -> object:
        assert self.test is not None, "a decision is one of a test"
        return self.test.interval(decision.runs, decision.successes)


NO_REQUIREMENT = Requirement()
"""All planned runs are done, and nothing is asked of them."""
