"""Tests of the model: motion or readings of a robot that no set can describe, and their effect on estimates.

In the model, the biases of drives are constant, and their effect is proportional to the commanded distance.
The tests are for drives that weaken over the log, and for movements that end short by a constant. Each is one
more column of the linearised model; its score test (Rao 1948) needs no further fit. All tests of a run
together have a false-alarm rate of 1 %, by Holm's procedure (1979). An accepted term is estimated as well
when the others are tested.

Intervals then contain the estimates with and without the accepted terms, by the omitted-variable formula
(Greene, "Econometric Analysis", 2012, section 4.3.2).

Held-back readings test everything else. If significantly more than one in ten are further off than predicted,
with some slack (`_SLACK`), all intervals are widened by the split-conformal factor. With it nine in ten
predictions are right (Vovk, Gammerman and Shafer, "Algorithmic Learning in a Random World", 2005).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.special import bdtrc, bdtrik, chdtrc, ndtri, stdtrit

from simmer_tui.calibrate.geometry import on_axes
from simmer_tui.calibrate.parameters import AXES, ParameterSpace, main_axis
from simmer_tui.calibrate.posterior import PROCESS, Iterate, Posterior, Rows
from simmer_tui.calibrate.rows import Model
from simmer_tui.report.robust_fit import Z_95
from simmer_tui.sim.arrays import BoolArray, FloatArray
from simmer_tui.sim.sensors import ParameterKind

FALSE_MISFIT_RATE = 0.01
"""False-alarm rate of a group of tests, for robots that follow the model: a verdict must rarely be wrong."""
_UNEVEN = 0.05
"""Level of the test that sensors are mounted where the set has them: a false alarm only widens intervals."""
FEWEST_MOVEMENTS = 8
"""Least number of a drive's movements for a test of its terms: a slope over time needs some on either
side."""
_LEAST = {"": 0.02, "in": 0.05, "deg": 0.5}
"""Least terms that are reported, as a share or by unit: the resolution of a ruler and a protractor. On
movements of 4 in, and turns of 40 degrees, such a shortfall equals such a drift."""
_HOLDS = 0.9
"""Share of predictions that must be right: below 1, so that outliers, some percent, do not decide."""
_SLACK = 1.25
"""Factor on their standard deviations within which predictions fit. Their filter is linear and ignores
standard errors. Of 40 robots that follow the model, six kinds of sensor had a factor of 1.3 or more, the
largest 1.41; none had enough readings to fail."""
_FEW_SCORES = 30
"""Least number of a sensor kind's predictions for a test: three of them may be further off."""
_NORMAL_SCORE = float(ndtri((1.0 + _HOLDS) / 2))
EVERY_DRIVE = "all drives"


class MisfitKind(StrEnum):
    """The ways in which a robot departs from the model."""

    DRIFT = "drift"
    SHORTFALL = "shortfall"
    PREDICTION = "prediction"


@dataclass(frozen=True, slots=True)
class Misfit:
    """A departure from the model that the log shows."""

    kind: MisfitKind
    owner: str
    """ID of a drive, `EVERY_DRIVE`, or the name of a kind of sensor."""
    value: float
    """Share of its strength that a drive loses over the log; inches or degrees that each movement ends short;
    the factor by which predictions are further off than expected."""
    low: float
    high: float
    """Ends of the 95 % interval."""
    unit: str
    probability: float
    """Probability of as large a departure by chance."""

    @property
    def text(self) -> str:
        """The departure in a sentence."""
        ends = sorted((abs(self.low), abs(self.high)))
        match self.kind:
            case MisfitKind.DRIFT:
                how = "weaker" if self.value > 0 else "stronger"
                name = "All drives" if self.owner == EVERY_DRIVE else self.owner
                size = f"{abs(self.value):.0%} ({ends[0]:.1%} to {ends[1]:.1%})"
                return f"{name} became {how} by {size} from the first movement to the last."
            case MisfitKind.SHORTFALL:
                how = "short" if self.value > 0 else "too far"
                size = f"{abs(self.value):.2f} {self.unit} {how} ({ends[0]:.2f} to {ends[1]:.2f})"
                return f"Each movement of {self.owner} ends {size}, whatever its length."
            case MisfitKind.PREDICTION:
                return f"Held-back readings of {self.owner} have {self.value:.1f} times the expected error."


@dataclass(frozen=True)
class ModelCheck:
    """The tests of one fit, and their effect on its intervals."""

    misfits: tuple[Misfit, ...]
    shifts: FloatArray
    """Greatest amounts by which the accepted terms move the parameters, (p,)."""
    log_shifts: FloatArray
    """The same for the noise scales' logarithms, (k,)."""


@dataclass(frozen=True)
class _Term:
    """A term that the model does not have, with the derivatives of the residuals by it, (rows,)."""

    kind: MisfitKind
    owner: str
    unit: str
    drives: tuple[int, ...]
    column: FloatArray


