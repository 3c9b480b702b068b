"""Teams with boards, as far as nothing is compiled: whose wiring counts, and what the course's rules say."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.cli.grade_command import run_grade
from simmer_tui.config.loader import load
from simmer_tui.errors import ConfigurationError, GradeError
from simmer_tui.grade import board_build, grade_folder
from simmer_tui.grade.board_build import BoardBuild, BoardCompiler
from simmer_tui.grade.course import Rules, Team, read_course, submitted_team
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.grading import on_cluster
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.submission import SubmissionCheck, check_submission
from simmer_tui.grade.submission_copy import copy_submission
from simmer_tui.grade.submission_reader import SubmissionReader
from simmer_tui.sketch.compiler import Compiler
from tests.grade.board_course import SOLVES, WIRING, board_course, boards
from tests.sketch.rovers import ENCODERS, MOTORS, ROVER

Check = Callable[..., SubmissionCheck]
ANALOG = (
    '[[sensors]]\nboard = "rover"\npart = "analog"\ncode = "u1"\npin = "A0"\npoints = [[0, 0], [12, 900]]\n'
)


@pytest.fixture
def check(tmp_path: Path, exact_mission: Path) -> Check:
    """Checks a team's files against a course whose set has `wiring`."""
    board_course(tmp_path, {})

    def checked(
        files: dict[str, str], wiring: str = "", config: str = ".", allowed: bool | None = True
    ) -> SubmissionCheck:
        if wiring:
            (exact_mission / "wiring.toml").write_text(wiring, "utf-8")
        folder, home = tmp_path / "team", tmp_path / "home"
        folder.mkdir()
        home.mkdir()
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, "utf-8")
        copy_submission(folder, home / "program", 1_000_000)
        team = Team("team", folder, "", config)
        return check_submission(team, home, load(exact_mission), Rules(boards=allowed))

    return checked


def texts(found: SubmissionCheck) -> list[str]:
    return [str(each) for each in found.problems]


# -- whose wiring counts ---------------------------------------------------------------------------


def test_a_folder_with_a_wiring_is_a_set(check: Check) -> None:
    found = check(boards(SOLVES))
    assert texts(found) == []
    assert found.sketches is not None
    assert list(found.sketches.wiring.boards) == ["rover"]
    assert found.configuration is not None
    motion = found.configuration.settings.motion
    assert (motion.motion, motion.clock) == ("timed", "program")
    assert found.configuration.files["wiring.toml"] == WIRING


def test_boards_are_taken_if_the_course_says_so_or_has_them(check: Check) -> None:
    (said,) = texts(check(boards(SOLVES), allowed=None))
    assert said.startswith("wiring.toml: the course takes no boards: leave it out")
    assert "boards = true in course.toml would allow it" in said


def test_a_course_with_a_wiring_takes_boards(check: Check) -> None:
    assert check(boards(SOLVES), WIRING, allowed=None).sketches is not None


def test_a_course_with_a_wiring_may_refuse_boards(check: Check) -> None:
    assert check(boards(SOLVES), WIRING, allowed=False).sketches is None


def test_a_sketch_alone_runs_on_the_courses_board(check: Check) -> None:
    found = check({"rover.ino": SOLVES}, WIRING, "")
    assert texts(found) == []
    assert found.sketches is not None
    assert found.sketches.wiring.boards["rover"].sketch == "rover.ino"


def test_a_sketch_of_another_name_than_the_courses_is_told_so(check: Check) -> None:
    (said,) = texts(check({"my_robot.ino": SOLVES}, WIRING, ""))
    assert said == (
        "wiring.toml: the course's names rover.ino, which is not there: rename your sketch, or hand in a "
        "wiring.toml"
    )


def test_a_sketch_without_any_wiring_is_told_so(check: Check) -> None:
    (said,) = texts(check({"my_robot.ino": SOLVES}, config=""))
    assert said.startswith("wiring.toml: is missing: it says what is wired")


def test_a_program_alone_needs_no_board_of_the_courses(check: Check) -> None:
    found = check({"main.py": "pass"}, WIRING, "")
    assert (texts(found), found.sketches) == ([], None)


def test_the_robot_may_be_in_another_folder_than_the_wiring(check: Check) -> None:
    found = check({**boards(SOLVES), "robot/dialect.toml": ""}, config="robot")
    assert texts(found)[0].startswith("dialect.toml: the course takes no team's own language")


@pytest.mark.parametrize(
    "sketch", ["../other/rover.ino", "/etc/passwd", "a/../../x.ino", "nosuch.ino", "\\0"]
)
def test_a_sketch_lies_in_the_teams_folder(check: Check, sketch: str) -> None:
    (said,) = texts(check(boards(SOLVES, WIRING.replace("rover.ino", sketch.replace("\\", "\\\\")))))
    outside = "nosuch" not in sketch and sketch != "\\0"
    assert said.startswith("wiring.toml:2:boards.rover.sketch: ")
    assert ("must lie in the team's folder" in said) == outside


