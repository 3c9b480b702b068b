"""The report as one page, and as one picture."""

from __future__ import annotations

from simmer_tui.report import svg
from simmer_tui.report.content import tables
from simmer_tui.report.figure import WIDTH, maze_figure
from simmer_tui.report.findings import findings
from simmer_tui.report.markup import escape
from simmer_tui.report.page import heading, html_tables, page, paragraph
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.report.traces import traces


def html_page(run: RunStatistics, name: str) -> str:
    """The page about a log of some name."""
    maze_height, maze = maze_figure(run)
    height, strips = traces(run)
    header = run.header
    about = f"{header.start}, configuration {header.configuration}, seed {header.seed}"
    found = "".join(f"<li>{escape(finding)}</li>" for finding in findings(run))
    sensors = heading("Sensors over time") + svg.picture(WIDTH, height, strips, "Sensors") if height else ""
    return page(
        f"Run {name}",
        paragraph(about, "run"),
        heading("What happened"),
        f"<ul>{found}</ul>",
        *(paragraph(f"Note: {note}", "note") for note in run.notes),
        heading("Where the robot went"),
        svg.picture(WIDTH, maze_height, maze, "The maze and the path"),
        sensors,
        html_tables(tables(run)),
        f"<p class='note'>The same robot again: <code>simmer-tui replay {escape(name)}</code>, and to prove "
        f"it: <code>simmer-tui rerun {escape(name)}</code></p>",
    )


def svg_picture(run: RunStatistics, name: str) -> str:
    """The maze and under it the traces, as one picture."""
    height, maze = maze_figure(run)
    more, strips = traces(run)
    below = svg.shifted(0.0, height + 10, strips) if more else ""
    whole = height + (more + 10 if more else 0)
    return (
        f"<?xml version='1.0' encoding='UTF-8'?>\n{svg.picture(WIDTH, whole, maze + below, f'Run {name}')}\n"
    )
