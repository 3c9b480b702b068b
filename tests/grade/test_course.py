"""Demands on teams, and which robots may be graded."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.cli.grade_command import run_grade
from simmer_tui.config.loader import load
from simmer_tui.errors import ConfigurationError
from simmer_tui.grade.course import Rules, Team, read_course, shown_name
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.robot_rules import rule_problems
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.site import site
from simmer_tui.grade.submission import check_submission, reference
from simmer_tui.grade.submission_copy import copy_submission
from simmer_tui.grade.team_result import TeamStatus, team_results
from simmer_tui.run.mission import plan_run
from simmer_tui.sim.sensors import KINDS
from simmer_tui.trials.trial import prepare
from tests.grade.conftest import read_grades

pytestmark = pytest.mark.usefixtures("reads_here")


@pytest.fixture
def problems(tmp_path: Path, exact_mission: Path) -> Callable[..., str]:
    """Changes text in a file of a team's own set, and says what is against the rules."""

    def found(file: str, old: str, new: str, rules: Rules | None = None) -> str:
        team = tmp_path / "teams" / "a"
        shutil.copytree(exact_mission, team / "config")
        text = (team / "config" / file).read_text()
        assert old in text
        (team / "config" / file).write_text(text.replace(old, new, 1))
        one = Team("a", team, "python main.py", "config")
        copy_submission(one.folder, tmp_path / "home" / "program", 10**6)
        check = check_submission(one, tmp_path / "home", load(exact_mission), rules or Rules())
        assert (check.configuration is None) == bool(check.problems)
        return "\n".join(map(str, check.problems))

    return found


@pytest.mark.parametrize(
    ("file", "old", "new", "rules", "what"),
    [
        ("sensors.csv", "ultra1,u1", "ultra1,x9", None, ""),
        ("sensors.csv", "ultra1,u1,1,3,0,6,0,0.02", "ultra1,u1,1,2,1,6,9,0.05", None, ""),
        ("sensors.csv", "ultra1,u1,1,3,0,6,0,0.02", "ultra1,u1,1,3,0,6,0,0.01", None,
         "sensors.csv:ultra1: its error is below the course's 0.02"),
        ("sensors.csv", "ultra1,u1,1,3,0,6,0,0.02", "ultra1,u1,0,3,0,6,0,0.01", None, ""),
        ("sensors.csv", "ultra1,", "ultra9,", Rules(sensors=16),
         "sensors.csv: 17 sensors are enabled; at most 16 are allowed"),
        ("robot.csv", "(in),6", "(in),9", Rules(size=8.0),
         "robot.csv: the robot needs a circle of 9.00 in around its centre; 8 allowed"),
        ("robot.csv", "(in),6", "(in),9", None, ""),
        ("drive.csv", "grip,p1,1,,,,,,,3,4", "grip,p1,1,,,,,,,30,4", None,
         "drive.csv:grip: its reach is above the course's 3"),
        ("drive.csv", "up,w1", "up,z1", Rules(cells={"drive.csv": ("Poll Character",)}), ""),
        ("drive.csv", "up,w1,1", "up,w1,0", Rules(cells={"drive.csv": ("Poll Character",)}),
         "drive.csv:up:Enabled: must be the same as in the course's set"),
        ("robot.csv", "(in),6", "(in),7", Rules(cells={"robot.csv": ()}),
         "robot.csv:Diameter or x-size (in): must be the same as in the course's set"),
        ("maze.csv", "3,3,1", "0,0,0", None, ""),
        ("settings.toml", "port = 9000", "port = 9100", None, ""),
    ],
)  # fmt: skip
def test_robot_against_the_rules(
    problems: Callable[..., str], file: str, old: str, new: str, rules: Rules | None, what: str
) -> None:
    assert problems(file, old, new, rules) == what


_SENSOR = dict(zip(("ID", "Poll Character", "Enabled", "X Position (in)", "Y Position (in)",
                    "Z Position (in)", "Rotation (deg)", "Percent Error (0-1)",
                    "Field of View (deg)", "Threshold"),
                   ("", "", "1", "2", "0", "4", "0", "0.02", "30", ""), strict=True))  # fmt: skip
