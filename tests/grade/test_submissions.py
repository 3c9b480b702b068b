"""Submissions as the grader takes them: a snapshot of plain files, read within limits."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from simmer_tui.cli.grade_command import run_grade
from simmer_tui.document.as_data import json_text
from simmer_tui.errors import ConfigurationError, GradeError
from simmer_tui.grade import submission_copy
from simmer_tui.grade.course import not_teams, read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.site import grades_document, site
from simmer_tui.grade.submission_copy import copy_submission
from simmer_tui.grade.submission_folder import folder_of_program
from simmer_tui.grade.team_result import team_results
from simmer_tui.trials.cluster import pack
from tests.grade.conftest import read_grades

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="links are a privilege there")

REMEDY = "submit a plain file or folder"


def content(folder: Path) -> dict[str, str]:
    """The files below a folder by relative path."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_text() for path in files}


@pytest.fixture
def handed_in(tmp_path: Path) -> Path:
    folder = tmp_path / "handed-in"
    (folder / "lib").mkdir(parents=True)
    (folder / "main.py").write_text("go")
    (folder / "lib" / "a.py").write_text("a")
    return folder


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    folder = tmp_path / "secrets"
    folder.mkdir()
    (folder / "a.py").write_text("only the grader may read this")
    return folder


def test_copy_is_of_plain_files(handed_in: Path, secret: Path, tmp_path: Path) -> None:
    (handed_in / "main.py").chmod(0o700)
    (handed_in / "link.py").symlink_to(secret / "a.py")
    (handed_in / "folder").symlink_to(secret)
    os.mkfifo(handed_in / "pipe")
    for cache in ("__pycache__", ".git"):
        (handed_in / cache).mkdir()
        (handed_in / cache / "x").write_text("x")
    left_out = copy_submission(handed_in, tmp_path / "copy", 100)
    assert {name: left_out[name] for name in sorted(left_out)} == {
        "folder": "is a symbolic link",
        "link.py": "is a symbolic link",
        "pipe": "is a pipe",
    }
    assert content(tmp_path / "copy") == {"main.py": "go", "lib/a.py": "a"}
    modes = {
        name: (tmp_path / "copy" / name).stat().st_mode & 0o777 for name in ("main.py", "lib/a.py", "lib")
    }
    assert modes == {"main.py": 0o755, "lib/a.py": 0o644, "lib": 0o755}


@pytest.mark.parametrize("kind", ["a symbolic link", "a pipe", "a link above it"])
def test_a_program_that_is_not_copied_is_refused_with_the_reason(
    make_course: Callable[..., Path], secret: Path, tmp_path: Path, kind: str
) -> None:
    file = make_course(
        {"a": "", "b": ""}, '[[team]]\nname = "c"\nfolder = "c"\ncommand = "python ./src/a.py"\n'
    )
    program = tmp_path / "teams" / "a" / "main.py"
    program.unlink()
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "src").mkdir()
    (tmp_path / "c" / "src" / "a.py").touch()
    if kind == "a symbolic link":
        program.symlink_to(secret / "a.py")
    elif kind == "a pipe":
        os.mkfifo(program)
    else:
        program.touch()
        shutil.rmtree(tmp_path / "c" / "src")
        (tmp_path / "c" / "src").symlink_to(secret)
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 3, Isolation.NONE)
    found = {entry.team.name: [*map(str, entry.problems)] for entry in folder.entries if entry.problems}
    refused, team = ("src", "c") if kind == "a link above it" else ("main.py", "a")
    what = "a pipe" if kind == "a pipe" else "a symbolic link"
    assert found == {
        team: [f"files: {refused} is {what}, which is not copied: submit a plain file or folder"]
    }


@pytest.mark.parametrize("name", ["team.toml", "config", "Main.m"])
def test_a_robot_that_is_not_copied_is_refused_with_the_reason(
    make_course: Callable[..., Path], secret: Path, tmp_path: Path, name: str
) -> None:
    """The team would be graded with the course's robot, or command, without a word."""
    file = make_course({"a": "", "b": ""})
    (tmp_path / "teams" / "a" / name).symlink_to(secret)
    (tmp_path / "teams" / "b" / "data").symlink_to(secret)
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 3, Isolation.NONE)
    found = [[*map(str, entry.problems)] for entry in folder.entries]
    assert found == [[f"files: {name} is a symbolic link, which is not copied: {REMEDY}"], []]


