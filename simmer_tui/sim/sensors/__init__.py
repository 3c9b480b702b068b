"""The kinds of sensor, each one class: its columns, true value, errors, unit and geometry.

In: a `SensorSpec`, the world and the robot's pose or path.
Out: a `Reading` with its true value, and what to draw of it.

Functions that read names of kinds from files take a mapping such as `KINDS`; `sensor_kinds` makes one with
kinds of your own:

    load(folder, kinds=sensor_kinds(Thermometer))
"""

from collections.abc import Mapping
from types import MappingProxyType

from simmer_tui.sim.sensors.base import CountingSensor as CountingSensor
from simmer_tui.sim.sensors.base import ObservingSensor as ObservingSensor
from simmer_tui.sim.sensors.base import ParameterKind as ParameterKind
from simmer_tui.sim.sensors.base import Prior as Prior
from simmer_tui.sim.sensors.base import Sensor as Sensor
from simmer_tui.sim.sensors.base import View as View
from simmer_tui.sim.sensors.base import World as World
from simmer_tui.sim.sensors.base import modelled_sensor as modelled_sensor
from simmer_tui.sim.sensors.base import parameter_value as parameter_value
from simmer_tui.sim.sensors.base import sensor_of as sensor_of
from simmer_tui.sim.sensors.base import with_parameters as with_parameters
from simmer_tui.sim.sensors.lidar import Lidar as Lidar
from simmer_tui.sim.sensors.lidar import LidarSpec as LidarSpec
from simmer_tui.sim.sensors.own_motion import Compass as Compass
from simmer_tui.sim.sensors.own_motion import CompassSpec as CompassSpec
from simmer_tui.sim.sensors.own_motion import Gyro as Gyro
from simmer_tui.sim.sensors.own_motion import GyroSpec as GyroSpec
from simmer_tui.sim.sensors.own_motion import Odometer as Odometer
from simmer_tui.sim.sensors.own_motion import OdometerSpec as OdometerSpec
from simmer_tui.sim.sensors.range_sensors import RangeSensor as RangeSensor
from simmer_tui.sim.sensors.range_sensors import RangeSpec as RangeSpec
from simmer_tui.sim.sensors.range_sensors import TimeOfFlight as TimeOfFlight
from simmer_tui.sim.sensors.range_sensors import Ultrasonic as Ultrasonic
from simmer_tui.sim.sensors.range_sensors import UltrasonicSpec as UltrasonicSpec
from simmer_tui.sim.sensors.yes_or_no import LineSensor as LineSensor
from simmer_tui.sim.sensors.yes_or_no import LineSpec as LineSpec
from simmer_tui.sim.sensors.yes_or_no import LoadSensor as LoadSensor
from simmer_tui.sim.specs import SensorKind

SensorKinds = Mapping[str, type[SensorKind]]
"""Kinds by name, in the order in which lists show them."""

_BUILT_IN: tuple[type[SensorKind], ...] = (
    Ultrasonic,
    TimeOfFlight,
    LineSensor,
    Compass,
    Odometer,
    Gyro,
    LoadSensor,
    Lidar,
)


def sensor_kinds(*more: type[SensorKind]) -> SensorKinds:
    """The built-in kinds and `more`, by name, as a read-only mapping."""
    return MappingProxyType({kind.name: kind for kind in (*_BUILT_IN, *more)})


KINDS = sensor_kinds()
