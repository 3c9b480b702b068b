"""Differences of a sensor from its row of another set, and their effect on the readings of a run.

Each column that differs is tried alone. The run's true values are read by the sensor's own row, and by that
row with the other set's value in this column, both without random errors. The difference is the column's
effect. A column of random errors has none: it is told by the readings that were off by more than is usual.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace

from simmer_tui.report.finding import (
    LEAST_DEGREES,
    LEAST_INCHES,
    LEAST_SHARE,
    Device,
    Finding,
    FindingKind,
)
from simmer_tui.report.robust_statistics import median_interval
from simmer_tui.report.run_readings import poses_of
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.table import Columns
from simmer_tui.sim.angles import cos_sin_array
from simmer_tui.sim.arrays import BoolArray, FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.sensors import CountingSensor, ObservingSensor, Sensor, modelled_sensor
from simmer_tui.sim.sensors.base import World
from simmer_tui.sim.specs import SensorSpec, SimulationSpec

# Readings of one sensor that are compared, evenly chosen: a share of them has a standard error below 1 %.
_MOST = 4000
# Least error that matters in other units, in least errors of the kind's readings. Judged: 50 times 0.02 is
# the inch of a range sensor.
_LEAST_ERRORS = 50.0
_PLACE = ("x", "y", "z", "rotation")
_VIEW = ("field_of_view", "rays", "vertical_field_of_view")
# Kinds of findings by the column's field; all other columns are `OTHER`.
_OPPOSITE = ("gain", "detects_white", "error")
"""Columns by which a sensor that answers yes or no answers the opposite."""
_KINDS = {
    "gain": FindingKind.GAIN,
    "bias": FindingKind.OFFSET,
    "drift": FindingKind.DRIFT,
    "resolution": FindingKind.NOISE,
    **dict.fromkeys(_PLACE, FindingKind.MOUNTING),
}


def sensor_differences(
    history: RunHistory,
    own: SensorSpec,
    row: SensorSpec,
    rows: Columns,
    reference: SimulationSpec,
    device: Device,
) -> Iterator[Finding]:
    """The differences of a sensor with some readings: another place or kind, no or the opposite effect, else
    column by column."""
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
    elif own.gain * row.gain < 0.0:
        yield device.finding(FindingKind.SIGN, -1.0, "reads with the wrong sign", count)
    else:
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
    return row.kind, *(getattr(row, name) for name in (*_PLACE, *_VIEW) if row.kind.has(name))


def _swapped_with(
    own: SensorSpec, row: SensorSpec, spec: SimulationSpec, reference: SimulationSpec
) -> str | None:
    """The code of the other set's sensor with which this one is swapped; None if it is the right one."""
    now = {each.code: _mounting(each) for each in spec.sensors}
    for each in reference.sensors:
        # A sensor that is where another still is has moved; it was not swapped.
        if _mounting(each) == _mounting(own) != _mounting(row) and now.get(each.code) != _mounting(each):
            return each.code
    return None


