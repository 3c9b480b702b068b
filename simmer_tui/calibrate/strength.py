"""The strength of random biases, as the spread between calibrated robots.

One robot does not identify it: its biases are what they are. From five on it is the spread of their biases
beyond what standard errors explain, by the moments of DerSimonian and Laird (1986).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.special import chdtri

from simmer_tui.calibrate.estimates import ParameterEstimate
from simmer_tui.errors import CalibrationError
from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.specs import DriveKind

LEAST = 5
"""Robots from which strength is estimated: with four the interval of one bias reaches from 0.6 to
3.7 times it."""
_NAMES = ("strength of translations", "strength of rotations")


def strengths(robots: Sequence[dict[str, Any]]) -> tuple[ParameterEstimate, ...]:
    """Both numbers of `strength` from what was learned of several robots (`read_knowledge`).

    Raises:
        CalibrationError: for fewer than five robots, or if they have no bias in common that was identified.
    """
    if len(robots) < LEAST:
        raise CalibrationError(
            f"strength is estimated from {LEAST} calibrated sets on; these are {len(robots)}"
        )
    common = [name for name in robots[0]["parameters"] if all(name in each["parameters"] for each in robots)]
    found = []
    for turning, label in enumerate(_NAMES):
        units = {name: unit for name in common if (unit := _unit(name, bool(turning)))}
        if not units:
            raise CalibrationError("these sets have no drive in common whose bias was identified")
        values, errors = np.array([_biases(each, units) for each in robots]).transpose(1, 0, 2)
        value, low, high = between(values, errors)
        found.append(ParameterEstimate("strength", str(turning), label, "", 0.0, value, low, high))
    return tuple(found)


def _unit(name: str, turning: bool) -> float | None:
    """Factor of the simulator from a strength to a bias (`random_bias` in sim/noise.py); None if the
    parameter is no bias of a translation, or of a rotation if `turning`."""
    owner, _, figure = name.partition(" ")
    if owner not in set(DriveKind) or DriveKind(owner).turns != turning:
        return None
    if turning:
        return 1 / 360  # a strength of 1 is a degree in a whole turn
    return 10.0 if figure.startswith("rotation") else 1.0


def _biases(robot: dict[str, Any], units: dict[str, float]) -> tuple[FloatArray, FloatArray]:
    """Biases of one robot and their standard errors, in units of strength."""
    rows = [robot["parameters"].index(name) for name in units]
    scale = np.array(list(units.values()))
    values, variances = np.array(robot["values"])[rows], np.diag(np.array(robot["covariance"]))[rows]
    return values / scale, np.sqrt(variances) / scale


def between(values: FloatArray, errors: FloatArray) -> tuple[float, float, float]:
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
