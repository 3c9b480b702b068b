"""A guided session: movements and readings that identify a robot's parameters, without touching a wall.

It begins with readings at rest, a spin, and a square in both directions (UMBmark, Borenstein and Feng 1996).
Then it uses the drives with the least known parameters, where there is room. A movement is made only if its
whole path is clear of walls, for every likely pose and error of the robot.
"""

from __future__ import annotations

import asyncio
import dataclasses
import math
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from msgspec.structs import astuple, replace
from numpy.typing import ArrayLike

from simmer_tui.calibrate.estimates import estimates_of
from simmer_tui.calibrate.fit import Fit
from simmer_tui.calibrate.geometry import Clearance, on_axes
from simmer_tui.calibrate.measured_run import Chain, MeasuredMovement, MeasuredRun
from simmer_tui.calibrate.parameters import Parameter, main_axis
from simmer_tui.calibrate.pose_filter import PoseFilter
from simmer_tui.calibrate.written_set import learned_spec
from simmer_tui.config.loader import Configuration
from simmer_tui.dialect.inverse import InverseRules
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors import ParameterKind, modelled_sensor
from simmer_tui.sim.specs import Axes, DriveSpec, SensorSpec, SimulationSpec

PLACED = (0.25, 0.25, 2.0)
"""Standard deviations of the pose in which a person places the robot on request, inches and degrees."""
# `where_to_put` asks for a quarter of an inch and 2 degrees.
MOST_GUIDED = 150
"""Movements after which a session ends: a quarter of an hour at 6 s a movement, with its readings."""
LOOKS = 3
"""Readings of each range sensor and compass at every stop: their median is robust to one outlier."""
FITS_AT = (20, 45, 70, 90, 105, 120, 135, MOST_GUIDED)
"""Movements after which parameters are estimated: a fit takes seconds, in which the robot waits."""
# 20 are the spin and most of the square. Sessions that reach `WANTED` end between 70 and 150.
WANTED = {"main": 0.01, "angle": 0.3, "range": 0.03}
"""Median standard errors at which a session may end: bias of each drive along its axis, mounting angles
(degrees), biases of range sensors (inches)."""
_CLEAR = 0.4
"""Least clearance, inches, of every path that the robot may take: the error of the walls in the set, and the
spacing of the places at which a path is tested."""
_SAMPLES = 80
"""Paths drawn to test a movement: one that is unsafe in 4 % of cases passes once in 26."""
_WIDER = 1.3
"""Factor on the standard deviations of these paths, and of the learned errors, for effects that are not in
the model."""
_AMOUNTS = (8.0, 6.0, 4.5, 3.0, 2.0, 1.2)
"""Inches that translations are tried with: the longest that fit into a cell first, since they are the most
informative."""
_TURNS = (15, 120)
"""Least and greatest degrees of a turn, in either direction: less shows little of its bias, more does not fit
the screen's plan."""
_TRIES = 6
"""Turns that are tried before another drive is chosen: if six of any size are unsafe, most are."""
_WAIT = 0.5
"""Seconds between two tries of a robot that does not answer: a port needs about as long to reconnect."""
# Assumed errors of the drives of an unknown robot, an inch driven or a degree turned: twice the biases of
# strength = [0.05, 1], so that the first movements are short and end clear of walls.
_ANY_BIAS = (0.08, 0.08, 0.6)
_ANY_TURN_BIAS = (0.006, 0.006, 0.04)

Ask = Callable[[str], Awaitable[float]]
"""Function that sends a command and returns the robot's answer, NaN if there is none."""


