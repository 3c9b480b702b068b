"""Where the robot went, roughly: a particle filter over pose, drive biases and contacts.

Each particle is a robot with biases of its own, drawn about those of the set, so that those whose biases
fit survive (Liu and West 2001 call such parameters static). Wheel encoders and the gyro, where they are
read after each movement, say how far it went better than the law of the drive. A particle whose way
leads into a wall stops there; a few stop anywhere (the slip hypothesis).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from simmer_tui.calibrate.drive_law import moved
from simmer_tui.calibrate.measured_run import Chain, MeasuredRun
from simmer_tui.calibrate.wall_clearance import SHARES, Clearance
from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.sensors import RangeSensor, World, sensor_of
from simmer_tui.sim.sensors.counters import Gyro, Odometer

_BIAS_SPREAD = (0.06, 0.06, 0.4)
_TURN_BIAS_SPREAD = (0.005, 0.005, 0.03)
_LEAST_ERROR = (0.02, 0.02, 0.03)
_TURN_LEAST_ERROR = (0.003, 0.003, 0.01)
_COUNTER_ERROR = 0.035
"""A counter's gain and its noise together, before either is known."""
_SLIPS = 0.03
"""How often a movement ends early for no reason that is seen."""
_ODD = 0.08
"""How often a reading fits no model."""
_REACH = 157.0
_TEMPER = 0.6
"""Readings count for less than if their errors were independent: a sensor's bias stays what it is."""


@dataclass(frozen=True)
class RoughPath:
    """The pose at each stop of a chain, (n, 3), which movements met a wall, (n - 1,), and how well the
    readings fit on average (log likelihood a reading)."""

    poses: FloatArray
    contacts: np.ndarray[tuple[int], np.dtype[np.bool_]]
    fit: float


