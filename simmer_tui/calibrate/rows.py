"""The model, row by row: what each movement and each reading says of poses and parameters.

Unknown are, of every stop, the pose (x, y, heading) and the totals of the movement after it (x, y and
turn: what the wheels do, errors included), six numbers a stop; then the parameters. Each row is a
residual with its derivatives and its variance:

process      totals = commanded + d * bias, variance (d (1 + bias) error)^2      (sim/motion.py)
kinematic    the next pose is where the totals lead; loosely, after a contact
counter      increments of the totals (encoders) or of the turn made (gyros)
range        the maze as seen from the pose; a normal error or, now and then, an outlier
observation  other sensors that observe, such as a compass
start, prior

What a sensor is expected to read, and how that changes with poses and parameters, is said by its kind
(sim/sensors).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from simmer_tui.calibrate.find_path import is_known_to, world_of
from simmer_tui.calibrate.geometry import chord_factor
from simmer_tui.calibrate.measured_run import MeasuredRun, Readings
from simmer_tui.calibrate.parameters import AXES, ParameterSpace, observed_sensors, on_axes
from simmer_tui.calibrate.posterior import (
    COUNTER,
    KINEMATIC,
    OBSERVATION,
    PRIOR,
    PROCESS,
    RANGE,
    START,
    Iterate,
    JacobianEntry,
    Rows,
    RowStack,
    VarianceShare,
)
from simmer_tui.sim.angles import FloatArray, IntArray
from simmer_tui.sim.sensors import CountingSensor, ObservingSensor, Sensor, with_parameters
from simmer_tui.sim.specs import ContactRule

_LIMITS = 2.5
"""Standard deviations by which a range must be within a sensor's limits to count: beyond them only 1 % of
readings are cut off, which biases the rest by less than 2 % of a standard deviation."""
PER_STOP = 6
"""Unknowns a stop: the pose and the totals of the movement after it."""
LONGEST_COUNT = 6
"""Movements between two readings of a counter beyond which they are not compared: every row between
them would touch all of these."""
_KINEMATIC_SPREADS = (0.002, 0.002, 0.003)
"""Standard deviations of the kinematic constraints, inches and degrees: they hold exactly. These are small
against what any sensor tells, and large enough for the normal equations to stay well conditioned."""
FIXED = 1e-7
"""Standard deviation of a parameter that is to stay where it is."""
_HUBER = 4.0
"""Standard deviations from which a residual's influence is bounded. Huber's usual 1.345 would cost 5 % of
what normal residuals tell; counters have few outliers, so that only gross ones need to be held."""


class Model:
    """Makes the rows of a run.

    Args:
        run: The movements and readings.
        space: The parameters; those of sensors that were never read have no rows but their priors'.
    """

    def __init__(self, run: MeasuredRun, space: ParameterSpace) -> None:
        self.run = run
        self.space = space
        spec = run.spec
        self.segments = spec.num_segments
        self.stops = run.stops
        self._turns_freely = spec.robot.radius is not None and spec.contact is ContactRule.DRIVE
        self.world = world_of(run)
        movements = run.movements
        self.before: IntArray = run.stops_before_movements()
        """The stop before each movement."""
        self.drive: IntArray = np.array([each.drive for each in movements])
        directions = np.array([on_axes(drive.kind.direction) for drive in spec.drives])
        self.asked: FloatArray = (
            np.array([each.value for each in movements])[:, None] * directions[self.drive]
        )
        self.amount: FloatArray = self.asked.sum(axis=1)
        self.certain = np.array([each.certain for each in movements])
        self.turns = np.array([drive.kind.turns for drive in spec.drives])[self.drive]
        self.movement_at: IntArray = np.full(self.stops, -1)
        """The movement after each stop; -1 after the last stop of a chain."""
        self.movement_at[self.before] = np.arange(len(self.before))
        self._bias_columns, self._error_columns = (
            np.array([[space.column(True, d, f"{table}.{axis}") for axis in AXES] for d in self.drive])
            for table in ("bias", "error")
        )
        self._sensors = {
            index: sensor
            for index, sensor in observed_sensors(spec).items()
            if sensor.spec.code in run.readings
        }
        self._columns = {index: space.of_sensor(index) for index in self._sensors}

    def biases(self, state: Iterate) -> FloatArray:
        """Biases of each movement's drive, (movements, 3)."""
        biases: FloatArray = state.parameters[self._bias_columns]
        return biases

    @property
    def width(self) -> int:
        """Columns of the chain."""
        return PER_STOP * self.stops

    def rows(self, state: Iterate, annealed: float = 0.0, tight: FloatArray | None = None) -> Rows:
        """All rows at a point.

        Args:
            annealed: Standard deviation, inches, added to that of every observation.
            tight: Prior standard deviations in place of the parameters' own; 0 keeps one where it is.
        """
        stack = RowStack()
        self._add_process_model(stack, state)
        self._add_kinematic_constraints(stack, state)
        for index in self._sensors:
            match self.sensor_at(state, index):
                case CountingSensor() as counter:
                    self._add_counter(stack, state, index, counter)
                case ObservingSensor() as observer:
                    self._add_observations(stack, state, index, observer, annealed)
        firsts = np.array(self.run.first_stops())
        starts = np.array([(c.start.x, c.start.y, c.start.heading) for c in self.run.chains])
        for axis in range(3):
            off = state.chain[firsts, axis] - starts[:, axis]
            spreads = np.array([chain.spread[axis] for chain in self.run.chains])
            stack.add(START, -1, firsts, off, spreads**2, [(PER_STOP * firsts + axis, 1.0)])
        # The last stop of a chain has no movement; its totals are 0.
        last: IntArray = np.flatnonzero(self.movement_at < 0)
        for axis in range(3, 6):
            stack.add(
                START, -1, last, state.chain[last, axis], np.ones(len(last)), [(PER_STOP * last + axis, 1.0)]
            )
        parameters = self.space.parameters
        numbers = np.arange(len(parameters))
        priors = np.array([each.spread for each in parameters]) if tight is None else tight
        off = state.parameters - np.array([each.prior for each in parameters])
        off = np.where(priors > 0.0, off, 0.0)
        variances = np.maximum(priors, FIXED) ** 2
        stack.add(PRIOR, -1, numbers, off, variances, [(self.width + numbers, 1.0)])
        return stack.rows(self.width + len(parameters), len(self.space.noise_scales))

    def sensor_at(self, state: Iterate, index: int) -> Sensor:
        """A sensor with its parameters and noise scales as estimated at a point."""
        sensor = self._sensors[index]
        values: dict[str, float] = {}
        for group, estimated in (
            (sensor.parameters, state.parameters),
            (sensor.noise_scales, state.noise_scales),
        ):
            values |= {prior.field: float(estimated[self._columns[index][prior.field]]) for prior in group}
        return type(sensor)(with_parameters(sensor.spec, values))

    def expected(self, state: Iterate, index: int, stops: IntArray) -> FloatArray:
        """Readings of an observing sensor at stops, (n,), without random errors and drift."""
        sensor = self.sensor_at(state, index)
        assert isinstance(sensor, ObservingSensor), "only these have readings of their own at a stop"
        return sensor.expected(self.world, state.chain[stops, :3], 0.0)

    # -- movements -------------------------------------------------------------------------------

    def _add_process_model(self, stack: RowStack, state: Iterate) -> None:
        stop, d = self.before, self.amount
        for axis in range(3):
            columns, scales = self._bias_columns[:, axis], self._error_columns[:, axis]
            bias, error = state.parameters[columns], state.noise_scales[scales]
            residual = state.chain[stop, 3 + axis] - self.asked[:, axis] - d * bias
            random = (d * (1.0 + bias) * error) ** 2
            # 0.001 in or degrees at the least, so that a movement by 0 has a variance. Without an answer a
            # movement may have been made in full or not at all: the whole of it is its standard deviation.
            variance = random + 1e-6 + np.where(self.certain, 0.0, d**2)
            entries: list[JacobianEntry] = [(PER_STOP * stop + 3 + axis, 1.0), (self.width + columns, -d)]
            stack.add(
                PROCESS, self.drive, stop, residual, variance, entries, [(scales, random)],
                chosen=np.argsort(self.drive, kind="stable"),
            )  # fmt: skip

    def _add_kinematic_constraints(self, stack: RowStack, state: Iterate) -> None:
        stop = self.before
        here, there = state.chain[stop], state.chain[stop + 1]
        heading = np.exp(-1j * np.radians(here[:, 2]))
        gone = ((there[:, 0] - here[:, 0]) + 1j * (there[:, 1] - here[:, 1])) * heading
        curve, slope = chord_factor(here[:, 5], self.segments)
        totals = here[:, 3] + 1j * here[:, 4]
        free = curve * totals
        met = state.contacts
        length = np.abs(free)
        share = np.where(
            met & (length > 1e-6),
            np.clip((gone * free.conj()).real / np.maximum(length, 1e-6) ** 2, 0, 1),
            1.0,
        )
        # A disc completes a turn on the spot, whatever it touches; a polygon's corner may be held by a wall.
        turned = np.where(met & ~self.turns, share, 1.0)
        loose = np.where(self.turns, 0.0 if self._turns_freely else 1.0, 0.4)
        off = gone - share * free
        along = np.where(length > 1e-6, free / np.maximum(length, 1e-6), 1.0)
        # After a contact: anything along the path, little across it, in the frame of the path. The spreads
        # are judged: 0.4 of the distance asked covers any stop on it, since the share already follows the
        # poses, and 0.1 across is a wall slid along at 6 degrees; 0.5, 0.4 in and 0.3 degrees are what a
        # push against the wall shifts.
        off = np.where(met, off * along.conj(), off)
        spreads = (
            np.where(met, np.where(self.turns, 1.0, 0.4 * length + 0.5), _KINEMATIC_SPREADS[0]),
            np.where(met, np.where(self.turns, 1.0, 0.1 * length + 0.4), _KINEMATIC_SPREADS[1]),
            np.where(met, loose * np.abs(here[:, 5]) + 0.3, _KINEMATIC_SPREADS[2]),
        )
        frame = np.where(met, along.conj(), 1.0)
        d_there = heading * frame
        d_turn = -1j * np.pi / 180.0 * gone * frame
        d_x, d_y = -share * curve * frame, -share * 1j * curve * frame
        d_r = -share * slope * totals * frame
        base = PER_STOP * stop
        slopes: list[tuple[int, Any]] = [(6, d_there), (7, 1j * d_there), (0, -d_there), (1, -1j * d_there)]
        slopes += [(2, d_turn), (3, d_x), (4, d_y), (5, d_r)]
        for part, spread in zip((np.real, np.imag), spreads, strict=False):
            entries = [(base + column, part(each)) for column, each in slopes]
            stack.add(KINEMATIC, self.drive, stop, part(off), spread**2, entries)
        stack.add(
            KINEMATIC,
            self.drive,
            stop,
            there[:, 2] - here[:, 2] - turned * here[:, 5],
            spreads[2] ** 2,
            [(base + 8, 1.0), (base + 2, -1.0), (base + 5, -turned)],
        )

    # -- sensors ---------------------------------------------------------------------------------

    def _pairs(self, readings: Readings) -> tuple[IntArray, IntArray]:
        """Readings (by number) that follow each other and can be compared: first and second."""
        stops = readings.stops
        first = np.arange(len(stops) - 1)
        good = np.isfinite(readings.values[:-1]) & np.isfinite(readings.values[1:])
        good &= stops[1:] - stops[:-1] <= LONGEST_COUNT
        chain_of = np.searchsorted(self.run.first_stops(), stops, side="right")
        good &= chain_of[1:] == chain_of[:-1]
        kept = first[good]
        return kept, kept + 1

    def _add_counter(self, stack: RowStack, state: Iterate, index: int, sensor: CountingSensor) -> None:
        spec = sensor.spec
        readings = self.run.readings[spec.code]
        first, second = self._pairs(readings)
        begin, end = readings.stops[first], readings.stops[second]
        if sensor.slips:
            counts = self._counts_totals(state, sensor, begin, end)
        else:
            counts = self._counts_turns(state, sensor, begin, end)
        total, squares, entries = counts
        seconds = readings.times[second] - readings.times[first]
        change = readings.values[second] - readings.values[first]
        residual = sensor.wrapped(change - spec.gain * total - spec.drift * seconds)
        random = (spec.gain * spec.error) ** 2 * squares / self.segments
        walk = spec.random_walk**2 * seconds
        # Two readings, each with its error and its rounding: a variance of a twelfth of the step squared.
        floor = sensor.least_error**2 + 2 * spec.absolute_error**2 + spec.resolution**2 / 6
        if spec.ticks_per_inch:
            floor += (spec.gain / spec.ticks_per_inch) ** 2 / 6
        variance = random + walk + floor
        columns = self._columns[index]
        entries += self._linear_entries(columns, total, seconds)
        parts: list[VarianceShare] = [
            (columns[field], part)
            for field, part in (("error", random), ("random_walk", walk))
            if field in columns
        ]
        # Between readings at one stop only what grows with time shows.
        chosen = np.flatnonzero((end > begin) | ("drift" in columns))
        stack.add(
            COUNTER, index, end, residual, variance, entries, parts,
            weights=huber_weights(residual**2 / variance), chosen=chosen,
        )  # fmt: skip

    def _counts_totals(
        self, state: Iterate, sensor: CountingSensor, begin: IntArray, end: IntArray
    ) -> tuple[FloatArray, FloatArray, list[JacobianEntry]]:
        """Sum of what wheels roll between stops, (n,), sum of its squares by segment, and derivatives."""
        ahead, aside, around = sensor.lever
        rolled = around * state.chain[:, 5]
        straight = ahead * state.chain[:, 3] + aside * state.chain[:, 4]
        gain = sensor.spec.gain
        entries: list[JacobianEntry] = []
        for step in range(int((end - begin).max(initial=0))):
            inside = begin + step < end
            base = PER_STOP * (begin + step)
            entries += [(base + 3 + axis, -gain * sensor.lever[axis], inside) for axis in range(3)]
        return _between(rolled + straight, begin, end), _between(rolled**2 + straight**2, begin, end), entries

    def _counts_turns(
        self, state: Iterate, sensor: CountingSensor, begin: IntArray, end: IntArray
    ) -> tuple[FloatArray, FloatArray, list[JacobianEntry]]:
        """The same of a sensor that counts the turn that was made, not what the wheels did."""
        around = sensor.lever[2]
        turned = around * (state.chain[end, 2] - state.chain[begin, 2])
        squares = np.where(self.movement_at >= 0, (around * state.chain[:, 5]) ** 2, 0.0)
        slope = sensor.spec.gain * around
        entries: list[JacobianEntry] = [(PER_STOP * end + 2, -slope), (PER_STOP * begin + 2, slope)]
        return turned, _between(squares, begin, end), entries

    def _linear_entries(
        self, columns: dict[str, int], true: FloatArray, seconds: FloatArray
    ) -> list[JacobianEntry]:
        """Derivatives by gain, bias and drift, as far as they are estimated."""
        slopes = (("gain", -true), ("bias", -1.0), ("drift", -seconds))
        return [(self.width + columns[field], slope) for field, slope in slopes if field in columns]

    def _add_observations(
        self, stack: RowStack, state: Iterate, index: int, sensor: ObservingSensor, annealed: float
    ) -> None:
        spec, readings = sensor.spec, self.run.readings[sensor.spec.code]
        usable = np.isfinite(readings.values) & is_known_to(self.run, sensor, readings.stops)
        said = np.flatnonzero(usable)
        if not said.size:
            return
        stop, times = readings.stops[said], readings.times[said]
        stops, where = np.unique(stop, return_inverse=True)
        seen = sensor.linearised(self.world, state.chain[stops, :3])
        true, slopes = seen.true[where], spec.gain * seen.by_pose[:, where]
        # Beyond an incidence limit there is no range at all; such rows are left out below.
        with np.errstate(invalid="ignore"):
            proportional = (spec.gain * spec.error * seen.proportional[where]) ** 2
            floor = sensor.least_error**2 + spec.resolution**2 / 12 + spec.gain**2 * seen.curvature[where]
            variance = proportional + spec.absolute_error**2 + floor + (sensor.annealing * annealed) ** 2
            expected = spec.gain * true + spec.bias
            residual = sensor.wrapped(readings.values[said] - expected - spec.drift * times)
            weights = inlier_probability(residual**2 / variance, variance, state.outliers[index], sensor.span)
        by_parameter = {field: -spec.gain * each[where] for field, each in seen.by_parameter.items()}
        good = np.isfinite(residual) & np.isfinite(variance)
        for each in (*slopes, *by_parameter.values()):
            good &= np.isfinite(each)
        # Near its limits a sensor says only what is within them. Those readings are left out by what they
        # should be: chosen by what they are, what is left would seem too far or too near.
        good &= sensor.within_limits(expected, _LIMITS * np.sqrt(variance))
        columns = self._columns[index]
        entries: list[JacobianEntry] = [
            (PER_STOP * stop + axis, -each) for axis, each in enumerate(slopes) if each.any()
        ]
        entries += self._linear_entries(columns, true, times)
        entries += [(self.width + columns[field], each) for field, each in by_parameter.items()]
        absolute = np.full(len(stop), spec.absolute_error**2)
        parts: list[VarianceShare] = [
            (columns[field], part)
            for field, part in (("error", proportional), ("absolute_error", absolute))
            if field in columns
        ]
        stack.add(
            RANGE if spec.kind.is_range else OBSERVATION, index, stop, residual, variance, entries, parts,
            weights=weights, chosen=np.flatnonzero(good),
        )  # fmt: skip


