"""Differences of a drive from its row of another set, and their effect on its movements in a run.

A movement is compared as its drive began it: a wall that held the robot is not the drive's fault. The wheels
turned all the same. Movements that were cut short are left out. The others have on each axis the total a + d
B + d (1 + B) P e of docs/how-it-works.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from msgspec.structs import astuple

from simmer_tui.report.finding import (
    LEAST_DEGREES,
    LEAST_INCHES,
    LEAST_SHARE,
    Device,
    Finding,
    FindingKind,
)
from simmer_tui.report.robust_fit import MAD_ERROR, Z_95, mad_scale, measured, median_of
from simmer_tui.report.sensor_differences import NOISIER
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import Columns
from simmer_tui.sim.noise import bias_spread
from simmer_tui.sim.specs import CELL_SIZE, Axes, DriveSpec, SimulationSpec

# The errors of a shorter movement are too small to measure: they are a share of it.
_SHORTEST = {"in": 0.05, "deg": 0.5}
"""Least command that counts, inches and degrees."""
# Rounding of the history's numbers, for drives without noise.
_LEAST_NOISE = 1e-4
# A bias of 2 degrees in a cell, or of an inch in a quarter turn, leads past the middle of the next cell.
_LEAST_BIAS = {
    ("in", "deg"): LEAST_DEGREES / CELL_SIZE,
    ("deg", "in"): LEAST_INCHES / 90.0,
    ("in", "in"): LEAST_SHARE,
    ("deg", "deg"): LEAST_SHARE,
}
"""Least bias that matters, by the units of the command and of the axis."""
# A normal number is beyond twice its standard deviation once in 20.
_UNUSUAL = 2.0
# A turn leads further away than the rest, so it is told first.
_AXES = ("r", "x", "y")
_SIDES = {"r": ("left", "right"), "y": ("left", "right"), "x": ("front", "back")}


def drive_differences(
    history: RunHistory,
    own: DriveSpec,
    row: DriveSpec,
    moves: Columns,
    reference: SimulationSpec,
    device: Device,
) -> Iterator[Finding]:
    """The differences of a drive with some movements: of its kind or direction, else on each axis."""
    count = len(moves)
    if own.kind is not row.kind:
        other = next((each.code for each in reference.drives if each.kind is own.kind), None)
        what = "moves like no drive of that set" if other is None else f"does what {other} should do"
        yield device.finding(FindingKind.SWAPPED, 1.0, what, count, other=other)
    elif own.gain == 0.0 != row.gain:
        yield device.finding(FindingKind.STUCK, 0.0, "does not move the robot", count)
    elif own.gain * row.gain < 0.0:
        yield device.finding(FindingKind.SIGN, -1.0, f"{own.kind.verb} the wrong way", count)
    elif own.gain and row.gain:
        moves = moves[np.isfinite(moves["total_x"]) & (np.abs(moves["asked"]) >= _SHORTEST[own.kind.unit])]
        if len(moves):
            yield from _on_axes(history, own, row, moves, reference, device)


def _on_axes(
    history: RunHistory,
    own: DriveSpec,
    row: DriveSpec,
    moves: Columns,
    reference: SimulationSpec,
    device: Device,
) -> Iterator[Finding]:
    """The gain on a drive's own axis, biases on the others, then the scatter on all."""
    spec, unit, direction = history.spec, own.kind.unit, own.kind.direction
    # A bias that a set declares is fixed, not drawn.
    usual, spread, as_nominal = row.bias, (0.0, 0.0, 0.0), own.bias == row.bias
    if spec.randbias:
        usual, as_nominal = Axes(), not reference.randbias or spec.strength == reference.strength
        spread = spread if as_nominal else bias_spread(row.kind, reference.strength)
    if as_nominal and (own.gain, own.error) == (row.gain, row.error):
        return
    states = list(history.biases.items)
    since = np.searchsorted([each.order for each in states], moves["order"], "right") - 1
    allowed = dict(zip("xyr", (_UNUSUAL * each for each in spread), strict=True))
    driven = moves["asked"].astype(np.float64) * sum(astuple(direction)) * own.gain
    scattered = []
    for axis in _AXES:
        other, sign = "deg" if axis == "r" else "in", getattr(direction, axis)
        drawn = np.array([getattr(states[max(place, 0)].bias.get(own.kind, Axes()), axis) for place in since])
        expected = drawn if as_nominal else np.full(len(drawn), getattr(usual, axis))
        done, least = moves[f"total_{axis}"].astype(np.float64), _LEAST_BIAS[unit, other]
        noise = np.abs(driven * (1.0 + drawn)) * getattr(own.error, axis) + _LEAST_NOISE
        # A bias of -1 takes a motion away: that has no gain.
        due = (1.0 + expected) * row.gain / own.gain
        if sign and due.all():
            known = median_of((1.0 + drawn) / due)
            if abs(known - 1.0) >= max(LEAST_SHARE, allowed[axis] if own.gain == row.gain else 0.0):
                value, interval = measured(known, driven * due, done, noise)
                what = f"{own.kind.verb} {value:.2f} times what is asked"
                yield device.finding(FindingKind.GAIN, value, what, len(done), interval=interval)
        elif not sign and abs(known := median_of(drawn - expected)) >= max(least, allowed[axis]):
            value, interval = measured(known, driven, done - driven * expected, noise)
            verb = "turns" if axis == "r" else "drifts"
            what = f"{verb} {abs(value):.3f} {other} to the {_SIDES[axis][value < 0]} for each {_one(unit)}"
            near, far = sorted(map(abs, interval or (value, value)))
            bounds, per = f"{near:.3f} to {far:.3f}", f"{other}/{unit}"
            yield device.finding(
                FindingKind.BIAS, value, what, len(done), interval=interval, bounds=bounds, unit=per
            )
        declared = median_of(np.abs(1.0 + expected)) * getattr(row.error, axis)
        scatter = mad_scale(done / driven - drawn - abs(sign))
        excess = math.sqrt(max(scatter**2 - declared**2, 0.0))
        differs = getattr(own.error, axis) > getattr(row.error, axis)
        if differs and scatter >= NOISIER * declared and excess >= least:
            scattered.append((axis, scatter, declared))
    # What scatters may have another error behind it.
    for axis, scatter, declared in scattered:
        yield _scatter(device, unit, axis, scatter, declared, len(moves))


def _scatter(device: Device, unit: str, axis: str, scatter: float, declared: float, count: int) -> Finding:
    """Noise on an axis that the other row does not declare."""
    other, motion = ("deg", "turn") if axis == "r" else ("in", "distance")
    half = Z_95 * MAD_ERROR * scatter / math.sqrt(count)
    low, high = max(scatter - half, 0.0), scatter + half
    what = f"scatters by {scatter:.3f} {other} of {motion} for each {_one(unit)}, not by {declared:.3f}"
    bounds, per = f"{low:.3f} to {high:.3f}", f"{other}/{unit}"
    return device.finding(
        FindingKind.NOISE, scatter, what, count, interval=(low, high), bounds=bounds, unit=per
    )


def _one(unit: str) -> str:
    return "inch" if unit == "in" else "degree"
