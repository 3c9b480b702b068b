"""The kinds of sensor. Each is one class: its columns, true value, errors, unit and geometry.

Whoever reads names of kinds from files takes a mapping such as `KINDS`; `sensor_kinds` makes one
with kinds of your own:

    load(folder, kinds=sensor_kinds(Thermometer))
"""

from collections.abc import Mapping
from types import MappingProxyType

from simmer_tui.sim.sensors.base import (
    CountingSensor,
    Linearisation,
    ObservingSensor,
    Prior,
    Sensor,
    Sort,
    View,
    World,
    sensor_of,
)
from simmer_tui.sim.sensors.faults import Faults, Pings, has_faults
from simmer_tui.sim.sensors.own_motion import Compass, Gyro, Odometer
from simmer_tui.sim.sensors.range_sensors import RangeSensor, TimeOfFlight, Ultrasonic
from simmer_tui.sim.sensors.yes_or_no import TEST_POINTS, LineSensor, LoadSensor
from simmer_tui.sim.specs import SensorKind

SensorKinds = Mapping[str, type[SensorKind]]
"""Kinds by name, in the order in which people are told of them."""

_BUILT_IN: tuple[type[SensorKind], ...] = (
    Ultrasonic,
    TimeOfFlight,
    LineSensor,
    Compass,
    Odometer,
    Gyro,
    LoadSensor,
)


def sensor_kinds(*more: type[SensorKind]) -> SensorKinds:
    """The kinds there are and `more`, by name; none of it can be changed."""
    return MappingProxyType({kind.name: kind for kind in (*_BUILT_IN, *more)})


KINDS = sensor_kinds()

__all__ = [
    "KINDS",
    "TEST_POINTS",
    "Compass",
    "CountingSensor",
    "Faults",
    "Gyro",
    "LineSensor",
    "Linearisation",
    "LoadSensor",
    "ObservingSensor",
    "Odometer",
    "Pings",
    "Prior",
    "RangeSensor",
    "Sensor",
    "SensorKinds",
    "Sort",
    "TimeOfFlight",
    "Ultrasonic",
    "View",
    "World",
    "has_faults",
    "sensor_kinds",
    "sensor_of",
]
