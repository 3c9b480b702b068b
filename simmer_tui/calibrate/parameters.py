"""Parameters that calibration estimates: those of drives and sensors, and their noise scales.

Each has its row and field in the set, the set's present value, and a weak prior about it. A sensor's priors
are its kind's (sim/sensors). Priors are wide compared with the differences between robots of a course (drives
of the strength [0.05, 1] that the manual suggests, sensors of the profiles' data sheets). They separate
parameters that the data hardly separate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np
from msgspec.structs import replace

from simmer_tui.calibrate.measured_run import MeasuredRun
from simmer_tui.report.robust_statistics import Z_95
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.sensors import (
    ParameterKind,
    Prior,
    Sensor,
    parameter_value,
    sensor_of,
    with_parameters,
)
from simmer_tui.sim.specs import DriveKind, DriveSpec, SimulationSpec

AXES = ("x", "y", "r")
IDENTIFIED = 0.5
"""A parameter is identified if its posterior spread is at most this share of its prior's: the data then have
three times the information of the prior (precisions add, and 1 / 0.5^2 = 4)."""
LEAST_SCALE = 1e-6
"""Least noise scale: estimation works on logarithms."""

# Prior standard deviations of a drive's biases, by axis: inches or degrees an inch driven, or a degree
# turned. With the manual's strength = [0.05, 1] biases spread by 0.05, 0.05 and 0.5, or by 1 / 360. Priors
# are 1.6 to 36 times as wide, since a loose wheel turns a robot more than it shifts it.
_BIAS_PRIOR = (0.15, 0.15, 0.8)
_TURN_BIAS_PRIOR = (0.02, 0.02, 0.1)
# Centre of a drive's error if the set has 0: about those of the bundled drives.
_USUAL_ERROR, _USUAL_TURN_ERROR = 0.02, 0.003
_ERROR_PRIOR = 1.2
"""Prior standard deviation of the logarithm of a drive's error: a factor of 3 up or down."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of one drive or sensor."""

    owner: str
    """ID of the drive or sensor."""
    field: str
    """Field of its spec, such as `bias.x`."""
    label: str
    kind: ParameterKind
    drive: bool
    index: int
    """Row among drives or sensors."""
    present: float
    """Value in the set."""
    prior: float
    """Centre of the prior: the set's value, or a usual one for noise scales that the set leaves at 0."""
    spread: float
    """Prior standard deviation; for a noise scale, that of its logarithm."""
    unit: str
    place: tuple[float, float] = (0.0, 0.0)
    """Place of the sensor in the set, inches, from which an offset is counted."""

    @property
    def name(self) -> str:
        """Owner and label, as people read it."""
        return f"{self.owner} {self.label}"

    def value_in(self, spec: SimulationSpec) -> float:
        """Its value in a set."""
        if not self.drive:
            return parameter_value(spec.sensors[self.index], self.field, self.place)
        return float(attrgetter(self.field)(spec.drives[self.index]))

    def interval(self, value: float, spread: float) -> tuple[float, float]:
        """The 95 % interval of an estimate.

        Symmetric about a parameter, by factors about a noise scale, whose spread is that of its logarithm.
        """
        if self.kind is ParameterKind.NOISE:
            factor = math.exp(min(Z_95 * spread, 50.0))  # e^50 is practically infinite, and does not overflow
            return value / factor, value * factor
        return value - Z_95 * spread, value + Z_95 * spread


@dataclass(frozen=True)
class ParameterSpace:
    """All parameters of a robot. `parameters` are biases, gains and the like of drives and sensors,
    `noise_scales` the standard deviations of their random errors."""

    parameters: tuple[Parameter, ...]
    noise_scales: tuple[Parameter, ...]

    @cached_property
    def _columns(self) -> Mapping[tuple[bool, int, str], int]:
        return {
            (each.drive, each.index, each.field): column
            for group in (self.parameters, self.noise_scales)
            for column, each in enumerate(group)
        }

    def column(self, drive: bool, index: int, field: str) -> int:
        """Number of a parameter among `parameters`, or of a noise scale among `noise_scales`. Raises KeyError
        if it is not estimated."""
        return self._columns[drive, index, field]

    def of_sensor(self, index: int) -> dict[str, int]:
        """Numbers of a sensor's parameters and noise scales, by field."""
        return {field: n for (drive, row, field), n in self._columns.items() if not drive and row == index}

    def start(self) -> tuple[FloatArray, FloatArray]:
        """Parameters and noise scales at which estimation begins."""
        return (
            np.array([each.present for each in self.parameters]),
            np.array([each.prior for each in self.noise_scales]),
        )

    def of(self, spec: SimulationSpec) -> tuple[FloatArray, FloatArray]:
        """Parameters and noise scales of a set."""
        return (
            np.array([each.value_in(spec) for each in self.parameters]),
            np.array([max(each.value_in(spec), LEAST_SCALE) for each in self.noise_scales]),
        )

    def with_estimates(
        self, spec: SimulationSpec, parameters: FloatArray, noise_scales: FloatArray
    ) -> SimulationSpec:
        """A specification with these values in it."""
        values = (*parameters.tolist(), *noise_scales.tolist())
        pairs = zip((*self.parameters, *self.noise_scales), values, strict=True)
        changed = ((each.drive, each.index, each.field, value) for each, value in pairs)
        return with_parameter_values(spec, changed)