def test_each_file_that_is_not_copied_is_named_with_the_reason(
    make_course: Callable[..., Path], tmp_path: Path
) -> None:
    """A program that needs it would fail without a word."""
    file = make_course({"a": "", "b": "", "c": ""})
    one, many = tmp_path / "teams" / "a", tmp_path / "teams" / "b"
    (one / "common.py").touch()
    (one / "helpers.py").symlink_to("common.py")
    for number in range(9):
        (many / f"{number}.py").symlink_to("main.py")
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 3, Isolation.NONE)
    assert not any(entry.problems for entry in folder.entries)
    names = ", ".join(f"{number}.py is a symbolic link" for number in range(5))
    expected = ["a: helpers.py is a symbolic link", f"b: {names}, and 4 more"]
    folder = GradeFolder.read(tmp_path / "out")
    results = team_results(folder, hidden=False)
    answer = grades_document(folder, results, "")
    assert json.loads(json_text(answer))["text"]["not_copied"] == expected
    pages = site(folder, results, "")
    assert [name for name in sorted(pages) if "helpers.py is a symbolic link" in pages[name]] == [
        "a.html",
        "index.html",
    ]
    folder.hide_names(hidden=True)  # a path may have the name of its team
    hidden = site(folder, team_results(folder, hidden=True), "")
    assert not any("helpers.py" in page for page in hidden.values())


@pytest.mark.parametrize("swapped", ["main.py", "lib"])
@pytest.mark.parametrize("by", ["a link", "a pipe"])
def test_what_is_swapped_in_the_last_moment_is_not_followed(
    handed_in: Path, secret: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, swapped: str, by: str
) -> None:
    """The name is looked at first; another thing bears it when it is opened."""
    really_open, swapped_out = os.open, tmp_path / "swapped-out"

    def swap_and_open(path: os.PathLike[str] | str, *rest: int, **more: int | None) -> int:
        target = handed_in / swapped
        if Path(path).name == swapped and not swapped_out.exists():
            target.rename(swapped_out)
            if by == "a pipe":
                os.mkfifo(target)
            else:
                target.symlink_to(secret if swapped == "lib" else secret / "a.py")
        return really_open(path, *rest, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(os, "open", swap_and_open)
    with pytest.raises(GradeError, match=swapped):
        copy_submission(handed_in, tmp_path / "copy", 100)
    monkeypatch.undo()
    assert not any("grader" in text for text in content(tmp_path / "copy").values())


def test_folder_that_becomes_a_link_is_not_followed(handed_in: Path, secret: Path, tmp_path: Path) -> None:
    (tmp_path / "team").symlink_to(secret)
    with pytest.raises(GradeError, match="its folder"):
        copy_submission(tmp_path / "team", tmp_path / "copy", 100)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="changes owners")
def test_other_name_of_another_users_file_is_not_taken(handed_in: Path, secret: Path, tmp_path: Path) -> None:
    (handed_in / "main.py").unlink()
    os.link(secret / "a.py", handed_in / "main.py")
    for path in (handed_in, handed_in / "lib", handed_in / "lib" / "a.py"):
        os.chown(path, 12345, 12345)
    left_out = copy_submission(handed_in, tmp_path / "copy", 100)
    assert left_out == {"main.py": "is another user's file under a second name"}
    assert content(tmp_path / "copy") == {"lib/a.py": "a"}


