"""Drives against the truth: the displacement on each axis, beside the command.

A movement is compared as its drive began it: a wall that held the robot is not the drive's fault. The wheels
turned all the same. Movements that were cut short are left out. The others have on each axis the total a + d
B + d (1 + B) P e of docs/how-it-works.md. Over d it is the same for all movements of a drive, but for its
noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from msgspec import Struct
from msgspec.structs import astuple

from simmer_tui.report.finding import (
    FEWEST,
    LEAST_DEGREES,
    LEAST_INCHES,
    LEAST_SHARE,
    Claim,
    DeviceUnderTest,
    FindingKind,
)
from simmer_tui.report.robust_fit import (
    RobustFit,
    binomial_tail,
    excess_noise,
    median_of,
    quantiles,
    robust_fit,
)
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import Columns
from simmer_tui.sim.arrays import BoolArray, FloatArray
from simmer_tui.sim.specs import CELL_SIZE, Axes, DriveKind, DriveSpec

# The errors of a shorter movement are too small to measure: they are a share of it.
_SHORTEST = {"in": 0.05, "deg": 0.5}
"""Least command that counts, inches and degrees."""
# Rounding of the history's numbers, for drives without noise.
_LEAST_ERROR = 1e-4
# Judged: with half of a command on its own axis a drive neither moves along it nor along another.
_OTHER_AXIS = 0.5
# A bias of 2 degrees in a cell, or of an inch in a quarter turn, leads past the middle of the next cell.
_LEAST_BIAS = {
    ("in", "deg"): LEAST_DEGREES / CELL_SIZE,
    ("deg", "in"): LEAST_INCHES / 90.0,
    ("in", "in"): LEAST_SHARE,
    ("deg", "deg"): LEAST_SHARE,
}
"""Least bias that matters, by the units of the command and of the axis."""
_AXES = ("x", "y", "r")


class DriveRule(Struct, frozen=True):
    """Expected motion of a drive: its row, and the bias on each axis in each movement, (n, 3). Where the bias
    was drawn at random, it may differ from that by `allowed`, standard deviations, (3,)."""

    row: DriveSpec
    biases: FloatArray
    allowed: FloatArray

    def of(self, chosen: BoolArray) -> DriveRule:
        """The same for some of the movements."""
        return DriveRule(self.row, self.biases[chosen], self.allowed)


def set_rule(history: RunHistory, moves: Columns, row: DriveSpec) -> DriveRule:
    """Expected motion of a drive by the run's own set, with the bias that was in force each time."""
    states = list(history.biases.items)
    table = np.array([astuple(each.bias.get(row.kind, Axes())) for each in states])
    since = np.searchsorted([each.order for each in states], moves["order"], "right") - 1
    return DriveRule(row, table[np.maximum(since, 0)], np.zeros(3))


def drive_tests(
    device: DeviceUnderTest, moves: Columns, rule: DriveRule, others: Iterable[DriveSpec]
) -> list[Claim]:
    """Tests of one drive by its movements, and by the rows of the `others` that it may be swapped with."""
    row = rule.row
    usable = np.isfinite(moves["total_x"]) & (np.abs(moves["asked"]) >= _SHORTEST[row.kind.unit])
    usable &= row.gain != 0.0
    moves, rule = moves[usable], rule.of(usable)
    if len(moves) < FEWEST[device.basis]:
        return []
    asked = moves["asked"].astype(np.float64)
    done = np.column_stack([moves[f"total_{axis}"] for axis in _AXES]).astype(np.float64)
    claim = other_direction(device, row, asked, done, others)
    return [claim] if claim.finding is not None else [claim, *_axes(device, rule, asked, done)]


def other_direction(
    device: DeviceUnderTest,
    row: DriveSpec,
    asked: FloatArray,
    done: FloatArray,
    others: Iterable[DriveSpec],
) -> Claim:
    """The claim that a drive moves as one of the `others` should, or the other way round, or not at all.

    Args:
        asked: Values of its commands, (n,).
        done: Displacement by each in the robot's frame, inches and degrees, (n, 3).
    """
    direction = _direction(row.kind)
    along = done @ direction / (asked * row.gain)
    off = int((along < _OTHER_AXIS).sum())
    # Movements of which less than half is done on their axis: without a fault hardly one in a hundred.
    probability = binomial_tail(off, len(asked), 0.01)
    typical = median_of(along)
    if typical >= _OTHER_AXIS:
        return Claim(probability)
    count = len(asked)
    # The other drive that would have led there by the same command.
    for each in others:
        if each.code != row.code and each.enabled and each.kind.turns == row.kind.turns:
            as_other = done @ _direction(each.kind) / (asked * each.gain)
            opposite = float(direction @ _direction(each.kind)) == -1.0
            if median_of(as_other) >= _OTHER_AXIS and not opposite:
                what = f"does what {each.code} should do"
                return device.claim(probability, FindingKind.SWAPPED, 1.0, what, count, other=each.code)
    if typical <= -_OTHER_AXIS:
        return device.claim(probability, FindingKind.SIGN, -1.0, f"{row.kind.verb} the wrong way", count)
    if float(np.abs(done).max()) < _SHORTEST["in"]:
        return device.claim(probability, FindingKind.STUCK, 0.0, "does not move the robot", count)
    return Claim(probability)


