"""Change detection: the parts of a robot that no longer behave as in its calibrated set.

The estimates from a log are compared with the set's, both with their covariance. For each part (a drive, a
sensor) the likelihood ratio is the gain when its parameters may differ from the set's, and all others may
not. Without a change it is chi-square, with a degree of freedom for each parameter. Holm's procedure (1979)
keeps the family-wise rate of false alarms. The parameters of a changed part are free before the others are
tested, so that it does not affect their verdicts.

The strength of random biases is the spread between calibrated robots. One robot does not identify it, because
its biases are constant. From five robots on, it is the spread of their biases minus their standard errors, by
the moments of DerSimonian and Laird (1986).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec.structs import replace
from scipy.special import chdtrc, chdtri

from simmer_tui.calibrate.estimates import ParameterEstimate, estimates_of
from simmer_tui.calibrate.fit import Fit, Progress, fit
from simmer_tui.calibrate.measured_run import MeasuredRun
from simmer_tui.calibrate.written_set import Knowledge, knowledge_of, learned_spec
from simmer_tui.config.loader import Configuration
from simmer_tui.errors import CalibrationError
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.noise import bias_spread
from simmer_tui.sim.specs import DriveKind

FALSE_ALARMS = 0.05
"""Share of unchanged robots with the verdict "changed": the usual level of a test."""
_ANOTHER = 0.001
"""Share of pairs of logs of one robot that are refused as logs of two. It is low, because a wrong refusal
costs a user more than a wrong verdict, and different robots differ by much more."""
_UNMODELLED = 1.1
"""Factor on standard errors. Over 30 emulated robots 95 % intervals contain the truth in 93 to 95 %
(docs/calibrate.md), and errors of both set and log enter."""
_SCALES_KNOWN = 0.3
"""Factor on the prior spreads of noise scales that come from a calibrated set: their uncertainty after a few
hundred movements. Without it, noise in a short log would count as a change."""


@dataclass(frozen=True, slots=True)
class PartVerdict:
    """The test of one part."""

    owner: str
    """ID of its row."""
    probability: float
    """Probability of so great a difference without a change."""
    changed: bool
    figures: tuple[tuple[str, float, float, float], ...]
    """Label, value in the set, value in the log and the difference's standard error."""
    units: tuple[str, ...] = ()
    """Unit of each figure; empty text for none."""


def check_robot(
    run: MeasuredRun,
    configuration: Configuration,
    knowledge: Knowledge,
    progress: Progress = lambda what, share: None,
    rate: float = FALSE_ALARMS,
) -> tuple[PartVerdict, ...]:
    """Test each part of a calibrated set on a run of the robot; those that have changed come first.

    Args:
        knowledge: What was learned with the set (`read_knowledge`).
        rate: Share of unchanged robots with the verdict "changed".

    Raises:
        CalibrationError: if the path was not found, or set and log are of different robots.
    """
    here, there = run.spec, configuration.simulation
    for name in ("sensors", "drives"):
        ours, logged = ([each.code for each in getattr(spec, name)] for spec in (there, here))
        if ours != logged:
            raise CalibrationError(f"the log's {name} ({', '.join(logged)}) are not those of the set")
    # Maze and start are from the log, everything that is checked is from the set.
    spec = replace(here, sensors=there.sensors, drives=there.drives, randbias=False)
    run = dataclasses.replace(run, configuration=replace(run.configuration, simulation=spec))
    found = fit(run, prior_scale=_SCALES_KNOWN, progress=progress)
    return judged(found, knowledge, rate)


def require_one_robot(
    runs: Sequence[MeasuredRun], seed: int = 0, progress: Progress = lambda what, share: None
) -> None:
    """Raises CalibrationError if the robot of one run behaves differently from that of the longest run. A run
    that is too short to be tested by itself is skipped."""
    longest = max(runs, key=lambda run: len(run.movements))
    found = fit(longest, seed=seed, progress=progress)
    estimates = estimates_of(found)
    knowledge = knowledge_of(found, estimates)
    configuration = replace(longest.configuration, simulation=learned_spec(longest.spec, estimates))
    for run in runs:
        if run is longest:
            continue
        try:
            parts = check_robot(run, configuration, knowledge, progress, _ANOTHER)
        except CalibrationError:
            continue
        changed = [part.owner for part in parts if part.changed]
        if changed:
            raise CalibrationError(
                f"{', '.join(run.names)} is of another robot than {', '.join(longest.names)}, or the robot "
                f"has changed in between: {', '.join(changed)} differ; calibrate each by itself"
            )


def judged(found: Fit, knowledge: Knowledge, rate: float = FALSE_ALARMS) -> tuple[PartVerdict, ...]:
    """Verdicts on all parts that the log identifies, from a fit of a run about the calibrated set."""
    columns = {parameter.name: i for i, parameter in enumerate(found.space.parameters)}
    kept = [k for k, name in enumerate(knowledge.parameters) if name in columns]
    chosen = np.array([columns[knowledge.parameters[k]] for k in kept])
    prior = np.array(knowledge.values)[kept]
    covariance = np.array(knowledge.covariance)[np.ix_(kept, kept)] * _UNMODELLED**2
    information = found.information[np.ix_(chosen, chosen)] / _UNMODELLED**2
    difference = found.state.parameters[chosen] - prior
    owners = np.array([found.space.parameters[i].owner for i in chosen])
    identified = found.identified[chosen]
    errors = np.sqrt(np.diag(covariance + _pseudo_inverse(information)))

    def misfit(free: list[str]) -> float:
        return _misfit(information, covariance, difference, np.isin(owners, free))

    verdicts = []
    for owner, probability, changed in _holm(owners, list(dict.fromkeys(owners[identified])), misfit, rate):
        mine = np.flatnonzero((owners == owner) & identified)
        tested = [found.space.parameters[i] for i in chosen[mine]]
        numbers = ((prior[mine]).tolist(), (prior + difference)[mine].tolist(), errors[mine].tolist())
        figures = tuple(zip((each.label for each in tested), *numbers, strict=True))
        units = tuple(each.unit for each in tested)
        verdicts.append(PartVerdict(str(owner), probability, changed, figures, units))
    return tuple(verdicts)


