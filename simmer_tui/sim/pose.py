"""Where the robot is."""

from __future__ import annotations

from msgspec import Struct


class Pose(Struct, frozen=True):
    """Where the robot is: centre (inches, global frame) and heading (degrees, not wrapped)."""

    x: float
    y: float
    heading: float