def check_model(model: Model, state: Iterate, rows: Rows, posterior: Posterior) -> ModelCheck:
    """Test a fit, `rows` and `posterior` being those of its last iterate `state`."""
    terms = _terms(model, state, rows)
    columns = np.array([each.column for each in terms]).reshape(len(terms), len(rows.residuals)).T
    columns = columns * np.sqrt(rows.weights / rows.variances)[:, None]
    free = columns - posterior.projected(columns)
    information = columns.T @ free
    score = -free.T @ posterior.residuals
    chosen = accepted(score, information, FALSE_MISFIT_RATE)
    kept = [number for number, _ in chosen]
    values = np.linalg.solve(information[np.ix_(kept, kept)], score[kept])
    chosen = [
        each
        for each, value in zip(chosen, values.tolist(), strict=True)
        if abs(value) >= _LEAST[terms[each[0]].unit]
    ]
    kept = [number for number, _ in chosen]
    covariance = np.linalg.inv(information[np.ix_(kept, kept)])
    values = covariance @ score[kept]
    misfits = []
    for (number, probability), value, error in zip(
        chosen, values.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True
    ):
        term, half = terms[number], Z_95 * error
        ends = (value - half, value + half)
        misfits.append(Misfit(term.kind, term.owner, value, *ends, term.unit, probability))
    explained = columns[:, kept] @ values
    step = posterior.solve(posterior.whitened.T @ explained)
    shifts = np.abs(step[model.width :])
    for number, value in zip(kept, values.tolist(), strict=True):
        if terms[number].kind is MisfitKind.DRIFT:
            shifts += _half_a_drift(model, state, terms[number].drives, value)
    left = posterior.residuals + explained - posterior.whitened @ step
    return ModelCheck(tuple(misfits), shifts, _log_shifts(rows, posterior.residuals, left))


def accepted(score: FloatArray, information: FloatArray, level: float) -> list[tuple[int, float]]:
    """Terms that differ from 0, the most significant first, with their probabilities.

    Args:
        score: Of each term, (k,).
        information: Of the terms, with all other parameters estimated, (k, k).
        level: Probability that any is accepted if all are 0.
    """
    found: list[tuple[int, float]] = []
    # Below 1e-9 no row depends on the term: the rest is rounding.
    left = [number for number in range(len(score)) if information[number, number] > 1e-9]
    while left:
        kept = [number for number, _ in found]
        inner = np.linalg.pinv(information[np.ix_(kept, kept)], hermitian=True)
        across = information[np.ix_(left, kept)] @ inner
        remaining = score[left] - across @ score[kept]
        spare = information[left, left] - np.sum(across * information[np.ix_(left, kept)], axis=1)
        # A term that the accepted ones explain to a millionth has no information of its own.
        sizes = np.where(spare > 1e-6 * information[left, left], remaining**2 / np.maximum(spare, 1e-12), 0.0)
        best = int(sizes.argmax())
        probability = float(chdtrc(1, sizes[best]))
        if probability * len(left) > level:
            break
        found.append((left.pop(best), probability))
    return found


def held_back_misfits(scores: Mapping[str, FloatArray]) -> tuple[Misfit, ...]:
    """Kinds of sensor whose held-back readings differ from their predictions, the largest difference first.

    Args:
        scores: Absolute errors of predictions in standard deviations, (n,), by name of the kind.
    """
    tested = tested_kinds(scores)
    far = _SLACK * _NORMAL_SCORE
    found = []
    for name, each in tested.items():
        # An upper bound: the probability if predictions are right exactly as often as required.
        probability = float(bdtrc(int((each > far).sum()) - 1, len(each), 1.0 - _HOLDS))
        if probability * len(tested) <= FALSE_MISFIT_RATE:
            value, low, high = conformal_factor(each)
            found.append(Misfit(MisfitKind.PREDICTION, name, value, low, high, "", probability))
    return tuple(sorted(found, key=lambda each: -each.value))


def conformal_factor(scores: FloatArray) -> tuple[float, float, float]:
    """Factor on standard deviations with which predictions are right as often as required, and the ends of
    its 95 % interval. By order statistics of the scores, (n,)."""
    ordered, count = np.sort(scores), len(scores)
    ranks = [math.ceil((count + 1) * _HOLDS)]
    ranks += [int(bdtrik(share, count, _HOLDS)) + 1 for share in (0.025, 0.975)]
    value, low, high = (float(ordered[min(rank, count) - 1]) / _NORMAL_SCORE for rank in ranks)
    return value, low, high


def tested_drives(model: Model) -> tuple[int, ...]:
    """Indices of the drives that moved often enough for a test."""
    counts = np.bincount(model.drive, minlength=len(model.run.spec.drives))
    return tuple(index for index, count in enumerate(counts.tolist()) if count >= FEWEST_MOVEMENTS)


