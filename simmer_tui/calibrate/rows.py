"""The model, row by row: the residuals of movements and readings, by poses and parameters.

The unknowns are six numbers a stop, and the parameters. The six are the pose (x, y, heading) and the totals
of the movement after it (x, y and turn by the wheels, with errors). Each row is a residual with its
derivatives and its variance:

process      totals = commanded + d * bias, variance (d (1 + bias) error)^2      (sim/motion.py)
kinematic    the next pose is where the totals lead; loosely, after a contact
counter      increments of the totals (encoders) or of the turn made (gyros)
range        the maze as seen from the pose; a normal error or, now and then, an outlier
observation  other sensors that observe, such as a compass
start, prior

The expected reading of a sensor, and its derivatives by poses and parameters, are defined by its kind
(sim/sensors).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec.structs import astuple

from simmer_tui.calibrate.find_path import is_known_to, world_of
from simmer_tui.calibrate.geometry import Clearance, chord_factor
from simmer_tui.calibrate.measured_run import MeasuredRun, Readings
from simmer_tui.calibrate.parameters import AXES, ParameterSpace, observed_sensors
from simmer_tui.calibrate.posterior import (
    COUNTER,
    KINEMATIC,
    OBSERVATION,
    PRIOR,
    PROCESS,
    RANGE,
    START_POSE,
    Iterate,
    JacobianEntry,
    Rows,
    RowStack,
    VarianceShare,
)
from simmer_tui.calibrate.stretches import prediction, share_of_variance
from simmer_tui.sim.arrays import BoolArray, FloatArray, IntArray
from simmer_tui.sim.distance_errors import REFERENCE_TURN
from simmer_tui.sim.sensors import CountingSensor, ObservingSensor, Sensor, with_parameters
from simmer_tui.sim.specs import CELL_SIZE, ContactRule

_LIMITS = 2.5
"""Standard deviations by which an expected range must be within a sensor's limits to count. The limits then
cut off only 1 % of such readings, which biases the rest by less than 2 % of a standard deviation."""
PER_STOP = 6
"""Unknowns a stop: the pose and the totals of the movement after it."""
LONGEST_COUNT = 6
"""Movements between two readings of a counter beyond which they are not compared: every row between
them would touch all of these."""
_KINEMATIC_SPREAD, _KINEMATIC_TURN_SPREAD = 0.002, 0.003
"""Standard deviations of the kinematic constraints, inches and degrees. The constraints are exact: these are
small compared with any sensor's errors, and large enough for well-conditioned normal equations."""
FIXED = 1e-7
"""Standard deviation of a parameter that must stay fixed."""
_ALIKE = 3.0
"""Ratio of two stretches' lengths within which the error of one predicts that of the other."""
_HUBER = 4.0
"""Standard deviations from which a residual's influence is bounded. Huber's usual 1.345 would cost 5 % of the
efficiency for normal residuals. Counters have few outliers, so that only gross ones need a bound."""


