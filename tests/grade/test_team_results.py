"""The results of teams from results of runs that never were: score, order, codes, seeds, faults."""

from __future__ import annotations

import errno
import hashlib
import hmac
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec import structs

from simmer_tui.cli import grade_command
from simmer_tui.errors import GradeError
from simmer_tui.grade import grade_folder
from simmer_tui.grade.course import read_course
from simmer_tui.grade.grade_folder import Entry, GradeFolder
from simmer_tui.grade.grading import Grading
from simmer_tui.grade.limits import Limits
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.team_result import TeamStatus, code_of, last_failure, ranked, team_results
from simmer_tui.trials.run import fault_result
from simmer_tui.trials.trial import Ending, TrialResult

DECIDE = "[decide]\nrequire = 0.9\nmargin = 0.5\nrisk = 0.05\n[limits]\ntime = 7.0\n"
"""Four successes pass: (0.9 / 0.4)^4 > 0.95 / 0.05; two failures fail: (0.6 / 0.1)^2 > 19."""


@pytest.fixture
def folder(make_course: Callable[..., Path], tmp_path: Path) -> GradeFolder:
    course = read_course(make_course({"a": "", "b": "", "c": "", "d": ""}, DECIDE))
    return GradeFolder.create(tmp_path / "out", course, 3, Isolation.NONE)


def run(folder: GradeFolder, entry: Entry, number: int, **fields: object) -> TrialResult:
    result = fault_result(folder.trial(entry, number), "")
    return structs.replace(result, **{"success": True, "ending": Ending.SUCCESS, **fields})


def fill(folder: GradeFolder, name: str, outcomes: str, *, times: tuple[float, ...] = ()) -> Entry:
    """Give a team runs: s succeeds, anything else fails by contact."""
    entry = next(each for each in folder.entries if each.team.name == name)
    for number, outcome in enumerate(outcomes, 1):
        fields = {} if outcome == "s" else {"success": False, "ending": Ending.CONTACTS, "reason": outcome}
        time = times[number - 1] if times else 10.0
        folder.append(run(folder, entry, number, time=time, contacts=number, **fields))
    return entry


def test_score_is_that_of_the_runs_up_to_the_decision(folder: GradeFolder) -> None:
    fill(folder, "a", "ssssx", times=(5.0, 1.0, 2.0, 4.0, 9.0))
    fill(folder, "b", "xys")
    fill(folder, "c", "sxs", times=(5.0, 1.0, 2.0))
    for opened in (folder, GradeFolder.read(folder.path)):
        a, b, c, d = team_results(opened, hidden=False)
        assert [each.status for each in (a, b, c, d)] == [
            TeamStatus.PASSED, TeamStatus.FAILED, TeamStatus.UNDER_WAY, TeamStatus.UNDER_WAY,
        ]  # fmt: skip
        assert a.score is not None
        # No end is better than four successes at once, none worse than two failures at once.
        assert (a.score.value, a.score.high) == (1.0, 1.0)
        assert a.score.low == pytest.approx(0.025**0.25, rel=1e-9)
        assert b.score is not None
        assert (b.score.value, b.score.low) == (0.0, 0.0)
        assert b.score.high == pytest.approx(1 - 0.025**0.5, rel=1e-9)
        assert (c.score, d.score) == (None, None)
        assert [(each.runs, each.successes) for each in (a, b, c, d)] == [(4, 4), (2, 0), (3, 2), (0, 0)]
        assert (a.time, a.contacts) == (3.0, 2.5)
        assert (b.time, b.contacts) == (None, 1.5)
        assert (c.time, d.time, d.contacts) == (3.5, None, None)
        assert b.causes == [("x", 1), ("y", 1)]
        assert a.causes == []
        assert a.summary == f"success rate 1.000 ({0.025**0.25:.3f} to 1.000), 4 of 4 runs"
        assert c.summary == "2 of 3 runs so far"
        assert (last_failure(a), last_failure(b)) == ("", "y")
        assert [opened.is_open(each.entry) for each in (a, b, c, d)] == [False, False, True, True]


def test_best_comes_first_and_of_equals_the_faster(folder: GradeFolder) -> None:
    fill(folder, "a", "xx")
    fill(folder, "b", "ssss", times=(9.0,) * 4)
    fill(folder, "c", "ssss", times=(8.0,) * 4)
    fill(folder, "d", "sxsssss")
    assert [each.label for each in ranked(team_results(folder, hidden=False))] == ["c", "b", "d", "a"]


