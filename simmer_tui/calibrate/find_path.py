"""A rough path of the robot, by a particle filter over pose, drive biases and contacts.

Each particle is a robot with biases of its own, drawn about those of the set. Those whose biases fit survive
(Liu and West 2001 call such parameters static). Wheel encoders and the gyro, if read after each movement,
measure it better than the process model predicts it. A particle whose path leads into a wall stops there; a
few stop anywhere (the slip hypothesis).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from msgspec.structs import astuple

from simmer_tui.calibrate.geometry import SHARES, Clearance, moved, on_axes
from simmer_tui.calibrate.measured_run import Chain, MeasuredMovement, MeasuredRun
from simmer_tui.calibrate.parameters import observed_sensors
from simmer_tui.sim.arrays import BoolArray, FloatArray, IntArray
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.sensors import CountingSensor, ObservingSensor, World

# Standard deviations of the biases that particles draw. About those of strength = [0.05, 1], 0.05 and 0.5,
# and ten times as much for the rotation of turns: too narrow loses a robot, too wide wastes particles.
_BIAS_SPREAD = (0.06, 0.06, 0.4)
_TURN_BIAS_SPREAD = (0.005, 0.005, 0.03)
# Least random errors of particles, even if a set has none: they keep particles distinct.
_LEAST_ERROR = (0.02, 0.02, 0.03)
_TURN_LEAST_ERROR = (0.003, 0.003, 0.01)
_COUNTER_ERROR = 0.035
"""Relative error of a counter by its gain and noise, before either is known: gains differ by 3 %, noise is 1
to 2 %."""
_SLIPS = 0.03
"""Probability that a movement ends early without a wall on the particle's path."""
# With 300 particles, nine do so at each movement: enough to survive if it is true, and few enough otherwise.
_TEMPER = 0.6
"""Power of the likelihood, below 1 because a sensor's bias is constant: errors of its readings are not
independent."""
_JITTER = np.array((0.05, 0.05, 0.15))
"""Standard deviations, inches and degrees, by which resampled particles are moved apart: below the resolution
of ranges."""
_BIAS_JITTER = 0.05
"""The same for their biases, as a share of the spread of the drawn ones."""
_DEEPER = 0.02
"""Inches by which a particle may get deeper into a wall: less than the jitter is no contact."""

ValuesAtStops = Mapping[str, Mapping[int, tuple[float, float]]]
"""Readings by code and stop: value and time."""


@dataclass(frozen=True)
class RoughPath:
    """A chain's path by the particle filter."""

    poses: FloatArray
    """The pose at each stop, (n, 3)."""
    contacts: BoolArray
    """Movements that met a wall, (n - 1,)."""
    fit: float
    """Mean log likelihood of a reading."""