def with_parameter_values(spec: SimulationSpec, changed: Any) -> SimulationSpec:
    """A specification with these values and no random biases. `changed` has (True for a drive, row, field,
    value) each."""
    drives, sensors = list(spec.drives), list(spec.sensors)
    for is_drive, index, field, value in changed:
        if is_drive:
            drives[index] = _drive_with(drives[index], field, value)
        else:
            sensors[index] = with_parameters(sensors[index], {field: value})
    return replace(spec, drives=tuple(drives), sensors=tuple(sensors), randbias=False)


def _drive_with(drive: DriveSpec, field: str, value: float) -> DriveSpec:
    table, _, axis = field.partition(".")
    changed = replace(getattr(drive, table), **{axis: value}) if axis else value
    return replace(drive, **{table: changed})


def main_axis(kind: DriveKind) -> str:
    """The axis that a drive moves along."""
    return "r" if kind.turns else "x" if kind.direction.x else "y"


def observed_sensors(spec: SimulationSpec) -> dict[int, Sensor]:
    """Enabled sensors with an observation model, by row."""
    return {
        index: sensor_of(each)
        for index, each in enumerate(spec.sensors)
        if each.enabled and issubclass(each.kind, Sensor) and each.kind.parameters and not each.kind.is_opaque
    }


def parameters_of(run: MeasuredRun, prior_scale: float = 1.0) -> ParameterSpace:
    """Parameters of all drives and sensors that are enabled, or were driven in a log.

    Args:
        prior_scale: Factor on the prior spreads of the noise scales.
    """
    spec = run.spec
    parameters: list[Parameter] = []
    noise_scales: list[Parameter] = []
    driven = {index for movement in run.movements for index, _ in movement.distances(spec.drives)}
    for index, drive in enumerate(spec.drives):
        if drive.enabled or index in driven:
            parameters += [_of_drive(drive, index, "bias", axis, 1.0) for axis in AXES]
            noise_scales += [_of_drive(drive, index, "error", axis, prior_scale) for axis in AXES]
    for index, sensor in observed_sensors(spec).items():
        parameters += [_of_sensor(sensor, index, prior, 1.0) for prior in sensor.parameters]
        noise_scales += [_of_sensor(sensor, index, prior, prior_scale) for prior in sensor.noise_scales]
    return ParameterSpace(tuple(parameters), tuple(noise_scales))


def _of_drive(drive: DriveSpec, index: int, table: str, axis: str, scale: float) -> Parameter:
    """A drive's bias or error (`table`) on an axis. `scale` is a factor on the prior's spread."""
    kind, field = drive.kind, f"{table}.{axis}"
    unit = f"{'deg' if axis == 'r' else 'in'}/{kind.unit}" if axis != main_axis(kind) else ""
    label = f"{'rotation' if axis == 'r' else f'{axis}-axis'} {table}"
    value = centre = float(attrgetter(field)(drive))
    if table == "bias":
        what, spread = ParameterKind.BIAS, (_TURN_BIAS_PRIOR if kind.turns else _BIAS_PRIOR)[AXES.index(axis)]
    else:
        what, spread = ParameterKind.NOISE, _ERROR_PRIOR
        centre = value or (_USUAL_TURN_ERROR if kind.turns else _USUAL_ERROR)
    return Parameter(kind.value, field, label, what, True, index, value, centre, scale * spread, unit)


def _of_sensor(sensor: Sensor, index: int, prior: Prior, scale: float) -> Parameter:
    place = (sensor.spec.x, sensor.spec.y)
    value = parameter_value(sensor.spec, prior.field, place)
    spread = scale * prior.spread
    if prior.kind is ParameterKind.GAIN:
        spread *= abs(value) or 1.0
    centre = value or prior.usual
    kind = (sensor.spec.id, prior.field, prior.label, prior.kind)
    return Parameter(*kind, False, index, value, centre, spread, prior.unit, place)
