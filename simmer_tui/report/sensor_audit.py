"""Sensors against the truth: the fault that explains the readings of one, if any does.

First come faults that change the measured quantity: stuck, inverted sign, swapped with another, late. Each is
compared with no fault on the readings where the two differ: each reading votes for the nearer one. The number
of votes has a binomial distribution, whatever the noise. If no such fault explains the readings, an offset
and a gain are fitted.
"""

from __future__ import annotations

import math
from operator import itemgetter

import numpy as np

from simmer_tui.report.finding import FEWEST, LEAST_SHARE, Claim, DeviceUnderTest, FindingKind
from simmer_tui.report.robust_fit import (
    Z_95,
    RobustFit,
    binomial_tail,
    excess_noise,
    mad_scale,
    median_of,
    quantiles,
    robust_fit,
)
from simmer_tui.report.sensor_sample import Alternative, SensorSample
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.command import counted
from simmer_tui.sim.specs import SensorSpec

# Judged: a fault explains the readings if no more than a fifth of them do not fit.
_EXPLAINED = 0.8
# Where a set declares no dropouts, one in a thousand may come from rounding at a limit.
_MISSED = 0.001
# Judged: the residuals of a fit with one coefficient more must be smaller by a tenth.
_BETTER = 1.1
_ONE_VALUE = 0.1
"""Share of the expected value, or least error, within which eight values in ten are one: there a gain and an
offset are the same. Judged."""


def sensor_tests(device: DeviceUnderTest, sample: SensorSample) -> list[Claim]:
    """Tests of one sensor by its readings."""
    tests = [_missed(device, sample)] if sample.looked >= FEWEST["set"] else []
    if len(sample.values) < FEWEST[device.basis]:
        return tests
    changed = other_quantity(device, sample)
    tests.append(changed)
    if changed.finding is not None:
        return tests
    if sample.least == 0.5 and sample.spec.is_yes_or_no:
        return [*tests, _wrong(device, sample)]
    inside = sample.inside()
    return [*tests, *_fitted(device, inside)] if len(inside.values) >= FEWEST[device.basis] else tests


# -- another quantity --------------------------------------------------------------------------------


def other_quantity(device: DeviceUnderTest, sample: SensorSample) -> Claim:
    """The claim of the alternative that explains the sample best: stuck, turned, swapped or late."""
    explaining: list[tuple[float, Alternative, int]] = []
    least = 1.0
    for each in sample.alternatives:
        hits, count, explained = _held_against(sample, each)
        # Bonferroni: as many faults were tried.
        probability = min(binomial_tail(hits, count, sample.chance) * len(sample.alternatives), 1.0)
        least = min(least, probability)
        if count >= FEWEST[device.basis] and explained >= _EXPLAINED:
            explaining.append((explained, each, count))
    if not explaining:
        return Claim(least)
    (_, fault, count), spec = max(explaining, key=itemgetter(0)), sample.spec
    # A counting sensor that is stuck adds nothing.
    value = 0.0 if fault.kind is FindingKind.STUCK and spec.kind.counts else fault.value
    unit = {FindingKind.STUCK: spec.unit, FindingKind.LATE: "readings"}.get(fault.kind, "")
    what = change_text(spec, fault.kind, value, fault.other)
    if (
        spec.is_yes_or_no
        and fault.kind is FindingKind.STUCK
        and (sample.expected == sample.expected[0]).all()
    ):
        # Nothing tells a sensor that is stuck from one that answers the opposite.
        held = " while the block was held" if spec.kind.detects_block and sample.expected[0] else ""
        what = f"read {value:g}{held}, in place of {sample.expected[0]:g}"
    return device.claim(least, fault.kind, value, what, count, unit=unit, other=fault.other)


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


def change_text(spec: SensorSpec, kind: FindingKind, value: float, other: str | None = None) -> str:
    """Words for a fault that changes the measured quantity: `reads what u2 should`.

    Args:
        value: The value at which it is stuck, in its unit, or the number of readings by which it is late.
        other: Code of the sensor that it is swapped with.
    """
    match kind:
        case FindingKind.STUCK:
            return "counts nothing" if spec.kind.counts else f"always reads {value:.3g} {spec.unit}".rstrip()
        case FindingKind.SIGN:
            return "answers the opposite" if spec.is_yes_or_no else "reads with the wrong sign"
        case FindingKind.SWAPPED:
            return f"reads what {other} should read"
        case _:
            return f"is late by {counted(int(value), 'reading')}"


# -- shares ------------------------------------------------------------------------------------------


def _missed(device: DeviceUnderTest, sample: SensorSample) -> Claim:
    """The claim of too many dropouts: readings of nothing where something was in range."""
    declared = max(sample.spec.dropout, _MISSED)
    return _share(device, sample.missed, sample.looked, declared, FindingKind.MISSED, "misses")


