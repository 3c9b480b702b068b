"""The answer for other programs: JUnit XML, and Gradescope's results.json."""

from __future__ import annotations

from xml.etree import ElementTree

from simmer_tui.document.as_json import json_text
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.team_result import TeamResult, TeamStatus, last_failure
from simmer_tui.trials.sequential import shown_test


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
