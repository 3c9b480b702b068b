"""The model, row by row: what each movement and each reading says of poses and parameters.

Unknown are, of every stop, the pose (x, y, heading) and the totals of the movement after it (x, y and
turn: what the wheels do, errors included), six numbers a stop; then the parameters. Each row is a
residual with its derivatives and its variance:

law         totals = commanded + d * bias, variance (d (1 + bias) error)^2      (sim/motion.py)
way         the next pose is where the totals lead; loosely, where a wall was met
counter     what an encoder counted of the totals, a gyro of the turn that was made
range       the maze as seen from the pose; a normal error or, now and then, anything
compass     the heading
start, prior
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

from simmer_tui.calibrate.drive_law import swing
from simmer_tui.calibrate.find_path import trusted, world_of
from simmer_tui.calibrate.measured_run import MeasuredRun, Readings
from simmer_tui.calibrate.row_stack import (
    COMPASS,
    COUNTER,
    LAW,
    PRIOR,
    RANGE,
    START,
    WAY,
    IntArray,
    Rows,
    RowStack,
    State,
)
from simmer_tui.calibrate.unknowns import Unknowns
from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.sensors import RangeSensor, sensor_of
from simmer_tui.sim.sensors.range_sensors import USUAL_RANGE
from simmer_tui.sim.specs import ContactRule, SensorSpec

_LIMITS = 2.5
"""Standard deviations by which a range must be within a sensor's limits to count."""
PER_STOP = 6
LONGEST_COUNT = 6
"""Movements between two readings of a counter beyond which they are not compared: every row between
them would touch all of these."""
_WAY_SPREAD = (0.002, 0.002, 0.003)
"""How exactly totals lead to the next pose, inches and degrees: exactly, but for the arithmetic."""
_STEPS = (0.12, 0.12, 0.6)
"""Differences in pose over which ranges are compared: about what poses are known to."""
_GRAZING = 0.5
"""What of a bend or jump of the range within these steps counts as its error."""
_FLOOR = {"range": 0.02, "comp": 0.05, "odom": 0.002, "gyro": 0.003}
"""Errors that every reading has: a percent error vanishes at zero."""
FIXED = 1e-7
"""Standard deviation of a parameter that is to stay where it is."""


