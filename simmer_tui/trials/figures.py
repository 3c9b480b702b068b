"""Pictures of a set of trials, where runs failed and how times are spread, and a page for each failed run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from simmer_tui.document import svg
from simmer_tui.document.model import Figure, LegendMark
from simmer_tui.document.svg import PICTURE_WIDTH
from simmer_tui.errors import ConfigurationError, RunLogError
from simmer_tui.report.figure import AXIS, LEFT, RIGHT, TOP, MazeFrame
from simmer_tui.report.page import report_page
from simmer_tui.report.run_statistics import RunStatistics, report_of
from simmer_tui.runlog.reader import LogReader
from simmer_tui.sim.specs import BLOCK, CELL_SIZE, START, MazeSpec
from simmer_tui.trials.failures import color_of, counted_causes, failures_in_turn, grouped
from simmer_tui.trials.folder import RUNS, TrialFolder
from simmer_tui.trials.intervals import bin_counts, histogram
from simmer_tui.trials.trial import TrialResult

# Bounds of the map: points an inch, and points.
_LARGEST_SCALE, _TALLEST = 10.0, 700.0
_START, _BLOCK = "#e8f0ff", "#fff3c4"
_SUCCESS, _FAILURE = "#0a968c", "#f5a500"
# Height of the tallest bar of a histogram, points.
_BAR_HEIGHT = 130.0


def map_figure(
    maze: MazeSpec,
    results: Sequence[TrialResult],
    run_pages: Mapping[int, str] = MappingProxyType({}),
    title: str = "Where runs failed",
) -> Figure:
    """The maze with contacts, ends of failed runs, and the share of successes at every start cell. Ends link
    to `run_pages`, by number."""
    frame = MazeFrame(maze, largest_scale=_LARGEST_SCALE, tallest=_TALLEST)
    at, scale = frame.at, frame.scale
    parts = [frame.cells(START, _START), frame.cells(BLOCK, _BLOCK), frame.walls()]
    parts += [_fraction(*at(*cell), group, scale) for cell, group in grouped(results, start_cell).items()]
    causes = counted_causes(results)
    ends = ""
    for name, group in causes:
        marks = "".join(_end(*at(*result.end[:2]), result, run_pages) for result in group)
        look = {"fill": color_of(name), "fill_opacity": 0.7, "stroke": "#222222", "stroke_width": 0.8}
        ends += svg.element("g", marks, **look)
    parts.append(svg.element("g", ends, class_="fixed"))
    crosses = "".join(
        f"<path d='M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8'/>"
        for x, y in (at(*point) for result in results for point in result.contact_points)
    )
    parts.append(svg.element("g", crosses, stroke=svg.CONTACT, stroke_width=1.8, stroke_opacity=0.7))
    parts.append(frame.axes())
    by_cause = (LegendMark(f"{name} {len(group)}", _dot(color_of(name))) for name, group in causes)
    height, legend = frame.bottom + AXIS, (*_MARKS, *by_cause)
    return Figure(title, PICTURE_WIDTH, height, "".join(parts), "map", legend)


def _end(x: float, y: float, result: TrialResult, run_pages: Mapping[int, str]) -> str:
    """Mark at the end of a failed run, with the cause in a tooltip."""
    why = f"run {result.number}: {result.why or result.reason}"
    drawn = svg.element("circle", svg.tooltip(why), cx=x, cy=y, r=5.0)
    page = run_pages.get(result.number)
    return drawn if page is None else svg.element("a", drawn, href=page)


def _dot(fill: str) -> str:
    """Of a legend."""
    circle = svg.element("circle", cx=10.0, r=5.0, fill=fill, stroke="#222222")
    return svg.element("g", circle, class_="fixed")


_MARKS = (
    LegendMark("contact", svg.cross(svg.CONTACT, 1.8)),
    LegendMark("where a failed run ended, by cause", _dot("#fff")),
    LegendMark(
        "start cell, its successes of its runs",
        svg.element("circle", cx=10.0, r=7.0, fill="none", stroke=_SUCCESS, stroke_width=3.0),
    ),
)


def start_cell(result: TrialResult) -> tuple[float, float]:
    """The middle of the cell that a run began in, inches."""
    x, y, _ = result.start
    return (math.floor(x / CELL_SIZE) + 0.5) * CELL_SIZE, (math.floor(y / CELL_SIZE) + 0.5) * CELL_SIZE


def _fraction(x: float, y: float, group: Sequence[TrialResult], scale: float) -> str:
    """A start cell's successes as a ring that is closed where all runs succeeded: 9/10."""
    successes = sum(result.success for result in group)
    radius = min(CELL_SIZE * scale * 0.42, 40.0)
    length = math.tau * radius
    ring = svg.element("circle", cx=x, cy=y, r=radius, fill="none", stroke="#c8c8c8", stroke_width=4.0)
    if successes:
        done = length * successes / len(group)
        ring += svg.element(
            "circle", cx=x, cy=y, r=radius, fill="none", stroke=_SUCCESS, stroke_width=4.0,
            stroke_dasharray=f"{done:.2f} {length - done + 0.01:.2f}",
            transform=f"rotate(-90 {svg.coordinate(x)} {svg.coordinate(y)})",
        )  # fmt: skip
    return ring + svg.text(
        x, y + radius * 0.72, f"{successes}/{len(group)}", 11.0, text_anchor="middle", font_weight="bold",
        paint_order="stroke", stroke="#ffffff", stroke_width=3.0,
    )  # fmt: skip


