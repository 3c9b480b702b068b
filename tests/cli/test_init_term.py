"""The folder of a course that `init --term` writes: checked, graded, and each command of its files run."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path

import pytest
import yaml

from simmer_tui.cli.main import main
from simmer_tui.config.sets import bundled_folder, bundled_sets, find_mission_set
from simmer_tui.version import requirement
from tests.grade.conftest import read_grades
from tests.test_docs import BLOCK, blocks, done, place

__all__ = ["place"]  # a fixture

WORKFLOW = ".github/workflows/check.yml"


@pytest.fixture
def term(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    folder = tmp_path / "course"
    assert main(["init", str(folder), "--term"]) == 0
    capsys.readouterr()
    return folder


def test_all_of_a_course_is_written_and_its_check_passes(
    term: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    names = {path.relative_to(term).as_posix() for path in term.rglob("*") if path.is_file()}
    assert {"config/maze.csv", "config/mission.toml", "config/.schema/mission.json"} <= names
    assert {"samples/course/step7_mission.py", "samples/matlab/wander.m", "samples/c/simmer.h"} <= names
    assert {"README.md", "course.toml", "requirements.txt", ".gitignore", WORKFLOW} <= names
    assert {".devcontainer/devcontainer.json", "submission/main.py"} <= names
    assert main(["check", str(term)]) == 0
    said = capsys.readouterr().out
    assert "Mission" in said
    assert "Course: The robot course; a success rate of 0.9 passes" in said
    monkeypatch.chdir(term)
    assert main(["check"]) == 0, "as students do it, in the folder"
    assert "Course: The robot course" in capsys.readouterr().out


@pytest.mark.parametrize("words", [["--mission", "--no-ui", "--port", "0"], ["trials", "--runs", "1"]])
def test_missions_in_the_folder_are_those_of_its_set(
    words: list[str], term: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The edited mission.toml counts, without --config: its mistake ends the command."""
    monkeypatch.chdir(term)
    (term / "config" / "mission.toml").write_text('start = "nowhere"\n', "utf-8")
    assert main([*words, "--run", "python submission/main.py"]) == 2
    assert "mission.toml" in capsys.readouterr().err


def test_a_set_without_a_mission_leaves_missions_to_the_bundled_one(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder.parent)
    folder.rename("config")
    assert find_mission_set(None) == bundled_sets()["mission"]
    assert find_mission_set("config") == Path("config")


def test_nothing_is_overwritten(term: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path: path.read_bytes() for path in term.rglob("*") if path.is_file()}
    assert main(["init", str(term), "--term"]) == 2
    assert "nothing is overwritten" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in term.rglob("*") if path.is_file()} == before


def test_another_set_becomes_the_course_with_what_a_mission_needs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["init", str(tmp_path / "course"), "--term", "--from", "simmer-python"]) == 0
    assert main(["check", str(tmp_path / "course"), "--json"]) == 0
    assert 'nominal = "simmer-python"' in (tmp_path / "course/config/settings.toml").read_text("utf-8")
    assert "grip" in (tmp_path / "course/config/drive.csv").read_text("utf-8").lower()
    capsys.readouterr()


def test_a_mistake_in_the_grading_file_is_found(term: Path, capsys: pytest.CaptureFixture[str]) -> None:
    course = term / "course.toml"
    course.write_text(course.read_text("utf-8").replace("require = 0.9", "require = 90"), "utf-8")
    assert main(["check", str(term)]) == 2
    assert "course.toml" in capsys.readouterr().err


def test_the_simulator_is_named_in_one_place(term: Path) -> None:
    lines = (term / "requirements.txt").read_text("utf-8").splitlines()
    assert [line for line in lines if not line.startswith("#")] == [requirement()]
    installs = [
        path.relative_to(term).as_posix()
        for path in term.rglob("*")
        if path.is_file()
        and path.suffix in (".yml", ".json", ".md")
        and "pip install" in path.read_text("utf-8")
    ]
    assert sorted(installs) == [".devcontainer/devcontainer.json", WORKFLOW, "README.md"]
    for name in installs:
        found = re.findall(r"pip install ([^\"\n]*)", (term / name).read_text("utf-8"))
        assert found == ["-r requirements.txt"], name
    assert json.loads((term / ".devcontainer/devcontainer.json").read_text("utf-8"))["image"]


def test_links_of_the_page_for_students_lead_somewhere(term: Path) -> None:
    text = BLOCK.sub("", (term / "README.md").read_text("utf-8"))
    for target in re.findall(r"\]\(([^)]+)\)", text):
        assert target.startswith("https://") or (term / target).exists(), target


def hand_in(term: Path, step: str) -> None:
    """Make a step of the course, with those that it imports, the submission."""
    for path in (term / "samples/course").glob("*.py"):
        shutil.copy(path, term / "submission")
    (term / "submission" / step).replace(term / "submission/main.py")


def commands_of_the_workflow(term: Path) -> list[list[str]]:
    steps = yaml.safe_load((term / WORKFLOW).read_text("utf-8"))["jobs"]["check"]["steps"]
    lines = [step["run"] for step in steps if step.get("run", "").startswith("simmer-tui ")]
    return [shlex.split(line)[1:] for line in lines]


@pytest.mark.slow
@pytest.mark.parametrize(("step", "outcome"), [("step7_mission.py", "passed"), ("", "failed")])
def test_the_check_of_students_grades_their_program(
    term: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], step: str, outcome: str
) -> None:
    """The last step of the course passes, the sample that a submission begins as does not."""
    if step:
        hand_in(term, step)
    monkeypatch.chdir(term)
    check, grade = commands_of_the_workflow(term)
    assert main(check) == 0
    # The missions of a seed are always the same; a few of them decide here.
    few = ["--seed", "5", "--require", "0.7", "--margin", "0.5"]
    assert main([*grade, *few]) == (0 if outcome == "passed" else 1), capsys.readouterr().out
    assert read_grades(term / "grading")["submission"]["status"] == outcome
    assert (term / "grading/site/index.html").is_file()


@pytest.mark.slow
def test_the_page_for_students_runs(place: Path) -> None:
    """All but what needs a network or a terminal, and the grading that the workflow has too."""
    course = place / "course"
    assert main(["init", str(course), "--term"]) == 0
    hand_in(course, "step7_mission.py")
    lines = [line for _, text, _ in blocks(course / "README.md") for line in text.splitlines()]
    elsewhere = re.compile(r"python3 -m venv|pip install|simmer-tui +#|simmer-tui grade")
    run = [line for line in lines if not elsewhere.match(line)]
    assert len(run) == len(lines) - 4
    for line in run:
        done(["bash", "-euo", "pipefail", "-c", line], course)


def test_every_file_of_the_template_is_written(term: Path) -> None:
    folder = bundled_folder() / "term"
    for path in folder.rglob("*"):
        assert (term / path.relative_to(folder)).exists(), path
