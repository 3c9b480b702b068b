"""The tables of a report, as text: what the terminal and the page both show."""

from __future__ import annotations

import math
from dataclasses import dataclass

from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.run.bounded import BINS, Errors
from simmer_tui.run.run_history import OTHER_CODES, STOPS
from simmer_tui.sim.command import escape

ROWS = 20
"""Most rows of a table of places or commands."""
CELLS = 10
HISTOGRAM = " ▁▂▃▄▅▆▇█"
PLAIN_HISTOGRAM = " .:-=+*#@"


@dataclass(frozen=True, slots=True)
class Column:
    """A heading; whether what stands below is numbers, and whether it may go over several lines."""

    name: str
    numeric: bool = False
    wraps: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """A table of text. `note` stands below."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def summary(run: RunStatistics) -> Table:
    """The figures of the whole run."""
    header = run.header
    rows = [
        ("configuration", escape(header.configuration, 120)),
        ("seed", str(header.seed)),
        ("started", f"{escape(header.start, 40)} with simmer-tui {escape(header.program, 20)}"),
        ("simulated time", _duration(run.duration)),
        ("time on the clock", _duration(run.wall_seconds)),
        ("commands", f"{run.commands}, of which {run.refusals.given} refused"),
        ("driven", f"{run.distance:.1f} in in {run.movements} movements"),
        ("turned", f"{run.turned:.0f} deg"),
        ("contacts", str(run.contacts)),
        ("ended at", f"({run.pose.x:.2f}, {run.pose.y:.2f}) heading {run.pose.heading:.1f} deg"),
    ]
    sources = ", ".join(f"{escape(name, 30)} {count}" for name, count in run.sources.most_common())
    if len(run.sources) > 1:
        rows.append(("sent by", sources))
    return Table("Run", (Column(""), Column("", wraps=True)), tuple(rows))


def tables(run: RunStatistics, *, plain: bool = False) -> list[Table]:
    """All tables that have something to say. `plain` keeps histograms within ASCII."""
    made = [
        _time_spent(run),
        _commands(run),
        _contacts(run),
        _refusals(run),
        _sensors(run, plain),
        _belief(run),
        _cells(run),
    ]
    return [summary(run), *(table for table in (_mission(run), *made) if table.rows)]


def _mission(run: RunStatistics) -> Table:
    rows = [
        (f"{each.elapsed:.1f}", escape(each.text.removeprefix("mission: "), 300))
        for each in run.mission.items
    ]
    return Table("Mission", (Column("time s", numeric=True), Column("what", wraps=True)), tuple(rows))


def _time_spent(run: RunStatistics) -> Table:
    """Where simulated time went; nothing where only driving took any."""
    if not (run.on_link or run.reading):
        return Table("Where the time went", (), ())
    codes = {sensor.id: sensor.code for sensor in run.configuration.simulation.sensors}
    costly = sorted(run.reading.items(), key=lambda item: -item[1])
    read = [(f"reading {codes.get(name, '')} ({name})", spent) for name, spent in costly]
    rows = [("driving", run.driving), *read, ("on the link", run.on_link)]
    total = run.duration or 1.0
    return Table(
        "Where the time went",
        (Column(""), Column("time s", True), Column("share", True)),
        tuple((name, f"{spent:.1f}", f"{100 * spent / total:.0f} %") for name, spent in rows),
        "Of simulated time; the sensor that costs most comes first. For the rest the robot waited.",
    )


def _commands(run: RunStatistics) -> Table:
    spec = run.configuration.simulation
    meanings = {sensor.code: sensor.id for sensor in spec.sensors}
    meanings[STOPS] = "stop at once"
    meanings |= {drive.code: drive.kind.meaning for drive in spec.drives}
    if spec.gripper is not None:
        meanings[spec.gripper.code] = "gripper"
    rows = [
        (
            "other" if code == OTHER_CODES else code,
            meanings.get(code, "no such code, or no command"),
            str(record.count),
            _or_blank(record.contacts),
            _or_blank(record.refused),
        )
        for code, record in sorted(run.codes.items(), key=lambda item: -item[1].count)
    ]
    columns = (
        Column("code"),
        Column("meaning", wraps=True),
        Column("sent", True),
        Column("contacts", True),
        Column("refused", True),
    )
    return Table("Commands", columns, tuple(rows))


def _contacts(run: RunStatistics) -> Table:
    rows = [
        (
            f"{bump.touch.elapsed:.2f}",
            str(bump.touch.line),
            bump.touch.shown,
            str(bump.count),
            f"{bump.touch.went:.2f}",
            f"{bump.touch.pose.x:.2f}, {bump.touch.pose.y:.2f}",
            f"{bump.touch.pose.heading:.1f}",
            f"{bump.touch.point[0]:.2f}, {bump.touch.point[1]:.2f}",
        )
        for bump in run.bumps.items[:ROWS]
    ]
    columns = (
        Column("time s", True),
        Column("line", True),
        Column("command"),
        Column("times", True),
        Column("went in", True),
        Column("robot at", True),
        Column("heading", True),
        Column("touched", True),
    )
    note = "Times: how often in a row, without getting away from the wall."
    return Table("Contacts", columns, tuple(rows), f"{note} {_more(run.bumps.given)}".rstrip())


def _refusals(run: RunStatistics) -> Table:
    rows = [
        (
            f"{each.elapsed:.2f}",
            str(each.line),
            each.outcome.command.shown,
            escape(each.outcome.reason, 120),
        )
        for each in run.refusals.items[:ROWS]
    ]
    columns = (Column("time s", True), Column("line", True), Column("command"), Column("why", wraps=True))
    return Table("Refused commands", columns, tuple(rows), _more(run.refusals.given))


def _sensors(run: RunStatistics, plain: bool) -> Table:
    rows = []
    specs = {sensor.id: sensor for sensor in run.configuration.simulation.sensors}
    for name, record in sorted(run.sensors.items()):
        spec, errors = specs.get(name), record.errors
        unit = spec.unit if spec is not None else ""
        title = f"{spec.code} {name}" if spec is not None else name
        if spec is not None and spec.is_yes_or_no:
            wrong = sum(errors.bins) - errors.bins[BINS // 2] if errors.width else 0
            rows.append((title, str(record.readings), "", f"{wrong} wrong", "", "", "", ""))
            continue
        rows.append(
            (
                title,
                str(record.readings),
                unit,
                f"{errors.mean:+.3g}" if errors.count else "",
                f"{errors.std:.3g}" if errors.count > 1 else "",
                f"{errors.worst:+.3g}" if errors.count else "",
                histogram(errors, plain) if errors.width else "",
                f"+-{errors.reach:.3g}" if errors.width else "",
            )
        )
    missed = sum(record.missed for record in run.sensors.values())
    note = (
        "Reading less truth; the middle of a histogram is 0. Odometers and gyros are held against the true "
        "path, slip included."
    )
    if missed:
        note += f" {missed} readings had a value where nothing was in range, or none where something was."
    columns = (
        Column("sensor"),
        Column("count", True),
        Column("unit"),
        Column("mean", True),
        Column("std", True),
        Column("worst", True),
        Column("histogram"),
        Column("reaches"),
    )
    return Table("Errors of readings", columns, tuple(rows), note)


def _belief(run: RunStatistics) -> Table:
    if not run.beliefs.count:
        return Table("Belief", (), ())
    last = run.last_belief
    assert last is not None
    distance, turn = run.beliefs, run.belief_turns
    rows = (
        (
            "position, in",
            f"{distance.mean:.2f}",
            _std(distance),
            f"{distance.worst:.2f}",
            f"{last.distance:.2f}",
        ),
        ("heading, deg", f"{turn.mean:.1f}", _std(turn), f"{turn.worst:.1f}", f"{last.turn:.1f}"),
    )
    columns = (
        Column("off by"),
        Column("mean", True),
        Column("std", True),
        Column("worst", True),
        Column("at the end", True),
    )
    return Table(f"Belief ({distance.count} told)", columns, rows)


def _cells(run: RunStatistics) -> Table:
    total = sum(run.cells.values())
    if total <= 0:
        return Table("Time by cell", (), ())
    rows = [
        (f"row {row}, column {column}", f"{seconds:.1f}", f"{100 * seconds / total:.0f} %")
        for (row, column), seconds in run.cells.most_common(CELLS)
    ]
    note = "Rows and columns as in maze.csv, from the top left."
    if len(run.cells) > CELLS:
        note += f" {len(run.cells)} cells in all."
    return Table(
        "Time by cell", (Column("cell"), Column("time s", True), Column("share", True)), tuple(rows), note
    )


def histogram(errors: Errors, plain: bool = False) -> str:
    """Sixteen characters; the error 0 lies in the middle."""
    marks = PLAIN_HISTOGRAM if plain else HISTOGRAM
    pairs = [sum(errors.bins[place : place + 2]) for place in range(0, BINS, 2)]
    most = max(pairs)
    return "".join(marks[math.ceil(count / most * (len(marks) - 1))] for count in pairs)


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.2f} s"
    minutes, rest = divmod(seconds, 60)
    return f"{seconds:.0f} s ({int(minutes)} min {rest:.0f} s)"


def _std(errors: Errors) -> str:
    return f"{errors.std:.2f}" if errors.count > 1 else ""


def _or_blank(number: int) -> str:
    return str(number) if number else ""


def _more(given: int) -> str:
    return f"{given - ROWS} more." if given > ROWS else ""
