"""The strength of random biases, as the spread between calibrated robots.

One robot tells nothing of it: its biases are what they are. From five on, the spread of their biases beyond
what standard errors explain is told, by the moments of DerSimonian and Laird (1986).
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
"""Robots from which strength is told."""
_NAMES = ("strength of translations", "strength of rotations")


def strengths(robots: Sequence[dict[str, Any]]) -> tuple[ParameterEstimate, ...]:
    """Both numbers of `strength` from what was learned of several robots (`read_knowledge`). Raises
    CalibrationError for fewer than five, or if they have no bias in common that was told."""
    if len(robots) < LEAST:
        raise CalibrationError(f"strength is told from {LEAST} calibrated sets on; these are {len(robots)}")
    told = [dict(zip(each["parameters"], range(len(each["parameters"])), strict=True)) for each in robots]
    common = [name for name in told[0] if all(name in each for each in told)]
    found = []
    for turning, label in enumerate(_NAMES):
        names, units = [], []
        for name in common:
            owner, _, figure = name.partition(" ")
            if owner in {kind.value for kind in DriveKind} and DriveKind(owner).turns == bool(turning):
                names.append(name)
                # As the simulator draws them: `random_bias` in sim/noise.py.
                units.append(1 / 360 if turning else 10.0 if figure.startswith("rotation") else 1.0)
        if not names:
            raise CalibrationError("these sets have no drive in common whose bias was told")
        rows = [[numbers[name] for name in names] for numbers in told]
        values = np.array(
            [np.array(each["values"])[row] for each, row in zip(robots, rows, strict=True)]
        ) / np.array(units)
        errors = np.array(
            [
                np.sqrt(np.diag(np.array(each["covariance"])))[row]
                for each, row in zip(robots, rows, strict=True)
            ]
        ) / np.array(units)
        value, low, high = between(values, errors)
        found.append(ParameterEstimate("strength", str(turning), label, "", 0.0, value, low, high))
    return tuple(found)


def between(values: FloatArray, errors: FloatArray) -> tuple[float, float, float]:
    """The standard deviation between robots, from (robots, k) values with standard errors, pooled over k,
    with a 95 % interval from the chi-square distribution of as many degrees of freedom."""
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
