"""A rate behind a low-pass filter, in closed form: whatever is read in between."""

from __future__ import annotations

import math
import random

import pytest

from simmer_tui.sketch.low_pass import GYRO_DELAYS, LowPassRate

STEPS = ((0, 0.0), (1_000_000, 90.0), (9_000_000, -30.0), (9_500_000, 12.5))


def test_readings_between_steps_change_nothing() -> None:
    chance = random.Random(1)
    quiet, read = LowPassRate(), LowPassRate()
    for time, rate in STEPS:
        for each in (quiet, read):
            each.set_rate(time, rate)
        for _ in range(chance.randrange(5)):
            read.at(time + chance.randrange(500_000))
            # The world looks again where nothing has changed.
            read.set_rate(time + chance.randrange(500_000), rate)
    for time in range(9_500_000, 40_000_000, 777_777):
        assert read.at(time) == quiet.at(time)


@pytest.mark.parametrize("number", range(8))
def test_after_its_delay_a_step_has_come_by_63_percent(number: int) -> None:
    rate = LowPassRate()
    rate.set_rate(0, 10.0)
    assert rate.at(5) == 10.0
    rate.set_filter(5, number)
    rate.set_rate(10, 110.0)
    assert rate.at(10) == 10.0
    assert not rate.is_steady(10)
    assert rate.at(10 + GYRO_DELAYS[number]) == pytest.approx(110.0 - 100.0 / math.e)
    assert rate.at(10 + 12 * GYRO_DELAYS[number]) == 110.0
    assert rate.is_steady(10 + 12 * GYRO_DELAYS[number])


def test_another_filter_goes_on_from_the_same_rate() -> None:
    rate = LowPassRate()
    rate.set_rate(0, 0.0)
    rate.set_rate(10, 100.0)
    before = rate.at(500_000)
    rate.set_filter(500_000, 6)
    assert rate.at(500_000) == pytest.approx(before)
    assert rate.at(5_000_000) < 95.0
