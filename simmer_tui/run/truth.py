"""True values of each sensor, so that errors can be computed.

Range, line and compass sensors have their true value in the log. Odometers and gyros do not: their
errors accumulate in it. For them the truth is reckoned from the robot's true path, so wheels that
slip against a wall show as error.
"""

from __future__ import annotations

from collections.abc import Iterable

from simmer_tui.sim.angles import cos_sin
from simmer_tui.sim.path import Path, PathPosition
from simmer_tui.sim.records import Reading
from simmer_tui.sim.sensors import CountingSensor, sensor_of
from simmer_tui.sim.specs import SensorSpec
from simmer_tui.sim.trajectory import Trajectory


class Truth:
    """Follows a run's true path and says what sensors should read on it.

    `known` is False while the counters' beginnings are not known: in a log that began mid-run.
    """

    def __init__(self, sensors: Iterable[SensorSpec], known: bool) -> None:
        self.known = known
        self._sensors = {sensor.code: sensor_of(sensor) for sensor in sensors}
        self._counters = {
            code: each for code, each in self._sensors.items() if isinstance(each, CountingSensor)
        }
        self._counted = dict.fromkeys(self._counters, 0.0)

    def restart(self) -> None:
        """All counters are 0 again."""
        self.known = True
        self._counted = dict.fromkeys(self._counted, 0.0)

    def move(self, trajectory: Trajectory, until: float) -> None:
        """The robot made a movement till a simulated time."""
        turned, ahead, aside = _way(trajectory, until)
        for code, counter in self._counters.items():
            self._counted[code] += counter.counted_on(turned, ahead, aside)

    def error(self, reading: Reading, under_way: Trajectory | None, time: float) -> float | None:
        """Error of a reading taken at a simulated time, perhaps with a movement `under_way`, in
        the sensor's unit; None if that cannot be told, infinity if it saw something where nothing was
        in range, or the reverse."""
        code = reading.sensor.code
        sensor = self._sensors.get(code)
        if sensor is None:
            return None
        counter = self._counters.get(code)
        if counter is None:
            return sensor.error(reading.true, reading.value)
        if not self.known:
            return None
        true = self._counted[code]
        if under_way is not None:
            true += counter.counted_on(*_way(under_way, time))
        return counter.error(true, reading.value)


def _way(trajectory: Trajectory, until: float) -> tuple[float, float, float]:
    """Real way of a movement till a simulated time, in the robot's frame: degrees turned,
    inches ahead and to the left. Each segment brings the same."""
    path, at = trajectory.place(until)
    turned = path.start + path.turn * (at.segment + at.turned) - trajectory.path.start
    if trajectory.kind is None:
        return (turned, *_along(path, at))
    x, y = trajectory.move
    contact = trajectory.contact
    if path is trajectory.path or contact is None:
        gone = at.segment + at.translated
        return turned, gone * x, gone * y
    before = contact.segment + contact.translated
    ahead, aside = _along(path, at)
    return turned, before * x + ahead, before * y + aside


def _along(path: Path, at: PathPosition) -> tuple[float, float]:
    """Distance ahead and to the left along a path till a place on it, from its points."""
    ahead = aside = 0.0
    places = path.places
    for segment in range(at.segment + 1):
        (x, y), (next_x, next_y) = places[segment], places[segment + 1]
        part = 1.0 if segment < at.segment else at.translated
        cos, sin = cos_sin(path.start + path.turn * (segment + 1))
        ahead += part * ((next_x - x) * cos + (next_y - y) * sin)
        aside += part * ((next_y - y) * cos - (next_x - x) * sin)
    return ahead, aside
