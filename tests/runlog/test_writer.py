"""A log holds what happened, line by line, the moment it happens, and never harms the run."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simmer_tui.errors import RunLogError
from simmer_tui.events import NoticeKind
from simmer_tui.runlog.entries import CommandEntry, parse_entry
from simmer_tui.runlog.numbers import list_text, number, number_text, numbers
from simmer_tui.runlog.writer import RunLog, auto_path
from simmer_tui.sim import Command, Outcome, Pose, Simulator, Status
from simmer_tui.version import __version__


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def same(a: float, b: float) -> bool:
    return (
        math.isnan(a) and math.isnan(b) if math.isnan(a) or math.isnan(b) else a == b and repr(a) == repr(b)
    )


@given(st.lists(st.floats()))
def test_numbers_read_back_to_the_last_bit(values: list[float]) -> None:
    read = numbers(json.loads(list_text(values)))
    assert len(read) == len(values)
    assert all(same(a, b) for a, b in zip(values, read, strict=True))
    assert all(same(number(json.loads(number_text(value))), value) for value in values)


def test_numpy_scalars_are_written_as_plain_numbers() -> None:
    assert number_text(np.float64(0.1)) == "0.1"
    assert list_text([np.float32(0.5), 2]) == "[0.5,2.0]"


@given(st.text(st.characters()))
def test_any_text_of_a_client_reads_back(text: str) -> None:
    from simmer_tui.runlog.lines import command_line

    pose = Pose(1.0, 2.0, 3.0)
    outcome = Outcome(1, 0.0, Command(text), Status.REFUSED, math.nan, pose, pose, text)
    line = command_line(outcome, 1.0)
    assert line.isascii()
    assert "\n" not in line
    entry = parse_entry(line.encode(), 2)
    assert isinstance(entry, CommandEntry)
    assert (entry.command, entry.reason) == (text, text)


def test_the_header_says_what_ran(start_run: Any, configuration: Any) -> None:
    run = start_run()
    [header] = lines(run.path)
    assert (header["kind"], header["format"], header["program"]) == ("header", 1, __version__)
    assert header["seed"] == 7
    assert set(header["files"]) == {"maze.csv", "robot.csv", "sensors.csv", "drive.csv", "settings.toml"}
    for name, text in header["files"].items():
        assert (configuration.directory / name).read_bytes().decode() == text
    assert header["settings"]["bot_center"] == [9.5, 42.0]
    assert datetime.fromisoformat(header["start"]).tzinfo is not None


def test_every_line_is_in_the_file_at_once(start_run: Any) -> None:
    run = start_run()
    for count, text in enumerate(("u1", "d1-2", "zz", "i1"), 2):
        run.send(text)
        data = run.path.read_bytes()
        assert data.endswith(b"\n")
        assert data.count(b"\n") == run.log.lines == count


def test_lines_hold_what_the_simulator_said(start_run: Any) -> None:
    run = start_run()
    outcomes: list[Outcome] = []
    run.engine.watch(outcomes.append)
    run.send("u1", "i1", "d1-60", "zz")
    reading, line_reading, movement, unknown = lines(run.path)[1:]
    assert reading["reply"] == outcomes[0].reply
    assert reading["true"] == outcomes[0].reading.true
    assert reading["rays"]["distances"] == list(outcomes[0].reading.view.distances)
    view = outcomes[1].reading.view
    assert line_reading["points"]["black"] == "".join(str(int(black)) for black in view.black)
    assert movement["reply"] == "inf"
    assert movement["contact"] == list(outcomes[2].contact.point)
    assert movement["path"][0] == movement["before"][:2] == [9.5, 42.0]
    assert movement["path"][-1] == movement["pose"][:2]
    assert unknown["reply"] == "nan"
    assert "zz" in unknown["reason"]


def test_paths_of_many_segments_are_thinned(tmp_path: Path, configuration: Any) -> None:
    from dataclasses import replace

    simulator = Simulator(replace(configuration.simulation, num_segments=1000), 7)
    with RunLog(tmp_path / "long.jsonl", configuration, simulator) as log:
        outcome = simulator.execute("d1-8")
        log(outcome)
    path = lines(log.path)[1]["path"]
    assert 20 < len(path) <= 42
    assert path[0] == [9.5, 42.0]
    assert path[-1] == [outcome.pose.x, outcome.pose.y]


def test_an_existing_log_is_never_overwritten(start_run: Any, configuration: Any) -> None:
    run = start_run()
    before = run.path.read_bytes()
    with pytest.raises(RunLogError, match="exists already"):
        RunLog(run.path, configuration, run.simulator)
    assert run.path.read_bytes() == before


@pytest.mark.parametrize("name", ["no/such/folder/run.jsonl", "nul\0.jsonl", "."])
def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, configuration: Any, name: str) -> None:
    with pytest.raises(RunLogError, match="cannot log to"):
        RunLog(tmp_path / name, configuration, Simulator(configuration.simulation, 1))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_disk_full_at_the_start_is_an_error(configuration: Any) -> None:
    with pytest.raises(RunLogError, match="No space left"):
        RunLog(Path("/dev/full"), configuration, Simulator(configuration.simulation, 1))


LIMITED = """
import resource, sys
from pathlib import Path
from simmer_tui.config import load_default
from simmer_tui.engine import Engine
from simmer_tui.events import Notice, NoticeKind
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator, parse_command