@dataclass
class SessionPlanner:
    """Plans a guided session: the next movement, and the readings at each stop."""

    configuration: Configuration
    random: np.random.Generator
    most: int = MOST_GUIDED
    """Movements after which it ends."""
    count: int = 0
    """Movements made."""
    counts: Counter[str] = field(default_factory=Counter)
    """The same by code."""
    fit: Fit | None = None
    stuck: str = ""
    """Reason why no movement can be made; empty if one can."""

    def __post_init__(self) -> None:
        spec = self.spec = self.configuration.simulation
        self._seen: dict[str, list[float]] = {}
        self._unreachable = _unreachable(self.configuration)
        self.drives = [each for each in spec.drives if each.enabled and each.code not in self._unreachable]
        self.start = spec.start_pose
        self._chain = Chain(self.start, 1, spread=PLACED)
        self._clear = Clearance(spec.maze, spec.robot)
        self._plan = [*_spin(self.drives), *_square(self.drives)]
        self._follow(worst_case(spec), np.array(astuple(self.start)), PLACED)

    @property
    def pose(self) -> Pose:
        return Pose(*(float(value) for value in self._filter.pose))

    def looks(self) -> list[str]:
        """Codes to read at a stop, in this order."""
        enabled = [each for each in self.spec.sensors if each.enabled and not each.kind.is_yes_or_no]
        sensors = [each for each in enabled if each.code not in self._unreachable]
        once = [each.code for each in sensors if each.kind.counts]
        often = [each.code for each in sensors if not each.kind.counts]
        # Three times as many at the start: readings at rest are free of movement errors.
        return once + often * (LOOKS if self.count else 3 * LOOKS)

    def seen(self, code: str, value: float, time: float) -> None:
        """Add a reading at the present stop; the median of several is used for the robot's pose."""
        self._seen.setdefault(code, []).append(value)
        middle = float(np.median(self._seen[code]))
        self._filter.values_at_stops.setdefault(code, {})[self.count] = (middle, time)

    def settled(self) -> None:
        """Called after all readings at a stop."""
        if self.count:
            self._filter.advance(self.count)
        else:
            self._filter.look(0)
        self._seen = {}

    def next_move(self) -> tuple[DriveSpec, float] | None:
        """The next drive and its value; None if the robot cannot move safely."""
        while self._plan:
            drive, amount = self._plan.pop(0)
            if self.safe(drive, amount):
                return drive, amount
        for drive in sorted(self.drives, key=lambda each: (self._need(each), self.random.random())):
            for amount in self._amounts(drive):
                if self.safe(drive, amount):
                    return drive, amount
        self.stuck = "there is a wall too near on every side; put the robot where there is room"
        return None

    def made(self, drive: DriveSpec, amount: float, certain: bool) -> None:
        """Note a movement. `certain` is False if the robot did not answer it."""
        self.count += 1
        self.counts[drive.code] += 1
        index = self.spec.drives.index(drive)
        movement = MeasuredMovement(index, amount * drive.gain, certain, 0, math.nan)
        self._filter.movements[self.count] = movement

    def learned(self, fit: Fit) -> None:
        """Use new estimates for planning from now on."""
        self.fit = fit
        spec = learned_spec(fit.run.spec, estimates_of(fit))
        before = self._filter
        # Three times the fit's spread, at least a tenth of an inch: the filter must not be overconfident.
        spread = np.maximum(3 * fit.pose_spread[-1], (0.1, 0.1, 0.3))
        self._follow(learned_worst_case(spec), fit.poses[-1].copy(), spread)
        self._filter.values_at_stops, self._filter.movements = before.values_at_stops, before.movements

    @property
    def reached(self) -> dict[str, float]:
        """Median standard errors, as `WANTED` names them; infinite before the first estimate."""
        if self.fit is None:
            return dict.fromkeys(WANTED, math.inf)
        groups: dict[str, list[float]] = {name: [] for name in WANTED}
        for index, parameter in enumerate(self.fit.space.parameters):
            if not self._is_reachable(parameter):
                continue
            spread = float(self.fit.standard_errors[index])
            if parameter.drive:
                kind = self.fit.run.spec.drives[parameter.index].kind
                if parameter.field == f"bias.{main_axis(kind)}":
                    groups["main"].append(spread)
            elif parameter.kind is ParameterKind.ANGLE:
                groups["angle"].append(spread)
            elif parameter.field == "bias" and parameter.unit == "in":
                groups["range"].append(spread)
        return {name: float(np.median(group)) if group else 0.0 for name, group in groups.items()}

    @property
    def done(self) -> bool:
        """True if the session has reached its goals, or its last movement."""
        if self.count >= self.most:
            return True
        if self.fit is None:
            return False
        # Offsets show only at walls that are seen obliquely, and waiting for them would need many more
        # movements.
        needed = np.array(
            [
                each.kind is not ParameterKind.OFFSET and self._is_reachable(each)
                for each in self.fit.space.parameters
            ]
        )
        if not self.fit.identified[needed].all():
            return False
        return all(self.reached[name] <= most for name, most in WANTED.items())

    def _is_reachable(self, parameter: Parameter) -> bool:
        """True if the robot can be asked to use the drive or sensor of a parameter."""
        parts = self.spec.drives if parameter.drive else self.spec.sensors
        return parts[parameter.index].code not in self._unreachable

    def safe(self, drive: DriveSpec, amount: float) -> bool:
        """True if all drawn paths of a movement keep their clearance from walls."""
        pose_filter = self._filter
        asked = amount * drive.gain * on_axes(drive.kind.direction)
        now = next(each for each in pose_filter.spec.drives if each.kind is drive.kind)
        bias, error = on_axes(now.bias), on_axes(now.error)
        d = asked.sum()
        noise = self.random.standard_normal((_SAMPLES, 6))
        # 1e-9 keeps the covariance positive definite against rounding.
        root = np.linalg.cholesky(pose_filter.covariance + 1e-9 * np.eye(3))
        poses = pose_filter.pose + _WIDER * noise[:, :3] @ root.T
        totals = asked + d * bias + _WIDER * d * error * noise[:, 3:]
        segments = self.spec.num_segments
        # A robot near a wall may leave it: no path may be nearer than the present place, by more than the
        # 0.05 in to which poses are known.
        here = np.minimum(self._clear.of(poses) - 0.05, _CLEAR)
        return bool((self._clear.along(poses, totals, segments).min(axis=1) >= here).all())

    def _need(self, drive: DriveSpec) -> float:
        """Priority of a drive, the least first: its number of movements, later the precision of its bias."""
        if self.fit is None:
            return float(self.counts[drive.code])
        index = self.spec.drives.index(drive)
        scale = self.fit.space.column(True, index, f"error.{main_axis(drive.kind)}")
        return -float(self.fit.state.noise_scales[scale]) / math.sqrt(self.counts[drive.code] + 1)

    def _amounts(self, drive: DriveSpec) -> Iterator[float]:
        """Amounts to try with a drive, in this order."""
        if drive.kind.turns:
            for _ in range(_TRIES):
                yield round(float(self.random.choice((-1, 1)) * self.random.uniform(*_TURNS)), 1)
            return
        # Each times a random factor, so that amounts do not repeat; the three longest in any order.
        amounts = np.array(_AMOUNTS) * self.random.uniform(0.8, 1.1, len(_AMOUNTS))
        for each in (*self.random.permutation(3).tolist(), *range(3, len(_AMOUNTS))):
            yield round(float(amounts[each]), 1)

    def _follow(self, spec: SimulationSpec, pose: FloatArray, spread: ArrayLike) -> None:
        """Follow the robot by a set from the present stop on; `spread` are the pose's standard deviations."""
        run = MeasuredRun(
            replace(self.configuration, simulation=spec), ("guided",), (self._chain,), {}, None, False
        )
        self._filter = PoseFilter(run, spec, pose, np.diag(np.square(spread)), self.count)