def test_mistakes_in_a_wiring_are_told_with_their_lines(check: Check) -> None:
    said = texts(check(boards(SOLVES, WIRING.replace("in1 = 5", "in1 = 99"))))
    assert said[0].startswith("wiring.toml:10:motors.1.in1: ")


# -- the course's robot ----------------------------------------------------------------------------


def test_motors_are_no_faster_than_the_courses_wheels(check: Check) -> None:
    said = texts(check(boards(SOLVES, WIRING.replace("top_speed = 12", "top_speed = 13", 1))))
    assert said == ["wiring.toml:13:motors.1.top_speed: its 13 in/s are above the course's 12"]


def test_motors_are_those_of_the_courses_wiring(check: Check) -> None:
    model = WIRING.replace("top_speed = 12\ndead_band = 0", "top_speed = 9\ndead_band = 0.1", 1)
    said = texts(check(boards(SOLVES), model))
    assert [each.partition(": ")[2] for each in said] == [
        "its 12 in/s are above the course's 9", "its dead band of 0 is below the course's 0.1",
    ]  # fmt: skip
    assert all(each.startswith("wiring.toml:") and "motors.1." in each for each in said)


STEPPER = ROVER + "".join(
    f'[[motors]]\nboard = "rover"\ndriver = "step_dir"\nstep = {step}\ndir = {step + 3}\n'
    f'steps_per_inch = 100\nwheel = "{wheel}"\n'
    for step, wheel in ((2, "left"), (3, "right"))
)


def test_steppers_are_those_of_the_course(check: Check) -> None:
    said = texts(check(boards(SOLVES, STEPPER.replace("= 100", "= 90", 1)), STEPPER))
    assert [each.partition(": ")[2] for each in said] == ["its 90 steps an inch are not the course's 100"]


def test_a_course_with_steppers_has_them_at_their_wheels(check: Check) -> None:
    said = texts(check(boards(SOLVES), STEPPER))
    assert [each.partition(": ")[2] for each in said] == ["the course's robot has a stepper there"] * 2


def test_a_course_with_motors_has_no_steppers(check: Check) -> None:
    said = texts(check(boards(SOLVES, STEPPER), WIRING))
    assert [each.partition(": ")[2] for each in said] == ["the course's robot has no stepper there"] * 2


def test_a_ramp_of_the_course_is_not_passed_by(check: Check, exact_mission: Path) -> None:
    first, *rows = (exact_mission / "drive.csv").read_text("utf-8").splitlines()
    lines = [f"{first},Acceleration", *(f"{each},{20 if each.startswith('up,') else ''}" for each in rows)]
    (exact_mission / "drive.csv").write_text("\n".join((*lines, "")), "utf-8")
    said = texts(check(boards(SOLVES, STEPPER)))
    assert "a stepper has neither lag nor ramp, which the course's drive.csv has" in "\n".join(said)


def test_steppers_are_taken_where_nothing_is_said(check: Check) -> None:
    assert texts(check(boards(SOLVES, STEPPER))) == []


def test_encoders_are_no_finer_than_the_courses(check: Check) -> None:
    finer = WIRING + ENCODERS.format(board="rover").replace("= 40", "= 41").replace("a = 3", "a = 4")
    said = texts(
        check(boards(SOLVES, finer), WIRING + ENCODERS.format(board="rover").replace("a = 3", "a = 4"))
    )
    assert len(said) == 2
    assert all("its 41 edges an inch are above the course's 40" in each for each in said)


def test_a_course_without_encoders_has_none(check: Check) -> None:
    own = ROVER + MOTORS + ENCODERS.format(board="rover")
    said = texts(check(boards(SOLVES, own), WIRING))
    assert len(said) == 2
    assert all(each.endswith("the course's robot has no encoders") for each in said)


def test_curves_are_the_courses(check: Check) -> None:
    own = WIRING + ANALOG.replace("900", "901")
    (said,) = texts(check(boards(SOLVES, own), WIRING + ANALOG))
    assert said.endswith("points: its curve is not one of the course's")


def test_other_pins_are_the_teams(check: Check) -> None:
    own = WIRING.replace("pin = 3", "pin = 11").replace("in2 = 6", "in2 = 3") + ANALOG.replace("A0", "A4")
    assert texts(check(boards(SOLVES, own), WIRING + ANALOG)) == []


