"""Readings of one sensor beside those of an ideal one at the same place, ready to be tested.

A sensor that observes is compared reading by reading with the true value in the log. One that answers yes or
no is compared where the truth is clear of its threshold. One that counts is compared by its increments,
because its errors add up.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from simmer_tui.report.finding import LEAST_DEGREES, LEAST_INCHES, FindingKind
from simmer_tui.report.robust_fit import median_of, quantiles
from simmer_tui.run.run_history import RunHistory, rows_by_name
from simmer_tui.run.table import Columns
from simmer_tui.sim.arrays import BoolArray, FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.sensors import CountingSensor, ObservingSensor, Sensor, modelled_sensor
from simmer_tui.sim.sensors.base import World
from simmer_tui.sim.specs import SensorSpec, SimulationSpec

_MOST = 4000
"""Readings of one sensor that are compared, evenly chosen: its interval is then a sixtieth of its noise."""
# Standard deviations between truth and a limit. Of normal errors one in 1.7 million lies beyond five, so
# clipping at the limit does not bias the rest.
_CLEAR = 5.0
# Judged: a longer delay than this many readings does not happen.
LAGS = (1, 2, 3)
_ONE_HEADING = 0.97
"""Length of the mean direction of headings that are one: they scatter by less than 14 deg. Judged."""
# Judged: enough to distinguish two sensors; a line sensor's 113 test points take a tenth of a millisecond.
_PLACES = 800
"""Places at which the readings of other sensors are computed."""
_LEAST = {"in": LEAST_INCHES, "deg": LEAST_DEGREES}
# Judged: 50 times 0.02 is the inch of a range sensor.
LEAST_ERRORS = 50.0
"""Least error that matters in other units, in least errors of the kind's readings."""
# A share of one wrong answer in twenty is no fault: it comes from edges of tiles, whatever the set declares.
_WRONG = 0.05


class Alternative(Struct, frozen=True):
    """Values that a sensor with a fault would give: `expected`, (n,), in its unit, NaN where not known."""

    kind: FindingKind
    expected: FloatArray
    value: float = 1.0
    other: str | None = None


class SensorSample(Struct, frozen=True):
    """Readings of one sensor, or its counts between them: values, expected values and declared standard
    deviations, (n,) each, in its unit. `chance` is the probability that a reading without a fault is nearer
    to a false expectation. `missed` is the number of dropouts among the `looked` readings with something in
    range."""

    sensor: Sensor
    values: FloatArray
    expected: FloatArray
    spread: FloatArray
    alternatives: tuple[Alternative, ...] = ()
    chance: float = 0.5
    missed: int = 0
    looked: int = 0
    seconds: FloatArray = field(default_factory=lambda: np.empty(0))
    """Of a counting sensor: seconds between its readings, (n,)."""

    @property
    def spec(self) -> SensorSpec:
        """The row that says how the sensor should read."""
        return self.sensor.spec

    @property
    def least(self) -> float:
        """Least error that matters, in its unit."""
        if self.spec.is_yes_or_no or not self.spec.unit:
            # Halfway between no and yes.
            return 0.5
        return _LEAST.get(self.spec.unit) or LEAST_ERRORS * self.sensor.least_error

    @property
    def tolerance(self) -> FloatArray:
        """Errors up to which a reading still agrees with a value: half of the least error that matters, and
        four standard deviations, (n,). One normal error in 16,000 is beyond them."""
        return self.least / 2 + 4 * self.spread

    def against(self, faults: Iterable[Alternative]) -> SensorSample:
        """The same with the faults that it is compared with."""
        return replace(self, alternatives=tuple(faults))

    def inside(self) -> SensorSample:
        """The same without readings that its least range, or 0, clipped: they do not show the size of an
        error."""
        if not self.spec.kind.is_range:
            return self
        kept = self.values > self.spec.min_range
        columns = {name: getattr(self, name)[kept] for name in ("values", "expected", "spread")}
        return replace(self, **columns)

    def off(self, expected: FloatArray) -> FloatArray:
        """Values less expected ones, (n,)."""
        return self.sensor.wrapped(self.values - expected)


def by_sensor(history: RunHistory, readings: Columns) -> Iterator[tuple[SensorSpec, Columns]]:
    """The sensors that a run read, each with its rows among some readings."""
    specs = {each.code: each for each in history.spec.sensors}
    for code, rows in rows_by_name(readings, "sensor", history.sensor_codes):
        if code in specs:
            yield specs[code], rows


