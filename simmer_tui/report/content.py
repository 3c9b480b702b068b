"""The report of a run as a document for terminal and programs, and as one picture."""

from __future__ import annotations

from heapq import nlargest
from operator import itemgetter
from typing import Any

from msgspec.structs import replace

from simmer_tui.document import svg
from simmer_tui.document.formats import (
    COUNT,
    COUNT_OR_BLANK,
    DURATION,
    HISTOGRAM,
    PASSAGE,
    PLACE,
    POSE,
    QUOTED,
    SHARE,
    TYPED,
    WORDS,
    Format,
    number,
)
from simmer_tui.document.model import (
    Bullets,
    Code,
    DataColumn,
    DataTable,
    Document,
    DocumentPart,
    NestedValue,
    Paragraph,
    Prose,
    data_table,
)
from simmer_tui.report.bent_scans import SCANS, scans_table
from simmer_tui.report.episode_table import EPISODES, episodes_table
from simmer_tui.report.fact_tables import BELIEF_FACTS, COMMAND_FACTS, DEVICE_FACTS, fact_tables
from simmer_tui.report.figure import maze_figure
from simmer_tui.report.finding import FINDINGS, findings_table
from simmer_tui.report.moments import MOMENTS, moments_table
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.report.traces import traces
from simmer_tui.report.verdict import Verdict
from simmer_tui.run.run_history import OTHER_CODES, STOPS
from simmer_tui.run.table import BINS, Errors
from simmer_tui.sim.command import counted, typed_path
from simmer_tui.sim.command_codes import code_meanings

_ROWS = 20
"""Most rows of a table of contacts or commands: more of them are more of the same, and are in the log."""
# Points between the maze and the sensors in the one picture of a run.
_GAP = 10.0
MOST_CELLS = 10
"""Cells listed: the course's maze has 32, and a run spends most of its time in a few."""
_SOURCES = Format(lambda counts: ", ".join(f"{name} {count}" for name, count in counts.items()))
_TIME = DataColumn("time_s", number(".2f"))
_SHARE = DataColumn("share", SHARE)
_LINE = DataColumn("line", COUNT)
_COMMAND = DataColumn("command", QUOTED)
RUN = data_table(
    "run",
    "Run",
    DataColumn("log", TYPED),
    DataColumn("configuration", TYPED),
    DataColumn("seed"),
    DataColumn("started", QUOTED),
    DataColumn("version", QUOTED, "simmer-tui"),
    DataColumn("time_s", DURATION, "simulated time"),
    DataColumn("real_time_s", DURATION, "real time"),
    DataColumn("commands"),
    DataColumn("refused"),
    DataColumn("movements"),
    DataColumn("distance_in", number(".1f", " in"), "driven"),
    DataColumn("turned_deg", number(".0f", " deg"), "turned"),
    DataColumn("contacts"),
    DataColumn("end", POSE, "ended at"),
    DataColumn("sources", _SOURCES, "sent by"),
    record=True,
)
_MISSION = data_table(
    "mission", "Mission", DataColumn("time_s", number(".1f")), DataColumn("text", PASSAGE, "what", wraps=True)
)
_SENSOR = Format(lambda names: " ".join(filter(None, reversed(names))), ("", "_code"), tuple)
"""A sensor by its ID and its code, None if the set has no such sensor: `u1 ultra1`."""


def _use_text(use: tuple[str, str | None, str | None]) -> str:
    name, sensor, code = use
    return name if sensor is None else f"{name} {code or ''} ({sensor})"


