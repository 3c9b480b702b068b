"""Answers of a grading of runs that never were, kept; and which of its files are."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec import structs

from simmer_tui.document.as_data import document_value, plain
from simmer_tui.errors import ConfigurationError
from simmer_tui.grade.cgroup import made_group
from simmer_tui.grade.course import read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.grade_run import GradeRun
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.site import grades_document, gradescope_json, junit_xml, site
from simmer_tui.grade.team_result import team_results
from simmer_tui.trials.run import TrialRun, fault_result
from simmer_tui.trials.trial import Ending
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_grades.json")
DECIDE = "[decide]\nrequire = 0.9\nmargin = 0.5\nrisk = 0.05\n[limits]\ntime = 7.0\nlogs = 0.004\n"


@pytest.fixture
def folder(make_course: Callable[..., Path], tmp_path: Path) -> GradeFolder:
    course = read_course(make_course({"a": "", "b": "", "c": "", "d": ""}, DECIDE))
    return GradeFolder.create(tmp_path / "out", course, 3, Isolation.NONE)


def fill(folder: GradeFolder, team: int, outcomes: str, commands: int = 9) -> None:
    """Give a team runs: s succeeds, anything else fails."""
    entry = folder.entries[team]
    for number, outcome in enumerate(outcomes, 1):
        result = fault_result(folder.trial(entry, number), "")
        ending = Ending.SUCCESS if outcome == "s" else Ending.CONTACTS
        fields: dict[str, object] = {
            "time": 10.0 + 1.5 * number + team,
            "contacts": number,
            "commands": commands,
        }
        fields |= {"success": outcome == "s", "ending": ending, "reason": "" if outcome == "s" else outcome}
        fields |= {"clock": "real" if number == 2 else "program", "start": (30.0, 42.0, 180.0)}
        folder.append(structs.replace(result, **fields))


def words(page: str) -> list[str]:
    """Texts of a page, without its style, its scripts and what the machine decides."""
    bare = re.sub(r"(?s)<(style|script|head)\b.*?</\1>", "", page)
    return [
        text
        for text in map(str.strip, re.split(r"<[^>]*>", bare))
        if text and "ingerprint" not in text and "1970" not in text
    ]


def test_pages_and_tables_of_a_grading_are_those_that_were_kept(folder: GradeFolder) -> None:
    fill(folder, 0, "sssss")
    fill(folder, 1, "xy", commands=0)
    fill(folder, 2, "sxs")
    results = team_results(folder, hidden=False)
    value = plain(document_value(grades_document(folder, results, "none")))
    value["text"].pop("mathematics", None)
    pages = site(folder, results, "none")
    found = {
        "grades": value,
        "pages": {name: words(pages[name]) for name in sorted(pages)},
        "junit": junit_xml(folder, results),
        "gradescope": [gradescope_json(folder, each) for each in results],
    }
    assert_kept(found, KEPT, "grading")


def test_logs_are_kept_until_the_share_of_a_team_is_used_up(folder: GradeFolder) -> None:
    """Four teams share 0.004 MB: 1000 bytes each."""
    entry = folder.entries[1]
    place = folder.runs / entry.team.slug
    place.mkdir()
    for number, size in ((1, 600), (2, 400), (3, 1)):
        folder.log(entry, number).write_bytes(bytes(size))
        folder.output(entry, number).touch()
        folder.append(fault_result(folder.trial(entry, number), ""))
        kept = number < 3
        assert (folder.log(entry, number).exists(), folder.output(entry, number).exists()) == (kept, kept)
    assert folder.log(entry, 1).exists()
    folder.output(entry, 3).write_bytes(bytes(2))  # a run that left nothing is no error, however full it is
    folder.append(fault_result(folder.trial(entry, 4), ""))
    assert sorted(entry.results) == [1, 2, 3, 4]


@pytest.mark.parametrize(("number", "success", "log", "output"), [(1, 1, 1, 0), (2, 1, 0, 0), (2, 0, 1, 1)])
def test_a_log_is_kept_of_a_failure_and_of_the_first_run(
    folder: GradeFolder, monkeypatch: pytest.MonkeyPatch, number: int, success: int, log: int, output: int
) -> None:
    entry = folder.entries[0]
    trial = folder.trial(entry, number)
    result = structs.replace(fault_result(trial, ""), success=bool(success))
    monkeypatch.setattr(TrialRun, "run", lambda self: result)
    made = GradeRun(trial, folder.runs)
    folder.log(entry, number).write_bytes(b"log")
    most = int(trial.limits.output * 1000)
    folder.output(entry, number).write_bytes(b"x" + b"y" * most)
    assert made.run() is result
    assert (folder.log(entry, number).exists(), folder.output(entry, number).exists()) == (
        bool(log),
        bool(output),
    )
    if output:
        assert folder.output(entry, number).read_bytes() == b"y" * most


def test_two_teams_with_one_name_are_one_mistake(make_course: Callable[..., Path]) -> None:
    file = make_course({"a": "", "b": ""}, '[[team]]\nname = "b"\nfolder = "teams/a"\n')
    with pytest.raises(ConfigurationError) as caught:
        read_course(file)
    assert str(caught.value).count("two teams have the name") == 1
    assert 'two teams have the name "b"' in str(caught.value)


def test_a_control_group_is_asked_for_from_the_inside_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The groups of a process are told by /proc; nothing above the mount of cgroup2 is touched."""
    mount = tmp_path / "mount"
    inner = mount / "a" / "b"
    inner.mkdir(parents=True)
    places = (inner, inner.parent, mount, tmp_path)
    for place in places:
        (place / "cgroup.subtree_control").touch()
    texts = {
        "/proc/self/mountinfo": f"1 0 0:1 / /x rw - ext4 y rw\n2 0 0:2 / {mount} rw - cgroup2 cgroup2 rw\n",
        "/proc/self/cgroup": "1:name=x:/y\n0::/a/b\n",
    }
    read = Path.read_text
    monkeypatch.setattr(Path, "read_text", lambda self, *given: texts.get(str(self)) or read(self, *given))
    assert made_group() is None
    said = [read(place / "cgroup.subtree_control") for place in places]
    assert said == ["+memory +pids +cpu"] * 3 + [""]
    assert not list(mount.rglob("simmer-*"))
