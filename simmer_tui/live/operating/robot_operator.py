"""The operator: a person's commands and actions, put into the robot's queue."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from simmer_tui.links.backend import MOST_COMMANDS, CommandBudget
from simmer_tui.live.operating.line_advice import line_advice
from simmer_tui.live.server import Server
from simmer_tui.run.events import Action, ActionName, Notice, NoticeKind
from simmer_tui.run.state import State
from simmer_tui.sim.command import Command, parse_command
from simmer_tui.sim.distance_errors import AXIS_KINDS
from simmer_tui.sim.records import CommandResult, Status
from simmer_tui.sim.specs import DriveKind, SimulationSpec, VelocityKind
from simmer_tui.sim.velocity_commands import WAIT

# Drive of each driving key, and the sign of its step. In drive.csv forward is +X, left is +Y, and a turn to
# the left is positive.
DRIVES: dict[str, tuple[DriveKind, float]] = {
    "forward": (DriveKind.RIGHT, 1.0),
    "back": (DriveKind.LEFT, 1.0),
    "turn_left": (DriveKind.ROT, 1.0),
    "turn_right": (DriveKind.ROT, -1.0),
    "sideways_left": (DriveKind.UP, 1.0),
    "sideways_right": (DriveKind.DOWN, 1.0),
}
# A thousand wait for their turn, and more are answered busy behind them: some megabytes of memory.
MOST_UNANSWERED = 4 * MOST_COMMANDS
"""Commands of a person at a page without an answer; further ones are dropped."""
# A robot with one of two opposite drives moves the other way by a negative value.
_OPPOSITE = {kind: other for pair in AXIS_KINDS for kind, other in (pair, pair[::-1])}


class Operator:
    """Puts a person's commands and actions into the robot's queue. No method waits for the robot's thread."""

    def __init__(self, server: Server, lane: str = "", budget: CommandBudget | None = None) -> None:
        """A person at a page shares the turn of its `lane`, and a `budget` bounds what waits of one."""
        self._server = server
        self._spec = server.configuration.simulation
        self._screen = server.configuration.settings.screen
        self._session, self._budget = server.open_session(lane), budget
        # Counted apart, since each is written by one thread alone.
        self._sent = self._answered = 0
        self._block_told = False
        self._block_at = self._spec.block_center
        self._block_since = -1
        """Number of the movement, if any, that was the last when the block came to its place."""

    def send(self, command: Command, refused: Callable[[str], None] | None = None) -> None:
        """Send a command, as a program would. If the robot refuses it, `refused` is called with the reason,
        in the robot's thread. Of one with a budget, commands far ahead of their answers are dropped."""

        def answered(results: Sequence[CommandResult], data: bytes | None) -> None:
            self._answered += 1
            if not results:  # a query, which is no command and makes no event
                self.hint(self._server.mission_told)
            for result in results:
                if refused is not None and result.reason and math.isnan(result.reply):
                    refused(self._refusal(result))

        if self._budget is not None and self._waiting >= MOST_UNANSWERED:
            if refused is not None:
                refused(
                    f"{command.shown}: dropped, {MOST_UNANSWERED} commands wait already. Stop them with :stop"
                )
            return
        message = self._server.message(command)
        self._sent += 1
        self._server.call(self._server.submit, message, self._session, answered, self._budget)

    @property
    def _waiting(self) -> int:
        """Count of its commands that are not answered yet."""
        return self._sent - self._answered

    def close(self) -> None:
        """Drop the commands that wait, and end a velocity that it has set."""
        self._server.call(self._session.close)

    def _refusal(self, result: CommandResult) -> str:
        is_unknown = result.status is Status.UNKNOWN or bool(result.command.problem)
        advice = line_advice(result.command.text, self._spec) if is_unknown else ""
        return advice or f"{result.command.shown}: {result.reason}"

    def perform(self, action: Action) -> str:
        """Perform an action. Returns a warning if it will have no effect."""
        self._server.call(self._server.engine.perform, action)
        if action.name is ActionName.TIME_SCALE and not self._server.engine.timed:
            return "no effect: motion is instant (--motion timed makes it take its time)"
        return ""

    def hint(self, text: str) -> None:
        """Show a hint about the robot among the events. It is not logged."""
        self._server.call(self._server.engine.tell, Notice(NoticeKind.HINT, text))

    def note_block(self, state: State) -> None:
        """Report once that the robot drives through a block that is not solid."""
        if self._block_at != (place := (state.block.x, state.block.y)):
            self._block_at, self._block_since = place, state.moved
        # A movement before the block was put there did not lead through it.
        is_new = state.moved != self._block_since
        if is_new and not self._block_told and drives_through_block(state, self._spec):
            self._block_told = True
            self.hint("drives through the block: motion.block_solid is false")

    def send_text(self, text: str) -> str:
        """Send text to the board at the laptop's line. Returns an error text if there is none."""
        link = self._server.board_link
        if link is None:
            return "send: no board has a line to a laptop; run a set with one: simmer-tui --sketch DIR"
        self._server.call(link.send, text.encode("utf-8", "surrogateescape"))
        return ""

    def press(self, name: str, paused: bool) -> str:
        """Do the action of a key: `stop`, `poll`, `reset`, `pause` or `step`. Returns an error text, or an
        empty one."""
        if name == "poll":
            for sensor in self._spec.sensors:
                if sensor.enabled:
                    self.send(parse_command(sensor.code, "keys"))
        elif name == "step":
            self._server.call(self._server.engine.step)
            return "" if paused else "step: nothing is paused"
        else:
            name = "resume" if name == "pause" and paused else name
            self.perform(Action(ActionName(name), source="keys"))
        return ""

    @property
    def velocity_code(self) -> str:
        """Code of the command that sets the whole velocity, empty if the set has none."""
        velocities = self._spec.velocities
        return next((each.code for each in velocities if each.kind is VelocityKind.ALL and each.enabled), "")

    def drive_for(self, values: str, refused: Callable[[str], None]) -> str:
        """Drive at a velocity `VX;VY;OMEGA;T` for its time; in instant motion a wait lets that time pass.

        Returns an error text if the set has no such command. `refused` is called as for `send`.
        """
        if not self.velocity_code:
            return "vv: this set's drive.csv has no enabled row velocity"
        for text in (f"{self.velocity_code}-{values}", f"{WAIT}-{values.rpartition(';')[2]}"):
            self.send(parse_command(text, "console"), refused)
        return ""

    def drive(self, name: str, fine: bool) -> str:
        """Drive or turn by a key's step. Returns an error text if the robot cannot."""
        kind, sign = DRIVES[name]
        if kind is DriveKind.ROT:
            value = self._screen.fine_turn if fine else self._screen.turn
        else:
            value = self._screen.fine_step if fine else self._screen.step
        codes = {drive.kind: drive.code for drive in self._spec.drives if drive.enabled}
        # The left and right keys also work on a robot with only one of the two drives.
        if kind not in codes and _OPPOSITE.get(kind) in codes:
            kind, sign = _OPPOSITE[kind], -sign
        if kind not in codes:
            return f"this robot has no drive for {name.replace('_', ' ')}"
        self.send(parse_command(f"{codes[kind]}-{sign * value:g}", "keys"))
        return ""


def drives_through_block(state: State, spec: SimulationSpec) -> bool:
    """True if the robot's last movement leads through a block that does not stop it."""
    block = state.block
    if spec.block_solid or not block.size or state.holding or not len(state.path):
        return False
    path = state.path
    return bool(np.hypot(path[:, 0] - block.x, path[:, 1] - block.y).min() < spec.robot.reach)
