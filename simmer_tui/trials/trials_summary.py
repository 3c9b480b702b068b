"""The tables that answer how often a program succeeds, and where it fails."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from simmer_tui.report.causes import Kind
from simmer_tui.report.content import Column, Table
from simmer_tui.sim.command import escape
from simmer_tui.sim.specs import CELL_SIZE
from simmer_tui.trials.estimate_text import rate, shown_estimate, shown_fraction, shown_length
from simmer_tui.trials.failures import causes_table
from simmer_tui.trials.folder import TABLE, TrialFolder
from simmer_tui.trials.intervals import distribution
from simmer_tui.trials.record import Ending, TrialResult
from simmer_tui.trials.trial import RANDOM

LISTED = 20
"""Most failed runs listed."""
SLOWEST = 5
_LIST_COLUMNS = (
    Column("run", True),
    Column("time s", True),
    Column("what happened", wraps=True),
    Column("see it", wraps=True),
)
_OF_THE_PROGRAM = (Kind.CRASHED.value, Kind.ENDED.value, Kind.NOTHING_SENT.value)
_PORTS_ADVICE = (
    "No program sent a command. A program finds its simulator by the variables SIMMER_HOST and SIMMER_PORT "
    "(simmer_tui.client does so by itself); one that has port 9000 built in needs --fixed-ports."
)


def tables(folder: TrialFolder) -> list[Table]:
    """All tables that have something to say; there must be a result."""
    results = folder.done
    made = [
        _summary(folder, results),
        causes_table(results),
        _endings(results),
        _goals(results),
        _distributions(results),
        _mazes(results),
        _starts(results),
        _slowest(folder, results),
        _failures(folder, results),
    ]
    return [table for table in made if table.rows]


def advice(results: Sequence[TrialResult]) -> str:
    """What to try when something is wrong with all runs, or empty."""
    unheard = all(result.sent_nothing for result in results)
    return _PORTS_ADVICE if unheard and not all(result.exit_code for result in results) else ""


def replay_command(folder: TrialFolder, number: int) -> str:
    """What plays a run again, to be typed."""
    return f"simmer-tui replay {shlex.quote(escape(str(folder.log(number)), 400))}"


def how(result: TrialResult) -> str:
    """Why a run failed, with the last that its program said."""
    if result.why and result.cause not in _OF_THE_PROGRAM:
        return result.why
    reason = result.reason or result.ending.value
    words = f': "{result.last_output}"' if result.last_output and result.exit_code is not None else ""
    return f"{reason}{words}"


def start_cell(result: TrialResult) -> tuple[float, float]:
    """The middle of the cell that a run began in."""
    x, y, _ = result.start
    return (math.floor(x / CELL_SIZE) + 0.5) * CELL_SIZE, (math.floor(y / CELL_SIZE) + 0.5) * CELL_SIZE


def _summary(folder: TrialFolder, results: list[TrialResult]) -> Table:
    plan = folder.plan
    planned = f"{len(results)}" if len(results) == plan.runs else f"{len(results)} of {plan.runs}"
    mission = "its mission" if folder.configuration.mission is not None else "exit code 0 is success"
    mazes = "one at random for every run" if plan.random_mazes else f"{len(plan.mazes)}" if plan.mazes else ""
    rows = [
        ("program", escape(plan.command, 200)),
        ("configuration", f"{escape(plan.configuration, 120)}, {mission}"),
        ("mazes", mazes),
        ("options", ", ".join(f"{name} {escape(str(value), 60)}" for name, value in plan.settings.items())),
        ("seed", str(plan.seed)),
        ("runs", planned),
        ("successes", str(sum(result.success for result in results))),
        ("success rate", shown_estimate(rate(results))),
        ("contacts", f"{sum(result.contacts for result in results)} in {_with_contacts(results)} runs"),
    ]
    note = "In brackets, here and below: the 95 % Wilson interval."
    return Table("Trials", (Column(""), Column("", wraps=True)), tuple(row for row in rows if row[1]), note)


def _with_contacts(results: Iterable[TrialResult]) -> int:
    return sum(result.contacts > 0 for result in results)


def _endings(results: list[TrialResult]) -> Table:
    counts = Counter(result.ending for result in results)
    rows = [
        (ending.value, str(counts[ending]), shown_fraction(counts[ending], len(results)))
        for ending in Ending
        if counts[ending]
    ]
    columns = (Column("ended by"), Column("runs", True), Column("share", True))
    return Table("How runs ended", columns, tuple(rows))


def _goals(results: list[TrialResult]) -> Table:
    columns = (Column("goal"), Column("runs", True), Column("share", True), Column("median time s", True))
    if all(result.drop_zone is None for result in results):
        return Table("How far they came", columns, ())
    rows = []
    goals: dict[str, Callable[[TrialResult], float | None]] = {
        "loading zone reached": lambda result: result.reached,
        "block taken": lambda result: result.taken,
        "block delivered": lambda result: result.delivered,
    }
    for name, when in goals.items():
        times = [time for time in map(when, results) if time is not None]
        median = shown_length(distribution(times).median) if times else ""
        rows.append((name, str(len(times)), shown_fraction(len(times), len(results)), median))
    return Table("How far they came", columns, tuple(rows))


def _distributions(results: list[TrialResult]) -> Table:
    successes = [result for result in results if result.success]
    figures: list[tuple[str, list[float], int]] = []
    if successes:
        figures = [
            ("time of successful runs s", [result.time for result in successes], 1),
            ("distance of successful runs in", [result.distance for result in successes], 1),
            ("commands of successful runs", [float(result.commands) for result in successes], 0),
        ]
    figures.append(("contacts of all runs", [float(result.contacts) for result in results], 0))
    rows = []
    for name, values, decimals in figures:
        spread = distribution(values)
        quantiles = (spread.least, spread.quarter, spread.median, spread.three_quarters, spread.most)
        rows.append((name, *(f"{value:.{decimals}f}" for value in quantiles)))
    names = ("least", "1/4", "median", "3/4", "most")
    return Table("Distributions", (Column(""), *(Column(name, True) for name in names)), tuple(rows))


def _shares(title: str, what: str, groups: dict[str, list[TrialResult]]) -> Table:
    rows = [
        (
            name,
            str(len(group)),
            str(sum(result.success for result in group)),
            shown_estimate(rate(group), ".2f"),
            str(sum(result.contacts for result in group)),
        )
        for name, group in groups.items()
    ]
    columns = (
        Column(what),
        Column("runs", True),
        Column("successes", True),
        Column("success rate", True),
        Column("contacts", True),
    )
    return Table(title, columns, tuple(rows) if len(rows) > 1 else ())


def _mazes(results: list[TrialResult]) -> Table:
    groups: dict[str, list[TrialResult]] = {}
    for result in sorted(results, key=lambda each: each.maze):
        groups.setdefault(escape(result.maze, 60), []).append(result)
    return _shares("By maze", "maze", groups)


def _starts(results: list[TrialResult]) -> Table:
    """Only where all runs are in the same maze is a place the same place."""
    groups: dict[str, list[TrialResult]] = {}
    if len({result.maze for result in results}) == 1 and results[0].maze != RANDOM:
        for result in sorted(results, key=lambda each: (-start_cell(each)[1], start_cell(each)[0])):
            x, y = start_cell(result)
            groups.setdefault(f"({x:g}, {y:g})", []).append(result)
    return _shares("By start cell", "middle in", groups)


def _slowest(folder: TrialFolder, results: list[TrialResult]) -> Table:
    slowest = sorted((each for each in results if each.success), key=lambda each: (-each.time, each.number))
    rows = [
        _listed(folder, result, f"{shown_length(result.distance)} in, {result.commands} commands")
        for result in slowest[:SLOWEST]
    ]
    return Table("Slowest successful runs", _LIST_COLUMNS, tuple(rows))


def _failures(folder: TrialFolder, results: list[TrialResult]) -> Table:
    failed = [result for result in results if not result.success]
    rows = [_listed(folder, result, how(result)) for result in failed[:LISTED]]
    more = len(failed) - LISTED
    return Table(
        "Failed runs", _LIST_COLUMNS, tuple(rows), f"and {more} more, in {TABLE}" if more > 0 else ""
    )


def _listed(folder: TrialFolder, result: TrialResult, what: str) -> tuple[str, ...]:
    has_log = folder.log(result.number).exists()
    command = replay_command(folder, result.number) if has_log else "no log"
    return str(result.number), shown_length(result.time), what, command


def folded(table: Table) -> Table:
    """A table for the terminal, where a command has a line of its own so that it can be copied."""
    if table.columns != _LIST_COLUMNS:
        return table
    rows = tuple((number, time, f"{what}\n{command}") for number, time, what, command in table.rows)
    return Table(table.title, _LIST_COLUMNS[:-1], rows, table.note)
