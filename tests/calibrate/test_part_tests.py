"""Tests of a real robot's parts, on samples made up for each fault."""

from __future__ import annotations

import numpy as np
import pytest

from simmer_tui.calibrate.part_tests import (
    Claim,
    SensorSample,
    inverted_compass,
    kept,
    other_direction,
    other_quantity,
    stuck,
)
from simmer_tui.config.loader import find_set, load
from simmer_tui.report.finding import Basis, Device, Finding, FindingKind
from simmer_tui.sim import SensorSpec
from simmer_tui.sim.sensors import Sensor, modelled_sensor
from tests.report.test_differences import Bearing

SPEC = load(find_set("mission")).simulation


def sensor_of(code: str) -> Sensor:
    return modelled_sensor(next(each for each in SPEC.sensors if each.code == code))


@pytest.mark.parametrize(("headings", "found"), [((90.0,), 0), ((88.0, 92.0), 0), ((0.0, 90.0, 200.0), 1)])
def test_at_one_heading_no_sign_can_be_told_from_an_offset(headings: tuple[float, ...], found: int) -> None:
    base = np.array(headings * 12)
    sample = SensorSample(sensor_of("c1"), 300.0 - base, base, np.full(len(base), 5.0))
    assert len(list(inverted_compass(sample, base))) == found


def test_only_of_a_heading_the_direction_is_tested() -> None:
    base = np.array((0.0, 90.0, 200.0) * 12)
    bearing = Bearing(SensorSpec(kind=Bearing, number=1, code="b1", wrap=360.0))
    sample = SensorSample(bearing, 300.0 - base, base, np.full(len(base), 5.0))
    assert list(inverted_compass(sample, base)) == []


def test_a_compass_that_is_half_a_turn_off_is_not_said_to_have_the_wrong_sign() -> None:
    rng = np.random.default_rng(1)
    # A robot that drives to and fro along one way.
    headings = np.tile((90.0, 270.0), 25) + rng.normal(0.0, 2.0, 50)
    values = (headings + 180.0 + rng.normal(0.0, 0.2, 50)) % 360.0
    sample = SensorSample(sensor_of("c1"), values, headings, np.full(50, 0.5))
    assert list(inverted_compass(sample, headings)) == []


def test_a_constant_value_is_stuck_only_where_others_were_expected() -> None:
    for moved, told in ((0.0, False), (20.0, True)):
        expected = 10.0 + moved * np.linspace(0.0, 1.0, 30)
        sample = SensorSample(sensor_of("u1"), np.full(30, 10.0), expected, np.full(30, 0.2))
        claim = other_quantity(Device("u1", "reading"), sample.against(stuck(sample)))
        assert (claim.finding is not None) is told
        if claim.finding is not None:
            assert claim.finding.text.startswith("u1 always reads 10 in (")


@pytest.mark.parametrize(
    ("way", "kind", "other"),
    [
        ((1.0, 0.0, 0.0), None, None),
        ((-1.0, 0.0, 0.0), FindingKind.SIGN, None),
        ((0.0, 1.0, 0.0), FindingKind.SWAPPED, "w1"),
        ((0.0, 0.0, 0.0), FindingKind.STUCK, None),
    ],
)
def test_a_drive_that_moves_elsewhere_is_named(
    way: tuple[float, float, float], kind: FindingKind | None, other: str | None
) -> None:
    asked = np.array((3.0, 4.0, -2.0, 5.0))
    row = next(each for each in SPEC.drives if each.code == "d1")
    device = Device("d1", "movement")
    found = other_direction(device, row, asked, asked[:, None] * np.array(way), SPEC.drives).finding
    assert (None if found is None else (found.kind, found.other)) == (None if kind is None else (kind, other))


def test_findings_together_hold_the_error() -> None:
    def made(probability: float) -> Claim:
        found = Finding("u1", FindingKind.GAIN, 2.0, 1.9, 2.1, "", 9, Basis.SET, str(probability))
        return Claim(probability, found)

    # Holm: 0.001 times four, 0.003 times three, and then 0.006 times two is more than a hundredth.
    tests = [made(0.006), made(0.001), made(0.003), Claim(0.5)]
    assert [each.text for each in kept(tests)] == ["0.001", "0.003"]
