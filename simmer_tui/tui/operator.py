"""What a person at the screen does to the robot. Nothing here waits for the robot's thread."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from simmer_tui.events import Action, ActionName
from simmer_tui.server import Server
from simmer_tui.sim.command import Command, parse_command
from simmer_tui.sim.records import CommandResult
from simmer_tui.sim.specs import DriveKind
from simmer_tui.tui.maze_pane import DRIVES

_OPPOSITE = {
    DriveKind.UP: DriveKind.DOWN,
    DriveKind.DOWN: DriveKind.UP,
    DriveKind.LEFT: DriveKind.RIGHT,
    DriveKind.RIGHT: DriveKind.LEFT,
}


class Operator:
    """Puts a person's commands and actions into the robot's queue."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._spec = server.configuration.simulation
        self._screen = server.configuration.settings.screen
        self._session = server.open_session()

    def send(self, command: Command, refused: Callable[[str], None] | None = None) -> None:
        """A command, as a program would send it. `refused` is told, in the robot's thread, why the
        robot would not do it, should that be so."""

        def answered(outcomes: Sequence[CommandResult], data: bytes | None) -> None:
            for outcome in outcomes:
                if refused is not None and outcome.reason and math.isnan(outcome.reply):
                    refused(f"{outcome.command.shown}: {outcome.reason}")

        self._server.call(self._session.submit, self._server.message(command), answered)

    def perform(self, action: Action) -> str:
        """An action. Returns a warning if it will have no effect."""
        self._server.call(self._server.engine.perform, action)
        if action.name is ActionName.SPEED and not self._server.engine.timed:
            return "no effect: motion is instant (--motion timed makes it take its time)"
        return ""

    def press(self, name: str, paused: bool) -> str:
        """What the key of that name does: `stop`, `poll`, `reset`, `pause` or `step`. Returns what is
        wrong, if anything is."""
        if name == "poll":
            for sensor in self._spec.sensors:
                if sensor.enabled:
                    self.send(parse_command(sensor.code, "keys"))
        elif name == "step":
            self._server.call(self._server.engine.step)
            return "" if paused else "step: nothing is paused"
        elif name == "pause":
            self.perform(Action(ActionName.RESUME if paused else ActionName.PAUSE, source="keys"))
        else:
            self.perform(Action(ActionName(name), source="keys"))
        return ""

    def drive(self, name: str, fine: bool) -> str:
        """Drive or turn by a key's step. Returns what is wrong if the robot cannot."""
        kind, sign = DRIVES[name]
        if kind is DriveKind.ROT:
            value = self._screen.fine_turn if fine else self._screen.turn
        else:
            value = self._screen.fine_step if fine else self._screen.step
        codes = {drive.kind: drive.code for drive in self._spec.drives if drive.enabled}
        if kind not in codes and _OPPOSITE.get(kind) in codes:
            kind, sign = _OPPOSITE[kind], -sign
        if kind not in codes:
            return f"this robot has no drive for {name.replace('_', ' ')}"
        self.send(parse_command(f"{codes[kind]}-{sign * value:g}", "keys"))
        return ""
