"""Observation model of a kind of sensor: what calibration may estimate about it, and from which readings.

A kind lists its parameters and noise scales, each with a prior. `ObservingSensor.linearised` and
`CountingSensor.lever` say what a reading is expected to be and how it changes with pose and parameters.
A kind without parameters is reported as not identifiable.
"""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct, field

from simmer_tui.sim.angles import FloatArray


class Sort(StrEnum):
    """Sort of parameter; calibration is judged sort by sort."""

    BIAS = "bias"
    GAIN = "gain"
    ANGLE = "angle"
    DRIFT = "drift"
    NOISE = "error"
    """The standard deviation of a random error; its intervals are by factors."""


class Prior(Struct, frozen=True):
    """A parameter that calibration may estimate, with its prior about the set's value."""

    field: str
    """The field of `SensorSpec`."""
    label: str
    sort: Sort
    spread: float
    """Prior standard deviation: in `unit`, of a gain as a share of it, of a noise scale that of its
    logarithm."""
    unit: str = ""
    usual: float = 0.0
    """Of a noise scale: the prior's centre where the set has 0, which has no logarithm."""
    step: float = 0.0
    """Difference over which the derivative of a reading is taken; 0 if readings are linear in it."""


class Linearisation(Struct, frozen=True):
    """A sensor's true values at n poses, before gain and bias, with their derivatives."""

    true: FloatArray
    """(n,)."""
    proportional: FloatArray
    """The value that the Percent Error is a share of, (n,)."""
    by_pose: FloatArray
    """Derivatives by x, y (inches) and heading (degrees), (3, n)."""
    curvature: FloatArray
    """Variance that stands for what a linear model misses: bends and jumps, (n,)."""
    by_parameter: dict[str, FloatArray] = field(default_factory=dict)
    """Derivatives by parameters that have a `step`, by field."""
