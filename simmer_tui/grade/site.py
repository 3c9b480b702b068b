"""The answer of a grading: grades, a page a team, some failed runs, and files for other programs."""

from __future__ import annotations

from collections import Counter
from xml.etree import ElementTree

from msgspec.structs import replace

from simmer_tui.document.as_data import json_text
from simmer_tui.document.as_html import html_page
from simmer_tui.document.formats import COUNT, LENGTH, WORDS, TextLink, estimate, number
from simmer_tui.document.model import (
    Bullets,
    DataColumn,
    DataTable,
    Document,
    DocumentPart,
    Folded,
    KeyFigures,
    Paragraph,
    Tone,
    VerdictBox,
    data_table,
)
from simmer_tui.grade.grade_folder import GradeFolder, number_in_team
from simmer_tui.grade.team_result import TeamResult, TeamStatus, code_of, last_failure, ranked
from simmer_tui.run.phrases import SHOWN_OUTPUT
from simmer_tui.sim.command import counted, cut, first_of
from simmer_tui.sim.fingerprint import math_fingerprint
from simmer_tui.trials.figures import log_page, map_figure
from simmer_tui.trials.sequential import shown_test
from simmer_tui.trials.trial import clock_sentences, clocks_text
from simmer_tui.trials.trials_page import beside, key_figures
from simmer_tui.trials.trials_summary import failure_text

INDEX = "index.html"
_TONES = {
    TeamStatus.PASSED: Tone.GOOD,
    TeamStatus.FAILED: Tone.BAD,
    TeamStatus.REFUSED: Tone.BAD,
    TeamStatus.UNDER_WAY: Tone.PLAIN,
}
_RUN_TONES = {"succeeded": Tone.GOOD, "failed": Tone.BAD}
_MOST_SILENT = 5
"""Programs that never started whose names and lines are shown; judged: more would push the table away."""
NOT_COPIED = "Not copied, so not there in the runs: submit plain files"
"""The title of the list of files that were left out of the copies of submissions."""
_SHOWN_RUNS = 3
"""Failed runs of a team with a page of their own."""
_LARGEST_SHOWN = 2_000_000
"""Largest compressed log that a page is made of, bytes."""
GRADES = data_table(
    "grades",
    "Grades",
    DataColumn("team", wraps=True),
    DataColumn("code", hidden=True),
    DataColumn("status", heading="", tone=lambda status: _TONES[TeamStatus(status)]),
    DataColumn("success_rate", estimate(".2f")),
    DataColumn("successes", COUNT, hidden=True),
    DataColumn("runs", COUNT),
    DataColumn("time_s", LENGTH),
    DataColumn("contacts_per_run", number(".2f"), "contacts/run"),
    DataColumn("clock"),
    DataColumn("main_cause", hidden=True),
    DataColumn("problem", hidden=True),
    DataColumn("why", WORDS, "main cause", wraps=True),
)
_CAUSES = data_table("causes", "Why runs failed", DataColumn("cause", wraps=True), DataColumn("runs", COUNT))
_RUNS = data_table(
    "runs",
    "Runs",
    DataColumn("run", COUNT),
    DataColumn("outcome", heading="", tone=_RUN_TONES.__getitem__),
    DataColumn("time_s", LENGTH),
    DataColumn("contacts", COUNT),
    DataColumn("clock"),
    DataColumn("text", heading="", wraps=True),
)


def grades_table(folder: GradeFolder, team_results: list[TeamResult], *, links: bool = False) -> DataTable:
    """A row a team; the same for the same seed and programs. Names may link to the teams' pages."""
    rows = []
    for each in team_results:
        cause, count = each.causes[0] if each.causes else (None, 0)
        why = f"{cause} ({count} of {each.runs - each.successes})" if cause else None
        problem = each.summary if each.status is TeamStatus.REFUSED else None
        rows.append(
            (
                TextLink(each.label, f"{each.slug}.html") if links else each.label,
                code_of(folder, each.entry),
                *(each.status.value, each.score, each.successes, each.runs, each.time, each.contacts),
                clocks_text(each.results),
                *(cause, problem, problem or why),
            )
        )
    clocks = {clocks_text(each.results) for each in team_results if each.results}
    return _with_clock(GRADES, len(clocks) > 1).filled(rows)


def _with_clock(table: DataTable, differs: bool) -> DataTable:
    """A table with the column of the clock only where it differs; otherwise the notes name it."""
    columns = [replace(each, hidden=not differs) if each.key == "clock" else each for each in table.columns]
    return replace(table, columns=tuple(columns))


