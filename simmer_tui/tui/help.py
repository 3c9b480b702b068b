"""The help screen: keys, orders and codes, made from the same tables the app works with."""

from __future__ import annotations

from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.keys import format_key
from textual.screen import ModalScreen
from textual.widgets import Static

from simmer_tui.config.describe_code import describe_code
from simmer_tui.config.keys import DRIVING, keys_of
from simmer_tui.config.robot_drawing import robot_drawing, sensor_drawing
from simmer_tui.config.settings import KeySettings, all_settings
from simmer_tui.sim.command import escape
from simmer_tui.sim.specs import SimulationSpec
from simmer_tui.tui.clipboard import ALLOWING
from simmer_tui.tui.console_commands import CONSOLE_COMMANDS

WITH_THE_MOUSE = (
    ("wheel", "on the maze: zoom"),
    ("drag", "on the maze: look elsewhere; on text: mark and copy it"),
    ("click", "on the maze: what is there"),
)
ANYWHERE = (
    ("tab", "from pane to pane; in the console, complete what is typed"),
    ("escape", "from the console to the maze"),
    ("enter", "in the console: give the line; from the maze: to the console"),
    (":", "from the maze to the console, beginning an order"),
    ("up, down", "in the console: what was typed before"),
    ("ctrl+p", "command palette: everything by name"),
    ("f2, or 1 to 4", "on small screens: the next page, or a page (from the maze)"),
    ("ctrl+q", "end"),
)
"""Keys that are not settings."""
IN_LOG = (
    ("/, slash", "filter by what is typed next; escape shows all"),
    ("enter", "unfold readings, or the rest of a long line; fold again"),
    ("c", "copy to the clipboard"),
    ("up, down, end", "move; to the newest"),
    ("escape", "to the maze"),
)
"""The log panel's keys."""

_WORDS = {key: key for key in ("up", "down", "left", "right")}
"""Keys that Textual would show by an arrow, which not every terminal has."""


def help_text(keys: KeySettings, spec: SimulationSpec) -> str:
    """All of the help as plain text."""
    helps = {item.name: item.help for item in all_settings()}
    lines = ["THE ROBOT from above (:help u2 tells all about one code)", ""]
    lines += robot_drawing(spec, ascii_only=True)
    lines += ["", "KEYS while the maze has the focus (settings.toml, [keys])"]
    for item in all_settings():
        if item.name.startswith("keys."):
            name = item.name.removeprefix("keys.")
            fine = "  (fine with Shift)" if name in DRIVING else ""
            lines.append(f"  {_shown(keys_of(keys, name)) or '(none)':<18}{helps[item.name]}{fine}")
    lines += ["", "KEYS anywhere", *(f"  {key:<18}{what}" for key, what in ANYWHERE)]
    lines += ["", "MOUSE", *(f"  {key:<18}{what}" for key, what in WITH_THE_MOUSE)]
    lines += ["", "COPIED TEXT arrives if this is set", *(f"  {key:<18}{what}" for key, what in ALLOWING)]
    lines += ["", "KEYS while the events have the focus", *(f"  {key:<18}{what}" for key, what in IN_LOG)]
    lines += ["", "ORDERS in the console"]
    lines += [f"  {order.usage:<24}{order.help}" for order in CONSOLE_COMMANDS.values()]
    lines += ["", "COMMANDS, in the console as from a program"]
    lines += [f"  {drive.code}-V   {drive.kind.meaning} by V" for drive in spec.drives if drive.enabled]
    if spec.gripper is not None and spec.gripper.enabled:
        lines.append(f"  {spec.gripper.code}-1   close the gripper; {spec.gripper.code}-0 opens it")
    lines += [
        f"  {sensor.code}     read {sensor.id}: {sensor.kind.meaning}"
        for sensor in spec.sensors
        if sensor.enabled
    ]
    return "\n".join(lines)


def help_screen(keys: KeySettings, spec: SimulationSpec, code: str = "") -> HelpScreen:
    """The help as a screen, or what there is to say of one code."""
    if not code:
        return HelpScreen(help_text(keys, spec))
    lines = describe_code(spec, code)
    for sensor in spec.sensors:
        if code in (sensor.code, sensor.id) and sensor.kind.has("x"):
            lines = [*lines, "", *sensor_drawing(spec.robot, sensor)]
    return HelpScreen("\n".join(lines), code)


def _shown(keys: list[str]) -> str:
    return ", ".join(_WORDS.get(key) or format_key(key) for key in keys)


class HelpScreen(ModalScreen[None]):
    """Shows the help until dismissed."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,q,question_mark,enter", "dismiss", "Close")]

    def __init__(self, text: str, code: str = "") -> None:
        super().__init__(classes="one-code" if code else None)
        self.text = text
        self._code = code

    def compose(self) -> ComposeResult:
        with VerticalScroll(id="help"):
            yield Static(Text(self.text), id="help-text")

    def on_mount(self) -> None:
        frame = self.query_one("#help")
        frame.border_title = f"Help: {escape(self._code, 20)}" if self._code else "Help"
        frame.border_subtitle = "escape closes"
        frame.focus()
