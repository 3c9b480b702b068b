"""Functions on arrays that stand in for numpy's own."""

import math

import numpy as np
import pytest

from simmer_tui.sim.arrays import distinct, median_of, quantiles


@pytest.mark.parametrize("count", [1, 2, 3, 10, 101])
def test_medians_quantiles_and_distinct_values_are_those_of_numpy(count: int) -> None:
    random = np.random.default_rng(count)
    for values in (random.normal(size=count), random.normal(size=count).round(1)):
        fractions = (0.0, 0.1, 0.5, 0.9, 1.0)
        assert median_of(values) == np.median(values)
        assert quantiles(values, *fractions) == np.quantile(values, fractions).tolist()
        assert distinct(values).tolist() == np.unique(values).tolist()
        values[0] = math.nan
        assert math.isnan(median_of(values))


def test_nothing_has_no_median() -> None:
    assert math.isnan(median_of(np.empty(0)))
