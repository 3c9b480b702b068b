"""How well a set predicts readings that it was not made from.

An extended Kalman filter follows the robot through the stretch that was held back, once with each set, and
says before each reading what it will be: from everything before but the reading itself (0 movements
ahead), from the stop before (1), or from five stops before, by the commands alone. Counters are predicted
as what they add since then.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from simmer_tui.calibrate.drive_law import moved
from simmer_tui.calibrate.find_path import trusted, world_of
from simmer_tui.calibrate.fit import Fit, fit_path, fit_tail, refit
from simmer_tui.calibrate.measured_run import MeasuredRun
from simmer_tui.calibrate.row_stack import State
from simmer_tui.calibrate.wall_clearance import SHARES, Clearance
from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.sensors import RangeSensor, Sensor, sensor_of
from simmer_tui.sim.sensors.counters import Odometer
from simmer_tui.sim.specs import SimulationSpec

AHEAD = (0, 1, 5)
"""Movements ahead."""
HELD_BACK = 0.25
"""The part of the movements, at the end, that is held back."""
_LEAST = 5
"""Movements held back below which nothing is said."""
_STEPS = np.diag((0.1, 0.1, 0.5))
_GATE = 4.0
_ENOUGH, _FAR_OFF, _SEARCHED, _AROUND = 3, 2, 600, np.array((0.7, 0.7, 2.0))
"""Ranges that it takes to find the pose again, how many of them must be far off for that, poses looked
at, and how far around (standard deviations, inches and degrees, beyond the filter's own)."""
_BETTER = 6.0
"""By how much the log likelihood of a pose found must be better to be believed."""

Errors = dict[tuple[str, int], list[float]]
"""By kind of sensor and movements ahead: sizes of errors."""


@dataclass(frozen=True)
class HeldBack:
    """Median absolute errors of predictions, by kind of sensor and movements ahead, in its unit: with the
    set as it was, and with what was learned from the first part alone."""

    movements: int
    learned: Fit
    """What the movements before tell."""
    before: dict[tuple[str, int], float]
    after: dict[tuple[str, int], float]
    counts: dict[tuple[str, int], int]


def held_back(fit: Fit) -> HeldBack | None:
    """Learn from the first part, and predict the rest, up to the end of the last way that is long enough.
    None if none is."""
    ways = zip(fit.run.first_stops(), fit.run.chains, strict=True)
    long = [(first, len(c.movements)) for first, c in ways if len(c.movements) * HELD_BACK >= _LEAST]
    if not long:
        return None
    first, length = long[-1]
    count = int(length * HELD_BACK)
    run = fit.run.before_stop(first + length)
    last = run.stops - 1 - count
    learned = refit(fit, run.before_stop(last))
    spec = run.spec
    after = prediction_errors(run, fit, last, learned.state.places, learned.state.sizes, learned.state)
    before = prediction_errors(run, fit, last, *fit.unknowns.of(spec), learned.state)
    keys = [key for key in after if key in before]
    return HeldBack(
        count,
        learned,
        {key: float(np.median(before[key])) for key in keys},
        {key: float(np.median(after[key])) for key in keys},
        {key: len(after[key]) for key in keys},
    )


def prediction_errors(
    run: MeasuredRun, fit: Fit, last: int, places: FloatArray, sizes: FloatArray, rough: State
) -> Errors:
    """Errors of predictions after stop `last` by a set with these parameters. `rough` is a path up to
    there from which that under the set is found."""
    early = run.before_stop(last)
    path = fit_path(early, fit.unknowns, places, sizes, rough)
    pose, covariance = fit_tail(early, fit.unknowns, path)
    follower = Follower(run, fit.unknowns.laid_over(run.spec, places, sizes), pose, covariance, last)
    for stop in range(last + 1, run.stops):
        follower.go_on(stop)
    return follower.errors


@dataclass
class Follower:
    """An extended Kalman filter of the pose, from stop `begin` on. What is read and done later may be
    added to `said` (by code and stop: value and time) and `movements` (by the stop they lead to)."""

    run: MeasuredRun
    spec: SimulationSpec
    pose: FloatArray
    covariance: FloatArray
    begin: int
    errors: Errors = field(default_factory=lambda: defaultdict(list))

    def __post_init__(self) -> None:
        run = self.run
        self.world = world_of(run)
        self.clear = Clearance(self.spec.maze, self.spec.robot)
        self.sensors = {each.code: sensor_of(each) for each in self.spec.sensors if each.enabled}
        self.said: dict[str, dict[int, tuple[float, float]]] = {}
        for code, each in run.readings.items():
            rows = zip(each.stops.tolist(), each.values.tolist(), each.times.tolist(), strict=True)
            self.said[code] = {stop: (value, time) for stop, value, time in rows}
        self.poses = {self.begin: self.pose}
        self._came_from = self.pose
        self._turn_counted = False
        """Whether a gyro told the last turn, so that the heading is known even where the way is not."""
        self._random = np.random.default_rng(self.begin)
        offset = run.stops - 1 - len(run.chains[-1].movements)
        self.movements = {offset + k + 1: m for k, m in enumerate(run.chains[-1].movements)}

    def go_on(self, stop: int) -> None:
        """Predict what is read at the next stop, and take it in."""
        for ahead in AHEAD[1:]:
            if stop - ahead >= self.begin:
                self._predict_from(stop - ahead, stop, ahead)
        self._move(stop)
        self.look(stop)
        self.poses[stop] = self.pose

    def _law(self, stop: int) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of the totals of the movement to a stop."""
        movement = self.movements[stop]
        drive = self.spec.drives[movement.drive]
        direction = drive.kind.direction
        asked = movement.value * np.array((direction.x, direction.y, direction.r))
        bias = np.array((drive.bias.x, drive.bias.y, drive.bias.r))
        error = np.array((drive.error.x, drive.error.y, drive.error.r))
        d = asked.sum()
        return asked + d * bias, np.diag((d * (1.0 + bias) * error) ** 2 + 1e-8)

    def _arrive(self, pose: FloatArray, totals: FloatArray) -> tuple[FloatArray, float]:
        """Where totals lead from a pose, as far as walls let it; and what was left of the way."""
        segments = self.spec.num_segments
        clear = self.clear.along(pose[None], totals[None], segments)[0]
        share, least = 1.0, min(float(self.clear.of(pose[None])[0]), 0.0) - 0.05
        if (clear < least).any() and np.hypot(*totals[:2]) > 0.05:
            first = int((clear < least).argmax())
            past = clear[first - 1] if first else 0.0
            part = past / (past - clear[first]) if past > clear[first] else 0.0
            share = float(([0.0, *SHARES][first]) + max(part, 0.0) / len(SHARES))
        done = totals * np.array((share, share, 1.0 if share == 1.0 else max(share, 0.0)))
        return moved(pose[None], done[None], segments)[0], 1.0 - share

    def _predict_from(self, origin: int, stop: int, ahead: int) -> None:
        pose, planned = self.poses[origin], np.zeros(3)
        turned = 0.0
        wheels: list[FloatArray] = []
        for step in range(origin + 1, stop + 1):
            totals, _ = self._law(step)
            there, _ = self._arrive(pose, totals)
            turned += there[2] - pose[2]
            wheels.append(totals)
            planned += totals
            pose = there
        for code, sensor in self.sensors.items():
            spoken = self.said.get(code, {}).get(stop)
            if spoken is None or not np.isfinite(spoken[0]):
                continue
            if sensor.counts:
                begin = self.said[code].get(origin)
                if begin is not None and np.isfinite(begin[0]):
                    self._note(sensor, ahead, _change(sensor, begin, spoken, wheels, turned))
            elif isinstance(sensor, RangeSensor) or sensor.spec.kind.name == "comp":
                seen = self._seen(sensor, pose[None], spoken[1], stop)[0]
                self._note(sensor, ahead, spoken[0] - seen)

    def _move(self, stop: int) -> None:
        """The movement, as far as law and counters tell it."""
        totals, spread = self._law(stop)
        observed: list[tuple[Sensor, FloatArray, float, float]] = []
        for code, sensor in self.sensors.items():
            said = self.said.get(code, {})
            if not sensor.counts or stop not in said or stop - 1 not in said:
                continue
            (value, begin), (later, end) = said[stop - 1], said[stop]
            spec = sensor.spec
            change = later - value - spec.drift * (end - begin)
            if spec.wrap:
                change = (change + spec.wrap / 2) % spec.wrap - spec.wrap / 2
            if not np.isfinite(change):
                continue
            lever = _lever(sensor)
            part = spec.gain * lever * totals
            floor = 0.002 if isinstance(sensor, Odometer) else 0.003
            variance = (spec.error**2) * float((part**2).sum()) / self.spec.num_segments + floor**2
            variance += spec.random_walk**2 * (end - begin)
            observed.append((sensor, spec.gain * lever, change, variance))
        for number, (sensor, lever, change, _) in enumerate(observed):
            others = [each for k, each in enumerate(observed) if k != number]
            mean, _ = _updated(totals, spread, others)
            self._note(sensor, 0, float(change - lever @ mean))
        _, left = self._arrive(self.pose, totals)
        gyros = [each for each in observed if not isinstance(each[0], Odometer)]
        if not self.movements[stop].certain:
            spread = spread + np.diag(totals**2)
        mean, spread = _updated(totals, spread, observed)
        arrived, left = self._arrive(self.pose, mean)
        turn = self.pose[2]
        if left and gyros:
            arrived[2] = turn + gyros[0][2] / gyros[0][1][2]
        self._came_from, self._turn_counted = self.pose, bool(gyros)
        jacobian = np.eye(3)
        away = arrived[:2] - self.pose[:2]
        jacobian[:2, 2] = np.radians((-away[1], away[0]))
        angle = np.radians((turn + arrived[2]) / 2)
        frame = np.eye(3)
        frame[:2, :2] = ((np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle)))
        self.covariance = jacobian @ self.covariance @ jacobian.T + frame @ spread @ frame.T
        if left:
            self.covariance += np.diag((0.3 + 0.2 * left, 0.3 + 0.2 * left, 0.3)) ** 2
        self.pose = arrived

    def look(self, stop: int) -> None:
        """Ranges and compass: predict each from the others, and take all in."""
        self._find_again(stop)
        rows: list[tuple[Sensor, float, FloatArray, float]] = []
        for code, sensor in self.sensors.items():
            spoken = self.said.get(code, {}).get(stop)
            if sensor.counts or spoken is None or not np.isfinite(spoken[0]):
                continue
            ranging = isinstance(sensor, RangeSensor)
            if not (ranging or sensor.spec.kind.name == "comp"):
                continue
            places = np.concatenate((self.pose[None], self.pose + _STEPS, self.pose - _STEPS))
            seen = self._seen(sensor, places, spoken[1], stop)
            if not np.isfinite(seen).all():
                continue
            slope = (seen[1:4] - seen[4:]) / (2 * np.diag(_STEPS))
            bends = float((0.5 * np.abs(seen[1:4] + seen[4:] - 2 * seen[0])).max()) ** 2
            spec = sensor.spec
            variance = (spec.error * (seen[0] - spec.bias)) ** 2 + spec.absolute_error**2 + bends + 4e-4
            off = spoken[0] - seen[0]
            if not ranging:
                off = (off + 180.0) % 360.0 - 180.0
            rows.append((sensor, float(off), slope, variance))
        prior = np.linalg.inv(self.covariance)
        # Readings far from anything expected say nothing of the pose.
        kept = [row for row in rows if row[1] ** 2 < _GATE**2 * (row[3] + row[2] @ self.covariance @ row[2])]
        information = prior + sum(np.outer(g, g) / v for _, _, g, v in kept)
        score = sum((g * off / v for _, off, g, v in kept), np.zeros(3))
        for row in rows:
            sensor, off, slope, variance = row
            among = any(row is each for each in kept)
            own = np.outer(slope, slope) / variance if among else 0.0
            others = np.linalg.solve(information - own, score - (slope * off / variance if among else 0.0))
            self._note(sensor, 0, float(off - slope @ others))
        self.covariance = np.linalg.inv(information)
        self.pose = self.pose + self.covariance @ score

    def _find_again(self, stop: int) -> None:
        """Where several ranges are far from what was expected, as after a wall that was met sooner than
        thought, look for the pose around, and anywhere on the way: a filter of one pose never comes back
        by itself."""
        heard = [
            (sensor, self.said[code][stop])
            for code, sensor in self.sensors.items()
            if (isinstance(sensor, RangeSensor) or sensor.spec.kind.name == "comp")
            and stop in self.said.get(code, {})
            and np.isfinite(self.said[code][stop][0])
        ]
        ranging = np.array([isinstance(sensor, RangeSensor) for sensor, _ in heard], bool)
        if ranging.sum() < _ENOUGH:
            return
        away, _ = self._fits(heard, self.pose[None], stop)
        if (np.abs(away[ranging, 0]) > _GATE).sum() < _FAR_OFF:
            return
        # First widely, then about those that fit best; the pose as it is stays among them.
        poses = self._thinkable()
        for finer in (0.15, 0.05):
            _, score = self._fits(heard, poses, stop)
            share = np.exp(score - score.max())
            chosen = self._random.choice(len(poses), _SEARCHED - 1, p=share / share.sum())
            jitter = finer * np.array((1.0, 1.0, 2.0)) * self._random.standard_normal((len(chosen), 3))
            poses = np.concatenate((self.pose[None], poses[chosen] + jitter))
        _, score = self._fits(heard, poses, stop)
        best = int(score.argmax())
        if score[best] - score[0] < _BETTER:
            return
        near = np.hypot(*(poses[:, :2] - poses[best, :2]).T) < 1.0
        share = np.where(near, np.exp(score - score[best]), 0.0)
        share /= share.sum()
        self.pose = share @ poses
        off = poses - self.pose
        self.covariance = (off * share[:, None]).T @ off + np.diag((0.1, 0.1, 0.5)) ** 2

    def _thinkable(self) -> FloatArray:
        """Where the robot may be if it is not where it is thought to be: around, and on the way there."""
        noise = self._random.standard_normal((_SEARCHED, 3))
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
        self, heard: list[tuple[Sensor, tuple[float, float]]], poses: FloatArray, stop: int
    ) -> tuple[FloatArray, FloatArray]:
        """By how many standard deviations each reading is off at each pose, and the poses' log
        likelihoods, outliers allowed for."""
        score, off = np.zeros(len(poses)), np.zeros((len(heard), len(poses)))
        for number, (sensor, (value, time)) in enumerate(heard):
            seen = self._seen(sensor, poses, time, stop)
            away = value - seen
            if isinstance(sensor, RangeSensor):
                sigma = np.hypot(sensor.spec.error * np.abs(seen), sensor.spec.absolute_error + 0.1)
            else:
                away = (away + 180.0) % 360.0 - 180.0
                sigma = np.full(len(poses), max(sensor.spec.absolute_error, 1.0))
                sigma = np.hypot(sigma, sensor.spec.error * np.abs(poses[:, 2]))
            away = np.where(np.isfinite(seen), away / sigma, 50.0)
            score += np.log(0.95 * np.exp(-0.5 * np.minimum(away**2, 500.0)) / sigma + 1e-3)
            off[number] = away
        return off, score

    def _seen(self, sensor: Sensor, poses: FloatArray, time: float, stop: int) -> FloatArray:
        """What an observing sensor would say without random errors."""
        spec = sensor.spec
        if isinstance(sensor, RangeSensor):
            if not trusted(self.run, sensor, stop):
                return np.full(len(poses), np.nan)
            true = sensor.ranges(self.world, poses)
        else:
            true = poses[:, 2] + spec.rotation
            angle = np.radians(true)
            true = true + spec.hard_iron * np.sin(angle) + spec.soft_iron * np.sin(2 * angle)
        return spec.gain * true + spec.bias + spec.drift * time

    def _note(self, sensor: Sensor, ahead: int, off: float) -> None:
        if sensor.spec.kind.name in ("comp", "gyro"):
            off = (off + 180.0) % 360.0 - 180.0
        if np.isfinite(off):
            self.errors[sensor.spec.kind.name, ahead].append(abs(off))


def _lever(sensor: Sensor) -> FloatArray:
    """What a counter counts of each inch ahead, inch aside, and degree."""
    unit = np.eye(3)
    return np.array([sensor.counted_on(u[2], u[0], u[1]) for u in unit])  # type: ignore[attr-defined]


def _change(
    sensor: Sensor,
    begin: tuple[float, float],
    end: tuple[float, float],
    wheels: list[FloatArray],
    turned: float,
) -> float:
    """How far what a counter added is off what was expected of it."""
    spec = sensor.spec
    lever = _lever(sensor)
    counted = sum(float(lever @ each) for each in wheels) if isinstance(sensor, Odometer) else turned
    off = end[0] - begin[0] - spec.gain * counted - spec.drift * (end[1] - begin[1])
    return float((off + spec.wrap / 2) % spec.wrap - spec.wrap / 2) if spec.wrap else float(off)


def _updated(
    mean: FloatArray, spread: FloatArray, observed: list[tuple[Sensor, FloatArray, float, float]]
) -> tuple[FloatArray, FloatArray]:
    """A Kalman update of totals by what counters counted of them."""
    if not observed:
        return mean, spread
    levers = np.array([lever for _, lever, _, _ in observed])
    noise = np.diag([variance for _, _, _, variance in observed])
    off = np.array([change for _, _, change, _ in observed]) - levers @ mean
    gain = spread @ levers.T @ np.linalg.inv(levers @ spread @ levers.T + noise)
    return mean + gain @ off, spread - gain @ levers @ spread