def _holm(
    owners: np.ndarray[Any, Any], parts: list[str], misfit: Callable[[list[str]], float], rate: float
) -> list[tuple[str, float, bool]]:
    """Each part with its probability and verdict, those that have changed first.

    Args:
        owners: The part of each parameter.
        misfit: The misfit with some parts' parameters free.
    """
    changed: list[tuple[str, float, bool]] = []
    left = list(parts)
    while left:
        freed = [owner for owner, _, _ in changed]
        before = misfit(freed)
        probabilities = {
            owner: float(chdtrc((owners == owner).sum(), max(before - misfit([*freed, owner]), 0.0)))
            for owner in left
        }
        worst = min(left, key=lambda owner: probabilities[owner])
        if probabilities[worst] * len(left) > rate:
            return changed + [(owner, probabilities[owner], False) for owner in left]
        changed.append((worst, probabilities[worst], True))
        left.remove(worst)
    return changed


def _misfit(
    information: FloatArray,
    covariance: FloatArray,
    difference: FloatArray,
    free: np.ndarray[tuple[int], np.dtype[np.bool_]],
) -> float:
    """The least of (x - difference)' I (x - difference) + x' C^-1 x, the free parameters not held by C: the
    misfit that remains between log and set."""
    held = np.flatnonzero(~free)
    precision = np.zeros_like(covariance)
    if held.size:
        precision[np.ix_(held, held)] = np.linalg.inv(covariance[np.ix_(held, held)])
    pulled = information @ difference
    # 1e-12 of the diagonal keeps directions regular on which neither log nor set has information.
    total = information + precision + 1e-12 * np.diag(np.diag(information) + 1e-12)
    best = np.linalg.lstsq(total, pulled, rcond=None)[0]
    return float(difference @ pulled - pulled @ best)


def _pseudo_inverse(information: FloatArray) -> FloatArray:
    """The inverse, 0 in directions without information; scaled, since inches and degrees differ by 1,000."""
    # 1e-12 is below any real information: it keeps the scale of a direction without information finite.
    scale: FloatArray = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-12))
    both: FloatArray = np.outer(scale, scale)
    return np.asarray(both * np.linalg.pinv(both * information, hermitian=True))


LEAST_ROBOTS = 5
"""Robots from which strength is estimated: with four the interval of one bias reaches from 0.6 to
3.7 times it."""
_NAMES = ("translations", "rotations")


def strengths(robots: Sequence[Knowledge]) -> tuple[ParameterEstimate, ...]:
    """Both numbers of `strength` from what was learned of several robots (`read_knowledge`).

    Raises:
        CalibrationError: for fewer than five robots, or if they have no bias in common that was identified.
    """
    if len(robots) < LEAST_ROBOTS:
        raise CalibrationError(
            f"strength is estimated from {LEAST_ROBOTS} calibrated sets on; these are {len(robots)}"
        )
    common = [name for name in robots[0].parameters if all(name in each.parameters for each in robots)]
    found = []
    for turning, label in enumerate(_NAMES):
        units = {name: unit for name in common if (unit := _unit(name, bool(turning)))}
        if not units:
            raise CalibrationError("these sets have no drive in common whose bias was identified")
        values, errors = np.array([_biases(each, units) for each in robots]).transpose(1, 0, 2)
        value, low, high = spread_between_robots(values, errors)
        found.append(ParameterEstimate("strength", str(turning), label, "", 0.0, value, low, high))
    return tuple(found)


def _unit(name: str, turning: bool) -> float | None:
    """Factor of the simulator from a strength to a bias; None if the parameter is no bias of a translation,
    or of a rotation if `turning`."""
    owner, _, figure = name.partition(" ")
    if owner not in set(DriveKind) or DriveKind(owner).turns != turning:
        return None
    along, _, rotation = bias_spread(DriveKind(owner), (1.0, 1.0))
    return rotation if figure.startswith("rotation") else along


def _biases(robot: Knowledge, units: dict[str, float]) -> tuple[FloatArray, FloatArray]:
    """Biases of one robot and their standard errors, in units of strength."""
    rows = [robot.parameters.index(name) for name in units]
    scale = np.array(list(units.values()))
    values, variances = np.array(robot.values)[rows], np.diag(np.array(robot.covariance))[rows]
    return values / scale, np.sqrt(variances) / scale


def spread_between_robots(values: FloatArray, errors: FloatArray) -> tuple[float, float, float]:
    """Standard deviation between robots, with its 95 % interval.

    Args:
        values: (robots, k); the k kinds are pooled.
        errors: Standard errors of the values, of the same shape.

    Returns:
        The standard deviation and the ends of its interval, from the chi-square distribution with
        k (robots - 1) degrees of freedom.
    """
    robots, kinds = values.shape
    freedom = kinds * (robots - 1)
    scatter = float(values.var(axis=0, ddof=1).mean())
    noise = float(np.square(errors).mean())
    low, high = (freedom / float(chdtri(freedom, share)) for share in (0.025, 0.975))
    return (
        math.sqrt(max(scatter - noise, 0.0)),
        math.sqrt(max(scatter * low - noise, 0.0)),
        math.sqrt(max(scatter * high - noise, 0.0)),
    )
