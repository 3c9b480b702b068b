"""Reading back: whole logs, logs cut anywhere, broken lines, and files that are no logs."""

from __future__ import annotations

import json
import os
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.actions import ActionName
from simmer_tui.errors import RunLogError
from simmer_tui.runlog.commands import run_rerun
from simmer_tui.runlog.entries import (
    ActionEntry,
    BeliefEntry,
    BrokenEntry,
    CommandEntry,
    NoticeEntry,
    parse_entry,
)
from simmer_tui.runlog.header import rebuild
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.reader import MAX_LINE, LogReader
from simmer_tui.sim import Axes, DriveKind, Pose


def test_entries_hold_what_happened(start_run: Any) -> None:
    run = start_run()
    outcomes: list[Any] = []
    run.engine.watch(outcomes.append)
    run.send("u1", "d1-60", "i1")
    with LogReader(run.path) as log:
        reading, movement, line_reading = list(log)
    assert isinstance(reading, CommandEntry)
    assert isinstance(movement, CommandEntry)
    assert isinstance(line_reading, CommandEntry)
    assert (reading.reply, reading.true) == (outcomes[0].reply, outcomes[0].reading.true)
    assert reading.view == outcomes[0].reading.view
    assert movement.contact == outcomes[1].contact.point
    assert (movement.before, movement.pose) == (outcomes[1].before, outcomes[1].pose)
    assert movement.path == tuple(map(tuple, outcomes[1].trajectory.trail(movement.end).tolist()))
    view = outcomes[2].reading.view
    assert line_reading.view is not None
    assert (line_reading.view.points == view.points).all()  # type: ignore[union-attr]
    assert (line_reading.view.black == view.black).all()  # type: ignore[union-attr]


def test_an_entry_says_whether_and_when_its_contact_held_the_robot(start_run: Any) -> None:
    run = start_run()
    run.simulator.noise = False
    run.simulator.set_bias({DriveKind.RIGHT: Axes(y=0.1), DriveKind.UP: Axes()})
    run.simulator.teleport(Pose(9.5, 44.9, 0.0))
    run.send("d1-3", "w1-1", "d1-80")
    with LogReader(run.path) as log:
        went_on, stopped, later = [entry for entry in log if isinstance(entry, CommandEntry)]
    assert went_on.contact is not None
    assert (went_on.held, went_on.arrival) == (None, went_on.end)
    assert stopped.held == stopped.arrival == stopped.contact_time < stopped.end
    assert later.held is not None
    assert later.contact_time < later.held == later.arrival < later.end


def test_every_kind_of_line_comes_back(varied_log: Path) -> None:
    with LogReader(varied_log) as log:
        kinds = {type(entry) for entry in log}
    assert kinds == {ActionEntry, BeliefEntry, CommandEntry, NoticeEntry}


def test_the_configuration_comes_back_whole(start_run: Any, configuration: Any) -> None:
    with LogReader(start_run().path) as log:
        rebuilt = rebuild(log.header)
    assert rebuilt.simulation == configuration.simulation
    assert rebuilt.settings == configuration.settings
    assert rebuilt.name == configuration.name
    assert rebuilt.files == configuration.files


def test_a_log_cut_at_any_byte_gives_its_whole_lines(start_run: Any, tmp_path: Path) -> None:
    run = start_run()
    run.send("u1", "d1-3", "zz")
    run.believe()
    run.perform(ActionName.RESET)
    header, *lines = run.path.read_bytes().splitlines(keepends=True)
    short = json.dumps({**json.loads(header), "files": {}, "settings": {}}, separators=(",", ":"))
    data = b"".join((short.encode(), b"\n", *lines))
    ends = [place + 1 for place, byte in enumerate(data) if byte == ord("\n")]
    path = tmp_path / "cut.jsonl"
    path.write_bytes(data)
    for cut in range(len(data), -1, -1):
        os.truncate(path, cut)
        if cut < ends[0]:
            with pytest.raises(RunLogError, match=r"is empty|cut off within|not a run log"):
                LogReader(path)
            continue
        whole = sum(end <= cut for end in ends)
        with LogReader(path) as log, RunLogIndex(path) as index:
            entries = list(log)
            assert not any(isinstance(entry, BrokenEntry) for entry in entries)
            assert len(entries) == index.count == whole - 1
            assert log.note == index.note
            assert bool(log.note) == (cut not in ends)


def test_cut_logs_can_be_run_again(varied_log: Path, tmp_path: Path, capsys: Any) -> None:
    data = varied_log.read_bytes()
    first = data.index(b"\n") + 1
    path = tmp_path / "cut.jsonl"
    for cut in range(first, len(data), 397):
        path.write_bytes(data[:cut])
        assert run_rerun([str(path)]) == 0
        notes = capsys.readouterr().err
        assert ("is cut off and was skipped" in notes) == (not data[:cut].endswith(b"\n"))


