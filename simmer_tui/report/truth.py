"""What each sensor should have read, so that its error can be told.

Range, line and compass sensors have their true value in the log. Odometers and gyros do not: their
errors accumulate in it. For them the truth is reckoned from the robot's true path, so wheels that
slip against a wall show as error.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import Reading
from simmer_tui.sim.sensors import CountingSensor, sensor_of
from simmer_tui.sim.specs import SensorSpec


class Truth:
    """Follows a run's true path and says what sensors should read on it.

    `known` is False while the counters' beginnings are not known: in a log that began mid-run.
    """

    def __init__(self, sensors: Iterable[SensorSpec], pose: Pose, known: bool) -> None:
        self.known = known
        self._sensors = {sensor.id: sensor_of(sensor) for sensor in sensors}
        self._counters = {
            name: each for name, each in self._sensors.items() if isinstance(each, CountingSensor)
        }
        self._counted = dict.fromkeys(self._counters, 0.0)
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
        centres = np.array(path)
        for name, counter in self._counters.items():
            self._counted[name] += counter.counted_on(self._pose, centres, pose)
        self._pose = pose

    def error(self, reading: Reading, pose: Pose) -> float | None:
        """How far a reading taken at a pose is off, in the sensor's unit; None if that cannot be told,
        infinity if it saw something where nothing was in range, or the reverse."""
        name = reading.sensor.id
        sensor = self._sensors.get(name)
        if sensor is None:
            return None
        true = reading.true
        if isinstance(sensor, CountingSensor):
            if not self.known:
                return None
            here = np.array(((self._pose.x, self._pose.y), (pose.x, pose.y)))
            true = self._counted[name] + sensor.counted_on(self._pose, here, pose)
        return sensor.error(true, reading.value)
