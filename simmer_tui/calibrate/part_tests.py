"""Tests of a real robot's parts: whether a sensor is stuck, turned or swapped, or a drive turned or swapped.

A real robot has no truth. The readings of a sensor are compared with those expected on a fitted path, and
with those that it would give with each fault. Each reading on which the two differ votes for the nearer one.
The number of votes has a binomial distribution, whatever the noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from operator import itemgetter

import numpy as np
from msgspec import Struct
from msgspec.structs import astuple, replace
from scipy.special import bdtrc

from simmer_tui.report.finding import FEWEST, Device, Finding, FindingKind
from simmer_tui.report.robust_statistics import median_of
from simmer_tui.report.sensor_differences import least_error
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.sensors import Sensor
from simmer_tui.sim.specs import DriveSpec

# A person looks at a suspicion once, before the calibration is used: one missed costs more than in a report.
_ERROR = 0.01
"""Probability that a robot without a fault has any suspicion."""
# Judged: a fault explains the readings if no more than a fifth of them do not fit.
_EXPLAINED = 0.8
_ONE_HEADING = 0.97
"""Length of the mean direction of headings that are one: they scatter by less than 14 deg. Judged."""
# Judged: with half of a command on its own axis a drive neither moves along it nor along another.
_OTHER_AXIS = 0.5
_STOOD = 0.05
"""Inches and degrees below which no movement moved the robot."""


class Claim(Struct, frozen=True):
    """One test: its p-value, and its finding if the fault explains the evidence."""

    probability: float
    finding: Finding | None = None


class Alternative(Struct, frozen=True):
    """Values that a sensor with a fault would give: `expected`, (n,), in its unit."""

    kind: FindingKind
    expected: FloatArray
    value: float = 1.0
    other: str | None = None


class SensorSample(Struct, frozen=True):
    """Readings of one sensor, or its counts between them: values, expected values and standard deviations,
    (n,) each, in its unit, and the faults that they are compared with."""

    sensor: Sensor
    values: FloatArray
    expected: FloatArray
    spread: FloatArray
    alternatives: tuple[Alternative, ...] = ()

    @property
    def tolerance(self) -> FloatArray:
        """Errors up to which a reading still agrees with a value: half of the least error that matters, and
        four standard deviations, (n,). One normal error in 16,000 is beyond them."""
        return least_error(self.sensor) / 2 + 4 * self.spread

    def against(self, faults: Iterable[Alternative]) -> SensorSample:
        """The same with the faults that it is compared with."""
        return replace(self, alternatives=tuple(faults))

    def off(self, expected: FloatArray) -> FloatArray:
        """Values less expected ones, (n,)."""
        return self.sensor.wrapped(self.values - expected)


def kept(tests: Iterable[Claim]) -> tuple[Finding, ...]:
    """The findings of all tests that hold an error of 1 % together, the surest first: S. Holm, "A simple
    sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6 (1979)."""
    ranked, found = sorted(tests, key=lambda each: each.probability), []
    for place, each in enumerate(ranked):
        if each.probability * (len(ranked) - place) > _ERROR:
            break
        if each.finding is not None:
            found.append(each.finding)
    return tuple(found)


def other_quantity(device: Device, sample: SensorSample) -> Claim:
    """The claim of the alternative that explains the sample best: stuck, turned or swapped."""
    explaining: list[tuple[float, Alternative, int]] = []
    least = 1.0
    for each in sample.alternatives:
        hits, count, explained = _held_against(sample, each)
        # Bonferroni: as many faults were tried.
        probability = min(float(bdtrc(hits - 1, count, 0.5)) * len(sample.alternatives), 1.0)
        least = min(least, probability)
        if count >= FEWEST["set"] and explained >= _EXPLAINED:
            explaining.append((explained, each, count))
    if not explaining:
        return Claim(least)
    (_, fault, count), spec = max(explaining, key=itemgetter(0)), sample.sensor.spec
    unit = spec.unit if fault.kind is FindingKind.STUCK else ""
    stuck = "counts nothing" if spec.kind.counts else f"always reads {fault.value:.3g} {spec.unit}".rstrip()
    what = {FindingKind.STUCK: stuck, FindingKind.SIGN: "reads with the wrong sign"}.get(
        fault.kind, f"reads what {fault.other} should read"
    )
    return Claim(least, device.finding(fault.kind, fault.value, what, count, unit=unit, other=fault.other))


def _held_against(sample: SensorSample, other: Alternative) -> tuple[int, int, float]:
    """Number of readings nearer to the other expectation, number on which the two differ, and the share of
    all that the other explains."""
    known = np.isfinite(other.expected)
    expected = np.where(known, other.expected, sample.expected)
    off, otherwise = np.abs(sample.off(sample.expected)), np.abs(sample.off(expected))
    apart = np.abs(sample.sensor.wrapped(expected - sample.expected)) > sample.tolerance
    count = int(apart.sum())
    if not count:
        return 0, 0, 0.0
    near = otherwise <= sample.tolerance
    return int((otherwise < off)[apart].sum()), count, float(min(near[known].mean(), near[apart].mean()))


def stuck(sample: SensorSample) -> Iterator[Alternative]:
    """A constant value, where the expected ones varied by more than their noise."""
    if not len(sample.values):
        return
    ordered = np.sort(sample.expected)
    low, high = (float(ordered[round(share * (len(ordered) - 1))]) for share in (0.1, 0.9))
    middle = median_of(sample.values)
    if high - low > 2 * least_error(sample.sensor) + 4 * median_of(sample.spread):
        yield Alternative(FindingKind.STUCK, np.full(len(sample.values), middle), middle)


def inverted_compass(sample: SensorSample, base: FloatArray) -> Iterator[Alternative]:
    """A compass that counts in the other direction, from any zero."""
    spec, period = sample.sensor.spec, sample.sensor.period
    if not spec.kind.is_heading or not len(base):
        return
    turn = 2j * np.pi / period
    mirrored = np.exp(turn * (sample.values + spec.gain * base)).mean()
    offset = np.exp(turn * (sample.values - spec.gain * base)).mean()
    # At one heading, or two opposite ones, any zero fits, and an offset explains as much.
    headings = np.exp(turn * spec.gain * base)
    if abs(headings.mean()) > _ONE_HEADING or abs(offset) >= abs(mirrored):
        return
    zero = np.angle(mirrored) / (2 * np.pi) * period
    yield Alternative(FindingKind.SIGN, zero - spec.gain * base, -1.0)


def other_direction(
    device: Device, row: DriveSpec, asked: FloatArray, done: FloatArray, others: Iterable[DriveSpec]
) -> Claim:
    """The claim that a drive moves as one of the `others` should, or the other way round, or not at all.

    Args:
        asked: Values of its commands after its Gain, (n,).
        done: Displacement by each in the robot's frame, inches and degrees, (n, 3).
    """
    direction = np.array(astuple(row.kind.direction))
    along = done @ direction / asked
    # Movements of which less than half is done on their axis: without a fault hardly one in a hundred.
    off_axis = int((along < _OTHER_AXIS).sum())
    probability = float(bdtrc(off_axis - 1, len(asked), 0.01))
    typical, count = median_of(along), len(asked)
    if typical >= _OTHER_AXIS:
        return Claim(probability)
    # The other drive that would have led there by the same command.
    for each in others:
        if each.code != row.code and each.enabled and each.kind.turns == row.kind.turns:
            way = np.array(astuple(each.kind.direction))
            if median_of(done @ way / asked) >= _OTHER_AXIS and float(direction @ way) != -1.0:
                what = f"does what {each.code} should do"
                found = device.finding(FindingKind.SWAPPED, 1.0, what, count, other=each.code)
                return Claim(probability, found)
    if typical <= -_OTHER_AXIS:
        what = f"{row.kind.verb} the wrong way"
        return Claim(probability, device.finding(FindingKind.SIGN, -1.0, what, count))
    if float(np.abs(done).max()) < _STOOD:
        what = "does not move the robot"
        return Claim(probability, device.finding(FindingKind.STUCK, 0.0, what, count))
    return Claim(probability)
