"""Files of a course and its teams: the least and the largest values, what is found where, what is copied."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from simmer_tui.cli.grade_command import run_grade
from simmer_tui.config.loader import load
from simmer_tui.config.sets import find_set
from simmer_tui.errors import ConfigurationError, GradeError
from simmer_tui.grade import submission_copy
from simmer_tui.grade.course import Course, Rules, Team, not_teams, read_course, shown_name, submitted_team
from simmer_tui.grade.limits import Limits
from simmer_tui.grade.submission import check_submission, reference
from simmer_tui.grade.submission_copy import copy_submission

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="links are a privilege there")


def problems_of(file: Path, alone: bool = False) -> list[str]:
    with pytest.raises(ConfigurationError) as caught:
        read_course(file, alone=alone)
    return [*map(str, caught.value.problems)]


@pytest.fixture
def teams(tmp_path: Path) -> Path:
    """A folder with two teams."""
    for name in ("a", "b"):
        (tmp_path / "teams" / name).mkdir(parents=True)
    return tmp_path / "teams"


def test_a_course_has_what_its_file_says(teams: Path, tmp_path: Path) -> None:
    file, tools = tmp_path / "course.toml", tmp_path / "tools"
    tools.mkdir()
    file.write_text(
        'name = "A course"\nset = "mission"\ncommand = "./run"\nimage = "an image"\n'
        f'read_only = ["{tools}", "tools"]\ndialects = true\nwheels = true\n'
        "[decide]\nrequire = 0.8\nmargin = 0.2\nrisk = 0.1\ncap = 70\n"
        "[limits]\ntime = 1\ncpu = 2\nmemory = 3\nprocesses = 4\ndisk = 5\noutput = 6\nlogs = 7\n"
        '[rules]\nsensors = 3\nsize = 8.5\n[rules.cells]\n"robot.csv" = ["Shape"]\n'
        '[[team]]\nname = "named"\nfolder = "teams/a"\ncommand = "./other"\nconfig = "robot"\n'
        '[[team]]\nfolder = "teams/b"\n'
    )
    assert read_course(file) == Course(
        name="A course",
        directory=find_set("mission"),
        command="./run",
        require=0.8,
        margin=0.2,
        risk=0.1,
        cap=70,
        limits=Limits(time=1.0, cpu=2.0, memory=3.0, processes=4, disk=5.0, output=6.0, logs=7.0),
        rules=Rules(sensors=3, size=8.5, cells={"robot.csv": ("Shape",)}, dialects=True, wheels=True),
        read_only=(str(tools), str(tools)),
        image="an image",
        teams=(
            Team("named", teams / "a", "./other", "robot", {"command": "./other", "config": "robot"}),
            Team("b", teams / "b", "./run"),
        ),
    )


def test_a_course_without_a_file_has_the_usual_values(teams: Path) -> None:
    command = "python main.py"
    made = [Team(name, teams / name, command) for name in ("a", "b")]
    assert read_course(teams) == Course(
        name="teams",
        directory=find_set("mission"),
        command=command,
        require=0.9,
        margin=0.15,
        risk=0.05,
        cap=None,
        teams=(*made,),
        team_folders=(teams,),
    )
    alone = read_course(teams, alone=True)
    assert alone.teams == (Team("teams", teams, command),)
    assert alone.team_folders == ()
    both = read_course(teams)
    assert (both.require, both.margin, both.risk, both.cap) == (0.9, 0.15, 0.05, None)
    assert both.limits == Limits(
        time=120.0, cpu=120.0, memory=2000.0, processes=64, disk=64.0, output=20.0, logs=400.0
    )
    assert both.rules == Rules(None, None, {}, False, False)
    assert (both.read_only, both.image, both.clock) == ((), "", "")


DECIDE = ("decide.require", "decide.margin", "decide.risk", "decide.cap", "rules.sensors", "rules.size")


def text_of(*values: object) -> str:
    """A course's file with these values."""
    return "".join(f"{name} = {value}\n" for name, value in zip(DECIDE, values, strict=False))


LEAST = text_of(1e-9, 1e-9, 1e-9, 1, 0, 1e-9)
LARGEST = text_of(1, 1, 0.4999, 5000, 1000, 1e9)
BELOW = text_of(0, 0, 0, 0, -1, 0)
ABOVE = text_of(1.01, 1.01, 0.5, 5001, 1001)
NAMES = ("time", "cpu", "memory", "disk", "output", "logs")