configuration = load_default()
simulator = Simulator(configuration.simulation, 7)
engine = Engine(simulator)
notices, replies = [], []
engine.watch(lambda event: notices.append(event.text) if isinstance(event, Notice) else None)
log = RunLog(Path(sys.argv[1]), configuration, simulator,
             on_stop=lambda why: engine.tell(Notice(NoticeKind.FAULT, why)))
engine.watch(log)
size = Path(sys.argv[1]).stat().st_size
resource.setrlimit(resource.RLIMIT_FSIZE, (size + 5000, size + 5000))
session = engine.session()
for _ in range(100):
    session.submit(parse_command("u1"), replies.append)
print(len(replies), len(notices), bool(log.stopped), notices[0])
"""


@pytest.mark.skipif(sys.platform == "win32", reason="limits of a file's size are Unix's")
def test_the_run_goes_on_when_the_log_cannot_grow(tmp_path: Path) -> None:
    path = tmp_path / "full.jsonl"
    program = tmp_path / "limited.py"
    program.write_text(LIMITED)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, str(program), str(path)], capture_output=True, text=True, env=environment, check=True
    )
    replies, notices, stopped, what = done.stdout.split(" ", 3)
    assert (replies, notices, stopped) == ("100", "1", "True")
    assert "has stopped" in what
    whole = path.read_bytes().split(b"\n")[1:-1]
    assert whole
    assert all(isinstance(parse_entry(line, 2), CommandEntry) for line in whole)


def test_a_closed_log_takes_no_more(start_run: Any) -> None:
    run = start_run()
    run.log.close()
    run.log.close()
    run.send("u1")
    assert len(lines(run.path)) == 1
    assert NoticeKind.FAULT not in lines(run.path)


def test_auto_names_new_files_by_date(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platformdirs, "user_data_path", lambda name, appauthor: tmp_path / name)
    now = datetime(2025, 11, 21, 10, 5, 9)
    first = auto_path(now)
    assert first == tmp_path / "simmer-tui" / "logs" / "2025-11-21_10-05-09.jsonl"
    first.touch()
    assert auto_path(now).name == "2025-11-21_10-05-09_2.jsonl"


def test_auto_says_when_its_folder_cannot_be_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "simmer-tui").write_text("a file in the way")
    monkeypatch.setattr(platformdirs, "user_data_path", lambda name, appauthor: tmp_path / name)
    with pytest.raises(RunLogError, match="cannot be made"):
        auto_path()