def test_too_much_is_refused(handed_in: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    limits = submission_copy.MOST_FILES, submission_copy._MOST_ENTRIES
    assert limits == (2000, 20_000)
    # Thousands of files take seconds to make; the limits are the same in kind.
    monkeypatch.setattr(submission_copy, "MOST_FILES", 20)
    monkeypatch.setattr(submission_copy, "_MOST_ENTRIES", 200)
    with pytest.raises(GradeError, match="more than 2e-06 MB"):
        copy_submission(handed_in, tmp_path / "bytes", 2)
    deep = handed_in
    for _ in range(60):
        deep = deep / "d"
    deep.mkdir(parents=True)
    with pytest.raises(GradeError, match="more than 40 deep"):
        copy_submission(handed_in, tmp_path / "deep", 100)
    shutil.rmtree(handed_in / "d")
    for number in range(20):
        (handed_in / str(number)).touch()
    with pytest.raises(GradeError, match="or 20 files"):
        copy_submission(handed_in, tmp_path / "many", 100)
    for number in range(200 - 20):
        (handed_in / f"link{number}").symlink_to("nowhere")
    with pytest.raises(GradeError, match="more than 200 files, folders and links"):
        copy_submission(handed_in, tmp_path / "links", 100)


def test_team_is_graded_as_it_was_when_it_was_copied(
    make_course: Callable[..., Path], tmp_path: Path
) -> None:
    file = make_course({"a": "1"})
    own = tmp_path / "teams" / "a"
    (own / "team.toml").write_text('command = "./one"\n')
    GradeFolder.create(tmp_path / "out", read_course(file), 5, Isolation.NONE)
    (own / "team.toml").write_text('command = "./two"\n')
    (own / "main.py").write_text("2")
    (team,) = [entry.team for entry in GradeFolder.read(tmp_path / "out").entries]
    assert team.command == "./one"
    kept = content(tmp_path / "out" / "teams" / "a" / "program")
    assert kept == {"main.py": "1", "team.toml": 'command = "./one"\n'}


@pytest.mark.slow
@pytest.mark.parametrize("sort", ["time", "memory"])
def test_file_that_takes_for_ever_is_its_teams_mistake(
    make_course: Callable[..., Path], tmp_path: Path, sort: str
) -> None:
    """A key of 30,000 parts takes 20 s; a table of a million cells takes gigabytes."""
    file = make_course({"bad": "", "good": ""}, "[decide]\ncap = 1\nmargin = 0.5\n")
    bad, good = (tmp_path / "teams" / name for name in ("bad", "good"))
    if sort == "time":
        (bad / "team.toml").write_text(f"{'a.' * 30_000}a = 1\n")
    else:
        shutil.copytree(tmp_path / "set", bad / "config")
        (bad / "config" / "sensors.csv").write_text("ID\n" + "," * 60_000_000)
    (good / "team.toml").write_text('command = "./nothing"\n')
    assert run_grade([str(file), "--out", str(tmp_path / "out"), "--isolation", "none"]) == 1
    rows = read_grades(tmp_path / "out")
    assert {name: row["status"] for name, row in rows.items()} == {"bad": "refused", "good": "failed"}
    assert "files" in rows["bad"]["problem"]


LEFTOVERS = (
    "__MACOSX/._main.py",
    ".DS_Store",
    "._main.py",
    "src/__pycache__/x.pyc",
    "Thumbs.db",
    "desktop.ini",
    "main.py~",
    ".main.py.swp",
    "#main.py#",
    "~$report.docx",
    ".idea/x.xml",
    ".git/config",
    "$RECYCLE.BIN/x",
)


def write_files(folder: Path, names: Iterable[str]) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("x")


def test_leftovers_are_neither_copied_nor_packed(tmp_path: Path) -> None:
    environments = ("venv/bin/python", ".venv/x", "node_modules/a.js", "mine/pyvenv.cfg", "mine/lib/a.py")
    write_files(tmp_path / "in", ["main.py", "src/a.py", *LEFTOVERS, *environments])
    left_out = copy_submission(tmp_path / "in", tmp_path / "copy", 100)
    assert content(tmp_path / "copy").keys() == {"main.py", "src/a.py"}
    assert left_out == dict.fromkeys((".venv", "mine", "node_modules", "venv"), "is a virtual environment")
    assert pack("python main.py", tmp_path / "in").files.keys() == {"main.py", "src/a.py"}


def test_leftovers_beside_the_teams_are_no_teams(make_course: Callable[..., Path], tmp_path: Path) -> None:
    file = make_course({"a": "", "b": ""})
    beside = ("Thumbs.db", "._a.zip", "~$a.zip", "venv/x", "node_modules/x", "System Volume Information/x")
    write_files(
        tmp_path / "teams", [*LEFTOVERS[:3], *beside, "__pycache__/x", "lost+found/x", "a/pyvenv.cfg"]
    )
    course = read_course(file)
    assert [team.name for team in course.teams] == ["a", "b"]
    assert not_teams(course) == []


def test_the_folder_that_is_too_large_is_named(tmp_path: Path) -> None:
    names = [f"data/runs/{number}.txt" for number in range(submission_copy.MOST_FILES)]
    write_files(tmp_path / "many", ["main.py", *names])
    with pytest.raises(GradeError, match=r"2000 files, most of them in data/runs: leave it out$"):
        copy_submission(tmp_path / "many", tmp_path / "copy", 10_000)
    write_files(tmp_path / "big", ["main.py", "data/a/1", "data/b/1"])
    (tmp_path / "big" / "data" / "b" / "1").write_text("x" * 99)
    with pytest.raises(GradeError, match=r"2000 files, most of them in data/b: leave it out$"):
        copy_submission(tmp_path / "big", tmp_path / "goal", 50)


@pytest.mark.parametrize(
    ("files", "command", "taken"),
    [
        (["ada/main.py", "ada/lib/a.py"], "python main.py", "ada"),
        (["ada/ada/main.py"], "python main.py", "ada/ada"),  # packed twice
        (["main/main.py"], "python main.py", "main"),
        (["python/main.py"], "python main.py", "python"),
        (["ada/Main.java"], "java Main", "ada"),
        (["src/team.toml", "src/src/a.py"], "python src/a.py", "src"),
        (["src/main.py"], "python src/main.py", "."),  # as the course asks
        (["robot/__main__.py"], "python -m robot", "."),
        (["robot/main.py"], "python -m robot.main", "."),
        (["src/main.m"], """matlab -batch "run('src/main.m')" """, "."),
        (["ada/main.py"], "sh -c 'python */main.py'", "."),
        (["ada/main.py", "notes.txt"], "python main.py", "."),
        (["main.py"], "python main.py", "."),
        ([], "python main.py", "."),
    ],
)
def test_a_folder_that_was_packed_whole_is_the_submission(
    tmp_path: Path, files: list[str], command: str, taken: str
) -> None:
    """Finder and Explorer pack a folder with its name, so that all files are one folder deeper."""
    for name in files:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert folder_of_program(tmp_path, command, ["team.toml"], {}).as_posix() == taken


def test_packed_submissions_are_taken_or_refused_with_the_way(
    make_course: Callable[..., Path], tmp_path: Path
) -> None:
    file = make_course({"a": "", "b": "", "c": "", "d": "", "e": "", "f": ""})
    teams = tmp_path / "teams"
    for name in "abcdef":
        (teams / name / "main.py").unlink()
    for name in "abd":
        (teams / name / "mine").mkdir()
        (teams / name / "mine" / "main.py").write_text(name)
    (teams / "a" / "__MACOSX").mkdir()
    (teams / "a" / "mine" / "link.py").symlink_to("main.py")
    (teams / "b" / "main.py").symlink_to("mine/main.py")
    (teams / "c" / "mine.zip").touch()
    (teams / "d" / "report.pdf").touch()
    (teams / "f" / "Main.py").touch()
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 3, Isolation.NONE)
    assert {each.team.name: [*map(str, each.problems)] for each in folder.entries} == {
        "a": [],
        "b": [f"files: main.py is a symbolic link, which is not copied: {REMEDY}"],
        "c": ["files: mine.zip is an archive, which is not unpacked: submit what is in it"],
        "d": ["files: main.py is not there, but mine/main.py is: submit what is in the folder mine"],
        "e": [],
        "f": ["files: main.py is not there, but Main.py is: write its name in the same letters"],
    }
    first = folder.entries[0]
    assert content(tmp_path / "out" / "teams" / first.team.slug / "program") == {"main.py": "a"}
    assert first.planned.not_copied == ("link.py is a symbolic link",)


