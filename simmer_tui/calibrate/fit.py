"""The fit: paths and parameters together, noise scales separately, and the parameters that the data do not
identify.

First the particle filter finds each path, then Gauss-Newton refines poses and parameters at once. Noise
scales follow by Fisher scoring (posterior.py). Intervals are Laplace's; predictions of held-back readings
widen them (prediction.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from msgspec.structs import astuple

from simmer_tui.calibrate.find_path import PathFinder, RoughPath
from simmer_tui.calibrate.geometry import totals_between
from simmer_tui.calibrate.measured_run import MeasuredRun
from simmer_tui.calibrate.model_check import EffectTest, Misfit, check_model, with_mounting
from simmer_tui.calibrate.parameters import (
    IDENTIFIED,
    ParameterSpace,
    observed_sensors,
    parameters_of,
)
from simmer_tui.calibrate.posterior import (
    COUNTER,
    KINEMATIC,
    PROCESS,
    RANGE,
    Iterate,
    Posterior,
    Rows,
    noise_scale_score,
    outliers_in,
)
from simmer_tui.calibrate.rows import PER_STOP, Model
from simmer_tui.errors import CalibrationError
from simmer_tui.report.robust_statistics import Z_95
from simmer_tui.sim.arrays import BoolArray, FloatArray

_PARTICLES = (300, 1500, 4000)
"""Particles at each try."""
# Judged: 300 are enough for a robot that was placed within an inch and 5 degrees of its start, and cost
# little compared with the fit. Later tries begin with wider starts and need more. Of 30 emulated robots no
# log was refused.
WINDOW = 12
"""Stops of a stretch that is tested by itself."""
# Some 50 ranges: with so many, half of them are outliers only if the path is wrong.
_RANGES = 6
"""Least number of ranges to test a stretch, or to begin at all: twice the numbers of a pose."""
_HOPELESS = -3.5
"""Log likelihood a reading below which a rough path is rejected; right ones have about -1.5."""
_ODD_AT_MOST, _FARTHEST = 0.2, 4.0
"""Limits of an accepted path: the share of all ranges that fit no pose, and the distance of its first pose
from the start, in standard deviations."""
# Judged: a robot's sensors have outliers of some percent, while a path that is wrong by a cell fits few
# ranges. A start 4 standard deviations off occurs by chance once in 16,000 logs.
_ANNEALED = (1.5, 0.7, 0.3)
"""Standard deviations, inches, added to ranges in the rounds that refine a rough path."""
# The rough path has an error of about an inch. Halving from there keeps each step where ranges are linear.
_STEPS = 2
"""Gauss-Newton steps at each of these."""
_LONGEST_STEP = 6.0
"""Most inches by which a step may move a stop: half a cell, so that no pose jumps over a wall."""
_DAMPING = 1e-6
"""Share of the diagonal that is added to the normal equations of a step, only against rounding."""
_MEETS, _CLEARS = -0.08, 0.12
"""Clearance, inches, below which a planned path has a contact, and above which it has none any more."""
# Poses are known to about 0.05 in; the two differ so that a contact does not alternate between rounds.
_NEAR, _ODD_NEAR, _ODD_ANYWHERE = 0.6, 4.0, 6.0
"""A movement within so many inches of a wall met it if its residuals exceed the second number, in standard
deviations. Elsewhere they must exceed the third."""
# With 5,000 normal residuals a log, one beyond 4 occurs once in three logs, one beyond 6 once in 100,000.
# Near a wall a real contact is more likely.
_ROUNDS = 12
"""Most rounds of Fisher scoring: it converges earlier, unless two noise scales alternate."""
_CONVERGED = 0.06
"""Change of a noise scale's logarithm, twice in a row, below which scoring ends: its standard error is seldom
below 0.1, and the random vectors of the traces change from round to round."""
_LARGEST_CHANGE = 0.7
"""Largest change of a noise scale's logarithm in a round, a factor of two: beyond it the likelihood is not a
parabola."""
_TRUSTED = 2
"""Rounds before a large residual may mark a movement as slipped: in them the noise scales are still wrong."""
_LEAST_OUTLIERS = 0.02
"""Least share of outliers at which estimation begins: from 0 it could never grow."""
_APPROXIMATED = 2.0
"""Factor on the intervals of errors of drives that moved by velocities."""
# It covers what the model omits there: counters interpolated to a stop, errors of two drives at once. With
# it, intervals contain 90 % of ten emulated robots' figures.
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Fit:
    """Estimates from a run."""

    run: MeasuredRun
    space: ParameterSpace
    state: Iterate
    pose_spread: FloatArray
    """Posterior standard deviations of the poses, (stops, 3)."""
    standard_errors: FloatArray
    """Of the parameters; for one that is not identified, its prior's."""
    noise_scale_errors: FloatArray
    """Of the noise scales' logarithms."""
    identified: BoolArray
    noise_scales_identified: BoolArray
    rows: Rows
    covariance: FloatArray
    """Of the parameters; rows and columns of one that is not identified have no meaning."""
    information: FloatArray
    """Fisher information of the parameters, from the data alone, with the poses eliminated and the noise
    scales as estimated."""
    model: Model
    misfits: tuple[Misfit, ...] = ()
    """Departures of the robot from the model, the surest first."""
    tests: tuple[EffectTest, ...] = ()
    """Effects that were tested for, with the power of their tests."""

    @property
    def poses(self) -> FloatArray:
        """(stops, 3)."""
        return self.state.chain[:, :3]