class _Part:
    """Motion of one drive in each movement: the one that moved most first.

    `distance` is signed. `variance` is that of its random errors, as a multiple of that of one movement of
    the same length. A movement with fewer parts has a distance of 0 in the others.
    """

    def __init__(self, run: MeasuredRun, space: ParameterSpace, place: int) -> None:
        drives = run.spec.drives
        parts = [each.distances(drives) for each in run.movements]
        mine = [each[place] if place < len(each) else (each[0][0], 0.0) for each in parts]
        self.drive: IntArray = np.array([drive for drive, _ in mine])
        self.distance: FloatArray = np.array([distance for _, distance in mine])
        self.turns = np.array([drive.kind.turns for drive in drives])[self.drive]
        shares = share_of_variance(self.distance, turns=self.turns)
        self.variance = np.where([each.is_continuous for each in run.movements], shares, 1.0)
        # Columns of its parameters and noise scales, (movements, 3).
        self.bias_columns, self.error_columns = (
            np.array([[space.column(True, d, f"{table}.{axis}") for axis in AXES] for d in self.drive])
            for table in ("bias", "error")
        )


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
        self.stops = run.stops
        self._turns_freely = spec.robot.radius is not None and spec.contact is ContactRule.DRIVE
        self.world = world_of(run)
        self.clearance = Clearance(spec.maze, spec.robot)
        movements = run.movements
        self.before: IntArray = run.stops_before_movements()
        """The stop before each movement."""
        self.drive: IntArray = np.array([each.drive for each in movements])
        self.asked: FloatArray = np.array([each.asked(spec.drives) for each in movements])
        laws = [each.law(spec.num_segments) for each in movements]
        self.law = np.array([float(segments) for segments, _ in laws]), np.array([bend for _, bend in laws])
        """Segments of each movement's path, and its bend."""
        most = max(1, *(len(each.parts) for each in movements))
        self._parts = [_Part(run, space, place) for place in range(most)]
        self.amount = self._parts[0].distance
        """Distance of each movement's drive, inches or degrees, (movements,)."""
        self.certain = np.array([each.certain for each in movements])
        self.turns = np.all([each.turns | (each.distance == 0.0) for each in self._parts], axis=0)
        self.continuous = np.array([each.is_continuous for each in movements])
        self._previous: IntArray = self._stretches_before()
        """The stretch before each in which the same drive moved most; itself if there is none."""
        self._left, self._carried = self._predictions()
        self.movement_at: IntArray = np.full(self.stops, -1)
        """The movement after each stop; -1 after the last stop of a chain."""
        self.movement_at[self.before] = np.arange(len(self.before))
        self._sensors = {
            index: sensor
            for index, sensor in observed_sensors(spec).items()
            if sensor.spec.code in run.readings
        }
        self.columns = {index: space.of_sensor(index) for index in self._sensors}
        """Numbers of parameters and noise scales of the sensors that were read, by row and field."""

    def biases(self, state: Iterate) -> FloatArray:
        """Biases of each movement's drive, (movements, 3)."""
        biases: FloatArray = state.parameters[self._parts[0].bias_columns]
        return biases

    def innovations(self, errors: FloatArray) -> FloatArray:
        """Errors of movements, (movements,), minus their prediction from the previous movement's errors."""
        return errors - self._carried * errors[self._previous]

    def _stretches_before(self) -> IntArray:
        # Errors continue by the distance of each drive, even if other drives move the robot in between.
        before, latest = np.arange(len(self.drive)), dict[tuple[int, int], int]()
        chains = self.run.chains_of(self.before)
        for number in np.flatnonzero(self.continuous).tolist():
            key = int(chains[number]), int(self.drive[number])
            before[number] = latest.get(key, number)
            latest[key] = number
        return before

    def _predictions(self) -> tuple[FloatArray, FloatArray]:
        """Share of each movement's variance that remains if the errors of the previous movement are known,
        and the factor from these to the expected ones, (movements,) each. They are 1 and 0 outside a
        continuous motion."""
        distance, before = self.amount, self._previous
        follows = before < np.arange(len(before))
        # Not from a stretch so short that its error has no information.
        ratio = np.where(follows, distance / np.where(follows, distance[before], 1.0), 0.0)
        follows &= (np.abs(ratio) > 1 / _ALIKE) & (np.abs(ratio) < _ALIKE)
        factor, left = prediction(distance, turns=self._parts[0].turns)
        return np.where(follows, left, 1.0), np.where(follows, factor * ratio, 0.0)

    @property
    def is_of_continuous_drive(self) -> BoolArray:
        """True for the noise scales of drives that moved by velocities."""
        moved = {int(drive) for part in self._parts for drive in part.drive[self.continuous]}
        return np.array([each.drive and each.index in moved for each in self.space.noise_scales])

    @property
    def width(self) -> int:
        """Columns of the chain."""
        return PER_STOP * self.stops

    def rows(self, state: Iterate, annealed: float = 0.0, tight: FloatArray | None = None) -> Rows:
        """All rows at a point.

        Args:
            annealed: Standard deviation, inches, added to that of every observation.
            tight: Prior standard deviations in place of the parameters' own; 0 fixes one.
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
        firsts, chains = np.array(self.run.first_stops()), self.run.chains
        off = state.chain[firsts, :3] - np.array([astuple(chain.start) for chain in chains])
        variances = np.array([chain.spread for chain in chains]) ** 2
        for axis in range(3):
            columns = PER_STOP * firsts + axis
            stack.add(START_POSE, -1, firsts, off[:, axis], variances[:, axis], [(columns, 1.0)])
        # The last stop of a chain has no movement; its totals are 0.
        last: IntArray = np.flatnonzero(self.movement_at < 0)
        for axis in range(3, 6):
            columns = PER_STOP * last + axis
            stack.add(START_POSE, -1, last, state.chain[last, axis], np.ones(len(last)), [(columns, 1.0)])
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
        sensor, columns = self._sensors[index], self.columns[index]
        values = {each.field: float(state.parameters[columns[each.field]]) for each in sensor.parameters}
        for each in sensor.noise_scales:
            values[each.field] = float(state.noise_scales[columns[each.field]])
        return type(sensor)(with_parameters(sensor.spec, values))

    def expected(self, state: Iterate, index: int, stops: IntArray) -> FloatArray:
        """Readings of an observing sensor at stops, (n,), without random errors and drift."""
        sensor = self.sensor_at(state, index)
        assert isinstance(sensor, ObservingSensor), "only these have readings of their own at a stop"
        return sensor.expected(self.world, state.chain[stops, :3], 0.0)

    # -- movements -------------------------------------------------------------------------------

    def _add_process_model(self, stack: RowStack, state: Iterate) -> None:
        stop, before, carried = self.before, self._previous, self._carried
        for axis in range(3):
            residual = state.chain[stop, 3 + axis] - self.asked[:, axis]
            column = PER_STOP * stop + 3 + axis
            entries: list[JacobianEntry] = [(column, 1.0), (column[before], -carried, carried != 0.0)]
            shares: list[VarianceShare] = []
            # 0.001 in or degrees at the least, so that a movement by 0 has a variance. Without an answer a
            # movement may have been made in full or not at all: its whole length is its standard deviation.
            variance = 1e-6 + np.where(self.certain, 0.0, self.amount**2)
            for place, part in enumerate(self._parts):
                columns, scales = part.bias_columns[:, axis], part.error_columns[:, axis]
                d = part.distance
                bias, error = state.parameters[columns], state.noise_scales[scales]
                random = (d * (1.0 + bias) * error) ** 2 * part.variance
                residual = residual - d * bias
                own = self.width + columns
                entries += [(own, -d, d != 0.0), (own[before], carried * d[before], carried != 0.0)]
                shares.append((scales, random * (1.0 if place else self._left)))
                if place:
                    # The previous movement does not predict these, so their own variance enters.
                    shares.append((scales[before], carried**2 * random[before]))
            variance = variance + sum(random for _, random in shares)
            residual = self.innovations(residual)
            stack.add(
                PROCESS, self.drive, stop, residual, variance, entries, shares,
                chosen=np.argsort(self.drive, kind="stable"),
            )  # fmt: skip

    def _add_kinematic_constraints(self, stack: RowStack, state: Iterate) -> None:
        stop = self.before
        here, there = state.chain[stop], state.chain[stop + 1]
        heading = np.exp(-1j * np.radians(here[:, 2]))
        gone = ((there[:, 0] - here[:, 0]) + 1j * (there[:, 1] - here[:, 1])) * heading
        segments, bend = self.law
        curve, slope = chord_factor(here[:, 5], segments)
        totals = here[:, 3] + 1j * here[:, 4]
        free = curve * totals + bend
        met = state.contacts
        length = np.abs(free)
        # A millionth of an inch has no direction; rounding of lengths is far below.
        somewhere, divisor = length > 1e-6, np.maximum(length, 1e-6)
        reached = np.clip((gone * free.conj()).real / divisor**2, 0, 1)
        share = np.where(met & somewhere, reached, 1.0)
        # A disc completes a turn on the spot even at a wall; a wall may block a polygon's corner. By a
        # velocity it does so even while it is pressed.
        whole = self.turns | (self.continuous & self._turns_freely)
        turned = np.where(met & ~whole, share, 1.0)
        loose = np.where(whole, 0.0 if self._turns_freely else 1.0, 0.4)
        off = gone - share * free
        along = np.where(somewhere, free / divisor, 1.0)
        # After a contact, in the frame of the path: any error along it, a small one across it. The spreads
        # are judged: 0.4 of the commanded distance covers any stop on it, since the share already follows the
        # poses. 0.1 across is sliding along a wall at 6 degrees. 0.5, 0.4 in and 0.3 degrees are shifts by a
        # push against the wall; 1 in is that of a turn.
        off = np.where(met, off * along.conj(), off)
        spreads = (
            np.where(met, np.where(self.turns, 1.0, 0.4 * length + 0.5), _KINEMATIC_SPREAD),
            np.where(met, np.where(self.turns, 1.0, 0.1 * length + 0.4), _KINEMATIC_SPREAD),
            np.where(met, loose * np.abs(here[:, 5]) + 0.3, _KINEMATIC_TURN_SPREAD),
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
        rest = there[:, 2] - here[:, 2] - turned * here[:, 5]
        by_turn: list[JacobianEntry] = [(base + 8, 1.0), (base + 2, -1.0), (base + 5, -turned)]
        stack.add(KINEMATIC, self.drive, stop, rest, spreads[2] ** 2, by_turn)

    # -- sensors ---------------------------------------------------------------------------------

    def counted_between(self, index: int) -> tuple[IntArray, IntArray]:
        """The stops between which each row of a counting sensor counts, (rows,) each."""
        readings = self.run.readings[self._sensors[index].spec.code]
        first, second = self._pairs(readings, index)
        return readings.stops[first], readings.stops[second]

    def _pairs(self, readings: Readings, index: int) -> tuple[IntArray, IntArray]:
        """Readings (by number) of a counting sensor that follow each other and can be compared: first and
        second."""
        stops = readings.stops
        good = np.isfinite(readings.values[:-1]) & np.isfinite(readings.values[1:])
        # Between readings at one stop only errors that grow with time show.
        good &= (np.diff(stops) > 0) | ("drift" in self.columns[index])
        good &= np.diff(stops) <= LONGEST_COUNT
        good &= np.diff(self.run.chains_of(stops)) == 0
        first = np.flatnonzero(good)
        return first, first + 1

    def _add_counter(self, stack: RowStack, state: Iterate, index: int, sensor: CountingSensor) -> None:
        spec = sensor.spec
        readings = self.run.readings[spec.code]
        first, second = self._pairs(readings, index)
        begin, end = readings.stops[first], readings.stops[second]
        counts = self._counts_totals if sensor.slips else self._counts_turns
        total, squares, entries = counts(state, sensor, begin, end)
        seconds = readings.times[second] - readings.times[first]
        change = readings.values[second] - readings.values[first]
        residual = sensor.wrapped(change - spec.gain * total - spec.drift * seconds)
        random = (spec.gain * spec.error) ** 2 * squares / self.run.spec.num_segments
        walk = sensor.random_walk**2 * seconds
        # Two readings, each with its error and its rounding: a variance of a twelfth of the step squared.
        floor = sensor.least_error**2 + 2 * spec.absolute_error**2 + spec.resolution**2 / 6
        floor += (spec.gain * sensor.tick) ** 2 / 6
        variance = random + walk + floor
        columns = self.columns[index]
        entries += self._linear_entries(columns, total, seconds)
        stack.add(
            COUNTER, index, end, residual, variance, entries,
            _shares(columns, error=random, random_walk=walk),
            weights=huber_weights(residual**2 / variance),
        )  # fmt: skip

    def _counts_totals(
        self, state: Iterate, sensor: CountingSensor, begin: IntArray, end: IntArray
    ) -> tuple[FloatArray, FloatArray, list[JacobianEntry]]:
        """Distance that wheels roll between stops, (n,), the sum of its squares by segment, and
        derivatives."""
        ahead, aside, around = sensor.lever
        rolled = around * state.chain[:, 5]
        straight = ahead * state.chain[:, 3] + aside * state.chain[:, 4]
        gain = sensor.spec.gain
        entries: list[JacobianEntry] = []
        for step in range(int((end - begin).max(initial=0))):
            inside = begin + step < end
            base = PER_STOP * (begin + step)
            entries += [(base + 3 + axis, -gain * sensor.lever[axis], inside) for axis in range(3)]
        squares = self._squares(rolled, abs(around) * REFERENCE_TURN) + self._squares(straight, CELL_SIZE)
        return _between(rolled + straight, begin, end), _between(squares, begin, end), entries

    def _squares(self, counted: FloatArray, reference: float) -> FloatArray:
        """Squares of the counts after each stop. Divided by `num_segments` they are the variance by an error
        of 1. For a continuous motion it grows with the distance, and is the same over `reference`."""
        continuous = (self.movement_at >= 0) & self.continuous[self.movement_at]
        squares: FloatArray = np.where(continuous, np.abs(counted) * reference, counted**2)
        return squares

    def _counts_turns(
        self, state: Iterate, sensor: CountingSensor, begin: IntArray, end: IntArray
    ) -> tuple[FloatArray, FloatArray, list[JacobianEntry]]:
        """The same for a sensor that counts the real turn, not the wheels'."""
        around = sensor.lever[2]
        turned = around * (state.chain[end, 2] - state.chain[begin, 2])
        counted = self._squares(around * state.chain[:, 5], abs(around) * REFERENCE_TURN)
        squares = np.where(self.movement_at >= 0, counted, 0.0)
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
            proportional, absolute, least = sensor.variances(seen.proportional[where])
            floor = least + spec.gain**2 * seen.curvature[where]
            variance = proportional + absolute + floor + (sensor.annealing * annealed) ** 2
            expected = spec.gain * true + spec.bias
            residual = sensor.wrapped(readings.values[said] - expected - spec.drift * times)
            weights = inlier_probability(residual**2 / variance, variance, state.outliers[index], sensor.span)
        by_parameter = {field: -spec.gain * each[where] for field, each in seen.by_parameter.items()}
        good = np.isfinite(residual) & np.isfinite(variance)
        for each in (*slopes, *by_parameter.values()):
            good &= np.isfinite(each)
        # Near its limits a sensor reports only ranges within them. Readings are left out by their expected
        # values: a choice by their own values would bias the rest.
        good &= sensor.within_limits(expected, _LIMITS * np.sqrt(variance))
        columns = self.columns[index]
        entries: list[JacobianEntry] = [
            (PER_STOP * stop + axis, -each) for axis, each in enumerate(slopes) if each.any()
        ]
        entries += self._linear_entries(columns, true, times)
        entries += [(self.width + columns[field], each) for field, each in by_parameter.items()]
        shares = _shares(columns, error=proportional, absolute_error=np.full(len(stop), absolute))
        stack.add(
            RANGE if spec.kind.is_range else OBSERVATION, index, stop, residual, variance, entries, shares,
            weights=weights, chosen=np.flatnonzero(good),
        )  # fmt: skip


