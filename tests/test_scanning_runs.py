"""A run whose program reads a lidar: run again, taken over, reported, compared, tried often."""

from __future__ import annotations

import csv
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from simmer_tui import Simulator, load
from simmer_tui.cli.main import main
from simmer_tui.config.sets import find_set, init_set
from simmer_tui.live.takeover import TakeOver, moment_at
from simmer_tui.run.events import CommandResult
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.log_records import BrokenLine
from simmer_tui.runlog.reader import LogReader
from tests.in_process import simmer

PROGRAM = """
import sys
from simmer_tui.client import Robot

with Robot(protocol=sys.argv[1]) as robot:
    for _ in range(12):
        ranges = robot.scan("sc")
        left = robot.send("sc-90")
        robot.drive("r1", 25 if left > 8 else -25)
        if ranges[0] > 8:
            robot.drive("d1", 2)
"""


def logged(folder: Path, name: str, seed: int, protocol: str = "binary") -> Path:
    program, log = folder / "program.py", folder / name
    program.write_text(PROGRAM)
    done = simmer(
        *("--no-ui", "--config", "lidar", "--port", 0, "--listeners", "binary,packets", "--seed", seed),
        *("--log", log, "--run", f"{sys.executable} {program} {protocol}"),
    )
    assert done.returncode == 0, done.stderr
    return log


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return logged(tmp_path_factory.mktemp("run"), "run.jsonl", 3)


def said(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    capsys.readouterr()
    assert main([*map(str, arguments)]) == 0
    return capsys.readouterr().out


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("protocol", ["binary", "packets"])
def test_it_repeats_exactly(tmp_path: Path, capsys: pytest.CaptureFixture[str], protocol: str) -> None:
    again = logged(tmp_path, "run.jsonl", 5, protocol)
    assert "every reply the same" in said(capsys, "rerun", again)
    with LogReader(again) as reader:
        results = [each.event for each in reader if not isinstance(each, BrokenLine)]
    scans = [each for each in results if isinstance(each, CommandResult) and each.ranges is not None]
    assert len(scans) == 12
    assert {len(each.ranges) for each in scans if each.ranges is not None} == {360}


def test_it_is_taken_over_at_any_moment(log: Path) -> None:
    with RunLogIndex(log) as index:
        for elapsed in np.linspace(0.0, index.duration, 3).tolist():
            TakeOver(log, moment_at(index, elapsed)).check()


def test_it_is_reported_in_every_form(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "lidar1" in said(capsys, "report", log)
    told = json.loads(said(capsys, "report", log, "--json"))
    rows = json.dumps(told)
    assert "sc lidar1" in rows
    table, page = tmp_path / "run.csv", tmp_path / "run.html"
    said(capsys, "report", log, "--csv", table, "--html", page)
    with table.open() as file:
        commands = list(csv.DictReader(file))
    assert [float(each["reply"]) > 0 for each in commands if each["command"] == "sc"] == [True] * 12
    assert "sc lidar1" in page.read_text()


@pytest.mark.slow
def test_it_is_tried_often_and_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    command = f"{sys.executable} {program} binary"
    for name in ("one", "two"):
        done = simmer(
            *("trials", "--run", command, "--config", "lidar", "--runs", 2, "--seed", 1),
            *("--out", tmp_path / name),
        )
        assert done.returncode == 0, done.stdout + done.stderr
    logs = sorted((tmp_path / "one" / "runs").glob("*.jsonl"))
    assert len(logs) == 2
    for each in logs:
        assert "every reply the same" in said(capsys, "rerun", each)
    said(capsys, "compare", tmp_path / "one", tmp_path / "two")


@pytest.mark.slow
def test_on_a_serial_line_a_scan_takes_the_time_of_its_bytes(tmp_path: Path) -> None:
    pytest.importorskip("serial")
    folder, program = tmp_path / "set", tmp_path / "program.py"
    init_set(folder, find_set("lidar"))
    (folder / "dialect.toml").write_text('[frame]\nkind = "binary9000"\n')
    program.write_text(
        "import serial, time\n"
        "line = serial.Serial('COM6', 9600, timeout=60)\n"
        "begun = time.monotonic()\n"
        "line.write(b'sc\\n')\n"
        "print(len(line.read(8 + 360 * 8)), round(time.monotonic() - begun, 1))\n"
    )
    done = simmer(
        *("--no-ui", "--quiet", "--config", folder, "--port", 0, "--seed", 7, "--clock", "program"),
        *("--run", f"{sys.executable} {program}"),
    )
    assert done.stdout.splitlines() == ["2888 3.0"], done.stderr


def test_a_reading_in_a_notebook_has_arrays() -> None:
    reading = Simulator(load("lidar"), seed=2).execute("sc").reading
    assert reading is not None
    assert reading.scan is not None
    scan = reading.scan
    assert [each.shape for each in (scan.ranges, scan.bearings, scan.true, scan.poses)] == [
        *[(360,)] * 3,
        (360, 3),
    ]
    assert {each.dtype for each in (scan.ranges, scan.bearings, scan.true, scan.poses)} == {np.dtype(float)}
    assert os.linesep not in repr(Simulator(load("lidar"), seed=2).execute("sc"))