"""A sensor of the course, but for what a test says of it."""


@pytest.mark.parametrize(
    ("sensor", "course", "team", "what"),
    [
        ("ultra1", {}, {"Gain": "1000"}, "gain is not the course's 1"),
        ("ultra1", {"Max Range (in)": "40"}, {"Gain": "0.001"}, "gain is not the course's 1"),
        ("ultra1", {"Max Range (in)": "40"}, {"Max Range (in)": ""}, "max range is above the course's 40"),
        ("ultra1", {"Max Range (in)": "40"}, {"Bias": "-40"}, "bias is not the course's 0"),
        ("ultra1", {"Max Range (in)": "40"}, {"Wrap": "40"}, "wrap is not the course's 0"),
        ("ultra1", {"Max Range (in)": "40"}, {"Resolution": "40"}, "resolution is not the course's 0"),
        ("ultra1", {}, {"Rays": "100"}, "rays is not the course's 5"),
        ("ultra1", {}, {"Field of View (deg)": "180"}, "field of view is not the course's 30"),
        ("ultra1", {}, {"Field of View (deg)": "0.0001"}, "field of view is not the course's 30"),
        ("ultra1", {}, {"X Position (in)": "20"}, "it is 20.00 in from the robot's centre; at most 3.00 are"),
        ("ultra1", {"Absolute Error": "1"}, {"Absolute Error": "2", "Max Range (in)": "50"}, ""),
        ("tof1", {}, {"Max Range (in)": "30", "Min Range (in)": "2"}, ""),
        ("comp1", {}, {"Hard Iron (deg)": "1e6"}, "hard iron is not the course's 0"),
        ("gyro1", {"Bias": "0.5"}, {"Bias": "-1"}, ""),
        ("gyro1", {"Bias": "0.5"}, {"Bias": ""}, "bias is below the course's 0.5"),
        ("odom1", {"Ticks per Inch": "2"}, {"Ticks per Inch": ""}, "ticks per inch is above the course's 2"),
        ("odom1", {"Ticks per Inch": "2"}, {"Ticks per Inch": "1000"},
         "ticks per inch is above the course's 2"),
        ("odom1", {"Ticks per Inch": "2"}, {"Ticks per Inch": "1"}, ""),
        ("load1", {}, {"Percent Error (0-1)": "1.0"}, "error is above 0.98: the opposite"),
        ("load1", {}, {"Percent Error (0-1)": "0.9"}, ""),
        ("ir1", {}, {"Percent Error (0-1)": "1.0"}, ""),
        ("ir1", {}, {"Answer": "analog"}, "answer is not the course's digital"),
        ("ir1", {"Answer": "analog"}, {"Answer": ""}, "answer is not the course's analog"),
        ("ir1", {}, {"Threshold": "0.3", "Detects": "white"}, ""),
    ],
)  # fmt: skip
def test_sensor_that_is_better_by_a_detour(
    tmp_path: Path, exact_mission: Path, sensor: str, course: dict[str, str], team: dict[str, str], what: str
) -> None:
    """Whatever comes before or after an error in a reading, and so changes what the error amounts to."""
    row = _SENSOR | {"ID": sensor, "Poll Character": "q1", "Threshold": "0.8" if sensor == "ir1" else ""}
    loaded = []
    for name, cells in (("course", course), ("team", team)):
        folder = shutil.copytree(exact_mission, tmp_path / name)
        table = row | course | cells
        (folder / "sensors.csv").write_text(f"{','.join(table)}\n{','.join(table.values())}\n")
        loaded.append(load(folder))
    found = rule_problems(Rules(), *loaded)
    assert len(found) == bool(what)
    assert what in "\n".join(map(str, found))


def test_every_property_of_a_sensor_is_judged_or_the_teams() -> None:
    judged = {column.field for kind in KINDS.values() for column in kind.columns}
    fields = {field for kind in KINDS.values() for field in kind.spec_type.__struct_fields__}
    assert judged == fields - {"kind", "number", "code", "enabled"}


