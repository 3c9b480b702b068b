"""The commands of a log as a table for spreadsheets, pandas and MATLAB, written while it is read."""

from __future__ import annotations

import csv
import math
from typing import TextIO

from simmer_tui.events import CommandResult, EventHandler, MovementEnded
from simmer_tui.runlog.reader import Logged
from simmer_tui.sim.command import escape
from simmer_tui.sim.records import Status

COLUMNS = (
    "line", "t", "elapsed", "wall", "number", "source", "command", "verdict", "reply", "sensor", "true",
    "x_before", "y_before", "heading_before", "x", "y", "heading", "contact_x", "contact_y", "reason",
)  # fmt: skip


class CommandTable(EventHandler[None]):
    """A row a command. Infinities and NaN are inf, -inf and nan; what does not apply is blank."""

    def __init__(self, file: TextIO) -> None:
        self._writer = csv.writer(file, lineterminator="\n")
        self._writer.writerow(COLUMNS)
        self._ended: MovementEnded | None = None

    def add(self, logged: Logged, elapsed: float) -> None:
        """Take in an event; movements that were answered at once have their row when they end."""
        self._logged, self._elapsed = logged, elapsed
        self.handle(logged.event)

    def on_ended(self, event: MovementEnded) -> None:
        self._ended = event
        if not event.answers:
            done = CommandResult(
                event.number, event.time, event.command, Status.DONE, math.inf, event.before, event.pose
            )
            self._write(done)

    def on_result(self, event: CommandResult) -> None:
        if event.status is not Status.ACCEPTED:
            self._write(event)

    def _write(self, outcome: CommandResult) -> None:
        logged, elapsed = self._logged, self._elapsed
        before, pose, reading = outcome.before, outcome.pose, outcome.reading
        ended, self._ended = self._ended, None
        contact = ended.contact if ended is not None and ended.number == outcome.number else None
        point = ("", "") if contact is None else contact.point
        self._writer.writerow(
            (
                logged.line, outcome.time, elapsed, logged.real_time, outcome.number,
                harmless(outcome.command.source), harmless(outcome.command.text), outcome.status.value,
                outcome.reply, "" if reading is None else harmless(reading.sensor.id),
                "" if reading is None else reading.true,
                before.x, before.y, before.heading, pose.x, pose.y, pose.heading,
                point[0], point[1], harmless(outcome.reason),
            )
        )  # fmt: skip


def harmless(text: str) -> str:
    """Text that no spreadsheet takes for a formula."""
    return no_formula(escape(text, 400))


def no_formula(shown: str) -> str:
    """The same for text that is safe to show already, in whatever script: some take the wide forms too."""
    return f"'{shown}" if shown.startswith(tuple("=+-@＝＋－＠")) else shown