TIME_SPENT = data_table(
    "time_spent",
    "Where the time went",
    DataColumn("on", Format(_use_text, ("", "_sensor", "_code"), tuple), ""),
    DataColumn("time_s", number(".1f")),
    _SHARE,
)
_COMMANDS = data_table(
    "commands",
    "Commands",
    DataColumn("code"),
    DataColumn("meaning", wraps=True),
    DataColumn("sent", COUNT),
    DataColumn("contacts", COUNT_OR_BLANK),
    DataColumn("refused", COUNT_OR_BLANK),
)
_MESSAGES = data_table(
    "messages",
    "Messages to the robot",
    DataColumn("message", QUOTED),
    DataColumn("sent", COUNT),
    DataColumn("text", PASSAGE, "not understood", wraps=True),
)
CONTACTS = data_table(
    "contacts",
    "Contacts",
    _TIME,
    _LINE,
    _COMMAND,
    DataColumn("times", COUNT),
    DataColumn("went_in", number(".2f")),
    DataColumn("robot", PLACE, "robot at"),
    DataColumn("robot_heading_deg", number(".1f"), "heading"),
    DataColumn("touched", PLACE),
)
REFUSED_COMMANDS = data_table(
    "refusals", "Refused commands", _TIME, _LINE, _COMMAND, DataColumn("text", PASSAGE, "why", wraps=True)
)
_ERROR = number("+.3g")
_SENSORS = data_table(
    "sensor_errors",
    "Errors of readings",
    DataColumn("sensor", _SENSOR),
    DataColumn("readings", COUNT, "count"),
    DataColumn("unit"),
    DataColumn("wrong", hidden=True),
    DataColumn("mean", hidden=True),
    DataColumn("shown", replace(WORDS, numeric=True), "mean"),
    DataColumn("std", number(".3g")),
    DataColumn("worst", _ERROR),
    DataColumn("histogram", HISTOGRAM),
    DataColumn("reach", Format(lambda reach: f"+-{reach:.3g}"), "reaches"),
)
_BELIEF = data_table(
    "belief",
    "Belief",
    DataColumn("of", heading="off by"),
    DataColumn("unit", heading=""),
    DataColumn("mean", number(".2f")),
    DataColumn("std", number(".2f")),
    DataColumn("worst", number(".2f")),
    DataColumn("end", number(".2f"), "at the end"),
)
_CELLS = data_table(
    "cells",
    "Time by cell",
    DataColumn("cell", Format(lambda at: f"row {at[0]}, column {at[1]}", ("_row", "_column"), tuple)),
    DataColumn("time_s", number(".1f")),
    _SHARE,
)
_OUTPUT = data_table(
    "output",
    "The program's last output",
    DataColumn("time_s"),
    DataColumn("stream"),
    DataColumn("output"),
    hidden=True,
)

TABLES = (
    MOMENTS,
    COMMAND_FACTS,
    DEVICE_FACTS,
    BELIEF_FACTS,
    RUN,
    _MISSION,
    TIME_SPENT,
    _COMMANDS,
    _MESSAGES,
    CONTACTS,
    REFUSED_COMMANDS,
    FINDINGS,
    _SENSORS,
    SCANS,
    _BELIEF,
    EPISODES,
    _CELLS,
    _OUTPUT,
)
"""All tables of a report."""


def report_document(run: RunStatistics, name: str, path: str | None = None) -> Document:
    """The report of a run whose log has a name. Its commands take the `path` of the log, by default the name;
    without one they take the last run."""
    # The last output of a failed program says why it failed; that of a successful one has no news.
    failed = run.failed
    # The way to be sure stands on the first screen, and is the last line of a long report.
    surely = try_again(run, name if path is None else path)
    parts: list[DocumentPart] = [
        *_verdict(run.verdict),
        surely,
        *fact_tables(run.evidence),
        *((output(run.verdict),) if failed else ()),
        Bullets("Notes", run.notes, "notes"),
        *report_tables(run, name),
        *(() if failed else (output(run.verdict),)),
        again(name if path is None else path),
        surely,
    ]
    return Document(f"Run {name}", parts)


def try_again(run: RunStatistics, name: str) -> Paragraph:
    """The command that finds the change which saves a failed run; empty if it cannot be run again."""
    header = run.header
    if not run.failed or not (header.can_run_again or header.sketches):
        return Paragraph("")
    command = f"simmer-tui why {typed_path(name)}" if name else "simmer-tui why"
    if header.sketches:
        # A log has no sketches, only their hashes.
        command = f"simmer-tui trials --sketch DIR {'--run CMD ' if header.run is not None else ''}--why"
    return Paragraph(("Try again with one change: ", Code(command)), kind="note")


def again(name: str) -> Paragraph:
    """Commands that show the run again."""
    argument = f" {typed_path(name)}" if name else ""
    commands: tuple[Prose, ...] = (
        *("Play it: ", Code(f"simmer-tui replay{argument}")),
        # No full stop: it would be copied with the command before it.
        *("   Compare every reply: ", Code(f"simmer-tui rerun{argument}")),
    )
    return Paragraph(commands, kind="note")


def _verdict(verdict: Verdict) -> list[DocumentPart]:
    """The verdict: its sentence, and its reasons."""
    return [
        Paragraph(verdict.headline, "verdict", "strong"),
        moments_table(verdict.moments),
        Bullets("Why", [*verdict.why, *filter(None, (verdict.advice,))], "why"),
        NestedValue("verdict", verdict.plain()),
        _output_table(verdict),
    ]