class Model:
    """Makes the rows of a run. `free` says which parameters are estimated; the others stay fixed.
    `annealed` is a standard deviation, inches, added to that of every range."""

    def __init__(self, run: MeasuredRun, unknowns: Unknowns) -> None:
        self.run = run
        self.unknowns = unknowns
        spec = run.spec
        self.segments = spec.num_segments
        self.stops = run.stops
        self._turns_freely = spec.robot.radius is not None and spec.contact is ContactRule.DRIVE
        self.world = world_of(run)
        before = [
            first + k
            for first, chain in zip(run.first_stops(), run.chains, strict=True)
            for k in range(len(chain.movements))
        ]
        movements = run.movements
        self.before: IntArray = np.array(before)
        """The stop before each movement."""
        self.drive: IntArray = np.array([each.drive for each in movements])
        directions = np.array(
            [(d.kind.direction.x, d.kind.direction.y, d.kind.direction.r) for d in spec.drives]
        )
        self.asked: FloatArray = (
            np.array([each.value for each in movements])[:, None] * directions[self.drive]
        )
        self.amount: FloatArray = self.asked.sum(axis=1)
        self.certain = np.array([each.certain for each in movements])
        self.turns = np.array([drive.kind.turns for drive in spec.drives])[self.drive]
        self.movement_at: IntArray = np.full(self.stops, -1)
        self.movement_at[self.before] = np.arange(len(before))
        self._bias_columns = np.array(
            [[unknowns.place(True, i, f"bias.{a}") for a in "xyr"] for i in range(len(spec.drives))]
        )
        self._error_columns = np.array(
            [[unknowns.size(True, i, f"error.{a}") for a in "xyr"] for i in range(len(spec.drives))]
        )
        self._sensors = [
            (index, sensor, run.readings[sensor.code])
            for index, sensor in enumerate(spec.sensors)
            if sensor.enabled and sensor.code in run.readings
        ]

    @property
    def width(self) -> int:
        """Columns of the chain."""
        return PER_STOP * self.stops

    def rows(self, state: State, annealed: float = 0.0, tight: FloatArray | None = None) -> Rows:
        """All rows at a point. `tight` are standard deviations of the parameters' priors in place of
        their own; 0 keeps one where it is."""
        stack = RowStack()
        self._add_law(stack, state)
        self._add_way(stack, state)
        for index, sensor, readings in self._sensors:
            match sensor.kind.name:
                case "ultra" | "tof":
                    self._add_ranges(stack, state, index, sensor, readings, annealed)
                case "odom":
                    self._add_encoder(stack, state, index, sensor, readings)
                case "gyro":
                    self._add_gyro(stack, state, index, sensor, readings)
                case "comp":
                    self._add_compass(stack, state, index, sensor, readings, annealed)
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
        places = self.unknowns.places
        numbers = np.arange(len(places))
        priors = np.array([each.spread for each in places]) if tight is None else tight
        off = state.places - np.array([each.prior for each in places])
        off = np.where(priors > 0.0, off, 0.0)
        variances = np.maximum(priors, FIXED) ** 2
        stack.add(PRIOR, -1, numbers, off, variances, [(self.width + numbers, 1.0)])
        return stack.rows(self.width + len(places), len(self.unknowns.sizes))

    def expected(self, state: State, index: int, stops: IntArray) -> FloatArray:
        """What a range sensor would say at stops without random errors."""
        gain, bias, angle = (
            state.places[self.unknowns.place(False, index, field)] for field in ("gain", "bias", "rotation")
        )
        ranging = sensor_of(replace(self.run.spec.sensors[index], rotation=float(angle)))
        assert isinstance(ranging, RangeSensor), "only range sensors are asked for"
        true: FloatArray = ranging.ranges(self.world, state.chain[stops, :3])
        expected: FloatArray = gain * true + bias
        return expected

    # -- movements -------------------------------------------------------------------------------

    def _add_law(self, stack: RowStack, state: State) -> None:
        stop, d = self.before, self.amount
        for axis in range(3):
            place = self._bias_columns[self.drive, axis]
            size = self._error_columns[self.drive, axis]
            bias = np.where(place >= 0, state.places[place], 0.0)
            error = np.where(size >= 0, state.sizes[size], 0.0)
            residual = state.chain[stop, 3 + axis] - self.asked[:, axis] - d * bias
            random = (d * (1.0 + bias) * error) ** 2
            variance = random + 1e-6 + np.where(self.certain, 0.0, d**2)
            columns = np.where(place >= 0, self.width + place, -1)
            entries = [(PER_STOP * stop + 3 + axis, 1.0), (columns, -d)]
            for each in np.unique(self.drive):
                mine = np.flatnonzero(self.drive == each)
                stack.add(
                    LAW,
                    self.drive[mine],
                    stop[mine],
                    residual[mine],
                    variance[mine],
                    [(_take(column, mine), _take(value, mine)) for column, value in entries],
                    [(int(self._error_columns[each, axis]), random[mine])],
                )

    def _add_way(self, stack: RowStack, state: State) -> None:
        stop = self.before
        here, there = state.chain[stop], state.chain[stop + 1]
        heading = np.exp(-1j * np.radians(here[:, 2]))
        gone = ((there[:, 0] - here[:, 0]) + 1j * (there[:, 1] - here[:, 1])) * heading
        curve, slope = swing(here[:, 5], self.segments)
        totals = here[:, 3] + 1j * here[:, 4]
        free = curve * totals
        met = state.contacts
        length = np.abs(free)
        share = np.where(
            met & (length > 1e-6),
            np.clip((gone * free.conj()).real / np.maximum(length, 1e-6) ** 2, 0, 1),
            1.0,
        )
        # Of a turn on the spot a disc does all, whatever it touches; a corner may be held by a wall.
        turned = np.where(met & ~self.turns, share, 1.0)
        loose = np.where(self.turns, 0.0 if self._turns_freely else 1.0, 0.4)
        off = gone - share * free
        along = np.where(length > 1e-6, free / np.maximum(length, 1e-6), 1.0)
        # Where a wall was met: anything along the way, little across it, in the frame of the way.
        off = np.where(met, off * along.conj(), off)
        spreads = (
            np.where(met, np.where(self.turns, 1.0, 0.4 * length + 0.5), _WAY_SPREAD[0]),
            np.where(met, np.where(self.turns, 1.0, 0.1 * length + 0.4), _WAY_SPREAD[1]),
            np.where(met, loose * np.abs(here[:, 5]) + 0.3, _WAY_SPREAD[2]),
        )
        frame = np.where(met, along.conj(), 1.0)
        d_there = heading * frame
        d_turn = -1j * np.pi / 180.0 * gone * frame
        d_x, d_y = -share * curve * frame, -share * 1j * curve * frame
        d_r = -share * slope * totals * frame
        parts = (np.real, np.imag)
        base = PER_STOP * stop
        for axis, part in enumerate(parts):
            stack.add(
                WAY,
                self.drive,
                stop,
                part(off),
                spreads[axis] ** 2,
                [
                    (base + 6, part(d_there)),
                    (base + 7, part(1j * d_there)),
                    (base, -part(d_there)),
                    (base + 1, -part(1j * d_there)),
                    (base + 2, part(d_turn)),
                    (base + 3, part(d_x)),
                    (base + 4, part(d_y)),
                    (base + 5, part(d_r)),
                ],
            )
        stack.add(
            WAY,
            self.drive,
            stop,
            there[:, 2] - here[:, 2] - turned * here[:, 5],
            spreads[2] ** 2,
            [(base + 8, 1.0), (base + 2, -1.0), (base + 5, -turned)],
        )

    # -- counters --------------------------------------------------------------------------------

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

    def _add_encoder(
        self, stack: RowStack, state: State, index: int, sensor: SensorSpec, readings: Readings
    ) -> None:
        first, second = self._pairs(readings)
        place = self.unknowns.place(False, index, "gain")
        size = self.unknowns.size(False, index, "error")
        gain, error = state.places[place], state.sizes[size]
        begin, end = readings.stops[first], readings.stops[second]
        angle = np.radians(sensor.rotation)
        cos, sin = np.cos(angle), np.sin(angle)
        lever = 2.0 * np.pi * (sensor.x * sin - sensor.y * cos) / 360.0
        rolled, straight = lever * state.chain[:, 5], cos * state.chain[:, 3] + sin * state.chain[:, 4]
        counted = np.concatenate(([0.0], np.cumsum(rolled + straight)))
        squares = np.concatenate(([0.0], np.cumsum(rolled**2 + straight**2)))
        seconds = readings.times[second] - readings.times[first]
        total = counted[end] - counted[begin]
        residual = readings.values[second] - readings.values[first] - gain * total - sensor.drift * seconds
        residual = _wrapped(residual, sensor.wrap)
        random = (gain * error) ** 2 * (squares[end] - squares[begin]) / self.segments
        floor = _FLOOR["odom"] ** 2 + 2 * sensor.absolute_error**2 + sensor.resolution**2 / 6
        if sensor.ticks_per_inch:
            floor += (gain / sensor.ticks_per_inch) ** 2 / 6
        entries: list[tuple[IntArray | int, FloatArray | float]] = [(self.width + place, -total)]
        for step in range(int((end - begin).max(initial=0))):
            inside = begin + step < end
            base = np.where(inside, PER_STOP * (begin + step), -PER_STOP)
            entries += [(base + 3, -gain * cos), (base + 4, -gain * sin), (base + 5, -gain * lever)]
        entries = [(np.where(np.asarray(c) < 0, -1, c), v) for c, v in entries]
        moved = end > begin
        self._add_some(stack, COUNTER, index, end, residual, random + floor, entries, [(size, random)], moved)

    def _add_gyro(
        self, stack: RowStack, state: State, index: int, sensor: SensorSpec, readings: Readings
    ) -> None:
        first, second = self._pairs(readings)
        unknowns = self.unknowns
        place, drift_place = unknowns.place(False, index, "gain"), unknowns.place(False, index, "drift")
        size, walk_size = unknowns.size(False, index, "error"), unknowns.size(False, index, "random_walk")
        gain, drift = state.places[place], state.places[drift_place]
        begin, end = readings.stops[first], readings.stops[second]
        turned = state.chain[end, 2] - state.chain[begin, 2]
        step = np.where(self.movement_at >= 0, state.chain[:, 5] ** 2, 0.0)
        squares = np.concatenate(([0.0], np.cumsum(step)))
        seconds = readings.times[second] - readings.times[first]
        residual = readings.values[second] - readings.values[first] - gain * turned - drift * seconds
        residual = _wrapped(residual, sensor.wrap)
        random = (gain * state.sizes[size]) ** 2 * (squares[end] - squares[begin]) / self.segments
        walk = state.sizes[walk_size] ** 2 * seconds
        floor = _FLOOR["gyro"] ** 2 + 2 * sensor.absolute_error**2 + sensor.resolution**2 / 6
        entries: list[tuple[IntArray | int, FloatArray | float]] = [
            (PER_STOP * end + 2, -gain),
            (PER_STOP * begin + 2, gain),
            (self.width + place, -turned),
            (self.width + drift_place, -seconds),
        ]
        parts = [(size, random), (walk_size, walk)]
        everything = np.ones(len(end), bool)
        self._add_some(
            stack, COUNTER, index, end, residual, random + walk + floor, entries, parts, everything
        )

    def _add_some(
        self,
        stack: RowStack,
        family: int,
        index: int,
        stop: IntArray,
        residual: FloatArray,
        variance: FloatArray,
        entries: Sequence[tuple[IntArray | int, FloatArray | float]],
        parts: Sequence[tuple[int, FloatArray]],
        chosen: np.ndarray[tuple[int], np.dtype[np.bool_]],
    ) -> None:
        mine = np.flatnonzero(chosen)
        stack.add(
            family,
            index,
            stop[mine],
            residual[mine],
            variance[mine],
            [(_take(column, mine), _take(value, mine)) for column, value in entries],
            [(size, part[mine]) for size, part in parts],
            weights=_calm(residual[mine] ** 2 / variance[mine]),
        )

    # -- what observes the world -------------------------------------------------------------------

    def _add_ranges(
        self,
        stack: RowStack,
        state: State,
        index: int,
        sensor: SensorSpec,
        readings: Readings,
        annealed: float,
    ) -> None:
        unknowns = self.unknowns
        gain_place, bias_place, angle_place = (
            unknowns.place(False, index, field) for field in ("gain", "bias", "rotation")
        )
        error_size, absolute_size = (
            unknowns.size(False, index, field) for field in ("error", "absolute_error")
        )
        gain, bias, angle = state.places[[gain_place, bias_place, angle_place]]
        error, absolute = state.sizes[[error_size, absolute_size]]
        ranging = sensor_of(replace(sensor, rotation=float(angle)))
        assert isinstance(ranging, RangeSensor), "it is one"
        usable = np.isfinite(readings.values)
        if not trusted(self.run, ranging, self.stops):
            usable &= np.array([trusted(self.run, ranging, int(s)) for s in readings.stops])
        said = np.flatnonzero(usable)
        if not said.size:
            return
        places, where = np.unique(readings.stops[said], return_inverse=True)
        poses = state.chain[places, :3]
        shifts = np.concatenate((np.zeros((1, 3)), np.diag(_STEPS), -np.diag(_STEPS)))
        around = (poses + shifts[:, None, :]).reshape(-1, 3)  # all in one call: calls are what takes time
        middle, *sides = ranging.ranges(self.world, around).reshape(len(shifts), -1)
        slopes = [(sides[k] - sides[k + 3]) / (2 * _STEPS[k]) for k in range(3)]
        bent = np.array([_GRAZING * (sides[k] + sides[k + 3] - 2 * middle) for k in range(3)])
        bends: FloatArray = np.square(bent).sum(axis=0)
        turned = [
            sensor_of(replace(sensor, rotation=float(angle + sign * _STEPS[2]))) for sign in (1.0, -1.0)
        ]
        looked = [each.ranges(self.world, poses) for each in turned if isinstance(each, RangeSensor)]
        by_angle = (looked[0] - looked[1]) / (2 * _STEPS[2])
        middle, bends, by_angle = middle[where], bends[where], by_angle[where]
        stop = readings.stops[said]
        with np.errstate(invalid="ignore"):  # beyond an incidence limit there is no range at all
            proportional = (gain * error * middle) ** 2
            floor = _FLOOR["range"] ** 2 + sensor.resolution**2 / 12 + gain**2 * bends + annealed**2
            variance = proportional + absolute**2 + floor
            residual = readings.values[said] - gain * middle - bias - sensor.drift * readings.times[said]
        slope = [gain * each[where] for each in slopes]
        good = np.isfinite(residual) & np.isfinite(variance) & np.isfinite(by_angle)
        for each in slope:
            good &= np.isfinite(each)
        # Near its limits a sensor says only what is within them. Those readings are left out by what they
        # should be: chosen by what they are, what is left would seem too far or too near.
        expected, margin = gain * middle + bias, _LIMITS * np.sqrt(variance)
        good &= (expected - margin > max(sensor.min_range, 0.0)) & (expected + margin < sensor.max_range)
        mine = np.flatnonzero(good)
        longest = sensor.max_range if np.isfinite(sensor.max_range) else USUAL_RANGE
        residual, variance = residual[mine], variance[mine]
        stack.add(
            RANGE,
            index,
            stop[mine],
            residual,
            variance,
            [
                *((PER_STOP * stop[mine] + axis, -each[mine]) for axis, each in enumerate(slope)),
                (self.width + gain_place, -middle[mine]),
                (self.width + bias_place, -1.0),
                (self.width + angle_place, -gain * by_angle[mine]),
            ],
            [(error_size, proportional[mine]), (absolute_size, np.full(len(mine), absolute**2))],
            weights=_mixture(residual**2 / variance, variance, state.outliers[index], longest),
        )

    def _add_compass(
        self,
        stack: RowStack,
        state: State,
        index: int,
        sensor: SensorSpec,
        readings: Readings,
        annealed: float,
    ) -> None:
        unknowns = self.unknowns
        place = unknowns.place(False, index, "bias")
        absolute_size = unknowns.size(False, index, "absolute_error")
        error_size = unknowns.size(False, index, "error")
        absolute, error = state.sizes[[absolute_size, error_size]]
        said = np.flatnonzero(np.isfinite(readings.values))
        stop = readings.stops[said]
        true = state.chain[stop, 2] + sensor.rotation
        radians = np.radians(true)
        iron = sensor.hard_iron * np.sin(radians) + sensor.soft_iron * np.sin(2 * radians)
        predicted = sensor.gain * (true + iron) + state.places[place] + sensor.drift * readings.times[said]
        residual = readings.values[said] - predicted
        # Headings of a log may be whole turns off what the robot counts; people put it there by eye.
        residual = _wrapped(residual, sensor.wrap or 360.0)
        proportional = (sensor.gain * error * true) ** 2
        floor = _FLOOR["comp"] ** 2 + sensor.resolution**2 / 12 + (5.0 * annealed) ** 2
        variance = proportional + absolute**2 + floor
        slope = 1.0 + np.pi / 180 * (
            sensor.hard_iron * np.cos(radians) + 2 * sensor.soft_iron * np.cos(2 * radians)
        )
        stack.add(
            COMPASS,
            index,
            stop,
            residual,
            variance,
            [(PER_STOP * stop + 2, -sensor.gain * slope), (self.width + place, -1.0)],
            [(absolute_size, np.full(len(stop), absolute**2)), (error_size, proportional)],
            weights=_mixture(residual**2 / variance, variance, state.outliers[index], 360.0),
        )


def _take(value: Any, chosen: IntArray) -> Any:
    array = np.asarray(value)
    return array[chosen] if array.ndim else value


def _wrapped(residual: FloatArray, wrap: float) -> FloatArray:
    return (residual + wrap / 2) % wrap - wrap / 2 if wrap else residual


def _mixture(squares: FloatArray, variances: FloatArray, odd: float, longest: float) -> FloatArray:
    """How likely a reading is no outlier, which may be anything up to `longest`."""
    normal = (1.0 - odd) * np.exp(-0.5 * np.minimum(squares, 500.0)) / np.sqrt(2 * np.pi * variances)
    return np.maximum(normal / (normal + odd / longest), 1e-6)


def _calm(squares: FloatArray) -> FloatArray:
    """Weights that keep a few readings far off from ruling (Huber's, from 4 standard deviations)."""
    far = np.sqrt(np.maximum(squares, 1e-12))
    return np.where(far > 4.0, 4.0 / far, 1.0)
