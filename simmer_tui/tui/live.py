"""A run that is going on, as the screen sees it: snapshots of it, and what a person does to its robot."""

import asyncio
import math
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence

from simmer_tui.config.loader import Configuration
from simmer_tui.events import Action, ActionName
from simmer_tui.runlog.saved_runs import SavedRun
from simmer_tui.server import Server
from simmer_tui.sim.command import Command, parse_command, printable
from simmer_tui.sim.records import CommandResult
from simmer_tui.sim.specs import DriveKind
from simmer_tui.snapshot import Snapshot
from simmer_tui.tui.key_table import DRIVES
from simmer_tui.tui.sizes import SMALLEST_COLUMNS

# The clock alone is not worth frames at the full rate: an idle screen sends next to nothing.
_CLOCK_TICK = 1.0
"""Period at which the clock of timed motion is shown while nothing else is new, seconds."""
# A robot with one of two opposite drives goes the other way by a negative value.
_OPPOSITE = {DriveKind.UP: DriveKind.DOWN, DriveKind.LEFT: DriveKind.RIGHT}
_OPPOSITE |= {backward: forward for forward, backward in _OPPOSITE.items()}


class LiveSource:
    """Snapshots of the run that a server is at."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._asked = 0.0
        self.configuration: Configuration = server.configuration
        self.name = server.configuration.name if server.prefix is None else str(server.prefix.origin)

    @property
    def ports(self) -> Mapping[str, int]:
        return self._server.ports

    @property
    def pace(self) -> str:
        engine, pace = self._server.engine, self._server.pace
        if engine.timed:
            return f"timed {engine.time_scale:g}x"
        return f"pace {pace:g}x" if pace else "full speed"

    def has_news(self, known: int) -> bool:
        server = self._server
        if server.engine.timed and time.monotonic() - self._asked >= _CLOCK_TICK:
            return True  # simulated time goes on
        return server.recorder.number != known or server.moving

    async def snapshot(self, since: int, true_values: bool) -> Snapshot:
        self._asked = time.monotonic()
        return await self._server.snapshot(since, true_values)


class Operator:
    """Puts a person's commands and actions into the robot's queue. Nothing waits for the robot's thread."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._spec = server.configuration.simulation
        self._screen = server.configuration.settings.screen
        self._session = server.open_session()

    def send(self, command: Command, refused: Callable[[str], None] | None = None) -> None:
        """Send a command, as a program would. Should the robot refuse it, `refused` is called with the
        reason, in the robot's thread."""

        def answered(results: Sequence[CommandResult], data: bytes | None) -> None:
            for result in results:
                if refused is not None and result.reason and math.isnan(result.reply):
                    refused(f"{result.command.shown}: {result.reason}")

        self._server.call(self._session.submit, self._server.message(command), answered)

    def perform(self, action: Action) -> str:
        """Perform an action. Returns a warning if it will have no effect."""
        self._server.call(self._server.engine.perform, action)
        if action.name is ActionName.SPEED and not self._server.engine.timed:
            return "no effect: motion is instant (--motion timed makes it take its time)"
        return ""

    def press(self, name: str, paused: bool) -> str:
        """Do what the key of that name does: `stop`, `poll`, `reset`, `pause` or `step`. Returns what is
        wrong, if anything is."""
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

    def drive(self, name: str, fine: bool) -> str:
        """Drive or turn by a key's step. Returns what is wrong if the robot cannot."""
        kind, sign = DRIVES[name]
        if kind is DriveKind.ROT:
            value = self._screen.fine_turn if fine else self._screen.turn
        else:
            value = self._screen.fine_step if fine else self._screen.step
        codes = {drive.kind: drive.code for drive in self._spec.drives if drive.enabled}
        # The left and right keys work on a robot that has one of the two drives.
        if kind not in codes and _OPPOSITE.get(kind) in codes:
            kind, sign = _OPPOSITE[kind], -sign
        if kind not in codes:
            return f"this robot has no drive for {name.replace('_', ' ')}"
        self.send(parse_command(f"{codes[kind]}-{sign * value:g}", "keys"))
        return ""


async def report_of(saved: SavedRun, width: int, plain: bool) -> str:
    """Text of `simmer-tui report` for the run so far.

    It is made in a process of its own: a long run takes a while, and the robot's thread must not
    share its time with that.

    Raises:
        OSError: if no process can be started.
    """
    await asyncio.to_thread(saved.flush)
    encoding = "ascii" if plain else "utf-8"
    environment = {"COLUMNS": str(max(width, SMALLEST_COLUMNS)), "PYTHONIOENCODING": encoding}
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "simmer_tui", "report", str(saved.path)),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env=os.environ | environment,
    )
    try:
        out, err = await process.communicate()
    except asyncio.CancelledError:
        process.kill()
        raise
    shown = out if process.returncode == 0 else err
    return "\n".join(printable(line) for line in shown.decode("utf-8", "replace").splitlines())
