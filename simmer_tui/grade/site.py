"""The answer of a grading: grades of all teams, a page a team, some failed runs; and for other programs."""

from __future__ import annotations

from xml.etree import ElementTree

from simmer_tui.document.as_data import json_text
from simmer_tui.document.as_html import html_page
from simmer_tui.document.formats import COUNT, LENGTH, WORDS, TextLink, estimate, number
from simmer_tui.document.model import (
    Bullets,
    DataColumn,
    DataTable,
    Document,
    DocumentPart,
    Paragraph,
    Prose,
    SectionHeading,
)
from simmer_tui.errors import ConfigurationError, RunLogError
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.team_result import TeamResult, TeamStatus, code_of, last_failure, ranked
from simmer_tui.phrases import computing_text
from simmer_tui.report.content import report_page
from simmer_tui.report.run_statistics import report_of
from simmer_tui.runlog.reader import LogReader
from simmer_tui.sim.fingerprint import math_fingerprint
from simmer_tui.trials.figures import map_figure
from simmer_tui.trials.sequential import shown_test
from simmer_tui.trials.trials_summary import failure_text

INDEX = "index.html"
_SHOWN_RUNS = 3
"""Failed runs of a team with a page of their own."""
_LARGEST_SHOWN = 2_000_000
"""Bytes of a compressed log that a page is made of."""
GRADES = DataTable(
    "grades",
    "Grades",
    (
        DataColumn("team", wraps=True),
        DataColumn("code", hidden=True),
        DataColumn("outcome", heading=""),
        DataColumn("success_rate", estimate(".2f")),
        DataColumn("successes", COUNT, hidden=True),
        DataColumn("runs", COUNT),
        DataColumn("time_s", LENGTH),
        DataColumn("contacts_per_run", number(".2f"), "contacts/run"),
        DataColumn("main_cause", hidden=True),
        DataColumn("problem", hidden=True),
        DataColumn("why", WORDS, "most runs failed by", wraps=True),
    ),
)
CAUSES = DataTable("causes", "Why runs failed", (DataColumn("cause", wraps=True), DataColumn("runs", COUNT)))
RUNS = DataTable(
    "runs",
    "Runs",
    (
        DataColumn("run", COUNT),
        DataColumn("time_s", LENGTH),
        DataColumn("contacts", COUNT),
        DataColumn("text", heading="", wraps=True),
    ),
)


def grades_table(folder: GradeFolder, team_results: list[TeamResult], *, links: bool = False) -> DataTable:
    """A row a team; the same for the same seed and programs. Names may link to the teams' pages."""
    rows = []
    for each in team_results:
        cause, count = each.causes[0] if each.causes else (None, 0)
        why = f"{cause} ({count} of {each.runs - each.successes})" if cause else None
        problem = each.said if each.outcome is TeamStatus.REFUSED else None
        rows.append(
            (
                TextLink(each.label, f"{each.slug}.html") if links else each.label,
                code_of(folder, each.entry),
                *(each.outcome.value, each.score, each.successes, each.runs, each.time, each.contacts),
                *(cause, problem, problem or why),
            )
        )
    return GRADES.filled(rows)


def grades_document(
    folder: GradeFolder, team_results: list[TeamResult], isolation: str, *, links: bool = False
) -> Document:
    """The grades, the best team first. `isolation` tells how programs were kept apart."""
    note = (
        "In brackets: the 95 % interval, exact for a sequential test. All teams met the same "
        "missions, in the same order."
    )
    passed = sum(each.outcome is TeamStatus.PASSED for each in team_results)
    runs = sum(each.runs for each in team_results)
    # The course's settings of motion hold for every team.
    checked = (each.check.configuration for each in folder.entries)
    motions = sorted({each.settings.motion.motion for each in checked if each is not None})
    parts: tuple[DocumentPart, ...] = (
        Paragraph(shown_test(folder.test), "test", "run"),
        grades_table(folder, ranked(team_results), links=links),
        Paragraph(f"{passed} of {len(team_results)} teams passed, {runs} runs counted", "answer"),
        Paragraph(note, kind="note"),
        Paragraph(isolation, "isolation", "note"),
        *(Paragraph(computing_text(each), "computing", "note") for each in motions),
        Paragraph(
            f"Fingerprint of this machine's mathematics: {math_fingerprint()}. On a machine with another "
            "one, numbers may differ in their last bits.",
            "mathematics",
            "note",
        ),
    )
    return Document(folder.course.name, parts)


