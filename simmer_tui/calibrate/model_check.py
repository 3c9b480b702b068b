"""Tests of the model: effects that no set can describe, the power of their tests, and held-back readings.

Each effect (effects.py) is one or more columns of the linearised model; its score test (Rao 1948) needs no
further fit. All tests of a run together have a false-alarm rate of 1 %, by Holm's procedure (1979). An
accepted effect is estimated as well when the others are tested. A test's information gives its power: the
size that it would have found in nine of ten such logs.

Intervals then contain the estimates with and without the accepted effects, by the omitted-variable formula
(Greene, "Econometric Analysis", 2012, section 4.3.2).

Held-back readings test everything else. In every case, all intervals are widened by the split-conformal
factor, with which nine in ten predictions are right (Vovk, Gammerman and Shafer, "Algorithmic Learning in a
Random World", 2005). If significantly more than one in ten are further off than predicted, with some slack
(`_SLACK`), the model does not fit.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import bdtrc, bdtri, bdtrik, chdtrc, chdtri, chndtrinc, ndtri, stdtrit

from simmer_tui.calibrate.effects import BLIND_SPOTS, EVERY_DRIVE, Effect, effects
from simmer_tui.calibrate.parameters import ParameterSpace, main_axis
from simmer_tui.calibrate.posterior import OBSERVATION, RANGE, Iterate, Posterior, Rows
from simmer_tui.calibrate.rows import Model
from simmer_tui.report.robust_statistics import Z_95
from simmer_tui.run.phrases import capitalized
from simmer_tui.sim.arrays import BoolArray, FloatArray, IntArray
from simmer_tui.sim.sensors import ParameterKind

FALSE_MISFIT_RATE = 0.01
"""False-alarm rate of a group of tests, for robots that follow the model: a verdict must rarely be wrong."""
POWER = 0.9
"""Probability with which an effect of the stated size would have been found."""
_UNEVEN = 0.05
"""Level of the test that sensors are mounted where the set has them: a false alarm only widens intervals."""
_BOUND = 3.0
"""Standard deviations from which a reading's influence on a test is bounded. The fit takes readings in a
blind spot as outliers, which would hide it."""
_LEAST_OWN = 0.001
"""Least share of an effect on readings that no other parameters explain: below, only priors separate it. In
logs with all drives it is 0.004 or more; of turns that encoders count, in a robot that only turns, 0.0005."""
_HOLDS = 0.9
"""Share of predictions that must be right: below 1, so that outliers, some percent, do not decide."""
_SLACK = 1.25
"""Factor on their standard deviations within which predictions fit. Their filter is linear and ignores
standard errors. Of 40 robots that follow the model, six kinds of sensor had a factor of 1.3 or more, the
largest 1.41; none had enough readings to fail."""
_FEW_SCORES = 30
"""Least number of a sensor kind's predictions for a test: three of them may be further off."""
_NORMAL_SCORE = float(ndtri((1.0 + _HOLDS) / 2))
_FAR = _SLACK * _NORMAL_SCORE
_PREDICTED = "held-back readings with {size} the expected error"
PREDICTION = "prediction"
"""Kind of a misfit that held-back readings show."""


@dataclass(frozen=True, slots=True)
class Misfit:
    """A departure from the model that the log shows."""

    kind: str
    """Name of a kind of effect, or `PREDICTION`."""
    owner: str
    """ID of a drive or sensor, `EVERY_DRIVE`, or the name of a kind of sensor."""
    value: float
    """Its size; of a prediction, the factor by which errors are larger than expected."""
    low: float
    high: float
    """Ends of the 95 % interval."""
    unit: str
    probability: float
    """Probability of as large a departure by chance."""
    phrase: str
    """The departure as a noun, with `{size}` in it."""

    @property
    def text(self) -> str:
        """The departure in a sentence."""
        interval = f"{self.value:.2f} {self.unit} ({self.low:.2f} to {self.high:.2f})"
        if not self.unit:
            interval = f"{self.value:.1%} ({self.low:.1%} to {self.high:.1%})"
        if self.kind == PREDICTION:
            interval = f"{self.value:.1f} times"
        return f"{capitalized(self.owner)}: {self.phrase.format(size=interval)}."


