"""An extended Kalman filter of the pose, which predicts readings before it uses them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Set
from dataclasses import dataclass, field

import numpy as np

from simmer_tui.calibrate.find_path import increments, observed, world_of
from simmer_tui.calibrate.geometry import SHARES, Clearance, moved, on_axes
from simmer_tui.calibrate.measured_run import MeasuredRun
from simmer_tui.calibrate.parameters import observed_sensors
from simmer_tui.calibrate.stretches import REFERENCES
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.sensors import CountingSensor, ObservingSensor, Sensor
from simmer_tui.sim.specs import SensorKind, SimulationSpec

AHEAD = (0, 1, 5)
"""Movements ahead that are predicted: the reading itself, the next stop, and a short path."""
_STEPS = np.diag((0.1, 0.1, 0.5))
"""Differences in pose, inches and degrees, over which derivatives are taken: about the precision of the
filter's pose."""
_GATE = 4.0
"""Standard deviations beyond which a reading does not update the pose: 1 normal reading in 16,000 is beyond,
and most outliers are."""
_ENOUGH, _FAR_OFF = 3, 2
"""Least number of ranges for a search for a lost pose, and of ranges beyond the gate: three ranges determine
a pose, and a single one beyond the gate is an outlier."""
_SEARCHED = 600
"""Poses tried in each round of the search: a fifth of an inch apart, then finer."""
_AROUND = np.array((0.7, 0.7, 2.0))
"""Standard deviations of the tried poses, inches and degrees, in addition to the filter's own: its error
after a missed contact."""
_BETTER = 6.0
"""Least gain in log likelihood of a found pose: with 600 independent tries, log 600 = 6.4 would occur by
chance, and the tries are not independent."""

PredictionErrors = dict[tuple[type[SensorKind], int], list[float]]
"""Absolute errors by kind of sensor and movements ahead."""


