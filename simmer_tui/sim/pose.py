"""The pose of the robot."""

from msgspec import Struct


class Pose(Struct, frozen=True):
    """Pose of the robot: centre (inches, global frame) and heading (degrees, not wrapped)."""

    x: float
    y: float
    heading: float
