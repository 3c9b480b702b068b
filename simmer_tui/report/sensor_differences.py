"""Differences of a sensor from its row of another set, and their effect on the readings of a run.

The true value of a reading is that of an ideal sensor where the run's own set has it. What the set's own row
adds to it is known, so the rest of a reading is its random error. A counting sensor adds its errors up: it is
compared by its counts from each reading to the next.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace

from simmer_tui.report.finding import (
    FEWEST,
    LEAST_DEGREES,
    LEAST_INCHES,
    LEAST_SHARE,
    Device,
    Finding,
    FindingKind,
)
from simmer_tui.report.robust_fit import MAD_ERROR, Z_95, mad_scale, measured, median_of
from simmer_tui.report.run_readings import poses_of
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import Columns
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import counted
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.sensors import ObservingSensor, Sensor, modelled_sensor
from simmer_tui.sim.sensors.base import World
from simmer_tui.sim.specs import SensorSpec, SimulationSpec

_MOST = 4000
"""Readings of one sensor that are compared, evenly chosen: its interval is then a sixtieth of its noise."""
# Judged: 50 times 0.02 is the inch of a range sensor.
_LEAST_ERRORS = 50.0
"""Least error that matters in other units, in least errors of the kind's readings."""
NOISIER = 1.5
"""Least ratio of scatter to that of another row that matters; judged."""
# One normal error in 16,000 is beyond four standard deviations.
_CLEAR = 4.0
# A share of one wrong answer in twenty is no fault: it comes from edges of tiles, whatever the set declares.
_WRONG = 0.05
_MOUNTING = ("x", "y", "z", "rotation", "field_of_view", "rays", "vertical_field_of_view")
"""Fields of a sensor's row for its place, direction and view."""
_ELECTRONICS = ("gain", "bias", "drift")
_TOLD = ("x", "y", "z", "rotation", "read_time", "dropout", "outlier", "cross_talk", "random_walk")
"""Fields with an effect that is measured, or told elsewhere. All others change readings by themselves."""
_STEPS = ("resolution", "ticks_per_inch")
"""Fields that round a count."""
_LIMITS = {
    "min_range": (1, FindingKind.MISSED, "reads {own} {unit} where anything is nearer"),
    "max_range": (-1, FindingKind.MISSED, "reads nothing beyond {own} {unit}"),
    "resolution": (1, FindingKind.NOISE, "reads in steps of {own} {unit}"),
}
"""Sentences on fields that are larger (1) or smaller (-1) than in the other row."""


def sensor_differences(
    history: RunHistory,
    own: SensorSpec,
    row: SensorSpec,
    rows: Columns,
    reference: SimulationSpec,
    device: Device,
) -> Iterator[Finding]:
    """The differences of a sensor with some readings: another place or kind, no or the opposite effect, its
    mounting, then its readings."""
    count = len(rows)
    if (other := _swapped_with(own, row, history.spec, reference)) is not None:
        yield device.finding(FindingKind.SWAPPED, 1.0, f"reads what {other} should read", count, other=other)
    elif own.kind is not row.kind:
        what = f"is another sensor here: {own.kind.meaning}, not {row.kind.meaning}"
        yield device.finding(FindingKind.SWAPPED, 1.0, what, count)
    elif own.gain == 0.0 != row.gain:
        value = 0.0 if own.kind.counts else own.bias
        what = "counts nothing" if own.kind.counts else f"always reads {value:.3g} {own.unit}".rstrip()
        yield device.finding(FindingKind.STUCK, value, what, count, unit=own.unit)
    elif own.gain * row.gain < 0.0 or own.is_inverted != row.is_inverted:
        what = "answers the opposite" if own.is_yes_or_no else "reads with the wrong sign"
        yield device.finding(FindingKind.SIGN, -1.0, what, count)
    else:
        yield from _mounted(own, row, count, device)
        yield from _Readings(history, own, row, rows, device).differences()


def is_another_robot(spec: SimulationSpec, reference: SimulationSpec) -> bool:
    """True if most sensors of a set are mounted elsewhere than in another: each is meant to be there."""
    places = {each.code: _mounting(each) for each in reference.sensors}
    return 2 * sum(places.get(each.code) != _mounting(each) for each in spec.sensors) > len(spec.sensors)


