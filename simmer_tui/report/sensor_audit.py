"""Sensors against the truth: each one's readings beside what an ideal sensor at that place would say.

The log has the true value of each reading. What a row of sensors.csv makes of it without random errors is
expected; the readings less that are fitted by an offset and a gain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simmer_tui.report.finding import (
    FEWEST,
    LEAST_DEGREES,
    LEAST_INCHES,
    LEAST_SHARE,
    Basis,
    Finding,
    FindingKind,
    Tested,
)
from simmer_tui.report.robust_fit import RobustFit, robust_fit
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import Columns
from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.sensors import ObservingSensor, Sensor, sensor_of
from simmer_tui.sim.specs import SensorSpec

MOST = 4000
"""Readings of one sensor that are compared, evenly chosen: its interval is then a fiftieth of its noise."""
# Of normal errors one in 1.7 million lies beyond five standard deviations: what a limit cuts off is then
# nothing that the rest would be biased by.
_CLEAR = 5.0
_Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class SensorSample:
    """Readings of one sensor that are far enough from its limits: values, expected values, and their
    declared standard deviations, (n,) each, in its unit."""

    sensor: Sensor
    values: FloatArray
    expected: FloatArray
    spread: FloatArray

    @property
    def residuals(self) -> FloatArray:
        """Values less the expected ones, (n,)."""
        return self.sensor.wrapped(self.values - self.expected)


def sensor_tests(history: RunHistory, rows: Columns, spec: SensorSpec, basis: Basis) -> list[Tested]:
    """Tests of one sensor, by its readings and the row of a set that says how it should read."""
    sensor = sensor_of(spec)
    if not isinstance(sensor, ObservingSensor) or spec.is_yes_or_no:
        return []
    sample = observed_sample(history, rows, sensor)
    if len(sample.values) < FEWEST:
        return []
    return _offset_and_gain(sample, basis)


def observed_sample(history: RunHistory, rows: Columns, sensor: Sensor) -> SensorSample:
    """The readings of a sensor beside what it should have said, those near its limits left out."""
    step = max(1, -(-len(rows) // MOST))
    values = rows["value"][::step].astype(np.float64)
    true = rows["true"][::step].astype(np.float64)
    # A restart sets simulated time to 0; drift that is declared goes on with it.
    times = rows["taken"][::step] - history.clock.before
    known = np.isfinite(true)
    values, true, times = values[known], true[known], times[known]
    spec = sensor.spec
    base = np.array([sensor.proportional(each, None) for each in true.tolist()])
    expected = spec.gain * base + spec.bias + spec.drift * times
    spread = np.sqrt(
        (spec.gain * spec.error * true) ** 2
        + spec.absolute_error**2
        + spec.resolution**2 / 12.0
        + sensor.least_error**2
    )
    usable = np.isfinite(values) & _within_limits(sensor, expected, _CLEAR * spread)
    return SensorSample(sensor, values[usable], expected[usable], spread[usable])


def _within_limits(sensor: Sensor, expected: FloatArray, margin: FloatArray) -> _Flags:
    if isinstance(sensor, ObservingSensor):
        return sensor.within_limits(expected, margin)
    return np.ones(len(expected), bool)


def _offset_and_gain(sample: SensorSample, basis: Basis) -> list[Tested]:
    """The simplest of these that explains the residuals: an offset, a gain, both."""
    residuals, ones = sample.residuals, np.ones(len(sample.values))
    # Around the middle, offset and gain are told apart as well as the readings allow.
    by_offset = robust_fit(ones[:, None], residuals, sample.spread)
    by_gain = robust_fit(sample.expected[:, None], residuals, sample.spread)
    both = robust_fit(np.column_stack((ones, sample.expected)), residuals, sample.spread)
    # Two tests of one sensor, whichever of the three fits they are read off.
    tests: list[Tested] = []
    if min(both.probability(0), both.probability(1)) == 1.0:
        return [Tested(1.0)]
    if by_offset.scale <= by_gain.scale and by_offset.scale <= 1.1 * both.scale:
        tests.append(_offset(sample, by_offset, 0, basis))
    elif by_gain.scale <= 1.1 * both.scale:
        tests.append(_gain(sample, by_gain, 0, basis))
    else:
        tests += [_offset(sample, both, 0, basis), _gain(sample, both, 1, basis)]
    return tests


def _offset(sample: SensorSample, fit: RobustFit, place: int, basis: Basis) -> Tested:
    spec, value = sample.sensor.spec, float(fit.values[place])
    low, high = fit.interval(place)
    # Rounding errors of readings at one place are all the same: more readings do not make them smaller.
    low, high = low - spec.resolution / 2, high + spec.resolution / 2
    if abs(value) < (LEAST_DEGREES if spec.unit == "deg" else LEAST_INCHES) or low <= 0.0 <= high:
        return Tested(fit.probability(place))
    near, far = sorted((abs(low), abs(high)))
    size = _range(abs(value), near, far, spec.unit)
    text = f"{spec.code} reads {size[0]} {_too(value, spec)} ({size[1]}, {fit.count} readings)"
    return Tested(
        fit.probability(place),
        Finding(spec.code, FindingKind.OFFSET, value, low, high, spec.unit, fit.count, basis, text),
    )


def _gain(sample: SensorSample, fit: RobustFit, place: int, basis: Basis) -> Tested:
    spec, value = sample.sensor.spec, 1.0 + float(fit.values[place])
    low, high = (1.0 + each for each in fit.interval(place))
    if abs(value - 1.0) < LEAST_SHARE:
        return Tested(fit.probability(place))
    of = f"{low:.2f} to {high:.2f}, {fit.count} readings"
    text = f"{spec.code} reads {value:.2f} times what it should ({of})"
    return Tested(
        fit.probability(place),
        Finding(spec.code, FindingKind.GAIN, value, low, high, "", fit.count, basis, text),
    )


def _too(value: float, spec: SensorSpec) -> str:
    if spec.kind.is_range:
        return "too long" if value > 0 else "too short"
    return "too high" if value > 0 else "too low"


def _range(value: float, low: float, high: float, unit: str) -> tuple[str, str]:
    """A figure with its unit, and its interval."""
    digits = 1 if math.isfinite(high - low) and high - low >= 0.02 else 2
    return f"{value:.{digits}f} {unit}".rstrip(), f"{low:.{digits}f} to {high:.{digits}f}"
