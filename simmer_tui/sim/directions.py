"""Names and arrows of the eight directions of a turn: tables begin at 0 degrees, go counter-clockwise."""

from simmer_tui.sim.angles import eighth_of_turn

ARROWS = ("→", "↗", "↑", "↖", "←", "↙", "↓", "↘")
"""Arrows to 0, 45 ... 315 degrees, counter-clockwise from the right."""
PLAIN_ARROWS = (">", "/", "^", "\\", "<", "/", "v", "\\")
"""The same in ASCII. Those of diagonals are lines, with one sign for both ends."""


def side_name(bearing: float, ahead: str = "ahead", behind: str = "behind") -> str:
    """Side of the robot in a direction, degrees from its front: `ahead left`.

    Args:
        bearing: Degrees, counter-clockwise.
        ahead: Word for the robot's +X.
        behind: Word for its -X.
    """
    return (
        *(ahead, f"{ahead} left", "left", f"{behind} left"),
        *(behind, f"{behind} right", "right", f"{ahead} right"),
    )[eighth_of_turn(bearing)]
