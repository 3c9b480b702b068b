"""The pages of a large course with all that can happen to a team, kept; and which runs have pages."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec import structs

from simmer_tui.document.as_data import document_value, plain
from simmer_tui.grade import site as module
from simmer_tui.grade.course import read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.site import grades_document, gradescope_json, junit_xml, site
from simmer_tui.grade.team_result import last_failure, ranked, team_results
from simmer_tui.report.causes import Kind
from simmer_tui.trials.run import fault_result
from simmer_tui.trials.trial import Ending
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_site.json")
DECIDE = "[decide]\nrequire = 0.9\nmargin = 0.5\nrisk = 0.05\n"
"""Four successes pass, two failures fail."""
SILENT = [f"silent{number}" for number in range(7)]


@pytest.fixture
def folder(make_course: Callable[..., Path], tmp_path: Path) -> GradeFolder:
    names = [*SILENT, "fast", "slow", "wall", "crash", "refused", "begun", "new"]
    file = make_course(dict.fromkeys(names, ""), DECIDE)
    (tmp_path / "teams" / "refused").joinpath(*["deep"] * 41).mkdir(parents=True)
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 3, Isolation.NONE)
    for name in SILENT:
        fill(folder, name, "xx", commands=0)
    fill(folder, "slow", "ssss", time=31.26)
    fill(folder, "fast", "sxsssss", time=3.04)
    fill(folder, "wall", "xsxsxxx", contacts=2)
    fill(folder, "crash", "xx", verdict={"cause": {"kind": Kind.CRASHED.value, "text": "KeyError: <1>"}})
    fill(folder, "begun", "sx", clock="")
    return folder


def fill(folder: GradeFolder, name: str, outcomes: str, **fields: object) -> None:
    """Give a team runs: s succeeds, anything else fails. Each has a log and 7 lines of output."""
    entry = next(each for each in folder.entries if each.team.name == name)
    (folder.runs / entry.team.slug).mkdir()
    for number, outcome in enumerate(outcomes, 1):
        usual: dict[str, object] = {
            "time": 10.0 + number, "commands": 5, "contacts": number % 2, "clock": "program",
            "success": outcome == "s", "ending": Ending.SUCCESS if outcome == "s" else Ending.CONTACTS,
            "reason": "" if outcome == "s" else f"reason {number % 3}", "start": (30.0, 42.0, 180.0),
        }  # fmt: skip
        result = fault_result(folder.trial(entry, number), "")
        entry.results[number] = structs.replace(result, **(usual | fields))
        folder.log(entry, number).write_text(f"log {number}")
        folder.output(entry, number).write_text("".join(f"{number}: line {k}\n" for k in range(7)))


@pytest.fixture
def paged(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Runs of which pages are made: their logs and titles."""
    made: list[tuple[str, str]] = []

    def log_page(log: Path, name: str, *, commands: bool) -> str | None:
        assert not commands
        made.append((f"{log.parent.name}/{log.name}", name))
        return None if log.read_text() == "cut off" else "a page"

    monkeypatch.setattr(module, "log_page", log_page)
    return made


def words(page: str) -> list[str]:
    """Texts and links of a page, without its style, its scripts and what the machine decides."""
    bare = re.sub(r"(?s)<(style|script|head|svg)\b.*?</\1>", "", page)
    links = re.findall(r"href='([^']*)'", bare)
    said = [text for text in map(str.strip, re.split(r"<[^>]*>", bare)) if text]
    return [*links, *(text for text in said if "ingerprint" not in text)]


@pytest.mark.parametrize("hidden", [False, True])
def test_pages_of_a_course(folder: GradeFolder, paged: list[tuple[str, str]], hidden: bool) -> None:
    folder.hide_names(hidden=hidden)
    results = team_results(folder, hidden=hidden)
    pages = site(folder, results, "how they are isolated")
    shown = {
        name: words(pages[name]) for name in sorted(pages) if "silent" not in name and "-run-" not in name
    }
    if hidden:
        text = "".join(map(str, pages.values()))
        assert not any(name in text for name in (*SILENT, "line 6"))
        shown = {"index.html": shown["index.html"]}
    name = "hidden" if hidden else "shown"
    assert_kept({"pages": shown, "files": sorted(pages), "paged": paged[-12:]}, KEPT, name)
    grades = plain(document_value(grades_document(folder, results, "how")))
    assert_kept({"grades": grades["grades"], "answer": grades["text"]["answer"]}, KEPT, f"grades {name}")


def test_each_team_is_in_one_of_the_three_numbers(folder: GradeFolder, paged: list[tuple[str, str]]) -> None:
    said = words(site(folder, team_results(folder, hidden=False), "")["index.html"])
    numbers = {name: int(said[said.index(name) - 1]) for name in ("passed", "did not pass", "under way")}
    assert numbers == {"passed": 2, "did not pass": 10, "under way": 2}
    assert sum(numbers.values()) == len(folder.entries)


def test_files_for_other_programs(folder: GradeFolder) -> None:
    results = team_results(folder, hidden=False)
    assert_kept(junit_xml(folder, results), KEPT, "junit")
    assert_kept([gradescope_json(folder, each) for each in results[6:]], KEPT, "gradescope")
    assert_kept([each.label for each in ranked(results)], KEPT, "ranked")
    assert_kept([last_failure(each) for each in results], KEPT, "failures")


def test_three_failures_and_the_first_run_have_pages(
    make_course: Callable[..., Path], tmp_path: Path, paged: list[tuple[str, str]]
) -> None:
    """As far as their logs are kept, whole and not too large; a log that is cut off counts as one."""
    undecided = "[decide]\nrequire = 0.5\nmargin = 0.2\n"
    course = read_course(make_course({"wall": ""}, undecided))
    folder = GradeFolder.create(tmp_path / "out", course, 3, Isolation.NONE)
    fill(folder, "wall", "xsxsxxx")
    wall = folder.entries[0]

    def numbers() -> list[int]:
        paged.clear()
        pages = site(folder, team_results(folder, hidden=False), "")
        assert sum(name.startswith("wall-run-") for name in pages) <= len(paged)
        return [int(name.rpartition(" ")[2]) for _, name in paged if name.startswith("wall, run ")]

    assert numbers() == [1, 2, 3, 4, 5]
    folder.log(wall, 3).unlink()
    assert numbers() == [1, 2, 4, 5, 6]
    with folder.log(wall, 1).open("wb") as log:
        log.truncate(2_000_000)
    assert numbers() == [1, 2, 4, 5, 6]
    with folder.log(wall, 1).open("wb") as log:
        log.truncate(2_000_001)
    assert numbers() == [2, 4, 5, 6]
    folder.log(wall, 5).write_text("cut off")
    assert numbers() == [2, 4, 5, 6]


def test_output_that_is_not_there_is_no_error(folder: GradeFolder, paged: list[tuple[str, str]]) -> None:
    for path in (folder.runs / "silent0").iterdir():
        path.unlink()
    index = site(folder, team_results(folder, hidden=False), "")["index.html"]
    assert "silent0: last lines of its program" not in words(index)
    assert "silent1: last lines of its program" in words(index)
    assert re.search(r"<table class='[^']*sortable", index)  # by a click on a heading