def site(folder: GradeFolder, team_results: list[TeamResult], isolation: str) -> dict[str, str]:
    """All pages by name. `isolation` tells how programs were kept apart."""
    pages = {INDEX: html_page(grades_document(folder, team_results, isolation, links=True))}
    for team_result in team_results:
        links: list[tuple[Prose, ...]] = []
        for number_of, text in _run_pages(folder, team_result).items():
            name = f"{team_result.slug}-run-{number_of}.html"
            pages[name] = text
            links.append((TextLink(f"run {number_of}", name),))
        pages[f"{team_result.slug}.html"] = html_page(_team_document(folder, team_result, links))
    return pages


def _team_document(folder: GradeFolder, team_result: TeamResult, links: list[tuple[Prose, ...]]) -> Document:
    runs = [
        (
            *(each.number % 100_000, each.time, each.contacts),
            "success" if each.success else failure_text(each),
        )
        for each in team_result.results
    ]
    tables = (
        CAUSES.filled(team_result.causes),
        RUNS.filled(runs),
    )
    parts: list[DocumentPart] = [
        Paragraph((TextLink(folder.course.name, INDEX),)),
        Paragraph(f"{team_result.outcome.value}: {team_result.said}", "answer", "strong"),
    ]
    configuration = team_result.entry.check.configuration
    if configuration is not None and team_result.results:
        parts += [
            SectionHeading("Where runs failed"),
            map_figure(configuration.simulation.maze, team_result.results),
        ]
    parts += [Bullets("Failed runs, seen from above", links), *(table for table in tables if table.rows)]
    return Document(team_result.label, parts)


def _run_pages(folder: GradeFolder, team_result: TeamResult) -> dict[int, str]:
    """Pages of the first failed runs whose logs are kept."""
    pages: dict[int, str] = {}
    for result in team_result.results:
        number_of = result.number % 100_000
        log = folder.log(team_result.entry, number_of)
        if result.success or len(pages) >= _SHOWN_RUNS or not log.exists():
            continue
        if log.stat().st_size > _LARGEST_SHOWN:
            continue
        try:
            with LogReader(log) as reader:
                pages[number_of] = report_page(report_of(reader), f"{team_result.label}, run {number_of}")
        except (RunLogError, ConfigurationError):
            continue  # a log that was cut short by its bound
    return pages


def junit_xml(folder: GradeFolder, team_results: list[TeamResult]) -> str:
    """A test case a team: a failure has failed, an error was not run, a skipped one is not decided yet."""
    counts = {outcome: sum(each.outcome is outcome for each in team_results) for outcome in TeamStatus}
    suite = ElementTree.Element(
        "testsuite",
        name=_text(folder.course.name),
        tests=str(len(team_results)),
        failures=str(counts[TeamStatus.FAILED]),
        errors=str(counts[TeamStatus.REFUSED]),
        skipped=str(counts[TeamStatus.UNDER_WAY]),
    )
    kinds = {TeamStatus.FAILED: "failure", TeamStatus.REFUSED: "error", TeamStatus.UNDER_WAY: "skipped"}
    for each in team_results:
        case = ElementTree.SubElement(
            suite, "testcase", classname="simmer-tui.grade", name=_text(each.entry.team.name)
        )
        if each.outcome in kinds:
            about = ElementTree.SubElement(case, kinds[each.outcome], message=_text(each.said))
            about.text = _text(last_failure(each))
        out = ElementTree.SubElement(case, "system-out")
        out.text = _text(each.said)
    ElementTree.indent(suite)
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{ElementTree.tostring(suite, encoding='unicode')}\n"


def _text(text: str) -> str:
    """Without what XML cannot hold."""
    return "".join(character if character.isprintable() else " " for character in text)


def gradescope_json(folder: GradeFolder, team_result: TeamResult) -> str:
    """A team's results.json: of 100 points as many as its success rate in percent, and whether it passed."""
    score = 0.0 if team_result.score is None else team_result.score.value
    passed = team_result.outcome is TeamStatus.PASSED
    causes = [f"{number} of {team_result.runs} runs: {cause}" for cause, number in team_result.causes]
    board: list[dict[str, object]] = [{"name": "success rate", "value": round(score, 3)}]
    if team_result.time is not None:  # without a success there is no time, and 0 would be the best
        board.append({"name": "time, s", "value": round(team_result.time, 1), "order": "asc"})
    fields = {
        "score": round(100 * score, 1),
        "output": "\n".join((shown_test(folder.test), team_result.said, *causes)),
        "visibility": "visible",
        "stdout_visibility": "hidden",
        "tests": [
            {
                "name": f"success rate of {folder.course.require:g}",
                "status": "passed" if passed else "failed",
                "score": round(100 * score, 1),
                "max_score": 100,
                "output": team_result.said,
            }
        ],
        "leaderboard": board,
    }
    return json_text(fields)
