"""Texts of teams and courses are cut in messages and answers: each place has its length."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec import structs

from simmer_tui.config.loader import find_set, load
from simmer_tui.document.model import Bullets
from simmer_tui.errors import ConfigurationError, GradeError, PortError, Problem
from simmer_tui.grade import site as module
from simmer_tui.grade.course import Rules, Team, read_course
from simmer_tui.grade.grade_folder import GradeFolder, PlannedTeam
from simmer_tui.grade.grade_run import GradeRun
from simmer_tui.grade.robot_rules import rule_problems
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.site import grades_document, site
from simmer_tui.grade.submission_copy import copy_submission
from simmer_tui.grade.team_result import last_failure, team_results
from simmer_tui.trials.run import TrialRun, fault_result
from simmer_tui.trials.trial import Ending, TrialResult

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="paths are shorter there")

X = "x" * 900


def lengths(text: object) -> list[int]:
    """Lengths of all texts in which x stands for what is long, with the dots of what is cut off."""
    return [len(each) for each in re.findall(r"x{8,}(?:\.\.\.)?", str(text))]


def mistakes(file: Path) -> str:
    with pytest.raises(ConfigurationError) as caught:
        read_course(file)
    return "\n".join(map(str, caught.value.problems))


def test_names_in_a_course_are_cut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    long = Path("x" * 250)
    assert lengths(mistakes(long)) == [200]
    (tmp_path / "a").mkdir()
    file = tmp_path / "course.toml"
    file.write_text(f'teams = "{"x" * 250}"\n')
    assert len(mistakes(Path("course.toml")).removesuffix(": is not a folder")) == 200
    file.write_text(f'[[team]]\nfolder = "{"x" * 250}"\n')
    assert lengths(mistakes(file)) == [100]
    team = f'[[team]]\nname = "{"x" * 250}"\nfolder = "a"\n'
    file.write_text(team + team)
    assert lengths(mistakes(file)) == [60]


def test_cells_are_cut() -> None:
    course = load(find_set("mission"))
    robot, table = f"{X},1\n", f"ID,{X}\nultra1,1\n{'x' * 90},2\n"
    team = structs.replace(course, files={**course.files, "robot.csv": robot, "drive.csv": table})
    base = structs.replace(course, files={**course.files, "robot.csv": robot[:-2] + "2", "drive.csv": "ID\n"})
    found = rule_problems(Rules(cells={"robot.csv": (), "drive.csv": ()}), base, team)
    assert [lengths(each) for each in found] == [[60], [40], [30, 40]]


def test_names_in_a_copy_are_cut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import os

    source = tmp_path / "from"
    (source / ("x" * 240)).mkdir(parents=True)
    opened = os.open

    def refused(path: str | Path, *given: int, **more: int | None) -> int:
        if "xxx" in str(path):
            raise PermissionError(13, "Permission denied")
        return opened(path, *given, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(os, "open", refused)
    with pytest.raises(GradeError) as caught:
        copy_submission(source, tmp_path / "to", 10)
    assert lengths(caught.value) == [200]
    monkeypatch.undo()
    listed = os.scandir

    def unlisted(place: int) -> object:
        if not os.listdir(place):
            raise PermissionError(13, "Permission denied")
        return listed(place)

    monkeypatch.setattr(os, "scandir", unlisted)
    with pytest.raises(GradeError) as caught:
        copy_submission(source, tmp_path / "again", 10)
    assert lengths(caught.value) == [200]


@pytest.fixture
def folder(make_course: Callable[..., Path], tmp_path: Path) -> GradeFolder:
    file = make_course({"x" * 90: "", "b": ""}, "[decide]\nrequire = 0.9\nmargin = 0.5\n")
    return GradeFolder.create(tmp_path / "out", read_course(file), 3, Isolation.NONE)


def failed(folder: GradeFolder, number: int, **fields: object) -> TrialResult:
    entry = next(each for each in folder.entries if each.team.name == "b")
    result = structs.replace(fault_result(folder.trial(entry, number), ""), ending=Ending.CONTACTS)
    entry.results[number] = structs.replace(result, **fields)
    return entry.results[number]


def test_names_in_a_grading_are_cut(folder: GradeFolder) -> None:
    with pytest.raises(GradeError) as caught:
        folder.regrade(X)
    assert lengths(caught.value) == [60, 40]
    long = next(each for each in folder.entries if each.team.name != "b")
    gone = Team(long.team.name, Path("x" * 250), "")
    long.planned = PlannedTeam(gone)
    with pytest.raises(GradeError) as caught:
        folder.regrade(long.team.name)
    assert lengths(caught.value) == [200]


def test_results_of_teams_are_cut(folder: GradeFolder) -> None:
    long = next(each for each in folder.entries if each.team.name != "b")
    problems = (Problem("a", X), Problem("b", X))
    long.planned = PlannedTeam(Team(long.team.name, Path(), "", problems=problems))
    failed(folder, 1, reason=X)
    failed(folder, 2, reason=X, verdict={"text": X}, clock="real", clock_note=X)
    b, refused = team_results(folder, hidden=False)
    assert (lengths(refused.label), lengths(refused.said)) == ([60], [297, 297])
    assert (lengths([cause for cause, _ in b.causes]), lengths(last_failure(b))) == ([200], [300])
    document = grades_document(folder, [b, refused], "how")
    notes = [str(part.text) for part in document.parts if getattr(part, "key", "") == "computing"]
    assert [len(each) for each in notes if "x" * 99 in each] == [600]


def test_the_most_frequent_five_causes_are_shown(make_course: Callable[..., Path], tmp_path: Path) -> None:
    file = make_course({"b": ""}, "[decide]\nrequire = 0.5\nmargin = 0.2\n")
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 3, Isolation.NONE)
    for number, reason in enumerate("abcdefa", 1):
        failed(folder, number, reason=reason)
    (result,) = team_results(folder, hidden=False)
    assert result.causes == [("a", 2), *((each, 1) for each in "bcde")]


def test_lines_of_a_program_are_cut(folder: GradeFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = next(each for each in folder.entries if each.team.name == "b")
    failed(folder, 1, commands=0)
    failed(folder, 2, commands=0)
    (folder.runs / "b").mkdir()
    folder.output(entry, 2).write_text(f"{X}\n")
    shown: list[Bullets] = []
    monkeypatch.setattr(
        module,
        "html_page",
        lambda document: shown.extend(p for p in document.parts if isinstance(p, Bullets)),
    )
    site(folder, team_results(folder, hidden=False), "")
    (lines,) = shown
    assert [len(str(each)) for each in lines.entries] == [200]


def test_the_reason_why_a_run_could_not_be_done_is_cut(
    folder: GradeFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: TrialRun) -> TrialResult:
        raise PortError(X)

    monkeypatch.setattr(TrialRun, "run", fail)
    result = GradeRun(folder.trial(folder.entries[0], 1), folder.runs).run()
    assert (lengths(result.reason), result.ending, result.success) == ([300], Ending.EXIT, False)
