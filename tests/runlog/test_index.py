"""Going about in a log: the index agrees with reading it through, grows with the file, and tells how
things stood."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.errors import RunLogError
from simmer_tui.events import ActionName
from simmer_tui.runlog.entries import ActionEntry, BrokenEntry, CommandEntry
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.reader import ElapsedTime, LogReader
from simmer_tui.runlog.scan import Mark
from simmer_tui.sim import Pose


def read_through(path: Path) -> tuple[list[Any], list[float]]:
    with LogReader(path) as log:
        clock = ElapsedTime(log.header.t)
        entries = list(log)
    return entries, [clock.advance(entry) for entry in entries]


def wanted(entry: Any) -> Mark:
    marks = {
        "CommandEntry": Mark.COMMAND,
        "ActionEntry": Mark.ACTION,
        "BeliefEntry": Mark.BELIEF,
        "NoticeEntry": Mark.NOTICE,
        "BrokenEntry": Mark.BROKEN,
    }[type(entry).__name__]
    if isinstance(entry, ActionEntry) and entry.restarts:
        marks |= Mark.RESTART
    if isinstance(entry, CommandEntry):
        marks |= Mark.CONTACT if entry.contact else Mark(0)
        marks |= Mark.REFUSED if entry.refused else Mark(0)
    return marks


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_the_index_agrees_with_reading_through(
    random_run: Callable[..., Path], seed: int, timed: bool
) -> None:
    path = random_run(seed, timed=timed)
    entries, times = read_through(path)
    with RunLogIndex(path) as log:
        assert log.count == len(entries)
        assert [type(log.entry(i)) for i in range(log.count)] == [type(entry) for entry in entries]
        assert [log.entry(i).line for i in range(log.count)] == list(range(2, len(entries) + 2))
        assert [log.marks_of(i) for i in range(log.count)] == [wanted(entry) for entry in entries]
        assert [log.time_of(i) for i in range(log.count)] == times
        assert log.duration == times[-1]


def test_a_log_written_anew_by_another_program_reads_the_same(varied_log: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.jsonl"
    with other.open("w", newline="\r\n") as file:
        for line in varied_log.read_text().splitlines():
            file.write(json.dumps(dict(reversed(json.loads(line).items()))) + "\n")
    with RunLogIndex(varied_log) as first, RunLogIndex(other) as second:
        assert first.count == second.count
        for i in range(first.count):
            assert (first.marks_of(i), first.time_of(i)) == (second.marks_of(i), second.time_of(i))


def test_text_that_looks_like_a_field_is_no_contact(start_run: Any) -> None:
    run = start_run()
    run.send('u1,"contact":[1,2]', 'zz,"contact":[1', "d1-1")
    with RunLogIndex(run.path) as log:
        assert log.next_contact(-1) is None


@pytest.mark.parametrize("time", ["1.2.3", "1e", "--1", "", "1e999999"])
def test_a_line_with_no_time_does_not_spoil_its_neighbours(varied_log: Path, time: str) -> None:
    lines = varied_log.read_text().splitlines(keepends=True)
    _, rest = lines[3].split(",", 1)
    lines[3] = f'{{"t":{time},{rest}'
    varied_log.write_text("".join(lines))
    with RunLogIndex(varied_log) as log:
        assert log.count == len(lines) - 1
        assert log.marks_of(1) == Mark.COMMAND
        assert log.marks_of(3) == Mark.COMMAND
        assert all(log.time_of(i) <= log.time_of(i + 1) for i in range(log.count - 1))


def test_finding_a_time_gives_the_last_entry_till_then(random_run: Callable[..., Path]) -> None:
    with RunLogIndex(random_run(1, timed=True)) as log:
        assert log.find_time(-1.0) == 0
        assert log.find_time(log.duration) == log.count - 1
        for step in range(50):
            elapsed = log.duration * step / 50
            i = log.find_time(elapsed)
            assert i == 0 or log.time_of(i) <= elapsed
            assert i == log.count - 1 or log.time_of(i + 1) > elapsed


def test_the_next_and_the_previous_of_each_kind_are_found(varied_log: Path) -> None:
    entries, _ = read_through(varied_log)
    marks = [wanted(entry) for entry in entries]
    with RunLogIndex(varied_log) as log:
        for mark, following, preceding in (
            (Mark.CONTACT, log.next_contact, log.previous_contact),
            (Mark.REFUSED, log.next_refused, log.previous_refused),
            (Mark.COMMAND, log.next_command, log.previous_command),
        ):
            places = [i for i, each in enumerate(marks) if each & mark]
            assert places
            for i in range(-1, log.count):
                assert following(i) == next((place for place in places if place > i), None)
                assert preceding(i) == next((place for place in reversed(places) if place < i), None)


def test_a_growing_log_is_followed_line_by_line(start_run: Any) -> None:
    run = start_run()
    with RunLogIndex(run.path) as log:
        assert (log.count, log.note) == (0, "")
        run.send("u1", "d1-3")
        assert log.refresh() == 2
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
        entry = log.entry(2)
        assert isinstance(entry, CommandEntry)
        assert entry.number == 3


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
            with pytest.raises(IndexError, match="entries 0 to"):
                log.entry(i)


def test_a_broken_line_is_an_entry_that_says_so(varied_log: Path) -> None:
    lines = varied_log.read_bytes().splitlines(keepends=True)
    lines[4] = lines[4][:60] + b"}\n"
    varied_log.write_bytes(b"".join(lines))
    with RunLogIndex(varied_log) as log:
        entry = log.entry(3)
        assert isinstance(entry, BrokenEntry)
        assert str(entry).startswith("line 5 is broken")
        log.state_at(4)


# -- how things stood ------------------------------------------------------------------------------


def test_the_state_follows_an_instant_run(start_run: Any) -> None:
    run = start_run()
    seen = []
    for text in ("u1", "d1-5", "u1", "r1-90", "d1-60", "u3", "zz"):
        run.send(text)
        seen.append((run.simulator.pose, run.simulator.contacts))
    with RunLogIndex(run.path) as log:
        for i, (pose, contacts) in enumerate(seen):
            state = log.state_at(i)
            assert state.pose == pose
            assert len(state.contacts) == contacts
            assert not state.moving
        assert set(state.readings) == {"ultra1", "ultra3"}
        assert state.readings["ultra1"].number == 3
        assert state.trail[0] == (9.5, 42.0)
        assert state.trail[-1] == (pose.x, pose.y)


@pytest.mark.parametrize("answer_at_end", [True, False])
def test_between_two_lines_the_robot_is_where_it_was(start_run: Any, answer_at_end: bool) -> None:
    run = start_run(timed=True, answer_at_end=answer_at_end)
    start = run.loop.now
    run.send("d1-12")
    poses: list[tuple[float, Pose, bool]] = []
    for tick in range(1, 60):
        run.loop.run_until(start + tick * 0.1)
        if tick == 30:
            run.send("r1-90")
        if tick == 50:
            run.send("d1-6")
        if tick == 55:
            run.perform(ActionName.STOP)
        run.engine.now()
        if tick in (30, 50):
            continue  # at the very beginning of a movement the robot still stands
        poses.append((run.simulator.time, run.simulator.pose, run.simulator.moving))
    run.send("u1")
    moved = 0
    with RunLogIndex(run.path) as log:
        for elapsed, pose, moving in poses:
            state = log.state_at_time(elapsed)
            assert math.hypot(state.pose.x - pose.x, state.pose.y - pose.y) < 0.2
            assert abs(state.pose.heading - pose.heading) < 3
            assert state.moving == moving
            moved += moving
    assert moved > 20


def test_what_people_do_shows_in_the_state(start_run: Any) -> None:
    run = start_run()
    run.send("u1", "d1-5")
    run.perform(ActionName.BLOCK, 30.0, 45.0)
    run.believe(2.0)
    run.perform(ActionName.TELEPORT, 30.0, 42.0, 90.0)
    run.send("d1-1")
    run.perform(ActionName.RESET)
    with RunLogIndex(run.path) as log:
        assert log.state_at(1).block == Pose(25.0, 41.0, 0.0)
        state = log.state_at(5)
        assert state.block == Pose(30.0, 45.0, 0.0)
        assert state.belief is not None
        assert state.belief.believed.x - state.belief.pose.x == pytest.approx(2.0)
        assert state.trail[0] == (30.0, 42.0)
        state = log.state_at(6)
        assert (state.pose, state.block) == (Pose(9.5, 42.0, 0.0), Pose(25.0, 41.0, 0.0))
        assert (state.readings, state.trail, state.contacts, state.belief) == ({}, (), (), None)
        assert log.time_of(6) == log.time_of(5)


def test_a_held_block_moves_with_the_robot(tmp_path: Path, configuration: Any) -> None:
    from dataclasses import replace

    from simmer_tui.runlog.writer import RunLog
    from simmer_tui.sim import GripperSpec, Simulator

    simulation = replace(
        configuration.simulation,
        gripper=GripperSpec(code="p1", reach=6.0, width=6.0),
        bot_center=(18.0, 41.0),
    )
    simulator = Simulator(simulation, 7)
    with RunLog(tmp_path / "grip.jsonl", configuration, simulator) as run:
        for text in ("u1", "p1-1", "r1-40", "d1-2", "p1-0", "d1--3"):
            run(simulator.execute(text))
            if text == "d1-2":
                held = simulator.block
    end = simulator.block
    with RunLogIndex(tmp_path / "grip.jsonl") as log:
        carried = log.state_at(3)
        assert carried.holding
        assert (carried.block.x, carried.block.y) == pytest.approx((held.x, held.y))
        assert carried.block.heading == pytest.approx(held.heading)
        after = log.state_at(5)
        assert not after.holding
        assert (after.block.x, after.block.y) == (end.x, end.y)
        assert [log.state_at(i).holding for i in range(6)] == [False, True, True, True, False, False]


def test_looking_back_is_bounded(start_run: Any) -> None:
    run = start_run()
    run.send("u3", *("d1-0",) * 1000)
    run.loop.run_until(run.loop.now)
    with RunLogIndex(run.path) as log:
        assert "ultra3" in log.state_at(10).readings
        state = log.state_at(log.count - 1)
        assert len(state.trail) <= 400 * 11
        assert state.readings == {}