@pytest.mark.parametrize("limit", [1e-9, 1e6])
@pytest.mark.parametrize("values", [LEAST, LARGEST], ids=["least", "largest"])
def test_values_may_be_as_small_and_as_large(teams: Path, values: str, limit: float) -> None:
    limits = "".join(f"limits.{name} = {limit}\n" for name in NAMES)
    limits += f"limits.processes = {1 if limit < 1 else 10_000}\n"
    (teams / "course.toml").write_text(values + limits)
    course = read_course(teams)
    assert course.limits.logs == limit
    assert course.cap == (1 if values == LEAST else 5000)


@pytest.mark.parametrize(("values", "limit"), [(BELOW, 0), (ABOVE, 1_000_001)], ids=["below", "above"])
def test_values_beyond_are_mistakes_with_their_lines(teams: Path, values: str, limit: int) -> None:
    limits = "".join(f"limits.{name} = {limit}\n" for name in NAMES)
    limits += f"limits.processes = {0 if limit == 0 else 10_001}\n"
    text = values + limits
    (teams / "course.toml").write_text(text)
    allowed = {
        "require": "a number above 0 and at most 1",
        "margin": "a number above 0 and at most 1",
        "risk": "a number above 0 and below 0.5",
        "cap": "a whole number from 1 to 5000",
        "sensors": "a whole number from 0 to 1000",
        "size": "a number above 0",
        "processes": "a whole number from 1 to 10000",
    }
    expected = []
    for place, line in enumerate(text.splitlines(), 1):
        name, _, value = line.partition(" = ")
        what = allowed.get(name.partition(".")[2], "a number above 0 and at most 1e+06")
        expected.append(f"course.toml:{place}:{name}: must be {what}, not {value}")
    assert sorted(problems_of(teams)) == sorted(expected)


def test_a_folder_for_programs_that_does_not_exist_is_refused_with_its_line(teams: Path) -> None:
    (teams / "course.toml").write_text('name = "x"\nread_only = ["/usr", "/opt/matlba", "tools"]\n')
    assert problems_of(teams) == [
        'course.toml:2:read_only: "/opt/matlba" does not exist',
        f'course.toml:2:read_only: "{teams / "tools"}" does not exist',
    ]
    # A team that practices may not have the course's tools, and a cluster's workers have their own.
    assert read_course(teams, alone=True).read_only == read_course(teams, is_here=False).read_only


def test_what_is_not_there_is_said(teams: Path, tmp_path: Path) -> None:
    missing = tmp_path / "missing"
    assert problems_of(missing) == [f"{missing}: there is no such file or folder"]
    nothing = "names no team: a folder for each, or [[team]] with name and folder"
    (tmp_path / "empty").mkdir()
    assert problems_of(tmp_path / "empty") == [f"{tmp_path / 'empty'}: {nothing}"]
    file = tmp_path / "some.toml"
    file.write_text("")
    assert problems_of(file) == [f"some.toml: {nothing}"]
    file.write_text('teams = "nowhere"')
    assert problems_of(file) == [f"{tmp_path / 'nowhere'}: is not a folder"]
    file.write_text('[[team]]\nname = "x"\n[[team]]\nfolder = "none"\n')
    assert problems_of(file) == [
        "some.toml:1:team: team 1 has no folder",
        'some.toml:1:team: "none" is not a folder',
    ]


def test_a_course_file_that_is_not_there_is_said_and_so_are_teams_beside_one_that_is(
    teams: Path, tmp_path: Path
) -> None:
    missing, there = tmp_path / "missing", tmp_path / "some.toml"
    there.write_text("")
    for target, course_file in ((teams, missing), (missing, there)):
        with pytest.raises(ConfigurationError) as caught:
            read_course(target, course_file)
        assert [*map(str, caught.value.problems)] == [f"{missing}: there is no such file or folder"]


def test_teams_are_the_folders_that_are_neither_hidden_nor_the_courses(teams: Path, tmp_path: Path) -> None:
    (teams / ".hidden").mkdir()
    (teams / "file").touch()
    (teams / "link").symlink_to(teams / "a")
    (teams / "set").mkdir()
    for name, plan, folder in (("grading", True, True), ("plan", True, False), ("folder", False, True)):
        (teams / name).mkdir()
        if plan:
            (teams / name / "grade.json").touch()
        if folder:
            (teams / name / "teams").mkdir()
    (teams / "course.toml").write_text('set = "set"\n')
    assert [team.name for team in read_course(teams).teams] == ["a", "b", "folder", "plan"]
    assert read_course(teams).directory == teams / "set"


