"""A live run as the screen sees it: its snapshots, and its report so far."""

import asyncio
import os
import sys
import time
from collections.abc import Mapping

from simmer_tui.config.loader import Configuration
from simmer_tui.live.server import Server
from simmer_tui.live.snapshot import Snapshot
from simmer_tui.runlog.saved_runs import SavedRun
from simmer_tui.tui.sizes import SMALLEST_COLUMNS

# A changed clock is not worth frames at the full rate: an idle screen sends next to nothing.
_CLOCK_TICK = 1.0
"""Seconds between two updates of the clock in timed motion while nothing else is new."""


class LiveSource:
    """Snapshots of a server's run."""

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
            return True  # simulated time continues
        return server.recorder.number != known or server.moving

    async def snapshot(self, since: int, true_values: bool) -> Snapshot:
        self._asked = time.monotonic()
        return await self._server.snapshot(since, true_values)


async def report_text(saved: SavedRun, width: int, plain: bool) -> str:
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
        await process.communicate()  # which closes its pipes
        raise
    shown = out if process.returncode == 0 else err
    return "\n".join(line for line in shown.decode("utf-8", "replace").splitlines())