def test_wheels_must_be_driven(check: Check, exact_mission: Path) -> None:
    rows = (exact_mission / "drive.csv").read_text("utf-8")
    (exact_mission / "drive.csv").write_text(rows.replace("wheels,ww,1", "wheels,ww,0"), "utf-8")
    assert texts(check(boards(SOLVES)))[0].startswith("drive.csv: boards turn the wheels by its row wheels")


# -- a grading -------------------------------------------------------------------------------------


def test_a_team_without_a_program_has_no_command(tmp_path: Path) -> None:
    def command(files: dict[str, str], given: dict[str, str] | None = None) -> str:
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, "utf-8")
        return submitted_team(Team("a", folder, "", given=given or {}), folder, "python main.py").command

    alone = boards(SOLVES)
    assert command(alone) == ""
    assert command({"config/wiring.toml": WIRING, "rover.ino": SOLVES}) == ""
    # A program that is there, or in a wrong place, or of the team's own command, is not left out.
    assert command({**alone, "main.py": "pass"}) == "python main.py"
    assert command({**alone, "laptop/main.py": "pass"}) == "python main.py"
    assert command({**alone, "team.toml": 'command = "python other.py"\n'}) == "python other.py"
    assert command(alone, {"command": "python own.py"}) == "python own.py"
    assert command({"rover/rover.ino": SOLVES}) == ""  # on the course's board
    assert command({"notes.txt": ""}) == "python main.py"


@pytest.mark.usefixtures("reads_here", "exact_mission")
@pytest.mark.parametrize("engine", ["docker", "podman"])
def test_boards_have_no_sandbox_of_an_engine(tmp_path: Path, engine: str) -> None:
    file = board_course(tmp_path, {"ada": boards(SOLVES)})
    told = f"^team ada has boards, for which {engine} is no sandbox: grade with --isolation bwrap$"
    with pytest.raises(GradeError, match=told):
        GradeFolder.create(tmp_path / "out", read_course(file), 1, Isolation(engine))
    assert not [*(tmp_path / "out").iterdir()]


@pytest.mark.usefixtures("reads_here")
def test_sketches_are_read_within_limits(
    tmp_path: Path, exact_mission: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That of a team without a set too: it runs on the course's board."""
    read: list[object] = []
    call = SubmissionReader.call

    def noted(self: SubmissionReader, function: Callable[..., object], *given: object) -> object:
        read.append(function)
        return call(self, function, *given)

    monkeypatch.setattr(SubmissionReader, "call", noted)
    file = board_course(tmp_path, {"ada": {"rover.ino": SOLVES}})
    (exact_mission / "wiring.toml").write_text(WIRING, "utf-8")
    with pytest.raises(GradeError, match="no sandbox"):
        GradeFolder.create(tmp_path / "out", read_course(file), 1, Isolation.DOCKER)
    assert read == [check_submission]


@pytest.mark.usefixtures("reads_here", "exact_mission")
def test_boards_do_not_run_on_a_cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grade_folder, "kept_build", lambda goal: BoardBuild())
    file = board_course(tmp_path, {"ada": boards(SOLVES)})
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 1, Isolation.BWRAP)
    with pytest.raises(GradeError, match=r"boards run on this machine alone \(ada\)"):
        on_cluster(folder, None)  # type: ignore[arg-type] - it is not asked


@pytest.mark.usefixtures("reads_here", "exact_mission")
def test_a_machine_without_a_compiler_is_no_teams_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = board_course(tmp_path, {"ada": boards(SOLVES)})
    monkeypatch.setattr(board_build, "find_compiler", lambda: None)
    monkeypatch.setattr("simmer_tui.cli.grade_command.check_isolation", lambda *given: None)
    assert run_grade([str(file), "--out", str(tmp_path / "out")]) == 2
    assert "need g++ or clang++ on this machine: apt install g++" in capsys.readouterr().err
    assert [*(tmp_path / "out").iterdir()] == []
    monkeypatch.setattr(board_build, "find_compiler", lambda: Compiler(("python", "-m", "ziglang", "c++")))
    with pytest.raises(GradeError, match=r"need g\+\+ or clang\+\+ on this machine"):
        BoardCompiler()


@pytest.mark.usefixtures("exact_mission")
def test_a_course_with_boards_has_wheels(tmp_path: Path) -> None:
    file = board_course(tmp_path, {"ada": boards(SOLVES)})
    settings = tmp_path / "set" / "settings.toml"
    settings.write_text(settings.read_text("utf-8").partition("\n[wheels]")[0], "utf-8")
    drives = tmp_path / "set" / "drive.csv"
    drives.write_text(drives.read_text("utf-8").partition("wheels,")[0], "utf-8")
    with pytest.raises(ConfigurationError) as caught:
        GradeFolder.create(tmp_path / "out", read_course(file), 1, Isolation.NONE)
    assert [each.where for each in caught.value.problems] == ["boards", "boards"]
