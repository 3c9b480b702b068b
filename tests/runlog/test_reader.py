"""Reading back: whole logs, logs cut anywhere, broken lines, and files that are no logs."""

from __future__ import annotations

import codecs
import errno
import gzip
import io
import json
import os
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.cli.log_reports import build_report
from simmer_tui.cli.rerun_command import run_rerun
from simmer_tui.errors import RunLogError
from simmer_tui.run.events import ActionName
from simmer_tui.runlog.header import rebuild
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.log_records import (
    ActionRecord,
    AnswerRecord,
    BeliefRecord,
    BrokenLine,
    EndRecord,
    NoticeRecord,
    PlanRecord,
    ReadingRecord,
    decode_line,
)
from simmer_tui.runlog.reader import MAX_LINE, LogReader
from tests.runlog.conftest import StartRun


def test_every_kind_of_line_comes_back(varied_log: Path) -> None:
    with LogReader(varied_log) as log:
        kinds = {type(line) for _, line in log.lines()}
    assert kinds == {
        ActionRecord,
        AnswerRecord,
        BeliefRecord,
        EndRecord,
        NoticeRecord,
        PlanRecord,
        ReadingRecord,
    }


def test_a_log_that_grows_is_read_on_with_the_numbers_of_its_lines(varied_log: Path, tmp_path: Path) -> None:
    data = varied_log.read_bytes()
    path, lines = tmp_path / "run.jsonl", data.splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:3]))
    with LogReader(path) as log:
        assert [number for number, _ in log.lines()] == [2, 3]
        path.write_bytes(data)
        assert [number for number, _ in log.lines()] == [*range(4, len(lines) + 1)]


@pytest.mark.parametrize("whole", [True, False])
def test_a_compressed_log_is_read(varied_log: Path, tmp_path: Path, whole: bool) -> None:
    packed = gzip.compress(varied_log.read_bytes())
    path = tmp_path / "run.jsonl.gz"
    path.write_bytes(packed if whole else packed[:-30])
    with LogReader(varied_log) as plain, LogReader(path) as log:
        lines, again = list(plain.lines()), list(log.lines())
        assert lines[: len(again)] == again
        assert (len(again) == len(lines)) == whole
        assert ("cut off" in log.note) == (not whole)


def test_a_log_that_an_editor_saved_with_a_byte_order_mark_is_read(varied_log: Path, tmp_path: Path) -> None:
    marked = tmp_path / "marked.jsonl"
    marked.write_bytes(codecs.BOM_UTF8 + varied_log.read_bytes())
    with LogReader(varied_log) as plain, LogReader(marked) as log, RunLogIndex(marked) as index:
        assert log.header == plain.header
        lines = list(plain.lines())
        assert list(log.lines()) == lines
        assert [(2 + entry, index.record(entry)) for entry in range(index.count)] == lines


def test_the_configuration_comes_back_whole(start_run: Any, configuration: Any) -> None:
    with LogReader(start_run().path) as log:
        rebuilt = rebuild(log.header)
    assert rebuilt.simulation == configuration.simulation
    assert rebuilt.settings == configuration.settings
    assert rebuilt.name == configuration.name
    assert rebuilt.files == configuration.files


@pytest.mark.parametrize("step", [71, pytest.param(1, marks=pytest.mark.slow)])
def test_a_log_cut_at_any_byte_gives_its_whole_lines(start_run: Any, tmp_path: Path, step: int) -> None:
    run = start_run()
    run.send("u1", "d1-3", "zz")
    run.believe()
    run.perform(ActionName.RESET)
    header, *lines = run.path.read_bytes().splitlines(keepends=True)
    short = json.dumps(json.loads(header), separators=(",", ":"))
    data = b"".join((short.encode(), b"\n", *lines))
    ends = [place + 1 for place, byte in enumerate(data) if byte == ord("\n")]
    path = tmp_path / "cut.jsonl"
    path.write_bytes(data)
    around = {place for end in ends for place in (end - 1, end, end + 1) if place <= len(data)}
    # Within the header every seventh will do: it is long, and there is nothing before it.
    cuts = around | set(range(ends[0], len(data), step)) | set(range(0, ends[0], 7 * step))
    for cut in sorted(cuts, reverse=True):
        os.truncate(path, cut)
        if cut < ends[0]:
            with pytest.raises(RunLogError, match=r"is empty|cut off within|not a run log"):
                LogReader(path)
            continue
        whole = sum(end <= cut for end in ends)
        with LogReader(path) as log, RunLogIndex(path) as index:
            entries = list(log.lines())
            assert not any(isinstance(entry, BrokenLine) for _, entry in entries)
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
        b'{"t":0,"kind":"header","format":4,"program":"9.9"}\n',
        "format 4, written by simmer-tui 9.9",
    ),
    "first": (b'{"t":0,"kind":"header","format":2,"program":"0.1"}\n', r"reads format 1: log the run again"),
    "fields": (b'{"kind":"header","format":1}\n', "the header is broken: Object missing required field"),
    "torn": (b'{"kind":"header","t":', "cut off within its first line"),
}


@pytest.mark.parametrize("name", NO_LOGS)
@pytest.mark.parametrize("opener", [LogReader, RunLogIndex])
def test_what_is_no_log_is_refused(tmp_path: Path, name: str, opener: Any) -> None:
    data, reason = NO_LOGS[name]
    path = tmp_path / "file"
    path.write_bytes(data)
    with pytest.raises(RunLogError, match=reason):
        opener(path)