@dataclass(frozen=True, slots=True)
class EffectTest:
    """A test of the model, with its power."""

    kind: str
    owner: str
    """`EVERY_DRIVE`, or the name of a kind of sensor."""
    devices: tuple[str, ...]
    """IDs of those that were tested."""
    size: float
    """Size that would have been found in each of them with a probability of `POWER`."""
    unit: str
    phrase: str
    """The effect as a noun, with `{size}` in it."""

    @property
    def text(self) -> str:
        """The effect of this size, as a noun."""
        size = f"{self.size:.2g} {self.unit}" if self.unit else f"{self.size:.1%}"
        if self.kind == PREDICTION:
            size = f"{self.size:.1f} times"
        return self.phrase.format(size=size)


@dataclass(frozen=True)
class ModelCheck:
    """The tests of one fit, and their effect on its intervals."""

    misfits: tuple[Misfit, ...]
    tests: tuple[EffectTest, ...]
    shifts: FloatArray
    """Greatest amounts by which the accepted effects move the parameters, (p,)."""
    log_shifts: FloatArray
    """The same for the noise scales' logarithms, (k,)."""


def check_model(model: Model, state: Iterate, rows: Rows) -> ModelCheck:
    """Test a fit, `rows` being those of its last iterate `state`."""
    rows = _bounded(rows)
    posterior = Posterior(rows, model.width)
    tested = effects(model, state, rows)
    columns = np.column_stack([np.zeros((len(rows.residuals), 0)), *(each.columns for each in tested)])
    columns = columns * np.sqrt(rows.weights / rows.variances)[:, None]
    ends = np.cumsum([each.columns.shape[1] for each in tested])
    groups = [np.arange(end - each.columns.shape[1], end) for each, end in zip(tested, ends, strict=True)]
    free = columns - posterior.projected(columns)
    information = columns.T @ free
    score = -free.T @ posterior.residuals
    own, whole = np.diag(information), (columns**2).sum(axis=0)
    shown = [
        each.group == EVERY_DRIVE or own[group].sum() > _LEAST_OWN * whole[group].sum()
        for each, group in zip(tested, groups, strict=True)
    ]
    tested = [each for each, is_shown in zip(tested, shown, strict=True) if is_shown]
    groups = [each for each, is_shown in zip(groups, shown, strict=True) if is_shown]
    chosen = accepted(score, information, groups, FALSE_MISFIT_RATE)
    values, covariance = _estimated(score, information, [groups[number] for number, _ in chosen])
    misfits = []
    for (number, probability), value, spread in zip(chosen, values, covariance, strict=True):
        misfit = _misfit(tested[number], value, spread, probability)
        if abs(misfit.value) >= tested[number].kind.least:
            misfits.append((number, misfit))
    kept = [groups[number] for number, _ in misfits]
    values, _ = _estimated(score, information, kept)
    explained = np.zeros(len(rows.residuals))
    for group, value in zip(kept, values, strict=True):
        explained += columns[:, group] @ value
    step = posterior.solve(posterior.whitened.T @ explained)
    shifts = np.abs(step[model.width :])
    for (number, _), value in zip(misfits, values, strict=True):
        if tested[number].drives:
            shifts += _half_a_drift(model, state, tested[number].drives, float(np.abs(value).max()))
    left = posterior.residuals + explained - posterior.whitened @ step
    return ModelCheck(
        tuple(misfit for _, misfit in misfits),
        tuple(_powers(tested, groups, information)),
        shifts,
        _log_shifts(rows, posterior.residuals, left),
    )


def _bounded(rows: Rows) -> Rows:
    """The rows, with the weights of outlying observations such that their influence is bounded, not zero."""
    far = np.abs(rows.residuals) / np.sqrt(rows.variances)
    weights = np.maximum(rows.weights, np.minimum(1.0, _BOUND / np.maximum(far, 1e-9)))
    # What is further off than a blind spot makes it is an outlier.
    near = (rows.family == OBSERVATION) | (
        (rows.family == RANGE) & (np.abs(rows.residuals) < BLIND_SPOTS[-1])
    )
    return replace(rows, weights=np.where(near, weights, rows.weights))


