"""The clock of trials: the program's for a set with a dialect, and the real one where that cannot be."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path

import pytest
from msgspec.structs import replace as changed

from simmer_tui.cli.main import main
from simmer_tui.config.loader import Configuration, find_set, init_set, load
from simmer_tui.config.settings import ELSE_REAL
from simmer_tui.config.settings_file import Override
from simmer_tui.trials.run import TrialRun
from simmer_tui.trials.trial import Trial, TrialResult, clock_sentences, clocks_text, run_clock, timed_seconds

pytest.importorskip("serial")
DIALECT = '[[command]]\nmatch = "w {n}"\ndo = "d1-{n}"\ndone = "ok"\n'
# A minute and a half by any clock but the program's.
SLEEPING = """
import serial, time
robot = serial.Serial("COM6", 115200, timeout=20)
time.sleep(90)
robot.write(b"w 2\\n")
assert robot.read(2) == b"ok"
"""
POLLING = """
import select, serial, sys
if sys.platform != "win32":
    select.poll().poll(10)
robot = serial.Serial("COM6", 115200, timeout=20)
robot.write(b"w 1\\n")
assert robot.read(2) == b"ok"
"""


def configuration(tmp_path: Path, clock: str = "") -> Configuration:
    """The default set, with a dialect and perhaps a clock."""
    folder = tmp_path / "set"
    if not folder.exists():
        init_set(folder, find_set("default"))
        (folder / "dialect.toml").write_text(DIALECT, "utf-8")
    return load(folder, {"motion.clock": Override("--clock", clock)} if clock else {})


def command_of(tmp_path: Path, lines: str) -> str:
    path = tmp_path / "program.py"
    path.write_text(lines, "utf-8")
    return shlex.join([sys.executable, str(path)])


def result_of(tmp_path: Path, lines: str, clock: str = "") -> TrialResult:
    trial = Trial(
        number=1,
        seed=1,
        configuration=configuration(tmp_path, clock),
        maze="",
        command=command_of(tmp_path, lines),
        fixed_ports=False,
        time_limit=60.0,
    )
    return TrialRun(trial, tmp_path).run()


def test_a_set_with_a_dialect_has_the_programs_clock_by_itself(tmp_path: Path) -> None:
    result = result_of(tmp_path, SLEEPING)
    assert (result.success, result.clock, result.clock_note) == (True, "program", "")
    assert result.time > 90
    again = result_of(tmp_path, SLEEPING)
    same = {"real_seconds": 0.0, "simulator_seconds": 0.0}
    assert changed(again, **same) == changed(result, **same)


def test_a_program_that_cannot_run_under_it_fails_and_is_told_why(tmp_path: Path) -> None:
    result = result_of(tmp_path, POLLING)
    assert (result.success, result.clock) == (False, "program")
    assert result.clock_note.endswith(": select.poll waits by a clock of its own")
    said = " ".join(clock_sentences(configuration(tmp_path), [result]))
    assert f'clock = "{ELSE_REAL}"' in said


def test_such_a_program_is_repeated_under_the_real_clock_where_that_is_allowed(tmp_path: Path) -> None:
    result = result_of(tmp_path, POLLING, ELSE_REAL)
    assert (result.success, result.clock) == (True, "real")
    assert result.clock_note.endswith(": select.poll waits by a clock of its own")
    said = " ".join(clock_sentences(configuration(tmp_path, ELSE_REAL), [result]))
    assert "1 run went by the real clock: program.py:4: select.poll" in said
    log = (tmp_path / "0001.jsonl").read_text("utf-8")
    assert "select.poll" not in log  # of the second attempt alone
    assert clocks_text([result, changed(result, clock="program")]) == "program (1), real (1)"


def test_other_sets_keep_their_clock(tmp_path: Path) -> None:
    assert run_clock(load(find_set("default"))) == "real"
    assert run_clock(configuration(tmp_path, "real")) == "real"
    assert run_clock(configuration(tmp_path)) == "program"
    assert timed_seconds(load(find_set("mission"))) == 0.0


@pytest.mark.slow
def test_table_page_and_json_name_the_clock(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    configuration(tmp_path)
    out = tmp_path / "trials"
    words = ["trials", "--config", str(tmp_path / "set"), "--run", command_of(tmp_path, SLEEPING)]
    assert main([*words, "--runs", "2", "--jobs", "2", "--out", str(out), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["trials"]["clock"] == "program"
    assert {each["clock"] for each in answer["runs"]} == {"program"}
    assert "program's clock" in answer["text"]["computing"]
    assert "clock: program" in next(out.glob("*.html")).read_text("utf-8")


@pytest.mark.slow
def test_grades_name_the_clock_and_repeat_where_allowed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "course-set"
    init_set(folder, find_set("mission"))
    settings = (folder / "settings.toml").read_text("utf-8")
    assert "[motion]" in settings
    (folder / "settings.toml").write_text(
        settings.replace("[motion]", f'[motion]\nclock = "{ELSE_REAL}"', 1), "utf-8"
    )
    team = tmp_path / "teams" / "one"
    team.mkdir(parents=True)
    (team / "robot.py").write_text(
        "import select\nfrom simmer_tui.client import Robot\n"
        "robot = Robot()\nrobot.read('u1')\nselect.poll().poll(10)\n",
        "utf-8",
    )
    course = tmp_path / "course.toml"
    course.write_text(
        f'set = "{folder}"\nteams = "teams"\ncommand = "{sys.executable} robot.py"\n'
        "[decide]\nrequire = 0.5\ncap = 2\nrisk = 0.4\nmargin = 0.4\n",
        "utf-8",
    )
    out = tmp_path / "grading"
    main(["grade", str(course), "--isolation", "none", "--out", str(out), "--json"])
    answer = json.loads(capsys.readouterr().out)
    assert answer["grades"][0]["clock"] == "real"
    page = (out / "site" / "index.html").read_text("utf-8")
    assert "went by the real clock" in page