def least_error(sensor: Sensor) -> float:
    """Least error of a sensor's readings that matters, in its unit."""
    unit = sensor.spec.unit
    if sensor.spec.is_yes_or_no or not unit:
        # Halfway between no and yes.
        return 0.5
    return {"in": LEAST_INCHES, "deg": LEAST_DEGREES}.get(unit) or _LEAST_ERRORS * sensor.least_error


def _mounting(row: SensorSpec) -> tuple[object, ...]:
    return tuple(getattr(row, name) for name in _MOUNTING if row.kind.has(name))


def _swapped_with(
    own: SensorSpec, row: SensorSpec, spec: SimulationSpec, reference: SimulationSpec
) -> str | None:
    """The code of the other set's sensor with which this one is swapped; None if it is the right one."""
    if _mounting(own) == _mounting(row) and own.kind is row.kind:
        return None
    now = {each.code: _mounting(each) for each in spec.sensors}
    for each in reference.sensors:
        # A sensor that is where another still is has moved; it was not swapped.
        there = each.kind is own.kind and _mounting(each) == _mounting(own)
        if there and each.code != own.code and now.get(each.code) != _mounting(each):
            return each.code
    return None


def _mounted(own: SensorSpec, row: SensorSpec, count: int, device: Device) -> Iterator[Finding]:
    """A sensor that is elsewhere, or looks elsewhere."""
    turned, moved = half_turn(own.rotation - row.rotation), math.hypot(own.x - row.x, own.y - row.y)
    kind, higher, where = FindingKind.MOUNTING, own.z - row.z, device.against
    if own.kind.has("rotation") and abs(turned) >= LEAST_DEGREES:
        side = "left" if turned > 0 else "right"
        what = f"looks {abs(turned):.1f} deg further to the {side} than in {where}"
        yield device.finding(kind, turned, what, count, unit="deg", names_set=True)
    if own.kind.has("x") and moved >= LEAST_INCHES:
        what = f"is mounted {moved:.1f} in from where {where} has it"
        yield device.finding(kind, moved, what, count, unit="in", names_set=True)
    if own.kind.has("z") and abs(higher) >= LEAST_INCHES:
        what = f"is mounted at Z {own.z:g} in, in {where} at {row.z:g} in"
        yield device.finding(kind, higher, what, count, unit="in", names_set=True)