def _chi_square(score: FloatArray, information: FloatArray, scale: FloatArray) -> float:
    """The score statistic, from the directions with more than a millionth of their first information `scale`:
    the accepted effects explain the others."""
    root = np.sqrt(np.maximum(np.diag(scale), 1e-12))
    inverse = np.linalg.pinv(information / np.outer(root, root), rcond=1e-6, hermitian=True)
    return max(float((score / root) @ inverse @ (score / root)), 0.0)  # rounding may make it negative


def _log_probability(count: int, size: float) -> float:
    """Logarithm of the probability of a chi-square of at least this size, with `count` degrees of freedom."""
    probability = float(chdtrc(count, size))
    if probability > 0.0:
        return math.log(probability)
    # The first term of its asymptotic series, where the probability is too small for a number.
    return (count / 2 - 1) * math.log(size / 2) - size / 2 - math.lgamma(count / 2)


def accepted(
    score: FloatArray, information: FloatArray, groups: Sequence[IntArray], level: float
) -> list[tuple[int, float]]:
    """Effects that differ from 0, the most significant first, with their probabilities.

    Args:
        score: Of each column, (k,).
        information: Of the columns, with all other parameters estimated, (k, k).
        groups: Columns of each effect.
        level: Probability that any is accepted if all are 0.

    Returns:
        Numbers of groups.
    """
    found: list[tuple[int, float]] = []
    # Below 1e-9 no row depends on the effect: the rest is rounding.
    left = [n for n, each in enumerate(groups) if np.trace(information[np.ix_(each, each)]) > 1e-9]
    while left:
        kept = np.concatenate([np.zeros(0, int), *(groups[number] for number, _ in found)])
        inner = np.linalg.pinv(information[np.ix_(kept, kept)], hermitian=True)
        remaining = score - information[:, kept] @ inner @ score[kept]
        spare = information - information[:, kept] @ inner @ information[kept]
        tried = []
        for number in left:
            mine = np.ix_(groups[number], groups[number])
            size = _chi_square(remaining[groups[number]], spare[mine], information[mine])
            tried.append((_log_probability(len(groups[number]), size), number))
        logarithm, best = min(tried)
        probability = math.exp(logarithm)
        if probability * len(left) > level:
            break
        left.remove(best)
        found.append((best, probability))
    return found


