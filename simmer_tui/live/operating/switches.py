"""Switches: the parts of the picture that people show and hide, each by an order and most by a key too."""

from msgspec import Struct


class Switch(Struct, frozen=True):
    """A part of the picture.

    Attributes:
        name: Name of its order, `:NAME [on|off]`, and of the part in `Scene.shown`.
        help: Meaning of the order.
        key: Field of `KeySettings` with its key; empty for none.
        label: Name of the key's action in the palette.
        at_start: True if it is shown at the start, unless the settings have a flag of its name.
    """

    name: str
    help: str
    key: str = ""
    label: str = ""
    at_start: bool = True


SWITCHES = (
    Switch("plot_robot", "draw the maze and the robot"),
    Switch("plot_sense", "draw what the sensors see", "rays", "Rays"),
    Switch("trail", "draw the route since the start", "trail", "Trail"),
    Switch("truth", "true values beside readings", "truth", "True values", at_start=False),
)
"""All switches, in the order of the help."""
SHOWN = frozenset(switch.name for switch in SWITCHES if switch.at_start)
"""Names of those that are shown at the start."""
