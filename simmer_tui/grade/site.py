"""The pages: a leaderboard, a page a team, and some of its failed runs."""

from __future__ import annotations

from html import escape

from simmer_tui.errors import ConfigurationError, RunLogError
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.team_result import TeamResult, TeamStatus, ranked
from simmer_tui.report import svg
from simmer_tui.report.content import Column, Table
from simmer_tui.report.html_report import html_page, report_of
from simmer_tui.report.maze_frame import WIDTH
from simmer_tui.report.page import heading, html_tables, page, paragraph
from simmer_tui.runlog.reader import LogReader
from simmer_tui.trials.estimate_text import shown_estimate, shown_length
from simmer_tui.trials.figures import map_figure
from simmer_tui.trials.sequential import shown_test
from simmer_tui.trials.trials_summary import how

INDEX = "index.html"
_SHOWN_RUNS = 3
"""Failed runs of a team with a page of their own."""
_LARGEST_SHOWN = 2_000_000
"""Bytes of a compressed log that a page is made of."""
_COLUMNS = ("team", "", "success rate", "runs", "time s", "contacts a run", "most runs failed by")


def site(folder: GradeFolder, team_results: list[TeamResult], isolation: str) -> dict[str, str]:
    """All pages by name. `isolation` tells how programs were sandboxed."""
    pages = {INDEX: _leaderboard(folder, team_results, isolation)}
    for team_result in team_results:
        links = []
        for number, text in _run_pages(folder, team_result).items():
            name = f"{team_result.slug}-run-{number}.html"
            pages[name] = text
            links.append((number, name))
        pages[f"{team_result.slug}.html"] = _team_page(folder, team_result, links)
    return pages


def _leaderboard(folder: GradeFolder, team_results: list[TeamResult], isolation: str) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in _COLUMNS)
    rows = "".join(_row(team_result) for team_result in ranked(team_results))
    note = (
        "In brackets: the 95 % interval, exact for a test that stops by what it sees. All teams met the same "
        "missions, in the same order."
    )
    return page(
        folder.course.name,
        paragraph(shown_test(folder.test), "run"),
        f"<section><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></section>",
        paragraph(note, "note"),
        paragraph(isolation, "note"),
    )


def _row(team_result: TeamResult) -> str:
    score = "" if team_result.score is None else shown_estimate(team_result.score, ".2f")
    cause = team_result.said if team_result.outcome is TeamStatus.REFUSED else ""
    if team_result.causes:
        cause = "{} ({} of {})".format(*team_result.causes[0], team_result.runs - team_result.successes)
    cells = (
        f"<a href='{team_result.slug}.html'>{escape(team_result.label)}</a>",
        team_result.outcome.value,
        escape(score),
        str(team_result.runs),
        "" if team_result.time is None else shown_length(team_result.time),
        "" if team_result.contacts is None else f"{team_result.contacts:.2f}",
        escape(cause),
    )
    return f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _team_page(folder: GradeFolder, team_result: TeamResult, links: list[tuple[int, str]]) -> str:
    tables = [
        Table(
            "Why runs failed",
            (Column("cause", wraps=True), Column("runs", numeric=True)),
            tuple((cause, str(number)) for cause, number in team_result.causes),
        ),
        Table(
            "Runs",
            (Column("run", True), Column("time s", True), Column("contacts", True), Column("", wraps=True)),
            tuple(
                (str(each.number % 100_000), shown_length(each.time), str(each.contacts),
                 "success" if each.success else how(each))
                for each in team_result.results
            ),
        ),
    ]  # fmt: skip
    shown = "".join(f"<li><a href='{name}'>run {number}</a></li>" for number, name in links)
    return page(
        team_result.label,
        f"<p><a href='{INDEX}'>{escape(folder.course.name)}</a></p>",
        f"<p><strong>{team_result.outcome.value}</strong>: {escape(team_result.said)}</p>",
        _map(folder, team_result),
        heading("Failed runs, seen from above") + f"<ul>{shown}</ul>" if shown else "",
        html_tables(table for table in tables if table.rows),
    )


def _map(folder: GradeFolder, team_result: TeamResult) -> str:
    configuration = team_result.entry.check.configuration
    if configuration is None or not team_result.results:
        return ""
    height, content = map_figure(configuration.simulation.maze, team_result.results)
    return svg.picture(WIDTH, height, content, "Where runs failed")


def _run_pages(folder: GradeFolder, team_result: TeamResult) -> dict[int, str]:
    """Pages of the first failed runs whose logs are kept."""
    pages: dict[int, str] = {}
    for result in team_result.results:
        number = result.number % 100_000
        log = folder.log(team_result.entry, number)
        if result.success or len(pages) >= _SHOWN_RUNS or not log.exists():
            continue
        if log.stat().st_size > _LARGEST_SHOWN:
            continue
        try:
            with LogReader(log) as reader:
                pages[number] = html_page(report_of(reader), f"{team_result.label}, run {number}")
        except (RunLogError, ConfigurationError):
            continue  # a log that was cut short by its bound
    return pages
