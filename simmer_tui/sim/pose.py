"""Where the robot is."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the robot is: centre (inches, global frame) and heading (degrees, not wrapped)."""

    x: float
    y: float
    heading: float