def output(verdict: Verdict) -> Bullets:
    """The program's last lines."""
    program = verdict.program
    said = () if program is None else (*program.stderr, *(() if program.crashed else program.stdout))
    lines = [f"{line.time:.1f} s  {line.text}" for line in said]
    title = f"{_OUTPUT.title}, times{verdict.restart}" if verdict.restart else _OUTPUT.title
    return Bullets(title, lines, _OUTPUT.key, "output")


def _output_table(verdict: Verdict) -> DataTable:
    """All that is known of the program's output."""
    program = verdict.program
    streams = () if program is None else (("stderr", program.stderr), ("stdout", program.stdout))
    return _OUTPUT.filled([(line.time, name, line.text) for name, lines in streams for line in lines])


def svg_picture(run: RunStatistics, name: str) -> str:
    """The maze and under it the traces, as one picture."""
    figure, strips = svg.whole_figure(replace(maze_figure(run), title=f"Run {name}")), traces(run)
    if strips is not None:
        strips = svg.whole_figure(strips)
        below = svg.translated(0.0, figure.height + _GAP, strips.content)
        height = figure.height + _GAP + strips.height
        figure = replace(figure, height=height, content=figure.content + below)
    return svg.document(figure)


def maze_picture(run: RunStatistics, name: str, width: float) -> str:
    """The maze with the whole path, as one picture `width` pixels wide."""
    return svg.document(replace(maze_figure(run), title=f"Run {name}"), width)


def report_tables(run: RunStatistics, name: str = "") -> list[DataTable]:
    """The run's record, the findings about sensors and drives, and all other tables that have rows."""
    others = (
        _mission(run),
        _time_spent(run),
        _commands(run),
        _messages(run),
        _contacts(run),
        _refusals(run),
        _sensors(run),
        scans_table(run.bent),
        _belief(run),
        episodes_table(run.history, ended_badly=run.cause is not None),
        _cells(run),
    )
    return [_record(run, name), findings_table(run.findings), *(table for table in others if table.rows)]


def _record(run: RunStatistics, name: str) -> DataTable:
    header = run.header
    row = (
        name,
        *(header.configuration, header.seed, header.start, header.program),
        *(run.history.elapsed, run.real_seconds, run.totals.commands, run.history.refusals.first.given),
        *(run.totals.movements, run.totals.distance, run.totals.turned, run.totals.contacts, run.pose),
        dict(run.totals.sources.most_common()),
    )
    return RUN.filled([row])


def _mission(run: RunStatistics) -> DataTable:
    rows = [(each.elapsed, each.text.removeprefix("mission: ")) for each in run.history.missions.first.items]
    return _MISSION.filled(rows)


def _time_spent(run: RunStatistics) -> DataTable:
    """Simulated time by use; no rows where only driving took any."""
    codes = {sensor.id: sensor.code for sensor in run.configuration.simulation.sensors}
    totals = run.totals
    costly = sorted(totals.sensors.items(), key=lambda item: -item[1].seconds)
    read = [(("reading", name, codes.get(name)), each.seconds) for name, each in costly if each.seconds]
    driving = (("driving", None, None), totals.driving_seconds)
    spent = [driving, *read, (("on the link", None, None), totals.link_seconds)]
    if not read and not totals.link_seconds:
        spent = []
    total = run.history.elapsed or 1.0
    rows = [(name, seconds, seconds / total) for name, seconds in spent]
    rest = "In the remaining time the robot waited."
    # Times of sensors are in single precision.
    if sum(seconds for _, seconds in spent) > total * (1 + 1e-6):
        rest = "The robot also drove while it read and sent, so the shares add up to more than 100%."
    return TIME_SPENT.filled(rows, f"Of simulated time; the sensor that costs most comes first. {rest}")


def _commands(run: RunStatistics) -> DataTable:
    meanings = code_meanings(run.configuration.simulation) | {STOPS: "stop at once"}
    rows = [
        (
            "other" if code == OTHER_CODES else code,
            meanings.get(code, "no such code, or no command"),
            *(record.count, record.contacts, record.refused),
        )
        for code, record in sorted(run.totals.codes.items(), key=lambda item: -item[1].count)
    ]
    return _COMMANDS.filled(rows)


def _messages(run: RunStatistics) -> DataTable:
    """Messages of a dialect, unknown ones first."""
    counted_messages = sorted(run.totals.messages.items(), key=lambda item: (not item[0][1], -item[1]))
    rows = [(name, count, remark) for (name, remark), count in counted_messages]
    return _MESSAGES.filled(rows)


