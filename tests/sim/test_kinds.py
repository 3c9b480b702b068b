"""A table of the built-in kinds of sensors: nothing is what it is not by a default alone."""

import math

import numpy as np
from msgspec.structs import fields

from simmer_tui.sim import ObservingSensor, Pose, SensorSpec, World
from simmer_tui.sim.columns import WRAP
from simmer_tui.sim.sensors import Sensor, sensor_kinds, sensor_of


def test_kinds_are_what_their_names_say() -> None:
    """Name: measures a distance, sends sound, answers yes or no, counts."""
    kinds = [kind for kind in sensor_kinds().values() if issubclass(kind, Sensor)]
    told = {kind.name: (kind.is_range, kind.pings, kind.is_yes_or_no, kind.counts) for kind in kinds}
    built_in = {
        "ultra": (True, True, False, False),
        "tof": (True, False, False, False),
        "ir": (False, False, True, False),
        "comp": (False, False, False, False),
        "odom": (False, False, False, True),
        "gyro": (False, False, False, True),
        "load": (False, False, True, False),
        "lidar": (True, False, False, False),
    }
    assert {name: told[name] for name in built_in} == built_in


class Bearing(ObservingSensor):
    """The direction from the robot's place to the origin, degrees: of either sign, and periodic."""

    name = "bear"
    meaning = "bearing"
    unit = "deg"
    columns = (WRAP,)

    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        return math.degrees(math.atan2(-pose.y, -pose.x)) - pose.heading, None


def test_a_kinds_readings_may_be_negative_and_periodic_where_a_lost_pose_is_searched() -> None:
    sensor = sensor_of(SensorSpec(kind=Bearing, number=1, code="b1", wrap=360.0))
    assert isinstance(sensor, ObservingSensor)
    below, above, far = sensor.rough_likelihood(-150.0, np.array((-150.0, 210.0, -60.0)))
    assert below > far > 0.0
    assert above > far
    assert sensor.rough_likelihood(-150.0, np.array((-50.0,))) > 0.0


def test_a_row_has_the_fields_of_its_kind_and_no_others() -> None:
    common = {each.name for each in fields(SensorSpec)}
    for kind in sensor_kinds().values():
        columns = {column.field for column in kind.columns}
        has = {each.name for each in fields(kind.spec_type)}
        assert columns <= has, kind.name
        own = {name for name in kind.spec_type.__annotations__ if name not in common}
        assert own <= columns, kind.name
    owners = {name: kind.name for kind in sensor_kinds().values() for name in kind.spec_type.__annotations__}
    assert (owners["hard_iron"], owners["ticks_per_inch"], owners["cross_talk"]) == ("comp", "odom", "ultra")
    assert common.isdisjoint({"threshold", "analog", "rays", "random_walk", "field_of_view"})
