"""A drive is a member of `DriveKind`: a copy of the package gets one, and nothing else in it is edited."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from simmer_tui.config.sets import bundled_folder, init_set
from tests.test_made_up_sensor import ROOT, cli

BEFORE = '    ROT = "rot", Axes(r=1.0), "turn counter-clockwise"\n'
MEMBER = '    CREEP = "creep", Axes(x=-1.0), "creep back"\n'
PROGRAM = """
from simmer_tui.client import Robot

with Robot() as robot:
    for step in range(20):
        robot.read("u1", "u2", "o1", "o3", "g1")
        robot.send(("q1-3", "q1--3", "r1-20", "r1--20")[step % 4])
    robot.send("q1--40")
"""


@pytest.mark.slow
def test_a_drive_costs_one_line(tmp_path: Path) -> None:
    for name in ("simmer_tui", "config"):
        shutil.copytree(ROOT / name, tmp_path / name)
    specs = tmp_path / "simmer_tui" / "sim" / "specs.py"
    text = specs.read_text()
    assert BEFORE in text
    specs.write_text(text.replace(BEFORE, BEFORE + MEMBER))
    made, log, program = tmp_path / "set", tmp_path / "run.jsonl", tmp_path / "program.py"
    init_set(made, bundled_folder())
    rows = made / "drive.csv"
    rows.write_text(f"{rows.read_text()}creep,q1,1,0.02,0.02,0.02,0,0,0\n")
    program.write_text(PROGRAM)
    assert "creep back" in cli(tmp_path, "check", made)
    run = f"{sys.executable} {program}"
    cli(tmp_path, *("--no-ui", "--port", 0, "--config", made, "--seed", 5, "--log", log, "--run", run))
    assert "q1    creep back" in cli(tmp_path, "report", log)
    assert "every reply the same" in cli(tmp_path, "rerun", log)
    assert "creep" in cli(tmp_path, "calibrate", log, "--out", tmp_path / "learned")