def _unreachable(configuration: Configuration) -> frozenset[str]:
    """The codes of drives and sensors for which the robot's dialect has no message."""
    rules, spec = configuration.dialect, configuration.simulation
    if rules is None or rules.protocol is not None:
        return frozenset()
    inverse = InverseRules(rules)
    made = {each.code: inverse.drive(each.code, _AMOUNTS[0]) for each in spec.drives}
    made |= {each.code: inverse.read(each.code) for each in spec.sensors}
    return frozenset(code for code, message in made.items() if isinstance(message, str))


def worst_case(spec: SimulationSpec) -> SimulationSpec:
    """The set for an unknown robot: errors wide enough for any bias."""

    def drive(each: DriveSpec) -> DriveSpec:
        more = _ANY_TURN_BIAS if each.kind.turns else _ANY_BIAS
        return replace(each, error=Axes(*map(math.hypot, astuple(each.error), more)))

    def sensor(each: SensorSpec) -> SensorSpec:
        return modelled_sensor(each).worst_case()

    return replace(spec, drives=tuple(map(drive, spec.drives)), sensors=tuple(map(sensor, spec.sensors)))


def learned_worst_case(spec: SimulationSpec) -> SimulationSpec:
    """A learned set with wider errors, for effects that are not in the model."""
    drives = tuple(
        # An additional 0.01 degrees, since a drive's bias is known only to 0.004.
        replace(each, error=Axes(_WIDER * each.error.x, _WIDER * each.error.y, _WIDER * each.error.r + 0.01))
        for each in spec.drives
    )
    return replace(spec, drives=drives)


