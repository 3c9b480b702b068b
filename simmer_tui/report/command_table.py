"""The commands of a log as a table for spreadsheets, pandas and MATLAB, written while it is read."""

from __future__ import annotations

import csv
import math
from typing import TextIO

from simmer_tui.runlog.entries import CommandEntry
from simmer_tui.sim.command import escape

COLUMNS = (
    "line", "t", "elapsed", "wall", "number", "source", "command", "verdict", "reply", "sensor", "true",
    "x_before", "y_before", "heading_before", "x", "y", "heading", "contact_x", "contact_y", "reason",
)  # fmt: skip


class CommandTable:
    """A row a command. Infinities and NaN are inf, -inf and nan; what does not apply is blank."""

    def __init__(self, file: TextIO) -> None:
        self._writer = csv.writer(file, lineterminator="\n")
        self._writer.writerow(COLUMNS)

    def add(self, entry: CommandEntry, elapsed: float) -> None:
        before, pose, contact = entry.before, entry.pose, entry.contact or ("", "")
        self._writer.writerow(
            (
                entry.line, entry.t, elapsed, entry.wall, entry.number, harmless(entry.source),
                harmless(entry.command), entry.status.value, entry.reply, entry.sensor,
                "" if math.isnan(entry.true) and not entry.sensor else entry.true,
                before.x, before.y, before.heading, pose.x, pose.y, pose.heading,
                contact[0], contact[1], harmless(entry.reason),
            )
        )  # fmt: skip


def harmless(text: str) -> str:
    """Text that no spreadsheet takes for a formula."""
    shown = escape(text, 400)
    return f"'{shown}" if shown[:1] in ("=", "+", "-", "@") else shown
