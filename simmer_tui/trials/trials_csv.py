"""trials.csv: a row a run, for spreadsheets, pandas and MATLAB."""

from __future__ import annotations

import csv
import io

from simmer_tui.report.command_table import harmless
from simmer_tui.trials.folder import RUNS, TrialFolder
from simmer_tui.trials.record import TrialResult

COLUMNS = (
    "run", "seed", "maze", "success", "ending", "reason", "cause", "why", "exit_code", "time_s",
    "distance_in", "commands", "contacts", "start_x", "start_y", "start_heading", "end_x", "end_y",
    "end_heading", "block_x", "block_y", "drop_x", "drop_y", "reached_s", "taken_s", "delivered_s",
    "last_output", "log",
)  # fmt: skip


def csv_text(folder: TrialFolder) -> str:
    """All runs that are done, by number. What does not apply is blank; nothing depends on the machine.
    In a sweep more columns hold the values that a run had, blank where the set's own."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    plan = folder.plan
    varied = list(dict.fromkeys(name for point in plan.points for name in point))
    writer.writerow((*COLUMNS, *map(harmless, varied)))
    for result in folder.done:
        point = plan.points[plan.point(result.number)] if varied else {}
        values = [harmless(point.get(name, "")) for name in varied]
        writer.writerow((*_row(result, f"{RUNS}/{folder.log(result.number).name}"), *values))
    return text.getvalue()


def _row(result: TrialResult, log: str) -> tuple[object, ...]:
    return (
        result.number, result.seed, harmless(result.maze), int(result.success), result.ending.value,
        harmless(result.reason), harmless(result.cause), harmless(result.why),
        _or_blank(result.exit_code), result.time, result.distance, result.commands,
        result.contacts, *result.start, *result.end, *result.block, *(result.drop_zone or ("", "")),
        _or_blank(result.reached), _or_blank(result.taken), _or_blank(result.delivered),
        harmless(result.last_output), log,
    )  # fmt: skip


def _or_blank(value: float | None) -> float | str:
    return "" if value is None else value
