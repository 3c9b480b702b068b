"""A team's own language in a grading: taken where the course allows it, and no better than its sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest
from msgspec.structs import replace

from simmer_tui.cli.grade_command import run_grade
from simmer_tui.config.dialect_reader import load_dialect
from simmer_tui.config.loader import load
from simmer_tui.dialect.device import DialectDevice
from simmer_tui.dialect.dialect_rules import Parts
from simmer_tui.dialect.expressions import FieldValue
from simmer_tui.errors import Problem
from simmer_tui.grade.course import Rules, Team, read_course
from simmer_tui.grade.robot_rules import rule_problems
from simmer_tui.grade.submission import SubmissionCheck, check_submission
from simmer_tui.grade.submission_copy import copy_submission
from simmer_tui.sim.sensors.lidar import Lidar, LidarSpec
from tests.grade.conftest import read_grades

DIALECT = '[[command]]\nmatch = "get"\nreply = "{u1*cm:.1f}"\n[[command]]\nmatch = "x"\ndo = "stop"\n'
REFUSED = (
    "dialect.toml: the course takes no team's own language: let the program speak one of the course's "
    "protocols (dialects = true in course.toml would allow it)"
)


@pytest.fixture
def check(tmp_path: Path, exact_mission: Path) -> Callable[..., SubmissionCheck]:
    def checked(dialect: str, *, dialects: bool, settings: str = "") -> SubmissionCheck:
        own = tmp_path / "team" / "config"
        own.mkdir(parents=True, exist_ok=True)
        (own / "dialect.toml").write_text(dialect, "utf-8")
        if settings:
            (own / "settings.toml").write_text(settings, "utf-8")
        team = Team("team", tmp_path / "team", "python main.py", "config")
        home = tmp_path / "home"
        home.mkdir(exist_ok=True)
        copy_submission(team.folder, home / "program", 1_000_000)
        return check_submission(team, home, load(exact_mission), Rules(dialects=dialects))

    return checked


def test_a_dialect_is_taken_if_the_course_says_so(check: Callable[..., SubmissionCheck]) -> None:
    found = check(DIALECT, dialects=True)
    assert not found.problems
    assert found.configuration is not None
    assert found.configuration.dialect is not None
    assert found.configuration.settings.server.listeners == ("dialect",)
    assert found.configuration.settings.motion.motion == "timed"


def test_a_team_may_say_how_its_program_talks(check: Callable[..., SubmissionCheck]) -> None:
    found = check(DIALECT, dialects=True, settings='[server]\nlisteners = ["dialect", "binary"]\n')
    assert found.configuration is not None
    assert found.configuration.settings.server.listeners == ("dialect", "binary")


def test_a_wiring_is_refused_by_name(check: Callable[..., SubmissionCheck], tmp_path: Path) -> None:
    (tmp_path / "team" / "config").mkdir(parents=True)
    (tmp_path / "team" / "config" / "wiring.toml").write_text("[boards]\n", "utf-8")
    (problem,) = check(DIALECT, dialects=True).problems
    assert str(problem).startswith("wiring.toml: the course takes no boards: leave it out")


def test_without_that_it_is_refused(check: Callable[..., SubmissionCheck]) -> None:
    found = check(DIALECT, dialects=False)
    assert found.configuration is None
    assert [str(each) for each in found.problems] == [REFUSED]


@pytest.mark.parametrize(
    ("more", "place", "name", "sensor"),
    [
        ('reply = "{ray(90):.1f}"', "1:command.1", "ray()", "a lidar"),
        ('do = "d1-{scan(0, 1, 5)[2]}"', "1:command.1", "scan()", "a lidar"),
        ('do = "pause 1"\ndone = "{contact}"', "1:command.1", "'contact'", "a bumper"),
        ('reply = "x"\n[[stream]]\nevery = 1\nsend = "{ray(0)}"', "4:stream.1", "ray()", "a lidar"),
    ],
)
def test_exact_values_need_a_sensor(
    check: Callable[..., SubmissionCheck], more: str, place: str, name: str, sensor: str
) -> None:
    found = check(f'[[command]]\nmatch = "q"\n{more}\n', dialects=True)
    assert found.configuration is None
    (problem,) = map(str, found.problems)
    assert problem.startswith(f"dialect.toml:{place}: {name} needs {sensor} in sensors.csv")


def test_the_course_says_it_in_one_line(make_course: Callable[..., Path]) -> None:
    assert not read_course(make_course({"a": ""})).rules.dialects
    path = make_course({"b": ""}, "dialects = true\n")
    assert read_course(path).rules.dialects


MISSION = """
[[command]]
match = "f {n}"
do = "d1-{n}"
done = "ok;"
[[command]]
match = "g {n}"
do = "p1-{n}"
done = "ok;"
"""
PROGRAM = """
import serial
robot = serial.Serial("COM6", 9600, timeout=30)
for message in (b"f 5", b"g 1", b"f -9", b"g 0"):
    robot.write(message + b"\\n")
    assert robot.read_until(b";") == b"ok;"
"""


@pytest.mark.slow
def test_a_team_is_graded_by_its_own_language(
    make_course: Callable[..., Path], isolation: str, tmp_path: Path
) -> None:
    file = make_course({"alpha": PROGRAM}, "dialects = true\n[decide]\ncap = 3\n")
    team = tmp_path / "teams" / "alpha"
    (team / "config").mkdir()
    (team / "config" / "dialect.toml").write_text(MISSION, "utf-8")
    # The port is found by Python's site, which -S leaves out.
    (team / "team.toml").write_text('command = "python main.py"\n', "utf-8")
    out = tmp_path / "out"
    run_grade([str(file), "--out", str(out)])
    assert read_grades(out)["alpha"]["status"] == "passed"


class Reads:
    """A host that counts which sensors are read."""

    now = 0.0

    def __init__(self) -> None:
        self.codes: list[tuple[str, ...]] = []
        self.sent = b""

    def read(self, codes: Sequence[str], done: Callable[[Mapping[str, FieldValue]], None]) -> None:
        self.codes.append(tuple(codes))
        done({code: (7.0,) * 360 if code == "li" else 2.0 for code in codes})

    def send(self, data: bytes, *, droppable: bool = False) -> None:
        self.sent += data

    def done(self, message: bytes, meaning: str) -> None:
        pass

    def tell(self, text: str) -> None:
        raise AssertionError(text)

    inform = tell


def test_a_ray_costs_the_read_time_of_its_sensor(tmp_path: Path, exact_mission: Path) -> None:
    course = load(exact_mission)
    spec = course.simulation
    lidar = LidarSpec(kind=Lidar, number=1, code="li", read_time=0.2)
    text = '[[command]]\nmatch = "q"\nreply = "{ray(0):.0f} {ray(90):.0f} {u1:.0f} {u1:.0f}"\n'
    (tmp_path / "dialect.toml").write_text(text, "utf-8")
    problems: list[Problem] = []
    parts = Parts((*spec.sensors, lidar), spec.drives, spec.gripper, spec.velocities)
    rules = load_dialect(tmp_path, parts, problems)
    assert rules is not None
    host = Reads()
    DialectDevice(rules, host).received(b"q\n")  # type: ignore[arg-type]
    assert host.sent == b"7 7 2 2"
    assert host.codes == [("u1", "li")]
    assert not rule_problems(Rules(dialects=True), course, replace(course, dialect=rules))
