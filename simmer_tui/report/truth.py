"""What each sensor should have read, so that its error can be told.

Range, line and compass sensors have their true value in the log. Odometers and gyros do not: their
errors accumulate in it. For them the truth is reckoned from the robot's true path, so wheels that
slip against a wall show as error.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from simmer_tui.sim.angles import cos_sin_array
from simmer_tui.sim.records import Pose, Reading
from simmer_tui.sim.sensors import as_read
from simmer_tui.sim.specs import SensorKind, SensorSpec

COUNTING = (SensorKind.ODOM, SensorKind.GYRO)


class Truth:
    """Follows a run's true path and says what sensors should read on it.

    `known` is False while the counters' beginnings are not known: in a log that began mid-run.
    """

    def __init__(self, sensors: Iterable[SensorSpec], pose: Pose, known: bool) -> None:
        self.sensors = {sensor.id: sensor for sensor in sensors}
        self.known = known
        self._counted = {name: 0.0 for name, sensor in self.sensors.items() if sensor.kind in COUNTING}
        self._pose = pose

    def restart(self, pose: Pose) -> None:
        """All counters are 0 again."""
        self.known = True
        self._pose = pose
        self._counted = dict.fromkeys(self._counted, 0.0)

    def place(self, pose: Pose) -> None:
        """The robot was lifted to a place; nothing counts that."""
        self._pose = pose

    def move(self, path: tuple[tuple[float, float], ...], pose: Pose) -> None:
        """The robot went along a path to a pose."""
        for name in self._counted:
            self._counted[name] += _rolled(self.sensors[name], self._pose, path, pose)
        self._pose = pose

    def error(self, reading: Reading, pose: Pose) -> float | None:
        """How far a reading taken at a pose is off, in the sensor's unit; None if that cannot be told,
        infinity if it saw something where nothing was in range, or the reverse."""
        sensor = reading.sensor
        true = reading.true
        if sensor.kind in COUNTING:
            if not self.known:
                return None
            here = (self._pose.x, self._pose.y), (pose.x, pose.y)
            true = self._counted[sensor.id] + _rolled(sensor, self._pose, here, pose)
        expected = as_read(sensor, true * sensor.gain)
        if expected == reading.value:
            return 0.0
        error = reading.value - expected
        if not math.isfinite(error):
            return math.inf
        if sensor.wrap:
            error = (error + sensor.wrap / 2) % sensor.wrap - sensor.wrap / 2
        return error


def _rolled(sensor: SensorSpec, begin: Pose, path: tuple[tuple[float, float], ...], end: Pose) -> float:
    """What a counter without error counts on a path: degrees for a gyro, inches for an odometer.

    With q its place and v its rolling direction: turning by a degrees rolls 2 pi (q x v) a / 360,
    going by t in the robot's frame rolls t . v. The heading changes evenly along the path.
    """
    turned = end.heading - begin.heading
    if sensor.kind is SensorKind.GYRO:
        return turned
    angle = math.radians(sensor.rotation)
    rolled = 2 * math.pi * (sensor.x * math.sin(angle) - sensor.y * math.cos(angle)) * turned / 360
    steps = np.diff(np.array(path), axis=0)
    if len(steps):
        fractions = (np.arange(len(steps)) + 1.0) / len(steps)
        cos, sin = cos_sin_array(begin.heading + turned * fractions + sensor.rotation)
        rolled += float(steps[:, 0] @ cos + steps[:, 1] @ sin)
    return rolled
