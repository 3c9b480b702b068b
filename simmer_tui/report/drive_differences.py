"""Differences of a drive from its row of another set, and their effect on its movements in a run.

A movement is compared as its drive began it: a wall that held the robot is not the drive's fault. The wheels
turned all the same. Movements that were cut short are left out. The others have on each axis the total a + d
B + d (1 + B) P e of docs/how-it-works.md.
"""

from __future__ import annotations

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
from simmer_tui.report.robust_statistics import median_interval
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import Columns
from simmer_tui.sim.noise import bias_spread
from simmer_tui.sim.specs import CELL_SIZE, Axes, DriveSpec, SimulationSpec

# Least bias that matters, by the units of command and axis. One of 2 degrees in a cell, or of an
# inch in a quarter turn, leads past the middle of the next cell.
_LEAST_BIAS = {
    ("in", "deg"): LEAST_DEGREES / CELL_SIZE,
    ("deg", "in"): LEAST_INCHES / 90.0,
    ("in", "in"): LEAST_SHARE,
    ("deg", "deg"): LEAST_SHARE,
}
_NOUNS = {"in": "inch", "deg": "degree"}
# By axis. A turn leads further away than the rest, so it is told first.
_SIDES = {"r": ("left", "right"), "x": ("front", "back"), "y": ("left", "right")}


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
        moves = moves[np.isfinite(moves["total_x"]) & (moves["asked"] != 0.0)]
        for axis in _SIDES if len(moves) else ():
            yield from _on_axis(axis, history, own, row, moves, reference, device)


def _on_axis(
    axis: str,
    history: RunHistory,
    own: DriveSpec,
    row: DriveSpec,
    moves: Columns,
    reference: SimulationSpec,
    device: Device,
) -> Iterator[Finding]:
    """The gain, if this is a drive's own axis, else its bias on it; then the scatter."""
    spec, unit, other, count = history.spec, own.kind.unit, "deg" if axis == "r" else "in", len(moves)
    along, least = abs(getattr(own.kind.direction, axis)), _LEAST_BIAS[unit, other]
    drawn, per = history.biases.items[-1].bias.get(own.kind, Axes()), f"for each {_NOUNS[unit]}"
    # For each inch or degree that the drive goes by its gain: without noise, and as it was.
    known = along + getattr(drawn, axis)
    done = moves[f"total_{axis}"] / (moves["asked"] * sum(astuple(own.kind.direction)) * own.gain)
    is_usual, due, allowed = own.bias == row.bias, along + getattr(row.bias, axis), 0.0
    if spec.randbias:
        # A bias that a set declares is fixed, not drawn.
        is_usual, due = not reference.randbias or spec.strength == reference.strength, along
        spread = dict(zip("xyr", bias_spread(row.kind, reference.strength), strict=True))
        # A normal number is beyond twice its standard deviation once in 20.
        allowed = 0.0 if is_usual else 2.0 * spread[axis]
    due = known if is_usual else due
    # A bias of -1 takes a motion away: that has no gain.
    if along and due:
        factor = own.gain / row.gain / due
        if abs(known * factor - 1.0) >= max(least, allowed):
            value, interval = median_interval(done * factor, known * factor)
            what = f"{own.kind.verb} {value:.2f} times what is asked"
            yield device.finding(FindingKind.GAIN, value, what, count, interval=interval)
    elif abs(known - due) >= max(least, allowed):
        value, interval = median_interval(done - due, known - due)
        verb, side = "turns" if axis == "r" else "drifts", _SIDES[axis][value < 0.0]
        what = f"{verb} {abs(value):.3f} {other} to the {side} {per}"
        yield device.finding(FindingKind.BIAS, value, what, count, interval=interval, unit=f"{other}/{unit}")
    mine, usual = getattr(own.error, axis), getattr(row.error, axis)
    if mine - usual >= least:
        off = np.abs(done - known)
        value, interval = median_interval(off, off)
        side = {"x": " ahead", "y": " aside", "r": ""}[axis]
        what = f"is off by {value:.3f} {other}{side} {per}"
        why = f"its error is {mine:g}, in {device.against} {usual:g}"
        yield device.finding(
            FindingKind.NOISE, value, what, count, interval=interval, unit=f"{other}/{unit}", why=why
        )