class _Readings:
    """The readings of a sensor of a run whose truth is known, (n,)."""

    def __init__(
        self, history: RunHistory, own: SensorSpec, row: SensorSpec, rows: Columns, device: Device
    ) -> None:
        self._history, self._own, self._row, self._device = history, own, row, device
        self._usual = modelled_sensor(row)
        known = np.isfinite(rows["error"]) if own.kind.counts else ~np.isnan(rows["true"])
        self._rows = rows = rows[known][:: max(1, -(-len(rows) // _MOST))]
        self._true = rows["true"].astype(np.float64)
        # A restart sets simulated time to 0; drift follows it.
        self._seconds = rows["taken"] - history.clock.before

    def differences(self) -> Iterator[Finding]:
        """A finding for each column with an effect, then one for the columns of random errors."""
        own, row, least, random = self._own, self._row, least_error(self._usual), list[CsvColumn]()
        exact, noise = self._exact(own, self._seen(own)), self._noise()
        for column in own.kind.columns if len(noise) else ():
            mine, usual = (getattr(each, column.field) for each in (own, row))
            if mine == usual:
                continue
            changed = replace(own, **{column.field: usual})
            effect = self._off(exact, self._exact(changed, self._seen(changed)))
            matters = np.abs(effect) >= least
            if matters.mean() >= LEAST_SHARE:
                kind = _KINDS.get(column.field, FindingKind.OTHER)
                yield self._told(kind, [column], matters, effect, noise)
            elif column.is_error and mine > usual and not np.nan_to_num(effect).any():
                random.append(column)
        if random:
            # Counts add small errors up. Others are usual up to two standard deviations.
            by_share, *others = self._usual.variances(np.zeros(1) if own.kind.counts else self._true)
            matters = np.abs(noise) >= least + 2.0 * np.sqrt(by_share + sum(others))
            usual = row.dropout + row.outlier + (row.error if row.kind.errs_by_opposite else 0.0)
            if matters.mean() >= usual + LEAST_SHARE:
                yield self._told(FindingKind.NOISE, random, matters, noise, noise)

    def _told(
        self,
        kind: FindingKind,
        columns: list[CsvColumn],
        matters: BoolArray,
        effect: FloatArray,
        noise: FloatArray,
    ) -> Finding:
        """The finding on columns.

        Args:
            matters: True for the readings that it is about, (n,).
            effect: Effect of the columns on each reading, (n,).
            noise: Random errors, (n,); `effect` itself for columns of these.
        """
        own, unit, count = self._own, self._own.unit, int(matters.sum())
        used = matters & np.isfinite(effect) & np.isfinite(noise)
        known, off = effect[used], effect[used] + noise[used]
        value, interval, is_random = 1.0, None, effect is noise
        if own.is_yes_or_no:
            what = "is wrong"
            if 2 * count > len(matters) and all(each.field in _OPPOSITE for each in columns):
                kind, what = FindingKind.SIGN, "answers the opposite"
        elif 2 * (matters & np.isfinite(effect)).sum() < count or not used.any():
            saw = "sees what it should miss" if effect[matters].min() < 0.0 else "misses what it should see"
            what, unit = saw, ""
        elif kind is FindingKind.GAIN and self._row.gain:
            more = own.gain / self._row.gain - 1.0
            value, interval = median_interval(1.0 + more * off / known, 1.0 + more)
            what, unit = f"reads {value:.2f} times what it should", ""
        else:
            # All but one in twenty. Random errors have no direction.
            is_one_way = not is_random and abs(np.sign(known).mean()) >= 0.9
            sizes = (off, known) if is_one_way else (np.abs(known), np.abs(known))
            value, interval = median_interval(*sizes)
            size = f"{abs(value):.1f} {unit}".rstrip()
            words = ("short", "long") if own.kind.is_range else ("low", "high")
            verb = "scatters by" if is_random else "is off by"
            what = f"reads {size} too {words[value > 0.0]}" if is_one_way else f"{verb} {size}"
        why = []
        for each in columns:
            mine, usual = (each.rule.shown(getattr(row, each.field)) for row in (own, self._row))
            why.append(f"its {each.name} is {mine}, in {self._device.against} {usual}")
        return self._device.finding(
            kind, value, what, count, interval=interval, of=len(matters), unit=unit, why="; ".join(why)
        )

    def _noise(self) -> FloatArray:
        """Random errors of the readings, (n,)."""
        if self._own.kind.counts:
            # The true count of a log has its random errors.
            return self._off(self._rows["error"], self._own.bias + self._own.drift * self._seconds)
        return self._off(self._rows["value"], self._exact(self._own, self._true))

    def _exact(self, row: SensorSpec, true: FloatArray) -> FloatArray:
        """Readings of true values by a row, without random errors, (n,)."""
        sensor = modelled_sensor(row)
        pairs = zip(true.tolist(), self._seconds.tolist(), strict=True)
        return np.array([sensor.reading(value, None, at) for value, at in pairs])

    def _off(self, readings: FloatArray, due: FloatArray) -> FloatArray:
        """Errors of readings, (n,): infinite where only one of the two saw something."""
        with np.errstate(invalid="ignore"):
            off = np.where(readings == due, 0.0, self._usual.wrapped(readings - due))
        # A program uses differences of counts, which have no offset.
        return np.asarray(self._usual.wrapped(off - off[:1])) if self._own.kind.counts else off

    def _seen(self, row: SensorSpec) -> FloatArray:
        """True values of a sensor in place of this one, (n,); NaN where a held block may be seen."""
        sensor, rows, blocks = modelled_sensor(row), self._rows, list(self._history.blocks.items)
        maze, poses, true = Maze(self._history.spec.maze), poses_of(rows), np.full(len(rows), np.nan)
        if isinstance(sensor, CountingSensor):
            x, y, turned = np.diff(poses, axis=0, prepend=poses[:1]).T
            cos, sin = cos_sin_array(poses[:, 2] - turned / 2)
            counted_by = np.column_stack((cos * x + sin * y, cos * y - sin * x, turned)) @ sensor.lever
            return np.asarray(np.cumsum(counted_by))
        assert isinstance(sensor, ObservingSensor)
        # The analyses' true values of a compass have its deviation by iron, which `reading` adds.
        true_values = ObservingSensor.true_values if sensor.is_heading else type(sensor).true_values
        since = np.searchsorted([each.order for each in blocks], rows["order"], "right") - 1
        for place in set(since.tolist()):
            state, chosen = blocks[max(place, 0)], since == place
            if not (state.held and sensor.sees_block(state.block.size)):
                block = Block(0.0, 0.0, 0.0) if state.held else state.block
                world = World(maze, block, state.held)
                true[chosen] = true_values(sensor, world, poses[chosen])
        return true
