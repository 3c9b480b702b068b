"""The pose of the robot."""

from msgspec import Struct

from simmer_tui.sim.angles import cos_sin


class Pose(Struct, frozen=True):
    """Pose of the robot: centre (inches, global frame) and heading (degrees, not wrapped)."""

    x: float
    y: float
    heading: float

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Global place of a point that is (x, y) in the robot's frame, inches."""
        cos, sin = cos_sin(self.heading)
        return self.x + cos * x - sin * y, self.y + sin * x + cos * y
