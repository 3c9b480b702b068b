"""Limits of logs, on both sides of each: sizes, counts of lines, lengths of names and messages."""

from __future__ import annotations

import gzip
import json
import os
import sys
import threading
import time
import zlib
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui import platform_has
from simmer_tui.config.loader import Configuration
from simmer_tui.config.set_devices import DeviceStatus
from simmer_tui.errors import RunLogError
from simmer_tui.run.belief_grid import grid_belief
from simmer_tui.run.events import ActionName, Belief, Notice, NoticeKind
from simmer_tui.run.state import checkpoint_of
from simmer_tui.runlog import reader, saved_runs, writer
from simmer_tui.runlog.encode import LogEncoder
from simmer_tui.runlog.header import FORMAT, Header, TakenOver, parse_header, rebuild
from simmer_tui.runlog.index import EntryFlag, RunLogIndex
from simmer_tui.runlog.line_form import line_form
from simmer_tui.runlog.log_records import (
    BeliefRecord,
    BrokenLine,
    CheckpointRecord,
    NoticeRecord,
    decode_line,
    encode_line,
)
from simmer_tui.runlog.playback import Playback
from simmer_tui.runlog.reader import READS_LARGE, LogReader
from simmer_tui.runlog.saved_runs import SavedRun, last_run, make_room, saved_runs_folder
from simmer_tui.runlog.writer import ReplayedPrefix, RunLog, auto_path, new_file, new_folder, steady_clock
from simmer_tui.sim import CommandResult, Pose, Simulator, parse_command
from tests.runlog.conftest import StartRun, log_of

posix = pytest.mark.skipif(sys.platform == "win32", reason="of POSIX alone")


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def rewrite(path: Path, **changes: Any) -> Path:
    """Change the header of a log."""
    header, *rest = path.read_text().splitlines()
    path.write_text("\n".join([json.dumps({**json.loads(header), **changes}), *rest]) + "\n")
    return path


# -- the writer ------------------------------------------------------------------------------------------


def test_every_500_lines_there_is_a_checkpoint(start_run: StartRun) -> None:
    run = start_run()
    run.send(*("u1",) * 1010)
    while run.log.lines < 1013:
        run.loop.run_until(run.loop.now)
    places = [number for number, line in enumerate(lines(run.path), 1) if line["kind"] == "checkpoint"]
    assert places == [501, 1001]


def test_a_checkpoint_waits_for_the_end_of_a_movement(
    start_run: StartRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer, "CHECKPOINT_EVERY", 3)
    run = start_run(timed=True)
    reading = run.engine.session()
    run.send("d1-3")
    for _ in range(3):
        reading.submit(parse_command("u1"), lambda outcome: None)
    run.loop.run_until(run.loop.now + 1.0)
    run.send("vv-3;0;0", "u1", "u1")
    kinds = [line["kind"] for line in lines(run.path)]
    expected = ["header", "plan", "read", "read", "read", "end", "checkpoint", "leg", "answer"]
    assert kinds == [*expected, "read", "read"]


@posix
def test_a_deleted_file_is_noticed_at_the_hundredth_line(start_run: StartRun) -> None:
    stopped: list[str] = []
    run = start_run(on_stop=stopped.append)
    run.path.unlink()
    run.send(*("u1",) * 98)
    while run.simulator.commands < 98:
        run.loop.run_until(run.loop.now)
    assert (run.log.lines, stopped) == (99, [])
    run.send("u1")
    assert run.log.lines == 100
    assert stopped == [f"logging to {str(run.path)[:200]} has stopped: the file has been deleted"]


@posix
def test_the_bytes_of_a_cut_file_are_counted(start_run: StartRun) -> None:
    stopped: list[str] = []
    run = start_run(on_stop=stopped.append)
    size = run.path.stat().st_size
    os.truncate(run.path, size - 1)
    run.log.close()
    assert len(stopped) == 1
    assert stopped[0].endswith(f"the file has been cut to {size - 1} bytes; {size} were written")