@dataclass
class PoseFilter:
    """An extended Kalman filter of the pose, from stop `begin` on. Later readings and movements may be added
    to `values_at_stops` (by code and stop: value and time) and `movements` (by the stop they lead to)."""

    run: MeasuredRun
    spec: SimulationSpec
    pose: FloatArray
    covariance: FloatArray
    begin: int
    errors: PredictionErrors = field(default_factory=lambda: defaultdict(list))
    free: Set[int] = frozenset()
    """Stops that were reached without a contact; counters have scores at these."""
    scores: dict[type[SensorKind], list[float]] = field(default_factory=lambda: defaultdict(list))
    """Errors of readings, predicted from the others at their stop, in standard deviations, by kind."""

    def __post_init__(self) -> None:
        run = self.run
        self.world = world_of(run)
        self.clear = Clearance(self.spec.maze, self.spec.robot)
        sensors = observed_sensors(self.spec).values()
        self._counters = [each for each in sensors if isinstance(each, CountingSensor)]
        self._observers = [each for each in sensors if isinstance(each, ObservingSensor)]
        self.values_at_stops = {code: dict(each) for code, each in run.values_at_stops.items()}
        self.poses = {self.begin: self.pose}
        self._came_from = self.pose
        self._turn_counted = False
        """True if a gyro counted the last turn, so that the heading is known even if the path is not."""
        self._random = np.random.default_rng(self.begin)
        offset = run.stops - 1 - len(run.chains[-1].movements)
        self.movements = {offset + k + 1: m for k, m in enumerate(run.chains[-1].movements)}

    def advance(self, stop: int) -> None:
        """Predict the readings at the next stop, then update with them."""
        for ahead in AHEAD[1:]:
            if stop - ahead >= self.begin:
                self._predict_from(stop - ahead, stop)
        self._move(stop)
        self.look(stop)
        self.poses[stop] = self.pose

    def _process_model(self, stop: int) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of the totals of the movement to a stop."""
        movement, drives = self.movements[stop], self.spec.drives
        # 1e-8 keeps the covariance regular if a movement by 0 has no error.
        mean, variances = movement.asked(drives), np.full(3, 1e-8)
        for index, distance in movement.distances(drives):
            mean = mean + distance * on_axes(drives[index].bias)
            variances += movement.spread(drives, index, distance) ** 2
        return mean, np.diag(variances)

    def _arrive(self, pose: FloatArray, totals: FloatArray, stop: int) -> tuple[FloatArray, float]:
        """The pose to which totals of the movement to a stop lead, cut at walls, and the remaining share of
        the movement."""
        segments, bend = self.movements[stop].law(self.spec.num_segments)
        clear = self.clear.along(pose[None], totals[None], segments, bend)[0]
        # 0.05 in is the error of poses at a wall; shorter movements are not tested.
        share, least = 1.0, min(float(self.clear.of(pose[None])[0]), 0.0) - 0.05
        if (clear < least).any() and np.hypot(*totals[:2]) > 0.05:
            first = int((clear < least).argmax())
            past = clear[first - 1] if first else 0.0
            part = max(past / (past - clear[first]), 0.0)  # 0 if the robot stands in the wall
            share = float(([0.0, *SHARES][first]) + part / len(SHARES))
        return moved(pose[None], share * totals[None], segments, share * bend)[0], 1.0 - share

    def _predict_from(self, origin: int, stop: int) -> None:
        """Predict the readings at a stop from the pose at an earlier one, and note the errors."""
        pose, ahead, turned = self.poses[origin], stop - origin, 0.0
        wheels: list[FloatArray] = []
        for step in range(origin + 1, stop + 1):
            wheels.append(self._process_model(step)[0])
            there, _ = self._arrive(pose, wheels[-1], step)
            turned += there[2] - pose[2]
            pose = there
        for counter, change, _ in increments(self._counters, self.values_at_stops, origin, stop):
            counted = float(counter.lever[2] * turned)
            if counter.slips:
                counted = sum(float(counter.lever @ each) for each in wheels)
            self._note(counter, ahead, counter.wrapped(change - counter.spec.gain * counted))
        for sensor, value, time in self._observed(stop):
            self._note(sensor, ahead, value - sensor.expected(self.world, pose[None], time)[0])

    def _observed(self, stop: int) -> Iterator[tuple[ObservingSensor, float, float]]:
        return observed(self.run, self._observers, self.values_at_stops, stop)

    def _counted(self, stop: int) -> list[_Counted]:
        """Increments of the counters over the movement to a stop."""
        totals, _ = self._process_model(stop)
        found = []
        for counter, change, seconds in increments(self._counters, self.values_at_stops, stop - 1, stop):
            spec = counter.spec
            part = spec.gain * counter.lever * totals
            squares = part**2
            if self.movements[stop].is_continuous:
                squares = np.abs(part * spec.gain * counter.lever) * REFERENCES
            variance = (spec.error**2) * float(squares.sum()) / self.spec.num_segments
            variance += counter.least_error**2
            variance += counter.random_walk**2 * seconds
            found.append(_Counted(counter, spec.gain * counter.lever, change, variance))
        return found

    def _move(self, stop: int) -> None:
        """Propagate the pose by the process model and the counters."""
        totals, spread = self._process_model(stop)
        observed = self._counted(stop)
        for each in observed:
            mean, covariance = _updated(totals, spread, [other for other in observed if other is not each])
            # Wheels of a robot at a wall do not match the turn that it made.
            known = stop in self.free
            deviation = np.sqrt(each.variance + each.slope @ covariance @ each.slope) if known else 0.0
            self._note(each.counter, 0, float(each.change - each.slope @ mean), float(deviation))
        gyro = next((each for each in observed if not each.counter.slips), None)
        if not self.movements[stop].certain:
            # Made in full or not at all: its whole length is its standard deviation.
            spread = spread + np.diag(totals**2)
        mean, spread = _updated(totals, spread, observed)
        before = self.pose
        arrived, left = self._arrive(before, mean, stop)
        if left and gyro is not None:
            arrived[2] = before[2] + gyro.change / gyro.slope[2]
        self._came_from, self._turn_counted = before, gyro is not None
        self._propagate(before, arrived, spread)
        if left:
            # At a wall a robot stops some 0.3 in off the clearance model, more after a long push.
            self.covariance += np.diag((0.3 + 0.2 * left, 0.3 + 0.2 * left, 0.3)) ** 2
        self.pose = arrived

    def _propagate(self, before: FloatArray, arrived: FloatArray, spread: FloatArray) -> None:
        """Set the covariance after a movement whose totals have the covariance `spread`."""
        jacobian = np.eye(3)
        away = arrived[:2] - before[:2]
        jacobian[:2, 2] = np.radians((-away[1], away[0]))
        # Totals are along the robot's axes: those in the middle of the turn.
        angle = np.radians((before[2] + arrived[2]) / 2)
        frame = np.eye(3)
        frame[:2, :2] = ((np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle)))
        self.covariance = jacobian @ self.covariance @ jacobian.T + frame @ spread @ frame.T

    def look(self, stop: int) -> None:
        """Observations: predict each from the others, and update by all."""
        self._find_again(stop)
        innovations = self._innovations(stop)
        prior = np.linalg.inv(self.covariance)
        # Readings far from their expected values have no information on the pose.
        kept = [each for each in innovations if each.within(_GATE, self.covariance)]
        information = prior + sum(each.information for each in kept)
        score = sum((each.score for each in kept), np.zeros(3))
        for each in innovations:
            own, mine = (each.information, each.score) if each in kept else (0.0, 0.0)
            others = np.linalg.inv(information - own)
            deviation = np.sqrt(each.variance + each.slope @ others @ each.slope)
            off = each.off - each.slope @ others @ (score - mine)
            self._note(each.sensor, 0, float(off), float(deviation))
        self.covariance = np.linalg.inv(information)
        self.pose = self.pose + self.covariance @ score

    def _innovations(self, stop: int) -> list[_Innovation]:
        """Observations at a stop, linearised about the pose."""
        found = []
        around = np.concatenate((self.pose[None], self.pose + _STEPS, self.pose - _STEPS))
        for sensor, value, time in self._observed(stop):
            seen = sensor.expected(self.world, around, time)
            if not np.isfinite(seen).all():
                continue
            slope = (seen[1:4] - seen[4:]) / (2 * np.diag(_STEPS))
            bends = float((0.5 * np.abs(seen[1:4] + seen[4:] - 2 * seen[0])).max()) ** 2
            spec = sensor.spec
            # 4e-4 is 0.02 squared, in or degrees: no reading is more exact than that.
            variance = (spec.error * (seen[0] - spec.bias)) ** 2 + spec.absolute_error**2 + bends + 4e-4
            off = sensor.wrapped(float(value - seen[0]))
            found.append(_Innovation(sensor, off, slope, variance))
        return found

    def _find_again(self, stop: int) -> None:
        """Search for a lost pose if several ranges are far from their expected values.

        That happens after an unexpectedly early contact. Poses around and on the path are tried, since a
        filter with one pose never recovers by itself.
        """
        readings = [*self._observed(stop)]
        ranging = np.array([sensor.spec.kind.is_range for sensor, *_ in readings], bool)
        if ranging.sum() < _ENOUGH:
            return
        away, _ = self._fits(readings, self.pose[None])
        if (np.abs(away[ranging, 0]) > _GATE).sum() < _FAR_OFF:
            return
        # First widely, then around those that fit best, to 0.15 in and to 0.05 in; the present pose is always
        # among them.
        poses = self._candidates()
        for finer in (0.15, 0.05):
            _, score = self._fits(readings, poses)
            share = np.exp(score - score.max())
            chosen = self._random.choice(len(poses), _SEARCHED - 1, p=share / share.sum())
            jitter = finer * np.array((1.0, 1.0, 2.0)) * self._random.standard_normal((len(chosen), 3))
            poses = np.concatenate((self.pose[None], poses[chosen] + jitter))
        _, score = self._fits(readings, poses)
        best = int(score.argmax())
        if score[best] - score[0] < _BETTER:
            return
        # Poses an inch off fit because of symmetry.
        near = np.hypot(*(poses[:, :2] - poses[best, :2]).T) < 1.0
        share = np.where(near, np.exp(score - score[best]), 0.0)
        share /= share.sum()
        self.pose = share @ poses
        off = poses - self.pose
        self.covariance = (off * share[:, None]).T @ off + _STEPS**2

    def _candidates(self) -> FloatArray:
        """Candidate poses of a lost robot: around the filter's, and on the path there."""
        noise = self._random.standard_normal((_SEARCHED, 3))
        # A heading that a gyro counted needs a third of the width. Judged.
        turned = np.array((1.0, 1.0, 0.3 if self._turn_counted else 1.0))
        spread = np.sqrt(np.diag(self.covariance)) * 2 + _AROUND * turned
        around: FloatArray = self.pose + spread * noise
        around[0] = self.pose
        before = around[_SEARCHED // 2 :]
        back = self._random.random(len(before))[:, None] * (self._came_from - self.pose)
        before[:, :2] += back[:, :2]
        if not self._turn_counted:
            before[:, 2] += back[:, 2]
        return around

    def _fits(
        self, readings: list[tuple[ObservingSensor, float, float]], poses: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Error of each reading at each pose, in standard deviations, (readings, poses), and the poses' log
        likelihoods, with outliers."""
        score, off = np.zeros(len(poses)), np.zeros((len(readings), len(poses)))
        for number, (sensor, value, time) in enumerate(readings):
            seen = sensor.expected(self.world, poses, time)
            sigma = sensor.model_error(seen, poses)
            # If nothing is in range, a reading has the largest error: 50 standard deviations.
            away = np.where(np.isfinite(seen), sensor.wrapped(value - seen) / sigma, 50.0)
            # One reading in twenty may fit no pose: 1e-3 limits its effect on the score. exp(-250) does not
            # underflow.
            score += np.log(0.95 * np.exp(-0.5 * np.minimum(away**2, 500.0)) / sigma + 1e-3)
            off[number] = away
        return off, score

    def _note(self, sensor: Sensor, ahead: int, off: float, deviation: float = 0.0) -> None:
        """Note an error of a prediction, with its expected standard deviation, if that is known."""
        kind = sensor.spec.kind
        if kind.unit == "deg":
            off = half_turn(off)
        if np.isfinite(off):
            self.errors[kind, ahead].append(abs(off))
            if deviation:
                self.scores[kind].append(abs(off) / deviation)


@dataclass(frozen=True, slots=True)
class _Counted:
    """A counter's increment over a movement, its derivatives by the totals, (3,), and its variance."""

    counter: CountingSensor
    slope: FloatArray
    change: float
    variance: float


@dataclass(frozen=True, slots=True, eq=False)
class _Innovation:
    """A reading's difference from what was expected, its derivatives by the pose, (3,), and its variance."""

    sensor: ObservingSensor
    off: float
    slope: FloatArray
    variance: float

    @property
    def information(self) -> FloatArray:
        return np.outer(self.slope, self.slope) / self.variance

    @property
    def score(self) -> FloatArray:
        return self.slope * self.off / self.variance

    def within(self, gate: float, covariance: FloatArray) -> bool:
        """True if it is at most `gate` standard deviations."""
        return bool(self.off**2 < gate**2 * (self.variance + self.slope @ covariance @ self.slope))


def _updated(mean: FloatArray, spread: FloatArray, observed: list[_Counted]) -> tuple[FloatArray, FloatArray]:
    """A Kalman update of totals by counters."""
    if not observed:
        return mean, spread
    slopes = np.array([each.slope for each in observed])
    noise = np.diag([each.variance for each in observed])
    off = np.array([each.change for each in observed]) - slopes @ mean
    gain = spread @ slopes.T @ np.linalg.inv(slopes @ spread @ slopes.T + noise)
    return mean + gain @ off, spread - gain @ slopes @ spread
