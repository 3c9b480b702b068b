"""A table of the built-in kinds of sensors: nothing is what it is not by a default alone."""

from simmer_tui.sim.sensors import Sensor, sensor_kinds


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