def test_team_without_a_decision_has_no_points_to_upload(
    folder: GradeFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An interrupted grading wrote "failed" and 0 points for a team that had no run yet."""

    def interrupted(*args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(grade_command, "grade", interrupted)
    fill(folder, "a", "xx")
    fill(folder, "b", "s")
    for words, teams in ((["--resume"], ["a"]), (["--regrade", "a"], [])):
        assert grade_command.run_grade([*words, "--out", str(folder.path)]) == 130
        assert [path.parent.name for path in folder.path.glob("gradescope/*/results.json")] == teams


def test_codes_and_seeds_tell_nothing_without_the_secret(folder: GradeFolder) -> None:
    """HMAC-SHA256 under the grading's seed: RFC 2104."""
    entry = folder.entries[1]
    digest = hmac.new(b"3", b"b", hashlib.sha256).hexdigest()
    assert code_of(folder, entry) == f"team {digest[:10]}"
    (shown,) = [each for each in team_results(folder, hidden=True) if each.entry is entry]
    assert (shown.label, shown.slug) == (f"team {digest[:10]}", f"team-{digest[:10]}")
    trial = folder.trial(entry, 5)
    seed = hmac.new(b"3", b"seed of run 5", hashlib.sha256).digest()[16:]
    assert trial.seed == int.from_bytes(seed) == folder.trial(folder.entries[0], 5).seed
    assert (trial.number, trial.repetition, trial.name) == (100_005, 5, "b/0005")
    assert trial.label == "run 5 of b"
    assert (trial.time_limit, trial.fixed_ports) == (7.0, False)


def test_fault_of_the_simulator_is_a_failure_only_when_it_comes_three_times(folder: GradeFolder) -> None:
    grading = Grading(folder)
    trials = grading.trials()
    first = next(trials)
    fault = fault_result(first, "it broke")
    for _ in range(2):
        grading.take(fault)
        assert folder.entries[0].results == {}
    assert (next(trials).number, next(trials).number) == (1, 100_001)
    grading.take(fault)
    assert folder.entries[0].results == {1: fault}


def test_a_team_has_no_more_runs_under_way_than_its_cap(folder: GradeFolder) -> None:
    given = list(Grading(folder).trials())
    assert len(given) == 4 * folder.test.cap
    assert {trial.repetition for trial in given} == set(range(1, folder.test.cap + 1))


def test_team_that_nobody_knows_is_not_graded_again(folder: GradeFolder) -> None:
    with pytest.raises(GradeError, match='there is no team "e" in this grading; there are a, b, c, d'):
        folder.regrade("e")
    fill(folder, "a", "xx")
    folder.regrade("a")
    assert folder.is_open(folder.entries[0])
    again = GradeFolder.read(folder.path)
    assert [entry.planned.attempt for entry in again.entries] == [2, 1, 1, 1]
    assert again.entries[0].results == {}


@pytest.mark.skipif(sys.platform == "win32", reason="there is no lock on Windows")
def test_nobody_changes_a_grading_that_runs(folder: GradeFolder) -> None:
    """Its runs read the files of the team, and its results are those of the plan that it has read."""
    other = GradeFolder.read(folder.path)
    changes = (lambda: other.regrade("a"), lambda: other.hide_names(hidden=True))
    before = {
        path: path.stat().st_mtime_ns for path in folder.path.rglob("*") if path.name != "results.jsonl"
    }
    with folder.store.locked():
        for change in changes:
            with pytest.raises(GradeError, match="another simmer-tui is adding results"):
                change()
    assert before == {path: path.stat().st_mtime_ns for path in before}
    for change in changes:
        change()


def test_a_change_does_not_undo_that_of_another_process(folder: GradeFolder) -> None:
    first, second = GradeFolder.read(folder.path), GradeFolder.read(folder.path)
    first.regrade("a")
    for change in (lambda: second.regrade("b"), lambda: second.hide_names(hidden=True)):
        with pytest.raises(
            GradeError, match="another simmer-tui has changed this grading meanwhile; try again"
        ):
            change()
    assert [each.planned.attempt for each in GradeFolder.read(folder.path).entries] == [2, 1, 1, 1]
    first.regrade("b")
    first.hide_names(hidden=True)
    assert GradeFolder.read(folder.path).plan.hides_names


def test_team_whose_files_are_not_copied_to_the_end_is_not_graded_by_the_rest(
    folder: GradeFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk was full, or the process was killed. Half of the new files were run as the old ones."""

    def full(source: Path, goal: Path, most_bytes: int) -> dict[str, str]:
        goal.mkdir(parents=True)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    fill(folder, "a", "x")
    with monkeypatch.context() as patched:
        patched.setattr(grade_folder, "copy_submission", full)
        with pytest.raises(GradeError, match="cannot be written"):
            folder.regrade("a")
    again = GradeFolder.read(folder.path)
    assert not again.is_open(again.entries[0])
    assert team_results(again, hidden=False)[0].summary == (
        "files: were not copied to the end: grade this team again with --regrade"
    )
    again.regrade("a")
    assert again.is_open(again.entries[0])


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('"seed": 3', '"seed": -3', r"Expected `int` >= 0 - at `\$\.seed`"),
        ('"isolation": "none"', '"isolation": "bag"', "Invalid enum value 'bag'"),
        ('"margin": 0.5', '"margin": "0.5"', r"Expected `float`, got `str` - at `\$\.course\.margin`"),
        ('"memory": 2000.0', '"memory": [1]', r"at `\$\.course\.limits\.memory`"),
        ('"attempt": 1', '"attempt": null', r"at `\$\.teams\[0\]\.attempt`"),
        ('"format": 3', '"format": 2', "the format is not 3"),
    ],
)
def test_grading_with_a_wrong_value_is_one_error(folder: GradeFolder, old: str, new: str, why: str) -> None:
    text = (folder.path / "grade.json").read_text()
    assert old in text
    (folder.path / "grade.json").write_text(text.replace(old, new, 1))
    with pytest.raises(GradeError, match=rf"grade\.json: .*{why}"):
        GradeFolder.read(folder.path)


def test_limits_of_a_process_are_in_the_units_of_the_kernel() -> None:
    limits = Limits(cpu=0.4, memory=1.5, disk=2.0, processes=7)
    assert limits.resources() == {
        "CPU": 1, "AS": 1_500_000, "NPROC": 7, "FSIZE": 2_000_000, "NOFILE": 256, "CORE": 0,
    }  # fmt: skip
    assert Limits().resources()["CPU"] == 120