def test_a_compressed_log_can_be_read_up_to_each_64th_line(
    tmp_path: Path, start_run: StartRun, configuration: Configuration
) -> None:
    run = start_run()
    packed = tmp_path / "packed.gz"

    def whole() -> int:
        return zlib.decompressobj(31).decompress(packed.read_bytes()).count(b"\n")

    with RunLog(packed, configuration, run.simulator) as log:
        run.engine.watch(log)
        counts = [whole()]
        while log.lines < 130:
            run.send("u1")
            counts.append(whole())
    assert counts == [0] * 63 + [64] * 64 + [128] * 3
    assert packed.read_bytes()[:3] == b"\x1f\x8b\x08"


def test_a_line_of_which_the_disk_took_a_part_ends_the_log(
    start_run: StartRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped: list[str] = []
    run = start_run(on_stop=stopped.append)
    write, written = os.write, []

    def partly(descriptor: int, data: bytes) -> int:
        written.append(len(data))
        return write(descriptor, data[:5] if len(written) == 1 else data)

    monkeypatch.setattr(writer.os, "write", partly)
    run.send("u1", "u1")
    monkeypatch.undo()
    assert stopped[0].endswith("has stopped: only a part of the last line could be written")
    assert written[1] == written[0] - 5
    assert [line["kind"] for line in lines(run.path)] == ["header", "read"]
    assert run.log.lines == 1


@posix
def test_others_may_read_a_log_and_not_write_it(tmp_path: Path, configuration: Configuration) -> None:
    before = os.umask(0)
    try:
        RunLog(tmp_path / "a", configuration, Simulator(configuration.simulation, 1)).close()
        new_file(tmp_path, datetime(2025, 1, 2, 3, 4, 5))
    finally:
        os.umask(before)
    assert [path.stat().st_mode & 0o777 for path in tmp_path.iterdir()] == [0o644, 0o644]


@posix
def test_no_file_is_written_through_a_link(tmp_path: Path, configuration: Configuration) -> None:
    simulator = Simulator(configuration.simulation, 1)
    (tmp_path / "empty").touch()
    (tmp_path / "link").symlink_to(tmp_path / "empty")
    with pytest.raises(RunLogError, match=r"it is a link to a file, which is not written through"):
        RunLog(tmp_path / "link", configuration, simulator)
    (tmp_path / "device").symlink_to(os.devnull)
    with RunLog(tmp_path / "device", configuration, simulator) as log:
        assert (log.stopped, log.lines) == ("", 1)
    assert log.stopped == "the log is closed"


@posix
@pytest.mark.parametrize("kind", ["new", "made before", "saved"])
def test_a_log_is_only_appended_to(
    tmp_path: Path, configuration: Configuration, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    notice = Notice(NoticeKind.FAULT, "a")
    if kind == "saved":
        run = Saving(tmp_path, configuration, monkeypatch).run
        os.truncate(run.path, 10)
        run.apply(notice)
        run.flush()
        data = run.path.read_bytes()
        run.close()
    else:
        path = tmp_path / "log"
        if kind == "made before":
            path.touch()
        with RunLog(path, configuration, Simulator(configuration.simulation, 1)) as log:
            os.truncate(path, 10)
            log(notice)
            data = path.read_bytes()
    begin, end = data[:10], data[10:]
    assert begin == b'{"kind":"h'
    assert json.loads(end)["text"] == "a"


@posix
@pytest.mark.parametrize("name", ["run.jsonl", "run.jsonl.gz"])
def test_a_log_is_locked_until_it_is_closed(tmp_path: Path, configuration: Configuration, name: str) -> None:
    log = RunLog(tmp_path / name, configuration, Simulator(configuration.simulation, 1))
    with (tmp_path / name).open("ab") as other:
        with pytest.raises(BlockingIOError):
            platform_has.lock_alone(other.fileno())
        log.close()
        platform_has.lock_alone(other.fileno())


def test_folders_of_one_second_have_names_of_their_own(tmp_path: Path) -> None:
    """Two runs of `trials` may begin in the same second."""
    now = datetime(2025, 1, 2, 3, 4, 5)
    for name in (
        "trials_2025-01-02_03-04-05",
        "trials_2025-01-02_03-04-05_2",
        "trials_2025-01-02_03-04-05_3",
    ):
        folder = new_folder(tmp_path, "trials_", now)
        assert folder == tmp_path / name
        folder.mkdir()


def test_files_of_one_second_are_numbered(tmp_path: Path) -> None:
    now = datetime(2025, 1, 2, 3, 4, 5)
    names = [new_file(tmp_path, now).name for _ in range(3)]
    assert names == [f"2025-01-02_03-04-05{end}.jsonl" for end in ("", "_2", "_3")]


def test_a_mission_is_under_way_only_if_said(tmp_path: Path, configuration: Configuration) -> None:
    simulator = Simulator(configuration.simulation, 1)
    RunLog(tmp_path / "a", configuration, simulator).close()
    RunLog(tmp_path / "b", configuration, simulator, mission=True).close()
    SavedRun(log_of(configuration, simulator), tmp_path / "saved").close()
    saved = SavedRun(log_of(configuration, simulator), tmp_path / "runs")
    saved.flush()
    found = [lines(path)[0]["mission"] for path in (tmp_path / "a", tmp_path / "b", saved.path)]
    saved.close()
    assert found == [False, True, False]
    with LogReader(tmp_path / "a") as log:
        assert log.reducer().at().mission is None


def test_the_real_time_of_a_prefix_is_its_own_until_it_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    prefix = ReplayedPrefix(TakenOver("a\x1b", 3, 1.256), 1000.0)
    assert str(prefix.origin) == "from a\x1b at 1.26 s"
    assert (prefix.clock(), prefix.over, prefix.commands, prefix.time) == (1000.0, False, 0, 0.0)
    prefix.real_time = 5.0
    monkeypatch.setattr(writer.time, "monotonic", lambda: 70.0)
    assert prefix.clock() == 1005.0
    prefix.end()
    assert prefix.over
    monkeypatch.setattr(writer.time, "monotonic", lambda: 72.5)
    assert prefix.clock() == 1007.5


def test_numbers_and_times_of_a_prefix_are_its_own_until_it_is_over(
    tmp_path: Path, start_run: StartRun, configuration: Configuration
) -> None:
    run = start_run()
    prefix = ReplayedPrefix(TakenOver("other", 3, 1.0), 1.6e9)
    run.send("u1", "d1-3")
    with RunLog(tmp_path / "new", configuration, run.simulator, prefix=prefix) as log:
        run.engine.watch(log)
        prefix.commands, prefix.time, prefix.real_time = 7, 0.25, 2.0
        notice = Notice(NoticeKind.FAULT, "a")
        run.engine.tell(notice)
        run.perform(ActionName.STOP)
        prefix.end()
        run.engine.tell(notice)
        run.perform(ActionName.STOP)
    head, *rest = lines(tmp_path / "new")
    assert (head["taken_over"], head["real"]) == ({"log": "other", "line": 3, "elapsed": 1.0}, 1.6e9)
    assert [(line.get("n"), line["t"]) for line in rest] == [(None, 0.25), (7, 0.5), (None, 0.5), (2, 0.5)]
    assert rest[0]["real"] == rest[1]["real"] == 2.0
    assert rest[2]["real"] == pytest.approx(2.0, abs=60.0)


def test_events_of_a_prefix_that_waited_have_its_time_whatever_the_machine_did_meanwhile(
    tmp_path: Path, start_run: StartRun, configuration: Configuration
) -> None:
    run = start_run()
    prefix = ReplayedPrefix(TakenOver("other", 3, 1.0), 1.6e9)
    with RunLog(tmp_path / "new", configuration, run.simulator, prefix=prefix) as log:
        prefix.real_time = 2.0
        log.apply(Notice(NoticeKind.FAULT, "a"), 0, time.monotonic() - 1.5)
        results: list[CommandResult] = []
        run.engine.watch(lambda event: results.append(event) if isinstance(event, CommandResult) else None)
        run.send("u1", "u2")
        log.apply_readings(results, [0, 0], [time.monotonic() - 1.5] * 2)
    _, *rest = lines(tmp_path / "new")
    assert [line["real"] for line in rest] == [2.0] * 3


def test_the_clock_runs_on_when_the_system_sets_its_own_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer.time, "monotonic", lambda: 100.0)
    monkeypatch.setattr(writer.time, "time", lambda: 5000.0)
    clock = steady_clock()
    monkeypatch.setattr(writer.time, "time", lambda: 10.0)
    monkeypatch.setattr(writer.time, "monotonic", lambda: 103.0)
    assert clock() == 5003.0


@pytest.mark.parametrize(("shape", "whole"), [((40, 50, 1), True), ((29, 69, 1), False), ((20, 25, 4), True)])
def test_grids_of_2000_states_are_logged_whole(shape: tuple[int, int, int], whole: bool) -> None:
    encoder, here = LogEncoder((50.0, 20.0, 0.0), lambda: (0, 0.0)), Pose(50.0, 20.0, 0.0)
    grid = grid_belief(np.full(shape, 0.1), (0.0, 0.0, 96.0, 48.0), 0.0, here)
    cells = []
    for at in (3.0, 3.0, 3.25, 3.4989, 3.499, 3.75, 3.9981, 2.0, 2.4):
        (record,) = encoder.records(Belief(at, here, here, grid=grid), 0.0)
        assert isinstance(record, BeliefRecord)
        assert record.grid is not None
        cells.append(bool(record.grid.cells))
    some = [True, False, False, False, True, False, True, True, False]
    assert cells == ([True] * len(some) if whole else some)


# -- saved runs ------------------------------------------------------------------------------------------

MEGABYTE = 1024 * 1024


def empty_runs(folder: Path, *sizes: int) -> None:
    """Saved runs of some sizes, the newest first."""
    folder.mkdir(parents=True, exist_ok=True)
    for age, size in enumerate(sizes):
        path = folder / f"run{age:02}.jsonl"
        with path.open("wb") as file:
            file.truncate(size)
        os.utime(path, (5000 - age, 5000 - age))


@pytest.mark.parametrize(
    ("sizes", "left"),
    [
        ([1] * 12, 10),
        ([64 * MEGABYTE] * 3, 3),
        ([64 * MEGABYTE, 64 * MEGABYTE, 64 * MEGABYTE + 1], 2),
        ([64 * MEGABYTE + 1, 64 * MEGABYTE, 64 * MEGABYTE], 2),
        ([192 * MEGABYTE], 1),
        ([192 * MEGABYTE + 1], 0),
    ],
)
def test_ten_runs_of_256_megabytes_are_left_with_the_next(
    tmp_path: Path, sizes: list[int], left: int
) -> None:
    empty_runs(tmp_path, *sizes)
    make_room(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"run{age:02}.jsonl" for age in range(left)]


def test_the_last_run_is_the_one_written_last(tmp_path: Path) -> None:
    with pytest.raises(RunLogError, match="no run is saved"):
        last_run(tmp_path)
    empty_runs(tmp_path, 3, 2, 1)
    assert last_run(tmp_path).name == "run00.jsonl"


def test_data_is_in_the_users_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def folder(name: str, appauthor: object) -> Path:
        asked.append((name, appauthor))
        return tmp_path

    monkeypatch.setattr("platformdirs.user_data_path", folder)
    assert saved_runs_folder() == tmp_path / "runs"
    assert auto_path().parent == tmp_path / "logs"
    assert asked == [("simmer-tui", False)] * 2


class Saving:
    """A saved run whose data waits until it is asked for."""

    def __init__(self, folder: Path, configuration: Configuration, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(saved_runs, "GATHER", 60.0)
        # Lines of the same event have the same length.
        monkeypatch.setattr(writer, "steady_clock", lambda: lambda: 5.0)
        self.stopped: list[str] = []
        simulator = Simulator(configuration.simulation, 3)
        self.run = SavedRun(log_of(configuration, simulator, self.stopped.append), folder)
        self.run.flush()

    @property
    def size(self) -> int:
        return self.run.path.stat().st_size

    def tell(self, size: int) -> None:
        """Write a line of this many bytes."""
        line = b'{"kind":"notice","t":0.0,"real":0.0,"about":"fault","text":""}\n'
        self.run.apply(Notice(NoticeKind.FAULT, "x" * (size - len(line))))


@pytest.mark.parametrize("more", [0, 1])
def test_eight_megabytes_may_wait_for_the_disk(
    tmp_path: Path, configuration: Configuration, monkeypatch: pytest.MonkeyPatch, more: int
) -> None:
    saving = Saving(tmp_path / "runs", configuration, monkeypatch)
    saving.tell(8 * MEGABYTE + more)
    saving.tell(100)
    assert bool(saving.stopped) == bool(more)
    saving.tell(100)
    assert len(saving.stopped) == 1
    assert saving.stopped[0].endswith("has stopped: the disk is too slow")
    saving.run.close()


@pytest.mark.parametrize("less", [0, 1])
def test_a_saved_run_has_64_megabytes_at_most(
    tmp_path: Path, configuration: Configuration, monkeypatch: pytest.MonkeyPatch, less: int
) -> None:
    assert saved_runs.LARGEST_RUN == 64 * MEGABYTE
    saving = Saving(tmp_path / "runs", configuration, monkeypatch)
    threads = [each.daemon for each in threading.enumerate() if each.name == "saved run"]
    assert threads
    assert all(threads), "a disk that hangs does not keep the process from ending"
    saving.run.apply(Notice(NoticeKind.FAULT, "a"))
    saving.run.flush()
    line = len(saving.run.path.read_bytes().splitlines(keepends=True)[1])
    monkeypatch.setattr(saved_runs, "LARGEST_RUN", saving.size + line - less)
    saving.run.apply(Notice(NoticeKind.FAULT, "a"))
    assert bool(saving.stopped) == bool(less)
    saving.run.apply(Notice(NoticeKind.FAULT, "a"))
    assert saving.stopped[0].endswith("it has reached 0 MB, the most that is saved of a run")
    saving.run.close()


# -- the reader ------------------------------------------------------------------------------------------

MOST = 16 * 1024 * 1024


@pytest.mark.parametrize("more", [0, 1])
def test_a_line_of_16_megabytes_is_read_and_no_longer_one(start_run: StartRun, more: int) -> None:
    run = start_run()
    start, end = b'{"kind":"notice","t":0,"about":"fault","text":"a"', b"}\n"
    whole = b'{"kind":"cut","t":0}\n'
    with run.path.open("ab") as file:
        file.write(start + b" " * (MOST - len(start) - len(end) + more) + end + whole)
    with LogReader(run.path) as log, RunLogIndex(run.path) as index:
        first, second = (record for _, record in log.lines())
        assert log.position == log.size == run.path.stat().st_size
        assert first == index.record(0)
        assert second == index.record(1) == decode_line(whole, 3)
    assert isinstance(first, BrokenLine) == bool(more)
    assert str(first) == "line 2 is broken: it is longer than 16777216 bytes" if more else first


def test_the_line_that_is_cut_off_is_named(start_run: StartRun) -> None:
    run = start_run()
    run.send("u1")
    with run.path.open("ab") as file:
        file.write(b'{"kind"')
    with LogReader(run.path) as log:
        assert log.note == ""
        assert [number for number, _ in log.lines()] == [2]
        assert log.note == "line 3, the last, is cut off and was skipped"
        assert log.position == run.path.stat().st_size - 7
        with run.path.open("ab") as file:
            file.write(b':"wire","t":0,"data":""}\n{"kind":"wire","t":0,"data":""}\n')
        assert [type(record).__name__ for _, record in log.lines()] == ["WireRecord"] * 2
        assert log.note == ""


def test_events_come_in_blocks_of_64_or_of_a_quarter_of_a_megabyte(start_run: StartRun) -> None:
    run = start_run()
    run.send(*("d1-0",) * 50)
    while run.simulator.commands < 50:
        run.loop.run_until(run.loop.now)
    with LogReader(run.path) as log:
        assert [len(block) for block in log.blocks()] == [64, 65, 21]
    with LogReader(run.path) as log:
        assert [len(block) for block in log.blocks(4)][:3] == [4, 5, 4]
    long = json.dumps({"kind": "notice", "t": 0, "about": "fault", "text": ""})
    header = run.path.read_text().splitlines()[0]
    text = long.replace('"text": ""', f'"text": "{"x" * (2**17 - len(long) - 1)}"')
    run.path.write_text("\n".join([header, *[text] * 6]) + "\n")
    with LogReader(run.path) as log:
        assert [len(block) for block in log.blocks()] == [3, 3, 0], "two are just a quarter"


@pytest.mark.parametrize(
    ("unpacked", "ratio", "read"), [(-1, 1000, True), (-1, 0, False), (0, 0, True), (1000, 0, True)]
)
def test_a_file_that_unpacks_to_too_much_is_no_log(
    start_run: StartRun, monkeypatch: pytest.MonkeyPatch, unpacked: int, ratio: int, read: bool
) -> None:
    assert (reader.MOST_PACKED, reader.MOST_UNPACKED) == (50, 1_000_000_000)
    run = start_run()
    size = run.path.stat().st_size
    run.path.write_bytes(gzip.compress(run.path.read_bytes()))
    monkeypatch.setattr(reader, "MOST_UNPACKED", size + unpacked)
    monkeypatch.setattr(reader, "MOST_PACKED", ratio)
    for large in (False, True):
        token = READS_LARGE.set(large)
        try:
            if read or large:
                LogReader(run.path).close()
                continue
            with pytest.raises(RunLogError) as raised:
                LogReader(run.path)
            most = f"{ratio} times its size and {(size + unpacked) / 1e9:g} GB"
            assert f"unpacks to more than {most}, as no run log does; --large reads it" in str(raised.value)
        finally:
            READS_LARGE.reset(token)


def test_logs_that_were_packed_one_by_one_are_one_log(start_run: StartRun) -> None:
    run = start_run()
    run.send("u1", "d1-3")
    parts = run.path.read_bytes().splitlines(keepends=True)
    run.path.write_bytes(b"".join(gzip.compress(part) for part in parts))
    with LogReader(run.path) as log:
        assert len(list(log.lines())) == len(parts) - 1


@posix
def test_paths_in_messages_are_whole(tmp_path: Path, configuration: Configuration) -> None:
    folder = tmp_path / ("y" * 200)
    folder.mkdir()
    shown = str(path := folder / ("x" * 200))
    for opener in (LogReader, RunLogIndex):
        with pytest.raises(RunLogError) as raised:
            opener(path)
        assert str(raised.value).startswith(f"{shown}: there is no such file; ")
    with pytest.raises(RunLogError) as raised:
        last_run(path)
    assert str(raised.value).startswith(f"no run is saved in {shown} yet")
    simulator, stopped = Simulator(configuration.simulation, 1), list[str]()
    path.write_text("old")
    with pytest.raises(RunLogError) as raised:
        RunLog(path, configuration, simulator)
    assert str(raised.value).startswith(f"cannot log to {shown}: it exists already")
    with pytest.raises(RunLogError) as raised:
        SavedRun(log_of(configuration, simulator), path)
    assert str(raised.value).startswith(f"runs cannot be saved in {shown}: ")
    path.unlink()
    log = RunLog(path, configuration, simulator, on_stop=stopped.append)
    os.truncate(path, 0)
    log.close()
    assert stopped[0].startswith(f"logging to {shown} has stopped: ")
    path.unlink()
    path.mkdir()
    with pytest.raises(RunLogError) as raised:
        LogReader(path)
    assert str(raised.value).startswith(f"{shown} cannot be read: ")


# -- the replay ------------------------------------------------------------------------------------------


def test_a_replay_looks_400_entries_back_and_1500_ahead(
    start_run: StartRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer, "CHECKPOINT_EVERY", 50)
    run = start_run()
    run.send("u3", *("zz",) * 1500)
    while run.log.lines < 1520:
        run.loop.run_until(run.loop.now)
    with RunLogIndex(run.path) as log:
        first = log.find_next(-1, EntryFlag.CHECKPOINT)
        assert first is not None
        for more, known in ((400, True), (401, False)):
            playback = Playback(log)
            playback.state_at(log.count - 1)
            assert ("u3" in playback.state_at(first + more).sensors) == known
        for entry, still in ((1500, True), (1501, False)):
            playback = Playback(log)
            playback.state_at(0)
            assert ("u3" in playback.state_at(entry).sensors) == still


@pytest.mark.parametrize(("without", "shown"), [(499, True), (500, False)])
def test_cells_of_a_grid_are_sought_in_500_beliefs(start_run: StartRun, without: int, shown: bool) -> None:
    run = start_run()
    here = run.simulator.pose
    grid = grid_belief(np.full((4, 8, 1), 0.1), (0.0, 0.0, 96.0, 48.0), 0.0, here)
    run.engine.tell(Belief(0.0, here, here, grid=grid))
    run.engine.tell(Belief(0.0, here, here, grid=replace(grid, cells=b"")))
    run.engine.tell(Notice(NoticeKind.FAULT, ""))
    header, belief, bare, notice = run.path.read_text().splitlines()
    # Beliefs are recalled from before a checkpoint.
    summary = encode_line(line_form(CheckpointRecord).record(checkpoint_of(run.simulator))).decode().strip()
    run.path.write_text("\n".join([header, belief, *[bare] * without, summary, *[notice] * 1500]) + "\n")
    with RunLogIndex(run.path) as log:
        found = Playback(log).state_at(log.count - 1).belief
        assert found is not None
        assert found.grid is not None
        assert bool(found.grid.cells) == shown


def results(path: Path, *added: dict[str, Any]) -> list[CommandResult]:
    """The results of the lines of a log, with others at its end."""
    with path.open("a") as file:
        file.writelines(json.dumps(line) + "\n" for line in added)
    with LogReader(path) as log:
        events = [each.event for each in log if not isinstance(each, BrokenLine)]
    return [each for each in events if isinstance(each, CommandResult)]


def test_a_reply_without_a_pose_is_from_where_the_line_before_left_the_robot(start_run: StartRun) -> None:
    run = start_run()
    run.send("d1-0.3")
    run.log.close()
    there = run.simulator.pose
    reading = {"kind": "read", "n": 2, "cmd": "u1", "reply": 1.0, "t": run.simulator.time}
    moving = {**reading, "pose": [20.0, 41.0, 3.0], "before": [19.0, 41.0, 3.0]}
    answer = {**reading, "kind": "answer", "status": "done"}
    found = results(run.path, reading, moving, answer, {**answer, "pose": [21.0, 41.0, 3.0]})[-4:]
    assert [(each.before, each.pose) for each in found] == [
        (there, there),
        (Pose(19.0, 41.0, 3.0), Pose(20.0, 41.0, 3.0)),
        (Pose(20.0, 41.0, 3.0),) * 2,
        (Pose(21.0, 41.0, 3.0),) * 2,
    ]


# -- the header ------------------------------------------------------------------------------------------


def said_of(line: dict[str, Any]) -> str:
    with pytest.raises(RunLogError) as raised:
        parse_header(json.dumps({"kind": "header", **line}).encode(), "LOG")
    return str(raised.value)


def test_messages_about_headers_are_cut() -> None:
    said = said_of({"format": "f" * 50, "program": "p" * 50})
    assert f"format '{'f' * 36}..., written by simmer-tui {'p' * 37}...; " in said
    assert "simmer-tui ?; " in said_of({"format": 2})
    said = said_of({"format": FORMAT, "t": 0, "program": "", "start": "", "real": 0, "x": {"k" * 200: 1}})
    assert said.startswith("LOG: the header is broken: Object missing required field")
    key = "k" * 200
    fields = {"t": 0, "program": "", "start": "", "real": 0, "seed": 0, "configuration": "", "number": 0}
    fields |= {"pose": [0, 0, 0], "block": [0, 0, 0], "holding": False, "noise": False, "mission": False}
    fields |= {"bias": {key: [0, 0, 0]}, "settings": {}, "files": {}}
    said = said_of({"format": FORMAT, **fields})
    assert said.endswith("...")
    assert len(said) == len("LOG: the header is broken: ") + 120


def test_a_long_reason_for_a_broken_line_is_cut() -> None:
    line = decode_line(json.dumps({"kind": "x" * 300}).encode(), 2)
    assert isinstance(line, BrokenLine)
    assert (len(line.reason), line.reason[-3:]) == (120, "...")


@pytest.mark.parametrize(
    ("name", "good"),
    [
        ("a" * 95 + ".csv", True),
        ("a" * 96 + ".csv", False),
        ("a.toml", True),
        ("a.py", False),
        ("ä.csv", False),
    ],
)
def test_a_log_holds_files_with_short_plain_names(start_run: StartRun, name: str, good: bool) -> None:
    path = start_run().path
    rewrite(path, files={**lines(path)[0]["files"], name: ""})
    if good:
        LogReader(path).close()
        return
    with pytest.raises(RunLogError, match="is no file of a set") as raised:
        LogReader(path)
    assert repr(name) in str(raised.value)


def header(path: Path) -> Header:
    return parse_header(path.read_bytes().splitlines()[0], "LOG")


def test_a_log_is_simulated_whatever_robot_it_is_of(start_run: StartRun) -> None:
    path = start_run().path
    settings = lines(path)[0]["settings"]
    changes = {"sim": False, "seed": 99, "randerror": False, "num_segments": 7}
    serial = {**settings["serial"], "port": "/dev/ttyX", "baud": 4800}
    rewrite(path, settings={**settings, **changes, "serial": serial})
    assert not header(path).simulated
    found = rebuild(header(path)).settings
    assert (found.sim, found.serial.port, found.serial.baud, found.num_segments) == (True, "", 4800, 7)
    assert found.seed != 99
    rewrite(path, settings={})
    assert header(path).simulated


def test_device_files_of_a_log_have_not_run(start_run: StartRun) -> None:
    path = rewrite(start_run().path, devices=[{"path": "devices/a.py", "sha256": "00"}])
    configuration = rebuild(header(path))
    assert configuration.device_statuses == (
        DeviceStatus("devices/a.py", "00", trusted=False, ran=False, kinds=()),
    )


def test_a_log_begins_where_its_header_says(start_run: StartRun, configuration: Configuration) -> None:
    path = start_run().path
    rewrite(
        path, t=3.5, pose=[20.0, 41.0, 5.0], block=[30.0, 42.5, 7.0], number=4, holding=True, noise=False,
        mission=True, bias={"rot": [0.1, 0.2, 0.3]},
    )  # fmt: skip
    start = header(path).checkpoint(configuration)
    assert (start.time, start.commands, start.holding, start.noise) == (3.5, 4, True, False)
    assert (start.pose.x, start.pose.y, start.pose.heading) == (20.0, 41.0, 5.0)
    assert (start.block.x, start.block.y, start.block.heading) == (30.0, 42.5, 7.0)
    assert start.block.size == configuration.simulation.block_size
    assert start.mission is not None
    assert [(kind.value, error.x, error.y, error.r) for kind, error in start.bias.items()] == [
        ("rot", 0.1, 0.2, 0.3)
    ]


def test_an_access_token_is_not_logged(tmp_path: Path, configuration: Configuration) -> None:
    server = replace(configuration.settings.server, token="secret")
    files = {**configuration.files, "settings.toml": '[server]\ntoken = "secret"\nport = 1\n'}
    changed = replace(configuration, settings=replace(configuration.settings, server=server), files=files)
    RunLog(tmp_path / "log", changed, Simulator(configuration.simulation, 1)).close()
    head = lines(tmp_path / "log")[0]
    assert head["settings"]["server"]["token"] == ""
    assert head["files"]["settings.toml"] == '[server]\ntoken = ""\nport = 1\n'


def test_a_notice_is_no_advice_unless_said() -> None:
    record = decode_line(b'{"kind":"notice","t":0,"about":"fault","text":""}', 2)
    assert record == NoticeRecord(0.0, about=NoticeKind.FAULT, text="", subject="", advice=False)


def test_a_log_of_blank_lines_is_refused_before_it_takes_minutes(
    start_run: StartRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A compressed one of a megabyte had a thousand million of them."""
    monkeypatch.setattr(reader, "MOST_BROKEN", 20)
    run = start_run()
    run.send("u1")
    run.log.close()
    whole = run.path.read_bytes()
    run.path.write_bytes(whole + b"\n" * 20)
    with LogReader(run.path) as log:
        assert sum(isinstance(each, BrokenLine) for each in log) == 20
    run.path.write_bytes(whole + b"\n" * 1000)
    with LogReader(run.path) as log, pytest.raises(RunLogError, match="is no run log: 21 of its first"):
        list(log)
    with pytest.raises(RunLogError, match="have no record"):
        RunLogIndex(run.path)