def grades_document(folder: GradeFolder, team_results: list[TeamResult], isolation: str) -> Document:
    """The grades for terminals and programs, the best team first. `isolation` is a sentence about the
    sandboxes."""
    return Document(
        folder.course.name,
        (
            Paragraph(shown_test(folder.test), "test", "run"),
            grades_table(folder, ranked(team_results)),
            Paragraph(_answer(team_results), "answer"),
            *_left_out(folder, team_results),
            *_notes(folder, isolation),
        ),
    )


def _left_out(folder: GradeFolder, team_results: list[TeamResult]) -> list[Bullets]:
    """The files of submissions that were not copied: a program that needs one fails without it."""
    if folder.plan.hides_names:  # a path may name its team
        return []
    lines = [
        f"{each.label}: {', '.join(each.entry.planned.not_copied)}"
        for each in team_results
        if each.entry.planned.not_copied
    ]
    return [Bullets(NOT_COPIED, lines, "not_copied")] if lines else []


def _answer(team_results: list[TeamResult]) -> str:
    passed = sum(each.status is TeamStatus.PASSED for each in team_results)
    runs = sum(each.runs for each in team_results)
    return f"{passed} of {counted(len(team_results), 'team')} passed, {counted(runs, 'run')} counted"


def _notes(folder: GradeFolder, isolation: str) -> list[DocumentPart]:
    """Notes on how the grades were made."""
    note = (
        "In brackets: the 95 % interval, exact for a sequential test. All teams met the same "
        "missions, in the same order."
    )
    said: dict[str, None] = {}
    for each in folder.entries:
        if each.check.configuration is not None:
            said |= dict.fromkeys(clock_sentences(each.check.configuration, folder.counted(each)))
    return [
        Paragraph(note, kind="note"),
        Paragraph(isolation, "isolation", "note"),
        *(Paragraph(cut(text, 600), "computing", "note") for text in said),
        Paragraph(
            f"Fingerprint of this machine's mathematics: {math_fingerprint()}. On a machine with another "
            "fingerprint, numbers may differ in their last bits.",
            "mathematics",
            "note",
        ),
    ]


# -- pages -----------------------------------------------------------------------------------------


def site(folder: GradeFolder, team_results: list[TeamResult], isolation: str) -> dict[str, str]:
    """All pages by name. `isolation` is a sentence about the sandboxes."""
    pages = {INDEX: html_page(_index_page(folder, team_results, isolation))}
    for team_result in team_results:
        links: dict[int, str] = {}
        for number_of, text in _run_pages(folder, team_result).items():
            links[number_of] = f"{team_result.slug}-run-{number_of}.html"
            pages[links[number_of]] = text
        pages[f"{team_result.slug}.html"] = html_page(_team_page(folder, team_result, links))
    return pages


def _index_page(folder: GradeFolder, team_results: list[TeamResult], isolation: str) -> Document:
    """The page of all teams: how many have passed, and the table, in which each name leads to its team."""
    statuses = Counter(each.status for each in team_results)
    passed, teams = statuses[TeamStatus.PASSED], len(team_results)
    silent = [each for each in team_results if each.never_started]
    tone = Tone.GOOD if passed == teams else Tone.MIXED if passed else Tone.BAD
    names = first_of([each.label for each in silent], _MOST_SILENT)
    never = f" Never started: {names}." if silent else ""
    verdict = VerdictBox(
        key="answer",
        text=_answer(team_results),
        headline=f"{passed} of {counted(teams, 'team')} passed",
        tone=tone,
        sentence=(f"A success rate of {folder.test.rate:g} passes.{never}",),
    )
    # Each team is in one of the three numbers. A refused one may have results of an earlier check.
    unstarted = sum(each.status is TeamStatus.FAILED for each in silent)
    failed, refused = statuses[TeamStatus.FAILED], statuses[TeamStatus.REFUSED]
    if left := statuses[TeamStatus.UNDER_WAY]:
        failed, third = failed + refused, (str(left), "under way")
    else:
        failed, third = failed - unstarted, (str(refused + unstarted), "refused or never started")
    runs = sum(each.runs for each in team_results)
    graded = f"{folder.course.name} · {counted(teams, 'team')} · {counted(runs, 'run')}"
    table = replace(grades_table(folder, ranked(team_results), links=True), title="", sortable=True)
    # The output of a program may name its team.
    shown = () if folder.plan.hides_names else silent[:_MOST_SILENT]
    return Document(
        folder.course.name,
        (
            Paragraph(graded, kind="run"),
            verdict,
            KeyFigures(((str(passed), "passed"), (str(failed), "did not pass"), third)),
            table,
            *(_last_lines(folder, each) for each in shown),
            *_left_out(folder, team_results),
            Folded(
                "How the grades were made", (Paragraph(shown_test(folder.test)), *_notes(folder, isolation))
            ),
        ),
    )


