"""Trials of a set whose boards drive the robot: refusals, and runs with and without a laptop program."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.cli.main import main
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.trials.folder import TrialFolder
from tests.sketch.rovers import DRIVE, MOTORS, ROVER, STOPPABLE, made_set

with_compiler = pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
ALONE = (
    DRIVE
    + "void setup() {}\nvoid loop() {\n  drive(120, 100); delay(400); drive(-100, -90); delay(300);\n}\n"
)
DIES = "void setup() {}\nvoid loop() {\n  delay(100);\n  volatile int *place = 0; *place = 1;\n}\n"
LAPTOP = """
import serial, time
port = serial.Serial("COM6", 9600, timeout=1)
for what, pause in ((b"F", 0.4), (b"B", 0.3), (b"S", 0.2)):
    time.sleep(0.1); port.write(what); time.sleep(pause)
"""


def trials(folder: Path, *options: str) -> int:
    return main(["trials", "--sketch", str(folder), "--seed", "3", *options])


def records(log: Path) -> Iterator[dict[str, Any]]:
    """The records of a log without what is of the real clock, or of the system's ports."""
    for line in log.read_text("utf-8").splitlines()[1:]:
        record = json.loads(line)
        yield {key: record[key] for key in record if key not in ("real", "subject")}


def test_boards_are_refused_in_one_line_before_anything_is_compiled(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = tmp_path / "set", tmp_path / "out"
    made_set(folder, ROVER + MOTORS, {"rover.ino": STOPPABLE})

    def refusal(*options: str) -> str:
        assert trials(folder, "--out", str(out), *options) == 2
        assert not out.exists()
        return capsys.readouterr().err

    assert "leave --config out" in refusal("--config", "mission")
    assert "leave --serial out" in refusal("--serial", "/dev/nosuch")
    assert "--run 'nosuch-program'" in refusal("--run", "nosuch-program")
    (folder / "mission.toml").unlink()
    alone = refusal()
    assert "boards without a program need a mission" in alone
    assert alone.count("\n") == 1
    (folder / "wiring.toml").unlink()
    assert "has no wiring.toml" in refusal("--run", sys.executable)


@pytest.mark.slow
@with_compiler
def test_a_laptop_program_and_its_board_repeat_with_any_number_of_workers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, program = tmp_path / "set", tmp_path / "laptop.py"
    made_set(folder, ROVER + MOTORS, {"rover.ino": STOPPABLE})
    (folder / "mission.toml").unlink()
    program.write_text(LAPTOP, "utf-8")
    outs = [tmp_path / name for name in ("one", "two")]
    command = f"{sys.executable} {program}"
    for jobs, out in enumerate(outs, 1):
        assert trials(folder, "--run", command, "--runs", "2", "--jobs", str(jobs), "--out", str(out)) == 0
    read = [TrialFolder.read(out) for out in outs]
    assert [[each.success for each in one.done] for one in read] == [[True, True]] * 2
    assert {each.clock for one in read for each in one.done} == {"program"}
    assert [each.end for each in read[0].done] == [each.end for each in read[1].done]
    for number in (1, 2):
        assert list(records(read[0].log(number))) == list(records(read[1].log(number)))
    assert main(["rerun", str(read[0].log(1)), "--sketch", str(folder)]) == 0
    assert "8 facts of the boards repeated, all the same" in capsys.readouterr().err
    # The record of the folder names the sketch: another one does not continue it.
    assert read[0].plan.sketches["rover"].startswith("rover.ino ")
    (folder / "rover.ino").write_text(ALONE, "utf-8")
    assert main(["trials", "--resume", "--out", str(outs[0]), "--runs", "3"]) == 2
    assert "differ from those of these trials (rover: rover.ino " in capsys.readouterr().err
    copied = tmp_path / "copied.jsonl"
    copied.write_bytes(read[0].log(1).read_bytes())
    assert main(["why", str(copied), "--run", command]) == 2
    assert "why runs no boards" in capsys.readouterr().err
    # Results alone need no sketch.
    assert main(["compare", *map(str, outs)]) == 0


@pytest.mark.slow
@with_compiler
def test_boards_alone_run_until_the_end_of_their_mission(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "set"
    # No line to a laptop.
    made_set(folder, ROVER.split("[laptop]")[0] + MOTORS, {"rover.ino": ALONE})
    outs = [tmp_path / name for name in ("one", "two")]
    for jobs, out in enumerate(outs, 1):
        assert trials(folder, "--runs", "2", "--jobs", str(jobs), "--out", str(out)) == 0
    one, two = map(TrialFolder.read, outs)
    assert [each.ending for each in one.done] == ["contacts", "contacts"]
    for number in (1, 2):
        assert list(records(one.log(number))) == list(records(two.log(number)))
    assert main(["rerun", str(one.log(1)), "--sketch", str(folder)]) == 0
    capsys.readouterr()
    varied = "--vary", "wheels.layout=diff,omni-3", "--out", str(tmp_path / "varied")
    assert trials(folder, *varied) == 2
    assert "--vary wheels.layout = omni-3: wiring.toml" in capsys.readouterr().err


@pytest.mark.slow
@with_compiler
def test_a_board_that_dies_ends_the_run_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, program = tmp_path / "set", tmp_path / "laptop.py"
    made_set(folder, ROVER + MOTORS, {"rover.ino": DIES})
    program.write_text("import time\ntime.sleep(1000)\n", "utf-8")
    command = "--run", f"{sys.executable} {program}"
    died = "board rover died at rover.ino:4"
    for name, options in (("alone", ()), ("program", command)):
        out = tmp_path / name
        assert trials(folder, "--runs", "1", "--out", str(out), *options) == 0
        (result,) = TrialFolder.read(out).done
        assert (result.ending, result.reason[: len(died)]) == ("board ended", died)
        assert died in result.verdict["text"]
        assert died in (out / "trials.csv").read_text("utf-8")
        assert died in (out / "report.html").read_text("utf-8")
    (folder / "mission.toml").unlink()
    assert trials(folder, "--runs", "1", "--out", str(tmp_path / "free"), *command) == 0
    (result,) = TrialFolder.read(tmp_path / "free").done
    assert (result.success, result.reason[: len(died)]) == (False, died)
    # Mistakes that the compiler finds are told once, and no folder is made.
    (folder / "rover.ino").write_text("void setup() { nosuch(); }\nvoid loop() {}\n", "utf-8")
    capsys.readouterr()
    assert trials(folder, "--out", str(tmp_path / "none"), *command) == 2
    told = capsys.readouterr().err
    assert told.count("rover.ino:1") == 1
    assert "nosuch" in told
    assert not (tmp_path / "none").exists()
