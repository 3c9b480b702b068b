"""The commands of a log as a table for spreadsheets, pandas and MATLAB, written while it is read."""

from __future__ import annotations

import math
from typing import TextIO

from simmer_tui.document.as_csv import CsvWriter
from simmer_tui.document.formats import POSE, Format
from simmer_tui.document.model import DataColumn
from simmer_tui.events import CommandResult, EventHandler, MovementEnded
from simmer_tui.runlog.reader import Logged
from simmer_tui.sim.records import Status

_PLACE = Format(str, ("_x_in", "_y_in"), tuple)
COLUMNS = (
    *map(DataColumn, ("line", "time_s", "elapsed_s", "real_time", "number", "source", "command", "verdict")),
    *map(DataColumn, ("reply", "sensor", "true")),
    *(DataColumn("before", POSE), DataColumn("after", POSE), DataColumn("contact", _PLACE)),
    DataColumn("reason"),
)


class CommandTable(EventHandler[None]):
    """A row a command. Infinities and NaN are inf, -inf and nan; what does not apply is blank."""

    def __init__(self, file: TextIO) -> None:
        self._writer = CsvWriter(file, COLUMNS)
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

    def _write(self, result: CommandResult) -> None:
        logged, elapsed = self._logged, self._elapsed
        reading, command = result.reading, result.command
        ended, self._ended = self._ended, None
        contact = ended.contact if ended is not None and ended.number == result.number else None
        self._writer.write(
            (
                *(logged.line, result.time, elapsed, logged.real_time, result.number),
                *(command.source, command.text, result.status.value, result.reply),
                *((None, None) if reading is None else (reading.sensor.id, reading.true)),
                *(result.before, result.pose, None if contact is None else contact.point, result.reason),
            )
        )
