"""After the fact: the report of this run on the screen, and where a failure points to."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Static

from simmer_tui.events import MissionEvent, Result
from simmer_tui.runlog.kept_runs import KeptRun
from simmer_tui.sim.command import printable
from simmer_tui.snapshot import LogEntry

REASONS = (":why", ":report")
"""The orders that say why something went wrong."""
POINTER = ":why says why the last movement ended as it did, :report what happened"


def has_failed(entries: Sequence[LogEntry]) -> bool:
    """Whether one of these events is the end of a mission that failed."""
    events = [entry.event for entry in entries]
    return any(isinstance(event, MissionEvent) and event.subject is Result.FAILED for event in events)


async def report_of(kept: KeptRun, width: int, plain: bool) -> str:
    """What `simmer-tui report` says of the run so far.

    It is made in a process of its own: a long run takes a while, and the robot's thread must not
    share its time with that. Raises OSError if none can be started.
    """
    await asyncio.to_thread(kept.flush)
    environment = {"COLUMNS": str(max(width, 40)), "PYTHONIOENCODING": "ascii" if plain else "utf-8"}
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "simmer_tui",
        "report",
        str(kept.path),
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


class ReportScreen(ModalScreen[None]):
    """Shows a report until dismissed."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,q,enter", "dismiss", "Close")]

    def __init__(self, text: str, path: Path) -> None:
        """`path` is what it was made from."""
        super().__init__()
        self._text = text
        self._path = path

    def compose(self) -> ComposeResult:
        with VerticalScroll(id="report"):
            yield Static(Text(self._text, no_wrap=True), id="report-text")

    def on_mount(self) -> None:
        frame = self.query_one("#report")
        frame.border_title = "Report of this run"
        frame.border_subtitle = f"escape closes; kept in {printable(self._path.name)}"
        frame.focus()