def fit(
    run: MeasuredRun,
    *,
    seed: int = 0,
    prior_scale: float = 1.0,
    progress: Progress = lambda what, share: None,
) -> Fit:
    """Estimate all that the run identifies.

    Args:
        seed: Seed of the search for the path.
        prior_scale: Factor on the prior spreads of the noise scales.

    Raises:
        CalibrationError: if a path was not found.
    """
    ranging = [each.spec.code for each in observed_sensors(run.spec).values() if each.spec.kind.is_range]
    ranges = [run.readings[code].values for code in ranging if code in run.readings]
    if sum(int(np.isfinite(values).sum()) for values in ranges) < _RANGES:
        raise CalibrationError(
            f"{', '.join(run.names)}: no range sensor was read often enough to tell where the robot was; "
            "read all of them after each movement"
        )
    space = parameters_of(run, prior_scale)
    model = Model(run, space)
    reason: str | None = None
    for number, count in enumerate(_PARTICLES):
        random = np.random.default_rng((seed, number))
        # Each later try starts half as wide again, for a robot that was placed less exactly than requested.
        state, likely = _rough(model, count, random, 1.0 + 0.5 * number, progress)
        if likely < _HOPELESS:
            reason = "the ranges fit no path through the maze"
            continue
        state = _with_noise_scales(model, _settled(model, state), random, progress)
        reason = lost_stretch(model, model.rows(state)) or misplaced(run, state)
        if reason is None:
            return _result(model, state, random)
    raise CalibrationError(
        f"{', '.join(run.names)}: the robot's path was not found in {len(_PARTICLES)} tries: {reason}. "
        "Check its start pose and its maze against the set, and that nobody moved it in between."
    )


