"""Boards in sandboxes: missions that they do, and sketches that would harm the grader, or other teams.

Each ends without a success and within limits, and is told with its place.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
from msgspec import structs

from simmer_tui.cli.grade_command import run_grade
from simmer_tui.errors import BoardError, GradeError
from simmer_tui.grade import bubblewrap
from simmer_tui.grade.board_build import COMPILE_LIMITS, BoardBuild, BoardCompiler, BoardSketch
from simmer_tui.grade.bubblewrap import Bubblewrap
from simmer_tui.grade.course import read_course
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.grade_run import GradeRun
from simmer_tui.grade.limits import Limits
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.sketch.boards import UNO
from simmer_tui.trials.trial import Ending
from tests.grade.board_course import LAPTOP, OBEYS, SOLVES, WIRING, board_course, boards, with_compiler
from tests.grade.conftest import read_grades
from tests.sketch.rovers import DRIVE

pytestmark = [pytest.mark.slow, with_compiler]
SYSTEM = (
    'extern "C" {\nint fork(); int open(const char*, int, ...); unsigned sleep(unsigned); void _exit(int);\n'
    "int socket(int, int, int); int connect(int, const void*, unsigned); int close(int);\n"
    "void* signal(int, void*); long write(int, const void*, unsigned long);\n}\n"
)
"""Calls of the system, in five lines."""
LIMITS = "[limits]\ntime = 30.0\ncpu = 20.0\nmemory = 300.0\ndisk = 2.0\nprocesses = 20\n"
# By its name in the object file: a `board` of the sketch is the sketch's own.
CLOCK = 'extern unsigned long long clock_now asm("_ZN5board3nowE");\n'
HARMFUL = {
    "dies": ("void setup() { delay(100); volatile int* a = 0; *a = 1; }\n", "died at rover.ino:6 after 0.1"),
    "exits": ("void setup() { delay(100); _exit(0); }\n", "died at rover.ino:6 after 0.1 s: exit code 0"),
    "never begins": ("char room[1000000000L];\nvoid setup() { room[1] = 1; }\n", "could not be started: "),
    "ends before": ("struct A { A() { _exit(5); } } a;\nvoid setup() {}\n", "not be started: exit code 5"),
    "forks": ("void setup() { delay(100); for (;;) fork(); }\n", "rover.ino:6 after 0."),
    "keeps still": (
        "void setup() { delay(100); signal(6, (void*)1); for (;;) sleep(10); }\n",
        "hangs at rover.ino:6 after 0.1 s",
    ),
    "allocates": (
        "void setup() { delay(100); for (;;) { volatile char* a = new char[1000000]; *a = 1; } }\n",
        "died at rover.ino:6 after 0.1",
    ),
    "writes files": (
        'void setup() { delay(100); static char b[9999]; int f = open("/robot/a", 577, 438);\n'
        "for (;;) write(f, b, 9999); }\n",
        "died at rover.ino:6 after 0.1 s: it wrote more than it may",
    ),
    "writes to the channel": (
        "void setup() { delay(100); static char b[4096]; memset(b, 37, 4096);\n"
        "for (;;) for (int f = 3; f < 9; f++) write(f, b, 4096); }\n",
        "was ended at rover.ino:6 after 0.1 s: its clock went where it may not",
    ),
    "writes errors": (
        "void setup() { delay(100); static char b[4096]; for (int f = 3; f < 9; f++) close(f);\n"
        "for (;;) write(2, b, 4096); }\n",
        "hangs at rover.ino:6 after 0.1 s",
    ),
    "turns back the clock": (
        CLOCK + "void setup() { pinMode(5, OUTPUT); delay(100); clock_now = 5; digitalWrite(5, HIGH); }\n",
        "was ended at rover.ino:7 after 0.1",
    ),
}


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A folder that the user of a sandbox can reach."""
    for each in (tmp_path, *tmp_path.parents):
        if each.owner() == tmp_path.owner() and each != Path(each.anchor) and each.name != "tmp":
            each.chmod(each.stat().st_mode | 0o055)
    return tmp_path


def graded(course: Path, out: Path, *options: str) -> dict[str, dict[str, str]]:
    run_grade([str(course), "--out", str(out), "--seed", "7", *options])
    return read_grades(out)


