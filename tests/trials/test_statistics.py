"""Intervals against published values, and what must hold of them whatever the numbers."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.trials.intervals import (
    IntervalEstimate,
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

counts = st.integers(0, 200)
pairs = st.builds(PairCounts, counts, counts, counts, counts).filter(lambda each: each.count > 0)
values = st.lists(st.floats(-1e6, 1e6).map(lambda value: round(value, 3)), min_size=1, max_size=50)


@pytest.mark.parametrize(
    ("successes", "runs", "low", "high"),
    # Newcombe, "Two-sided confidence intervals for the single proportion", Statistics in Medicine 17
    # (1998): 857-872, table I, method 3.
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_interval_has_the_published_limits(successes: int, runs: int, low: float, high: float) -> None:
    estimate = wilson(successes, runs)
    assert estimate.value == successes / runs
    assert estimate.low == pytest.approx(low, abs=5e-5)
    assert estimate.high == pytest.approx(high, abs=5e-5)


@given(st.integers(1, 5000).flatmap(lambda runs: st.tuples(st.integers(0, runs), st.just(runs))))
def test_wilson_interval_holds_the_rate_and_mirrors(successes_of: tuple[int, int]) -> None:
    successes, runs = successes_of
    estimate, mirrored = wilson(successes, runs), wilson(runs - successes, runs)
    assert 0 <= estimate.low <= estimate.value <= estimate.high <= 1
    assert estimate.low == pytest.approx(1 - mirrored.high, abs=1e-12)


@pytest.mark.parametrize(
    ("table", "value", "low", "high"),
    [
        # Newcombe, Statistics in Medicine 17 (1998): 2635-2650, method 10
        (PairCounts(36, 2, 12, 0), 0.2, 0.0569, 0.3404),
        # Fagerland, Lydersen and Laake, "Recommended tests and confidence intervals for paired
        # binomial proportions", Statistics in Medicine 33 (2014): 2850-2875, both examples
        (PairCounts(1, 7, 1, 12), -0.2857, -0.5069, -0.0256),
        (PairCounts(59, 16, 6, 80), -0.0621, -0.1186, -0.0046),
    ],
)
def test_paired_difference_has_the_published_limits(
    table: PairCounts, value: float, low: float, high: float
) -> None:
    estimate = paired_difference(table)
    assert (estimate.value, estimate.low, estimate.high) == pytest.approx((value, low, high), abs=5e-5)


@given(pairs)
def test_paired_difference_holds_its_value_and_mirrors_when_the_two_change_places(table: PairCounts) -> None:
    estimate = paired_difference(table)
    mirrored = paired_difference(PairCounts(table.both, table.second_only, table.first_only, table.neither))
    assert -1 <= estimate.low <= estimate.value + 1e-12
    assert estimate.value - 1e-12 <= estimate.high <= 1
    assert estimate.value == pytest.approx((table.second_only - table.first_only) / table.count)
    assert (mirrored.low, mirrored.high) == pytest.approx((-estimate.high, -estimate.low), abs=1e-9)


@given(pairs)
def test_more_pairs_of_the_same_kind_narrow_the_interval(table: PairCounts) -> None:
    more = PairCounts(table.both * 9, table.first_only * 9, table.second_only * 9, table.neither * 9)
    narrow, wide = paired_difference(more), paired_difference(table)
    assert narrow.high - narrow.low < wide.high - wide.low


@settings(max_examples=12)
@given(pairs)
def test_mcnemar_is_the_two_sided_binomial_test_of_the_unequal_pairs(table: PairCounts) -> None:
    unequal = table.first_only + table.second_only
    chances = [math.comb(unequal, k) / 2**unequal for k in range(unequal + 1)]
    observed = chances[table.first_only]
    as_uneven = sum(chance for chance in chances if chance <= observed * (1 + 1e-9))
    assert mcnemar(table) == pytest.approx(as_uneven, rel=1e-6)


def test_mcnemar_of_a_known_table() -> None:
    assert mcnemar(PairCounts(1, 7, 1, 12)) == pytest.approx(0.0703, abs=5e-5)  # 2 * (1 + 8) / 2**8


@settings(max_examples=12)
@given(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=20))
def test_mean_difference_is_around_the_mean_and_repeats(differences: list[float]) -> None:
    estimate = mean_difference(differences)
    assert estimate is not None
    assert estimate == mean_difference(differences)
    slack = 1e-9 * max(1.0, *(abs(each) for each in differences))
    assert estimate.value == pytest.approx(sum(differences) / len(differences), abs=slack)
    assert estimate.low <= estimate.value + slack
    assert estimate.value - slack <= estimate.high


@pytest.mark.parametrize("differences", [[], [1.0], [1.0, 2.0]])
def test_fewer_than_three_differences_have_no_interval(differences: list[float]) -> None:
    assert mean_difference(differences) is None


def test_mean_of_equal_differences_is_that_difference() -> None:
    assert mean_difference([0.1] * 6) == IntervalEstimate(
        pytest.approx(0.1), pytest.approx(0.1), pytest.approx(0.1)
    )


@pytest.mark.parametrize(
    ("degrees", "value"),
    # W. H. Beyer (editor), "CRC Standard Mathematical Tables", percentage points of Student's t
    [(2, 4.3027), (4, 2.7764), (9, 2.2622), (11, 2.2010), (19, 2.0930), (39, 2.0227), (120, 1.9799)],
)
def test_student_quantile_has_the_published_values(degrees: int, value: float) -> None:
    assert student_quantile(degrees) == pytest.approx(value, abs=6e-5)


SAMPLES = 1000
Draw = Callable[[np.random.Generator, int], np.ndarray]


@pytest.mark.parametrize("size", [5, 20])
@pytest.mark.parametrize(
    ("mean", "draw"),
    [
        pytest.param(1.0, lambda random, n: random.normal(1, 1, n), id="normal", marks=pytest.mark.slow),
        pytest.param(0.5, lambda random, n: random.random(n), id="uniform", marks=pytest.mark.slow),
        pytest.param(1.0, lambda random, n: random.exponential(1, n), id="exponential"),
        pytest.param(2.0, lambda random, n: random.gamma(2, 1, n), id="gamma", marks=pytest.mark.slow),
        pytest.param(
            math.exp(0.125),
            lambda random, n: random.lognormal(0, 0.5, n),
            id="lognormal",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            1.0, lambda random, n: random.poisson(1, n).astype(float), id="counts", marks=pytest.mark.slow
        ),
        pytest.param(
            0.3,
            lambda random, n: random.exponential(1, n) - random.exponential(0.7, n),
            id="differences",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            0.0, lambda random, n: random.standard_t(3, n), id="heavy tails", marks=pytest.mark.slow
        ),
    ],
)
def test_intervals_of_means_hold_what_they_promise(mean: float, draw: Draw, size: int) -> None:
    random = np.random.default_rng(np.random.SeedSequence(12, spawn_key=(size,)))
    held = 0
    for _ in range(SAMPLES):
        estimate = mean_difference(draw(random, size).tolist(), resamples=1000)
        assert estimate is not None
        held += estimate.low <= mean <= estimate.high
    assert held / SAMPLES >= 0.93  # t alone: 0.89 of the exponential ones; percentiles: 0.79 to 0.84 at 5


def test_mean_difference_of_normal_values_is_near_the_textbook_interval() -> None:
    differences = [5 + math.sin(k * 12.9898) * 3 for k in range(400)]
    estimate = mean_difference(differences)
    assert estimate is not None
    mean = sum(differences) / 400
    error = math.sqrt(sum((each - mean) ** 2 for each in differences) / 399 / 400)
    assert estimate.value == pytest.approx(mean)
    assert estimate.low == pytest.approx(mean - 1.96 * error, abs=0.1 * error)
    assert estimate.high == pytest.approx(mean + 1.96 * error, abs=0.1 * error)


def test_distribution_gives_the_quartiles() -> None:
    spread = distribution([4.0, 1.0, 3.0, 2.0, 5.0])
    assert (spread.least, spread.quarter, spread.median, spread.three_quarters, spread.most) == (
        1,
        2,
        3,
        4,
        5,
    )


@settings(max_examples=12)
@given(values)
def test_histogram_has_round_edges_around_all_values_and_counts_each_once(numbers: list[float]) -> None:
    edges, decimals = histogram(numbers)
    assert edges == sorted(set(edges))
    assert edges[0] <= min(numbers) + 1e-6
    assert max(numbers) - 1e-6 <= edges[-1]
    assert len(edges) <= 23
    assert all(float(f"{edge:.{decimals}f}") == pytest.approx(edge) for edge in edges)
    assert sum(bin_counts(numbers, edges)) == len(numbers)
    assert bin_counts([], edges) == [0] * (len(edges) - 1)