def refit(whole: Fit, run: MeasuredRun) -> Fit:
    """Estimates from the first part of the run, starting from its path in the whole fit."""
    model = Model(run, whole.space)
    random = np.random.default_rng(0)
    chain = whole.state.chain[: run.stops].copy()
    chain[model.movement_at < 0, 3:] = 0.0
    here = slice(len(model.before))
    state = replace(
        whole.state, chain=chain, contacts=whole.state.contacts[here], slipped=whole.state.slipped[here]
    )
    # Half of the rounds: scoring begins at the estimates of the whole run.
    state = _with_noise_scales(model, state, random, rounds=_ROUNDS // 2)
    return _result(model, state, random)


def fit_path(
    run: MeasuredRun, space: ParameterSpace, parameters: FloatArray, noise_scales: FloatArray, rough: Iterate
) -> Iterate:
    """The path for fixed parameters, refined from a rough one."""
    model = Model(run, space)
    state = replace(rough, parameters=parameters, noise_scales=noise_scales)
    # Three steps at the end: with fixed parameters each pose depends on near neighbours only.
    for annealed in (*_ANNEALED, 0.0, 0.0, 0.0):
        state = with_contacts(model, _stepped(model, state, annealed, np.zeros(len(parameters))))
    return state


def fit_tail(run: MeasuredRun, space: ParameterSpace, state: Iterate) -> tuple[FloatArray, FloatArray]:
    """The pose at the last stop, (3,), and its covariance, for fixed parameters."""
    model = Model(run, space)
    posterior = Posterior(model.rows(state, 0.0, np.zeros(len(state.parameters))), model.width)
    columns = PER_STOP * (run.stops - 1) + np.arange(3)
    chosen = np.zeros((model.width + len(state.parameters), 3))
    chosen[columns, np.arange(3)] = 1.0
    return state.chain[-1, :3].copy(), posterior.solve(chosen)[columns]


def start_state(run: MeasuredRun, model: Model, paths: list[RoughPath]) -> Iterate:
    """The first iterate: rough paths, and the set's parameters."""
    parameters, noise_scales = model.space.start()
    chain = np.zeros((run.stops, PER_STOP))
    contacts = np.zeros(len(model.before), bool)
    begin = 0
    for first, path in zip(run.first_stops(), paths, strict=True):
        count = len(path.poses)
        chain[first : first + count, :3] = path.poses
        contacts[begin : begin + count - 1] = path.contacts
        begin += count - 1
    here, there = chain[model.before, :3], chain[model.before + 1, :3]
    totals = totals_between(here, there, *model.law)
    chain[model.before, 3:] = np.where(contacts[:, None], model.asked, totals)
    outliers = np.array([max(sensor.outlier, _LEAST_OUTLIERS) for sensor in run.spec.sensors])
    return Iterate(chain, parameters, noise_scales, contacts, np.zeros_like(contacts), outliers)


def _rough(
    model: Model, count: int, random: np.random.Generator, wide: float, progress: Progress
) -> tuple[Iterate, float]:
    """The first iterate, and the log likelihood a reading of the chain that fits worst."""
    run = model.run
    finder = PathFinder(run)

    def at_stop(stop: int) -> None:
        progress("finding the path", stop / model.stops)

    paths = [
        finder.find(chain, first, count, random, wide=wide, progress=at_stop)
        for first, chain in zip(run.first_stops(), run.chains, strict=True)
    ]
    return start_state(run, model, paths), min(path.fit for path in paths)


def _stepped(model: Model, state: Iterate, annealed: float, tight: FloatArray | None = None) -> Iterate:
    """The iterate after one step of Gauss-Newton; `annealed` and `tight` as in `Model.rows`."""
    rows = model.rows(state, annealed, tight)
    step = Posterior(rows, model.width, damping=_DAMPING).step()
    chain = step[: model.width].reshape(-1, PER_STOP)
    limit = np.abs(chain[:, :2]).max(initial=0.0)
    scale = min(1.0, _LONGEST_STEP / limit) if limit else 1.0
    parameters = state.parameters + scale * step[model.width :]
    return replace(state, chain=state.chain + scale * chain, parameters=parameters)


def _settled(model: Model, state: Iterate) -> Iterate:
    """The mode of poses and parameters, with fixed noise scales."""
    for annealed in (*_ANNEALED, 0.0):
        for _ in range(_STEPS):
            state = _stepped(model, state, annealed)
        state = with_contacts(model, state)
    return state


def with_contacts(model: Model, state: Iterate) -> Iterate:
    """The iterate with contacts where planned paths lead into walls, from its present poses."""
    # Its present place counts too: a robot that turns at a wall, or leaves one, has no contact.
    margin = np.minimum(model.clearance.of(state.chain[model.before, :3]), 0.0)
    least = _least_clearance(model, state) - margin
    contacts = np.where(state.contacts, least < _CLEARS, least < _MEETS)
    return replace(state, contacts=contacts | state.slipped)


def _least_clearance(model: Model, state: Iterate) -> FloatArray:
    """Least distance from a wall along each planned path, inches, (movements,)."""
    here = state.chain[model.before]
    least: FloatArray = model.clearance.along(here[:, :3], here[:, 3:], *model.law).min(axis=1)
    return least


def slips_in(model: Model, state: Iterate, rows: Rows) -> BoolArray:
    """True for movements for which process model, wheels and gyro contradict each other: the robot met a wall
    that the estimated path just misses, or a wheel slipped."""
    worst = np.zeros(model.stops)
    sizes = np.abs(rows.residuals) / np.sqrt(rows.variances)
    for family, offset in ((PROCESS, 0), (KINEMATIC, 0), (COUNTER, -1)):
        mine = rows.family == family
        np.maximum.at(worst, np.maximum(rows.stop[mine] + offset, 0), sizes[mine])
    allowed = np.where(_least_clearance(model, state) < _NEAR, _ODD_NEAR, _ODD_ANYWHERE)
    return state.slipped | (worst[model.before] > allowed)


# -- noise scales -----------------------------------------------------------------------------------


def _scored(
    model: Model, state: Iterate, random: np.random.Generator, tight: FloatArray | None = None
) -> tuple[Rows, Posterior, FloatArray, FloatArray]:
    """Rows and posterior at a point, with gradient and information of the noise scales' logarithms. `tight`
    is as in `Model.rows`."""
    rows = model.rows(state, 0.0, tight)
    posterior = Posterior(rows, model.width)
    return rows, posterior, *noise_scale_score(model.space, state, rows, posterior, random)


def _with_noise_scales(
    model: Model,
    state: Iterate,
    random: np.random.Generator,
    progress: Progress = lambda what, share: None,
    *,
    fixed: BoolArray | None = None,
    tight: FloatArray | None = None,
    rounds: int = _ROUNDS,
) -> Iterate:
    """Noise scales by restricted maximum likelihood, with poses and parameters refitted.

    Args:
        fixed: True for noise scales that stay as they are.
        tight: As in `Model.rows`.
    """
    before = None
    for turn in range(rounds):
        for _ in range(2 if turn == 0 else 1):
            state = _stepped(model, state, 0.0, tight)
        state = with_contacts(model, state)
        rows, _, gradient, information = _scored(model, state, random, tight)
        step = np.linalg.solve(information, gradient)
        if fixed is not None:
            step[fixed] = 0.0
        step = np.clip(step, -_LARGEST_CHANGE, _LARGEST_CHANGE)
        scales = state.noise_scales * np.exp(step)
        state = replace(state, noise_scales=scales, outliers=outliers_in(rows, state))
        if turn >= _TRUSTED:
            state = replace(state, slipped=slips_in(model, state, rows))
        progress("estimating", (turn + 1) / rounds)
        largest = float(np.abs(step).max(initial=0.0))
        if before is not None and max(largest, before) < _CONVERGED:
            break
        before = largest
    return state


# -- the end ----------------------------------------------------------------------------------------


def _result(model: Model, state: Iterate, random: np.random.Generator) -> Fit:
    space = model.space
    rows, posterior, _, information = _scored(model, state, random)
    prior_spreads = np.array([each.spread for each in space.parameters])
    log_spreads = np.array([each.spread for each in space.noise_scales])
    noise_scale_errors = np.sqrt(np.diag(np.linalg.inv(information)))
    identified = np.sqrt(np.diag(posterior.covariance())) < IDENTIFIED * prior_spreads
    present, present_scales = space.of(model.run.spec)
    # A log with little information on a small noise scale may still show that it is smaller than the set's.
    smaller = state.noise_scales * np.exp(Z_95 * noise_scale_errors) < present_scales
    noise_scales_identified = (noise_scale_errors < IDENTIFIED * log_spreads) | smaller
    # Parameters that are not identified keep the set's values, and the rest is estimated given these.
    if not (identified.all() and noise_scales_identified.all()):
        state = replace(
            state,
            parameters=np.where(identified, state.parameters, present),
            noise_scales=np.where(noise_scales_identified, state.noise_scales, present_scales),
        )
        tight = np.where(identified, prior_spreads, 0.0)
        # A third of the rounds: only parameters correlated with the unidentified ones change.
        state = _with_noise_scales(
            model, state, random, fixed=~noise_scales_identified, tight=tight, rounds=_ROUNDS // 3
        )
        rows, posterior, _, information = _scored(model, state, random, tight)
        chosen = np.flatnonzero(noise_scales_identified)
        noise_scale_errors[chosen] = np.sqrt(np.diag(np.linalg.inv(information[np.ix_(chosen, chosen)])))
    covariance = posterior.covariance()
    spreads = np.sqrt(np.diag(covariance))
    spreads = with_mounting(space, state.parameters, spreads, identified)
    # With the priors of all parameters: the difference of one that was held fixed would look like an effect.
    check = check_model(model, state, model.rows(state))
    spreads = spreads + check.shifts / Z_95
    noise_scale_errors = noise_scale_errors + check.log_shifts / Z_95
    noise_scale_errors = noise_scale_errors * np.where(model.is_of_continuous_drive, _APPROXIMATED, 1.0)
    data = posterior.information - np.diag(1.0 / prior_spreads**2)
    data[~identified] = 0.0
    data[:, ~identified] = 0.0
    return Fit(
        model.run,
        space,
        state,
        posterior.pose_spread(random).reshape(-1, PER_STOP)[:, :3],
        np.where(identified, spreads, prior_spreads),
        noise_scale_errors,
        identified,
        noise_scales_identified,
        rows,
        covariance,
        data,
        model,
        check.misfits,
        check.tests,
    )


def misplaced(run: MeasuredRun, state: Iterate) -> str | None:
    """The reason for rejecting a path that begins far from where people placed the robot; else None."""
    for first, chain in zip(run.first_stops(), run.chains, strict=True):
        off = state.chain[first, :3] - np.array(astuple(chain.start))
        if (np.abs(off) > _FARTHEST * np.array(chain.spread)).any():
            return (
                f"the path that fits best begins {np.hypot(*off[:2]):.1f} in and {abs(off[2]):.0f} degrees "
                f"from where line {chain.line} has the robot"
            )
    return None


def lost_stretch(model: Model, rows: Rows) -> str | None:
    """The reason for rejecting a path with a stretch that does not fit; else None."""
    mine = rows.family == RANGE
    odd = np.bincount(rows.stop[mine], 1.0 - rows.weights[mine], model.stops)
    counts = np.bincount(rows.stop[mine], minlength=model.stops)
    window = np.ones(WINDOW)
    odd_near, counts_near = (np.convolve(each, window, "same") for each in (odd, counts))
    enough = counts_near >= _RANGES
    if not enough.any():
        return "no range sensor was read often enough to tell where the robot was"
    whole = float(odd.sum() / counts.sum())
    if whole > _ODD_AT_MOST:
        return f"{whole:.0%} of all ranges fit no place on the path that fits best"
    share = np.where(enough, odd_near / np.maximum(counts_near, 1.0), 0.0)
    worst = int(share.argmax())
    # On a right path outliers and edges are some percent, on a wrong one most ranges.
    if share[worst] < 0.5:
        return None
    # The movement after that stop, or the last one.
    movement = min(int(np.searchsorted(model.before, worst)), len(model.before) - 1)
    line = model.run.movements[movement].line
    return (
        f"near line {line}, {share[worst]:.0%} of the ranges fit no place that the robot could have been at"
    )
