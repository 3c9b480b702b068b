"""The report as one page, within another page, and as one picture."""

from __future__ import annotations

from simmer_tui.report import svg
from simmer_tui.report.content import tables
from simmer_tui.report.figure import maze_figure
from simmer_tui.report.findings import findings
from simmer_tui.report.markup import escape
from simmer_tui.report.maze_frame import WIDTH
from simmer_tui.report.page import heading, html_tables, page, paragraph
from simmer_tui.report.player import player_script, player_style, shortened
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.report.traces import traces
from simmer_tui.runlog.reader import LogReader


def report_of(log: LogReader) -> RunStatistics:
    """The figures of a log that is read to its end."""
    run = RunStatistics(log.header, log.configuration)
    for logged in log:
        run.add(logged)
    run.finish(log.note)
    return run


def embedded(run: RunStatistics, name: str) -> str:
    """The page for a notebook: a document of its own within, whose script reaches nothing outside it."""
    page = html_page(run, name).replace("&", "&amp;").replace('"', "&quot;")
    looks = 'width="100%" height="820" style="border:0"'
    return f'<iframe sandbox="allow-scripts" {looks} srcdoc="{page}"></iframe>'


def html_page(run: RunStatistics, name: str) -> str:
    """The page about a log of some name."""
    maze_height, maze = maze_figure(run)
    height, strips = traces(run)
    header = run.header
    about = f"{header.start}, configuration {header.configuration}, seed {header.seed}"
    found = [escape(finding) for finding in findings(run)]
    if run.cause is not None:
        found[0] += f" <a href='#t={run.cause.elapsed:.2f}'>See it happen</a>"
    sensors = ""
    if height:
        drawn = svg.picture(WIDTH, height, strips, "Sensors")
        sensors = f"{heading('Sensors over time')}<div class='strips'>{drawn}</div>"
    return page(
        f"Run {name}",
        paragraph(about, "run"),
        heading("What happened"),
        f"<ul>{''.join(f'<li>{each}</li>' for each in found)}</ul>",
        *(paragraph(f"Note: {note}", "note") for note in run.notes),
        heading("Where the robot went"),
        f"<div class='maze'>{svg.picture(WIDTH, maze_height, maze, 'The maze and the path')}</div>",
        paragraph(shortened(run.recording), "note"),
        sensors,
        html_tables(tables(run)),
        f"<p class='note'>The same robot again: <code>simmer-tui replay {escape(name)}</code>, and to prove "
        f"it: <code>simmer-tui rerun {escape(name)}</code></p>",
        player_script(run),
        style=player_style(),
    )


def svg_picture(run: RunStatistics, name: str) -> str:
    """The maze and under it the traces, as one picture."""
    height, maze = maze_figure(run)
    more, strips = traces(run)
    below = svg.shifted(0.0, height + 10, strips) if more else ""
    whole = height + (more + 10 if more else 0)
    return svg.document(WIDTH, whole, maze + below, f"Run {name}")


def maze_picture(run: RunStatistics, name: str, width: float) -> str:
    """The maze with the whole way, as one picture `width` pixels wide."""
    height, maze = maze_figure(run)
    return svg.document(WIDTH, height, maze, f"Run {name}", width)
