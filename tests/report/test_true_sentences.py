"""Sentences of causes that their own evidence carries, and none beyond it."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import find_set, load
from simmer_tui.report.finding import Basis, DeviceUnderTest, kept
from simmer_tui.report.sensor_audit import sensor_tests
from simmer_tui.report.sensor_sample import SensorSample, inverted_compass
from simmer_tui.sim.sensors import modelled_sensor
from simmer_tui.sim.sensors.base import Sensor

SET = load(find_set("mission"))


def sensor_of(code: str) -> Sensor:
    return modelled_sensor(next(each for each in SET.simulation.sensors if each.code == code))


# -- sensors -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("missed", "looked", "found"), [(2, 6, 0), (1, 20, 0), (10, 20, 1)])
def test_a_share_of_few_readings_or_with_an_interval_down_to_nothing_is_no_finding(
    missed: int, looked: int, found: int
) -> None:
    values = np.linspace(5.0, 20.0, looked - missed)
    sample = SensorSample(
        sensor_of("u1"), values, values, np.full(len(values), 0.2), missed=missed, looked=looked
    )
    device = DeviceUnderTest("u1", "reading", Basis.NOMINAL, ", against the nominal set")
    assert len(kept(sensor_tests(device, sample))) == found


def test_a_compass_that_is_half_a_turn_off_is_not_said_to_have_the_wrong_sign() -> None:
    compass = sensor_of("c1")
    rng = np.random.default_rng(1)
    # A robot that drives to and fro along one way.
    headings = np.tile((90.0, 270.0), 25) + rng.normal(0.0, 2.0, 50)
    values = (headings + 180.0 + rng.normal(0.0, 0.2, 50)) % 360.0
    sample = SensorSample(compass, values, headings, np.full(50, 0.5))
    sample = sample.against(inverted_compass(sample, headings))
    (found,) = kept(sensor_tests(DeviceUnderTest("c1", "reading"), sample))
    assert found.kind == "offset"
    assert abs(found.value) == pytest.approx(180.0, abs=1.0)
