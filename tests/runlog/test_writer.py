"""A log holds what happened, line by line, the moment it happens, and never harms the run."""

from __future__ import annotations

import gzip
import json
import math
import os
import subprocess
import sys
import zlib
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.errors import RunLogError
from simmer_tui.links.belief_parser import parse_belief
from simmer_tui.run.events import NoticeKind
from simmer_tui.runlog.encode import LogEncoder
from simmer_tui.runlog.line_form import NUMBER_FORM
from simmer_tui.runlog.log_records import (
    AnswerRecord,
    BeliefRecord,
    ReadingRecord,
    decode_line,
    encode_line,
    packed_particles,
    unpacked_particles,
)
from simmer_tui.runlog.writer import FLUSH_EVERY, LOOK_EVERY, RunLog, auto_path
from simmer_tui.sim import Command, CommandResult, Pose, Simulator, Status
from simmer_tui.version import __version__

if sys.platform != "win32":
    import fcntl


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def same(a: float, b: float) -> bool:
    return (
        math.isnan(a) and math.isnan(b) if math.isnan(a) or math.isnan(b) else a == b and repr(a) == repr(b)
    )


@given(st.floats())
def test_numbers_read_back_to_the_last_bit(value: float) -> None:
    line = encode_line(ReadingRecord(0.0, n=1, command="u1", reply=NUMBER_FORM.written(value)))
    record = decode_line(line, 2)
    assert isinstance(record, ReadingRecord)
    assert same(value, float(record.reply))


def test_numpy_scalars_are_written_as_plain_numbers() -> None:
    record = BeliefRecord(
        np.float64(0.5), believed=(np.float32(0.5), np.int64(2), 1.0), pose=(0.0, 0.0, np.float64(0.1))
    )
    fields = json.loads(encode_line(record))
    assert (fields["t"], fields["believed"], fields["pose"]) == (0.5, [0.5, 2, 1.0], [0.0, 0.0, 0.1])


NEAR = st.floats(-1e6, 1e6)


@settings(max_examples=12)
@given(st.lists(st.tuples(NEAR, NEAR) | st.tuples(NEAR, NEAR, NEAR)), st.tuples(*[st.floats(-1e6, 1e6)] * 3))
def test_particles_read_back_as_they_came_in(
    particles: list[tuple[float, ...]], believed: tuple[float, float, float]
) -> None:
    names = ("x", "y", "heading")
    told = {**dict(zip(names, believed, strict=True)), "particles": particles}
    belief = parse_belief(json.dumps(told).encode(), 0.0, Pose(0.0, 0.0, 0.0), (0.0, 0.0, 96.0, 48.0))
    place = (belief.pose.x, belief.pose.y, belief.pose.heading)
    assert place == tuple(round(value, 2) for value in believed)
    record = BeliefRecord(
        0.0, believed=place, pose=place, particles=packed_particles(belief.particles, place)
    )
    back = decode_line(encode_line(record), 2)
    assert isinstance(back, BeliefRecord)
    assert repr(unpacked_particles(back)) == repr(belief.particles)


@settings(max_examples=15)
@given(st.text(st.characters()))
def test_any_text_of_a_client_reads_back(text: str) -> None:
    pose = Pose(1.0, 2.0, 3.0)
    outcome = CommandResult(1, 0.0, Command(text), Status.REFUSED, math.nan, pose, pose, text)
    [record] = LogEncoder((1.0, 2.0, 3.0), lambda: (0, 0.0)).records(outcome, 1.0)
    written = encode_line(record)
    assert written.isascii()
    assert written.index(b"\n") == len(written) - 1
    line = decode_line(written, 2)
    assert isinstance(line, AnswerRecord)
    assert (line.command, line.reason) == (text, text)


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
    for count, text in ((2, "u1"), (4, "d1-2"), (5, "zz"), (6, "i1")):
        run.send(text)
        data = run.path.read_bytes()
        assert data.endswith(b"\n")
        assert data.count(b"\n") == run.log.lines == count


def test_lines_hold_what_the_simulator_said(start_run: Any) -> None:
    run = start_run()
    run.send("u1", "i1", "d1-60", "zz")
    outcomes: list[Any] = [event for event in run.events if isinstance(event, CommandResult)]
    reading, line_reading, plan, movement, unknown = lines(run.path)[1:]
    assert reading["reply"] == outcomes[0].reply
    assert reading["true"] == outcomes[0].reading.true
    assert line_reading["true"] == outcomes[1].reading.true
    pose, contact = outcomes[2].pose, outcomes[2].contact
    assert movement["pose"] == [pose.x, pose.y, pose.heading]
    assert (plan["t"], movement["begin"]) == (outcomes[2].taken,) * 2
    assert (movement["begin"], movement["t"]) == (outcomes[2].taken, outcomes[2].time)
    assert movement["contact"]["point"] == list(contact.point)
    assert movement["contact"]["t"] == contact.time
    assert (unknown["status"], unknown["reply"]) == ("unknown", "nan")
    assert "zz" in unknown["reason"]


