"""Effects on readings that know time or motion: this file adds one, and every sensor has it."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_sets
from simmer_tui.sim import SensorSpec, SimulationSpec, Simulator, reading_effects
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.reading_effects import Moments, ReadingEffect

STRETCH, GROWTH = 0.05, 2.0


def stretched(sensor: SensorSpec, true: FloatArray, moments: Moments) -> FloatArray:
    """Ranges that are longer by a share for each inch a second, and by some inches a second of time."""
    if not sensor.kind.is_range:
        return true
    return true * (1.0 + STRETCH * moments.speeds) + GROWTH * moments.times


def made(spec: SimulationSpec) -> ReadingEffect | None:
    return stretched if spec.num_segments == 7 else None


@pytest.fixture
def spec(monkeypatch: pytest.MonkeyPatch) -> SimulationSpec:
    """The set with a lidar, exact, in whose world the effect is."""
    monkeypatch.setattr(reading_effects, "EFFECTS", (made,))
    found = load(bundled_sets()["lidar"]).simulation
    exact = {"resolution": 0.0, "min_range": 0.0, "max_range": np.inf}
    sensors = tuple(replace(each, **exact) if each.kind.is_range else each for each in found.sensors)
    return replace(found, sensors=sensors, num_segments=7, bot_center=(30.0, 42.0))


def driving(spec: SimulationSpec) -> Simulator:
    """A robot at 3 in/s that has driven on a whole turn of its lidar."""
    simulator = Simulator(spec, 1)
    simulator.noise = False
    simulator.begin("vv-3;0;0")
    simulator.advance(2.0)
    return simulator


def test_a_range_and_all_rays_of_a_lidar_have_the_effect_of_their_moment(spec: SimulationSpec) -> None:
    simulator = driving(spec)
    assert simulator.leg is not None
    speed = np.hypot(*simulator.leg.arc.velocity)
    ranging = next(code for code in simulator.ranging_codes() if not simulator.sensor(code).kind.is_scan)
    reading = simulator.begin(ranging).reading
    assert reading is not None
    assert reading.value == pytest.approx(reading.true * (1.0 + STRETCH * speed) + GROWTH * 2.0)
    assert simulator.plain_reading(ranging) == reading.value
    assert simulator.steady_seconds(ranging) == 0.0
    code = next(each for each in simulator.ranging_codes() if simulator.sensor(each).kind.is_scan)
    reading = simulator.begin(code).reading
    assert reading is not None
    assert reading.scan is not None
    scan, (lidar,) = reading.scan, simulator._lidars
    times = lidar.moments(scan.revolution)
    assert scan.ranges == pytest.approx(scan.true * (1.0 + STRETCH * speed) + GROWTH * times)


def test_a_sensor_that_is_not_concerned_and_a_set_without_the_effect_read_as_ever(
    spec: SimulationSpec,
) -> None:
    simulator = driving(spec)
    others = [each.code for each in spec.sensors if each.enabled and not each.kind.is_range]
    for code in others:
        reading = simulator.begin(code).reading
        assert reading is not None
        assert simulator.plain_reading(code) == reading.value
    plain = driving(replace(spec, num_segments=8))
    for code in plain.ranging_codes():
        reading = plain.begin(code).reading
        assert reading is not None
        assert reading.value == pytest.approx(reading.true)