class PathFinder:
    """Finds the paths of a run's chains."""

    def __init__(self, run: MeasuredRun) -> None:
        self._run = run
        spec = run.spec
        self._spec = spec
        self._clear = Clearance(spec.maze, spec.robot)
        self._world = world_of(run)
        sensors = observed_sensors(spec).values()
        self._observers = [each for each in sensors if isinstance(each, ObservingSensor)]
        self._counters = [each for each in sensors if isinstance(each, CountingSensor)]
        self._biases = np.array([on_axes(drive.bias) for drive in spec.drives])
        self._spread = np.array([_TURN_BIAS_SPREAD if d.kind.turns else _BIAS_SPREAD for d in spec.drives])
        self._has_gyro = not all(each.slips for each in self._counters)

    def find(
        self,
        chain: Chain,
        first: int,
        count: int,
        random: np.random.Generator,
        *,
        wide: float,
        progress: Callable[[int], None] = lambda stop: None,
    ) -> RoughPath:
        """The path of a chain.

        Args:
            first: Number of the chain's first stop.
            count: Number of particles.
            wide: Factor on the spread of the start.
        """
        start, spread = np.array(astuple(chain.start)), wide * np.array(chain.spread)
        poses = start + spread * random.standard_normal((count, 3))
        # The robot stood there, so that it was not in a wall, except for the error of the walls in the set.
        free = self._clear.of(poses) > -0.3
        if free.any():
            poses = poses[random.choice(np.flatnonzero(free), count)]
        biases = self._biases + self._spread * random.standard_normal((count, *self._spread.shape))
        total = len(chain.movements)
        history = np.empty((total + 1, count, 3), np.float32)
        parents = np.empty((total + 1, count), np.int32)
        touched = np.zeros((total + 1, count), bool)
        weights = np.zeros(count)
        fits, readings = 0.0, 0
        for step in range(total + 1):
            if step:
                movement = chain.movements[step - 1]
                poses, touched[step] = self._move(movement, first + step, poses, biases, random)
            score, read = self._score(first + step, poses)
            history[step] = poses
            parents[step] = np.arange(count)
            weights += _TEMPER * score
            if read:
                best = weights.max()
                share = np.exp(weights - best)
                # Adding 1e-300 keeps the logarithm finite if no particle fits at all.
                fits += float(np.log(np.average(np.exp(score), weights=share) + 1e-300))
                readings += read
                share /= share.sum()
                # Resample at half of the effective sample size (Liu and Chen 1995).
                if 1.0 / np.square(share).sum() < count / 2 and step < total:
                    chosen = _systematic(share, random)
                    parents[step] = chosen
                    poses = poses[chosen] + _JITTER * random.standard_normal((count, 3))
                    biases = biases[chosen]
                    biases = biases + _BIAS_JITTER * self._spread * random.standard_normal(biases.shape)
                    weights = np.zeros(count)
            progress(first + step)
        index = int(weights.argmax())
        path = np.empty((total + 1, 3))
        contacts = np.zeros(total, bool)
        for step in range(total, -1, -1):
            path[step] = history[step, index]
            if step:
                contacts[step - 1] = touched[step, index]
                index = int(parents[step - 1, index])
        return RoughPath(path, contacts, fits / max(readings, 1))

    def _move(
        self,
        movement: MeasuredMovement,
        stop: int,
        poses: FloatArray,
        biases: FloatArray,
        random: np.random.Generator,
    ) -> tuple[FloatArray, BoolArray]:
        """Poses after the movement to a stop, and True for movements that a wall or a slip ended."""
        totals = self._totals(movement, stop, biases, random)
        share, met = self._share_made(movement, poses, totals, random)
        slips = random.random(len(poses)) < _SLIPS
        share = np.where(slips, share * random.random(len(poses)), share)
        # A disc continues to turn at a wall, by a velocity even while it is pressed.
        turns = movement.is_continuous or self._spec.drives[movement.drive].kind.turns
        done = share[:, None] * totals
        if self._has_gyro or (turns and self._spec.robot.radius is not None):
            done[:, 2] = totals[:, 2]
        segments, bend = movement.law(self._spec.num_segments)
        arrived = moved(poses, done, segments, np.asarray(share * bend, complex))
        if movement.is_continuous and met.any():
            left = (1.0 - share) * np.hypot(totals[:, 0], totals[:, 1])
            self._slide(arrived, met, left, random)
        if movement.certain:
            # Deeper than the errors of poses and walls: a path through a wall is impossible.
            inside = self._clear.of(arrived) < -0.5
            arrived[inside, :2] = poses[inside, :2]
        return arrived, met | slips

    def _totals(
        self, movement: MeasuredMovement, stop: int, biases: FloatArray, random: np.random.Generator
    ) -> FloatArray:
        """Totals of the movement to a stop, drawn from the process model and the counters."""
        count, drives = len(biases), self._spec.drives
        totals, spread = movement.asked(drives), np.zeros(3)
        for index, d in movement.distances(drives):
            turns = drives[index].kind.turns
            errors = np.maximum(on_axes(drives[index].error), _TURN_LEAST_ERROR if turns else _LEAST_ERROR)
            totals = totals + d * biases[:, index]
            spread = np.hypot(spread, d * errors) if spread.any() else d * errors
        totals = totals + spread * random.standard_normal((count, 3))
        counted = [
            _Increment(counter, change / (counter.spec.gain or 1.0), seconds)
            for counter, change, seconds in increments(
                self._counters, self._run.values_at_stops, stop - 1, stop
            )
        ]
        wheels = [each for each in counted if each.counter.slips]
        gyro = next((each for each in counted if not each.counter.slips), None)
        # Three wheels determine all three totals; two leave one to the process model alone.
        if len(wheels) >= 3:
            totals = _by_wheels(wheels, totals, np.abs(spread), random)
        if gyro is not None:
            turn = gyro.amount / gyro.counter.lever[2]
            # In addition to the gain: 0.3 degrees for rounding, and an unknown drift of 0.05 degrees a
            # second.
            spread = _COUNTER_ERROR * abs(turn) + 0.3 + 0.05 * gyro.seconds
            totals[:, 2] = turn + spread * random.standard_normal(count)
        return totals

    def _share_made(
        self, movement: MeasuredMovement, poses: FloatArray, totals: FloatArray, random: np.random.Generator
    ) -> tuple[FloatArray, BoolArray]:
        """Share of its movement that each particle makes, and True for those that meet a wall."""
        count = len(poses)
        share = np.ones(count)
        # Without an answer half of the particles do not move, and the others move nearly all of the distance:
        # the fifth root of a uniform number is above 0.87 in half of the cases.
        if not movement.certain:
            share = random.choice((0.0, 1.0), count) * random.random(count) ** 0.2
        segments, bend = movement.law(self._spec.num_segments)
        clear = self._clear.along(poses, totals, segments, bend)
        # A particle that overlaps a wall slightly may move along it, and away from it.
        blocked = clear < np.minimum(self._clear.of(poses), 0.0)[:, None] - _DEEPER
        met = np.asarray(blocked.any(axis=1))
        if met.any():
            reached = np.where(met, np.concatenate(([0.0], SHARES))[blocked.argmax(axis=1)], 1.0)
            reached += np.where(met, random.random(count) / len(SHARES), 0.0)
            share = np.minimum(share, reached)
        return share, met

    def _slide(
        self, poses: FloatArray, met: BoolArray, left: FloatArray, random: np.random.Generator
    ) -> None:
        """Let robots that a velocity presses against a wall slide along it, by up to the remaining distance,
        to any place that is no deeper in a wall."""
        there = poses.copy()
        there[:, :2] += left[:, None] * random.uniform(-1.0, 1.0, (len(poses), 2))
        kept = met & (self._clear.of(there) >= np.minimum(self._clear.of(poses), 0.0) - _DEEPER)
        poses[kept] = there[kept]

    def _score(self, stop: int, poses: FloatArray) -> tuple[FloatArray, int]:
        """Log likelihoods of the readings at a stop, and the number of readings."""
        score = np.zeros(len(poses))
        read = 0
        for sensor, value, _ in observed(self._run, self._observers, self._run.values_at_stops, stop):
            expected = sensor.expected(self._world, poses, 0.0)
            # If nothing is in range, a reading has the largest error: 1,000 is beyond any maze.
            expected = np.where(np.isfinite(expected), expected, 1e3)
            score += np.log(sensor.rough_likelihood(value, expected))
            read += 1
        return score, read


