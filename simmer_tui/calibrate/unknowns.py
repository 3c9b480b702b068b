"""What is to be estimated: parameters of drives and sensors, and the sizes of their random errors.

Each has a place in the set (which row, which field), the value that the set has now, and a weak prior
about it. The priors are wide against what robots of a course differ by (drives of the strength [0.05, 1]
that the manual suggests, sensors of the profiles' data sheets); they keep apart what the data hardly can.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from msgspec import structs
from msgspec.structs import replace

from simmer_tui.calibrate.measured_run import MeasuredRun
from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.specs import Axes, SimulationSpec

AXES = ("x", "y", "r")
TOLD = 0.5
"""A figure is told if its spread is at most this part of its prior's."""
_LEAST = 1e-6


class Sort(StrEnum):
    """What kind of figure it is, for judging whether intervals hold."""

    BIAS = "bias"
    GAIN = "gain"
    ANGLE = "angle"
    DRIFT = "drift"
    ERROR = "error"

    @property
    def is_size(self) -> bool:
        """Whether it is the size of a random error, whose intervals are by factors."""
        return self is Sort.ERROR


@dataclass(frozen=True, slots=True)
class Unknown:
    """One figure. `owner` is the ID of a drive or sensor, `field` that of its spec (`bias.x`), `index`
    the row among drives or sensors. Of an error size the spread is that of its logarithm."""

    owner: str
    field: str
    label: str
    sort: Sort
    drive: bool
    index: int
    present: float
    prior: float
    """The centre of the prior; error sizes that the set leaves at 0 have a usual one."""
    spread: float
    unit: str

    @property
    def name(self) -> str:
        return f"{self.owner} {self.label}"

    def value_in(self, spec: SimulationSpec) -> float:
        """What a set says of it."""
        if not self.drive:
            return float(getattr(spec.sensors[self.index], self.field))
        table, axis = self.field.split(".")
        return float(getattr(getattr(spec.drives[self.index], table), axis))


@dataclass(frozen=True)
class Unknowns:
    """All figures of a robot: `places` shift or scale what drives and sensors do, `sizes` are standard
    deviations of their random errors."""

    places: tuple[Unknown, ...]
    sizes: tuple[Unknown, ...]

    def place(self, drive: bool, index: int, field: str) -> int:
        """The number of a figure among `places`; -1 if it is none of them."""
        return _find(self.places, drive, index, field)

    def size(self, drive: bool, index: int, field: str) -> int:
        """The number of a figure among `sizes`; -1 if it is none of them."""
        return _find(self.sizes, drive, index, field)

    def start(self) -> tuple[FloatArray, FloatArray]:
        """Where estimation begins."""
        return np.array([each.present for each in self.places]), np.array([each.prior for each in self.sizes])

    def of(self, spec: SimulationSpec) -> tuple[FloatArray, FloatArray]:
        """The figures as a set has them."""
        return (
            np.array([each.value_in(spec) for each in self.places]),
            np.array([max(each.value_in(spec), _LEAST) for each in self.sizes]),
        )

    def laid_over(self, spec: SimulationSpec, places: FloatArray, sizes: FloatArray) -> SimulationSpec:
        """A specification with these figures in it."""
        drives, sensors = list(spec.drives), list(spec.sensors)
        for unknown, value in zip((*self.places, *self.sizes), (*places, *sizes), strict=True):
            if unknown.drive:
                table, axis = unknown.field.split(".")
                drive = drives[unknown.index]
                axes: Axes = structs.replace(getattr(drive, table), **{axis: float(value)})
                drives[unknown.index] = (
                    replace(drive, error=axes) if table == "error" else replace(drive, bias=axes)
                )
            else:
                changed: dict[str, Any] = {unknown.field: float(value)}
                sensors[unknown.index] = replace(sensors[unknown.index], **changed)
        return replace(spec, drives=tuple(drives), sensors=tuple(sensors), randbias=False)


def _find(among: tuple[Unknown, ...], drive: bool, index: int, field: str) -> int:
    return next(
        (i for i, each in enumerate(among) if (each.drive, each.index, each.field) == (drive, index, field)),
        -1,
    )


