"""A live run as the screen sees it: its snapshots, and its report so far."""

import asyncio
import contextlib
import os
import re
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

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
    def _pace(self) -> str:
        engine, pace = self._server.engine, self._server.pace
        if engine.timed:
            return f"timed {engine.time_scale:g}x"
        return f"pace {pace:g}x" if pace else "full speed"

    def has_news(self, known: int) -> bool:
        server = self._server
        if server.engine.timed and time.monotonic() - self._asked >= _CLOCK_TICK:
            return True  # simulated time continues
        return server.newest != known or server.moving

    async def snapshot(self, since: int, true_values: bool) -> Snapshot:
        self._asked = time.monotonic()
        return replace(await self._server.snapshot(since, true_values), pace_text=self._pace)


_BAR = 40
"""Columns of the bar of progress. Judged: half of the narrowest screen."""
_PROGRESS = re.compile(r"simmer-tui why: ((\d+) of at most (\d+) runs: .*)")
# Judged: programs get 1.5 s to end.
_ENDING = 5.0
"""Seconds that the runs may take to end, before their process is killed; its workers then end themselves."""


async def why_text(saved: SavedRun, width: int, plain: bool, show: Callable[[str], None]) -> str:
    """Text of `simmer-tui why` for the run that has ended; `show` gets its progress.

    The runs are done in processes of their own, one fewer than there are processors: the robot's thread and
    the screen have theirs.

    Raises:
        OSError: if no process can be started.
    """
    jobs = max((os.cpu_count() or 1) - 1, 1)
    words = ("why", str(saved.path), "--yes", "--jobs", str(jobs))
    process = await _started(words, width, plain)
    assert process.stdout is not None, "a pipe"
    assert process.stderr is not None, "a pipe"
    answer = asyncio.create_task(process.stdout.read())
    other: list[str] = []
    try:
        async for line in process.stderr:
            text = line.decode("utf-8", "replace").rstrip()
            if (found := _PROGRESS.match(text)) is not None:
                show(_progress_text(int(found[2]), int(found[3]), found[1], plain))
            else:
                other.append(text)
        out = await answer
        await process.wait()
    except asyncio.CancelledError:
        answer.cancel()
        process.terminate()
        # The end of the app cancels a second time; a loop that closes would kill it in the middle of its end.
        for _ in range(2):
            with contextlib.suppress(asyncio.CancelledError, TimeoutError):
                await asyncio.wait_for(process.wait(), _ENDING)
                break
        else:
            process.kill()
        raise
    shown = out.decode("utf-8", "replace").splitlines() if process.returncode == 0 else other
    return "\n".join(each for each in shown)


def _progress_text(done: int, most: int, text: str, plain: bool) -> str:
    full = _BAR * done // max(most, 1)
    bar = ("#" if plain else "█") * full + ("." if plain else "░") * (_BAR - full)
    return f"{bar}\n{text}"


async def report_text(saved: SavedRun, width: int, plain: bool) -> str:
    """Text of `simmer-tui report` for the run so far.

    It is made in a process of its own: a long run takes a while, and the robot's thread must not
    share its time with that.

    Raises:
        OSError: if no process can be started.
    """
    process = await _started(("report", str(saved.path)), width, plain)
    try:
        out, err = await process.communicate()
    except asyncio.CancelledError:
        process.kill()
        await process.communicate()  # which closes its pipes
        raise
    shown = out if process.returncode == 0 else err
    return "\n".join(line for line in shown.decode("utf-8", "replace").splitlines())


async def _started(words: Sequence[str], width: int, plain: bool) -> asyncio.subprocess.Process:
    """`simmer-tui` with some arguments, for a page of a width. Raises OSError."""
    encoding = "ascii" if plain else "utf-8"
    environment = {"COLUMNS": str(max(width, SMALLEST_COLUMNS)), "PYTHONIOENCODING": encoding}
    return await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "simmer_tui", *words),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env=os.environ | environment,
    )