def _axes(device: DeviceUnderTest, rule: DriveRule, asked: FloatArray, done: FloatArray) -> list[Claim]:
    """Gain and shortfall on the drive's own axis, biases on the others, and scatter."""
    row = rule.row
    direction = _direction(row.kind)
    own = int(np.flatnonzero(direction)[0])
    driven = asked * row.gain * direction.sum()
    tests: list[Claim] = []
    for axis, name in enumerate(_AXES):
        bias = rule.biases[:, axis]
        error = np.abs(1.0 + bias) * getattr(row.error, name) + _LEAST_ERROR
        noise = np.abs(driven) * error
        rest = done[:, axis] - driven * (bias + (axis == own))
        if axis == own:
            fit = _gain_fit(driven, rest, noise)
            gain = _allowing(fit, float(rule.allowed[axis]))
            tests.append(device.gain(gain, 0, row.kind.verb, "what is asked"))
            if len(fit.values) == 2:
                tests.append(_shortfall(device, row.kind, fit, median_of(np.abs(driven))))
        else:
            fit = robust_fit(driven[:, None], rest, noise)
            tests.append(_bias(device, row.kind.unit, name, _allowing(fit, float(rule.allowed[axis]))))
        tests.append(_scatter(device, row.kind.unit, name, fit, median_of(error)))
    return tests


def _gain_fit(driven: FloatArray, rest: FloatArray, noise: FloatArray) -> RobustFit:
    """Gain, and a shortfall that is the same for all movements, where their lengths separate the two."""
    single = robust_fit(driven[:, None], rest, noise)
    short, long = quantiles(np.abs(driven), (0.1, 0.9))
    if long <= 1.5 * short:
        return single
    both = robust_fit(np.column_stack((driven, np.sign(driven))), rest, noise)
    # Judged: the fit with a shortfall must be better by a tenth.
    return both if single.rough > 1.1 * both.rough else single


def _allowing(fit: RobustFit, allowed: float) -> RobustFit:
    """The first coefficient, its error enlarged by the standard deviation of the random bias."""
    error = math.hypot(float(fit.errors[0]), allowed)
    return RobustFit(fit.values[:1], np.array([error]), fit.rough, fit.count, fit.declared)


def _shortfall(device: DeviceUnderTest, kind: DriveKind, fit: RobustFit, usual: float) -> Claim:
    value, probability, unit = float(fit.values[1]), fit.probability(1), kind.unit
    # A fiftieth of a usual command, and a quarter of an inch or half a degree, are the errors that add up
    # soonest.
    if abs(value) < max(LEAST_SHARE * usual, 0.25 if unit == "in" else 0.5):
        return Claim(probability)
    what = f"{kind.verb} {abs(value):.2f} {unit} {'too little' if value < 0 else 'too much'} each time"
    return device.claim(
        probability, FindingKind.OFFSET, value, what, fit.count, interval=fit.interval(1), unit=unit
    )


def _bias(device: DeviceUnderTest, unit: str, axis: str, fit: RobustFit) -> Claim:
    """A bias across: inches or degrees on another axis for each `unit` asked."""
    other = "deg" if axis == "r" else "in"
    value, probability = float(fit.values[0]), fit.probability(0)
    if abs(value) < _LEAST_BIAS[unit, other]:
        return Claim(probability)
    low, high = fit.interval(0)
    side = {"r": ("left", "right"), "y": ("left", "right"), "x": ("front", "back")}[axis][value < 0]
    verb = "turns" if axis == "r" else "drifts"
    near, far = sorted((abs(low), abs(high)))
    what = f"{verb} {abs(value):.3f} {other} to the {side} for each {_one(unit)}"
    interval, bounds, per = (low, high), f"{near:.3f} to {far:.3f}", f"{other}/{unit}"
    return device.claim(
        probability, FindingKind.BIAS, value, what, fit.count, interval=interval, bounds=bounds, unit=per
    )


def _scatter(device: DeviceUnderTest, unit: str, axis: str, fit: RobustFit, declared: float) -> Claim:
    """Noise on an axis that the set does not declare."""
    other = "deg" if axis == "r" else "in"
    probability, excess, (low, high) = excess_noise(fit.rough, declared, fit.count, 1)
    if excess < _LEAST_BIAS[unit, other]:
        return Claim(probability)
    scatter = fit.rough * declared
    motion = "turn" if axis == "r" else "distance"
    what = f"scatters by {scatter:.3f} {other} of {motion} for each {_one(unit)}, not by {declared:.3f}"
    interval, bounds, per = (low, high), f"{low:.3f} to {high:.3f}", f"{other}/{unit}"
    return device.claim(
        probability, FindingKind.NOISE, scatter, what, fit.count, interval=interval, bounds=bounds, unit=per
    )


def _one(unit: str) -> str:
    return "inch" if unit == "in" else "degree"


def _direction(kind: DriveKind) -> FloatArray:
    return np.array(astuple(kind.direction))
