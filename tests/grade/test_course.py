"""What is asked of teams, and which robots may be graded."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.config.loader import load
from simmer_tui.errors import ConfigurationError
from simmer_tui.grade.admission import admit, keep_files, reference
from simmer_tui.grade.course import Rules, Team, read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.limits import Isolation
from simmer_tui.mission import plan_run
from simmer_tui.trials.trial import prepare


@pytest.fixture
def problems(tmp_path: Path, course_set: Path) -> Callable[..., str]:
    """Changes text in a file of a team's own set, and says what is against the rules."""

    def found(file: str, old: str, new: str, rules: Rules | None = None) -> str:
        team = tmp_path / "teams" / "a"
        shutil.copytree(course_set, team / "config")
        text = (team / "config" / file).read_text()
        assert old in text
        (team / "config" / file).write_text(text.replace(old, new, 1))
        one = Team("a", team, "python main.py", "config")
        keep_files(one, tmp_path / "home", 10**6)
        admission = admit(one, tmp_path / "home", load(course_set), rules or Rules())
        assert (admission.configuration is None) == bool(admission.problems)
        return "\n".join(map(str, admission.problems))

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
         "drive.csv:up:Enabled: may not differ from the course's"),
        ("robot.csv", "(in),6", "(in),7", Rules(cells={"robot.csv": ()}),
         "robot.csv:Diameter or x-size (in): may not differ from the course's"),
        ("maze.csv", "3,3,1", "0,0,0", None, ""),
        ("settings.toml", "port = 9000", "port = 9100", None, ""),
    ],
)  # fmt: skip
def test_robot_against_the_rules(
    problems: Callable[..., str], file: str, old: str, new: str, rules: Rules | None, what: str
) -> None:
    assert problems(file, old, new, rules) == what


def test_errors_of_drives_are_at_least_the_courses(problems: Callable[..., str], course_set: Path) -> None:
    drives = course_set / "drive.csv"
    drives.write_text(drives.read_text().replace("up,w1,1,0,0,0", "up,w1,1,0.05,0,0"))
    found = problems("drive.csv", "up,w1,1,0.05", "up,w1,1,0.01")
    assert found == "drive.csv:up: its Y-axis error is below the course's 0.05"


def test_maze_and_mission_are_the_courses_and_ports_the_teams(tmp_path: Path, course_set: Path) -> None:
    own = tmp_path / "teams" / "a" / "config"
    shutil.copytree(course_set, own)
    (own / "maze.csv").write_text("2,3\n2,3\n")
    (own / "mission.toml").write_text("contacts = 'any'\n")
    settings = (own / "settings.toml").read_text().replace("port = 9000", "port = 9100")
    (own / "settings.toml").write_text(settings.replace("randerror = true", "randerror = false"))
    team = Team("a", tmp_path / "teams" / "a", "x", "config")
    keep_files(team, tmp_path / "home", 10**6)
    course = load(course_set)
    found = admit(team, tmp_path / "home", course, Rules()).configuration
    assert found is not None
    assert (found.simulation.maze, found.mission) == (course.simulation.maze, course.mission)
    assert (found.settings.server.port, found.settings.randerror) == (9100, course.settings.randerror)


def test_config_py_is_imported_and_not_executed(tmp_path: Path, course_set: Path) -> None:
    team = tmp_path / "teams" / "a"
    team.mkdir(parents=True)
    executed = tmp_path / "executed"
    (team / "config.py").write_text(f"import os\nopen({str(executed)!r}, 'w')\nROBOT = 1\n")
    one = Team("a", team, "x", "config.py")
    keep_files(one, tmp_path / "home", 10**6)
    admission = admit(one, tmp_path / "home", load(course_set), Rules())
    assert admission.configuration is None
    assert "config.py" in str(admission.problems[0])
    assert not executed.exists()


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


def test_folder_of_folders_is_a_course(tmp_path: Path) -> None:
    for name in ("red", "blue", ".hidden"):
        (tmp_path / name).mkdir()
    (tmp_path / "red" / "team.toml").write_text('name = "blue"\ncommand = "./run"\n')
    course = read_course(tmp_path)
    assert [(team.name, team.command) for team in course.teams] == [
        ("blue", "python main.py"),
        ("red", "./run"),
    ]


def test_names_make_files_of_their_own() -> None:
    names = ["red", "Red", "../red", "röd", "", "a" * 300]
    slugs = [Team(name, Path(), "").slug for name in names]
    assert len(set(slugs)) == len(names)
    assert all("/" not in slug and "." not in slug and 0 < len(slug) < 60 for slug in slugs)
