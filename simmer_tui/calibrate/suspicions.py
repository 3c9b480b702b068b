"""Faults that a fit hides: before a set is written, sensors and drives are compared with the fitted path.

The true path of a real robot is not known. But the fitted path depends on all sensors and drives together,
and one that is swapped, turned or stuck has little weight in it. The fit treats its readings as outliers, or
gives it a bias of -2. So each is compared with that path under every such fault, as in a report.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from simmer_tui.calibrate.find_path import is_known_to
from simmer_tui.calibrate.fit import Fit
from simmer_tui.calibrate.geometry import totals_between
from simmer_tui.calibrate.measured_run import MeasuredRun, Readings
from simmer_tui.calibrate.parameters import observed_sensors
from simmer_tui.calibrate.part_tests import (
    Alternative,
    Claim,
    SensorSample,
    inverted_compass,
    kept,
    other_direction,
    other_quantity,
    stuck,
)
from simmer_tui.report.finding import FEWEST, Device, Finding, FindingKind
from simmer_tui.report.sensor_differences import least_error
from simmer_tui.sim.arrays import BoolArray, FloatArray
from simmer_tui.sim.sensors import CountingSensor, ObservingSensor, ParameterKind, Sensor

# Judged: unknown gains, biases and mounting have an effect of an inch in a foot, and of 10 degrees.
_UNKNOWN = {"in": 1.0, "deg": 10.0}
"""Standard deviations of readings against the set's own figures, inches and degrees. In other units it is the
prior of the kind's bias, else what a report says matters."""
# A movement in the opposite direction has a probability of 0.01 by chance: four have one in a hundred
# million.
_FEWEST_MOVEMENTS = 4
# A movement that a wall blocked shows nothing about its drive.
_MOVED = 0.5
"""Share of the commanded distance from which a movement counts as made."""


def suspicions(found: Fit) -> tuple[Finding, ...]:
    """Sensors and drives that are swapped, turned or stuck by the fitted path, with an error rate of 1 %."""
    before, law = found.model.before, found.model.law
    totals = np.zeros((len(found.poses), 3))
    totals[before + 1] = totals_between(found.poses[before], found.poses[before + 1], *law)

    return kept([*_claims(found.run, totals, found), *_drives(found, totals[before + 1])])


def suspicions_without_path(run: MeasuredRun) -> tuple[Finding, ...]:
    """The same if no path was found: counting sensors, compared with the commanded movements."""
    totals = np.zeros((run.stops, 3))
    totals[run.stops_before_movements() + 1] = [each.asked(run.spec.drives) for each in run.movements]
    return kept([*_claims(run, totals)])


def _claims(run: MeasuredRun, totals: FloatArray, found: Fit | None = None) -> Iterator[Claim]:
    """Claims on sensors that were read often enough, from their samples and those of other sensors with the
    same unit. Without a path, on those that count; `totals` as in `_counted`."""
    sensors = observed_sensors(run.spec).values()
    for sensor in sensors:
        readings = run.readings.get(sensor.spec.code)
        if readings is None:
            continue
        alike = [each for each in sensors if each is not sensor and each.spec.unit == sensor.spec.unit]
        match sensor:
            case CountingSensor():
                sample = _counted(run, sensor, readings, alike, totals)
            case ObservingSensor() if found is not None:
                sample = _observed(found, sensor, readings, alike)
            case _:
                continue
        if len(sample.values) >= FEWEST["set"]:
            yield other_quantity(Device(sensor.spec.code, "reading"), sample)


def _observed(
    found: Fit, sensor: ObservingSensor, readings: Readings, alike: Sequence[Sensor]
) -> SensorSample:
    """Readings of a sensor with their expected values on the fitted path."""
    spec, world = sensor.spec, found.model.world
    poses = found.poses[readings.stops]
    expected = sensor.expected(world, poses, 0.0)
    spread = np.hypot(spec.error * np.abs(expected), _unknown(sensor))
    usable = np.isfinite(readings.values) & sensor.within_limits(expected, spread)
    usable &= is_known_to(found.run, sensor, readings.stops)
    sample = SensorSample(sensor, readings.values[usable], expected[usable], spread[usable])
    base = expected[usable] / (spec.gain or 1.0)  # with its bias, since a compass counts from any zero
    others = [
        Alternative(FindingKind.SWAPPED, each.expected(world, poses[usable], 0.0), 1.0, each.spec.code)
        for each in alike
        if isinstance(each, ObservingSensor) and each.spec.kind.is_range == spec.kind.is_range
    ]
    return sample.against([*stuck(sample), *inverted_compass(sample, base), *others])


def _unknown(sensor: Sensor) -> float:
    """Standard deviation of readings against the set's own figures, in the sensor's unit."""
    biases = (prior.spread for prior in sensor.parameters if prior.kind is ParameterKind.BIAS)
    return _UNKNOWN.get(sensor.spec.unit) or max(biases, default=least_error(sensor))


def _counted(
    run: MeasuredRun,
    sensor: CountingSensor,
    readings: Readings,
    alike: Sequence[Sensor],
    totals: FloatArray,
) -> SensorSample:
    """Increments of a counter between readings, with their expected values; `totals` are the motion from the
    previous stop to each stop, (stops, 3). Movements with a contact are included, because a fit assumes
    contacts where a wrong counter contradicts the path."""
    stops = readings.stops
    done = np.cumsum(totals, axis=0)[stops]
    usable: BoolArray = np.diff(run.chains_of(stops)) == 0
    driven: FloatArray = np.diff(done, axis=0)[usable]
    seconds = np.diff(readings.times)[usable]
    row = sensor.spec
    drift = row.drift * seconds
    values = sensor.wrapped(np.diff(readings.values))[usable]
    expected = row.gain * driven @ sensor.lever + drift
    # Its gain is uncertain by a tenth, and the path by a fraction of that.
    spread = np.hypot(0.1 * np.abs(expected), _unknown(sensor) / 4)
    sample = SensorSample(sensor, values, expected, spread)
    others = [
        Alternative(FindingKind.SWAPPED, row.gain * driven @ each.lever, 1.0, each.spec.code)
        for each in alike
        if isinstance(each, CountingSensor)
    ]
    still = Alternative(FindingKind.STUCK, np.zeros(len(values)), 0.0)
    mirrored = Alternative(FindingKind.SIGN, 2 * drift - expected, -1.0)
    return sample.against([still, mirrored, *others])


def _drives(found: Fit, done: FloatArray) -> Iterator[Claim]:
    """Claims on drives, from the totals of their movements on the fitted path, (movements, 3)."""
    run = found.run
    asked = np.array([each.value for each in run.movements])
    # A stretch of continuous motion does not belong to a single drive.
    number = np.array([-1 if each.is_continuous else each.drive for each in run.movements])
    # Values are times Gain already.
    for index, row in enumerate(run.spec.drives):
        travelled = np.abs(done[:, 2]) if row.kind.turns else np.hypot(done[:, 0], done[:, 1])
        made = (number == index) & (asked != 0.0) & (travelled > _MOVED * np.abs(asked))
        if int(made.sum()) >= _FEWEST_MOVEMENTS:
            device = Device(row.code, "movement")
            yield other_direction(device, row, asked[made], done[made], run.spec.drives)
