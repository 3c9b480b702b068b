"""The answer of a set of trials as a document: how often the program succeeds, and where it fails."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from operator import attrgetter

from msgspec.structs import replace

from simmer_tui.config.mission_toml import MissionSpec
from simmer_tui.document.formats import (
    COUNT,
    ESTIMATE,
    LENGTH,
    POSE,
    QUOTED,
    SHARE,
    TYPED,
    Format,
    estimate,
    number,
)
from simmer_tui.document.model import DataColumn, DataTable, Document, DocumentPart, Paragraph, data_table
from simmer_tui.run.events import Goal, goals_of
from simmer_tui.sim.command import counted, cut, typed_path
from simmer_tui.trials.chance_control import CONTROL
from simmer_tui.trials.explanations import CHANGED_RUNS, WHY_FAILED, explanation_tables
from simmer_tui.trials.failures import (
    CAUSES,
    DEVICES,
    RUN_FINDINGS,
    causes_table,
    failure_summary,
    findings_tables,
    grouped,
    success_rate,
)
from simmer_tui.trials.figures import start_cell
from simmer_tui.trials.folder import RUNS, TABLE, TrialFolder
from simmer_tui.trials.intervals import distribution, median
from simmer_tui.trials.requirement import DECISION, NO_REQUIREMENT, Requirement
from simmer_tui.trials.sweep import SWEPT
from simmer_tui.trials.trial import RANDOM, Ending, TrialResult, clock_sentences, clocks_text

_LISTED = 20
"""Most failed runs listed; all of them are in trials.csv."""
# Slowest successful runs listed.
SLOWEST = 5


def _shown_runs(runs: tuple[int, int]) -> str:
    done, planned = runs
    return f"{done}" if done == planned else f"{done} of {planned}"


def _shown_contacts(contacts: tuple[int, int]) -> str:
    number, runs = contacts
    return f"{number} in {counted(runs, 'run')}"


_COUNTED = tuple(DataColumn(key, COUNT) for key in ("runs", "successes"))
_RATE, _CONTACTS = DataColumn("success_rate", estimate(".2f")), DataColumn("contacts", COUNT)
_OPTIONS = Format(lambda options: ", ".join(f"{name} {cut(str(it))}" for name, it in options.items()))
TRIALS = data_table(
    "trials",
    "Trials",
    DataColumn("folder", Format(str), hidden=True),
    DataColumn("program", TYPED),
    DataColumn("configuration", TYPED),
    DataColumn("success_is", heading="success is"),
    DataColumn("mazes"),
    DataColumn("options", _OPTIONS),
    DataColumn("seed"),
    DataColumn("clock"),
    DataColumn("runs", Format(_shown_runs, ("", "_planned"), tuple)),
    DataColumn("successes"),
    DataColumn("success_rate", ESTIMATE),
    DataColumn("contacts", Format(_shown_contacts, ("", "_in_runs"), tuple)),
    record=True,
)
_SHARES = (DataColumn("runs", COUNT), DataColumn("share", SHARE))
ENDINGS = data_table("endings", "How runs ended", DataColumn("ended_by"), *_SHARES)
GOALS = data_table(
    "goals", "Goals reached", DataColumn("goal"), *_SHARES, DataColumn("median_time_s", LENGTH)
)
_VALUE = number()
DISTRIBUTION = data_table(
    "distributions",
    "Distributions",
    *(DataColumn("of"), DataColumn("unit")),
    DataColumn("least", _VALUE),
    DataColumn("quarter", _VALUE, "1/4"),
    DataColumn("median", _VALUE),
    DataColumn("three_quarters", _VALUE, "3/4"),
    DataColumn("most", _VALUE),
)
_REPLAY = DataColumn("replay", Format(lambda command: command or "no log"), "see it", wraps=True, line=True)
_DRIVEN = Format(lambda of: f"{LENGTH.text(of[0])} in, {of[1]} commands", ("distance_in", "commands"), tuple)
RUNS_TABLE = data_table(
    "runs",
    "Runs",
    *map(DataColumn, ("run", "seed", "maze", "success", "ending", "reason", "cause")),
    DataColumn("text"),
    *map(DataColumn, ("exit_code", "time_s", "distance_in", "commands", "contacts")),
    *(DataColumn(key, Format(str, POSE.suffixes, tuple)) for key in ("start", "end")),
    *(DataColumn(key, Format(str, ("_x_in", "_y_in"), tuple)) for key in ("block", "drop_zone")),
    *(DataColumn(f"{goal.key}_s") for goal in Goal),
    *map(DataColumn, ("output", "clock", "log")),
    hidden=True,
)
_RUN = (DataColumn("run", COUNT), DataColumn("time_s", LENGTH))
SLOWEST_RUNS = data_table(
    "slowest", "Slowest successful runs", *_RUN, DataColumn("", _DRIVEN, "what happened", wraps=True), _REPLAY
)
FAILED_RUNS = data_table(
    "failed", "Failed runs", *_RUN, DataColumn("text", heading="what happened", wraps=True), _REPLAY
)
_CELL = Format(lambda at: f"({at[0]:g}, {at[1]:g})", ("_x_in", "_y_in"), tuple)
BY_MAZE = data_table("mazes", "By maze", DataColumn("maze", QUOTED), *_COUNTED, _RATE, _CONTACTS)
BY_START = data_table(
    "start_cells", "By start cell", DataColumn("middle", _CELL, "middle in"), *_COUNTED, _RATE, _CONTACTS
)
TABLES = (
    *(TRIALS, DECISION, CAUSES, ENDINGS, GOALS, DISTRIBUTION, BY_MAZE, BY_START, SLOWEST_RUNS, FAILED_RUNS),
    *(DEVICES, RUN_FINDINGS, RUNS_TABLE, WHY_FAILED, CONTROL, CHANGED_RUNS),
)
"""All tables of a set of trials."""
_PORTS_ADVICE = (
    "No program sent a command. Connect to the address in SIMMER_HOST and SIMMER_PORT; simmer_tui.client "
    "does so by itself. For a program with port 9000 built in, add --fixed-ports."
)


def trials_document(folder: TrialFolder, requirement: Requirement = NO_REQUIREMENT) -> Document:
    """The answer about the runs that are done, for terminals and programs; there must be one run."""
    results = folder.done
    parts: list[DocumentPart] = [
        Paragraph(": ".join(success_texts(results)), "answer", "strong"),
        Paragraph(failure_summary(results), "advice"),
        Paragraph("" if folder.plan.sketches else ports_advice(results), "ports", "warning"),
        Paragraph(" ".join(clock_sentences(folder.configuration, results)), "computing", "note"),
        *trials_tables(folder),
        runs_table(folder),
        *requirement.tables(folder),
    ]
    return Document(f"Trials of {cut(folder.plan.program)}", parts)


def success_texts(results: Sequence[TrialResult]) -> tuple[str, str]:
    """The number of successes, and the success rate, in words."""
    successes = sum(result.success for result in results)
    return (
        f"{successes} of {len(results)} runs succeeded",
        f"success rate {ESTIMATE.text(success_rate(results))}",
    )


def trials_tables(folder: TrialFolder) -> list[DataTable]:
    """All tables for people that have rows; there must be a result."""
    results = folder.done
    made = [
        _summary(folder, results),
        causes_table(results),
        *findings_tables(results),
        *explanation_tables(folder),
        _endings(results),
        _goals(folder.configuration.mission, results),
        _distributions(results),
        _mazes(results),
        _starts(results),
        _slowest(folder, results),
        _failures(folder, results),
    ]
    return [table for table in made if table.rows]


def runs_table(folder: TrialFolder) -> DataTable:
    """All runs that are done, a row a run by number: trials.csv.

    Nothing in it depends on the machine. In a sweep more columns have the values of each run, blank where it
    had the set's own.
    """
    plan = folder.plan
    varied = list(dict.fromkeys(name for point in plan.points for name in point))
    rows = []
    for each in folder.done:
        point = plan.points[plan.point(each.number)] if varied else {}
        rows.append(
            (
                *(each.number, each.seed, each.maze, each.success, each.ending.value, each.reason),
                *(each.cause, each.why, each.exit_code, each.time, each.distance, each.commands),
                *(each.contacts, each.start, each.end, each.block, each.drop_zone),
                *(getattr(each, goal.key) for goal in Goal),
                *(each.last_output, each.clock),
                f"{RUNS}/{folder.log(each.number).name}",
                *(point.get(name) for name in varied),
            )
        )
    return replace(
        RUNS_TABLE, columns=(*RUNS_TABLE.columns, *(DataColumn(name, SWEPT) for name in varied)), rows=rows
    )


def ports_advice(results: Sequence[TrialResult]) -> str:
    """Advice when no program found its simulator, or empty."""
    silent = all(result.sent_nothing for result in results)
    return _PORTS_ADVICE if silent and not all(result.exit_code for result in results) else ""


def failure_text(result: TrialResult) -> str:
    """The verdict on a failed run."""
    if text := result.verdict.get("text"):
        return str(text)
    # A run in which the simulator failed has none.
    reason = result.reason or result.ending.value
    output = f': "{result.last_output}"' if result.last_output and result.exit_code is not None else ""
    return f"{reason}{output}"


def _summary(folder: TrialFolder, results: list[TrialResult]) -> DataTable:
    plan = folder.plan
    mazes = "a random one for each run" if plan.random_mazes else len(plan.mazes) or None
    row = (
        *(folder.path, plan.program, plan.configuration),
        "its mission" if folder.configuration.mission is not None else "exit code 0",
        *(mazes, dict(plan.settings), plan.seed, clocks_text(results), (len(results), plan.runs)),
        *(sum(result.success for result in results), success_rate(results)),
        (sum(result.contacts for result in results), sum(result.contacts > 0 for result in results)),
    )
    note = "In brackets, here and below: the 95 % Wilson interval."
    return TRIALS.filled([row], note)


def _rated(group: Sequence[TrialResult]) -> tuple[object, ...]:
    """Runs, successes, success rate and contacts."""
    successes = sum(result.success for result in group)
    return len(group), successes, success_rate(group), sum(result.contacts for result in group)


def _endings(results: list[TrialResult]) -> DataTable:
    counts = Counter(result.ending for result in results)
    rows = [(each.value, counts[each], counts[each] / len(results)) for each in Ending if counts[each]]
    return ENDINGS.filled(rows)


def _goals(mission: MissionSpec | None, results: list[TrialResult]) -> DataTable:
    """Goals that the mission asks for; no rows without one, or if no run of it began."""
    if mission is None or all(result.drop_zone is None for result in results):
        return GOALS
    rows = []
    for goal in goals_of(mission):
        moments = (getattr(result, goal.key) for result in results)
        times = [time for time in moments if time is not None]
        rows.append((goal.value, len(times), len(times) / len(results), median(times)))
    return GOALS.filled(rows)


def _distributions(results: list[TrialResult]) -> DataTable:
    successes = [result for result in results if result.success]
    values: list[tuple[str, str, list[float], int | None]] = [
        ("time of successful runs", "s", [result.time for result in successes], 1),
        ("distance of successful runs", "in", [result.distance for result in successes], 1),
        ("commands of successful runs", "", [result.commands for result in successes], None),
        ("contacts of all runs", "", [result.contacts for result in results], None),
    ]
    rows = []
    for name, unit, each, decimals in values:
        if each:
            rows.append((name, unit, *(round(value, decimals) for value in distribution(each))))
    return DISTRIBUTION.filled(rows)


def _groups(
    table: DataTable, results: Sequence[TrialResult], key: Callable[[TrialResult], object]
) -> DataTable:
    """A row a group of results with the same key; none if there is only one."""
    rows = [(name, *_rated(group)) for name, group in grouped(results, key).items()]
    return table.filled(rows if len(rows) > 1 else ())


def _mazes(results: list[TrialResult]) -> DataTable:
    by_maze = attrgetter("maze")
    return _groups(BY_MAZE, sorted(results, key=by_maze), by_maze)


def _starts(results: list[TrialResult]) -> DataTable:
    """The runs by start cell; only where all runs are in the same maze."""
    mazes = {result.maze for result in results}
    if len(mazes) > 1 or RANDOM in mazes:
        return BY_START
    ordered = sorted(results, key=lambda each: (-start_cell(each)[1], start_cell(each)[0]))
    return _groups(BY_START, ordered, start_cell)


def _slowest(folder: TrialFolder, results: list[TrialResult]) -> DataTable:
    slowest = sorted((each for each in results if each.success), key=lambda each: (-each.time, each.number))
    rows = [_listed(folder, each, (each.distance, each.commands)) for each in slowest[:SLOWEST]]
    return SLOWEST_RUNS.filled(rows)


def _failures(folder: TrialFolder, results: list[TrialResult]) -> DataTable:
    failed = [result for result in results if not result.success]
    rows = [_listed(folder, result, failure_text(result)) for result in failed[:_LISTED]]
    more = len(failed) - _LISTED
    return FAILED_RUNS.filled(rows, f"and {more} more, in {TABLE}" if more > 0 else "")


def _listed(folder: TrialFolder, result: TrialResult, what: object) -> tuple[object, ...]:
    """A row for a run; `what` happened, and the command that plays it again."""
    log = folder.log(result.number)
    command = f"simmer-tui replay {typed_path(log)}" if log.exists() else ""
    return result.number, result.time, what, command