@pytest.mark.usefixtures("isolation", "exact_mission")
def test_boards_do_a_mission_alone_and_with_a_program(tmp_path: Path) -> None:
    teams = {
        "alone": boards(SOLVES),
        "with a tab": {**boards(SOLVES.replace(DRIVE, "")), "motors.ino": DRIVE},
        "both": {**boards(OBEYS), "main.py": LAPTOP},
        "on the course's board": {"rover.ino": SOLVES},
    }
    course = board_course(tmp_path, teams)
    (tmp_path / "set" / "wiring.toml").write_text(WIRING, "utf-8")
    rows = graded(course, tmp_path / "out")
    assert {name: row["status"] for name, row in rows.items()} == dict.fromkeys(teams, "passed"), rows
    assert {row["clock"] for row in rows.values()} == {"program"}
    # A grading that is resumed needs no compiler, and one with the same seed gives the same.
    folder = GradeFolder.read(tmp_path / "out")
    assert [each.check.problems for each in folder.entries] == [()] * len(teams)
    again = graded(course, tmp_path / "again")
    assert again == rows
    # The command python is another one without a sandbox, so the board alone is asked.
    none = graded(course, tmp_path / "none", "--isolation", "none")
    assert none["alone"]["status"] == "passed"


@pytest.mark.usefixtures("isolation", "exact_mission")
def test_a_team_is_graded_again_with_another_program_or_sketch(tmp_path: Path) -> None:
    """As a new grading with the same seed, and the other team's row stays."""
    teams = {
        "alone": boards(SOLVES),
        "both": {**boards(OBEYS), "main.py": LAPTOP.replace('(b"C", 1.0), ', "")},
    }
    course = board_course(tmp_path, teams)
    out = tmp_path / "out"
    first = graded(course, out)
    assert {name: row["status"] for name, row in first.items()} == {"alone": "passed", "both": "failed"}
    (tmp_path / "teams" / "both" / "main.py").write_text(LAPTOP, "utf-8")
    assert run_grade(["--regrade", "both", "--out", str(out)]) == 0
    rows = read_grades(out)
    assert rows["alone"] == first["alone"]
    assert rows["both"]["status"] == "passed"
    with (tmp_path / "teams" / "alone" / "rover.ino").open("a", encoding="utf-8") as file:
        file.write("int x = ;\n")
    run_grade(["--regrade", "alone", "--out", str(out)])
    refused = read_grades(out)["alone"]
    assert (refused["status"], refused["runs"]) == ("refused", "0")
    assert "rover.ino:17: expected primary-expression" in refused["problem"]
    # A row of a team that was graded again is the one of a grading from the start.
    assert graded(course, tmp_path / "new")["both"] == rows["both"]


@pytest.mark.usefixtures("isolation", "exact_mission")
def test_harm_is_told_with_its_place_and_ends_within_limits(tmp_path: Path) -> None:
    loop = "void loop() { delay(100); }\n"
    teams = {name: boards(SYSTEM + text + loop) for name, (text, _) in HARMFUL.items()}
    rows = graded(board_course(tmp_path, {**teams, "good": boards(SOLVES)}, LIMITS), tmp_path / "out")
    assert {name: rows[name]["status"] for name in teams} == dict.fromkeys(teams, "failed")
    wrong = {
        name: rows[name]["main_cause"]
        for name, (_, told) in HARMFUL.items()
        if told not in rows[name]["main_cause"]
    }
    assert not wrong
    assert rows["good"]["status"] == "passed"


@pytest.mark.usefixtures("isolation", "exact_mission")
def test_a_board_sees_its_sketch_and_no_network(tmp_path: Path) -> None:
    """It prints what it can open and reach; the laptop's program keeps it as its output."""
    asks = (
        f'void setup() {{ Serial.begin(9600); const char* all[] = {{"{tmp_path}/out/grade.json", '
        f'"{tmp_path}/teams/good/rover.ino", "/program/rover.ino", "/program/board.exe", "/etc/hosts"}};\n'
        "for (auto each : all) Serial.print(open(each, 0) >= 0);\n"
        "unsigned char a[16] = {2, 0, 0, 53, 127, 0, 0, 53}; Serial.print(connect(socket(2, 1, 0), a, 16));\n"
        "Serial.print(socket(17, 3, 0)); Serial.print('!'); }\nvoid loop() { delay(100); }\n"
    )
    shows = (
        'import serial\nport = serial.Serial("COM6", 9600, timeout=5)\n'
        'print(port.read_until(b"!").decode(), flush=True)\n'
    )
    teams = {"good": boards(SOLVES), "spy": {**boards(SYSTEM + asks), "main.py": shows}}
    graded(board_course(tmp_path, teams), tmp_path / "out")
    told = (tmp_path / "out" / "runs" / "spy" / "0001.txt").read_text("utf-8")
    # Its compiled sketch alone; no connection, and no socket of a family that no namespace confines.
    assert "00010-1-1!" in told


# -- compilers -------------------------------------------------------------------------------------