NO_LOGS = {
    "empty": (b"", "is empty"),
    "text": (b"hello\nworld\n", "is not a run log"),
    "binary": (bytes(range(256)), "is not a run log"),
    "json": (b"[1, 2]\n", "is not a run log"),
    "other": (b'{"kind":"header"}\n', "is not a run log"),
    "nested": (b"[" * 100_000 + b"\n", "is not a run log"),
    "number": (b'{"kind":"header","format":' + b"9" * 5000 + b"}\n", "is not a run log"),
    "version": (
        b'{"t":0,"kind":"header","format":2,"program":"9.9"}\n',
        "format 2, written by simmer-tui 9.9",
    ),
    "fields": (b'{"t":0,"kind":"header","format":1}\n', "the header has no field"),
    "torn": (b'{"t":0.0,"kind":"hea', "cut off within its first line"),
}


@pytest.mark.parametrize("name", NO_LOGS)
@pytest.mark.parametrize("opener", [LogReader, RunLogIndex])
def test_what_is_no_log_is_refused(tmp_path: Path, name: str, opener: Any) -> None:
    data, reason = NO_LOGS[name]
    path = tmp_path / "file"
    path.write_bytes(data)
    with pytest.raises(RunLogError, match=reason):
        opener(path)


@pytest.mark.parametrize("opener", [LogReader, RunLogIndex])
def test_files_that_cannot_be_read_are_named(tmp_path: Path, opener: Any) -> None:
    with pytest.raises(RunLogError, match="no such file"):
        opener(tmp_path / "none.jsonl")
    with pytest.raises(RunLogError, match="cannot be read"):
        opener(tmp_path)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("seed", -1),
        ("seed", "7"),
        ("pose", [1, 2]),
        ("bias", {"sideways": [0, 0, 0]}),
        ("files", {"maze.csv": 3}),
        ("settings", []),
        ("block", None),
        ("wall", 10**400),
    ],
)
def test_a_header_with_wrong_fields_is_refused(start_run: Any, field: str, value: object) -> None:
    path = start_run().path
    header = json.loads(path.read_text())
    path.write_text(json.dumps({**header, field: value}) + "\n")
    with pytest.raises(RunLogError, match="the header is broken"):
        LogReader(path)


@pytest.mark.parametrize(
    "name", ["../maze.csv", "C:\\maze.csv", "/tmp/maze.csv", "maze.exe", "a\0.csv", ".."]
)
def test_no_file_is_written_outside_the_folder(start_run: Any, name: str) -> None:
    path = start_run().path
    header = json.loads(path.read_text())
    header["files"][name] = "1"
    path.write_text(json.dumps(header) + "\n")
    with LogReader(path) as log, pytest.raises(RunLogError, match="no file of a set"):
        rebuild(log.header)


BROKEN = {
    b"": "it is not JSON",
    b'{"\xff":1}': "codec",
    b"{": "it is not JSON",
    b"[1]": "not a JSON object",
    b"[" * 100_000: "recursion",
    b'{"kind":"dream"}': "its kind is 'dream'",
    b'{"kind":"command"}': "it has no field 'verdict'",
    b'{"kind":"command","verdict":"maybe"}': "'maybe' is not a valid Status",
    b'{"kind":"notice","t":true,"wall":0,"about":"","subject":"","text":""}': "'True' is not a number",
    b'{"kind":"notice","t":0,"wall":0,"about":"","subject":"","text":7}': "'7' is not text",
}


@pytest.mark.parametrize("line", BROKEN)
def test_broken_lines_say_why(line: bytes) -> None:
    entry = parse_entry(line, 5)
    assert isinstance(entry, BrokenEntry)
    assert entry.line == 5
    assert BROKEN[line] in entry.reason


def test_a_broken_line_in_the_middle_is_named_and_the_rest_is_read(varied_log: Path) -> None:
    lines = varied_log.read_bytes().splitlines(keepends=True)
    lines[4] = lines[4][:40] + b"\n"
    varied_log.write_bytes(b"".join(lines))
    with LogReader(varied_log) as log:
        entries = list(log)
    assert [entry.line for entry in entries if isinstance(entry, BrokenEntry)] == [5]
    assert len(entries) == len(lines) - 1


def test_a_line_without_end_is_one_broken_line(varied_log: Path) -> None:
    lines = varied_log.read_bytes().splitlines(keepends=True)
    endless = b"x" * (MAX_LINE + 10) + b"\n"
    varied_log.write_bytes(b"".join((*lines[:3], endless, *lines[3:5])))
    with LogReader(varied_log) as log:
        kinds = [isinstance(entry, BrokenEntry) for entry in log]
    assert kinds == [False, False, True, False, False]
    with RunLogIndex(varied_log) as index:
        assert [isinstance(index.entry(i), BrokenEntry) for i in range(index.count)] == kinds


def test_reading_a_long_log_takes_no_more_memory_than_a_short_one(varied_log: Path, tmp_path: Path) -> None:
    header, *lines = varied_log.read_bytes().splitlines(keepends=True)
    path = tmp_path / "long.jsonl"
    path.write_bytes(header + b"".join(lines) * 100)
    tracemalloc.start()
    try:
        with LogReader(path) as log:
            count = sum(1 for _ in log)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert count == 100 * len(lines)
    assert peak < 500_000 < path.stat().st_size