class PathFinder:
    """Finds the paths of a run's chains."""

    def __init__(self, run: MeasuredRun) -> None:
        self._run = run
        spec = run.spec
        self._spec = spec
        self._clear = Clearance(spec.maze, spec.robot)
        self._world = world_of(run)
        sensors = {each.code: sensor_of(each) for each in spec.sensors}
        self._ranging = {code: each for code, each in sensors.items() if isinstance(each, RangeSensor)}
        self._odometers = {code: each for code, each in sensors.items() if isinstance(each, Odometer)}
        self._gyros = {code: each for code, each in sensors.items() if isinstance(each, Gyro)}
        self._said: dict[str, dict[int, tuple[float, float]]] = {
            code: {int(s): (v, t) for s, v, t in zip(r.stops, r.values, r.times, strict=True)}
            for code, r in run.readings.items()
        }
        self._compasses = {each.code: each for each in spec.sensors if each.kind.name == "comp"}

    def find(
        self,
        chain: Chain,
        first: int,
        count: int,
        random: np.random.Generator,
        *,
        wide: float = 1.0,
        progress: Callable[[int], None] = lambda stop: None,
    ) -> RoughPath:
        """The path of a chain whose stops begin with number `first`, by `count` particles. `wide`
        multiplies how far off the start may be."""
        start = np.array((chain.start.x, chain.start.y, chain.start.heading))
        poses = start + wide * np.array(chain.spread) * random.standard_normal((count, 3))
        free = self._clear.of(poses) > -0.3
        if free.any():
            poses = poses[random.choice(np.flatnonzero(free), count)]
        biases = self._drawn_biases(count, random)
        total = len(chain.movements)
        history = np.empty((total + 1, count, 3), np.float32)
        parents = np.empty((total + 1, count), np.int32)
        touched = np.zeros((total + 1, count), bool)
        weights = np.zeros(count)
        fits, readings = 0.0, 0
        for step in range(total + 1):
            if step:
                poses, touched[step] = self._move(chain, first, step, poses, biases, random)
            score, heard = self._score(first + step, poses)
            history[step] = poses
            parents[step] = np.arange(count)
            weights += _TEMPER * score
            if heard:
                best = weights.max()
                share = np.exp(weights - best)
                fits += float(np.log(np.average(np.exp(score), weights=share) + 1e-300))
                readings += heard
                share /= share.sum()
                if 1.0 / np.square(share).sum() < count / 2 and step < total:
                    chosen = _systematic(share, random)
                    parents[step] = chosen
                    poses = poses[chosen] + 0.05 * np.array((1.0, 1.0, 3.0)) * random.standard_normal(
                        (count, 3)
                    )
                    biases = biases[chosen]
                    biases = biases + 0.05 * self._spread * random.standard_normal(biases.shape)
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

    def _drawn_biases(self, count: int, random: np.random.Generator) -> FloatArray:
        drives = self._spec.drives
        present = np.array([(d.bias.x, d.bias.y, d.bias.r) for d in drives])
        self._spread = np.array([_TURN_BIAS_SPREAD if d.kind.turns else _BIAS_SPREAD for d in drives])
        drawn: FloatArray = present + self._spread * random.standard_normal((count, len(drives), 3))
        return drawn

    def _move(
        self,
        chain: Chain,
        first: int,
        step: int,
        poses: FloatArray,
        biases: FloatArray,
        random: np.random.Generator,
    ) -> tuple[FloatArray, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
        movement, count = chain.movements[step - 1], len(poses)
        drive = self._spec.drives[movement.drive]
        direction = drive.kind.direction
        asked = movement.value * np.array((direction.x, direction.y, direction.r))
        d = float(asked.sum())
        errors = np.maximum(
            (drive.error.x, drive.error.y, drive.error.r),
            _TURN_LEAST_ERROR if drive.kind.turns else _LEAST_ERROR,
        )
        totals = asked + d * biases[:, movement.drive] + d * errors * random.standard_normal((count, 3))
        before, after = first + step - 1, first + step
        wheels = self._differences(self._odometers, before, after)
        if len(wheels) >= 3:
            totals = _by_wheels(wheels, totals, abs(d) * np.array(errors), random)
        for gyro, change, seconds in self._differences(self._gyros, before, after):
            turn = (change - gyro.spec.drift * seconds) / (gyro.spec.gain or 1.0)
            spread = _COUNTER_ERROR * abs(turn) + 0.3 + 0.05 * seconds
            totals[:, 2] = turn + spread * random.standard_normal(count)
            break
        share = np.ones(count)
        if not movement.certain:
            share = random.choice((0.0, 1.0), count) * random.random(count) ** 0.2
        clear = self._clear.along(poses, totals, self._spec.num_segments)
        # A particle that overlaps a wall a little may go along it, and away from it.
        blocked = clear < np.minimum(self._clear.of(poses), 0.0)[:, None] - 0.02
        met = blocked.any(axis=1)
        if met.any():
            reached = np.where(met, np.concatenate(([0.0], SHARES))[blocked.argmax(axis=1)], 1.0)
            reached += np.where(met, random.random(count) / len(SHARES), 0.0)
            share = np.minimum(share, reached)
        slips = random.random(count) < _SLIPS
        share = np.where(slips, share * random.random(count), share)
        touched = met | slips
        freely = drive.kind.turns and self._spec.robot.radius is not None
        done = share[:, None] * totals
        done[:, 2] = totals[:, 2] if freely or self._gyros else done[:, 2]
        arrived = moved(poses, done, self._spec.num_segments)
        if movement.certain:
            inside = self._clear.of(arrived) < -0.5
            arrived[inside, :2] = poses[inside, :2]
        return arrived, touched

    def _differences(
        self, counters: dict[str, Odometer] | dict[str, Gyro], before: int, after: int
    ) -> list[tuple[Odometer | Gyro, float, float]]:
        found: list[tuple[Odometer | Gyro, float, float]] = []
        for code, counter in counters.items():
            said = self._said.get(code, {})
            if before in said and after in said:
                (value, begin), (later, end) = said[before], said[after]
                change = later - value
                wrap = counter.spec.wrap
                if wrap:
                    change = (change + wrap / 2) % wrap - wrap / 2
                if math.isfinite(change):
                    found.append((counter, change, end - begin))
        return found

    def _score(self, stop: int, poses: FloatArray) -> tuple[FloatArray, int]:
        """Log likelihoods of what was read at a stop, and how many readings that were."""
        score = np.zeros(len(poses))
        heard = 0
        for code, sensor in self._ranging.items():
            said = self._said.get(code, {}).get(stop)
            if said is None or not math.isfinite(said[0]) or not trusted(self._run, sensor, stop):
                continue
            true = sensor.ranges(self._world, poses)
            seen = np.where(np.isfinite(true), true, 1e3) * sensor.spec.gain + sensor.spec.bias
            spread = 0.06 * seen + 0.7
            away = (said[0] - seen) / spread
            density = (1.0 - _ODD) * np.exp(-0.5 * away**2) / (2.5066 * spread) + _ODD / _REACH
            score += np.log(density)
            heard += 1
        for code, compass in self._compasses.items():
            said = self._said.get(code, {}).get(stop)
            if said is None or not math.isfinite(said[0]):
                continue
            away = said[0] - compass.gain * (poses[:, 2] + compass.rotation) - compass.bias
            away = (away + 180.0) % 360.0 - 180.0
            score += np.log(0.9 * np.exp(-0.5 * (away / 20.0) ** 2) + 0.1)
            heard += 1
        return score, heard


def _by_wheels(
    wheels: list[tuple[Odometer | Gyro, float, float]],
    totals: FloatArray,
    spread: FloatArray,
    random: np.random.Generator,
) -> FloatArray:
    """Totals drawn from what wheels counted, and from the law where they do not say: a Kalman update."""
    unit = np.eye(3)
    levers = np.array([[each.counted_on(u[2], u[0], u[1]) for u in unit] for each, _, _ in wheels])
    counted = np.array([change / (each.spec.gain or 1.0) for each, change, _ in wheels])
    noise = (_COUNTER_ERROR * np.abs(counted) + 0.03) ** 2
    prior = np.diag(np.maximum(2.0 * spread, 1e-3) ** 2)
    gain = prior @ levers.T @ np.linalg.inv(levers @ prior @ levers.T + np.diag(noise))
    off = counted + np.sqrt(noise) * random.standard_normal((len(totals), len(counted))) - totals @ levers.T
    drawn: FloatArray = totals + off @ gain.T
    return drawn


def _systematic(share: FloatArray, random: np.random.Generator) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Systematic resampling: as many copies of each as its share wants, up to one."""
    places = (np.arange(len(share)) + random.random()) / len(share)
    return np.minimum(np.searchsorted(np.cumsum(share), places), len(share) - 1)


def world_of(run: MeasuredRun) -> World:
    """What sensors see: the maze, and the block where the set says that it lies."""
    spec = run.spec
    return World(Maze(spec.maze), Block(*spec.block_center, spec.block_size, 0.0))


def trusted(run: MeasuredRun, sensor: RangeSensor, stop: int) -> bool:
    """Whether what a sensor sees is known at a stop: a block that was moved may be anywhere."""
    if run.block_moved_at is None or stop <= run.block_moved_at:
        return True
    return math.isinf(sensor.block_from(run.spec.block_size))