def test_robot_is_no_better_than_one_of_the_courses_sensors(tmp_path: Path, exact_mission: Path) -> None:
    """The best of each property of two sensors would be a third."""
    head = ",".join((*_SENSOR, "Max Range (in)"))
    near, far = "ultra1,q1,1,2,0,4,0,0.01,30,,20", "ultra2,q2,1,2,0,4,0,0.05,30,,90"
    both = "ultra1,q1,1,2,0,4,0,0.01,30,,90"
    loaded = []
    for name, rows in (("course", (near, far)), ("one", (near,)), ("two", (far, far.replace("2,q2", "3,q3"))),
                       ("third", (both,))):  # fmt: skip
        folder = shutil.copytree(exact_mission, tmp_path / name)
        (folder / "sensors.csv").write_text("\n".join((head, *rows)) + "\n")
        loaded.append(load(folder))
    base, *teams = loaded
    assert [len(rule_problems(Rules(), base, team)) for team in teams] == [0, 0, 1]


@pytest.mark.parametrize("bias", ["0.1", "-0.1", "-1"])
def test_bias_of_a_drive_is_the_courses(problems: Callable[..., str], bias: str) -> None:
    """An error grows with 1 + bias: one of -1 takes the error away."""
    found = problems("drive.csv", "up,w1,1,0,0,0,0,0,0", f"up,w1,1,0,0,0,0,{bias},0")
    assert found == "drive.csv:up: its X-axis bias is not the course's 0"


def test_errors_of_drives_are_at_least_the_courses(problems: Callable[..., str], exact_mission: Path) -> None:
    drives = exact_mission / "drive.csv"
    drives.write_text(drives.read_text().replace("up,w1,1,0,0,0", "up,w1,1,0.05,0,0"))
    found = problems("drive.csv", "up,w1,1,0.05", "up,w1,1,0.01")
    assert found == "drive.csv:up: its Y-axis error is below the course's 0.05"


def test_maze_and_mission_are_the_courses_and_ports_the_teams(tmp_path: Path, exact_mission: Path) -> None:
    own = tmp_path / "teams" / "a" / "config"
    shutil.copytree(exact_mission, own)
    (own / "maze.csv").write_text("2,3\n2,3\n")
    (own / "mission.toml").write_text("contacts = 'any'\n")
    settings = (own / "settings.toml").read_text().replace("port = 9000", "port = 9100")
    (own / "settings.toml").write_text(settings.replace("randerror = true", "randerror = false"))
    team = Team("a", tmp_path / "teams" / "a", "x", "config")
    copy_submission(team.folder, tmp_path / "home" / "program", 10**6)
    course = load(exact_mission)
    found = check_submission(team, tmp_path / "home", course, Rules()).configuration
    assert found is not None
    assert (found.simulation.maze, found.mission) == (course.simulation.maze, course.mission)
    assert (found.settings.server.port, found.settings.randerror) == (9100, course.settings.randerror)


def test_config_py_is_imported_and_not_executed(tmp_path: Path, exact_mission: Path) -> None:
    team = tmp_path / "teams" / "a"
    team.mkdir(parents=True)
    executed = tmp_path / "executed"
    (team / "config.py").write_text(f"import os\nopen({str(executed)!r}, 'w')\nROBOT = 1\n")
    one = Team("a", team, "x", "config.py")
    copy_submission(one.folder, tmp_path / "home" / "program", 10**6)
    check = check_submission(one, tmp_path / "home", load(exact_mission), Rules())
    assert check.configuration is None
    assert "config.py" in str(check.problems[0])
    assert not executed.exists()


