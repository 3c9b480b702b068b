"""The report as one page that needs nothing else, on a screen or on paper, and as one picture."""

from __future__ import annotations

from simmer_tui.report import svg
from simmer_tui.report.content import Table, tables
from simmer_tui.report.figure import WIDTH, maze_figure
from simmer_tui.report.findings import findings
from simmer_tui.report.markup import escape
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.report.traces import traces

STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.45 Helvetica, Arial, sans-serif; color: #222; background: #fff; max-width: 960px;
  margin: 1.5em auto; padding: 0 1em; }
h1 { font-size: 1.5em; margin: 0 0 .2em; } h2 { font-size: 1.1em; margin: 1.4em 0 .4em; }
p.run { color: #666; margin: 0; overflow-wrap: anywhere; }
svg { width: 100%; height: auto; display: block; break-inside: avoid; }
ul { margin: .3em 0; padding-left: 1.2em; } li { margin: .25em 0; }
.tables { display: flex; flex-wrap: wrap; gap: 0 2.5em; align-items: flex-start; }
section { break-inside: avoid; max-width: 100%; overflow-x: auto; }
table { border-collapse: collapse; font-size: .87em; }
th { text-align: left; border-bottom: 1px solid #999; font-weight: 600; }
th, td { padding: .14em .9em .14em 0; vertical-align: top; overflow-wrap: anywhere; }
.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.h { font-family: monospace; white-space: pre; }
p.note { color: #666; font-size: .87em; margin: .3em 0; max-width: 60em; }
@media print { body { font-size: 11px; margin: 0; max-width: none; padding: 0; } h2 { margin-top: 1em; }
  h2 { break-after: avoid; } @page { margin: 14mm; } * { print-color-adjust: exact; } }
"""


def html_page(run: RunStatistics, name: str) -> str:
    """The page about a log of some name."""
    maze_height, maze = maze_figure(run)
    height, strips = traces(run)
    found = "".join(f"<li>{escape(finding)}</li>" for finding in findings(run))
    notes = "".join(f"<p class='note'>Note: {escape(note)}</p>" for note in run.notes)
    header = run.header
    about = f"{header.start}, configuration {header.configuration}, seed {header.seed}"
    sensors = f"<h2>Sensors over time</h2>{svg.picture(WIDTH, height, strips, 'Sensors')}" if height else ""
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>Run {escape(name)}</title><style>{STYLE}</style></head><body>"
        f"<h1>Run {escape(name)}</h1><p class='run'>{escape(about)}</p>"
        f"<h2>What happened</h2><ul>{found}</ul>{notes}"
        f"<h2>Where the robot went</h2>{svg.picture(WIDTH, maze_height, maze, 'The maze and the path')}"
        f"{sensors}<div class='tables'>{''.join(map(html_table, tables(run)))}</div>"
        f"<p class='note'>The same robot again: <code>simmer-tui replay {escape(name)}</code>, and to prove "
        f"it: <code>simmer-tui rerun {escape(name)}</code></p></body></html>\n"
    )


def html_table(table: Table) -> str:
    """A table as a section of a page with `STYLE`."""
    head = ""
    if any(column.name for column in table.columns):
        cells = "".join(
            f"<th class='n'>{escape(column.name)}</th>"
            if column.numeric
            else f"<th>{escape(column.name)}</th>"
            for column in table.columns
        )
        head = f"<thead><tr>{cells}</tr></thead>"
    kinds = [_kind(column.name, column.numeric) for column in table.columns]
    rows = "".join(
        "<tr>"
        + "".join(f"<td{kind}>{escape(cell)}</td>" for kind, cell in zip(kinds, row, strict=True))
        + "</tr>"
        for row in table.rows
    )
    note = f"<p class='note'>{escape(table.note)}</p>" if table.note else ""
    return (
        f"<section><h2>{escape(table.title)}</h2><table>{head}<tbody>{rows}</tbody></table>{note}</section>"
    )


def _kind(name: str, numeric: bool) -> str:
    return " class='n'" if numeric else " class='h'" if name == "histogram" else ""


def svg_picture(run: RunStatistics, name: str) -> str:
    """The maze and under it the traces, as one picture."""
    height, maze = maze_figure(run)
    more, strips = traces(run)
    below = svg.shifted(0.0, height + 10, strips) if more else ""
    whole = height + (more + 10 if more else 0)
    return (
        f"<?xml version='1.0' encoding='UTF-8'?>\n{svg.picture(WIDTH, whole, maze + below, f'Run {name}')}\n"
    )