def _estimated(
    score: FloatArray, information: FloatArray, groups: Sequence[IntArray]
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Sizes of the columns of some effects, estimated together, and their covariance; by effect."""
    kept = np.concatenate([np.zeros(0, int), *groups])
    # Devices may have an effect in common that the log does not show: it counts as 0.
    covariance = np.linalg.pinv(information[np.ix_(kept, kept)], rcond=1e-6, hermitian=True)
    values = covariance @ score[kept]
    ends = np.cumsum([len(each) for each in groups])
    parts = [np.arange(end - len(each), end) for each, end in zip(groups, ends, strict=True)]
    return [values[part] for part in parts], [covariance[np.ix_(part, part)] for part in parts]


def _misfit(effect: Effect, values: FloatArray, covariance: FloatArray, probability: float) -> Misfit:
    """An accepted effect. With several columns its size is their root mean square."""
    size = float(values[0]) if len(values) == 1 else float(np.sqrt((values**2).mean()))
    slope = values / (len(values) * (size or 1.0)) if len(values) > 1 else np.ones(1)
    half = Z_95 * math.sqrt(max(float(slope @ covariance @ slope), 0.0))
    kind, phrase = effect.kind, effect.kind.phrase
    if effect.limit:
        phrase = f"ranges below {effect.limit:g} in that are too large, by {{size}} for each inch less"
    ends = (size - half, size + half)
    return Misfit(kind.name, effect.owner, size, *ends, kind.unit, probability, phrase)


def _powers(
    tested: Sequence[Effect], groups: Sequence[IntArray], information: FloatArray
) -> Iterator[EffectTest]:
    """The size that each test would have found with the probability `POWER`; of several devices the
    largest."""
    level = FALSE_MISFIT_RATE / max(len(tested), 1)
    sizes: defaultdict[tuple[str, str], dict[str, float]] = defaultdict(dict)
    kinds = {each.kind.name: each.kind for each in tested}
    alone = {(each.kind.name, each.group) for each in tested if each.owner != each.group}
    for effect, group in zip(tested, groups, strict=True):
        key = effect.kind.name, effect.group
        if effect.owner == effect.group and key in alone:
            continue
        # The mean of a non-central chi-square grows by the sum of the columns' informations.
        given = float(np.trace(information[np.ix_(group, group)]))
        needed = float(chndtrinc(chdtri(len(group), level), len(group), 1.0 - POWER))
        size = max(math.sqrt(needed / max(given, 1e-12)), effect.kind.least)
        if effect.limit:
            size = effect.limit if size <= 1.0 else math.inf
        sizes[key][effect.owner] = min(size, sizes[key].get(effect.owner, math.inf))
    for (name, group_name), by_device in sizes.items():
        # A blind spot larger than all that were tried is not one that was tested for.
        seen = {device: size for device, size in by_device.items() if math.isfinite(size)}
        if seen:
            kind = kinds[name]
            yield EffectTest(name, group_name, tuple(seen), max(seen.values()), kind.unit, kind.phrase)


def held_back_misfits(scores: Mapping[str, FloatArray]) -> tuple[Misfit, ...]:
    """Kinds of sensor whose held-back readings differ from their predictions, the largest difference first.

    Args:
        scores: Absolute errors of predictions in standard deviations, (n,), by name of the kind.
    """
    tested = tested_kinds(scores)
    found = []
    for name, each in tested.items():
        # An upper bound: the probability if predictions are right exactly as often as required.
        probability = float(bdtrc(int((each > _FAR).sum()) - 1, len(each), 1.0 - _HOLDS))
        if probability * len(tested) <= FALSE_MISFIT_RATE:
            sizes = conformal_factor(each)
            found.append(Misfit(PREDICTION, name, *sizes, "", probability, _PREDICTED))
    return tuple(sorted(found, key=lambda each: -each.value))


def held_back_tests(scores: Mapping[str, FloatArray]) -> Iterator[EffectTest]:
    """The tests of held-back readings, with their power."""
    tested = tested_kinds(scores)
    for name, each in tested.items():
        counts = np.arange(len(each) + 1)
        enough = bdtrc(counts - 1, len(each), 1.0 - _HOLDS) * len(tested) <= FALSE_MISFIT_RATE
        least = int(counts[enough][0])
        # The share of predictions that must be far off, so that enough of them are with this power.
        share = float(bdtri(least - 1, len(each), 1.0 - POWER))
        size = _FAR / float(ndtri(1.0 - share / 2))
        yield EffectTest(PREDICTION, name, (name,), size, "", _PREDICTED)


def conformal_factor(scores: FloatArray) -> tuple[float, float, float]:
    """Factor on standard deviations with which predictions are right as often as required, and the ends of
    its 95 % interval. By order statistics of the scores, (n,)."""
    ordered, count = np.sort(scores), len(scores)
    ranks = [math.ceil((count + 1) * _HOLDS)]
    ranks += [int(bdtrik(share, count, _HOLDS)) + 1 for share in (0.025, 0.975)]
    value, low, high = (float(ordered[min(rank, count) - 1]) / _NORMAL_SCORE for rank in ranks)
    return value, low, high


def tested_kinds(scores: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The scores of kinds of sensor with enough held-back readings for a test; by name, as the argument."""
    return {name: each for name, each in scores.items() if len(each) >= _FEW_SCORES}


def held_back_factor(scores: Mapping[str, FloatArray]) -> float:
    """Factor on all intervals: the largest conformal factor of any kind of sensor, at least 1."""
    return max([1.0, *(conformal_factor(each)[0] for each in tested_kinds(scores).values())])


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