def _spin(drives: list[DriveSpec]) -> list[tuple[DriveSpec, float]]:
    """Half a turn and back, in steps: every sensor sees all directions from one place."""
    return [(each, amount) for each in drives if each.kind.turns for amount in (45.0,) * 4 + (-60.0,) * 3]


def _square(drives: list[DriveSpec]) -> list[tuple[DriveSpec, float]]:
    """A square in both directions, by the drive that moves ahead. Sides of 5 in fit into a cell of 12 in."""
    ahead = [each for each in drives if each.kind.direction.x > 0]
    turn = [each for each in drives if each.kind.turns]
    if not (ahead and turn):
        return []
    sides = [((ahead[0], 5.0), (turn[0], sign * 90.0)) for sign in (1, -1) for _ in range(4)]
    return [step for side in sides for step in side]


async def drive_guided(
    ask: Ask,
    guide: SessionPlanner,
    learn: Callable[[], Awaitable[Fit | None]],
    clock: Callable[[], float],
    show: Callable[[str], None] = lambda what: None,
) -> None:
    """Do a session.

    Args:
        learn: Returns estimates from the log so far; None if there are none.
        clock: Returns the time, seconds.
        show: Called with the present step, as text.
    """
    due = list(FITS_AT)
    while True:
        for code in guide.looks():
            while math.isnan(value := await ask(code)):
                show(f"the robot does not answer {code}; waiting for it")
                await asyncio.sleep(_WAIT)
            guide.seen(code, value, clock())
        guide.settled()
        while due and guide.count >= due[0]:
            due.pop(0)
            show("estimating")
            fit = await learn()
            if fit is not None:
                guide.learned(fit)
        if guide.done or (move := guide.next_move()) is None:
            return
        drive, amount = move
        show(f"{drive.code}-{amount:g}")
        reply = await ask(f"{drive.code}-{amount:g}")
        guide.made(drive, amount, not math.isnan(reply))


def guided_run(run: MeasuredRun) -> MeasuredRun:
    """A guided session's log: its robot was placed exactly."""
    chains = tuple(dataclasses.replace(chain, spread=PLACED) for chain in run.chains)
    return dataclasses.replace(run, chains=chains)


def where_to_put(guide: SessionPlanner) -> str:
    """The request to the person who places the robot at its start."""
    start = guide.start
    return (
        f"Put the robot's centre at x = {start.x:g}, y = {start.y:g} in (from the maze's lower left corner), "
        f"facing {start.heading:g} degrees counter-clockwise from right, within a quarter of an inch and 2 "
        "degrees."
    )