def tested_kinds(scores: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The scores of kinds of sensor with enough held-back readings for a test; by name, as the argument."""
    return {name: each for name, each in scores.items() if len(each) >= _FEW_SCORES}


def _terms(model: Model, state: Iterate, rows: Rows) -> list[_Term]:
    """Drift and shortfall of each drive that moved often enough, and the drift that all of these share."""
    drives = model.run.spec.drives
    tested = tested_drives(model)
    # From -1/2 to 1/2 over the log, so that a bias is that of its middle.
    place = np.arange(len(model.drive)) / max(len(model.drive) - 1, 1) - 0.5
    lost, short = -place * model.amount, -np.sign(model.amount)

    def term(kind: MisfitKind, owner: str, unit: str, of: tuple[int, ...]) -> _Term:
        amounts = np.where(np.isin(model.drive, of), lost if kind is MisfitKind.DRIFT else short, 0.0)
        return _Term(kind, owner, unit, of, _column(model, state, rows, amounts))

    terms = []
    for index in tested:
        name, unit = drives[index].kind.value, drives[index].kind.unit
        terms.append(term(MisfitKind.DRIFT, name, "", (index,)))
        terms.append(term(MisfitKind.SHORTFALL, name, unit, (index,)))
    if len(tested) > 1:
        terms.append(term(MisfitKind.DRIFT, EVERY_DRIVE, "", tested))
    return terms


def _column(model: Model, state: Iterate, rows: Rows, amounts: FloatArray) -> FloatArray:
    """Derivatives of all residuals by a factor on `amounts`, (movements,), the additional distances of
    drives."""
    axes = np.abs([on_axes(drive.kind.direction) for drive in model.run.spec.drives])
    totals = amounts[:, None] * (axes[model.drive] + model.biases(state))
    made = np.zeros(len(rows.residuals))
    # The rows of the process model come axis by axis.
    process = np.flatnonzero(rows.family == PROCESS).reshape(len(AXES), -1)
    for axis, mine in enumerate(process):
        made[mine] = -model.innovations(totals[:, axis])[model.movement_at[rows.stop[mine]]]
    return made


def _half_a_drift(model: Model, state: Iterate, drives: tuple[int, ...], value: float) -> FloatArray:
    """Amounts by which drift moves biases from the middle of the log to its ends, (p,)."""
    moved = np.zeros(len(model.space.parameters))
    for number, each in enumerate(model.space.parameters):
        if each.drive and each.index in drives:
            kind = model.run.spec.drives[each.index].kind
            along = float(each.field.endswith(main_axis(kind)))
            moved[number] = abs(value) / 2 * abs(along + state.parameters[number])
    return moved


def _log_shifts(rows: Rows, before: FloatArray, after: FloatArray) -> FloatArray:
    """Amounts by which noise scales' logarithms decrease if terms explain part of the noise, (k,), from the
    residuals with and without them, (rows,)."""
    squares = [np.asarray(rows.shares.T @ each**2) for each in (before, after)]
    ratios = squares[1] / np.maximum(squares[0], 1e-12)
    # If terms explain nothing of a scale, the rest is rounding.
    return np.where(squares[0] > 0.0, -0.5 * np.log(np.clip(ratios, 1e-6, 1.0)), 0.0)


def mounting_spread(
    space: ParameterSpace, values: FloatArray, errors: FloatArray, identified: BoolArray
) -> tuple[float, float]:
    """Standard deviation of the mounting offsets of this robot's sensors, inches, and its degrees of freedom.

    An offset in the direction that a sensor looks is part of its bias. It is assumed as large as the offsets
    across it, which the log identifies (by the moments of DerSimonian and Laird 1986).

    Args:
        values: Of the parameters, (p,); `errors` are their standard errors.
        identified: True for those that are identified.

    Returns:
        (0, 0) if the offsets across are no greater than their standard errors explain.
    """
    offsets = [
        n for n, each in enumerate(space.parameters) if each.kind is ParameterKind.OFFSET and identified[n]
    ]
    squares = values[offsets] ** 2
    if not offsets or chdtrc(len(offsets), float((squares / errors[offsets] ** 2).sum())) > _UNEVEN:
        return 0.0, 0.0
    return math.sqrt(max(float((squares - errors[offsets] ** 2).mean()), 0.0)), float(len(offsets))


def with_mounting(
    space: ParameterSpace, values: FloatArray, errors: FloatArray, identified: BoolArray
) -> FloatArray:
    """Standard errors, where those of biases include the unknown offset in the sensor's direction."""
    spread, freedom = mounting_spread(space, values, errors, identified)
    if not spread:
        return errors
    # With few sensors the spread itself is uncertain: Student's quantile instead of the normal one.
    spread *= float(stdtrit(freedom, 0.975)) / Z_95
    offsets = {each.index for each in space.parameters if each.kind is ParameterKind.OFFSET}
    widened = errors.copy()
    for number, each in enumerate(space.parameters):
        if not each.drive and each.index in offsets and each.field == "bias":
            gain = values[space.column(False, each.index, "gain")]
            widened[number] = math.hypot(errors[number], gain * spread)
    return widened