_RANGE = (
    ("gain", "gain", Sort.GAIN, 0.1, ""),
    ("bias", "bias", Sort.BIAS, 1.5, "in"),
    ("rotation", "mounting angle", Sort.ANGLE, 8.0, "deg"),
)
_PLACES = {
    "ultra": _RANGE,
    "tof": _RANGE,
    "odom": (("gain", "gain", Sort.GAIN, 0.15, ""),),
    "gyro": (("gain", "gain", Sort.GAIN, 0.1, ""), ("drift", "drift", Sort.DRIFT, 0.5, "deg/s")),
    "comp": (("bias", "bias", Sort.BIAS, 30.0, "deg"),),
}
_RANGE_SIZES = (
    ("error", "percent error", 0.02, 1.2, ""),
    ("absolute_error", "absolute error", 0.1, 1.5, "in"),
)
_SIZES = {
    "ultra": _RANGE_SIZES,
    "tof": _RANGE_SIZES,
    "odom": (("error", "percent error", 0.02, 1.2, ""),),
    "gyro": (
        ("error", "percent error", 0.01, 1.2, ""),
        ("random_walk", "random walk", 0.01, 1.5, "deg/sqrt s"),
    ),
    "comp": (
        ("absolute_error", "absolute error", 2.0, 1.5, "deg"),
        ("error", "percent error", 0.01, 1.5, ""),
    ),
}
"""By kind of sensor: field, label, usual size where the set has none, spread of the logarithm, unit."""


def unknowns_of(run: MeasuredRun, doubt: float = 1.0) -> Unknowns:
    """What there is to find out: of drives and sensors that are enabled, whether used or not. `doubt`
    scales the spreads of the error sizes' priors."""
    spec = run.spec
    places: list[Unknown] = []
    sizes: list[Unknown] = []
    for index, drive in enumerate(spec.drives):
        if not drive.enabled:
            continue
        turns = drive.kind.turns
        along = "r" if turns else "x" if drive.kind.direction.x else "y"
        for axis in AXES:
            angle = axis == "r"
            unit = ("deg" if angle else "in") + ("/deg" if turns else "/in")
            unit = "" if axis == along else unit
            bias, error = getattr(drive.bias, axis), getattr(drive.error, axis)
            spread = (0.1 if angle else 0.02) if turns else (0.8 if angle else 0.15)
            name = "rotation" if angle else f"{axis}-axis"
            owner = drive.kind.value
            places.append(
                Unknown(
                    owner, f"bias.{axis}", f"{name} bias", Sort.BIAS, True, index, bias, bias, spread, unit
                )
            )
            usual = error or (0.003 if turns else 0.02)
            sizes.append(
                Unknown(
                    owner, f"error.{axis}", f"{name} error", Sort.ERROR, True, index, error, usual, 1.2, unit
                )
            )
    for index, sensor in enumerate(spec.sensors):
        if not sensor.enabled:
            continue
        kind = sensor.kind.name
        for field, label, sort, spread, unit in _PLACES.get(kind, ()):
            value = getattr(sensor, field)
            if field == "gain":
                spread *= abs(value) or 1.0
            places.append(Unknown(sensor.id, field, label, sort, False, index, value, value, spread, unit))
        for field, label, usual, spread, unit in _SIZES.get(kind, ()):
            value = getattr(sensor, field)
            sizes.append(
                Unknown(
                    sensor.id, field, label, Sort.ERROR, False, index, value, value or usual, spread, unit
                )
            )
    sizes = [dataclasses.replace(each, spread=doubt * each.spread) for each in sizes]
    return Unknowns(tuple(places), tuple(sizes))


def interval(unknown: Unknown, value: float, spread: float, z: float = 1.959964) -> tuple[float, float]:
    """The interval of a figure: even about a place, by factors about an error size."""
    if unknown.sort.is_size:
        factor = math.exp(min(z * spread, 50.0))
        return value / factor, value * factor
    return value - z * spread, value + z * spread
