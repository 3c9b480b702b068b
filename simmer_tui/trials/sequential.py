"""Decision about a program's success rate with as few runs as possible.

Wald's sequential probability ratio test: A. Wald, "Sequential tests of statistical hypotheses", Annals
of Mathematical Statistics 16 (1945): 117-186. After each run the likelihood ratio of the success rates `rate`
and `rate - margin` is compared with two bounds. Above (1 - risk) / risk the program passes, below the inverse
it fails. A cap ends a walk that is still between the two, by a number of successes. The effect of the cap on
both errors is computed exactly, from the distribution of the walk after each run.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate

import numpy as np

from simmer_tui.errors import TrialsError
from simmer_tui.sim.rules import IntegerRule, NumberRule
from simmer_tui.trials.intervals import IntervalEstimate

# Runs grow with the inverse square of the margin: for a good program 0.15 takes 38, 0.05 takes 246.
REQUIRED_RATE, MARGIN, RISK = 0.9, 0.15, 0.05
"""Defaults: the success rate that passes, a rate this much lower that fails, and the error rate of either
decision."""
# The distribution of a walk of n runs takes n^2 steps, and no course has time for more runs.
LARGEST_CAP = 5000
RATE_RULE = NumberRule(0, 1, low_open=True)
CAP_RULE = IntegerRule(1, LARGEST_CAP)
"""A success rate, and a cap of runs, as an option and as a key of course.toml."""
# Where the ratio meets a bound exactly, the rounding of logarithms must not decide.
_ROUNDING = 1e-9
# Bisection of [0, 1] down to the last bit of a double (2^-53), with some to spare.
_HALVINGS = 60


@dataclass(frozen=True, slots=True)
class Decision:
    """Decision at the end of a walk, with its numbers of runs and successes."""

    passed: bool
    runs: int
    successes: int


@dataclass(frozen=True)
class SequentialTest:
    """A test, made by `sequential_test`. After n runs a walk with at most `fail_at[n]` successes fails, one
    with at least `pass_at[n]` passes. At `cap` the two meet. `false_pass` and `false_fail` are the exact
    probabilities of a wrong decision at `rate - margin` and at `rate`."""

    rate: float
    margin: float
    risk: float
    cap: int
    fail_at: tuple[int, ...] = field(repr=False)
    pass_at: tuple[int, ...] = field(repr=False)
    false_pass: float
    false_fail: float

    def decision(self, successes: Iterable[bool]) -> Decision | None:
        """The decision after some runs, in the order of their numbers; None if there are too few."""
        for runs, count in enumerate(accumulate(map(int, successes)), 1):
            if count <= self.fail_at[runs] or count >= self.pass_at[runs]:
                return Decision(count >= self.pass_at[runs], runs, count)
        return None

    def passes(self, rate: float) -> float:
        """The probability that a program with this true success rate passes."""
        return math.fsum(
            self._chance(runs, count, rate) for runs, count in self._ends if count >= self.pass_at[runs]
        )

    def expected_runs(self, rate: float) -> float:
        """Mean number of runs for a program with this true success rate."""
        return math.fsum(runs * self._chance(runs, count, rate) for runs, count in self._ends)

    def interval(self, runs: int, successes: int) -> IntervalEstimate:
        """The success rate after a decision, with its interval of 95 %.

        The usual intervals assume a fixed number of runs; here it depends on the results, and they would be
        wrong. So all possible ends are ordered, from an early failure to an early pass (around the boundary,
        as P. Armitage, "Numerical studies in the sequential estimation of a binomial parameter", Biometrika
        45 (1958): 1-15), and the interval has the rates with which an end at least as good, and one at least
        as bad, has 2.5 % or more. It is exact like that of Clopper and Pearson, so it contains the truth in
        at least 95 % of cases. (More successes in the same runs never lead to a worse end, so both
        probabilities are monotone in the rate.) Raises ValueError if these numbers are no end.
        """
        place = self._ends.index((runs, successes))
        return IntervalEstimate(
            successes / runs,
            0.0 if place == 0 else self._root(place, at_least=True),
            1.0 if place == len(self._ends) - 1 else self._root(place, at_least=False),
        )

    def _root(self, place: int, *, at_least: bool) -> float:
        """The rate with which an end from this place on (or up to it) has 2.5 %."""
        ends = self._ends[place:] if at_least else self._ends[: place + 1]
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            tail = math.fsum(self._chance(runs, count, middle) for runs, count in ends)
            if (tail < 0.025) is at_least:
                low = middle
            else:
                high = middle
        return low if at_least else high

    @cached_property
    def _ends(self) -> list[tuple[int, int]]:
        """All possible ends (runs, successes), from the worst to the best."""

        def goodness(end: tuple[int, int]) -> tuple[int, int]:
            runs, count = end
            if runs == self.cap:
                return 1, count
            return (0, runs) if count <= self.fail_at[runs] else (2, -runs)

        return sorted(self._paths, key=goodness)

    @cached_property
    def _paths(self) -> dict[tuple[int, int], float]:
        """The logarithm of the number of paths to each end."""
        paths, open_paths = {}, {0: 1}
        for runs in range(1, self.cap + 1):
            after: dict[int, int] = {}
            for count, number in open_paths.items():
                for reached in (count, count + 1):
                    after[reached] = after.get(reached, 0) + number
            open_paths = {}
            for count, number in after.items():
                if count <= self.fail_at[runs] or count >= self.pass_at[runs]:
                    paths[runs, count] = math.log(number)
                else:
                    open_paths[count] = number
        return paths

    def _chance(self, runs: int, count: int, rate: float) -> float:
        if rate in (0.0, 1.0):
            return float(count == (runs if rate else 0))
        paths = self._paths[runs, count]
        return math.exp(paths + count * math.log(rate) + (runs - count) * math.log1p(-rate))


# Judged: far finer than any number of runs can distinguish; below it the bounds overflow.
_LEAST = 1e-9
"""Least margin and error of a test."""


def sequential_test(
    rate: float, margin: float = MARGIN, risk: float = RISK, cap: int | None = None
) -> SequentialTest:
    """The test that passes a program at `rate` and fails one at `rate - margin`, each wrongly with at most
    `risk`. Without a `cap`, the smallest one that keeps both errors within `risk` is used; a given cap may
    enlarge them. At the cap, the number of successes that decides minimizes the larger error.

    Raises TrialsError if there is no such test.
    """
    if not (
        _LEAST <= margin < rate <= 1 and _LEAST <= risk < 0.5 and (cap is None or 0 < cap <= LARGEST_CAP)
    ):
        raise TrialsError(
            f"no test tells a success rate of {rate:g} from one lower by {margin:g} with errors of {risk:g}: "
            f"the rate must be above the margin (--margin) and at most 1, a cap of runs at most {LARGEST_CAP}"
        )
    low = rate - margin
    bound = math.log((1 - risk) / risk)
    up = math.log(rate / low)
    down = math.log((1 - rate) / (1 - low)) if rate < 1 else -math.inf
    fail_at, pass_at = [-1], [1]
    walks = np.ones((2, 1))  # the probabilities of 0, 1, ... successes so far, at `low` and at `rate`
    rates = np.array([[low], [rate]])
    false_pass = false_fail = 0.0
    for runs in range(1, (cap or LARGEST_CAP) + 1):
        walks = np.pad(walks * (1 - rates), ((0, 0), (0, 1))) + np.pad(walks * rates, ((0, 0), (1, 0)))
        failing, passing = _bounds(runs, bound, up, down)
        # Both errors if the test ended here, and 0, 1, ... successes, or one more than all, were needed.
        beyond = np.pad(np.cumsum(walks[:, ::-1], axis=1)[:, ::-1], ((0, 0), (0, 1)))
        passed, failed = false_pass + beyond[0], false_fail + (beyond[1, 0] - beyond[1])
        wrong = np.maximum(passed, failed)
        cut = failing + 1 + int(np.argmin(wrong[failing + 1 : passing + 1]))
        if runs == cap or (cap is None and wrong[cut] <= risk):
            ends = ((*fail_at, cut - 1), (*pass_at, cut))
            return SequentialTest(rate, margin, risk, runs, *ends, float(passed[cut]), float(failed[cut]))
        false_pass += float(walks[0, passing:].sum())
        false_fail += float(walks[1, : failing + 1].sum())
        walks[:, passing:] = 0.0
        walks[:, : failing + 1] = 0.0
        fail_at.append(failing)
        pass_at.append(passing)
    raise TrialsError(
        f"to tell a success rate of {rate:g} from {low:g} with errors of {risk:g} takes more than "
        f"{LARGEST_CAP} runs: allow a greater margin or error"
    )


def _bounds(runs: int, bound: float, up: float, down: float) -> tuple[int, int]:
    """The most successes of `runs` with which a walk fails, and the fewest with which it passes."""
    if down == -math.inf:
        return runs - 1, runs if runs * up >= bound - _ROUNDING else runs + 1
    step = up - down
    failing = math.floor((-bound - runs * down) / step + _ROUNDING)
    passing = math.ceil((bound - runs * down) / step - _ROUNDING)
    return max(failing, -1), min(passing, runs + 1)


def shown_test(test: SequentialTest) -> str:
    """Sentence about the test and its errors."""
    return (
        f"Wald's sequential test: success rate {test.rate:g} passes and {test.rate - test.margin:g} fails; "
        f"at most {test.cap} runs; computed errors: false pass {test.false_pass:.1%}, "
        f"false fail {test.false_fail:.1%}"
    )