END = "void setup() {}\nvoid loop() {}\n"
BOMB = "#if __INCLUDE_LEVEL__ < 60\n" + '#include "bomb.h"\n' * 2 + "#endif\n"


def built(home: Path, files: dict[str, str], limits: Limits = COMPILE_LIMITS) -> BoardBuild:
    for name, text in files.items():
        (home / "files").mkdir(exist_ok=True)
        (home / "files" / name).write_text(text, "utf-8")
    place = BoardSketch("rover.ino", UNO, "wiring.toml:2:boards.rover.sketch")
    (build,) = BoardCompiler((), limits).build_all([(home / "files", home / "boards", {"rover": place})])
    return build


@pytest.mark.usefixtures("isolation")
@pytest.mark.parametrize(
    ("sketch", "told"),
    [
        ('#include "/etc/passwd"\n', "rover.ino:1: there is no library with /etc/passwd"),
        ('#define A "/etc/passwd"\n#include A\n', "rover.ino:"),
        ('#define A "/dev/zero"\n#include A\n', "boards.rover.sketch: its compiler was ended: it took more"),
        ('#include "bomb.h"\n', "boards.rover.sketch: its compiler was ended: it took more than 3 s"),
        ('asm(".incbin \\"/etc/shadow\\"");\n', "rover.ino: "),
        ("char big[50000000L] = {1};\nchar more[50000000L] = {1};\n", "its compiler was ended: it took more"),
        ("void wrong() { nosuch(); }\n", "rover.ino:1: 'nosuch' was not declared"),
    ],
)
def test_what_a_compiler_may_not_do(home: Path, sketch: str, told: str) -> None:
    limits = Limits(time=60.0, cpu=3.0, memory=500.0, disk=64.0, processes=32)
    build = built(home, {"rover.ino": sketch + END, "bomb.h": BOMB}, limits)
    assert not build.built
    assert told in str(build.problems[0]), build.problems
    assert "root:" not in "".join(map(str, build.problems))


@pytest.mark.usefixtures("isolation")
def test_a_compiled_sketch_is_kept_and_its_lines_are_known(home: Path) -> None:
    text = DRIVE + "void setup() { delay(5); }\nvoid loop() {\n  delay(100);\n  drive(9, 9);\n}\n"
    build = built(home, {"rover.ino": text})
    assert not build.problems
    program = build.built["rover"].program
    (home / "files" / "rover.ino").write_text("no sketch", "utf-8")
    assert built(home, {}) == build
    with closing(Bubblewrap(program.parent, Limits())) as sandbox:
        board = sandbox.board("rover", program, [])
        board.receive()
        board.grant(500_000_000, [], 0.0, 0)
        board.receive()
        lines = text.splitlines()
        name, _, number = board.line_of(board.place).partition(":")
        assert name == "rover.ino"
        assert "analogWrite" in lines[int(number) - 1] or "d" in lines[int(number) - 1]
        assert board.line_of(0) == board.line_of(2**32 - 1) == ""


@pytest.mark.usefixtures("isolation")
def test_a_compiler_that_runs_out_of_real_time_is_asked_again(home: Path) -> None:
    """Another's work may have held it up."""
    build = built(home, {"rover.ino": END}, structs.replace(COMPILE_LIMITS, time=0.001))
    assert str(build.problems[0]).endswith("it took more than 0.001 s; grade again when this machine is idle")
    assert built(home, {}).built


@pytest.mark.usefixtures("isolation")
def test_a_board_without_a_sandbox_is_told_as_that(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bubblewrap, "COMMAND", "no-such-command")
    sandbox = Bubblewrap(home, Limits())
    board = sandbox.board("rover", home / "board.exe", [])
    with pytest.raises(BoardError, match=r"^board rover could not be started: no-such-command"):
        board.receive()
    assert sandbox.boards.fault.startswith("a board has no sandbox: no-such-command")
    sandbox.close()


@pytest.mark.usefixtures("isolation", "exact_mission")
def test_a_machine_without_sandboxes_for_boards_is_no_teams_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    course = read_course(board_course(tmp_path, {"ada": boards(SOLVES)}))
    folder = GradeFolder.create(tmp_path / "out", course, 1, Isolation.BWRAP)
    trial = folder.trial(folder.entries[0], 1)

    def refused(self: Bubblewrap, *given: object) -> None:
        raise GradeError("no room")

    monkeypatch.setattr(Bubblewrap, "start_piped", refused)
    result = GradeRun(trial, folder.runs).run()
    assert (result.ending, result.success) == (Ending.FAULT, False)
    assert "a board has no sandbox: no room" in result.reason
    assert not [each for each in (folder.runs / "ada").iterdir() if each.suffix == ".txt"]