def _contacts(run: RunStatistics) -> DataTable:
    rows = [
        (
            *(each.first.elapsed, each.first.line, each.first.shown, each.count, each.first.went),
            *((each.first.pose.x, each.first.pose.y), each.first.pose.heading, each.first.point),
        )
        for each in run.history.repeated.first.items[:_ROWS]
    ]
    note = "Times: contacts in a row, without getting away from the wall."
    return CONTACTS.filled(rows, _more(run.history.repeated.first.given, note))


def _refusals(run: RunStatistics) -> DataTable:
    rows = [
        (each.elapsed, each.line, each.result.command.text, each.result.reason)
        for each in run.history.refusals.first.items[:_ROWS]
    ]
    return REFUSED_COMMANDS.filled(rows, _more(run.history.refusals.first.given))


def _sensors(run: RunStatistics) -> DataTable:
    rows: list[tuple[object, ...]] = []
    specs = {sensor.id: sensor for sensor in run.configuration.simulation.sensors}
    for name, record in sorted(run.totals.sensors.items()):
        spec, errors = specs.get(name), record.errors
        unit = spec.unit if spec is not None else ""
        title = name, None if spec is None else spec.code
        if spec is not None and spec.is_yes_or_no:
            wrong = sum(errors.bins) - errors.bins[BINS // 2] if errors.width else 0
            rows.append((title, record.readings, unit, wrong, None, f"{wrong} wrong", *(None,) * 4))
            continue
        (mean, std), worst = _moments(errors), errors.worst if errors.count else None
        # Sixteen bins; the error 0 lies in the middle.
        counts = [sum(errors.bins[place : place + 2]) for place in range(0, BINS, 2)]
        bars = (counts, errors.reach) if errors.width else (None, None)
        rows.append((title, record.readings, unit, None, mean, _ERROR.text(mean), std, worst, *bars))
    missed = sum(record.missed for record in run.totals.sensors.values())
    read = [spec for name, spec in specs.items() if name in run.totals.sensors]
    times = " times Gain" if any(spec.gain != 1.0 for spec in read) else ""
    note = (
        f"Reading minus true value{times}. The middle of a histogram is 0. Odometers and gyros are compared "
        "with the true path, slip included."
    )
    if missed:
        told = counted(missed, "reading")
        note += f" {told} had a value where nothing was in range, or none where something was."
    return _SENSORS.filled(rows, note)


def _belief(run: RunStatistics) -> DataTable:
    last = run.history.beliefs[-1:]
    if not last or not run.totals.beliefs.count:
        return _BELIEF.filled(())
    distance, turn = run.totals.beliefs, run.totals.belief_turns
    rows: list[tuple[Any, ...]] = [("position", "in", *_moments(distance), distance.worst, last[0].distance)]
    if turn.count:
        end = last[0].turn if last[0].tells_heading else None
        rows.append(("heading", "deg", *_moments(turn), turn.worst, end))
    missed, entropy = run.totals.missed_shares, run.totals.entropies
    if missed.count:
        shares = 100 * (1 - missed.mean), 100 * missed.std if missed.count > 1 else None
        end = 100 * last[0].true_probability if last[0].is_grid else None
        rows.append(("probability at the truth", "%", *shares, 100 * (1 - missed.worst), end))
        end = last[0].entropy if last[0].is_grid else None
        rows.append(("entropy", "bit", *_moments(entropy), entropy.worst, end))
    return replace(_BELIEF.filled(rows), title=f"Belief ({distance.count} sent)")


def _cells(run: RunStatistics) -> DataTable:
    total = sum(run.paths.cells.values())
    rows = [
        (cell, seconds, seconds / total)
        for cell, seconds in nlargest(MOST_CELLS, run.paths.cells.items(), itemgetter(1))
        if total > 0
    ]
    note = "Rows and columns as in maze.csv, from the top left."
    if len(run.paths.cells) > MOST_CELLS:
        note += f" {len(run.paths.cells)} cells in all."
    return _CELLS.filled(rows, note)


def _moments(errors: Errors) -> tuple[float | None, float | None]:
    """Mean and standard deviation, as far as there are enough numbers."""
    return errors.mean if errors.count else None, errors.std if errors.count > 1 else None


def _more(given: int, note: str = "") -> str:
    return f"{note} {given - _ROWS} more.".lstrip() if given > _ROWS else note
