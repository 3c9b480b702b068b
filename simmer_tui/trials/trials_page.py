"""The answer of a set of trials as one page that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from types import MappingProxyType

from simmer_tui.report import markup, svg
from simmer_tui.report.maze_frame import WIDTH
from simmer_tui.report.page import heading, html_tables, page, paragraph
from simmer_tui.sim import command
from simmer_tui.trials.estimate_text import rate, shown_estimate
from simmer_tui.trials.failures import counted_causes, failure_summary
from simmer_tui.trials.figures import histogram_figure, map_figure
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.record import TrialResult
from simmer_tui.trials.trial import RANDOM
from simmer_tui.trials.trials_summary import advice, tables

_MAPS = 12
"""Most mazes drawn."""


def html_page(folder: TrialFolder, run_pages: Mapping[int, str] = MappingProxyType({})) -> str:
    """The page about the runs that are done; there must be one. `run_pages` are the pages of runs that it
    links to, by number."""
    results = folder.done
    successes = sum(result.success for result in results)
    first, *others = tables(folder)
    answer = f"{successes} of {len(results)} runs succeeded: success rate {shown_estimate(rate(results))}"
    return page(
        f"Trials of {command.escape(folder.plan.command, 120)}",
        f"<p><strong>{answer}</strong></p>",
        paragraph(failure_summary(results)),
        paragraph(advice(results), "note"),
        html_tables([first]),
        _links(results, run_pages),
        heading("Where runs failed and contacts happened"),
        _maps(folder, results, run_pages),
        heading("Simulated time, s"),
        _histogram(results, [result.time for result in results], "s"),
        heading("Distance driven, in"),
        _histogram(results, [result.distance for result in results], "in"),
        html_tables(others),
    )


def _links(results: list[TrialResult], run_pages: Mapping[int, str]) -> str:
    """The runs that can be looked at, by cause."""
    items = []
    for name, group in counted_causes(results):
        links = [
            f"<a href='{run_pages[each.number]}' title='{markup.escape(each.why or each.reason)}'>"
            f"run {each.number}</a>"
            for each in group
            if each.number in run_pages
        ]
        if links:
            items.append(f"<li>{escape(name)}: {', '.join(links)}</li>")
    if not items:
        return ""
    return f"{heading('Failed runs, to be played')}<ul>{''.join(items)}</ul>"


def _maps(folder: TrialFolder, results: list[TrialResult], run_pages: Mapping[int, str]) -> str:
    """A map a maze, those with most failures first; of mazes made for one run each, the failed ones."""
    groups: dict[str, list[TrialResult]] = {}
    for result in results:
        if result.maze != RANDOM:
            groups.setdefault(result.maze, []).append(result)
        elif not result.success or result.contacts:
            groups[f"run {result.number}"] = [result]
    drawn = sorted(groups.items(), key=lambda item: -sum(not result.success for result in item[1]))
    parts = []
    for name, group in drawn[:_MAPS]:
        height, content = map_figure(folder.maze(group[0].number), group, run_pages)
        label = command.escape(name, 80)
        heading = f"<h3>{escape(label)}</h3>" if label else ""
        parts.append(f"<section>{heading}{svg.picture(WIDTH, height, content, f'Map {label}')}</section>")
    if len(drawn) > _MAPS:
        parts.append(f"<p class='note'>and {len(drawn) - _MAPS} more mazes</p>")
    return "".join(parts) or "<p>No run failed, and no wall was touched.</p>"


def _histogram(results: list[TrialResult], values: list[float], unit: str) -> str:
    pairs = list(zip(results, values, strict=True))
    height, content = histogram_figure(
        [value for result, value in pairs if result.success],
        [value for result, value in pairs if not result.success],
        unit,
    )
    return svg.picture(WIDTH, height, content, "Histogram")