class _Failing(io.FileIO):
    """A file on a disk that fails behind the first piece that is read."""

    def readinto(self, buffer: Any) -> int | None:
        if self.tell():
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return super().readinto(buffer)


def _every_line(path: Path) -> None:
    with LogReader(path) as log:
        list(log.lines())


@pytest.mark.parametrize("read", [build_report, _every_line, RunLogIndex])
def test_a_disk_that_fails_while_a_log_is_read_is_named(
    start_run: StartRun, monkeypatch: pytest.MonkeyPatch, read: Any
) -> None:
    run = start_run()
    run.send("u1")
    header = run.path.read_bytes().index(b"\n") + 1
    usual = Path.open

    def opened(path: Path, *args: Any, **named: Any) -> Any:
        return io.BufferedReader(_Failing(path), header) if path == run.path else usual(path, *args, **named)

    monkeypatch.setattr(Path, "open", opened)
    with pytest.raises(RunLogError, match=rf"{run.path.name} cannot be read: .*{os.strerror(errno.EIO)}"):
        read(run.path)


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
        ("real", 10**400),
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
    with pytest.raises(RunLogError, match="no file of a set"):
        LogReader(path)


def test_a_header_without_the_files_of_its_set_names_no_temporary_folder(start_run: Any) -> None:
    path = start_run().path
    header = json.loads(path.read_text())
    del header["files"]["maze.csv"], header["files"]["drive.csv"]
    path.write_text(json.dumps(header) + "\n")
    with pytest.raises(RunLogError, match=r"^the header lacks maze.csv, drive.csv: "):
        LogReader(path)


NOTICE = b'"real":0,"about":"fault","subject":"","text":'
BROKEN = {
    b"": "it is empty",
    b" \r\n": "it is empty",
    b'{"\xff":1}': "missing required field",
    b"{": "truncated",
    b"[1]": "got `array`",
    b"[" * 100_000: "got `array`",
    b'{"t":0,"kind":"notice","x":' + b"[" * 100_000: "",
    b'{"kind":"dream"}': "Invalid value 'dream'",
    b'{"kind":"answer"}': "missing required field",
    b'{"kind":"belief","t":0,"believed":[0,0,0],"pose":[0,0,0],"particles":[[1'
    + b"0" * 400
    + b"],[0]]}": "Expected `int` <= 1000000000000000",
    b'{"kind":"belief","t":0,"believed":[0,0,0],"pose":[0,0,0],"particles":[[1],[2,3]]}': "columns",
    b'{"kind":"answer","t":0,"n":1,"cmd":"","reply":0,"status":"maybe"}': "Invalid enum value 'maybe'",
    b'{"kind":"notice","t":true,' + NOTICE + b'""}': "got `bool`",
    b'{"kind":"notice","t":0,' + NOTICE + b"7}": "Expected `str`",
    b'{"kind":"notice","t":1e999,' + NOTICE + b'""}': "out of range",
    b'{"kind":"notice","t":1e13,' + NOTICE + b'""}': "<= 1000000000000.0",
    b'{"kind":"notice","t":1e13,' + NOTICE + b'"\\udead"}': "<= 1000000000000.0",
    b'{"kind":"notice","t":Infinity,' + NOTICE + b'"\\udead"}': "Infinity is no JSON",
    b'{"kind":"action","t":0,"n":0,"action":"reset","source":"","arguments":[1],"text":""'
    b',"pose":[0,0,0]}': "reset takes 0 arguments",
}


@pytest.mark.parametrize("line", BROKEN)
def test_broken_lines_say_why(line: bytes) -> None:
    entry = decode_line(line, 5)
    assert isinstance(entry, BrokenLine)
    assert entry.line == 5
    assert BROKEN[line] in entry.reason


def test_a_broken_line_in_the_middle_is_named_and_the_rest_is_read(varied_log: Path) -> None:
    lines = varied_log.read_bytes().splitlines(keepends=True)
    lines[4] = lines[4][:40] + b"\n"
    varied_log.write_bytes(b"".join(lines))
    with LogReader(varied_log) as log:
        entries = [line for _, line in log.lines()]
    assert [entry.line for entry in entries if isinstance(entry, BrokenLine)] == [5]
    assert len(entries) == len(lines) - 1


def test_a_line_without_end_is_one_broken_line(varied_log: Path) -> None:
    lines = varied_log.read_bytes().splitlines(keepends=True)
    endless = b"x" * (MAX_LINE + 10) + b"\n"
    varied_log.write_bytes(b"".join((*lines[:3], endless, *lines[3:5])))
    with LogReader(varied_log) as log:
        kinds = [isinstance(line, BrokenLine) for _, line in log.lines()]
    assert kinds == [False, False, True, False, False]
    with RunLogIndex(varied_log) as index:
        assert [isinstance(index.record(i), BrokenLine) for i in range(index.count)] == kinds


def test_reading_a_long_log_takes_no_more_memory_than_a_short_one(varied_log: Path, tmp_path: Path) -> None:
    header, *lines = varied_log.read_bytes().splitlines(keepends=True)
    path = tmp_path / "long.jsonl"
    path.write_bytes(header + b"".join(lines) * 200)
    tracemalloc.start()
    try:
        with LogReader(path) as log:
            count = sum(1 for _ in log.lines())
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert count == 200 * len(lines)
    assert peak < 500_000 < path.stat().st_size
