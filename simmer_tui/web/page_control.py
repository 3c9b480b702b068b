"""Viewers' commands: lines and keys, carried out like those of the console."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from simmer_tui.config.keys import keys_of, shifted
from simmer_tui.config.settings import KeySettings
from simmer_tui.errors import ConsoleCommandError
from simmer_tui.links.backend import CommandBudget
from simmer_tui.live.operating.orders import Local, read_console_command
from simmer_tui.live.operating.robot_operator import DRIVES, Operator
from simmer_tui.live.server import Server
from simmer_tui.run.events import Action
from simmer_tui.sim.command import Command

BUTTONS = {"poll": "read all", "pause": "pause / continue", "step": "step", "reset": "to the start"}
"""Keys of the maze that affect the robot without driving or stopping it, with the words of their buttons."""
_PRESSES = ("stop", *BUTTONS)
# Textual's names of keys, and those of browsers where they differ.
_BROWSER_KEYS = {
    "up": "ArrowUp",
    "down": "ArrowDown",
    "left": "ArrowLeft",
    "right": "ArrowRight",
    "space": " ",
    "home": "Home",
    "end": "End",
    "pageup": "PageUp",
    "pagedown": "PageDown",
    "insert": "Insert",
    "delete": "Delete",
    "backspace": "Backspace",
}


class PageControl:
    """Carries out a viewer's requests, in a queue of its own. Programs and files are excluded."""

    def __init__(self, server: Server) -> None:
        """Needs a running event loop."""
        self._server = server
        self._spec = server.configuration.simulation
        # All pages share a turn, so that none of them, nor all together, delay a program.
        self._operator = Operator(server, "page", CommandBudget("page", server.tell))

    def close(self) -> None:
        """Drop what waits: the viewer has left."""
        self._operator.close()

    def give(self, line: str, tell: Callable[[str], None]) -> None:
        """Carry out a line of the console. `tell` is called with an error, in any thread."""
        try:
            order = read_console_command(line, self._spec)
        except ConsoleCommandError as error:
            tell(str(error))
            return
        if isinstance(order, Command):
            self._operator.send(order, tell)
        elif isinstance(order, Action):
            self._show(self._operator.perform(order), tell)
        else:
            self._follow(order, tell)

    def press(self, name: str, tell: Callable[[str], None], *, fine: bool = False) -> None:
        """Do what a key does on the screen: drive by a step, stop, read all sensors ..."""
        if name in DRIVES:
            self._show(self._operator.drive(name, fine), tell)
        elif name in _PRESSES:
            self._show(self._operator.press(name, self._server.engine.paused), tell)

    def _follow(self, order: Local, tell: Callable[[str], None]) -> None:
        if order.name == "step":
            self.press("step", tell)
        elif order.name == "vv":
            self._show(self._operator.drive_for(order.argument, tell), tell)
        elif order.name == "send":
            self._show(self._operator.send_text(order.argument), tell)
        else:
            tell(f":{order.name} is for the simulator's own screen; pages give orders to the robot alone")

    @staticmethod
    def _show(text: str, tell: Callable[[str], None]) -> None:
        if text:
            tell(text)


def page_keys(keys: KeySettings) -> dict[str, list[Any]]:
    """The effect of each key, by the browser's name: its name here, and 1 if it is the fine step."""
    made: dict[str, list[Any]] = {}
    for name in (*DRIVES, *_PRESSES):
        for key in keys_of(keys, name):
            browser = _BROWSER_KEYS.get(key, key)
            if len(key) > 1 and browser == key:
                continue  # signs and function keys have other meanings in browsers
            made[browser] = [name, 0]
            if name in DRIVES:
                made[shifted(key) if len(key) == 1 else f"shift+{browser}"] = [name, 1]
    return made
