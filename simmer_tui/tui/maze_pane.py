"""The maze view with the keys that drive the robot."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.events import MouseDown, MouseMove, MouseScrollDown, MouseScrollUp, MouseUp
from textual.geometry import Offset

from simmer_tui.config.keys import DRIVING, keys_of, shifted
from simmer_tui.config.settings import KeySettings
from simmer_tui.sim.specs import BLOCK, START, WALL, DriveKind
from simmer_tui.tui.maze.scene import FloorMode
from simmer_tui.tui.maze.view import MazeView
from simmer_tui.tui.terminal_app import TerminalApp

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
    "stop": ("app.press('stop')", "Stop"),
    "poll": ("app.press('poll')", "Poll"),
    "reset": ("app.press('reset')", "Reset"),
    "pause": ("app.press('pause')", "Pause"),
    "step": ("app.press('step')", "Step"),
    "slower": ("app.pace(0.5)", "Slower"),
    "faster": ("app.pace(2.0)", "Faster"),
    "full_speed": ("app.pace(0.0)", "Full speed"),
    "trail": ("app.switch('trail')", "Trail"),
    "rays": ("app.switch('plot_sense')", "Rays"),
    "truth": ("app.switch('truth')", "True values"),
    "zoom_in": ("zoom(1)", "Zoom in"),
    "zoom_out": ("zoom(-1)", "Zoom out"),
    "fit": ("fit", "Whole maze"),
    "follow": ("follow", "Follow"),
    "pan_left": ("pan(-1, 0)", "Look left"),
    "pan_right": ("pan(1, 0)", "Look right"),
    "pan_up": ("pan(0, -1)", "Look up"),
    "pan_down": ("pan(0, 1)", "Look down"),
    "floor": ("floor", "Floor"),
    "help": ("app.help", "Help"),
}
"""The maze's or the app's action and the footer's word for each further key setting."""
_IN_FOOTER = ("stop", "poll", "reset", "pause", "fit", "help")
_NO_KEY = "none"
"""Stands for the key of an action without one: no key has that name. Textual takes an empty text for the
usual key."""
_PAN = 8
"""Columns a key looks further; half as many rows are as far."""
_FLOORS = {
    FloorMode.AUTO: "tiles are told apart while line sensors are read",
    FloorMode.LOUD: "tiles are always told apart",
    FloorMode.QUIET: "tiles are never told apart",
}
_CELLS = {WALL: "a wall", START: "loading zone", BLOCK: "block zone"}


def keymap(keys: KeySettings) -> dict[str, str]:
    """Keys by binding ID, as Textual's keymaps want them."""
    mapped = {name: ",".join(keys_of(keys, name)) or _NO_KEY for name in (*DRIVES, *KEYS)}
    for name in DRIVING:
        mapped[fine_id(name)] = ",".join(shifted(key) for key in keys_of(keys, name)) or _NO_KEY
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
        bindings.append(Binding(keys[name], action, label, show=name in _IN_FOOTER, id=name))
    # With priority each is done before the next key is looked at: see TerminalApp.
    return [replace(binding, priority=True) for binding in bindings]


class MouseMaze(MazeView):
    """The maze with what the mouse does to it: the wheel zooms, dragging moves the picture, a click says
    what is there; and the actions that keys may be bound to."""

    _held: Offset | None = None
    """Where the pointer was last while a button is held down on the maze."""
    _dragged = False

    def action_zoom(self, step: int) -> None:
        if step > 0:
            self.zoom_in()
        else:
            self.zoom_out()

    def action_fit(self) -> None:
        """The whole maze, as large as there is room for."""
        self.zoom_to_fit()

    def action_follow(self) -> None:
        """Keep the robot in sight, or stop doing so."""
        self.toggle_follow()
        self._say(f"follow the robot: {'on' if self.follow else 'off'}")

    def action_pan(self, columns: int, rows: int) -> None:
        """Look further that way."""
        self.pan(columns * _PAN, rows * _PAN / 2)

    def action_floor(self) -> None:
        """The next way to show the floor."""
        self.cycle_floor()
        self._say(f"floor: {_FLOORS[self.floor_mode]}")

    def on_mouse_scroll_up(self, event: MouseScrollUp) -> None:
        event.stop()
        self.zoom_at(1, event.x, event.y)

    def on_mouse_scroll_down(self, event: MouseScrollDown) -> None:
        event.stop()
        self.zoom_at(-1, event.x, event.y)

    def on_mouse_down(self, event: MouseDown) -> None:
        if event.button == 1:
            self._held, self._dragged = event.screen_offset, False
            self.capture_mouse()

    def on_mouse_move(self, event: MouseMove) -> None:
        if self._held is None or event.screen_offset == self._held:
            return
        moved, self._held = event.screen_offset - self._held, event.screen_offset
        self._dragged = True
        if not self.zoom_is_automatic:  # else the whole maze is in sight
            self.pan(-moved.x, -moved.y)

    def on_mouse_up(self, event: MouseUp) -> None:
        if self._held is None:
            return
        self._held = None
        self.release_mouse()
        if not self._dragged:
            self._say(self.what_is_at(event.x, event.y))

    def what_is_at(self, column: int, row: int) -> str:
        """Place and cell at a place of the widget, in words; empty beside the maze."""
        middle = column + 0.5, row + 0.5
        place, cell = self.to_inches(*middle), self.cell_at(*middle)
        if place is None or cell is None or self.scene is None:
            return ""
        text = f"x {place[0]:.1f}, y {place[1]:.1f} in; cell: row {cell[0] + 1}, column {cell[1] + 1}"
        what = _CELLS.get(self.scene.maze.cells[cell[0]][cell[1]])
        return f"{text} from the top left{f' ({what})' if what else ''}"

    def _say(self, text: str) -> None:
        if isinstance(self.app, TerminalApp):
            self.app.tell(text)


class MazePane(MouseMaze):
    """The maze of a live run; while it has the focus its keys drive the robot."""

    BINDINGS: ClassVar[list[BindingType]] = [*_bindings()]
