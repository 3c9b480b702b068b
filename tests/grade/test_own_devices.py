"""A team's own devices in a grading: refused in a line, whoever brings them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.config.loader import load
from simmer_tui.errors import GradeError
from simmer_tui.grade.course import Rules, Team, read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.submission import check_submission
from simmer_tui.grade.submission_copy import copy_submission

SETTINGS = '[sensors]\ndevices = ["devices/thermal.py"]\n'
ENDS_THE_GRADER = "raise SystemExit('it ran')\n"


def test_a_team_with_a_device_is_refused_and_nothing_of_it_runs(tmp_path: Path, exact_mission: Path) -> None:
    own = tmp_path / "team" / "config"
    (own / "devices").mkdir(parents=True)
    (own / "settings.toml").write_text(SETTINGS)
    rows = (exact_mission / "sensors.csv").read_text()
    (own / "sensors.csv").write_text(f"{rows}temp1,h1,1,,,,,0,,\n")
    (own / "devices" / "thermal.py").write_text(ENDS_THE_GRADER)
    home = tmp_path / "home"
    home.mkdir()
    team = Team("team", tmp_path / "team", "python main.py", "config")
    copy_submission(team.folder, home / "program", 1_000_000)
    found = check_submission(team, home, load(exact_mission), Rules())
    assert found.configuration is None
    assert [str(each) for each in found.problems] == [
        "settings.toml:sensors.devices: devices/thermal.py: a grading runs no devices of a team's own; take "
        "them and their rows out"
    ]


def test_a_course_with_a_device_is_refused(
    make_course: Callable[..., Path], exact_mission: Path, tmp_path: Path
) -> None:
    settings = exact_mission / "settings.toml"
    settings.write_text(f"{settings.read_text()}\n{SETTINGS}")
    (exact_mission / "devices").mkdir()
    (exact_mission / "devices" / "thermal.py").write_text(ENDS_THE_GRADER)
    course = read_course(make_course({"a": "pass"}))
    with pytest.raises(GradeError, match=r"take devices/thermal\.py out of sensors\.devices"):
        GradeFolder.create(tmp_path / "out", course, 1, Isolation.NONE)
