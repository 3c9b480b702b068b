"""A sweep: the same runs for several values of a setting, or of a column of one sensor or drive.

Its plan is data: a list of points, each with the values that replace those of the set. Each name is varied
alone, the others stay as the set has them. Every point has runs with the same seeds, so two points differ by
the value and not by random draws (common random numbers).
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from itertools import dropwhile
from pathlib import Path

from msgspec.structs import replace

from simmer_tui.config import drive_csv, sensors_csv
from simmer_tui.config.csv_table import ID, POLL_CHARACTER, CsvRow, csv_text, read_csv
from simmer_tui.config.loader import Configuration
from simmer_tui.config.settings import Settings, all_settings, value_of
from simmer_tui.document.formats import Format
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.columns import column_name
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.rules import PairRule, did_you_mean
from simmer_tui.sim.specs import SimulationSpec

SweepPoint = Mapping[str, str]
"""Values by the dotted name of their setting or column."""
_TABLES = {
    sensors_csv.FILE: (*sensors_csv.HEADERS, *sensors_csv.optional_headers()),
    drive_csv.FILE: tuple(column.name for column in drive_csv.COLUMNS),
}
"""The headers that a file may have."""
_FROM_ELSEWHERE = ("seed", "randerror", "sim")


def points_of(varied: Sequence[str]) -> tuple[SweepPoint, ...]:
    """The points of some `NAME=VALUE,VALUE...`; semicolons stand between values that have commas.

    Raises ConfigurationError.
    """
    points: list[SweepPoint] = []
    problems = []
    for text in varied:
        name, equals, listed = text.partition("=")
        values = [value.strip() for value in listed.split(";" if ";" in listed else ",")]
        if not name.strip() or not equals or not all(values):
            what = f'must be a name and its values, NAME=VALUE,VALUE..., not "{cut(text)}"'
            problems.append(Problem("--vary", what))
        points += [{name.strip(): value} for value in values]
    repeated = {shown_point(point) for point in points if points.count(point) > 1}
    problems += [Problem("--vary", f"{cut(each)} is given twice") for each in sorted(repeated)]
    if problems:
        raise ConfigurationError(problems)
    return tuple(points)


def _plain(value: str) -> int | float | str:
    """The number that a value is; the text itself if it is none."""
    for number in (int, float):
        with contextlib.suppress(ValueError):
            if math.isfinite(found := number(value)):
                return found
    return value


SWEPT = Format(lambda text: cut(text, WORD), split=lambda value: (_plain(value),))
"""A value as it was typed; to programs it is a number if it can be."""


def shown_point(point: SweepPoint) -> str:
    """`strength = 0.05`."""
    return ", ".join(f"{name} = {value}" for name, value in point.items())


def settings_at(point: SweepPoint, configuration: Configuration) -> dict[str, str]:
    """The settings among the values of a point, as the options have them.

    A single number for a setting of two, such as strength, is the first; the second stays as
    `configuration` has it.
    """
    known = {item.name: item for item in all_settings()}
    found = {}
    for name, value in point.items():
        if name not in known:
            continue
        if isinstance(known[name].rule, PairRule) and "," not in value:
            value = f"{value},{value_of(configuration.settings, name)[1]:g}"
        found[name] = value
    return found


def files_at(point: SweepPoint, folder: Path) -> dict[str, str]:
    """The texts of the files of the set in `folder` that a point changes. Raises ConfigurationError."""
    settings = [item.name for item in all_settings()]
    changed: dict[str, str] = {}
    problems: list[Problem] = []
    for name, value in point.items():
        if name in _FROM_ELSEWHERE:
            problems.append(Problem(f"--vary {name}", "cannot be varied: the runs have seeds of their own"))
        elif name not in settings:
            _change(name, value, folder, changed, problems, settings)
    if problems:
        raise ConfigurationError(problems)
    return changed


def _change(
    name: str, value: str, folder: Path, changed: dict[str, str], problems: list[Problem], others: list[str]
) -> None:
    """Set the cell `name` (`u1.percent_error`, `ultra1.percent_error`) in the file that has it."""
    where = f"--vary {cut(name)}"
    owner, _, column = name.rpartition(".")
    for file, headers in _TABLES.items():
        table = read_csv(folder / file, problems)
        if table is None:
            continue
        head, *rows = dropwhile(lambda row: not row.cells, table.rows)
        row = _row(head, rows, owner)
        if row is None:
            continue
        # With the columns of the set's own devices, which only its own file has, and as it spells them.
        known = {column_name(each): each for each in (*headers, *head.cells) if each}
        if column not in known:
            hint = did_you_mean(column, [*known])
            problems.append(Problem(where, f"{file} has no column {cut(column)}{hint}"))
        else:
            changed[file] = _with_cell(head, rows, row, known[column], value)
        return
    what = "is neither a setting nor a column of a sensor or drive, such as u1.percent_error"
    problems.append(Problem(where, what + did_you_mean(name, others)))


def _row(head: CsvRow, rows: Sequence[CsvRow], owner: str) -> CsvRow | None:
    """The row of a sensor or drive, by its ID or its code."""
    names = {column_name(ID), column_name(POLL_CHARACTER)}
    columns = [index for index, cell in enumerate(head.cells) if column_name(cell) in names]
    return next((row for row in rows if owner in {row.cell(index) for index in columns} - {""}), None)


def _with_cell(head: CsvRow, rows: Sequence[CsvRow], changed: CsvRow, header: str, value: str) -> str:
    """The file with another value in a cell, its column added where it has none."""
    names = list(head.cells) if header in head.cells else [*head.cells, header]
    lines = [names]
    for row in rows:
        lines.append([row.cell(index) for index in range(max(len(names), len(row.cells)))])
        if row is changed:
            lines[-1][names.index(header)] = value
    return csv_text(lines)


def check_effects(points: Sequence[SweepPoint], configurations: Sequence[Configuration]) -> None:
    """Raises ConfigurationError if two values have the same effect: something else decides."""
    problems = []
    for index, one in enumerate(configurations):
        for other in range(index):
            same = _effective(one) == _effective(configurations[other])
            if same and points[index].keys() == points[other].keys():
                what = (
                    f"makes no difference to {shown_point(points[other])}: a profile, an option or randbias "
                    "decides"
                )
                problems.append(Problem(f"--vary {shown_point(points[index])}", what))
    if problems:
        raise ConfigurationError(problems)


def _effective(configuration: Configuration) -> tuple[SimulationSpec, Settings]:
    """Effective configuration: without random bias its strength does nothing."""
    simulation, settings = configuration.simulation, configuration.settings
    if not simulation.randbias:
        simulation = replace(simulation, strength=(0.0, 0.0))
        settings = replace(settings, strength=(0.0, 0.0))
    return simulation, settings
