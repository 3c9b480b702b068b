"""Whether a robot still behaves as its set says, and which part of it has changed.

The log's own estimate of all places is held against the set's, both with their covariance. For each part
(a drive, a sensor) the likelihood ratio says what is gained by letting its places be others than the
set's, all else staying as it was learned. Under no change that is chi-square with a degree of freedom a
place; the family-wise rate of false alarms is kept by Holm's procedure (1979), part after part: one that
has changed is let go before the others are judged, so that it does not accuse them.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec.structs import replace
from scipy.special import chdtrc

from simmer_tui.calibrate.estimates import estimates_of
from simmer_tui.calibrate.fit import Fit, Progress, fit
from simmer_tui.calibrate.measured_run import MeasuredRun
from simmer_tui.calibrate.written_set import knowledge_text, learned_spec
from simmer_tui.config.loader import Configuration
from simmer_tui.errors import CalibrationError
from simmer_tui.sim.angles import FloatArray

FALSE_ALARMS = 0.05
"""How often a robot that has not changed at all is said to have."""
_ANOTHER = 0.001
"""How often two logs of one robot are taken for those of two."""
_UNMODELLED = 1.1
"""What standard errors are widened by: the fit's intervals hold a little less than they say."""
_SIZES_KNOWN = 0.3
"""How much of the usual doubt about error sizes is left when the set has them from logs."""


@dataclass(frozen=True, slots=True)
class PartVerdict:
    """One part, by the ID of its row: the probability of so great a difference without a change, and
    the figures, each with what the set has, what the log has, and the difference's standard error."""

    owner: str
    probability: float
    changed: bool
    figures: tuple[tuple[str, float, float, float], ...]


def check_robot(
    run: MeasuredRun,
    configuration: Configuration,
    knowledge: dict[str, Any],
    progress: Progress = lambda what, share: None,
    rate: float = FALSE_ALARMS,
) -> tuple[PartVerdict, ...]:
    """Test each part of a calibrated set on a run of the robot; those that have changed come first.
    Unchanged robots are accused at `rate`. Raises CalibrationError if the path was not found, or set and log
    are of different robots."""
    here, there = run.spec, configuration.simulation
    for name, rows in (("sensors", "code"), ("drives", "code")):
        ours = [getattr(each, rows) for each in getattr(there, name)]
        logged = [getattr(each, rows) for each in getattr(here, name)]
        if ours != logged:
            raise CalibrationError(f"the log's {name} ({', '.join(logged)}) are not those of the set")
    # The maze and where the robot starts are the log's; what is to be checked is the set's.
    spec = replace(here, sensors=there.sensors, drives=there.drives, randbias=False)
    run = dataclasses.replace(run, configuration=replace(run.configuration, simulation=spec))
    found = fit(run, prior_scale=_SIZES_KNOWN, progress=progress)
    return judged(found, knowledge, rate)


def require_one_robot(
    runs: Sequence[MeasuredRun], seed: int = 0, progress: Progress = lambda what, share: None
) -> None:
    """Raises CalibrationError if the robot of one run behaves otherwise than that of the longest. Of a
    run that is too short to be judged by itself nothing is said."""
    longest = max(runs, key=lambda run: len(run.movements))
    found = fit(longest, seed=seed, progress=progress)
    estimates = estimates_of(found)
    knowledge = json.loads(knowledge_text(found, estimates))
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


def judged(found: Fit, knowledge: dict[str, Any], rate: float = FALSE_ALARMS) -> tuple[PartVerdict, ...]:
    """The parts, from a fit of a run about the calibrated set."""
    numbers = {parameter.name: i for i, parameter in enumerate(found.space.parameters)}
    kept = [k for k, name in enumerate(knowledge["parameters"]) if name in numbers]
    chosen = np.array([numbers[knowledge["parameters"][k]] for k in kept])
    known = np.array(knowledge["values"])[kept]
    covariance = np.array(knowledge["covariance"])[np.ix_(kept, kept)] * _UNMODELLED**2
    information = found.information[np.ix_(chosen, chosen)] / _UNMODELLED**2
    difference = found.state.parameters[chosen] - known
    owners = np.array([found.space.parameters[i].owner for i in chosen])
    seen = {str(owner) for owner in owners if found.identified[chosen[owners == owner]].any()}
    parts = sorted(seen, key=owners.tolist().index)
    accused: list[tuple[str, float]] = []
    left = list(parts)
    while left:
        freed = [owner for owner, _ in accused]
        before = _misfit(information, covariance, difference, np.isin(owners, freed))
        probabilities = {}
        for owner in left:
            after = _misfit(information, covariance, difference, np.isin(owners, [*freed, owner]))
            probabilities[owner] = float(chdtrc((owners == owner).sum(), max(before - after, 0.0)))
        worst = min(left, key=lambda owner: probabilities[owner])
        if probabilities[worst] * len(left) > rate:
            break
        accused.append((worst, probabilities[worst]))
        left.remove(worst)
    outcome = [(owner, p, True) for owner, p in accused]
    outcome += [(owner, probabilities[owner], False) for owner in left]
    total = covariance + _pseudo_inverse(information)
    errors = np.sqrt(np.diag(total))
    made = []
    for owner, probability, changed in outcome:
        mine = np.flatnonzero(owners == owner)
        figures = tuple(
            (
                found.space.parameters[chosen[i]].label,
                float(known[i]),
                float(known[i] + difference[i]),
                float(errors[i]),
            )
            for i in mine
            if found.identified[chosen[i]]
        )
        made.append(PartVerdict(owner, probability, changed, figures))
    return tuple(made)


def _misfit(
    information: FloatArray,
    covariance: FloatArray,
    difference: FloatArray,
    free: np.ndarray[tuple[int], np.dtype[np.bool_]],
) -> float:
    """The least of (x - difference)' I (x - difference) + x' C^-1 x, the free places not held by C:
    what log and set cannot agree on."""
    held = np.flatnonzero(~free)
    precision = np.zeros_like(covariance)
    if held.size:
        precision[np.ix_(held, held)] = np.linalg.inv(covariance[np.ix_(held, held)])
    pulled = information @ difference
    total = information + precision + 1e-12 * np.diag(np.diag(information) + 1e-12)
    best = np.linalg.lstsq(total, pulled, rcond=None)[0]
    return float(difference @ pulled - pulled @ best)


def _pseudo_inverse(information: FloatArray) -> FloatArray:
    scale: FloatArray = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-12))
    both: FloatArray = np.outer(scale, scale)
    inverse: FloatArray = both * np.linalg.pinv(both * information, hermitian=True)
    return inverse