def histogram_figure(successes: Sequence[float], failures: Sequence[float], unit: str) -> Figure:
    """The distribution of values of successful and of failed runs. There must be a value."""
    edges, decimals = histogram([*successes, *failures])
    counts = [bin_counts(values, edges) for values in (successes, failures)]
    tallest = max(a + b for a, b in zip(*counts, strict=True))
    bottom, width = TOP + 12 + _BAR_HEIGHT, (PICTURE_WIDTH - LEFT - RIGHT) / len(counts[0])
    parts = []
    for index, (done, failed) in enumerate(zip(*counts, strict=True)):
        x, base = LEFT + index * width, bottom
        for count, fill in ((done, _SUCCESS), (failed, _FAILURE)):
            height = _BAR_HEIGHT * count / tallest
            base -= height
            if count:
                parts.append(svg.element("rect", x=x + 1, y=base, width=width - 2, height=height, fill=fill))
        if done + failed:
            middle = x + width / 2
            parts.append(svg.text(middle, base - 3, f"{done + failed}", text_anchor="middle"))
    every = max(1, math.ceil(len(edges) / 16))
    parts += [
        svg.text(LEFT + index * width, bottom + 14, f"{edge:.{decimals}f}", text_anchor="middle")
        for index, edge in enumerate(edges)
        if index % every == 0
    ]
    parts.append(svg.text(LEFT - 14, bottom + 14, unit, text_anchor="end", fill=svg.FAINT))
    legend = tuple(
        LegendMark(words, svg.element("rect", x=0.0, y=-5.0, width=10.0, height=10.0, fill=fill), 10.0)
        for words, fill in (("successful runs", _SUCCESS), ("failed runs", _FAILURE))
    )
    return Figure("Histogram", PICTURE_WIDTH, bottom + 20, "".join(parts), "graph", legend)


# Each page takes time and space, and nobody reads more pages than these.
MOST_FIGURE_PAGES = 60
"""Most pages of a set of trials."""
# A longer log makes a page that browsers open slowly.
_LARGEST = 20_000_000
"""Largest log that a page is made of, bytes."""
_SUFFIX = ".html"


def logged_run(log: Path) -> RunStatistics | None:
    """The figures of a run by its log; None if the log is not there or cannot be read."""
    try:
        with LogReader(log) as reader:
            return report_of(reader)
    except (RunLogError, ConfigurationError):
        return None  # `report` gives the message for it


def log_page(log: Path, name: str, *, commands: bool = True) -> str | None:
    """The page about a run by its log, see `report_page`; None if the log cannot be read."""
    run = logged_run(log)
    return None if run is None else report_page(run, name, commands=commands)


def write_run_pages(folder: TrialFolder) -> dict[int, str]:
    """Write the pages that are not there yet, of failed runs whose logs are here, the first ones of every
    cause. Returns them by the runs' numbers, as they are linked to from the folder. Raises TrialsError."""
    pages: dict[int, str] = {}
    for number in failures_in_turn(folder.done):
        log = folder.log(number)
        if len(pages) >= MOST_FIGURE_PAGES or not log.exists() or log.stat().st_size > _LARGEST:
            continue
        name = f"{RUNS}/{folder.trial(number).name}{_SUFFIX}"
        page = folder.path / name
        if not page.exists() or page.stat().st_mtime_ns < log.stat().st_mtime_ns:
            text = log_page(log, log.name)
            if text is None:
                continue
            folder.store.write(name, text)
        pages[number] = name
    return pages
