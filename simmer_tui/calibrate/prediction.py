"""Errors of a set's predictions of held-back readings.

An extended Kalman filter follows the robot through the stretch that was held back, once with each set. It
predicts each reading in three ways: from all earlier data and the others at its stop (0 movements ahead),
from the stop before (1), or from five stops before, by the commands alone. For counters, the increments since
then are predicted.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from simmer_tui.calibrate.fit import Fit, fit_path, fit_tail, refit
from simmer_tui.calibrate.measured_run import MeasuredRun
from simmer_tui.calibrate.model_check import held_back_factor, held_back_misfits, held_back_tests
from simmer_tui.calibrate.pose_filter import PoseFilter
from simmer_tui.calibrate.posterior import Iterate
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.specs import SensorKind

HELD_BACK = 0.25
"""Share of the movements, at the end, that is held back: enough for medians of five movements ahead, while
the rest still identifies the same parameters."""
_LEAST = 5
"""Least number of held-back movements for a prediction: the furthest is five movements ahead."""


@dataclass(frozen=True, slots=True)
class PredictionAccuracy:
    """Median absolute errors of predictions of one kind of sensor, in its unit, some movements ahead: with
    the old set, and with the estimates from the first part alone."""

    kind: type[SensorKind]
    ahead: int
    before: float
    after: float
    count: int
    """Readings."""


@dataclass(frozen=True)
class HeldBack:
    """Predictions of the last part of a run."""

    movements: int
    learned: Fit
    """Estimates from the movements before."""
    errors: tuple[PredictionAccuracy, ...]
    """By name of the kind and movements ahead."""
    scores: dict[type[SensorKind], FloatArray] = field(default_factory=dict)
    """Absolute errors of predictions of held-back readings, in standard deviations, by kind; the predictions
    use the estimates and the other readings at their stop."""

    @property
    def scores_by_name(self) -> dict[str, FloatArray]:
        """The scores, by the name of the kind."""
        return {kind.name: each for kind, each in self.scores.items()}


def held_back(fit: Fit) -> HeldBack | None:
    """Learn from the first part, and predict the rest, up to the end of the last chain that is long enough.

    Returns:
        None if none is.
    """
    chains = zip(fit.run.first_stops(), fit.run.chains, strict=True)
    long = [(first, len(c.movements)) for first, c in chains if len(c.movements) * HELD_BACK >= _LEAST]
    if not long:
        return None
    first, length = long[-1]
    count = int(length * HELD_BACK)
    run = fit.run.before_stop(first + length)
    last = run.stops - 1 - count
    learned = refit(fit, run.before_stop(last))
    estimates = learned.state.parameters, learned.state.noise_scales
    followed = follow(run, fit, last, *estimates, learned.state)
    after = followed.errors
    before = follow(run, fit, last, *fit.space.of(run.spec), learned.state).errors
    errors = [
        PredictionAccuracy(*key, float(np.median(before[key])), float(np.median(after[key])), len(after[key]))
        for key in after
        if key in before
    ]
    errors.sort(key=lambda each: (each.kind.name, each.ahead))
    scores = {kind: np.array(each) for kind, each in followed.scores.items()}
    return HeldBack(count, learned, tuple(errors), scores)


def widened(fit: Fit, held: HeldBack) -> Fit:
    """The fit with intervals widened so that predictions of held-back readings are right often enough, and
    with the tests of these predictions."""
    scores = held.scores_by_name
    factor = held_back_factor(scores)
    return replace(
        fit,
        standard_errors=np.where(fit.identified, factor, 1.0) * fit.standard_errors,
        noise_scale_errors=factor * fit.noise_scale_errors,
        covariance=factor**2 * fit.covariance,
        misfits=(*fit.misfits, *held_back_misfits(scores)),
        tests=(*fit.tests, *held_back_tests(scores)),
    )


def follow(
    run: MeasuredRun,
    fit: Fit,
    last: int,
    parameters: FloatArray,
    noise_scales: FloatArray,
    rough: Iterate,
) -> PoseFilter:
    """A filter that has tracked the robot from stop `last` on, by a set with these parameters.

    Args:
        rough: A path up to there, from which the path under the set is refined.
    """
    early = run.before_stop(last)
    path = fit_path(early, fit.space, parameters, noise_scales, rough)
    pose, covariance = fit_tail(early, fit.space, path)
    spec = fit.space.with_estimates(run.spec, parameters, noise_scales)
    free = frozenset((fit.model.before[~fit.state.contacts] + 1).tolist())
    pose_filter = PoseFilter(run, spec, pose, covariance, last, free=free)
    for stop in range(last + 1, run.stops):
        pose_filter.advance(stop)
    return pose_filter