def poses_of(rows: Columns) -> FloatArray:
    """The poses of some rows, (n, 3)."""
    return np.column_stack([rows[name] for name in ("x", "y", "heading")]).astype(np.float64)


def world_without_block(spec: SimulationSpec) -> World:
    """The maze without the block, as a program has it that does not know the block's place."""
    return World(Maze(spec.maze), Block(0.0, 0.0, 0.0), False)


def sample_of(
    history: RunHistory, rows: Columns, spec: SensorSpec, others: Iterable[SensorSpec] = ()
) -> SensorSample | None:
    """The readings of a sensor in `rows`, beside those that a sensor with the row `spec` should have given;
    None if these are not known. It may be swapped with one of the `others`."""
    alike = tuple(_alike(spec, others))
    sensor = modelled_sensor(spec)
    if isinstance(sensor, CountingSensor):
        return _counted(history, rows, sensor, alike)
    if not isinstance(sensor, ObservingSensor):
        return None
    rows = rows[:: _stride(len(rows), _MOST)]
    rows = rows[np.isfinite(rows["true"])]
    if spec.is_yes_or_no:
        return _answered(history, rows, sensor, alike)
    return _observed(history, rows, sensor, alike)


def _stride(count: int, most: int) -> int:
    """Step that selects at most `most` of `count` rows, evenly."""
    return max(1, -(-count // most))


# -- observing sensors -------------------------------------------------------------------------------


def _observed(
    history: RunHistory, rows: Columns, sensor: ObservingSensor, alike: tuple[Sensor, ...]
) -> SensorSample:
    spec = sensor.spec
    base = _base(sensor, _true(history, rows, spec))
    # A restart sets simulated time to 0; drift that is declared follows it.
    seconds = rows["taken"] - history.clock.before
    expected = spec.gain * base + spec.bias + spec.drift * seconds
    # A log changed by hand may have any number; one that is too large has an unbounded spread.
    with np.errstate(over="ignore"):
        by_share, absolute, least = sensor.variances(base)
        spread = np.sqrt(by_share + absolute + least)
    within = sensor.within_limits(expected, _CLEAR * spread)
    values = rows["value"]
    there = np.isfinite(values)
    usable = within & there
    sample = SensorSample(
        sensor,
        values[usable],
        expected[usable],
        spread[usable],
        missed=int((within & ~there).sum()),
        looked=int(within.sum()),
    )
    others = *_late(expected, usable), *inverted_compass(sample, base[usable])
    return sample.against((*stuck(sample), *others, *_swapped(history, rows[usable], sample, alike)))


def _answered(
    history: RunHistory, rows: Columns, sensor: ObservingSensor, alike: tuple[Sensor, ...]
) -> SensorSample:
    """Readings of a sensor that answers yes or no, where the truth is clear of its threshold."""
    spec = sensor.spec
    seen = _true(history, rows, spec) * spec.gain + spec.bias
    opposite = spec.kind.errs_by_opposite
    measured = 0.0 if opposite else spec.error * seen
    clear = np.abs(seen - sensor.threshold) > _CLEAR * (measured + spec.absolute_error)
    expected = (seen >= sensor.threshold).astype(np.float64)
    # Dropouts answer no, outliers either.
    declared = spec.dropout + spec.outlier + (spec.error if opposite else 0.0)
    usable = clear & np.isfinite(rows["value"])
    sample = SensorSample(
        sensor,
        rows["value"][usable],
        expected[usable],
        np.full(int(usable.sum()), 0.01),
        chance=min(max(_WRONG, 1.5 * declared), 0.5),
    )
    others = *_late(expected, usable), Alternative(FindingKind.SIGN, 1.0 - sample.expected, -1.0)
    return sample.against((*stuck(sample), *others, *_swapped(history, rows[usable], sample, alike)))


def _true(history: RunHistory, rows: Columns, spec: SensorSpec) -> FloatArray:
    """True values as a sensor with the row `spec` has them, where the set's own answers the opposite."""
    true: FloatArray = rows["true"].astype(np.float64)
    own = _own_row(history, spec)
    return 1.0 - true if own.is_inverted != spec.is_inverted else true


def _own_row(history: RunHistory, spec: SensorSpec) -> SensorSpec:
    """The row of the run's own set for the sensor with this row's code."""
    return next((each for each in history.spec.sensors if each.code == spec.code), spec)


def _base(sensor: Sensor, true: FloatArray) -> FloatArray:
    """The values before gain and bias, without random errors: with the iron around a compass, for one."""
    return np.array([sensor.proportional(each, None) for each in true.tolist()], np.float64)


# -- counting sensors --------------------------------------------------------------------------------


def _counted(
    history: RunHistory, rows: Columns, sensor: CountingSensor, alike: tuple[Sensor, ...]
) -> SensorSample | None:
    """Counts from each reading to the next, where no contact came between."""
    spec = sensor.spec
    own = _own_row(history, spec)
    rows = rows[np.isfinite(rows["error"])]
    if len(rows) < 2:
        return None
    times = rows["taken"]
    exact = bool(own.gain) and not own.wrap
    if exact:
        levels, known = (rows["value"] - rows["error"]) / own.gain, np.ones(len(rows), bool)
    else:
        levels, known = _driven(history, rows) @ sensor.lever, _at_rest(history, times)
    travelled = _travelled(sensor, rows)
    step = _stride(len(rows), _MOST)
    values = sensor.wrapped(np.diff(rows["value"]))
    seconds, counted = np.diff(times), np.diff(levels)
    known = known[1:] & known[:-1]
    # Wheels slip at a wall; a gyro does not turn by the plan there.
    if sensor.slips or not exact:
        known &= _without_contacts(history, times)
    whole = np.flatnonzero(known)[::step]
    tick = max(spec.resolution, sensor.tick)
    spread = np.sqrt(
        (spec.gain * spec.error * np.diff(travelled)) ** 2
        + sensor.random_walk**2 * np.maximum(seconds, 0.0)
        + tick**2 / 6.0
        + sensor.least_error**2
    )
    expected = spec.gain * counted + spec.drift * seconds
    sample = SensorSample(
        sensor,
        values[whole],
        expected[whole],
        spread[whole],
        seconds=seconds[whole],
    )
    usable = np.zeros(len(values), bool)
    usable[whole] = True
    made = [
        Alternative(FindingKind.STUCK, np.zeros(len(whole))),
        Alternative(FindingKind.SIGN, spec.drift * seconds[whole] - spec.gain * counted[whole], -1.0),
        *_late(expected, usable),
    ]
    if _is_off(sample):
        driven = np.diff(_driven(history, rows), axis=0)[whole]
        for other in alike:
            lever = other.lever if isinstance(other, CountingSensor) else np.zeros(3)
            made.append(Alternative(FindingKind.SWAPPED, spec.gain * driven @ lever, 1.0, other.spec.code))
    return sample.against(made)


def _travelled(sensor: CountingSensor, rows: Columns) -> FloatArray:
    """Counts of the whole path up to each reading, in either direction: errors grow with it, (n,)."""
    ahead, aside, turn = np.abs(sensor.lever)
    return np.asarray(max(ahead, aside) * rows["gone"] + turn * rows["turned"], np.float64)


def _driven(history: RunHistory, rows: Columns) -> FloatArray:
    """Inches ahead and to the left, and degrees, driven up to each reading in the robot's frame, (n, 3)."""
    moves = history.movements.columns()
    totals = np.column_stack([moves[name] for name in ("total_x", "total_y", "total_r")]).astype(np.float64)
    sums = np.concatenate((np.zeros((1, 3)), np.cumsum(np.nan_to_num(totals), axis=0)))
    return np.asarray(sums[np.searchsorted(moves["order"], rows["order"])])


def _without_contacts(history: RunHistory, times: FloatArray) -> BoolArray:
    """True for the stretches between `times`, (n,), in which no movement had a contact, (n - 1,)."""
    moves = history.movements.columns()
    met = moves[moves["contact"]]
    # Ended before the stretch, or begun after it.
    begun = np.searchsorted(met["begin"], times[1:], "right")
    ended = np.searchsorted(met["elapsed"], times[:-1], "left")
    return np.asarray(begun <= ended)


def _at_rest(history: RunHistory, times: FloatArray) -> BoolArray:
    """True where no movement is under way, (n,)."""
    moves = history.movements.columns()
    begun = np.searchsorted(moves["begin"], times, "left")
    return np.asarray(begun == np.searchsorted(moves["elapsed"], times, "right"))


# -- faults ------------------------------------------------------------------------------------------


def stuck(sample: SensorSample) -> Iterator[Alternative]:
    """A constant value, where the truth varied by more than its noise."""
    if not len(sample.values):
        return
    low, high = quantiles(sample.expected, (0.1, 0.9))
    middle = median_of(sample.values)
    if high - low > 2 * sample.least + 4 * median_of(sample.spread) or sample.least == 0.5:
        yield Alternative(FindingKind.STUCK, np.full(len(sample.values), middle), middle)


def _late(expected: FloatArray, usable: BoolArray) -> Iterator[Alternative]:
    """Values that were expected some readings before."""
    for lag in LAGS:
        yield Alternative(FindingKind.LATE, delayed(expected, lag)[usable], float(lag))


def delayed(values: FloatArray, lag: int) -> FloatArray:
    """Values that come some readings late, NaN before the first, (n,)."""
    return np.concatenate((np.full(lag, np.nan), values))[: len(values)]


def inverted_compass(sample: SensorSample, base: FloatArray) -> Iterator[Alternative]:
    """A compass that counts in the other direction, from any zero. Ranges have no sign."""
    spec = sample.spec
    if spec.kind.is_range or not sample.sensor.period or not len(base):
        return
    turn = 2j * np.pi / sample.sensor.period
    mirrored = np.exp(turn * (sample.values + spec.gain * base)).mean()
    offset = np.exp(turn * (sample.values - spec.gain * base)).mean()
    # At one heading, or two opposite ones, any zero fits, and an offset explains as much.
    headings = np.exp(turn * spec.gain * base)
    if abs(headings.mean()) > _ONE_HEADING or abs(offset) >= abs(mirrored):
        return
    zero = np.angle(mirrored) / (2 * np.pi) * sample.sensor.period
    yield Alternative(FindingKind.SIGN, zero - spec.gain * base, -1.0)


def _swapped(
    history: RunHistory, rows: Columns, sample: SensorSample, alike: tuple[Sensor, ...]
) -> Iterator[Alternative]:
    """Values that the other sensors of its unit would have given, if its own truth does not fit."""
    if not _is_off(sample):
        return
    for other in alike:
        if isinstance(other, ObservingSensor):
            true = _seen_by(history, rows, other)
            value = _base(other, true) * other.spec.gain + other.spec.bias
            if other.spec.is_yes_or_no:
                value = np.where(np.isnan(value), np.nan, value >= other.threshold)
            yield Alternative(FindingKind.SWAPPED, value, 1.0, other.spec.code)


def _is_off(sample: SensorSample) -> bool:
    """True if more than a small share of the readings differs from the expected ones."""
    if not len(sample.values):
        return False
    off = np.abs(sample.off(sample.expected)) > sample.tolerance
    # A tenth: two sensors that see the same in nine readings of ten are distinguished by the tenth.
    return float(off.mean()) > 0.1


def _alike(spec: SensorSpec, others: Iterable[SensorSpec]) -> Iterator[Sensor]:
    """The sensors among others that could be taken for this one."""
    for each in others:
        same = each.unit == spec.unit and each.is_yes_or_no == spec.is_yes_or_no
        if same and each.enabled and each.code != spec.code and each.kind.counts == spec.kind.counts:
            yield modelled_sensor(each)


def _seen_by(history: RunHistory, rows: Columns, sensor: ObservingSensor) -> FloatArray:
    """True values of a sensor where other readings were taken, (n,); NaN where a held block may be seen."""
    maze = Maze(history.spec.maze)
    poses = poses_of(rows)
    true = np.full(len(rows), np.nan)
    blocks = list(history.blocks.items)
    since = np.searchsorted([each.order for each in blocks], rows["order"], "right") - 1
    asked = np.zeros(len(rows), bool)
    asked[:: _stride(len(rows), _PLACES)] = True
    for place in sorted(set(since.tolist())):
        chosen = asked & (since == place)
        state = blocks[max(place, 0)]
        if state.held and sensor.sees_block(state.block.size):
            continue
        block = Block(0.0, 0.0, 0.0) if state.held else state.block
        true[chosen] = sensor.true_values(World(maze, block, state.held), poses[chosen])
    return true