def _between(values: FloatArray, begin: IntArray, end: IntArray) -> FloatArray:
    """Sums of values at stops `begin` to `end`, that excluded."""
    sums = np.concatenate(([0.0], np.cumsum(values)))
    between: FloatArray = sums[end] - sums[begin]
    return between


def inlier_probability(
    squares: FloatArray, variances: FloatArray, outliers: float, span: float
) -> FloatArray:
    """Probability that a reading is no outlier.

    By Bayes, from a normal density and one that is even over `span` (Thrun, Burgard and Fox,
    "Probabilistic Robotics", 2005, section 6.3).

    Args:
        squares: Residuals' squares by their variances.
        outliers: Prior probability of an outlier.
    """
    # exp(-250) is no underflow yet; a weight of 1e-6 keeps the rows' square roots away from 0.
    normal = (1.0 - outliers) * np.exp(-0.5 * np.minimum(squares, 500.0)) / np.sqrt(2 * np.pi * variances)
    return np.maximum(normal / (normal + outliers / span), 1e-6)


def huber_weights(squares: FloatArray) -> FloatArray:
    """Huber's weights of residuals with these squares by their variances: 1 up to `_HUBER` standard
    deviations, then falling so that the influence stays the same."""
    far = np.sqrt(np.maximum(squares, 1e-12))
    return np.where(far > _HUBER, _HUBER / far, 1.0)