def _shares(columns: dict[str, int], **parts: FloatArray) -> list[VarianceShare]:
    """Parts of a sensor's variance with their noise scales, of those that are estimated."""
    return [(columns[field], part) for field, part in parts.items() if field in columns]


def _between(values: FloatArray, begin: IntArray, end: IntArray) -> FloatArray:
    """Sums of values at stops `begin` to `end`, exclusive."""
    sums = np.concatenate(([0.0], np.cumsum(values)))
    between: FloatArray = sums[end] - sums[begin]
    return between


def inlier_probability(
    squares: FloatArray, variances: FloatArray, outliers: float, span: float
) -> FloatArray:
    """Probability that a reading is not an outlier.

    By Bayes, from a normal density and one that is uniform over `span` (Thrun, Burgard and Fox,
    "Probabilistic Robotics", 2005, section 6.3).

    Args:
        squares: Residuals' squares by their variances.
        outliers: Prior probability of an outlier.
    """
    # exp(-250) does not underflow; a weight of 1e-6 keeps the rows' square roots away from 0.
    normal = (1.0 - outliers) * np.exp(-0.5 * np.minimum(squares, 500.0)) / np.sqrt(2 * np.pi * variances)
    return np.maximum(normal / (normal + outliers / span), 1e-6)


def huber_weights(squares: FloatArray) -> FloatArray:
    """Huber's weights of residuals with these squares by their variances: 1 up to `_HUBER` standard
    deviations, then falling so that the influence stays the same."""
    # Avoids a division by a residual of exactly 0.
    far = np.sqrt(np.maximum(squares, 1e-12))
    return np.where(far > _HUBER, _HUBER / far, 1.0)
