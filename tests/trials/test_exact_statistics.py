"""The numbers that grade students, against closed forms, numerical integration and all walks one by one.

Each of them decides about a program, so a wrong constant or sign must show: everything here is compared
to at least 6 digits with something that is computed in another way.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from itertools import pairwise, product

import numpy as np
import pytest
from scipy import stats

from simmer_tui.trials.intervals import (
    RESAMPLES,
    PairCounts,
    bin_counts,
    distribution,
    histogram,
    mcnemar,
    mean_difference,
    paired_difference,
    student_quantile,
    wilson,
)
from simmer_tui.trials.sequential import MARGIN, RISK, Decision, SequentialTest, sequential_test

Z = statistics.NormalDist().inv_cdf(0.975)


# -- one rate ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("successes", "runs"), [(1, 2), (3, 7), (50, 60), (1, 500), (4999, 5000)])
def test_wilson_limits_are_the_rates_at_which_the_score_test_just_rejects(successes: int, runs: int) -> None:
    """Wilson (1927): both limits p solve (rate - p)^2 = z^2 p (1 - p) / n."""
    estimate = wilson(successes, runs)
    for limit in (estimate.low, estimate.high):
        error = math.sqrt(limit * (1 - limit) / runs)
        assert abs(estimate.value - limit) / error == pytest.approx(Z, rel=1e-9)
    assert estimate.low < estimate.value < estimate.high


@pytest.mark.parametrize("runs", [1, 10, 100])
def test_wilson_limits_of_no_and_of_only_successes_have_a_closed_form(runs: int) -> None:
    none, all_of_them = wilson(0, runs), wilson(runs, runs)
    assert (none.low, none.high) == (0.0, pytest.approx(Z * Z / (runs + Z * Z), rel=1e-12))
    assert (all_of_them.low, all_of_them.high) == (pytest.approx(runs / (runs + Z * Z), rel=1e-12), 1.0)


# -- two programs --------------------------------------------------------------------------------------


def test_paired_limits_are_those_of_newcombes_formula() -> None:
    """Method 10 step by step, as Newcombe (1998) writes it: n 100 pairs, positive correlation."""
    counts = PairCounts(both=60, first_only=5, second_only=15, neither=20)
    (l2, u2), (l1, u1) = ((each.low, each.high) for each in (wilson(75, 100), wilson(65, 100)))
    phi = (60 * 20 - 15 * 5 - 100 / 2) / math.sqrt(75 * 25 * 65 * 35)
    d2, e2, d1, e1 = 0.75 - l2, u2 - 0.75, 0.65 - l1, u1 - 0.65
    estimate = paired_difference(counts)
    assert estimate.value == pytest.approx(0.1)
    assert estimate.low == pytest.approx(0.1 - math.sqrt(d2**2 - 2 * phi * d2 * e1 + e1**2), rel=1e-9)
    assert estimate.high == pytest.approx(0.1 + math.sqrt(e2**2 - 2 * phi * e2 * d1 + d1**2), rel=1e-9)


def test_paired_limits_without_discordant_or_without_concordant_pairs() -> None:
    one_sided = paired_difference(PairCounts(both=0, first_only=0, second_only=20, neither=0))
    assert (one_sided.value, one_sided.high) == (1.0, 1.0)
    gap = Z * Z / (20 + Z * Z)  # of both rates, which are uncorrelated where one is constant
    assert one_sided.low == pytest.approx(1 - math.hypot(gap, gap), rel=1e-9)
    alike = paired_difference(PairCounts(both=10, first_only=0, second_only=0, neither=10))
    assert (alike.value, alike.low) == (0.0, -alike.high)


@pytest.mark.parametrize(
    ("first_only", "second_only", "p"),
    [(0, 0, 1.0), (0, 5, 0.0625), (5, 0, 0.0625), (1, 7, 18 / 256), (3, 3, 1.0), (2, 9, 2 * 67 / 2048)],
)
def test_mcnemar_p_values_are_binomial_tails(first_only: int, second_only: int, p: float) -> None:
    assert mcnemar(PairCounts(4, first_only, second_only, 9)) == pytest.approx(p, rel=1e-12)


# -- means ---------------------------------------------------------------------------------------------


def student_probability(t: float, degrees: int, steps: int = 2000) -> float:
    """The distribution function of Student's t, by Simpson's rule from 0."""
    constant = math.exp(math.lgamma((degrees + 1) / 2) - math.lgamma(degrees / 2))
    constant /= math.sqrt(degrees * math.pi)
    values = [(1 + (t * k / steps) ** 2 / degrees) ** (-(degrees + 1) / 2) for k in range(steps + 1)]
    weighted = values[0] + values[-1] + 4 * sum(values[1:-1:2]) + 2 * sum(values[2:-1:2])
    return 0.5 + constant * t / steps / 3 * weighted


@pytest.mark.parametrize("degrees", [*range(2, 16), 20, 30, 60, 200])
def test_student_quantiles_leave_a_fortieth_above(degrees: int) -> None:
    assert student_probability(student_quantile(degrees), degrees) == pytest.approx(0.975, abs=2.5e-7)


@pytest.mark.parametrize("degrees", [11, 12, 15, 20, 30])
def test_student_quantiles_err_by_the_first_term_that_is_left_out(degrees: int) -> None:
    """The expansion ends with 1 / n^4: what is left is -0.78 / n^5, whatever the degrees."""
    left = student_quantile(degrees) - float(stats.t.ppf(0.975, degrees))
    assert left * degrees**5 == pytest.approx(-0.77, abs=0.03)


def quantile(values: Sequence[float], part: float) -> float:
    """By linear interpolation between the ordered values."""
    ordered, place = sorted(values), part * (len(values) - 1)
    low = math.floor(place)
    return ordered[low] + (place - low) * (ordered[min(low + 1, len(values) - 1)] - ordered[low])


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("values", [[1.0, 2.0, 4.0], [0.0, 0.1, 0.3, 2.5], [-3.0, -2.9, -2.8, -2.7, 4.0]])
def test_limits_of_a_mean_are_the_further_of_student_and_bootstrap(values: list[float]) -> None:
    """The bootstrap-t of Efron and Tibshirani (1993), chapter 12, one resample after the other."""
    count, mean = len(values), statistics.fmean(values)
    error = statistics.stdev(values) / math.sqrt(count)
    drawn = np.random.default_rng(0).choice(np.array(values) - mean, (RESAMPLES, count)).tolist()
    resampled = [
        statistics.fmean(each) / (deviation / math.sqrt(count))
        for each in drawn
        if (deviation := statistics.stdev(each)) > 1e-9
    ]
    t = student_quantile(count - 1)
    estimate = mean_difference(values)
    assert estimate is not None
    assert estimate.value == pytest.approx(mean)
    assert estimate.low == pytest.approx(mean - max(t, quantile(resampled, 0.975)) * error, rel=1e-6)
    assert estimate.high == pytest.approx(mean + max(t, -quantile(resampled, 0.025)) * error, rel=1e-6)


def test_enough_resamples_are_drawn() -> None:
    assert RESAMPLES == 10_000  # the note of `compare` says so


# -- distributions ---------------------------------------------------------------------------------------


def test_quantiles_are_interpolated() -> None:
    spread = distribution([10.0, 1.0, 3.0, 2.0])
    quantiles = (spread.least, spread.quarter, spread.median, spread.three_quarters, spread.most)
    assert quantiles == (1.0, 1.75, 2.5, 4.75, 10.0)


@pytest.mark.parametrize(
    ("values", "edges", "decimals"),
    [
        ([0.0, 1.0], [k / 20 for k in range(22)], 2),
        ([0.0, 2.0], [k / 10 for k in range(22)], 1),
        ([0.0, 100.0], [5.0 * k for k in range(22)], 0),
        ([3.0, 3.0], [2.99 + 0.02 * k for k in range(3)], 2),
        ([0.0, 0.0], [0.0, 0.005], 3),
        ([12.0, 47.0], [12.0 + 2 * k for k in range(19)], 0),
    ],
)
def test_bins_are_round(values: list[float], edges: list[float], decimals: int) -> None:
    made, shown = histogram(values)
    assert shown == decimals
    assert made[0] <= min(values)
    assert made[-1] > max(values)
    assert made[1] > min(values)
    assert made[-2] <= max(values)
    width = edges[1] - edges[0]
    assert [b - a for a, b in pairwise(made)] == pytest.approx([width] * (len(made) - 1))


def test_values_are_counted_from_the_lower_edge_on() -> None:
    assert bin_counts([0.0, 0.9, 1.0, 1.5, 2.0, 3.0, -1.0], [0.0, 1.0, 2.0]) == [3, 4]


# -- the sequential test ---------------------------------------------------------------------------------

TESTS = [(0.9, 0.15, 0.05), (0.8, 0.3, 0.1), (0.5, 0.2, 0.05), (0.95, 0.5, 0.02)]


def log_likelihood_ratio(runs: int, successes: int, rate: float, low: float) -> float:
    failures = runs - successes
    of_failures = failures * math.log((1 - rate) / (1 - low)) if failures else 0.0
    return successes * math.log(rate / low) + of_failures


@pytest.mark.parametrize(("rate", "margin", "risk"), TESTS)
def test_bounds_are_where_walds_likelihood_ratio_says(rate: float, margin: float, risk: float) -> None:
    """Wald (1945): accept one hypothesis when the ratio reaches (1 - risk) / risk, the other below risk /
    (1 - risk)."""
    test = sequential_test(rate, margin, risk)
    bound = math.log((1 - risk) / risk)
    for runs in range(1, test.cap):
        ratios = [log_likelihood_ratio(runs, count, rate, rate - margin) for count in range(runs + 1)]
        failing = [count for count, ratio in enumerate(ratios) if ratio <= -bound]
        passing = [count for count, ratio in enumerate(ratios) if ratio >= bound]
        assert test.fail_at[runs] == max(failing, default=-1)
        assert test.pass_at[runs] == min(passing, default=runs + 1)
    assert test.pass_at[test.cap] == test.fail_at[test.cap] + 1


def test_one_failure_fails_where_every_run_must_succeed() -> None:
    test = sequential_test(1.0)
    most = math.ceil(math.log(0.95 / 0.05) / math.log(1 / 0.85))
    assert test.cap <= most
    for runs in range(1, test.cap + 1):
        assert test.fail_at[runs] == runs - 1
    assert test.decision([True] * (most - 1) + [True]) == Decision(True, test.cap, test.cap)
    assert test.decision([True, False]) == Decision(False, 2, 1)


@pytest.mark.parametrize(("rate", "margin", "risk"), TESTS)
def test_cap_is_the_smallest_that_keeps_both_errors(rate: float, margin: float, risk: float) -> None:
    test = sequential_test(rate, margin, risk)
    assert max(test.false_pass, test.false_fail) <= risk
    shorter = sequential_test(rate, margin, risk, test.cap - 1)
    assert max(shorter.false_pass, shorter.false_fail) > risk


def all_ends(test: SequentialTest) -> dict[tuple[int, int, bool], int]:
    """Numbers of walks to each end (runs, successes, passed), one walk after the other."""
    ends: dict[tuple[int, int, bool], int] = {}
    seen = set()
    for walk in product((False, True), repeat=test.cap):
        decision = test.decision(walk)
        assert decision is not None
        if walk[: decision.runs] not in seen:
            seen.add(walk[: decision.runs])
            end = decision.runs, decision.successes, decision.passed
            ends[end] = ends.get(end, 0) + 1
    return ends


CAPPED = [(0.8, 0.3, 0.1, 10), (0.9, 0.15, 0.05, 9), (1.0, 0.4, 0.05, 5), (0.6, 0.4, 0.2, 8)]


@pytest.mark.parametrize(("rate", "margin", "risk", "cap"), CAPPED)
def test_cut_at_the_cap_leaves_the_larger_error_smallest(
    rate: float, margin: float, risk: float, cap: int
) -> None:
    """Among the cuts between the two bounds: beyond them the ratio has decided."""
    test = sequential_test(rate, margin, risk, cap)
    errors = {}
    ends = all_ends(test)
    bound = math.log((1 - risk) / risk)
    ratios = [
        log_likelihood_ratio(cap, count, min(rate, 1 - 1e-15), rate - margin) for count in range(cap + 1)
    ]
    least = sum(ratio <= -bound for ratio in ratios)
    for cut in range(least, sum(ratio < bound for ratio in ratios) + 1):
        passing = [(r, c, n) for (r, c, good), n in ends.items() if (good if r < cap else c >= cut)]
        false_pass = sum(n * (rate - margin) ** c * (1 - rate + margin) ** (r - c) for r, c, n in passing)
        false_fail = 1 - sum(n * rate**c * (1 - rate) ** (r - c) for r, c, n in passing)
        errors[cut] = max(false_pass, false_fail)
        if cut == test.pass_at[cap]:
            assert (test.false_pass, test.false_fail) == pytest.approx((false_pass, false_fail), abs=1e-12)
            assert test.passes(rate - margin) == pytest.approx(false_pass, abs=1e-12)
    assert errors[test.pass_at[cap]] == pytest.approx(min(errors.values()), abs=1e-12)


@pytest.mark.parametrize(("rate", "margin", "risk", "cap"), CAPPED)
@pytest.mark.parametrize("true", [0.0, 0.2, 0.7, 1.0])
def test_expected_runs_and_passes_are_those_of_all_walks(
    rate: float, margin: float, risk: float, cap: int, true: float
) -> None:
    test = sequential_test(rate, margin, risk, cap)
    ends = [(r, good, n * true**c * (1 - true) ** (r - c)) for (r, c, good), n in all_ends(test).items()]
    assert sum(chance for _, _, chance in ends) == pytest.approx(1)
    assert test.expected_runs(true) == pytest.approx(sum(runs * chance for runs, _, chance in ends))
    assert test.passes(true) == pytest.approx(sum(chance for _, good, chance in ends if good))


@pytest.mark.parametrize(("rate", "margin", "risk", "cap"), CAPPED)
def test_interval_holds_the_rates_at_which_neither_tail_is_below_a_fortieth(
    rate: float, margin: float, risk: float, cap: int
) -> None:
    """Clopper and Pearson's exact interval in Armitage's order of ends: failed, the latest best; then
    undecided at the cap, by successes; then passed, the earliest best."""
    test = sequential_test(rate, margin, risk, cap)
    ends = all_ends(test)
    failed = sorted(end for end in ends if not end[2] and end[0] < cap)
    at_cap = sorted((end for end in ends if end[0] == cap), key=lambda end: end[1])
    passed = sorted((end for end in ends if end[2] and end[0] < cap), reverse=True)
    order = [*failed, *at_cap, *passed]
    assert len(order) == len(ends)

    def tail(some: Sequence[tuple[int, int, bool]], true: float) -> float:
        return sum(ends[end] * true ** end[1] * (1 - true) ** (end[0] - end[1]) for end in some)

    for place, (runs, successes, _) in enumerate(order):
        estimate = test.interval(runs, successes)
        assert estimate.value == successes / runs
        if place == 0:
            assert estimate.low == 0.0
        else:
            assert tail(order[place:], estimate.low) == pytest.approx(0.025, rel=1e-9)
        if place == len(order) - 1:
            assert estimate.high == 1.0
        else:
            assert tail(order[: place + 1], estimate.high) == pytest.approx(0.025, rel=1e-9)


def test_ends_that_cannot_be_have_no_interval() -> None:
    with pytest.raises(ValueError, match="not in list"):
        sequential_test(0.9).interval(1, 0)


def test_usual_margin_and_risk_are_those_of_the_documents() -> None:
    assert (MARGIN, RISK) == (0.15, 0.05)  # docs/grading.md