@pytest.mark.parametrize("word", ["../../secrets/a.py", "/bin/sh", "x" * 300, "", "a\0b", "'"])
def test_a_command_of_a_team_asks_for_nothing_outside_its_folder(
    make_course: Callable[..., Path], secret: Path, tmp_path: Path, word: str
) -> None:
    file = make_course({"a": ""})
    (tmp_path / "teams" / "a" / "lib").mkdir()
    (tmp_path / "teams" / "a" / "lib" / "a.py").touch()
    (tmp_path / "teams" / "a" / "team.toml").write_text(f"command = {json.dumps('python ' + word)}")
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 3, Isolation.NONE)
    assert folder.entries[0].planned.refused == ""


@pytest.mark.skipif(os.sep == "\\", reason="there such a name is a path")
def test_names_that_are_paths_of_windows_are_told(tmp_path: Path) -> None:
    (tmp_path / "ada\\main.py").touch()
    with pytest.raises(
        ConfigurationError, match=r"is a path of Windows; unpack the archive again, with unzip"
    ):
        read_course(tmp_path)


def test_archives_in_place_of_a_course_or_its_teams_are_named(tmp_path: Path) -> None:
    (tmp_path / "ada.zip").write_bytes(b"PK\3\4\xff")
    unpack = "unpack each into a folder with its name, such as: unzip ada.zip -d ada"
    for target, what in ((tmp_path, "the teams are in archives"), (tmp_path / "ada.zip", "is an archive")):
        with pytest.raises(ConfigurationError) as caught:
            read_course(target)
        assert [each.what for each in caught.value.problems] == [f"{what}; {unpack}"]