def _last_lines(folder: GradeFolder, team_result: TeamResult) -> Bullets:
    """The last output of a team's program in its last run."""
    title = f"{team_result.label}: last lines of its program"
    try:
        output = folder.output(team_result.entry, number_in_team(team_result.results[-1])).read_bytes()
    except OSError:
        return Bullets(title, ())  # not kept: its space was used up
    lines = output.decode(errors="replace").splitlines()[-SHOWN_OUTPUT:]
    return Bullets(title, lines, kind="output")


def _team_page(folder: GradeFolder, team_result: TeamResult, links: dict[int, str]) -> Document:
    """The page of a team: its runs. Some have a page of their own."""
    rows = []
    for each in team_result.results:
        number_of = number_in_team(each)
        run = TextLink(f"run {number_of}", links[number_of]) if number_of in links else number_of
        outcome, text = ("succeeded", None) if each.success else ("failed", failure_text(each))
        rows.append((run, outcome, each.time, each.contacts, each.clock or None, text))
    runs = _with_clock(_RUNS, len({each.clock for each in team_result.results}) > 1)
    left: list[DocumentPart] = [
        table for table in (_CAUSES.filled(team_result.causes), runs.filled(rows)) if table.rows
    ]
    parts: list[DocumentPart] = [
        Paragraph((TextLink(folder.course.name, INDEX),), kind="run"),
        VerdictBox(
            key="answer",
            text=f"{team_result.status.value}: {team_result.summary}",
            headline=f"{team_result.label}: {team_result.status.value}",
            tone=_TONES[team_result.status],
            sentence=(team_result.summary,),
        ),
    ]
    if team_result.results:
        successes = f"{team_result.successes} of {team_result.runs}"
        parts.append(key_figures(successes, "succeeded", team_result.results))
    configuration = team_result.entry.check.configuration
    picture: list[DocumentPart] = []
    if configuration is not None and team_result.results:
        picture.append(map_figure(configuration.simulation.maze, team_result.results))
    return Document(team_result.label, [*parts, *beside(left, picture), *_left_out(folder, [team_result])])


def _run_pages(folder: GradeFolder, team_result: TeamResult) -> dict[int, str]:
    """Pages of the first failed runs, and of one that succeeded, whose logs are kept."""
    pages: dict[int, str] = {}
    failures = 0
    for result in team_result.results:
        number_of = number_in_team(result)
        log = folder.log(team_result.entry, number_of)
        if not log.exists() or (failures >= _SHOWN_RUNS and not result.success):
            continue
        failures += not result.success
        if log.stat().st_size > _LARGEST_SHOWN:
            continue
        page = log_page(log, f"{team_result.label}, run {number_of}", commands=False)
        if page is not None:  # None if the limit has cut the log off
            pages[number_of] = page
    return pages


def junit_xml(folder: GradeFolder, team_results: list[TeamResult]) -> str:
    """A test case a team: a failure has failed, an error was not run, a skipped one is not decided yet."""
    counts = Counter(each.status for each in team_results)
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
        if each.status in kinds:
            about = ElementTree.SubElement(case, kinds[each.status], message=_text(each.summary))
            about.text = _text(last_failure(each))
        out = ElementTree.SubElement(case, "system-out")
        out.text = _text(each.summary)
    ElementTree.indent(suite)
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{ElementTree.tostring(suite, encoding='unicode')}\n"


def _text(text: str) -> str:
    """The text without characters that XML does not allow."""
    return "".join(character if character.isprintable() else " " for character in text)


def gradescope_json(folder: GradeFolder, team_result: TeamResult) -> str:
    """A team's results.json: its success rate in percent as points out of 100, and the status."""
    score = 0.0 if team_result.score is None else team_result.score.value
    passed = team_result.status is TeamStatus.PASSED
    causes = [f"{number} of {team_result.runs} runs: {cause}" for cause, number in team_result.causes]
    clock = clocks_text(team_result.results)
    clocks = [f"clock: {clock}"] if clock else []
    board: list[dict[str, object]] = [{"name": "success rate", "value": round(score, 3)}]
    if team_result.time is not None:  # without a success there is no time, and 0 would be the best
        board.append({"name": "time, s", "value": round(team_result.time, 1), "order": "asc"})
    fields = {
        "score": round(100 * score, 1),
        "output": "\n".join((shown_test(folder.test), team_result.summary, *causes, *clocks)),
        "visibility": "visible",
        "stdout_visibility": "hidden",
        "tests": [
            {
                "name": f"success rate of {folder.course.require:g}",
                "status": "passed" if passed else "failed",
                "score": round(100 * score, 1),
                "max_score": 100,
                "output": team_result.summary,
            }
        ],
        "leaderboard": board,
    }
    return json_text(fields)