def test_a_timed_movement_is_told_when_it_begins_and_when_it_ends(start_run: Any) -> None:
    run = start_run(timed=True, answer_at_end=False)
    run.send("d1-3")
    assert [line["kind"] for line in lines(run.path)[1:]] == ["plan", "answer"]
    run.loop.run_until(run.loop.now + 3.0)
    plan, answer, end = lines(run.path)[1:]
    assert (answer["status"], end["kind"], end["answers"]) == ("accepted", "end", False)
    assert (end["n"], end["t"]) == (plan["n"], 0.5)


@pytest.mark.parametrize(
    ("damage", "said"),
    [(Path.unlink, "has been deleted"), (lambda path: os.truncate(path, 100), "been cut to")],
)
@pytest.mark.skipif(sys.platform == "win32", reason="an open file cannot be deleted there")
def test_a_file_deleted_or_cut_under_the_run_is_told(start_run: Any, damage: Any, said: str) -> None:
    told: list[str] = []
    run = start_run(on_stop=told.append)
    run.send("u1")
    damage(run.path)
    for _ in range(LOOK_EVERY):
        run.send("u1")
        run.loop.run_until(run.loop.now)
    assert len(told) == 1
    assert said in told[0]
    assert run.log.stopped == told[0]
    assert run.simulator.commands == LOOK_EVERY + 1


@pytest.mark.parametrize(
    ("damage", "said"),
    [(Path.unlink, "has been deleted"), (lambda path: os.truncate(path, 100), "been cut to")],
)
@pytest.mark.skipif(sys.platform == "win32", reason="an open file cannot be deleted there")
def test_what_happened_to_the_file_of_a_short_run_is_told_at_its_end(
    start_run: Any, damage: Any, said: str
) -> None:
    told: list[str] = []
    run = start_run(on_stop=told.append)
    run.send("u1")
    damage(run.path)
    run.send("u1")
    run.log.close()
    run.log.close()
    assert len(told) == 1
    assert said in told[0]


def test_a_compressed_log_holds_the_same_lines(tmp_path: Path, start_run: Any, configuration: Any) -> None:
    run = start_run()
    packed = tmp_path / "packed.jsonl.gz"
    with RunLog(packed, configuration, run.simulator, clock=run.clock) as log:
        run.engine.watch(log)
        run.send("u1", "d1-3", "zz", *("u1",) * FLUSH_EVERY)
        run.loop.run_until(run.loop.now)
        so_far = zlib.decompressobj(31).decompress(packed.read_bytes())
        assert so_far.count(b"\n") >= 3, "a run that crashes leaves what it has done"
    assert gzip.decompress(packed.read_bytes()) == run.path.read_bytes()
    with pytest.raises(RunLogError, match="exists already"):
        RunLog(packed, configuration, run.simulator)


def test_an_existing_log_is_never_overwritten(start_run: Any, configuration: Any) -> None:
    run = start_run()
    before = run.path.read_bytes()
    with pytest.raises(RunLogError, match="exists already"):
        RunLog(run.path, configuration, run.simulator)
    assert run.path.read_bytes() == before


@pytest.mark.skipif(sys.platform == "win32", reason="locks of files are Unix's")
def test_two_runs_never_write_one_log(configuration: Any, tmp_path: Path) -> None:
    path = tmp_path / "made by mktemp.jsonl"
    path.touch()
    simulator = Simulator(configuration.simulation, 1)
    with path.open("ab") as other:
        fcntl.flock(other, fcntl.LOCK_EX)  # a run that has opened it, and written nothing yet
        with pytest.raises(RunLogError, match="another run is writing it"):
            RunLog(path, configuration, simulator)
    assert path.read_bytes() == b""
    with RunLog(path, configuration, simulator):
        assert path.read_bytes().startswith(b"{")


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
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Notice, NoticeKind
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
    assert all(isinstance(decode_line(line, 2), ReadingRecord) for line in whole)


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
    assert first.read_bytes() == b"", "a run that starts in the same second finds the name taken"
    assert auto_path(now).name == "2025-11-21_10-05-09_2.jsonl"


def test_auto_says_when_its_folder_cannot_be_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "simmer-tui").write_text("a file in the way")
    monkeypatch.setattr(platformdirs, "user_data_path", lambda name, appauthor: tmp_path / name)
    with pytest.raises(RunLogError, match="cannot be made"):
        auto_path()