def test_course_without_a_mission_is_none(
    make_course: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Success would be exit code 0, which a program that does nothing has."""
    file = make_course({"lazy": ""})
    (tmp_path / "set" / "mission.toml").unlink()
    assert run_grade([str(file), "--out", str(tmp_path / "out"), "--isolation", "none"]) == 2
    assert "mission.toml: is missing: success in a grading is to do its mission" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_timed_motion_has_the_time_it_needs(make_course: Callable[..., Path], tmp_path: Path) -> None:
    file = make_course({"slow": ""}, "[limits]\ntime = 30\n")
    settings = tmp_path / "set" / "settings.toml"
    walls = []
    for text in ("", 'motion = "timed"\ntime_scale = 0.5\n'):
        settings.write_text(f"[motion]\n{text}")
        folder = GradeFolder.create(tmp_path / f"out{len(walls)}", read_course(file), 5, Isolation.NONE)
        walls.append(folder.trial(folder.entries[0], 1).time_limit)
    assert walls == [30.0, 30.0 + 60.0 / 0.5]


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("diameter", [4, 6, 8])
def test_robots_of_any_size_meet_the_same_missions(
    make_course: Callable[..., Path], tmp_path: Path, diameter: int
) -> None:
    file = make_course({"a": "", "b": ""}, "[rules]\nsize = 8\n")
    (tmp_path / "set" / "mission.toml").write_text("")  # all of it drawn
    own = tmp_path / "teams" / "b" / "config"
    own.mkdir()
    robot = (tmp_path / "set" / "robot.csv").read_text()
    (own / "robot.csv").write_text(robot.replace("(in),6", f"(in),{diameter}"))
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 5, Isolation.NONE)
    for number in range(1, 6):
        plans = [prepare(folder.trial(entry, number))[1] for entry in folder.entries]
        assert plans[0] == plans[1]
        assert plans[0] is not None
    largest = reference(load(tmp_path / "out" / "course"), Rules(size=8.0))
    assert (
        prepare(folder.trial(folder.entries[0], 1))[1]
        == plan_run(largest, folder.trial(folder.entries[0], 1).seed)[1]
    )


def test_every_mistake_in_a_course_is_told_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "teams.toml"
    file.write_text(
        'nam = "x"\n[decide]\nrequire = 2\n[limits]\nprocesses = 0\n[rules]\nsensors = "many"\n'
        '[rules.cells]\n"drive.csv" = 3\n[[team]]\nname = "a"\n[[team]]\nfolder = "nowhere"\n'
    )
    with pytest.raises(ConfigurationError) as caught:
        read_course(file)
    told = "\n".join(map(str, caught.value.problems))
    for part in (
        "teams.toml:1:nam",
        "teams.toml:3:decide.require",
        "teams.toml:5:limits.processes",
        "teams.toml:7:rules.sensors",
        "rules.cells.drive.csv",
        "team 1 has no folder",
        "nowhere",
    ):
        assert part in told


@pytest.mark.parametrize("name", ["drives.csv", "maze.csv"])
def test_rules_for_the_cells_of_another_file_than_the_robots_are_refused(tmp_path: Path, name: str) -> None:
    """They would have no effect, and the teams' robots could differ in every column."""
    file = tmp_path / "teams.toml"
    (tmp_path / "red").mkdir()
    file.write_text(f'[rules.cells]\n"{name}" = ["Poll Character"]\n[[team]]\nfolder = "red"\n')
    with pytest.raises(ConfigurationError) as caught:
        read_course(file)
    assert [problem.where for problem in caught.value.problems] == [f"teams.toml:2:rules.cells.{name}"]


def test_folder_of_folders_is_a_course(tmp_path: Path) -> None:
    for name in ("red", "blue", ".hidden"):
        (tmp_path / name).mkdir()
    (tmp_path / "red" / "team.toml").write_text('command = "./run"\n')
    folder = GradeFolder.create(tmp_path / "out", read_course(tmp_path), 5, Isolation.NONE)
    assert [(entry.team.name, entry.team.command) for entry in folder.entries] == [
        ("blue", "python main.py"),
        ("red", "./run"),
    ]


def test_course_set_and_gradings_are_no_teams(make_course: Callable[..., Path], tmp_path: Path) -> None:
    file = make_course({"a": "", "b": ""})
    teams = tmp_path / "teams"
    shutil.copytree(tmp_path / "set", teams / "set")
    (teams / "course.toml").write_text('set = "set"\n')
    file.unlink()
    outside = tmp_path / "out"
    GradeFolder.create(outside, read_course(teams), 5, Isolation.NONE)
    shutil.move(outside, teams / "grade_2026-01-01_00-00-00")
    assert [team.name for team in read_course(teams).teams] == ["a", "b"]


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ("where", "words"),
    [("teams", ["."]), ("teams/a", ["--practice", "."]), (".", ["teams"])],
)
def test_grading_does_not_lie_among_the_teams(
    make_course: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    where: str,
    words: list[str],
) -> None:
    """The default place is outside; one that is named inside is refused."""
    make_course({"a": ""}).rename(tmp_path / "course.toml")
    (tmp_path / "teams" / "a" / "team.toml").write_text("no = 1")  # refused: nothing has to be run
    monkeypatch.chdir(tmp_path / where)
    options = ["--isolation", "none", "--course", str(tmp_path / "course.toml")]
    assert run_grade([*words, *options]) == 1
    (made,) = (tmp_path if "--practice" not in words else tmp_path / "teams").glob("grade_*")
    assert list(read_grades(made)) == ["a"]
    assert sorted(path.name for path in (tmp_path / "teams" / "a").iterdir()) == ["main.py", "team.toml"]
    assert run_grade(["--resume"]) == 1
    capsys.readouterr()
    for option in (["--clock", "real"], ["--practice"], ["--cap", "3"]):
        assert run_grade(["--resume", "--out", str(made), *option]) == 2
        assert "take course and options from the grading" in capsys.readouterr().err
    assert run_grade(["--resume", "--out", "nowhere"]) == 2
    assert "nowhere holds no grading: there is no grade.json" in capsys.readouterr().err
    assert run_grade([*words, *options, "--out", str(tmp_path / "teams" / "a" / "grading")]) == 2
    assert "name another --out" in capsys.readouterr().err
    if "--practice" not in words:
        assert run_grade([*words, *options, "--out", str(tmp_path / "teams" / "grading")]) == 2
        assert "where each folder is a team: name another --out" in capsys.readouterr().err


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("command = python x\n", "team.toml:1"),
        ('comand = "x"\n', 'team.toml:1:comand: is not known here; did you mean "command"?'),
        ('name = "blue"\n', "team.toml:1:name: is not known here (known: command, config)"),
        ("#" * 70000, "team.toml: is larger than 65536 bytes"),
    ],
)
def test_mistake_in_a_teams_own_file_is_that_teams(
    make_course: Callable[..., Path], tmp_path: Path, text: str, what: str
) -> None:
    file = make_course({"bad": "", "good": ""})
    (tmp_path / "teams" / "bad" / "team.toml").write_text(text)
    GradeFolder.create(tmp_path / "out", read_course(file), 5, Isolation.NONE)
    folder = GradeFolder.read(tmp_path / "out")
    bad, good = team_results(folder, hidden=False)
    assert (bad.status, good.status) == (TeamStatus.REFUSED, TeamStatus.UNDER_WAY)
    assert what in bad.summary
    (tmp_path / "teams" / "bad" / "team.toml").write_text('command = "./robot"\n')
    folder.regrade("bad")
    assert folder.is_open(folder.entries[0])