class _Readings:
    """The readings of a sensor of a run: their true values, (n,), and for the usable ones, or the steps of a
    count, true values and random errors, (m,)."""

    def __init__(
        self, history: RunHistory, own: SensorSpec, row: SensorSpec, rows: Columns, device: Device
    ) -> None:
        self._history, self._own, self._row, self._device = history, own, row, device
        self._sensor = sensor = modelled_sensor(own)
        self._least = least_error(sensor)
        known = np.isfinite(rows["error"]) if own.kind.counts else ~np.isnan(rows["true"])
        self._rows = rows = rows[known][:: max(1, -(-len(rows) // _MOST))]
        # A restart sets simulated time to 0; drift follows it.
        self._seconds = rows["taken"] - history.clock.before
        self._values, self._true = rows["value"], rows["true"].astype(np.float64)
        self._missed = np.zeros(len(rows), bool)
        if own.kind.counts:
            lasted, off = np.diff(self._seconds), np.diff(rows["error"])
            self._lasted, self._noise = lasted, np.asarray(sensor.wrapped(off - own.drift * lasted))
            self._usable = sensor.wrapped(np.diff(self._values) - off) / (own.gain or 1.0)
            self._true = np.concatenate((np.zeros(len(rows[:1])), np.cumsum(self._usable)))
            return
        exact = self._read(sensor, self._true)
        with np.errstate(invalid="ignore"):
            apart = ~(np.abs(exact - sensor.missed) < self._least) & np.isfinite(exact)
        self._missed = (self._values == sensor.missed) & apart
        there = np.isfinite(exact) & np.isfinite(self._values) & ~self._missed
        self._usable, self._lasted = self._true[there], self._seconds[there]
        self._noise = np.asarray(sensor.wrapped(self._values[there] - exact[there]))

    def differences(self) -> Iterator[Finding]:
        """The differences of its readings: systematic ones, then missed and scattered ones."""
        if not len(self._rows):
            return
        if self._own.is_yes_or_no:
            yield from self._wrong()
        elif len(self._noise):
            yield from self._systematic()
            yield from self._scatter()
        yield from self._shares()
        yield from self._otherwise()

    def _more(self, name: str) -> float:
        """A number of the row less that of the other row; 0 for kinds without it, 1 for other words."""
        own, row = getattr(self._own, name, 0.0), getattr(self._row, name, 0.0)
        if own == row:
            return 0.0
        return 1.0 if isinstance(own, str) else float(own) - float(row)

    def _read(self, sensor: Sensor, true: FloatArray) -> FloatArray:
        """A sensor's readings of true values without random errors, (n,)."""
        pairs = zip(true.tolist(), self._seconds.tolist(), strict=True)
        return np.array([sensor.reading(value, None, at) for value, at in pairs])

    def _spread(self, row: SensorSpec) -> FloatArray:
        """Standard deviations of its random errors by a row, (m,)."""
        walk = getattr(row, "random_walk", 0.0) ** 2 * np.maximum(self._lasted, 0.0)
        by_share, absolute, least = modelled_sensor(row).variances(self._usable)
        return np.sqrt(by_share + walk + absolute + least)

    def _systematic(self) -> Iterator[Finding]:
        own, row, unit, device = self._own, self._row, self._own.unit, self._device
        words = ("too long", "too short") if own.kind.is_range else ("too high", "too low")
        spread, count = self._spread(own), len(self._noise)
        rate, shift = self._more("drift"), self._more("bias")
        if abs(rate) * float(np.ptp(self._seconds) if own.kind.counts else self._seconds[-1]) >= self._least:
            what = f"drifts by {abs(rate):.3g} {unit}/s"
            if not own.kind.counts:
                mean = float((rate * self._lasted + self._noise).mean())
                what += f" and reads {abs(mean):.1f} {unit} {words[mean < 0.0]} on average"
            yield device.finding(FindingKind.DRIFT, rate, what, len(self._rows), unit=f"{unit}/s")
        known = own.gain / row.gain if row.gain else 1.0
        if abs(known - 1.0) >= LEAST_SHARE and self._usable.any():
            due = row.gain * self._usable
            value, interval = measured(known, due, known * due + self._noise, spread)
            what = f"reads {value:.2f} times what it should"
            yield device.finding(FindingKind.GAIN, value, what, count, interval=interval)
        # A program uses differences of counts, which have no offset.
        if abs(shift) >= self._least and not own.kind.counts:
            value, interval = measured(shift, np.ones(count), shift + self._noise, spread)
            what = f"reads {abs(value):.1f} {unit} {words[value < 0.0]}"
            yield device.finding(FindingKind.OFFSET, value, what, count, interval=interval, unit=unit)

    def _scatter(self) -> Iterator[Finding]:
        unit, count, when = self._own.unit, len(self._noise), ""
        declared, scatter = median_of(self._spread(self._row)), mad_scale(self._noise)
        if self._own.kind.counts:
            # The errors of all steps add up.
            declared, scatter = (math.hypot(*each) for each in (self._spread(self._row), self._noise))
            when = " over the run"
        excess = math.sqrt(max(scatter**2 - declared**2, 0.0))
        differs = any(self._more(name) > 0.0 for name in ("error", "absolute_error", "random_walk"))
        # Of few readings an error says nothing of their scatter.
        if differs and scatter >= NOISIER * declared and excess >= self._least and count >= FEWEST["nominal"]:
            half = Z_95 * MAD_ERROR * scatter / math.sqrt(count)
            interval = max(scatter - half, 0.0), scatter + half
            what = f"scatters by {scatter:.1f} {unit}{when}, not by {declared:.1f}"
            yield self._device.finding(FindingKind.NOISE, scatter, what, count, interval=interval, unit=unit)

    def _shares(self) -> Iterator[Finding]:
        """Readings that were missed, or are far off: outliers, or another sensor's echo."""
        if self._own.is_yes_or_no:
            return
        far = np.abs(self._noise) > self._least + _CLEAR * self._spread(self._own)
        off = f"is off by more than {self._least:g} {self._own.unit} in"
        looked = int(self._missed.sum()) + len(self._noise)
        for names, hits, count, kind, verb in (
            (("dropout",), self._missed, looked, FindingKind.MISSED, "misses"),
            (("outlier", "cross_talk"), far, len(far), FindingKind.NOISE, off),
        ):
            share = float(hits.sum()) / max(count, 1)
            if max(map(self._more, names)) < LEAST_SHARE or share < LEAST_SHARE or count < FEWEST["nominal"]:
                continue
            half = Z_95 * math.sqrt(share * (1.0 - share) / count)
            low, high = max(share - half, 0.0), min(share + half, 1.0)
            what = f"{verb} {100 * share:.0f} % of its readings"
            bounds = f"{100 * low:.0f} % to {100 * high:.0f} %"
            yield self._device.finding(kind, share, what, count, interval=(low, high), bounds=bounds)

    def _wrong(self) -> Iterator[Finding]:
        """A sensor that answers yes or no, and is wrong more often than by the other row."""
        row, nominal = self._row, {name: getattr(self._row, name) for name in _ELECTRONICS}
        right = self._read(modelled_sensor(replace(self._own, **nominal)), self._true)
        wrong = self._values != right
        count, share = int(wrong.sum()), float(wrong.mean())
        names = (*_ELECTRONICS, "error", "absolute_error", "dropout", "outlier")
        if not any(map(self._more, names)) or share - row.error - row.dropout - row.outlier < _WRONG:
            return
        kind, value, what, due = FindingKind.NOISE, share, "was wrong", right[wrong]
        if 2 * count > len(wrong):
            kind, value = FindingKind.SIGN, -1.0
        if kind is FindingKind.SIGN and (due == due[0]).all():
            held = " while the block was held" if self._own.kind.detects_block and due[0] else ""
            what = f"read {1.0 - due[0]:g}{held}, in place of {due[0]:g}"
        rests_on = f"{count} of {counted(len(wrong), 'reading')}"
        yield self._device.finding(kind, value, what, len(wrong), rests_on=rests_on)

    def _otherwise(self) -> Iterator[Finding]:
        """Fields by which readings without random errors differ, those of its own kind too."""
        own, least = self._own, 0.0 if self._own.kind.is_yes_or_no else self._least
        # Whole turns are one heading.
        told = {*_TOLD, *_ELECTRONICS, "error", "absolute_error", *(("wrap",) if own.kind.is_heading else ())}
        for column in own.kind.columns:
            name = column.field
            if name in told or not self._more(name):
                continue
            off = self._effect(name)
            apart = off[(off > 0.0) & (off >= least)]
            if len(apart) < max(LEAST_SHARE * len(off), 1.0):
                continue
            values = [getattr(each, name) for each in (own, self._row)]
            mine, other = (each if isinstance(each, str) else f"{each:g}" for each in values)
            sign, kind, what = _LIMITS.get(name, (0, FindingKind.OTHER, ""))
            what = what.format(own=mine, unit=own.unit)
            if sign * self._more(name) <= 0.0:
                kind, what = FindingKind.OTHER, f"has {column.name} {mine}, not {other}"
            size = median_of(apart)
            by = f" by {size:.1f} {own.unit}, the median" if own.unit and math.isfinite(size) else ""
            yield self._device.finding(
                kind,
                1.0 if isinstance(values[0], str) else float(values[0]),
                what,
                len(apart),
                rests_on=f"{len(apart)} of {len(off)} readings differ{by}",
                unit=own.unit,
            )

    def _effect(self, name: str) -> FloatArray:
        """Sizes of a field's effect on readings without random errors, (n,); NaN where it is not known."""
        made = self._sensor, modelled_sensor(replace(self._own, **{name: getattr(self._row, name)}))
        mine, other = (self._read(each, self._seen(each)) for each in made)
        if self._own.kind.counts and name in _STEPS:
            # The count between two steps is not known: a step is the largest error.
            mine, other = (np.full(len(mine), max(each.tick, each.spec.resolution)) for each in made)
        with np.errstate(invalid="ignore"):
            off = np.where(mine == other, 0.0, np.abs(mine - other))
        if self._sensor.period and name != "wrap":
            off = np.minimum(off, np.abs(self._sensor.period - off))
        return off

    def _seen(self, sensor: Sensor) -> FloatArray:
        """True values of a sensor in place of this one, (n,); NaN where a held block may be seen."""
        if not isinstance(sensor, ObservingSensor) or sensor.is_heading:
            return self._true
        rows, blocks = self._rows, list(self._history.blocks.items)
        maze, poses, true = Maze(self._history.spec.maze), poses_of(rows), np.full(len(rows), np.nan)
        since = np.searchsorted([each.order for each in blocks], rows["order"], "right") - 1
        for place in set(since.tolist()):
            state, chosen = blocks[max(place, 0)], since == place
            if not (state.held and sensor.sees_block(state.block.size)):
                block = Block(0.0, 0.0, 0.0) if state.held else state.block
                true[chosen] = sensor.true_values(World(maze, block, state.held), poses[chosen])
        return true
