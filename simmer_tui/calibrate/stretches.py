"""Stretches of continuous motion as movements between stops, for logs of robots that drive by velocities.

A velocity has no length known beforehand. The commands to the wheels are in the legs of the simulated twin,
so that the commanded path is known at any time. It is cut where a sensor was read after `LEAST_DISTANCE`:
that place is a stop, although the robot may not stand. Readings between two stops are left out.

Errors follow the distance (sim/distance_errors.py): a first-order autoregressive process. Its correlation
falls to 1/e over a cell or a quarter turn, and its spread over that length is that of one movement of the
same length. With l the length in those units the variance over it is

    (l - 1 + exp(-l)) / exp(-1)        times that over l = 1

(the integral of an exponential covariance). A movement of the same length has l^2.
"""

import math
from collections.abc import Mapping

import numpy as np

from simmer_tui.calibrate.geometry import displacements, on_axes
from simmer_tui.sim.arcs import Arc, Twist
from simmer_tui.sim.arrays import BoolArray, FloatArray
from simmer_tui.sim.distance_errors import REFERENCE_TURN, components
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors import CountingSensor, Sensor, modelled_sensor
from simmer_tui.sim.specs import CELL_SIZE, DriveKind, DriveSpec, SensorSpec

LEAST_DISTANCE, LEAST_TURN = 3.0, 20.0
"""Inches and degrees after which a reading makes a stop: a quarter of the errors' correlation length, within
which the path is known better than by ranges."""
_LATER, _GOLDEN = 0.4, 0.618034
"""Share of these by which a stop may be later, and the step by which this varies. So a program that reads its
sensors in turn does not have the same one at each stop (multiples of the golden ratio are spread evenly)."""
_THERE, _THERE_TURN = 0.2, 1.5
"""Inches and degrees from a stop within which a range is one at it: less than its error."""
_NEAR, _NEAR_TURN = 0.5, 3.0
"""Inches and degrees from a stop within which a counter is corrected to its value there. Over these, the
error by unknown gains and biases, 5 %, is less than the errors of drives over a stretch."""
ARC_SEGMENTS = 1000
"""Segments of a continuous motion in the drive law: over a quarter turn its chord then differs by 0.05
degrees from that of an arc."""
_START = Pose(0.0, 0.0, 0.0)


REFERENCES = np.array((CELL_SIZE, CELL_SIZE, REFERENCE_TURN))
"""Correlation lengths of errors, by axis, inches or degrees."""


def _units(lengths: FloatArray, turns: bool | BoolArray, least: float) -> FloatArray:
    """Lengths of drives in units of their correlation lengths, at least `least`."""
    return np.maximum(np.abs(lengths) / np.where(turns, REFERENCE_TURN, CELL_SIZE), least)


def share_of_variance(lengths: FloatArray, *, turns: bool | BoolArray) -> FloatArray:
    """Variance over (n,) lengths of continuous motion, as a share of that of one movement of the same
    length."""
    # A millionth of a cell: the limit of 0 is e / 2.
    units = _units(lengths, turns, 1e-6)
    return np.where(
        units < 1e-3, math.e / 2, math.e * (units + np.expm1(-units)) / np.maximum(units, 1e-3) ** 2
    )


def prediction(lengths: FloatArray, *, turns: bool | BoolArray) -> tuple[FloatArray, FloatArray]:
    """Prediction of the errors of (n,) stretches from those of equally long stretches before them.

    Returns:
        The factor a on the previous error rate, and the remaining share of the variance. The share is 1 +
        a^2 - 2 a r, with r the correlation of two neighbours, (1 - exp(-l))^2 / 2 (l - 1 + exp(-l)).
        The factor is the one for which many stretches together have their right variance, l / (l - 1
        + exp(-l)) of that of independent ones.
    """
    # At least a hundredth of a length: below it factor and share are differences of nearly equal numbers.
    units = _units(lengths, turns, 1e-2)
    left = units + np.expm1(-units)
    neighbours = np.expm1(-units) ** 2 / (2 * left)
    lasting = units / left
    half = lasting - neighbours
    factor: FloatArray = (half - np.sqrt(half**2 - (lasting - 1) ** 2)) / (lasting - 1)
    share: FloatArray = 1 + factor**2 - 2 * factor * neighbours
    return factor, share


class VelocityStretch:
    """The commanded path of a robot since its last stop."""

    def __init__(self, drives: tuple[DriveSpec, ...]) -> None:
        self._drives, self._stops = drives, 0
        self._rows: Mapping[DriveKind, DriveSpec] = {each.kind: each for each in drives if each.enabled}
        self._index = {each.kind: number for number, each in enumerate(drives)}
        self.clear()

    def clear(self) -> None:
        """Begin again at a new stop."""
        self._stops += 1
        self._pose, self._asked = _START, np.zeros(3)
        self._travelled = self._turn = 0.0
        self._distances: dict[int, float] = {}

    def drive(self, twist: Twist, seconds: float) -> None:
        """Add so many seconds at a commanded twist."""
        parts = components(twist, self._rows)
        if seconds <= 0.0 or not parts:
            return
        totals = np.zeros(3)
        for part in parts:
            index = self._index[part.drive.kind]
            self._distances[index] = self._distances.get(index, 0.0) + part.speed * seconds
            totals += part.speed * np.abs(on_axes(part.drive.kind.direction))
        self._asked += totals * seconds
        commanded = Twist(*totals.tolist())
        self._pose = Arc.of(self._pose, commanded, seconds).end
        self._travelled += commanded.speed * seconds
        self._turn += abs(commanded.r) * seconds

    @property
    def is_long(self) -> bool:
        """True if a reading here makes a stop."""
        later = 1.0 + _LATER * (self._stops * _GOLDEN % 1.0)
        return self._travelled >= LEAST_DISTANCE * later or self._turn >= LEAST_TURN * later

    def at_stop(self, sensor: SensorSpec, value: float) -> float | None:
        """A reading made now, corrected to the last stop; None if that is too far away."""
        kind = modelled_sensor(sensor) if issubclass(sensor.kind, Sensor) else None
        near = self._travelled <= _NEAR and self._turn <= _NEAR_TURN
        if isinstance(kind, CountingSensor) and near:
            return value - sensor.gain * float(kind.lever @ self._asked)
        if kind is not None and kind.is_heading and near:
            return value - sensor.gain * float(self._asked[2])
        return value if self._travelled <= _THERE and self._turn <= _THERE_TURN else None

    @property
    def has_moved(self) -> bool:
        """True if a motion was commanded."""
        return self._travelled > 0.0 or self._turn > 0.0

    @property
    def asked(self) -> tuple[float, float, float]:
        """Commanded inches ahead and to the left, and degrees, as the wheels count them."""
        x, y, r = self._asked.tolist()
        return x, y, r

    @property
    def bend(self) -> complex:
        """Distance of its end from that of one arc with these totals, inches in the frame of its start."""
        return complex(self._pose.x, self._pose.y) - complex(
            displacements(self._asked[None], ARC_SEGMENTS)[0]
        )

    @property
    def distances(self) -> tuple[tuple[int, float], ...]:
        """Drives, by their rows, and the signed distance of each, inches or degrees; first the one with the
        greatest share of a cell or a quarter turn."""

        def share(part: tuple[int, float]) -> float:
            return abs(part[1]) / (REFERENCE_TURN if self._drives[part[0]].kind.turns else CELL_SIZE)

        return tuple(sorted(self._distances.items(), key=share, reverse=True))
