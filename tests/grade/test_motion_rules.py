"""Continuous motion in a grading: time, walls and clock are the course's, wheels where it says so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from simmer_tui.config.loader import load
from simmer_tui.grade.course import Rules, Team, read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.submission import SubmissionCheck, check_submission
from simmer_tui.grade.submission_copy import copy_submission

MOTION = """
[motion]
motion = "timed"
clock = "real"
loop_time = 0.5
wall_friction = 0.0
velocity_timeout = 3.0
control_period = 0.1
"""


@pytest.fixture
def check(tmp_path: Path, exact_mission: Path) -> Callable[..., SubmissionCheck]:
    def checked(settings: str, *, wheels: bool = False) -> SubmissionCheck:
        own = tmp_path / "team" / "config"
        own.mkdir(parents=True)
        (own / "robot.csv").write_text((exact_mission / "robot.csv").read_text())
        (own / "settings.toml").write_text(settings)
        (tmp_path / "home").mkdir()
        team = Team("team", tmp_path / "team", "python main.py", "config")
        copy_submission(team.folder, tmp_path / "home" / "program", 1_000_000)
        return check_submission(team, tmp_path / "home", load(exact_mission), Rules(wheels=wheels))

    return checked


def test_time_walls_and_clock_are_the_courses(
    check: Callable[..., SubmissionCheck], exact_mission: Path
) -> None:
    course, found = load(exact_mission), check(MOTION, wheels=True).configuration
    assert found is not None
    assert found.settings.motion == course.settings.motion
    for name in ("loop_time", "wall_friction", "velocity_timeout", "control_period"):
        assert getattr(found.simulation, name) == getattr(course.simulation, name)


def test_wheels_are_the_courses(check: Callable[..., SubmissionCheck], exact_mission: Path) -> None:
    course, found = load(exact_mission), check('[wheels]\nlayout = "diff"\n').configuration
    assert found is not None
    assert found.simulation.wheels == course.simulation.wheels
    assert found.settings.wheels == course.settings.wheels


def test_wheels_are_the_teams_if_the_course_says_so(check: Callable[..., SubmissionCheck]) -> None:
    found = check('[wheels]\nlayout = "omni-4"\nradius = 2.5\ntop_speed = 9\n', wheels=True).configuration
    assert found is not None
    assert found.simulation.wheels is not None
    assert (found.simulation.wheels.radius, found.simulation.wheels.top_speed) == (2.5, 9.0)
    assert found.settings.wheels.layout == "omni-4"


def test_without_wheels_of_its_own_a_team_has_the_courses(
    check: Callable[..., SubmissionCheck], exact_mission: Path
) -> None:
    found = check("[server]\nport = 9100\n", wheels=True).configuration
    assert found is not None
    assert found.simulation.wheels == load(exact_mission).simulation.wheels


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ("[wheels]\ntop_speed = 12.5\n", "the wheels turn at 12.5 in/s; at most 12 are allowed"),
        ("[wheels]\ntop_speed = -1\n", "wheels.top_speed"),
        ('[wheels]\nlayout = "tank"\n', "wheels.layout"),
    ],
)
def test_wheels_are_no_faster_than_the_courses(
    check: Callable[..., SubmissionCheck], settings: str, problem: str
) -> None:
    found = check(settings, wheels=True)
    assert found.configuration is None
    (said,) = map(str, found.problems)
    assert said.startswith("settings.toml")
    assert problem in said


def test_the_clock_of_the_runs_is_an_option(make_course: Callable[..., Path], tmp_path: Path) -> None:
    course = read_course(make_course({"a": ""}))
    for clock in ("program", "real", ""):
        asked = replace(course, clock=clock)
        folder = GradeFolder.create(tmp_path / f"out{clock}", asked, 5, Isolation.NONE)
        (entry,) = GradeFolder.read(folder.path).entries
        configuration = folder.trial(entry, 1).configuration
        assert configuration.settings.motion.clock == (clock or "auto")


def test_the_course_says_it_in_one_line(make_course: Callable[..., Path]) -> None:
    assert not read_course(make_course({"a": ""})).rules.wheels
    assert read_course(make_course({"b": ""}, "wheels = true\n")).rules.wheels
