"""The report of a run as one page, within another page, and as one picture."""

from __future__ import annotations

from dataclasses import replace

from simmer_tui.document import as_html, svg
from simmer_tui.report.content import report_document
from simmer_tui.report.figure import maze_figure
from simmer_tui.report.player import player_script, player_style
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.report.traces import traces
from simmer_tui.runlog.reader import LogReader

_GAP = 10.0
"""Points between the maze and the sensors."""


def report_of(log: LogReader) -> RunStatistics:
    """The figures of a log that is read to its end."""
    run = RunStatistics(log.header, log.configuration)
    for logged in log:
        run.add(logged)
    run.finish(log.note)
    return run


def report_page(run: RunStatistics, name: str) -> str:
    """The page about a log of some name, which plays the run."""
    document = report_document(run, name, pictures=True)
    return as_html.html_page(document, style=player_style(), script=player_script(run))


def embedded(run: RunStatistics, name: str) -> str:
    """The page for a notebook."""
    return as_html.embedded(report_page(run, name))


def svg_picture(run: RunStatistics, name: str) -> str:
    """The maze and under it the traces, as one picture."""
    figure, strips = replace(maze_figure(run), title=f"Run {name}"), traces(run)
    if strips is not None:
        below = svg.shifted(0.0, figure.height + _GAP, strips.content)
        height = figure.height + _GAP + strips.height
        figure = replace(figure, height=height, content=figure.content + below)
    return svg.document(figure)


def maze_picture(run: RunStatistics, name: str, width: float) -> str:
    """The maze with the whole path, as one picture `width` pixels wide."""
    return svg.document(replace(maze_figure(run), title=f"Run {name}"), width)