@pytest.mark.slow
@pytest.mark.parametrize("listed", [False, True])
def test_team_again_is_read_again(make_course: Callable[..., Path], tmp_path: Path, listed: bool) -> None:
    """Its team.toml and its robot; but what the course says of it goes first."""
    file = make_course({"a": ""})
    if listed:
        text = file.read_text().replace('teams = "teams"\n', "")
        file.write_text(f'{text}\n[[team]]\nname = "a"\nfolder = "teams/a"\nconfig = "robot"\n')
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 5, Isolation.NONE)
    assert folder.entries[0].team.command == "python -S main.py"
    own = tmp_path / "teams" / "a"
    for name in ("config", "robot"):
        shutil.copytree(tmp_path / "set", own / name)
    (own / "team.toml").write_text('command = "./new"\n')
    folder = GradeFolder.read(tmp_path / "out")
    folder.regrade("a")
    team = GradeFolder.read(tmp_path / "out").entries[0].team
    assert (team.command, team.config) == ("./new", "robot" if listed else "config")
    (own / "team.toml").unlink()
    folder.regrade("a")
    assert folder.entries[0].team.command == "python -S main.py"


def test_names_of_any_script_are_shown_as_they_are(
    make_course: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not so what steers a terminal, hides the order of letters, or is a formula for spreadsheets."""
    names = ("Ä b", "команда 7", "=1+1", "＝1", "red\x1b[2J", "a\u202eb", os.fsdecode(b"\xff"))
    file = make_course(dict.fromkeys(names, ""), "[decide]\nrequire = 0.9\nmargin = 0.5\n")
    for name in names:
        (tmp_path / "teams" / name / "team.toml").write_text("no = 1")  # refused: nothing has to be run
    assert run_grade([str(file), "--out", str(tmp_path / "out"), "--isolation", "none"]) == 1
    table = list(read_grades(tmp_path / "out"))
    shown = {"Ä b", "команда 7", "=1+1", "＝1", r"red\x1b[2J", r"a\u202eb", r"\xff"}
    assert set(table) == {f"'{name}" if name in ("=1+1", "＝1") else name for name in shown}
    index = (tmp_path / "out" / "site" / "index.html").read_text()
    assert all(f">{name}</a>" in index for name in shown)
    assert "Ä b" in (tmp_path / "out" / "junit.xml").read_text()
    assert "команда 7" in capsys.readouterr().out


def test_every_team_has_a_page_of_its_own(make_course: Callable[..., Path], tmp_path: Path) -> None:
    long = "a team whose name goes on and on, and is the same for sixty characters: "
    file = make_course({f"{long}{number}": "" for number in range(3)} | {"röd": "", "r\x01d": "", "r d": ""})
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 5, Isolation.NONE)
    for hidden in (False, True):
        found = team_results(folder, hidden=hidden)
        assert len(site(folder, found, "")) == 1 + 6
        assert len({each.label for each in found}) == 6 or not hidden


def test_hidden_names_stay_hidden(make_course: Callable[..., Path], tmp_path: Path) -> None:
    file, out = make_course({"secretive": ""}), tmp_path / "out"
    (tmp_path / "teams" / "secretive" / "team.toml").write_text("no = 1")

    def told() -> bool:
        return any("secretive" in page.name + page.read_text() for page in (out / "site").iterdir())

    run_grade([str(file), "--out", str(out), "--isolation", "none", "--hide-names"])
    assert not told()
    with (tmp_path / "teams" / "secretive" / "large.bin").open("wb") as large:
        large.truncate(65_000_000)
    for words in (["--resume"], ["--regrade", "secretive"]):
        run_grade([*words, "--out", str(out)])
        assert not told()
    run_grade(["--resume", "--out", str(out), "--no-hide-names"])
    assert told()


@pytest.mark.slow
def test_margin_can_be_given(make_course: Callable[..., Path], tmp_path: Path) -> None:
    file = make_course({"a": ""})
    (tmp_path / "teams" / "a" / "team.toml").write_text("no = 1")
    out = ["--out", str(tmp_path / "out"), "--isolation", "none"]
    assert run_grade([str(file), "--require", "0.1", *out]) == 2
    assert run_grade([str(file), "--require", "0.1", "--margin", "0.08", *out]) == 1
    test = GradeFolder.read(tmp_path / "out").test
    assert (test.rate, test.margin) == (0.1, 0.08)


def test_names_make_files_of_their_own() -> None:
    names = ["red", "Red", "../red", "röd", "", "a" * 300]
    slugs = [Team(name, Path(), "").slug for name in names]
    assert len(set(slugs)) == len(names)
    assert all("/" not in slug and "." not in slug and 0 < len(slug) < 60 for slug in slugs)


def test_long_names_are_cut_to_the_limit() -> None:
    assert shown_name("x" * 60) == "x" * 60
    assert shown_name("x" * 61) == "x" * 57 + "..."
    assert shown_name("x" * 20, 10) == "xxxxxxx..."