def _wrong(device: DeviceUnderTest, sample: SensorSample) -> Claim:
    """The claim of too many wrong answers of a binary sensor."""
    wrong = int((sample.values != sample.expected).sum())
    return _share(device, wrong, len(sample.values), sample.chance, FindingKind.NOISE, "is wrong in")


def _share(
    device: DeviceUnderTest, hits: int, count: int, declared: float, kind: FindingKind, verb: str
) -> Claim:
    probability, share = binomial_tail(hits, count, declared), hits / count
    half = Z_95 * math.sqrt(share * (1.0 - share) / count)
    low, high = max(share - half, 0.0), min(share + half, 1.0)
    # A share of few has no median: an interval down to the declared one claims nothing.
    if share - declared < LEAST_SHARE or low <= declared:
        return Claim(probability)
    what, bounds = f"{verb} {100 * share:.0f} % of its readings", f"{100 * low:.0f} % to {100 * high:.0f} %"
    return device.claim(probability, kind, share, what, count, interval=(low, high), bounds=bounds)


# -- offset, gain, drift, noise ----------------------------------------------------------------------


def _fitted(device: DeviceUnderTest, sample: SensorSample) -> list[Claim]:
    """Claims of the simplest model that explains the residuals (no parameter, one, two), and of the remaining
    noise."""
    residuals, period = sample.off(sample.expected), sample.sensor.period
    if period:
        # Half a turn off is one error, not two of both signs.
        middle = np.angle(np.exp(2j * np.pi * residuals / period).mean()) / (2 * np.pi) * period
        residuals = middle + sample.sensor.wrapped(residuals - middle)
    counts = sample.spec.kind.counts
    columns = {
        FindingKind.GAIN: sample.expected,
        (FindingKind.DRIFT if counts else FindingKind.OFFSET): (
            sample.seconds if counts else np.ones(len(residuals))
        ),
    }
    low, middle, high = quantiles(sample.expected, (0.1, 0.5, 0.9))
    if not counts and high - low <= max(_ONE_VALUE * abs(middle), sample.least):
        del columns[FindingKind.GAIN]
    singles, double = [(kind,) for kind in columns], tuple(columns)
    fits = {
        kinds: robust_fit(np.column_stack([columns[each] for each in kinds]), residuals, sample.spread)
        for kinds in (*singles, double)
    }
    single = min(singles, key=lambda kinds: fits[kinds].rough)
    kinds = single if fits[single].rough <= _BETTER * fits[double].rough else double
    fit, design = fits[kinds], np.column_stack([columns[each] for each in kinds])
    tests = [_figure(device, sample, kind, fit, place) for place, kind in enumerate(kinds)]
    return [*tests, _noise(device, sample, residuals - design @ fit.values)]


def _figure(
    device: DeviceUnderTest, sample: SensorSample, kind: FindingKind, fit: RobustFit, place: int
) -> Claim:
    if kind is FindingKind.GAIN:
        return device.gain(fit, place, "reads", "what it should")
    spec = sample.spec
    value, probability = float(fit.values[place]), fit.probability(place)
    low, high = fit.interval(place)
    if kind is FindingKind.DRIFT:
        # The largest error that the drift leads to.
        unit, error = f"{spec.unit}/s", abs(value) * float(sample.seconds.sum())
        what = f"drifts by {abs(value):.2f} {unit}"
    else:
        # Rounding errors of readings at one place are all the same: more of them make none smaller.
        low, high = low - spec.resolution / 2, high + spec.resolution / 2
        unit, error = spec.unit, abs(value)
        what = f"reads {abs(value):.1f} {unit} {_too(value, sample)}"
    if error < sample.least or low <= 0.0 <= high:
        return Claim(probability)
    return device.claim(probability, kind, value, what, fit.count, interval=(low, high), unit=unit)


def _noise(device: DeviceUnderTest, sample: SensorSample, residuals: FloatArray) -> Claim:
    """Residuals that scatter by more than the set says."""
    unit, count = sample.spec.unit, len(residuals)
    ratio, declared = mad_scale(residuals / sample.spread), median_of(sample.spread)
    probability, excess, interval = excess_noise(ratio, declared, count, 2)
    if excess < sample.least:
        return Claim(probability)
    scatter = ratio * declared
    what = f"scatters by {scatter:.1f} {unit}, not by {declared:.1f}"
    return device.claim(probability, FindingKind.NOISE, scatter, what, count, interval=interval, unit=unit)


def _too(value: float, sample: SensorSample) -> str:
    if sample.spec.kind.is_range:
        return "too long" if value > 0 else "too short"
    return "too high" if value > 0 else "too low"