def test_links_and_archives_among_the_folders_of_teams_are_named(
    teams: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each may be a submission, and grades without that team look complete."""
    (teams / "notes.txt").touch()
    assert not_teams(read_course(teams)) == []
    for name in ("late.ZIP", "b.tar.gz", "c.7z"):
        (teams / name).touch()
    (teams / "link").symlink_to(teams / "a")
    (teams / "link.txt").symlink_to(teams / "notes.txt")
    assert not_teams(read_course(teams)) == ["b.tar.gz", "c.7z", "late.ZIP", "link"]
    for name in ("a", "b"):
        (teams / name / "team.toml").write_text("no = 1")  # refused: nothing has to be run
    run_grade([str(teams), "--isolation", "none", "--out", str(tmp_path / "out")])
    said = "not graded, because they are links or archives: b.tar.gz, c.7z, late.ZIP, link"
    assert f"simmer-tui grade: {said}\n" in capsys.readouterr().err


def test_a_teams_own_file_has_64_kibibytes(tmp_path: Path) -> None:
    team = Team("a", tmp_path, "./x")
    line = 'command = "./own"\n'
    for size, command, problems in (
        (65536, "./own", []),
        (65537, "./course", ["team.toml: is larger than 65536 bytes"]),
    ):
        (tmp_path / "team.toml").write_text(line + "#" * (size - len(line)))
        found = submitted_team(team, tmp_path, "./course")
        assert (found.command, [*map(str, found.problems)]) == (command, problems)


def test_what_the_course_says_of_a_team_goes_before_its_own_file(tmp_path: Path) -> None:
    given = {"command": "./given", "config": "given"}
    (tmp_path / "team.toml").write_text('command = "./own"\nconfig = "own"\n')
    (tmp_path / "Main.m").touch()
    found = submitted_team(Team("a", tmp_path, "", "", given), tmp_path, "./course")
    assert (found.command, found.config) == ("./given", "given")
    found = submitted_team(Team("a", tmp_path, ""), tmp_path, "./course")
    assert (found.command, found.config) == ("./own", "own")
    (tmp_path / "team.toml").unlink()
    for name in ("Main.m", "config.py", "config"):
        (tmp_path / name).touch()
        found = submitted_team(Team("a", tmp_path, ""), tmp_path, "./course")
        assert (found.command, found.config) == ("./course", name)
    # The set is in its usual place, wherever the wiring is.
    (tmp_path / "wiring.toml").touch()
    assert submitted_team(Team("a", tmp_path, ""), tmp_path, "./course").config == "config"


def test_names_of_files_tell_teams_apart() -> None:
    slugs = {name: Team(name, Path(), "").slug for name in ("a-b9", "A b", "ö", "x" * 41, "x" * 40)}
    assert slugs["a-b9"] == "a-b9"
    assert slugs["x" * 40] == "x" * 40
    ends = {name: slug.rpartition("-") for name, slug in slugs.items()}
    assert [ends[name][0] for name in ("A b", "ö", "x" * 41)] == ["a-b", "team", "x" * 40]
    assert all(len(ends[name][2]) == 6 for name in ("A b", "ö", "x" * 41))
    assert shown_name("y" * 300, 200) == "y" * 197 + "..."


# -- the robot of a submission -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("config", "what"),
    [
        ("../else", "config: must lie in the team's folder"),
        ("in/../robot", "config: must lie in the team's folder"),
        ("in\\..\\robot", "config: must lie in the team's folder"),
        ("link", "config: must lie in the team's folder"),
        ("/", "config: must lie in the team's folder"),
        ("x" * 140, f'config: there is no "{"x" * 117}..."'),
    ],
)
def test_a_teams_robot_lies_in_its_folder(tmp_path: Path, config: str, what: str) -> None:
    program = tmp_path / "home" / "program"
    (program / "in").mkdir(parents=True)
    (program / "robot").mkdir()
    (program / "robot" / "robot.csv").touch()
    (tmp_path / "else").mkdir()
    (program / "link").symlink_to(tmp_path / "else")
    found = check_submission(
        Team("a", tmp_path, "x", config), tmp_path / "home", load(find_set("mission")), Rules()
    )
    assert found.configuration is None
    assert [*map(str, found.problems)] == [what]


def test_a_team_without_a_robot_has_the_courses_without_its_names(tmp_path: Path) -> None:
    course = load(find_set("mission"))
    found = check_submission(Team("a", tmp_path, "x"), tmp_path, course, Rules()).configuration
    assert found is not None
    server = found.settings.server
    assert (found.name, server.host, server.any_user, server.token) == ("the course's", "127.0.0.1", True, "")
    assert (found.simulation, found.mission) == (course.simulation, course.mission)
    assert reference(course, Rules()) is course
    assert reference(course, Rules(size=7.0)).simulation.robot.radius == 3.5


# -- copies ------------------------------------------------------------------------------------------


@pytest.fixture(params=[True, False])
def by_descriptor(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once as on this system, and once as on one that opens paths."""
    if not request.param:
        monkeypatch.setattr(submission_copy, "_BY_DESCRIPTOR", False)


@pytest.mark.usefixtures("by_descriptor")
def test_a_copy_is_of_files_up_to_the_last_byte(tmp_path: Path) -> None:
    source = tmp_path / "from"
    (source / "in" / ".gitted").mkdir(parents=True)
    (source / "in" / "node_modules").mkdir()
    (source / "in" / "node_modules" / "x").touch()
    (source / "in" / ".gitted" / "x").touch()
    (source / "in" / ".git").touch()
    (source / "in" / "__pycache__").touch()
    large = bytes(range(256)) * 8192  # more than is read at once
    (source / "large").write_bytes(large)
    (source / "tool").write_text("abc")
    (source / "pipe").symlink_to("large")
    for name, mode in (("large", 0o600), ("tool", 0o610)):
        (source / name).chmod(mode)
    size = len(large) + 3
    copy_submission(source, tmp_path / "to", size)
    found = {path.relative_to(tmp_path / "to").as_posix() for path in (tmp_path / "to").rglob("*")}
    assert found == {"large", "tool", "in", "in/.git", "in/__pycache__"}
    assert (tmp_path / "to" / "large").read_bytes() == large
    modes = [(tmp_path / "to" / name).stat().st_mode & 0o777 for name in ("large", "tool", "in", ".")]
    assert modes == [0o644, 0o755, 0o755, 0o755]
    with pytest.raises(GradeError, match=f"^are more than {(size - 1) / 1e6:g} MB or 2000 files$"):
        copy_submission(source, tmp_path / "less", size - 1)


@pytest.mark.usefixtures("by_descriptor")
def test_folders_may_be_40_deep(tmp_path: Path) -> None:
    source = tmp_path / "from"
    place = source
    for _ in range(40):
        place = place / "d"
    place.mkdir(parents=True)
    (place / "x").touch()
    copy_submission(source, tmp_path / "to", 1)
    assert (tmp_path / "to" / place.relative_to(source) / "x").exists()
    (place / "d").mkdir()
    with pytest.raises(GradeError, match=r"^has folders more than 40 deep$"):
        copy_submission(source, tmp_path / "deeper", 1)


def test_files_may_be_as_many_as_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(submission_copy, "MOST_FILES", 20)
    source = tmp_path / "from"
    source.mkdir()
    for number in range(20):
        (source / str(number)).touch()
    copy_submission(source, tmp_path / "to", 0)
    assert len(list((tmp_path / "to").iterdir())) == 20
    (source / "more").touch()
    with pytest.raises(GradeError, match=r"^are more than 0 MB or 20 files$"):
        copy_submission(source, tmp_path / "more", 0)


def test_a_file_that_grows_while_it_is_read_is_too_large(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "from").mkdir()
    (tmp_path / "from" / "x").write_bytes(bytes(10))
    read = os.read

    def growing(descriptor: int, size: int) -> bytes:
        with (tmp_path / "from" / "x").open("ab") as file:
            file.write(bytes(3))
        return read(descriptor, 5)

    monkeypatch.setattr(os, "read", growing)
    with pytest.raises(GradeError, match=r"^are more than 1.9e-05 MB or 2000 files$"):
        copy_submission(tmp_path / "from", tmp_path / "to", 19)


def test_a_disk_that_takes_a_part_at_a_time_gets_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "from").mkdir()
    (tmp_path / "from" / "x").write_bytes(b"0123456789")
    write = os.write
    monkeypatch.setattr(os, "write", lambda descriptor, data: write(descriptor, bytes(data)[:3]))
    copy_submission(tmp_path / "from", tmp_path / "to", 10)
    assert (tmp_path / "to" / "x").read_bytes() == b"0123456789"


def test_what_cannot_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = tmp_path / "from"
    (source / "in").mkdir(parents=True)
    (source / "in" / "x").touch()
    with pytest.raises(GradeError, match=r"^its folder: No such file or directory$"):
        copy_submission(tmp_path / "missing", tmp_path / "to", 1)
    opened = os.open

    def refused(path: str | Path, *given: int, **more: int | None) -> int:
        if Path(path).name == "x":
            raise PermissionError(13, "Permission denied")
        return opened(path, *given, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(os, "open", refused)
    with pytest.raises(GradeError, match=r"^in/x: Permission denied$"):
        copy_submission(source, tmp_path / "one", 1)
    monkeypatch.undo()
    scan = os.scandir

    def unlisted(place: int) -> object:
        if "in" not in os.listdir(place):
            raise OSError("odd")
        return scan(place)

    monkeypatch.setattr(os, "scandir", unlisted)
    with pytest.raises(GradeError, match=r"^in: odd$"):
        copy_submission(source, tmp_path / "two", 1)
