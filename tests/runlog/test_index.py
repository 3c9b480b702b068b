"""Going about in a log: the index agrees with reading it through, grows with the file, and tells how
things stood."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.errors import RunLogError
from simmer_tui.run.events import ActionName
from simmer_tui.run.run_history import ElapsedTime
from simmer_tui.runlog.index import EntryFlag, RunLogIndex
from simmer_tui.runlog.log_records import (
    ActionRecord,
    AnswerRecord,
    BeliefRecord,
    BrokenLine,
    CheckpointRecord,
    EndRecord,
    LegEndRecord,
    LegRecord,
    NoticeRecord,
    PlanRecord,
    ReadingRecord,
)
from simmer_tui.runlog.playback import Playback
from simmer_tui.runlog.reader import LogReader
from simmer_tui.sim import Pose, Status


def read_through(path: Path) -> tuple[list[Any], list[float]]:
    with LogReader(path) as log:
        clock = ElapsedTime(log.header.t)
        entries: list[Any] = [line for _, line in log.lines()]
    times = []
    for entry in entries:
        if isinstance(entry, ActionRecord) and entry.action.restarts and not entry.refused:
            clock.restart(entry.t)
        times.append(clock.advance(entry.t))
    return entries, times


def wanted(line: Any) -> EntryFlag:
    match line:
        case BrokenLine():
            return EntryFlag.BROKEN
        case ReadingRecord():
            return EntryFlag.COMMAND
        case EndRecord():
            return EntryFlag.COMMAND | (EntryFlag.CONTACT if line.contact else EntryFlag(0))
        case AnswerRecord(status=Status.ACCEPTED) | NoticeRecord() | PlanRecord():
            return EntryFlag.OTHER
        case AnswerRecord():
            refused = line.status in (Status.UNKNOWN, Status.REFUSED, Status.BUSY)
            return EntryFlag.COMMAND | (EntryFlag.REFUSED if refused else EntryFlag(0))
        case ActionRecord():
            restarts = line.action in ("reset", "seed") and not line.refused
            return EntryFlag.ACTION | (EntryFlag.RESTART if restarts else EntryFlag(0))
        case BeliefRecord():
            return EntryFlag.BELIEF
        case CheckpointRecord():
            return EntryFlag.CHECKPOINT
    raise AssertionError(line)


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_the_index_agrees_with_reading_through(
    random_run: Callable[..., Any], seed: int, timed: bool
) -> None:
    path = random_run(seed, timed=timed).path
    entries, times = read_through(path)
    with RunLogIndex(path) as log:
        assert log.count == len(entries)
        assert [log.record(i) for i in range(log.count)] == entries
        assert [log.flags_of(i) for i in range(log.count)] == [wanted(entry) for entry in entries]
        assert [log.time_of(i) for i in range(log.count)] == times
        assert log.duration == max(times[-1], log.time_of(log.count - 1))


def test_a_log_written_again_by_another_program_reads_the_same(varied_log: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.jsonl"
    with other.open("w", newline="\r\n") as file:
        for line in varied_log.read_text().splitlines():
            file.write(json.dumps(dict(reversed(json.loads(line).items()))) + "\n")
    with RunLogIndex(varied_log) as first, RunLogIndex(other) as second:
        assert first.count == second.count
        for i in range(first.count):
            assert (first.flags_of(i), first.time_of(i)) == (second.flags_of(i), second.time_of(i))


def test_text_that_looks_like_a_field_is_no_contact(start_run: Any) -> None:
    run = start_run()
    run.send('u1,"contact":[1,2]', 'zz,"contact":[1', "d1-1")
    with RunLogIndex(run.path) as log:
        assert log.find_next(-1, EntryFlag.CONTACT) is None


@pytest.mark.parametrize("time", ["1.2.3", "1e", "--1", "", "1e999999"])
def test_a_line_with_no_time_does_not_spoil_its_neighbours(varied_log: Path, time: str) -> None:
    lines = varied_log.read_text().splitlines(keepends=True)
    _, rest = lines[3].split(",", 1)
    lines[3] = f'{{"t":{time},{rest}'
    varied_log.write_text("".join(lines))
    with RunLogIndex(varied_log) as log:
        assert log.count == len(lines) - 1
        assert log.flags_of(1) == EntryFlag.COMMAND
        assert log.flags_of(3) == EntryFlag.COMMAND
        assert all(log.time_of(i) <= log.time_of(i + 1) for i in range(log.count - 1))


def test_finding_a_time_gives_the_last_entry_till_then(random_run: Callable[..., Any]) -> None:
    with RunLogIndex(random_run(1, timed=True).path) as log:
        assert log.find_time(-1.0) == -1
        assert log.find_time(log.duration) == log.count - 1
        for step in range(50):
            elapsed = log.duration * step / 50
            i = log.find_time(elapsed)
            assert i == -1 or log.time_of(i) <= elapsed
            assert i == log.count - 1 or log.time_of(i + 1) > elapsed


def test_the_next_and_the_previous_of_each_kind_are_found(varied_log: Path) -> None:
    entries, _ = read_through(varied_log)
    marks = [wanted(entry) for entry in entries]
    with RunLogIndex(varied_log) as log:
        for mark in (EntryFlag.CONTACT, EntryFlag.FAULTY, EntryFlag.COMMAND):
            places = [i for i, each in enumerate(marks) if each & mark]
            assert places
            for i in range(-1, log.count):
                assert log.find_next(i, mark) == next((place for place in places if place > i), None)
                assert log.find_previous(i, mark) == next(
                    (place for place in reversed(places) if place < i), None
                )


def test_a_growing_log_is_followed_line_by_line(start_run: Any) -> None:
    run = start_run()
    with RunLogIndex(run.path) as log:
        assert (log.count, log.note) == (0, "")
        run.send("u1", "d1-3")
        assert log.refresh() == 3
        assert log.refresh() == 0
        whole = run.path.read_bytes()
        run.send("u1")
        line = run.path.read_bytes()[len(whole) :]
        run.path.write_bytes(whole + line[:30])
        assert log.refresh() == 0
        assert "cut off" in log.note
        run.path.write_bytes(whole + line)
        assert log.refresh() == 1
        assert log.note == ""
        entry = log.record(3)
        assert isinstance(entry, ReadingRecord)
        assert entry.n == 3


def test_a_log_that_has_been_replaced_is_told(start_run: Any) -> None:
    run = start_run()
    run.send("u1", "u1")
    data = run.path.read_bytes()
    with RunLogIndex(run.path) as log:
        run.path.write_bytes(data[:-100])
        with pytest.raises(RunLogError, match="replaced"):
            log.refresh()


def test_there_is_no_entry_outside(varied_log: Path) -> None:
    with RunLogIndex(varied_log) as log:
        for i in (-1, log.count):
            with pytest.raises(IndexError, match=f"^the log has entries 0 to {log.count - 1}, not {i}$"):
                log.record(i)


@pytest.mark.parametrize("lines", [6, 7])
def test_the_last_entry_is_one_less_than_their_number(varied_log: Path, lines: int) -> None:
    varied_log.write_bytes(b"".join(varied_log.read_bytes().splitlines(keepends=True)[:lines]))
    with RunLogIndex(varied_log) as log, pytest.raises(IndexError, match=f"0 to {lines - 2}, not 99"):
        log.record(99)


def test_a_broken_line_is_an_entry_that_says_so(varied_log: Path) -> None:
    lines = varied_log.read_bytes().splitlines(keepends=True)
    lines[4] = lines[4][:40] + b"}\n"
    varied_log.write_bytes(b"".join(lines))
    with RunLogIndex(varied_log) as log:
        entry = log.record(3)
        assert isinstance(entry, BrokenLine)
        assert str(entry).startswith("line 5 is broken")
        Playback(log).state_at(4)


# -- how things stood ------------------------------------------------------------------------------


def test_what_people_do_shows_in_the_state(start_run: Any) -> None:
    run = start_run()
    run.send("u1", "d1-5")
    run.perform(ActionName.BLOCK, 30.0, 45.0)
    run.believe(2.0)
    run.perform(ActionName.TELEPORT, 30.0, 42.0, 90.0)
    run.send("d1-1")
    run.perform(ActionName.RESET)
    with RunLogIndex(run.path) as log:
        playback = Playback(log)
        block = playback.state_at(1).block
        assert (block.x, block.y, block.heading) == (25.0, 41.0, 0.0)
        state = playback.state_at(4)
        assert state.belief is not None
        assert state.belief.pose.x - state.belief.true.x == pytest.approx(2.0)
        state = playback.state_at(6)
        assert (state.block.x, state.block.y) == (30.0, 45.0)
        assert tuple(state.path[0, :2]) == (30.0, 42.0)
        state = playback.state_at(8)
        assert (state.pose, state.block.x, state.block.y) == (Pose(9.5, 42.0, 0.0), 25.0, 41.0)
        assert (state.sensors, len(state.path), state.contacts, state.belief) == ({}, 0, 0, None)
        assert log.time_of(8) == log.time_of(7)


@pytest.mark.slow
def test_looking_back_is_bounded(start_run: Any) -> None:
    run = start_run()
    run.send("u3", *("d1-0",) * 2500)
    run.loop.run_until(run.loop.now)
    with RunLogIndex(run.path) as log:
        playback = Playback(log)
        assert "u3" in playback.state_at(10).sensors
        state = playback.state_at(log.count - 1)
        assert state.sensors == {}
        assert state.commands == 2501


def test_where_times_count_from_is_known_between_two_resets(start_run: Any) -> None:
    run = start_run()
    run.send("d1-3", "u1")
    first = run.simulator.time
    run.perform(ActionName.RESET)
    run.send("d1-6", "u1")
    second = run.simulator.time
    run.perform(ActionName.SEED, 3)
    run.send("d1-1", "u1")
    with RunLogIndex(run.path) as log:
        assert [log.zero_of(i) for i in range(11)] == [0.0] * 3 + [first] * 4 + [first + second] * 4
        assert [log.time_of(i) for i in range(1, 6)] == [*[first] * 4, first + second]
        assert log.duration == pytest.approx(first + second + run.simulator.time)


def test_a_compressed_log_is_moved_about_in(start_run: Any, tmp_path: Path) -> None:
    run = start_run()
    run.send("u1", "d1-3", "u1", "d1-60")
    packed = tmp_path / "run.jsonl.gz"
    packed.write_bytes(gzip.compress(run.path.read_bytes()))
    with RunLogIndex(run.path) as plain, RunLogIndex(packed) as log:
        assert log.count == plain.count == 6
        assert Playback(log).state_at(5).pose == Playback(plain).state_at(5).pose


def test_a_leg_that_is_cut_before_its_contact_has_none(start_run: Callable[..., Any]) -> None:
    run = start_run(timed=True)
    run.perform(ActionName.NOISE, 0.0)  # without errors a leg leads to the next wall
    for seconds in (1, 30):
        run.send("vv-4;0;0")
        run.loop.run_until(run.loop.now + seconds)
        run.send("vv-0;0;0")
    run.log.close()
    with RunLogIndex(run.path) as log:
        records = [log.record(i) for i in range(log.count)]
        planned = [each for each in records if isinstance(each, LegRecord) and each.contact is not None]
        assert len(planned) == 2
        (touched,) = log.find_all(EntryFlag.CONTACT)
        assert isinstance(ended := records[touched], LegEndRecord)
        assert (ended.n, ended.t, ended.contact) == (planned[1].n, planned[1].end, planned[1].contact)


def test_contacts_of_continuous_motion_long_before_a_moment_are_known(start_run: Callable[..., Any]) -> None:
    run = start_run(timed=True)
    run.send("vv-4;0;0")
    run.loop.run_until(run.loop.now + 30)
    run.send("vv-0;0;0")
    for _ in range(1200):
        run.send("u1")
        run.loop.run_until(run.loop.now + 0.5)
    run.look()
    run.log.close()
    state = run.moments[-1][2]
    assert len(state.contact_points) == 1
    with RunLogIndex(run.path) as log:
        playback = Playback(log)
        for entry in (log.count - 1, log.count - 2):  # the second one is a step back, from a checkpoint
            assert playback.state_at(entry).contact_points == state.contact_points