@dataclass(frozen=True, slots=True)
class _Increment:
    """The increment of a counter in some seconds, divided by the set's gain."""

    counter: CountingSensor
    amount: float
    seconds: float


def _by_wheels(
    wheels: list[_Increment], totals: FloatArray, spread: FloatArray, random: np.random.Generator
) -> FloatArray:
    """Totals drawn from the counts of wheels, and from the process model in directions in which no wheel
    rolls: a Kalman update."""
    levers = np.array([each.counter.lever for each in wheels])
    counted = np.array([each.amount for each in wheels])
    # 0.03 in is a wheel's rounding. The process model has half the weight: its bias is not known yet.
    noise = (_COUNTER_ERROR * np.abs(counted) + 0.03) ** 2
    # At least a thousandth of an inch, so that the matrix stays regular for a movement by 0.
    prior = np.diag(np.maximum(2.0 * spread, 1e-3) ** 2)
    gain = prior @ levers.T @ np.linalg.inv(levers @ prior @ levers.T + np.diag(noise))
    off = counted + np.sqrt(noise) * random.standard_normal((len(totals), len(counted))) - totals @ levers.T
    return np.asarray(totals + off @ gain.T)


def _systematic(share: FloatArray, random: np.random.Generator) -> IntArray:
    """Systematic resampling: the copies of each differ from its share by less than one."""
    places = (np.arange(len(share)) + random.random()) / len(share)
    return np.minimum(np.searchsorted(np.cumsum(share), places), len(share) - 1)


def world_of(run: MeasuredRun) -> World:
    """The world that sensors see: the maze, and the block at its place in the set."""
    return World(Maze(run.spec.maze), run.spec.start_block)


def increments(
    counters: Iterable[CountingSensor], values: ValuesAtStops, before: int, after: int
) -> Iterator[tuple[CountingSensor, float, float]]:
    """The counters that were read at two stops, each with its increment and the seconds between."""
    for counter in counters:
        said = values.get(counter.spec.code, {})
        if before in said and after in said:
            change = counter.change(said[before], said[after])
            if math.isfinite(change):
                yield counter, change, said[after][1] - said[before][1]


def observed(
    run: MeasuredRun, sensors: Iterable[ObservingSensor], values: ValuesAtStops, stop: int
) -> Iterator[tuple[ObservingSensor, float, float]]:
    """The sensors whose view at a stop is known, each with its finite reading there: value and time."""
    for sensor in sensors:
        value, time = values.get(sensor.spec.code, {}).get(stop, (math.nan, math.nan))
        if math.isfinite(value) and is_known_to(run, sensor, stop):
            yield sensor, value, time


def is_known_to(run: MeasuredRun, sensor: ObservingSensor, stops: IntArray | int) -> BoolArray:
    """True at stops where the view of a sensor is known: a moved block may be anywhere."""
    sees_it = run.block_moved_at is not None and sensor.sees_block(run.spec.block_size)
    return np.asarray(stops) <= (run.block_moved_at if sees_it else np.inf)
