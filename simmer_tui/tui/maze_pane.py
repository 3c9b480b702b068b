"""The maze view with the keys that drive the robot."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from textual.binding import Binding, BindingType

from simmer_tui.config.keys import DRIVING, keys_of, shifted
from simmer_tui.config.settings import KeySettings
from simmer_tui.sim.specs import DriveKind
from simmer_tui.tui.maze.view import MazeView

DRIVES: dict[str, tuple[DriveKind, float]] = {
    "forward": (DriveKind.RIGHT, 1.0),
    "back": (DriveKind.LEFT, 1.0),
    "turn_left": (DriveKind.ROT, 1.0),
    "turn_right": (DriveKind.ROT, -1.0),
    "sideways_left": (DriveKind.UP, 1.0),
    "sideways_right": (DriveKind.DOWN, 1.0),
}
"""What each driving key asks for: the drive and the sign of the step."""
KEYS: dict[str, tuple[str, str]] = {
    "stop": ("press('stop')", "Stop"),
    "poll": ("press('poll')", "Poll"),
    "reset": ("press('reset')", "Reset"),
    "pause": ("press('pause')", "Pause"),
    "step": ("press('step')", "Step"),
    "slower": ("pace(0.5)", "Slower"),
    "faster": ("pace(2.0)", "Faster"),
    "full_speed": ("pace(0.0)", "Full speed"),
    "trail": ("switch('trail')", "Trail"),
    "rays": ("switch('plot_sense')", "Rays"),
    "truth": ("switch('truth')", "True values"),
    "zoom_in": ("zoom(1)", "Zoom in"),
    "zoom_out": ("zoom(-1)", "Zoom out"),
    "follow": ("follow", "Follow"),
    "help": ("help", "Help"),
}
"""The app's action and the footer's word for each further key setting."""
_IN_FOOTER = ("stop", "poll", "reset", "pause", "step", "help")


def keymap(keys: KeySettings) -> dict[str, str]:
    """Keys by binding ID, as Textual's keymaps want them."""
    mapped = {name: ",".join(keys_of(keys, name)) for name in (*DRIVES, *KEYS)}
    for name in DRIVING:
        mapped[fine_id(name)] = ",".join(shifted(key) for key in keys_of(keys, name))
    return mapped


def fine_id(name: str) -> str:
    """The binding of a driving key with Shift."""
    return f"{name}_fine"


def _bindings() -> list[Binding]:
    keys = keymap(KeySettings())
    bindings = []
    for name in DRIVES:
        for fine in (False, True):
            binding = fine_id(name) if fine else name
            action = f"app.drive('{name}', {fine})"
            label = name.replace("_", " ").capitalize()
            bindings.append(Binding(keys[binding], action, label, show=False, id=binding))
    for name, (action, label) in KEYS.items():
        bindings.append(Binding(keys[name], f"app.{action}", label, show=name in _IN_FOOTER, id=name))
    # With priority each is done before the next key is looked at: see TerminalApp.
    return [replace(binding, priority=True) for binding in bindings]


class MazePane(MazeView):
    """The maze; while it has the focus its keys drive the robot."""

    BINDINGS: ClassVar[list[BindingType]] = [*_bindings()]
